"""The answer and the charts of tuning."""

import itertools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.units import DEG
from flighttune.base.words import listed, number, pick
from flighttune.control.gains import gains_lists
from flighttune.control.linear_model import Envelope
from flighttune.control.margins import loop_margins
from flighttune.control.tuning.noise import Noise, Rms
from flighttune.control.tuning.result import TuningResult
from flighttune.outputs.answers.answer import Answer, Column, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.answers.tables import gains_table, margins_table
from flighttune.outputs.drawing.chart import DASHED, Chart
from flighttune.outputs.drawing.palette import HUES, INK, NEUTRAL, LineStyle

if TYPE_CHECKING:
    import pandas as pd

# Ratio of radii from which the axis of a figure is logarithmic.
DECADE = 10.0
# Title and horizontal axis of the figure over each indicator
AXES = {
    "I_K": (
        "R_K against I_K: nothing can lie above the curve",
        "I_K, the paper's bound on the ultimate set [s²]",
    ),
    "E_K": (
        "The same gains against E_K, the exact largest error",
        "E_K, largest error per L_d [s²]; smaller is better",
    ),
}
# Share of the height reserved for names above and below the marks
ROOM = 0.08

RESULT_COLUMNS = columns("status R_K I_K E_K spectral_abscissa active method starts wall_s")
ENVELOPE_COLUMNS = columns("status R_envelope R_K I_K E_K spectral_abscissa wall_s", of="tuning")
DIAGNOSIS_COLUMNS = columns("smallest_I_K largest_R_K common_factor", of="tuning")
LIMIT_COLUMNS = columns("name factor_alone smallest_I_K_without", of="tuning")
PLAIN = "units of state: plain, as in `certify`"
SCALED = "units of state: scaled by [tuning]; `certify` gives R_K in plain ones too"


def answer(result: TuningResult) -> Answer:
    """Indicators, gains and margins; without gains a failure with the nearest feasible problem."""
    nearest = result.diagnosis and pick(
        result.diagnosis, "smallest_I_K largest_R_K common_factor binding limits"
    )
    values = {
        **pick(result, "status reason R_K I_K E_K cost spectral_abscissa active"),
        **pick(result, "R_envelope R_envelope_bound factor starts agreeing wall_s method"),
        **pick(result, "tuned_for sensitivity errors_in_gusts"),
        "in_noise": result.in_noise
        and {"errors_rad": result.in_noise.errors, "rates": result.in_noise.rates},
        "scaling": result.problem.scaling,
        "diagnosis": nearest,
        **gains_lists(result.gains),
        **({"bound": result.bound.answer().values} if result.bound else {}),
    }
    plain = bool(np.all(np.asarray(result.problem.scaling) == 1.0))
    return Answer(
        lines=[summary(result)],
        values=values,
        tables=tables(result, values, nearest),
        notes=[
            PLAIN if plain else SCALED,
            *bounds_in_words(result),
            *(result.tuned_for or {}).get("assumed", ()),
            *([f"proven {result.bound.sentence}"] if result.bound else []),
        ],
        findings=[] if result.solved else unmet(result.reason),
    )


def summary(result: TuningResult) -> str:
    """The indicators of the gains and the limits that bind, or the reason for no gains."""
    if not result.solved:
        return result.reason
    rates = f"R_K {number(result.R_K)} 1/s"
    if result.R_envelope is not None:
        rates = f"a rate of {number(result.R_envelope)} 1/s over the envelope, at the trim {rates}"
    bind = f" Limits that bind: {listed(result.active)}." if result.active else ""
    sizes = f"I_K {number(result.I_K)} s² and E_K {number(result.E_K)} s²"
    return f"The gains found have {rates}, {sizes}.{bind}"


def tables(
    result: TuningResult, values: Mapping[str, Any], nearest: Mapping[str, Any] | None
) -> list[Table]:
    """The indicators in `values`, gains and margins, and the `nearest` problem if there is one."""
    problem, over = result.problem, result.R_envelope is not None
    shown = ENVELOPE_COLUMNS if over else RESULT_COLUMNS
    if problem.weights is not None:
        shown = [*shown, Column("cost", "quadratic cost")]
    margins = loop_margins(problem.model, result.gains) if result.solved and result.gains else ()
    found = [
        Table(shown, [values], "tuning over the envelope" if over else "tuning"),
        gains_table("gains", result.gains),
        margins_table(margins),
    ]
    if nearest:
        found += [
            Table(DIAGNOSIS_COLUMNS, [nearest], "within the limits"),
            Table(LIMIT_COLUMNS, nearest["limits"], "limits"),
        ]
    return found


def bounds_in_words(result: TuningResult) -> list[str]:
    """The bound on the sensitivity, and the errors in turbulence."""
    if result.sensitivity is None:
        return []
    acts = "holds the gains" if "sensitivity" in result.active else "does not hold the gains"
    most = result.problem.sensitivity_max
    words = [
        f"The largest sensitivity is {result.sensitivity:.3f}; its bound of {most:.4g} {acts}."
    ]
    if result.errors_in_gusts:
        shares = ", ".join(f"{share:.3f}" for share in result.errors_in_gusts)
        words.append(f"The rms errors in turbulence over that of the gusts' angle are {shares}.")
    if result.in_noise and result.problem.noise:
        words.append(_in_noise(result.in_noise, result.problem.noise))
    return words


def _in_noise(rms: Rms, noise: Noise) -> str:
    """Errors and command rates in gusts and estimation errors."""
    errors = listed([f"{error:.3g}" for error in rms.errors[:2] / DEG])
    roll, lift = rms.rates[:2]
    used = listed([f"{share:.0%}" for share in rms.rates[:2] / noise.rates_max[:2]])
    bounded = f", {used} of their bounds" if np.isfinite(noise.rates_max[:2]).all() else ""
    return (
        f"In light gusts with estimation errors the rms errors are {errors} deg. The rms rates of "
        f"the commands are {roll / DEG:.3g} deg/s and {lift:.3g} 1/s{bounded}."
    )


def frontier_chart(
    table: "pd.DataFrame",
    styles: Mapping[str, LineStyle],
    *,
    against: Literal["I_K", "E_K"] = "I_K",
) -> Chart:
    """Draw the frontier and the named gains over I_K or E_K."""
    title, x = AXES[against]
    along, marks = (table[(table["name"] == "frontier") == yes] for yes in (True, False))
    marks = marks[marks["R_K"] > 0.0]
    radii = np.concatenate([np.asarray(table[against], dtype=float) for table in (along, marks)])
    # The axis is logarithmic if it spans more than one decade.
    spread = len(radii) > 1 and radii.max() > DECADE * radii.min()
    chart = Chart(title=title, x=x, y="R_K, guaranteed rate [1/s]", log="x" if spread else "")
    chart.line(along[against], along["R_K"], NEUTRAL, width=2.4, name="largest R_K found")
    columns = (np.asarray(marks[key]) for key in ("name", against, "R_K", "within_limits"))
    points = list(zip(*columns, strict=True))
    # The mark of gains outside the input limits is hollow. Gains without a style are dark.
    for name, size, R_K, within in points:
        tip = f"{name}: R_K {R_K:.4f} 1/s, {against} {size:.3f} s²" + (
            "" if within else ", beyond the limits"
        )
        colour = styles[name].colour if name in styles else INK
        chart.points(size, R_K, colour, run="", size=5, filled=bool(within), tips=[tip])
    (low, high), (left, right) = chart.y_ends(), chart.x_ends()
    chart.y_range = (low - ROOM * (high - low), high + ROOM * (high - low))
    side = (right / left) ** ROOM if spread else 1.0
    shift = 0.0 if spread else ROOM * (right - left)
    chart.x_range = (left / side - shift, right * side + shift)
    chart.label_points([(float(x), float(y), str(name)) for name, x, y, _ in points])
    return chart


def rate_chart(curves: Mapping[str, tuple[FloatArray, FloatArray]], envelope: Envelope) -> Chart:
    """Draw each `rate_curve` by the name of its gains; `envelope` is the envelope at 100 %."""
    chart = Chart(
        title="Rate certified over an envelope",
        x="size of the envelope about the trim [%]",
        y="certified rate [1/s]",
        x_range=(0.0, 100.0 * max(float(factors[-1]) for factors, _ in curves.values())),
    )
    chart.upright(100.0, dash=DASHED)
    chart.legend.append((str(envelope), NEUTRAL, DASHED))
    for (name, (factors, rates)), ((colour, _), _) in zip(
        curves.items(), itertools.cycle(HUES), strict=False
    ):
        chart.line(100.0 * factors, rates, colour, name=name, width=2.0)
        if not rates[-1]:
            chart.points(100.0 * factors[-1], 0.0, colour, shape="cross", size=5)
    return chart
