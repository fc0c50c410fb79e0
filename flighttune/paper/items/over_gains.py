"""Panels of a measure over R_K or I_K that several items share."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from flighttune.paper import style
from flighttune.paper.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AXES = {"R_K": style.R_K_AXIS, "I_K": style.I_K_AXIS}


def draw(
    panel: "Axes", study: Study, measure: str, channels: Sequence[str], *, over: str = "R_K"
) -> None:
    """Draw a measure of some channels over an indicator, gain sets in its order."""
    indicator = study.indicator(over).sort_values()
    for channel in channels:
        values = study.of_gains(channel, measure).loc[indicator.index]
        panel.plot(indicator, values, label=style.LABELS[channel], **style.SERIES[channel])
    panel.set_xlabel(AXES[over])


def name_gains(panel: "Axes", study: Study) -> None:
    """Write the names of the gain sets along the top, over their R_K."""
    for name, found in study.indicators.items():
        panel.annotate(
            name,
            (found.R_K, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, -9),
            textcoords="offset points",
            ha="center",
            fontsize=7.5,
            color=style.GREY,
        )
