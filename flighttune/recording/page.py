"""Text in a recording, as Markdown: the page, a sentence for each tab, the names of the runs."""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
import rerun as rr

from flighttune.files.table import toml_text
from flighttune.metrics import metric_tables
from flighttune.present.names import METRIC_LABELS, SYMBOLS, columns
from flighttune.present.palette import hue_tells_gains
from flighttune.present.tables import Column, Table
from flighttune.recording.entities import LEGEND, OVERVIEW_TAB, PAGE_TAB, DrawnRun, reading
from flighttune.recording.plots import AIRCRAFT_TAB, LAW_TAB, TRACKING_TAB
from flighttune.recording.scene import all_positions, drawn_scale, ground_grid
from flighttune.simulate.run import Run, claim_notes, priority_notes, run_styles

ABOUT = {"verifies": "Verifies", "source": "Source"}

NOT_SHOWN = "ITAE_mean"  # it follows from ITAE, which is on the page, and the time flown

HOW_TO_READ = """\
Plots show angles in degrees; files keep radians. Positions are local north, east and down from
the start, in m. Errors are reference minus actual.

Every run has a colour of its own, the same in 3D and in every plot; the list on Overview names
them. Laws without an aircraft are drawn as outlines, and their paths dashed. The arrow of an
aircraft is its velocity over ground, the grey one the wind, four times longer.

Faint lines behind course, path angle and airspeed are what sensors gave the controller. Errors
and metrics are of the true values."""

# What each tab shows; that of the overview names colours and lines too.
SENTENCES = {
    OVERVIEW_TAB: "Where the runs flew and how far off they were.",
    TRACKING_TAB: "What was asked for (grey), commanded (thin) and flown; limits are red.",
    AIRCRAFT_TAB: "How the aircraft moved and in which air; the reference of V_a is grey.",
    LAW_TAB: "Commands before the limits (red), integrator thin; and what the aircraft adds to the "
    "law: steps from the plant before, rates of lift, inner loop (lag) and rest, distance.",
    PAGE_TAB: "The runs, gains and metrics as tables, and the scenario as TOML.",
}

CLAIMS = (
    "Lines around a signal are what is claimed of it: thin ones are proven (a tube), dashed ones "
    "are counted (a band)."
)

RUN_COLUMNS = [*columns("run colour"), Column("flown_s", "flown", "s", ".2f"), *columns("outcome")]
GAIN_COLUMNS = [
    *columns("gains"),
    Column("R_K", "R_K", "1/s", "z.5f"),
    Column("I_K", "I_K", "s²", "z.5f"),
    Column("E_K", "E_K", "s²", "z.5f"),
    Column("K_P", "K_P", missing="none found"),
    Column("K_I", "K_I", missing="none found"),
]


def scenario_page(
    runs: Sequence[Run],
    *,
    scenario: Mapping[str, Any],
    indicators: Mapping[str, tuple[float, float, float] | None] | None = None,
) -> str:
    """The page of text in a recording, as Markdown; `indicators` are by name of the gain set."""
    metrics, flight = metric_tables(runs)
    parts = [f"# {scenario.get('title', 'Flight')}", *_about(scenario)]
    parts += ["## Runs", _runs(runs), "## Gains", _gains(runs, indicators or {})]
    if len(metrics):
        labels = [f"{run}, {SYMBOLS.get(channel, channel)}" for run, channel in metrics.index]
        parts += ["## Tracking", _metrics("run, channel", labels, metrics)]
        parts += ["## Aircraft", _metrics("run", list(map(str, flight.index)), flight)]
    parts += ["## How to read it", HOW_TO_READ]
    parts += ["## Scenario", f"```toml\n{toml_text(scenario)}```", *_made_with(runs)]
    return "\n\n".join(parts) + "\n"


def _about(scenario: Mapping[str, Any]) -> list[str]:
    return [f"**{word}:** {scenario[key]}" for key, word in ABOUT.items() if scenario.get(key)]


def _runs(runs: Sequence[Run]) -> str:
    styles = run_styles(runs)
    records = [
        {
            "run": run.label,
            "colour": styles[run.label].name if len(run.signals) > 1 else "not drawn",
            "flown_s": run.duration,
            "outcome": run.outcome,
        }
        for run in runs
    ]
    notes = [*priority_notes(runs), *claim_notes(runs)]
    table = Table(RUN_COLUMNS, records).markdown()
    return "\n\n".join([table, CLAIMS, *notes] if notes else [table])


def _gains(runs: Sequence[Run], indicators: Mapping[str, tuple[float, float, float] | None]) -> str:
    sets = {run.provenance.gains_name: run.provenance.gains for run in runs}
    records = []
    for name, gains in sets.items():
        R_K, I_K, E_K = indicators.get(name) or (None, None, None)
        matrices = {} if gains is None else gains.as_lists()
        records.append({"gains": name, "R_K": R_K, "I_K": I_K, "E_K": E_K, **matrices})
    return Table(GAIN_COLUMNS, records).markdown()


def _metrics(heading: str, labels: Sequence[str], metrics: pd.DataFrame) -> str:
    names = [name for name in map(str, metrics) if name in METRIC_LABELS and name != NOT_SHOWN]
    layout = [Column(heading, heading), *columns(" ".join(names))]
    records = metrics.assign(**{heading: labels}).to_dict(orient="records")
    return Table(layout, records).markdown()


def _made_with(runs: Sequence[Run]) -> list[str]:
    if not runs:
        return []
    first = runs[0].provenance
    versions = ", ".join(f"{name} {number}" for name, number in first.versions.items())
    seconds = sum(run.provenance.wall_s for run in runs)
    return [f"Seed {first.seed}; {versions}; flown in {seconds:.2f} s."]


def log_legends(stream: rr.RecordingStream, flights: Sequence[DrawnRun]) -> None:
    """Log what each tab shows, and which run has which number and colour."""
    texts = {reading(tab): sentence for tab, sentence in SENTENCES.items()}
    texts[reading(OVERVIEW_TAB)] += f" {reading_line(flights)}"
    texts[LEGEND] = "".join(
        f"{drawn_run.number}. {drawn_run.run.label}: {drawn_run.style.name}, "
        f"{drawn_run.run.outcome}\n"
        for drawn_run in flights
    )
    for entity, text in texts.items():
        stream.log(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def reading_line(flights: Sequence[DrawnRun]) -> str:
    """Legend of colours, lines and arrows as Markdown."""
    made_by = [drawn_run.run.provenance for drawn_run in flights]
    pairs = [(flight.plant, flight.gains_name) for flight in made_by]
    same = len({gains for _, gains in pairs}) == 1
    parts = ["**Colour:** plant" if same else "**Colour:** run"]
    if hue_tells_gains(pairs) and not same:
        parts = ["**Hue:** gains"]
    if any(flight.aircraft is None for flight in made_by):
        parts.append("**dashed, outline:** a law")
    claims = {claim.kind for drawn_run in flights for claim in drawn_run.run.claims}
    if "proven" in claims:
        parts.append("**thin around a signal:** proven tube")
    if "counted" in claims:
        parts.append("**dashed around a signal:** counted band")
    factor = drawn_scale(flights)
    spacing = ground_grid(all_positions(flights))[1]
    parts += [
        f"**aircraft:** {factor:g} times their size",
        "**arrow:** velocity",
        f"**grid:** {spacing:g} m",
    ]
    return ", ".join(parts) + "."
