"""Bounds of the linear loop held against flights of the law, and the mismatch of an aircraft."""
