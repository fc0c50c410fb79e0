"""Numbers taken for the words of the paper.

Where the paper gives words and no number, a verdict needs one. Each is the mildest that an engineer
would still accept for the word, so that a claim fails for what comes out and not for a strict
reading. The page prints them in the column “expected”.
"""

# "A very small region": error left at the end, rad. 2 % of the first error in course, the usual
# band of a settling time.
VERY_SMALL = 0.02

# "Exponential stabilisation": share of the first state left after 20 s without disturbance.
SETTLED = 0.01

# "Assesses", "correlates": size of a rank correlation over the seven gain sets. Only 17 of the 5040
# orders of seven reach it, so that chance does so once in 300 times.
CORRELATED = 0.9

# "Linearity": R^2 of a straight line.
LINEAR = 0.95

# "Approximately inverse": correlation of a quantity with 1 / R_K.
INVERSE = 0.95

# "Of the order of 1e-3", "minor": anything below the next power of ten.
ORDER_OF_1E3 = 1e-2

# "No significant rise": relative rise up to which none is seen in the paper's figures.
NOT_SIGNIFICANT = 0.1

# "Pronounced upward trend": relative rise from here on.
PRONOUNCED = 0.5

# "Nearly all curves": of the nine disturbances.
NEARLY_ALL = 8

# "Optimal": relative distance from the best R_K. The printed gains have four decimals, which move
# R_K by less than 1e-4 of itself.
AS_GOOD = 1e-3

# Distance at which two Jacobians, or a rate and zero, are the same: the error of central
# differences with a step of 1e-6.
DERIVATIVE = 1e-8

# Excess of a limited command over its limit that is rounding.
ROUNDING = 1e-9
