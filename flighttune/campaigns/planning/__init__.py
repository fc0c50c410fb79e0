"""Campaign files, and the runs they plan."""
