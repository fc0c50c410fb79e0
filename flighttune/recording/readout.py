"""The text on Overview: how to read the picture, and the numbers of the present instant."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.present.names import shown_unit
from flighttune.present.palette import hue_tells_gains
from flighttune.present.thinning import evenly
from flighttune.recording import geometry
from flighttune.recording.entities import NOW, READING, DrawnRun, times
from flighttune.recording.plots import displayed, unit_of

INSTANTS = 120  # at which the numbers change

# Heading and format of each signal.
COLUMNS = {
    "V_a": ("V_a", ".1f"),
    "h": ("h", ".0f"),
    "phi": ("roll", "z.0f"),
    "n_z": ("n_z", "z.2f"),
    "chi_err": ("e chi", "z.1f"),
    "gamma_err": ("e gamma", "z.1f"),
}


def log_readout(stream: rr.RecordingStream, drawn: Sequence[DrawnRun]) -> None:
    """Log a line on how to read the picture, and a table of the runs over time."""
    line = rr.TextDocument(reading_line(drawn), media_type=rr.MediaType.MARKDOWN)
    stream.log(READING, line, static=True)
    t = max((drawn_run.run.t for drawn_run in drawn), key=lambda t: t[-1])
    t = t[evenly(len(t), most=INSTANTS)]
    headings = " | ".join(heading for heading, _ in COLUMNS.values())
    rule = "|".join(["---", *["--:"] * len(COLUMNS)])
    units = " | ".join(shown_unit(unit_of(name))[0] for name in COLUMNS)
    below = f" | {headings} |\n|{rule}|\n| | {units} |"
    lines = [[f"| t = {now:.1f} s{below}" for now in t.tolist()]]
    lines += [_rows(drawn_run, t) for drawn_run in drawn]
    pages = ["\n".join(page) + "\n" for page in zip(*lines, strict=True)]
    media = [rr.MediaType.MARKDOWN] * len(pages)
    stream.send_columns(NOW, [times(t)], rr.TextDocument.columns(text=pages, media_type=media))


def _rows(drawn_run: DrawnRun, t: FloatArray) -> list[str]:
    """The row of a run at each of the times `t` (s)."""
    run = drawn_run.run
    there = np.minimum(np.searchsorted(run.t, t), len(run.t) - 1)
    columns = []
    for name, (_, form) in COLUMNS.items():
        if name in run.signals:
            values = displayed(run.signals, name)[there].tolist()
            columns.append([f"{value:{form}}" for value in values])
        else:
            columns.append([" "] * len(t))
    name = f"{drawn_run.number} {run.label}"
    after = f"| {name} | {run.status.replace('_', ' ')} | " + " | ".join(" " * 5) + " |"
    return [
        after
        if now > run.duration and run.status != "completed"
        else f"| {name} | {' | '.join(row)} |"
        for now, row in zip(t.tolist(), zip(*columns, strict=True), strict=True)
    ]


def reading_line(drawn: Sequence[DrawnRun]) -> str:
    """Legend of colours, lines, arrows and lanes as Markdown."""
    made_by = [drawn_run.run.provenance for drawn_run in drawn]
    pairs = [(made.plant, made.gains_name) for made in made_by]
    same = len({gains for _, gains in pairs}) == 1
    parts = ["**Colour:** plant" if same else "**Colour:** run"]
    if hue_tells_gains(pairs) and not same:
        parts = ["**Hue:** gains"]
    if any(made.aircraft is None for made in made_by):
        parts.append("**dashed, outline:** a law")
    factor = geometry.drawn_scale(drawn)
    spacing = geometry.ground_grid(geometry.all_positions(drawn))[1]
    parts += [
        f"**aircraft:** {factor:g} times their size",
        "**arrow:** velocity",
        f"**grid:** {spacing:g} m",
        "**dark lane:** a limit holds a command",
    ]
    return ", ".join(parts) + "."
