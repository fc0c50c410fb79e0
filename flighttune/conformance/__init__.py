"""Boxes of an aircraft's residual rates against the exact point mass behind its identified lag."""
