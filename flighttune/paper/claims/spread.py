"""Claims of section 5.2.2 on means and deviations over the whole flight: Fig. 9."""

from collections.abc import Iterator

import numpy as np

from flighttune.paper.claims.base import Check, Claim, lower_with_higher_R_K, nothing
from flighttune.paper.study import Study

ORDER_OF_1E3 = 1e-2
"""Below this a difference is at most of the order of 1e-3."""

INVERSE = 0.95
"""Correlation of a deviation with 1 / R_K from which the relation is called inverse."""


def minor_means(study: Study) -> Iterator[Check]:
    """The mean rate of error differs by some 1e-3 over the gain sets."""
    for channel in ("chi_dot", "gamma_dot"):
        values = study.of_gains(channel, "mean")
        spread = float(values.max() - values.min())
        what = f"spread of the mean of {channel} over the gain sets [rad/s]"
        yield Check(what, "of the order of 1e-3", spread, spread < ORDER_OF_1E3)


def inverse_deviation(study: Study) -> Iterator[Check]:
    """The deviation of the rates of error is proportional to 1 / R_K, about."""
    for channel in ("chi_dot", "gamma_dot"):
        values = study.of_gains(channel, "std")
        R_K = study.indicator("R_K").loc[values.index].to_numpy()
        stable = (R_K > 0.0).all()
        found = float(np.corrcoef(1.0 / R_K, values)[0, 1]) if stable else 0.0
        what = f"correlation of 1/R_K and the deviation of {channel}"
        yield Check(what, f"≥ {INVERSE:g}", found, found >= INVERSE)
        yield lower_with_higher_R_K(f"deviation of {channel} lower with higher R_K", values)


def less_energy(study: Study) -> Iterator[Check]:
    """The energy of the rates of error falls with rising R_K."""
    for channel in ("chi_dot", "gamma_dot"):
        values = study.of_gains(channel, "energy")
        yield lower_with_higher_R_K(f"energy of {channel} lower with higher R_K", values)


WHERE = "section 5.2.2"

CLAIMS = (
    Claim(
        id="minor-means",
        text="effects on the mean of the error rates are minor, of the order of 1e-3",
        where=f"{WHERE}, Fig. 9 (c), (g)",
        checks=minor_means,
    ),
    Claim(
        id="inverse-deviation",
        text="R_K has an approximately inverse relationship with the deviations of the rates",
        where=f"{WHERE}, Fig. 9 (d), (h)",
        checks=inverse_deviation,
    ),
    Claim(
        id="less-energy",
        text="a larger R_K reduces the energy of the error derivatives",
        where=f"{WHERE}, last paragraph",
        checks=less_energy,
    ),
    Claim(
        id="influence-through-rates",
        text="the influences on the errors originate from their actions on the rates",
        where=f"{WHERE}, Fig. 9 (b), (d), (f), (h)",
        checks=nothing,
        missing="a cause, which no comparison of two deviations can show",
    ),
)
