"""Parts shared by every output: colours, names, numbers, tables and the frame of a page."""
