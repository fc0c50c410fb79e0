"""Matrices in, guarantees out: no aircraft, no time."""
