"""Figure 10: ITAE, MS and ST of K* over the disturbances."""

from flighttune.paper import parameters as printed
from flighttune.paper import style
from flighttune.paper.items.base import MANOEUVRE, PRINTED_STAR, Item, Made
from flighttune.paper.items.fig11 import AFTER_20_S
from flighttune.paper.items.histories import measures_of, measures_table
from flighttune.paper.study import Study

PANELS = (
    ("ITAE", ("chi", "gamma"), "ITAE [rad s²]"),
    ("MS_rad", ("s_chi", "s_gamma"), "MS [rad]"),
    ("ST_rad", ("s_chi", "s_gamma"), "ST [rad]"),
)


def make(study: Study) -> Made:
    """Draw the three panels: hue for the amplitude, dashes for the channel."""
    figure, panels = style.grid(
        1,
        3,
        size=(9.6, 3.4),
        titles=("ITAE of e", r"MS of $s$", r"ST of $s$"),
    )
    for panel, (measure, channels, label) in zip(panels, PANELS, strict=True):
        for channel, dashes, marker in zip(channels, ("-", "--"), ("o", "s"), strict=True):
            table = study.of_disturbances(channel, measure)
            for L_d in style.AMPLITUDE_COLOURS:
                panel.plot(
                    table.columns,
                    table.loc[L_d],
                    color=style.AMPLITUDE_COLOURS[L_d],
                    ls=dashes,
                    marker=marker,
                    label=f"{'χ' if channel.endswith('chi') else 'γ'}, $L_d$ {L_d:g}",
                )
        panel.set_xlabel(r"$\omega_d$ [rad/s]")
        panel.set_xticks([0.1, 0.15, 0.2])
        panel.set_ylabel(label)
        panel.set_ylim(bottom=0.0)
    style.legend_above(figure, panels[0], columns=6)
    released = {name: study.disturbed[name].released for name in ("d1", "d7", "d8", "d9")}
    growth = {
        channel: float((table.loc[0.3] - table.loc[0.1]).abs().max())
        for channel in ("s_chi", "s_gamma")
        for table in [study.of_disturbances(channel, "ST_rad")]
    }
    return Made(
        figures={"fig10": ("Panels (a) to (c) as in the paper.", figure)},
        tables={"fig10": measures_table(study.by_disturbance)},
        values={
            "measures": measures_of(study.by_disturbance),
            "largest_growth_of_ST_rad": growth,
        },
        outcome=(
            f"From L_d = 0.1 to 0.3, ST of s_chi grows by up to {growth['s_chi']:.4f} and that of "
            f"s_gamma by up to {growth['s_gamma']:.4f} rad.",
            "The roll command leaves its limit for the last time "
            + ", ".join(f"with {name} at {when:.1f} s" for name, when in released.items())
            + ": the later, the more of the transient reaches into the last quarter, in which MS "
            "and ST are taken.",
        ),
    )


ITEM = Item(
    name="fig10",
    title="ITAE, MS and ST over the disturbances",
    printed="The tenth figure (label Fig:10)",
    make=make,
    parameters=(
        PRINTED_STAR,
        *MANOEUVRE,
        "Table 3: L_d in 0.1, 0.2, 0.3 and ω_d in 0.1, 0.15, 0.2 rad/s, the same in both channels",
    ),
    assumed=(
        printed.ONLY_RANGES,
        AFTER_20_S,
        printed.TIME_ITAE,
        printed.STEADY_PART,
        printed.Assumption(
            "the signals of MS and ST",
            "s_chi and s_gamma; ITAE of the errors",
            "Fig. 13 defines MS and ST on them, Fig. 10 does not say",
        ),
    ),
)
