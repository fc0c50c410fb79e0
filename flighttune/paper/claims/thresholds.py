"""Numbers taken for the words of the paper.

Where the paper gives words and no number, a verdict needs one. Each is the mildest that an engineer
would still accept for the word, so that a claim fails for what comes out and not for a strict
reading. The page prints them in the column “expected”.
"""

VERY_SMALL = 0.02
""""A very small region": error left at the end, rad. 2 % of the first error in course, the usual
band of a settling time."""

SETTLED = 0.01
""""Exponential stabilisation": share of the first state left after 20 s without disturbance."""

CORRELATED = 0.9
""""Assesses", "correlates": size of a rank correlation over the seven gain sets. Only 17 of the
5040 orders of seven reach it, so that chance does so once in 300 times."""

LINEAR = 0.95
""""Linearity": R^2 of a straight line."""

INVERSE = 0.95
""""Approximately inverse": correlation of a quantity with 1 / R_K."""

ORDER_OF_1E3 = 1e-2
""""Of the order of 1e-3", "minor": anything below the next power of ten."""

NOT_SIGNIFICANT = 0.1
""""No significant rise": relative rise up to which none is seen in the paper's figures."""

PRONOUNCED = 0.5
""""Pronounced upward trend": relative rise from here on."""

NEARLY_ALL = 8
""""Nearly all curves": of the nine disturbances."""

AS_GOOD = 1e-3
""""Optimal": relative distance from the best R_K. The printed gains have four decimals, which
move R_K by less than 1e-4 of itself."""

DERIVATIVE = 1e-8
"""Distance at which two Jacobians, or a rate and zero, are the same: the error of central
differences with a step of 1e-6."""

ROUNDING = 1e-9
"""Excess of a limited command over its limit that is rounding."""
