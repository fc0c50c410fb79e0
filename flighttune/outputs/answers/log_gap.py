"""The answer and the figure of the gap between a log and a model."""

from collections.abc import Mapping

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.units import DEG, DEG_PER_RAD
from flighttune.base.words import listed, pick
from flighttune.gaps.of_log import (
    FACTORS,
    STRETCH_S,
    WAIT_S,
    LogGap,
    compared,
    difference,
    rms,
    scaled,
)
from flighttune.outputs.answers.answer import Answer, Column, Table
from flighttune.outputs.answers.labels import columns as columns_by
from flighttune.outputs.drawing.chart import DASHED, Chart, Sheet
from flighttune.outputs.drawing.palette import HUES, INK, NEUTRAL, PLANTS

RUNG_COLUMNS = columns_by("flown chi gamma phi n_z tail nose", of="rungs_of_log")
CAUSE_COLUMNS = columns_by("cause alone_percent without_percent")
FACTOR_COLUMNS = columns_by("title value unit", of="factors_of_log")
TRACK_COLUMNS = columns_by("of log_m grade low_m high_m true_m", of="tracks_of_log")
PART_COLUMNS = [Column("from_s", "from", "s", ".1f"), *RUNG_COLUMNS[1:]]

TRACK_NOTE = (
    "Errors of track are those of straight parts, as the log's autopilot saw them. {} flew in "
    "light turbulence by its own gains; `flighttune compare --with` flies those of an autopilot."
)


def answer(gap: LogGap) -> Answer:
    """Differences of each model that flew the commands, with causes, factors and stretches."""
    apart = {name: difference(gap.t, gap.logged, flown) for name, flown in gap.flights.items()}
    chi, t = np.abs(np.nan_to_num(apart[gap.aircraft]["chi"])), compared(gap.t, gap.t)
    worst = np.unravel_index(np.argmax(chi), chi.shape)
    names = listed([*gap.causes])
    verb = "explains" if len(gap.causes) == 1 else "together explain"
    share = f"{names[:1].upper()}{names[1:]} {verb} {100.0 * gap.explained:.1f} %"
    causes = share if gap.causes else "The log can tell no cause"
    ended = [
        f"{name}: {count} of {len(gap.t)} flights ended early, and are compared until then."
        for name, signals in gap.flights.items()
        if (count := int(np.isnan(signals["chi"]).any(axis=1).sum()))
    ]
    seen = [TRACK_NOTE.format(gap.aircraft)] * bool(gap.tracking)
    no_nose = ["Nose is pitch minus path angle, which a point mass does not have."]
    return Answer(
        values={"explained_percent": 100.0 * gap.explained},
        tables=tables(gap, apart),
        notes=[*gap.notes, *no_nose * ("nose" in apart[gap.aircraft]), *seen, *ended],
        verdict=(
            f"{causes} of the difference between the log {gap.log} and the model {gap.aircraft}. "
            f"The courses differ most at {t[worst]:.1f} s, by {chi[worst] * DEG_PER_RAD:.1f} deg."
        ),
    )


def tables(gap: LogGap, apart: Mapping[str, Mapping[str, FloatArray]]) -> list[Table]:
    """The differences `apart` by model, the causes, factors and stretches."""
    rungs = [
        {"flown": name, **{key: rms(values) for key, values in each.items()}}
        for name, each in apart.items()
    ]
    causes = [
        {"cause": name, "alone_percent": 100.0 * alone, "without_percent": 100.0 * without}
        for name, (alone, without) in gap.causes.items()
    ]
    factors = [
        {"factor": name, **pick(FACTORS[name], "title unit")}
        | {"value": value, "low": low, "high": high}
        for name, (value, low, high) in gap.factors.items()
    ]
    parts = [
        {"from_s": float(start), **{k: rms(v[i]) for k, v in apart[gap.aircraft].items()}}
        for i, start in enumerate(gap.t[:, 0] + WAIT_S)
    ]
    tracks = [row._asdict() for row in gap.tracking]
    exceeded = "errors of track that are exceeded 5 % of the time"
    title = f"{gap.log}: rms difference in {len(parts)} stretches of {STRETCH_S:g} s"
    return [
        Table(RUNG_COLUMNS, rungs, title, name="differences"),
        Table(CAUSE_COLUMNS, causes, f"difference from {gap.aircraft}", name="causes"),
        Table(FACTOR_COLUMNS, factors, "explained best by", name="factors"),
        Table(TRACK_COLUMNS, tracks, exceeded, name="tracks"),
        Table(PART_COLUMNS, parts, f"where {gap.aircraft} and the log part", name="parts"),
    ]


def sheet(gap: LogGap) -> Sheet:
    """Course, path angle, roll and load factor in the stretch with the largest difference."""
    differences = scaled(gap.t, gap.logged, gap.flights[gap.aircraft])
    k, charts = int(np.argmax(np.sum(differences**2, axis=1))), []
    colours = [*PLANTS[: len(gap.flights) - 2], HUES[0][0], HUES[1][0]]
    for name in ("chi", "gamma", "phi", "n_z"):
        unit, symbol = (1.0, "1") if name == "n_z" else (DEG, "deg")
        chart = Chart(title=name, y=f"{name} [{symbol}]")
        for (flown, signals), (colour, _) in zip(gap.flights.items(), colours, strict=True):
            chart.line(gap.t[k], signals[name][k] / unit, colour, name=flown)
        for key, colour, dash in ((f"{name}_cmd", NEUTRAL, DASHED), (name, INK, "")):
            if key in gap.logged:
                line, label = gap.logged[key][k] / unit, "command" if dash else "log"
                chart.line(gap.t[k], line, colour, dash=dash, name=label)
        charts.append(chart)
    return Sheet(charts=charts, title=f"{gap.log}: its commands flown on {gap.aircraft}")
