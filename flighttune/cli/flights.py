"""Commands that fly a scenario, fly a recording again, open one, and list what ships."""

import math
import tomllib
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from flighttune.cli.options import (
    ConformanceOption,
    ScenarioArgument,
    TubeOption,
    out_folder,
)
from flighttune.cli.progress import progress_bar, raise_on_interrupt
from flighttune.cli.show import NO, emit, fail, pick, say, tell
from flighttune.cli.tube import fail_if_outside, run_tubes, run_tubes_notes, run_tubes_values
from flighttune.errors import RecordingError, ScenarioError
from flighttune.present.answer import Answer
from flighttune.present.names import CHANNEL_SYMBOLS, columns
from flighttune.present.tables import Column, Table

RUN_COLUMNS = columns(
    "plant gains status metrics.chi.ITAE metrics.gamma.ITAE metrics.chi.MO_rad "
    "metrics.gamma.MO_rad metrics.chi.settling_s metrics.gamma.settling_s"
)
"""Metrics of the printed table; ``--json`` has them all."""

REFLOWN_COLUMNS = [
    *columns("run status samples"),
    Column("result", "result", good=("equal to the bit",)),
]
LIST_COLUMNS = columns("name title verifies")

if TYPE_CHECKING:
    from flighttune.flight.expectations import ClaimCheck
    from flighttune.flight.fly import FlownScenario
    from flighttune.recording.record import RecordedFiles
    from flighttune.simulate.run import Run
    from flighttune.tube.of_run import RunTubes


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
        emit(_flown(flown, claim, files, tubes, scenario))
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

    source = load_recording(recording)
    try:
        with progress_bar() as progress:
            flights = fly_again(source.runs, progress=progress)
    except (RecordingError, ScenarioError) as error:
        raise RecordingError(f"{recording}: {error}") from error
    different = [
        f"{flight.recorded.label}: {flight.difference.sentence}"
        for flight in flights
        if flight.difference
    ]
    versions = {name: pair for flight in flights for name, pair in flight.versions.items()}
    runs = [
        {
            "run": flight.recorded.label,
            "status": flight.recorded.status,
            "samples": len(flight.recorded.signals),
            "equal": flight.difference is None,
            "difference": flight.difference
            and {"t_s": flight.difference.t, **pick(flight.difference, "what recorded reflown")},
            "result": flight.difference.sentence if flight.difference else "equal to the bit",
        }
        for flight in flights
    ]
    emit(
        Answer(
            values={
                "equal": not different,
                "missing": source.missing,
                "versions": {
                    name: {"recorded": then, "now": now} for name, (then, now) in versions.items()
                },
            },
            tables=[
                Table(
                    title=f"{recording}, flown again",
                    name="runs",
                    columns=REFLOWN_COLUMNS,
                    records=runs,
                )
            ],
            notes=[
                *(f"missing: {line}" for line in source.missing),
                *(f"{name}: {then} then, {now} now" for name, (then, now) in versions.items()),
            ],
        )
    )
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
    columns = LIST_COLUMNS if verbose else LIST_COLUMNS[:2]
    places = (f"{name} ({at})" if at else name for name, at in aircraft.items())
    emit(
        Answer(
            values={"aircraft": list(aircraft)},
            tables=[
                Table(title=kind, name=kind, columns=columns, records=rows)
                for kind, rows in listed.items()
            ],
            notes=[f"aircraft: {', '.join(places)}"],
        )
    )


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
            tunnel = " ".join(f"-L {p}:127.0.0.1:{p}" for p in (port, port + 1))
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


def _flown(
    flown: "FlownScenario",
    claim: "ClaimCheck",
    files: "RecordedFiles",
    tubes: "RunTubes",
    source: str,
) -> Answer:
    runs = [
        {
            "plant": run.provenance.plant,
            "gains": run.provenance.gains_name,
            **pick(run, "status reason"),
            "duration_s": run.duration,
            "signals": files.signals.get(run.label),
            "metrics": flown.metrics_of(run),
            "indicators": _indicators(flown, run.provenance.gains_name),
        }
        for run in flown.runs
    ]
    shown = [{**values, **_settling(run)} for values, run in zip(runs, flown.runs, strict=True)]
    gain_sets = [{"gains": name, **_indicators(flown, name)} for name in flown.indicators]
    notes = [f"{run.label}: {run.outcome}" for run in flown.runs if run.status != "completed"]
    notes += run_tubes_notes(tubes, f"flighttune fly {source} --tube")
    if any(run.provenance.aircraft for run in flown.runs):
        notes.append(f"Why aircraft and law differ: flighttune gap {source}")
    notes.append(f"A page to send: flighttune report {files.recording.parent}")
    title = flown.scenario.title
    return Answer(
        values={
            "runs": runs,
            "claim": {
                "claim": flown.scenario.verifies,
                **pick(claim, "verdict sentence"),
                "bounds": [
                    pick(bound, "run subject measure sense bound value met")
                    for bound in claim.bounds
                ],
            },
            "missed": claim.missed,
            "tubes": run_tubes_values(tubes),
        },
        tables=[
            Table(title=title, columns=RUN_COLUMNS, records=shown, grouped=True),
            Table(
                title="on the kinematic law", columns=columns("gains R_K I_K"), records=gain_sets
            ),
        ],
        notes=notes,
        verdict=claim.sentence,
        files={"recording": files.recording},
    )


def _indicators(flown: "FlownScenario", gains: str) -> dict[str, float | None]:
    indicators = flown.indicators.get(gains)
    return pick(indicators, "R_K I_K") if indicators else {"R_K": None, "I_K": None}


def _settling(run: "Run") -> dict[str, str]:
    """Word in place of a missing settling time, by the key of its column."""
    from flighttune.metrics import channel_metrics, has_step

    if len(run.signals) < 2:
        return {}
    times = channel_metrics(run)["settling_s"]
    return {
        f"metrics.{channel}.settling_s": "never"
        for channel in CHANNEL_SYMBOLS
        if not math.isfinite(times[channel]) and has_step(run, channel)
    }
