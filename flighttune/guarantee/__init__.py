"""Bounds of the linear loop compared with flights of the law, and the mismatch of an aircraft."""
