"""Runs side by side: what differs, which is better, and whether it is within tolerance."""

from flighttune.comparison.compare import Comparison, Source, compare, load_source

__all__ = ["Comparison", "Source", "compare", "load_source"]
