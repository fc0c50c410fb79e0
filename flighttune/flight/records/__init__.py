"""A run as a table and a file, flown again, and beside others."""
