"""Campaign files, and the runs that they plan."""
