"""What every output shares: colours, names, numbers, tables and the frame of a page."""
