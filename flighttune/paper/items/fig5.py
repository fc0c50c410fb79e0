"""Figure 5: errors and their rates with K*, and when the course error really peaks."""

from typing import TYPE_CHECKING

import pandas as pd

from flighttune.paper import parameters as printed
from flighttune.paper import style
from flighttune.paper.flight import PaperFlight
from flighttune.paper.items.base import (
    MANOEUVRE,
    PRINTED_STAR,
    TABLE_1_DISTURBANCE,
    Item,
    Made,
)
from flighttune.paper.items.histories import MEASURES, columns_of, profiles
from flighttune.paper.parameters import DURATION, STAR
from flighttune.paper.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PRINTED_PEAKS = {"chi": 0.8, "gamma": 0.4}
PRINTED_PEAK_TIME = 4.0


def make(study: Study) -> Made:
    """Draw the four panels, and the peaks against what is said of them."""
    flight = study.flights[STAR]
    (chi, chi_t), (gamma, gamma_t) = flight.peak("chi"), flight.peak("gamma")
    return Made(
        figures={
            "fig5": (
                "Panels (a) to (d) as in the paper.",
                profiles({STAR: flight}, lambda _: {"color": style.INK}, end=DURATION, columns=1),
            ),
            "fig5_peak_time": (
                "The stated peak time: the dashed lines are what the text says, the marks what "
                "comes out.",
                _peaks(flight),
            ),
        },
        tables={"fig5": pd.DataFrame({"t_s": flight.t, **columns_of("", flight)})},
        values={
            channel: {key: float(flight.measures.loc[channel, key]) for key in MEASURES}
            for channel in ("chi", "gamma", "chi_dot", "gamma_dot")
        },
        outcome=(
            f"e_chi overshoots to {chi:.3f} rad at {chi_t:.2f} s, e_gamma to {gamma:.3f} rad at "
            f"{gamma_t:.2f} s. The text says below {PRINTED_PEAKS['chi']} and "
            f"{PRINTED_PEAKS['gamma']} rad, and below {PRINTED_PEAK_TIME:g} s.",
        ),
    )


def _peaks(flight: PaperFlight) -> "Figure":
    figure, panels = style.grid(1, 2, size=(8.6, 3.3), titles=("$e_χ$", "$e_γ$"))
    for panel, channel in zip(panels, ("chi", "gamma"), strict=True):
        panel.plot(flight.t, flight.channels[channel], color=style.INK)
        height, when = flight.peak(channel)
        style.level(panel, PRINTED_PEAKS[channel], label="stated: overshoot and peak time below")
        panel.axvline(PRINTED_PEAK_TIME, color=style.RED, lw=1.1, ls=(0, (6, 3)))
        label = f"peak {height:.3f} rad at {when:.2f} s"
        panel.plot(when, height, "o", color=style.CHI, ms=6, label=label)
        style.over_time(panel, f"{style.LABELS[channel]} [rad]", DURATION)
        style.legend(panel, loc="lower right")
    return figure


ITEM = Item(
    name="fig5",
    title="errors and their rates with K*",
    printed="The third figure (label Fig:5)",
    make=make,
    parameters=(PRINTED_STAR, *MANOEUVRE, TABLE_1_DISTURBANCE),
    assumed=(printed.ONLY_RANGES, printed.PEAK_TIME),
)
