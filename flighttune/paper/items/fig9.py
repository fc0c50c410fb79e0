"""Figure 9: means and deviations over the whole flight against R_K and I_K."""

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
from flighttune.paper.items.histories import measures_of, measures_table
from flighttune.paper.items.over_gains import draw
from flighttune.paper.study import Study

PANELS = (
    ("mean", ("chi", "gamma"), "mean of e", "rad"),
    ("std", ("chi", "gamma"), "deviation of e", "rad"),
    ("mean", ("chi_dot", "gamma_dot"), "mean of ė", "rad/s"),
    ("std", ("chi_dot", "gamma_dot"), "deviation of ė", "rad/s"),
)


def make(study: Study) -> Made:
    """Draw the eight panels."""
    titles = [title for _, _, title, _ in PANELS]
    figure, panels = style.grid(2, 4, size=(11.0, 5.4), titles=[*titles, *titles])
    for k, panel in enumerate(panels):
        measure, channels, _, unit = PANELS[k % 4]
        draw(panel, study, measure, channels, over="R_K" if k < 4 else "I_K")
        panel.set_ylabel(unit)
        if measure == "std":
            panel.set_ylim(0.0, 1.08 * panel.get_ylim()[1])
    style.legend_above(figure, panels[0], panels[2], columns=4)
    spread = {
        channel: float(values.max() - values.min())
        for channel in ("chi_dot", "gamma_dot")
        for values in [study.of_gains(channel, "mean")]
    }
    return Made(
        figures={"fig9": ("Panels (a) to (h) as in the paper.", figure)},
        tables={"fig9": measures_table(study.by_gains)},
        values={"measures": measures_of(study.by_gains), "spread_of_mean_rates": spread},
        outcome=(
            f"The mean rates differ by {spread['chi_dot']:.1e} and {spread['gamma_dot']:.1e} rad/s "
            "over the gain sets: the mean rate is the last error less the first over the time.",
            *(
                f"The deviation of the rate of e_{channel} is {deviation.iloc[0]:.3f} rad/s at the "
                f"highest R_K, {deviation.min():.3f} at the least and {deviation.iloc[-1]:.3f} at "
                "the lowest R_K."
                for channel in ("chi", "gamma")
                for deviation in [study.of_gains(f"{channel}_dot", "std")]
            ),
        ),
    )


ITEM = Item(
    name="fig9",
    title="means and deviations against R_K and I_K",
    printed="The eighth figure (label Fig:9)",
    make=make,
    parameters=(PRINTED_STAR, FAMILY, *MANOEUVRE, TABLE_1_DISTURBANCE),
    assumed=(
        printed.ONLY_RANGES,
        printed.Assumption(
            "time over which mean and deviation are taken",
            "the whole flight, equally spaced samples",
            "the paper says “during convergence”",
        ),
    ),
)
