"""Commands that fly a scenario, fly a recording again, open one, and list what ships."""

import math
import tomllib
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flighttune.cli.options import (
    ConformanceOption,
    ScenarioArgument,
    TubeOption,
    out_folder,
)
from flighttune.cli.progress import progress_bar, raise_on_interrupt
from flighttune.cli.show import NO, emit, fail, pick, say, table, tell
from flighttune.cli.tube import fail_if_outside, run_tubes, run_tubes_json, run_tubes_text
from flighttune.errors import RecordingError, ScenarioError
from flighttune.present.names import CHANNEL_SYMBOLS
from flighttune.present.tables import Bad, Table
from flighttune.units import DEG_PER_RAD

METRICS = {"ITAE": ("ITAE", 1.0), "MO": ("MO_rad", DEG_PER_RAD), "settle": ("settling_s", 1.0)}
"""Metrics of the printed table: key, and the factor to its unit; ``--json`` has them all."""

NEVER, NOTHING = Bad("never"), "-"

if TYPE_CHECKING:
    from flighttune.flight.expectations import ClaimCheck
    from flighttune.flight.fly import FlownScenario
    from flighttune.recording.record import RecordedFiles
    from flighttune.simulate.run import Run


def fly(
    scenario: ScenarioArgument,
    out: Annotated[Path | None, out_folder("runs/NAME, with --live runs/NAME-live")] = None,
    view: Annotated[bool, Option("--view", help="Open the recording in the viewer.")] = False,
    live: Annotated[
        bool,
        Option(
            "--live",
            help="Show the flights in the viewer as they fly; Ctrl-C ends and records them.",
        ),
    ] = False,
    pace: Annotated[str, Option(help="With --live: simulated seconds per second, or max.")] = "1",
    tube: TubeOption = False,
    conformance: ConformanceOption = None,
) -> None:
    """Fly every gain set of SCENARIO on each of its plants and record it."""
    from flighttune.cli.live import live_viewer, pace_of
    from flighttune.flight.fly import fly as fly_scenario
    from flighttune.recording.record import record
    from flighttune.scenario import load_scenario

    loaded = load_scenario(scenario)
    for note in loaded.notes:
        tell(f"{scenario}: {note}")
    name = Path(scenario).stem
    folder = out or Path("runs") / (f"{name}-live" if live else name)
    viewer = live_viewer(loaded, pace=pace_of(pace)) if live else nullcontext()
    with viewer as observer:
        with progress_bar() as progress:
            flown = fly_scenario(loaded, progress=progress, observer=observer)
        tubes = run_tubes(flown.runs, folder, make=tube, conformance=conformance)
        flown = replace(flown, runs=tubes.runs)
        files = record(flown, folder, name=name)
        claim = flown.claim
        emit(
            {**_flown_json(flown, claim, files), "tubes": run_tubes_json(tubes)},
            [
                *_flown_text(flown, claim, files.recording, scenario),
                *run_tubes_text(tubes, f"flighttune fly {scenario} --tube"),
            ],
        )
    if view:
        _open(files.recording)
    fail_if_outside(tubes)
    if claim.missed:
        more = f" ({len(claim.missed) - 1} more)" if claim.missed[1:] else ""
        fail(f"{claim.missed[0]}{more}", NO)


def refly(
    recording: Annotated[
        Path,
        Argument(
            metavar="RECORDING",
            help="A recording, the folder of one, or a Parquet file of one run.",
        ),
    ],
) -> None:
    """Fly RECORDING again from the scenario and seed in it, and compare it bit by bit.

    Exit status 1 if a bit differs; the first difference is shown.
    """
    from flighttune.flight.refly import refly as fly_again
    from flighttune.recording.load import load_recording

    found = load_recording(recording)
    try:
        with progress_bar() as progress:
            flights = fly_again(found.runs, progress=progress)
    except (RecordingError, ScenarioError) as error:
        raise RecordingError(f"{recording}: {error}") from error
    different = [
        f"{one.recorded.label}: {one.difference.sentence}" for one in flights if one.difference
    ]
    versions = {name: pair for one in flights for name, pair in one.versions.items()}
    answer = {
        "equal": not different,
        "missing": found.missing,
        "versions": {
            name: {"recorded": then, "now": now} for name, (then, now) in versions.items()
        },
        "runs": [
            {
                "run": one.recorded.label,
                "status": one.recorded.status,
                "samples": len(one.recorded.signals),
                "equal": one.difference is None,
                "difference": one.difference
                and {"t_s": one.difference.t, **pick(one.difference, "what recorded reflown")},
            }
            for one in flights
        ],
    }

    def text() -> Iterator[Table | str]:
        rows = [
            (
                run["run"],
                run["status"],
                str(run["samples"]),
                Bad(one.difference.sentence) if one.difference else "equal to the bit",
            )
            for run, one in zip(answer["runs"], flights, strict=True)
        ]
        yield table(f"{recording}, flown again", ("run", "status", "samples", "result"), rows)
        for line in found.missing:
            yield f"missing: {line}"
        for name, (then, now) in versions.items():
            yield f"{name}: {then} then, {now} now"

    emit(answer, text())
    if different:
        fail(f"{recording}: {different[0]}", NO)


def list_shipped(
    verbose: Annotated[
        bool, Option("--verbose", "-v", help="Show what each scenario verifies.")
    ] = False,
) -> None:
    """List the scenarios and campaigns that come with the package, and all aircraft found."""
    from flighttune import shipped

    files = {
        "scenarios": shipped.scenario_files().values(),
        "campaigns": shipped.campaign_files().values(),
    }
    listed = {kind: [_heading(path) for path in paths] for kind, paths in files.items()}
    aircraft = {
        name: "" if shipped.is_shipped(folder) else str(folder)
        for name, folder in shipped.aircraft_folders().items()
    }
    text = []
    for kind, rows in listed.items():
        head = [name for name in rows[0] if verbose or name != "verifies"]
        text.append(table(kind, head, [[row[name] for name in head] for row in rows]))
    places = (f"{name} ({at})" if at else name for name, at in aircraft.items())
    text.append(f"aircraft: {', '.join(places)}")
    emit({**listed, "aircraft": list(aircraft)}, text)


def view(
    path: Annotated[Path, Argument(metavar="PATH", help="A recording, or the folder of one.")],
    port: Annotated[
        int | None,
        Option(
            min=1,
            max=65534,
            help="Serve the viewer to a browser at this port, its data at the next one; both can "
            "be tunnelled [default: a window; without a screen, a browser at free ports].",
        ),
    ] = None,
) -> None:
    """Open a recording in the Rerun viewer."""
    _open(path, port=port)


def _heading(path: Path) -> dict[str, str]:
    """Name, title and claim of a shipped file; the whole file is checked by a test, not here."""
    # As far as the first table: the rest takes ten times as long to parse.
    tables = tomllib.loads(path.read_text(encoding="utf-8").partition("\n[")[0])
    return {"name": path.stem, "title": tables["title"], "verifies": tables.get("verifies", "")}


def _open(path: Path, *, port: int | None = None) -> None:
    from flighttune.recording.viewer import view as open_viewer

    with (
        raise_on_interrupt(),
        open_viewer(_recording_in(path), port=port) as viewer,
        suppress(KeyboardInterrupt),
    ):
        if port is not None:
            tunnel = " ".join(f"-L {one}:127.0.0.1:{one}" for one in (port, port + 1))
            say(f"open {viewer.url} in a browser, from elsewhere after: ssh {tunnel} HOST")
        elif viewer.url:
            say(f"no screen here; open {viewer.url} in a browser on this machine, Ctrl-C ends it")
        viewer.wait()


def _recording_in(path: Path) -> Path:
    from flighttune.recording.load import recording_in

    if not path.is_dir():
        return path
    recording = recording_in(path)
    if recording is None:
        raise RecordingError(f"{path}: the folder must hold a recording, got none.")
    return recording


def _flown_json(
    flown: "FlownScenario", claim: "ClaimCheck", files: "RecordedFiles"
) -> dict[str, Any]:
    runs = []
    for run in flown.runs:
        found = flown.indicators.get(run.provenance.gains_name)
        runs.append(
            {
                "plant": run.provenance.plant,
                "gains": run.provenance.gains_name,
                **pick(run, "status reason"),
                "duration_s": run.duration,
                "signals": files.signals.get(run.label),
                "metrics": flown.metrics_of(run),
                "indicators": pick(found, "R_K I_K") if found else {"R_K": None, "I_K": None},
            }
        )
    return {
        "recording": files.recording,
        "runs": runs,
        "claim": {
            "claim": flown.scenario.verifies,
            **pick(claim, "verdict sentence"),
            "bounds": [
                pick(one, "run subject measure sense bound value met") for one in claim.bounds
            ],
        },
        "missed": claim.missed,
    }


def _flown_text(
    flown: "FlownScenario", claim: "ClaimCheck", recording: Path, source: str
) -> Iterator[Table | str]:
    early = any(run.status != "completed" for run in flown.runs)
    rows = []
    for run in flown.runs:
        status = "completed" if run.status == "completed" else Bad(run.status.replace("_", " "))
        cells = [
            _metric_cell(flown, run, channel, key, factor)
            for key, factor in METRICS.values()
            for channel in CHANNEL_SYMBOLS
        ]
        made_by = run.provenance
        rows.append((made_by.plant, made_by.gains_name, *([status] if early else []), *cells))
    measured = [f"{name} {symbol}" for name in METRICS for symbol in CHANNEL_SYMBOLS.values()]
    head = ("plant", "gains", *(["status"] if early else []), *measured)
    yield table(flown.scenario.title, head, rows, grouped=True, lowest=measured)
    yield "ITAE in rad s²; MO: maximum overshoot in deg; settle: time to within 5 % in s"
    cells = {cell for row in rows for cell in row}
    if NEVER in cells:
        yield f"{NEVER}: the error is not within 5 % for good when the flight ends"
    if NOTHING in cells:
        yield f"{NOTHING}: the reference has no step in this channel, or the run was not flown"
    yield table(
        "on the kinematic law",
        ("gains", "R_K [1/s]", "I_K [s²]"),
        [(name, f"{f.R_K:.4f}", f"{f.I_K:.3f}") for name, f in flown.indicators.items()],
        highest=["R_K [1/s]"],
        lowest=["I_K [s²]"],
    )
    for run in flown.runs:
        if run.status != "completed":
            yield f"{run.label}: {run.outcome}"
    yield claim.sentence
    yield f"recording: {recording}"
    yield f"open it: flighttune view {recording}"
    yield f"a page to send: flighttune report {recording.parent}"
    if any(run.provenance.aircraft for run in flown.runs):
        yield f"why aircraft and law differ: flighttune gap {source}"


def _metric_cell(flown: "FlownScenario", run: "Run", channel: str, key: str, factor: float) -> str:
    from flighttune.metrics import has_step

    if (run.label, channel) not in flown.metrics.index:
        return NOTHING
    value = float(flown.metrics.at[(run.label, channel), key]) * factor
    if math.isfinite(value):
        return f"{value:.2f}"
    return NEVER if has_step(run, channel) else NOTHING
