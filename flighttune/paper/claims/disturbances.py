"""Claims of section 5.2.3: K* under the disturbances d1 to d9."""

from collections.abc import Callable, Iterator

import numpy as np
import pandas as pd

from flighttune.paper import parameters as printed
from flighttune.paper.claims.base import Check, Claim
from flighttune.paper.flight import NEAR
from flighttune.paper.study import Study

NOT_SIGNIFICANT = 0.1
"""A relative rise above this is significant."""

LINEAR = 0.95
"""R^2 of a straight line from which a relation is called linear."""

MINIMAL = 1e-2
"""Growth below this is of the order of 1e-3 at most, rad."""

PRONOUNCED = 0.5
"""A relative rise from here on is a pronounced upward trend."""


def near_origin(study: Study) -> Iterator[Check]:
    """After 20 s the errors stay near the origin, for nearly all disturbances."""
    for channel in ("chi", "gamma"):
        left = {n: f.after(channel, printed.DURATION) for n, f in study.disturbed.items()}
        near = sum(value < NEAR for value in left.values())
        what = f"disturbances with |e_{channel}| < {NEAR:g} rad after 20 s"
        yield Check(
            what, "≥ 8 of 9", f"{near} of 9, largest {max(left.values()):.3g} rad", near >= 8
        )


def _along_both(
    table: pd.DataFrame, what: str, *, rising: bool, flat: float = 0.0
) -> Iterator[Check]:
    """A table over L_d and omega_d must rise (or fall) at every step along each."""
    sign = 1.0 if rising else -1.0
    for axis, name in ((0, "L_d"), (1, "ω_d")):
        change = sign * np.diff(table.to_numpy(), axis=axis)
        good = int((change > flat).sum())
        word = "rises" if rising else "falls"
        yield Check(
            f"{what} {word} with {name}",
            f"{change.size} of {change.size} steps",
            f"{good} of {change.size} steps",
            good == change.size,
        )


def smaller_overshoot(study: Study) -> Iterator[Check]:
    """MO of the course error falls with L_d and with omega_d."""
    yield from _along_both(study.of_disturbances("chi", "MO_rad"), "MO of e_chi", rising=False)


def larger_afterwards(study: Study) -> Iterator[Check]:
    """The largest error after 20 s rises with L_d and with omega_d."""
    keys = pd.DataFrame.from_dict(printed.TABLE_3, orient="index", columns=["L_d", "omega_d"])
    for channel in ("chi", "gamma"):
        left = {n: f.after(channel, printed.DURATION) for n, f in study.disturbed.items()}
        table = keys.assign(value=pd.Series(left)).pivot(
            index="L_d", columns="omega_d", values="value"
        )
        yield from _along_both(table, f"largest |e_{channel}| after 20 s", rising=True)


def insensitive_ITAE(study: Study) -> Iterator[Check]:
    """For L_d = 0.1 and 0.3, ITAE does not rise significantly with omega_d."""
    for L_d in (0.1, 0.3):
        for channel in ("chi", "gamma"):
            row = study.of_disturbances(channel, "ITAE").loc[L_d]
            rise = float(row.max() / row.iloc[0] - 1.0)
            what = f"largest relative rise of ITAE of e_{channel} with ω_d, L_d = {L_d:g}"
            yield Check(what, f"≤ {NOT_SIGNIFICANT:g}", rise, rise <= NOT_SIGNIFICANT)


def decreasing_ITAE(study: Study) -> Iterator[Check]:
    """For L_d = 0.1 and 0.3, a straight line through ITAE over omega_d falls."""
    for L_d in (0.1, 0.3):
        for channel in ("chi", "gamma"):
            row = study.of_disturbances(channel, "ITAE").loc[L_d]
            omega = row.index.to_numpy(dtype=float)
            slope = np.polyfit(omega, row.to_numpy(), 1)[0]
            change = float(slope * np.ptp(omega) / row.iloc[0])
            what = f"relative change of ITAE of e_{channel} along a line over ω_d, L_d = {L_d:g}"
            yield Check(what, "< 0", change, change < 0.0)


def rising_MS(study: Study) -> Iterator[Check]:
    """MS rises with omega_d and L_d."""
    for channel in ("s_chi", "s_gamma"):
        table = study.of_disturbances(channel, "MS_rad")
        yield from _along_both(table, f"MS of {channel}", rising=True)


def _fit(x: np.ndarray, y: np.ndarray) -> float:
    """R^2 of a straight line."""
    return float(np.corrcoef(x, y)[0, 1] ** 2)


def linear_MS(study: Study) -> Iterator[Check]:
    """MS follows a straight line in L_d for each omega_d."""
    for channel in ("s_chi", "s_gamma"):
        table = study.of_disturbances(channel, "MS_rad")
        for omega in table.columns:
            fit = _fit(table.index.to_numpy(dtype=float), table[omega].to_numpy())
            what = f"R² of MS of {channel} over L_d, ω_d = {omega:g}"
            yield Check(what, f"≥ {LINEAR:g}", fit, fit >= LINEAR)


def rising_ST(study: Study) -> Iterator[Check]:
    """ST rises with L_d at every omega_d."""
    for channel in ("s_chi", "s_gamma"):
        yield next(
            _along_both(study.of_disturbances(channel, "ST_rad"), f"ST of {channel}", rising=True)
        )


def minimal_ST(study: Study) -> Iterator[Check]:
    """The growth of ST from the smallest to the largest L_d is of the order of 1e-3."""
    for channel in ("s_chi", "s_gamma"):
        table = study.of_disturbances(channel, "ST_rad")
        growth = float((table.loc[0.3] - table.loc[0.1]).abs().max())
        what = f"largest growth of ST of {channel} from L_d = 0.1 to 0.3 [rad]"
        yield Check(what, "of the order of 1e-3", growth, growth < MINIMAL)


def insensitive_ST(study: Study) -> Iterator[Check]:
    """ST does not rise by half or more from the lowest omega_d to the highest, at any L_d."""
    for channel in ("s_chi", "s_gamma"):
        table = study.of_disturbances(channel, "ST_rad")
        rise = table.iloc[:, -1] / table.iloc[:, 0] - 1.0
        many = int((rise >= PRONOUNCED).sum())
        what = f"amplitudes at which ST of {channel} rises by half or more with ω_d"
        yield Check(what, "0 of 3", f"{many} of 3, largest {rise.max():+.0%}", many == 0)


def _claim(id: str, text: str, place: str, checks: Callable[[Study], Iterator[Check]]) -> Claim:
    return Claim(id=id, text=text, where=f"section 5.2.3, {place}", checks=checks)


CLAIMS = (
    _claim(
        "near-origin",
        "nearly all curves stabilise near the origin after 20 s",
        "Fig. 11",
        near_origin,
    ),
    _claim(
        "smaller-overshoot",
        "with larger L_d and ω_d the overshoot of e_chi decreases",
        "Fig. 11 (a)",
        smaller_overshoot,
    ),
    _claim(
        "larger-afterwards",
        "the amplitudes of both errors after 20 s increase accordingly",
        "Fig. 11 (a), (b)",
        larger_afterwards,
    ),
    _claim(
        "insensitive-ITAE",
        "for L_d = 0.1 and 0.3 no significant rise of ITAE with ω_d",
        "Fig. 10 (a)",
        insensitive_ITAE,
    ),
    _claim(
        "decreasing-ITAE",
        "for L_d = 0.1 and 0.3 “there is even a decreasing trend” of ITAE with ω_d",
        "Fig. 10 (a)",
        decreasing_ITAE,
    ),
    _claim(
        "rising-MS", "increasing ω_d and L_d enhances the impact on MS", "Fig. 10 (b)", rising_MS
    ),
    _claim("linear-MS", "this impact exhibits linearity", "Fig. 10 (b)", linear_MS),
    _claim("rising-ST", "an increase in L_d leads to a rise in ST", "Fig. 10 (c)", rising_ST),
    _claim("minimal-ST", "the growth of ST is of the order of 1e-3", "Fig. 10 (c)", minimal_ST),
    _claim(
        "insensitive-ST",
        "ST shows no pronounced upward trend with ω_d",
        "Fig. 10 (c)",
        insensitive_ST,
    ),
)
