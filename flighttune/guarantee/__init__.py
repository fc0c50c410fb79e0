"""A claim about the linear loop, held against a flight."""
