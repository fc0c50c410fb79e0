"""A page in the browser on which gains are moved, and the server of it on this machine alone."""
