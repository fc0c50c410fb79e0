"""Figure 11: K* under the disturbances d1 to d9."""

from flighttune.paper import parameters as printed
from flighttune.paper import style
from flighttune.paper.items.base import MANOEUVRE, PRINTED_STAR, Item, Made
from flighttune.paper.items.histories import (
    measures_of,
    measures_table,
    profiles,
    profiles_table,
)
from flighttune.paper.study import Study

AFTER_20_S = printed.Assumption(
    "time simulated",
    "drawn to 40 s; measures over the 20 s of Table 1",
    "the text speaks of amplitudes after 20 s, Table 1 ends there",
)


def make(study: Study) -> Made:
    """Draw the four panels."""
    figure = profiles(study.disturbed, style.disturbance_style, end=printed.AFTERWARDS, columns=3)
    for panel in figure.axes:
        panel.axvline(printed.DURATION, color=style.GREY, lw=0.9)
    later = profiles(
        study.disturbed,
        style.disturbance_style,
        end=printed.AFTERWARDS,
        columns=3,
        channels=("chi", "gamma"),
    )
    for panel in later.axes:
        panel.set_xlim(printed.DURATION, printed.AFTERWARDS)
        panel.set_ylim(-0.08, 0.08)
    after = {
        name: {channel: flight.after(channel, printed.DURATION) for channel in ("chi", "gamma")}
        for name, flight in study.disturbed.items()
    }
    values = measures_of(study.by_disturbance)
    for name, found in after.items():
        for channel, value in found.items():
            values[name][channel]["largest_after_20_s_rad"] = value
    return Made(
        figures={
            "fig11": (
                "Panels (a) to (d) as in the paper; the grey line is the printed end.",
                figure,
            ),
            "fig11_after": ("The errors after 20 s, of which the text speaks, enlarged.", later),
        },
        tables={
            "fig11": profiles_table(study.disturbed),
            "fig11_measures": measures_table(study.by_disturbance),
        },
        values=values,
        outcome=(
            f"The overshoot of e_chi falls from {values['d1']['chi']['MO_rad']:.3f} rad (d1) to "
            f"{values['d9']['chi']['MO_rad']:.3f} (d9); the largest |e_chi| after 20 s rises from "
            f"{after['d1']['chi']:.4f} to {after['d9']['chi']:.4f} rad.",
        ),
    )


ITEM = Item(
    name="fig11",
    title="K* under d1 to d9",
    printed="The ninth figure (label Fig:11)",
    make=make,
    parameters=(
        PRINTED_STAR,
        *MANOEUVRE,
        "Table 3: L_d in 0.1, 0.2, 0.3 and ω_d in 0.1, 0.15, 0.2 rad/s, the same in both channels",
    ),
    assumed=(printed.ONLY_RANGES, AFTER_20_S, printed.TIME_ITAE, printed.PEAK_TIME),
)
