"""Runs of a plan, flown to rows."""
