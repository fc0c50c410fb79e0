"""Make ``flighttune/base/hard_arguments.txt``: arguments whose values are hardest to round.

The exact value lies within a thousandth of a digit from the middle between two doubles, so that
another algorithm, or the same one with other roundings, often gives the other neighbour.
"""

from pathlib import Path

import mpmath

from flighttune.base import c_library

COUNT, GRID = 91, 2**16
EXACT = {"log10": mpmath.log10, "pow": mpmath.power}


def distance(value):
    """Distance of an exact value from the middle of two doubles, in units of the last place."""
    with mpmath.workprec(160):
        mantissa, _ = mpmath.frexp(abs(value))
        return abs(mpmath.frac(mantissa * 2**53) - 0.5)


def hardest(name):
    function = EXACT.get(name) or getattr(mpmath, name)
    with mpmath.workprec(160):
        far = {
            k: distance(function(*map(mpmath.mpf, c_library.arguments(name, k))))
            for k in range(1, GRID)
        }
    return sorted(sorted(far, key=far.get)[:COUNT])


if __name__ == "__main__":
    lines = [" ".join([name, *map(str, hardest(name))]) for name in c_library.RANGES]
    place = Path(__file__).parents[3] / "flighttune/base/hard_arguments.txt"
    place.write_text("\n".join(lines) + "\n")
