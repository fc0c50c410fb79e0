"""The paper's five measures of any signal over time: errors, their rates, and both together."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray

# Columns of `measures`; the unit is rad for errors and rad/s for their rates.
MEASURES = {
    "ITAE": "unit s^2",
    "MO_rad": "unit",
    "PT_s": "s",
    "MS_rad": "unit",
    "ST_rad": "unit",
    "mean": "unit",
    "std": "unit",
    "energy": "unit^2 s",
}

# Errors, their rates, and `s = sqrt(e^2 + e_dot^2)`.
CHANNELS = ("chi", "gamma", "chi_dot", "gamma_dot", "s_chi", "s_gamma")


def measures(t: FloatArray, signals: Mapping[str, FloatArray]) -> pd.DataFrame:
    """The paper's measures of each signal: a row per signal, columns `MEASURES`.

    Every signal should go to zero; `t` is equally spaced, from zero.

    Notes
    -----
    ITAE is the integral of ``t |x|`` by the trapezoidal rule; MO the largest value of x and PT its
    time (the errors of the paper begin below zero and overshoot upwards); MS and ST the mean and
    standard deviation over the last quarter; mean and std those over the whole time; energy the
    integral of x^2. Section 5.2 of arXiv 2411.13140, in words.
    """
    late = t >= 0.75 * t[-1]
    rows = {}
    for name, x in signals.items():
        peak = int(np.argmax(x))
        rows[name] = {
            "ITAE": float(np.trapezoid(t * np.abs(x), t)),
            "MO_rad": max(0.0, float(x[peak])),
            "PT_s": float(t[peak]),
            "MS_rad": float(np.mean(x[late])),
            "ST_rad": float(np.std(x[late])),
            "mean": float(np.mean(x)),
            "std": float(np.std(x)),
            "energy": float(np.trapezoid(x**2, t)),
        }
    return pd.DataFrame.from_dict(rows, orient="index", columns=list(MEASURES))
