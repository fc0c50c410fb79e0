"""Numbers compared to the bit."""

import numpy as np
import numpy.typing as npt


def same_bits(a: npt.ArrayLike, b: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Where numbers are equal to the bit, also in the sign of a zero; NaN is equal to NaN."""
    x, y = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    return ((x == y) & (np.signbit(x) == np.signbit(y))) | (np.isnan(x) & np.isnan(y))
