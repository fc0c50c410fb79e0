"""Figure 13: MS and ST of s_chi and s_gamma against R_K."""

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
from flighttune.paper.items.over_gains import draw, name_gains
from flighttune.paper.study import Study


def make(study: Study) -> Made:
    """Draw both panels."""
    figure, panels = style.grid(1, 2, size=(8.0, 3.4), titles=("MS", "ST"))
    for panel, measure in zip(panels, ("MS_rad", "ST_rad"), strict=True):
        draw(panel, study, measure, ("s_chi", "s_gamma"))
        panel.set_ylabel(f"{measure[:2]} [rad]")
        panel.set_ylim(bottom=0.0, top=panel.get_ylim()[1] * 1.1)
        name_gains(panel, study)
    style.legend_above(figure, panels[0], columns=2)
    table = study.by_gains
    rows = table.loc[(slice(None), ["s_chi", "s_gamma"]), :]
    worst = study.of_gains("s_gamma", "MS_rad")
    return Made(
        figures={"fig13": ("Panels (a) and (b) as in the paper.", figure)},
        tables={"fig13": measures_table(rows)},
        values={
            name: {channel: found[channel] for channel in ("s_chi", "s_gamma")}
            for name, found in measures_of(table).items()
        },
        outcome=(
            f"MS of s_gamma falls from {worst.iloc[-1]:.3f} at the lowest R_K to "
            f"{worst.iloc[0]:.4f} rad at the highest.",
        ),
    )


ITEM = Item(
    name="fig13",
    title="MS and ST of s_chi and s_gamma against R_K",
    printed="The seventh figure (label Fig:13)",
    make=make,
    parameters=(
        PRINTED_STAR,
        FAMILY,
        *MANOEUVRE,
        TABLE_1_DISTURBANCE,
        "s = sqrt(e² + ė²) adds rad and rad/s as the paper does",
    ),
    assumed=(printed.ONLY_RANGES, printed.STEADY_PART),
)
