"""A run as a table and a file, and its repetition."""
