"""Runs side by side: what differs, which is better, and whether it is within tolerance."""

from flighttune.comparison.compare import Comparison, Pair, Source, compare, load_source
from flighttune.comparison.tolerance import Tolerance, Violation, load_tolerances, violations

__all__ = [
    "Comparison",
    "Pair",
    "Source",
    "Tolerance",
    "Violation",
    "compare",
    "load_source",
    "load_tolerances",
    "violations",
]
