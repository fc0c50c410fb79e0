"""Proven bounds on all errors that the flights of a scenario can have: docs/tube.md."""
