"""Figure 8: the manoeuvre with K1 to K6 and K*."""

from flighttune.paper import parameters as printed
from flighttune.paper import style
from flighttune.paper.items.base import (
    FAMILY,
    MANOEUVRE,
    PRINTED_STAR,
    TABLE_1_DISTURBANCE,
    Item,
    Made,
)
from flighttune.paper.items.histories import (
    measures_of,
    measures_table,
    profiles,
    profiles_table,
)
from flighttune.paper.study import Study


def make(study: Study) -> Made:
    """Draw the four panels."""
    labels = {
        name: f"{name}: $R_K$ {found.R_K:.3f}, $I_K$ {found.I_K:.2f}"
        for name, found in study.indicators.items()
    }
    figure = profiles(
        study.flights,
        lambda name: {"color": style.GAIN_COLOURS[name], "label": labels[name]},
        end=printed.DURATION,
        columns=4,
    )
    itae = study.of_gains("chi", "ITAE")
    return Made(
        figures={"fig8": ("Panels (a) to (d) as in the paper, errors for angles.", figure)},
        tables={
            "fig8": profiles_table(study.flights),
            "fig8_measures": measures_table(study.by_gains),
        },
        values=measures_of(study.by_gains),
        outcome=(
            f"ITAE of e_chi goes from {itae.iloc[0]:.1f} rad s² at the highest R_K to "
            f"{itae.iloc[-1]:.1f} at the lowest.",
        ),
    )


ITEM = Item(
    name="fig8",
    title="the manoeuvre with K1 to K6",
    printed="The fifth figure (label Fig:8)",
    make=make,
    parameters=(PRINTED_STAR, FAMILY, *MANOEUVRE, TABLE_1_DISTURBANCE),
    assumed=(
        printed.ONLY_RANGES,
        printed.TIME_ITAE,
        printed.PEAK_TIME,
        printed.Assumption(
            "what “profiles of χ and γ” are",
            "the errors",
            "the text beside the figure and its other figures speak of errors",
        ),
    ),
)
