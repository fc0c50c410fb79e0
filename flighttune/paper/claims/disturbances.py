"""Claims of section 5.2.3: K* under the disturbances d1 to d9."""

import numpy as np
import pandas as pd

from flighttune.paper import parameters as printed
from flighttune.paper.claims.base import Check, Checks, all_steps, at_least, at_most, below
from flighttune.paper.claims.thresholds import (
    LINEAR,
    NEARLY_ALL,
    NOT_SIGNIFICANT,
    ORDER_OF_1E3,
    PRONOUNCED,
)
from flighttune.paper.flight import NEAR
from flighttune.paper.study import Study

# The L_d for which the text speaks of ITAE over omega_d.
STATED_AMPLITUDES = (0.1, 0.3)


def _largest_after_20_s(study: Study, channel: str) -> pd.Series:
    return pd.Series(
        {name: flight.after(channel, printed.DURATION) for name, flight in study.disturbed.items()}
    )


def _steps_along(table: pd.DataFrame, what: str, *, axis: int, rising: bool = True) -> Check:
    """A table over L_d (axis 0) and omega_d (1) must rise, or fall, at every step along one."""
    change = np.diff(table.to_numpy(), axis=axis)
    agreeing = int(((change if rising else -change) > 0.0).sum())
    word, name = "rises" if rising else "falls", ("L_d", "ω_d")[axis]
    return all_steps(f"{what} {word} with {name}", agreeing, change.size)


def near_origin(study: Study) -> Checks:
    """After 20 s the errors stay near the origin, for nearly all disturbances."""
    for channel in ("chi", "gamma"):
        left = _largest_after_20_s(study, channel)
        near = int((left < NEAR).sum())
        what = f"disturbances with |e_{channel}| < {NEAR:g} rad after 20 s"
        computed = f"{near} of 9, largest {left.max():.3g} rad"
        yield Check(what, f"≥ {NEARLY_ALL} of 9", computed, near >= NEARLY_ALL)


def smaller_overshoot(study: Study) -> Checks:
    """MO of the course error falls with L_d and with omega_d."""
    overshoot = study.of_disturbances("chi", "MO_rad")
    for axis in (0, 1):
        yield _steps_along(overshoot, "MO of e_chi", axis=axis, rising=False)


def larger_afterwards(study: Study) -> Checks:
    """The largest error after 20 s rises with L_d and with omega_d."""
    for channel in ("chi", "gamma"):
        left = study.over_disturbances(_largest_after_20_s(study, channel))
        for axis in (0, 1):
            yield _steps_along(left, f"largest |e_{channel}| after 20 s", axis=axis)


def insensitive_ITAE(study: Study) -> Checks:
    """For the stated L_d, ITAE does not rise significantly with omega_d."""
    for L_d in STATED_AMPLITUDES:
        for channel in ("chi", "gamma"):
            row = study.of_disturbances(channel, "ITAE").loc[L_d]
            rise = float(row.max() / row.iloc[0] - 1.0)
            what = f"largest relative rise of ITAE of e_{channel} with ω_d, L_d = {L_d:g}"
            yield at_most(what, rise, NOT_SIGNIFICANT)


def decreasing_ITAE(study: Study) -> Checks:
    """For the stated L_d, a straight line through ITAE over omega_d falls."""
    for L_d in STATED_AMPLITUDES:
        for channel in ("chi", "gamma"):
            row = study.of_disturbances(channel, "ITAE").loc[L_d]
            omega = row.index.to_numpy(dtype=float)
            slope = np.polyfit(omega, row.to_numpy(), 1)[0]
            change = float(slope * np.ptp(omega) / row.iloc[0])
            what = f"relative change of ITAE of e_{channel} along a line over ω_d, L_d = {L_d:g}"
            yield below(what, change, 0.0)


def rising_MS(study: Study) -> Checks:
    """MS rises with omega_d and L_d."""
    for channel in ("s_chi", "s_gamma"):
        MS = study.of_disturbances(channel, "MS_rad")
        for axis in (0, 1):
            yield _steps_along(MS, f"MS of {channel}", axis=axis)


def linear_MS(study: Study) -> Checks:
    """MS follows a straight line in L_d for each omega_d."""
    for channel in ("s_chi", "s_gamma"):
        table = study.of_disturbances(channel, "MS_rad")
        for omega in table.columns:
            R_squared = float(np.corrcoef(table.index.astype(float), table[omega])[0, 1] ** 2)
            yield at_least(f"R² of MS of {channel} over L_d, ω_d = {omega:g}", R_squared, LINEAR)


def rising_ST(study: Study) -> Checks:
    """ST rises with L_d at every omega_d."""
    for channel in ("s_chi", "s_gamma"):
        yield _steps_along(study.of_disturbances(channel, "ST_rad"), f"ST of {channel}", axis=0)


def minimal_ST(study: Study) -> Checks:
    """The growth of ST from the smallest to the largest L_d is of the order of 1e-3."""
    for channel in ("s_chi", "s_gamma"):
        growth = study.growth_of_ST(channel)
        what = f"largest growth of ST of {channel} from L_d = 0.1 to 0.3 [rad]"
        yield Check(what, "of the order of 1e-3", growth, growth < ORDER_OF_1E3)


def insensitive_ST(study: Study) -> Checks:
    """ST does not rise by half or more from the lowest omega_d to the highest, at any L_d."""
    for channel in ("s_chi", "s_gamma"):
        table = study.of_disturbances(channel, "ST_rad")
        rise = table.iloc[:, -1] / table.iloc[:, 0] - 1.0
        count = int((rise >= PRONOUNCED).sum())
        what = f"amplitudes at which ST of {channel} rises by half or more with ω_d"
        yield Check(what, "0 of 3", f"{count} of 3, largest {rise.max():+.0%}", count == 0)
