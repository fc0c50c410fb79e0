"""Figure 7: ITAE, MO and PT against R_K."""

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
from flighttune.paper.items.histories import PROFILES, measures_of, measures_table
from flighttune.paper.items.over_gains import draw, name_gains
from flighttune.paper.study import Study, rank_correlation

PANELS = (
    ("ITAE", "ITAE [rad s², rad s]"),
    ("MO_rad", "MO [rad, rad/s]"),
    ("PT_s", "PT [s]"),
)


def make(study: Study) -> Made:
    """Draw the three panels."""
    figure, panels = style.grid(1, 3, size=(9.6, 3.4), titles=("ITAE", "MO", "PT"))
    for panel, (measure, label) in zip(panels, PANELS, strict=True):
        draw(panel, study, measure, PROFILES)
        panel.set_ylabel(label)
        top = panel.get_ylim()[1] * 1.1
        panel.set_ylim(-0.03 * top, top)
        name_gains(panel, study)
    style.legend_above(figure, panels[0], columns=4)
    R_K = study.indicator("R_K")
    trends = {
        measure: {
            channel: rank_correlation(R_K, study.of_gains(channel, measure)) for channel in PROFILES
        }
        for measure, _ in PANELS
    }
    return Made(
        figures={"fig7": ("Panels (a) to (c) as in the paper.", figure)},
        tables={"fig7": measures_table(study.by_gains)},
        values={
            "measures": measures_of(study.by_gains),
            "rank_correlation_with_R_K": trends,
        },
        outcome=(
            "Rank correlation with R_K of e_chi and e_gamma: "
            + "; ".join(
                f"{measure.split('_')[0]} {trends[measure]['chi']:.2f} and "
                f"{trends[measure]['gamma']:.2f}"
                for measure, _ in PANELS
            )
            + ".",
        ),
    )


ITEM = Item(
    name="fig7",
    title="ITAE, MO and PT against R_K",
    printed="The sixth figure (label Fig:7)",
    make=make,
    parameters=(PRINTED_STAR, FAMILY, *MANOEUVRE, TABLE_1_DISTURBANCE),
    assumed=(printed.ONLY_RANGES, printed.TIME_ITAE, printed.PEAK_TIME),
)
