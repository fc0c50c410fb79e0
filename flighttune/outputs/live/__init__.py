"""A page in the browser on which gains are moved, and its server."""
