"""Flies runs of a plan to rows."""
