"""Runs side by side: what differs, which is better, and whether it is within tolerance."""

from flighttune.comparison.compare import Comparison, Source, compare, load_source
from flighttune.comparison.tolerance import Tolerance, load_tolerances, violations

__all__ = [
    "Comparison",
    "Source",
    "Tolerance",
    "compare",
    "load_source",
    "load_tolerances",
    "violations",
]
