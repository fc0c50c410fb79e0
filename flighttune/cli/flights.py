"""Commands that fly, and show what was flown."""

import math
from collections.abc import Mapping
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flighttune.cli.show import (
    NO,
    JsonOption,
    ScenarioArgument,
    fail,
    print_json,
    print_table,
    progress_bar,
    say,
)
from flighttune.errors import RecordingError

if TYPE_CHECKING:
    from flighttune.flight import FlownScenario
    from flighttune.simulate.run import Run


def fly(
    scenario: ScenarioArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the recording; by default runs/NAME, with --live runs/NAME-live."
        ),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Open the recording in the viewer.")] = False,
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="Show the flights in the viewer; Ctrl-C ends them, and keeps them."
        ),
    ] = False,
    pace: Annotated[
        str, typer.Option(help="With --live: seconds of flight a second, or max.")
    ] = "1",
    as_json: JsonOption = False,
) -> None:
    """Fly every gain set of SCENARIO on each of its plants and record it."""
    from flighttune.cli.live import pace_of, watched
    from flighttune.flight import fly as fly_scenario
    from flighttune.recording.record import record
    from flighttune.scenario import load_scenario

    loaded = load_scenario(scenario)
    name = Path(scenario).stem
    folder = out if out is not None else Path("runs") / (f"{name}-live" if live else name)
    seen = watched(loaded, pace=pace_of(pace), quiet=as_json) if live else nullcontext()
    with seen as watcher:
        with progress_bar() as progress:
            flown = fly_scenario(loaded, progress=progress, watcher=watcher)
        files = record(flown, folder, name=name)
        if as_json:
            print_json(_flown_json(flown, files.recording, files.signals))
        else:
            _print_flown(flown, files.recording)
    if view:
        _open(files.recording)
    if flown.missed:
        more = f" ({len(flown.missed) - 1} more)" if flown.missed[1:] else ""
        fail(f"{flown.missed[0]}{more}", NO)


def list_shipped(as_json: JsonOption = False) -> None:
    """Show the scenarios, campaigns and aircraft that come with the package."""
    from flighttune.campaign import load_campaign
    from flighttune.scenario import load_scenario
    from flighttune.shipped import aircraft_names, campaign_names, scenario_names

    shown = {
        "scenarios": {name: load_scenario(name) for name in scenario_names()},
        "campaigns": {name: load_campaign(name) for name in campaign_names()},
    }
    header = ("name", "title", "verifies")
    rows = {
        kind: [(name, one.title, one.verifies) for name, one in files.items()]
        for kind, files in shown.items()
    }
    if as_json:
        listed = {
            kind: [dict(zip(header, row, strict=True)) for row in rows[kind]] for kind in rows
        }
        print_json({**listed, "aircraft": list(aircraft_names())})
        return
    for kind in rows:
        print_table(kind, header, rows[kind])
    say(f"aircraft: {', '.join(aircraft_names())}")


def view(
    path: Annotated[
        Path, typer.Argument(metavar="PATH", help="A recording, or the folder of one.")
    ],
) -> None:
    """Open a recording in the Rerun viewer."""
    _open(path)


def _open(path: Path) -> None:
    from flighttune.cli.live import terminated_like_ctrl_c
    from flighttune.recording.view import view as open_viewer

    with (
        terminated_like_ctrl_c(),
        open_viewer(_recording_in(path)) as viewer,
        suppress(KeyboardInterrupt),
    ):
        if viewer.url:
            say(f"no screen here; open {viewer.url} in a browser on this machine, Ctrl-C ends it")
        viewer.wait()


def _recording_in(path: Path) -> Path:
    if not path.is_dir():
        return path
    recordings = sorted(path.glob("*.rrd"))
    if len(recordings) != 1:
        raise RecordingError(f"{path}: the folder must hold one recording, got {len(recordings)}.")
    return recordings[0]


def _flown_json(
    flown: "FlownScenario", recording: Path, signals: Mapping[str, Path]
) -> dict[str, Any]:
    runs = []
    for run in flown.runs:
        found = flown.indicators.get(run.provenance.gains_name)
        flew = run.label in signals
        runs.append(
            {
                "plant": run.provenance.plant,
                "gains": run.provenance.gains_name,
                "status": run.status,
                "reason": run.reason,
                "duration_s": run.duration,
                "signals": str(signals[run.label]) if flew else None,
                "metrics": flown.metrics_of(run),
                "indicators": {
                    "R_K": None if found is None else found.R_K,
                    "I_K": None if found is None else found.I_K,
                },
            }
        )
    return {"recording": str(recording), "runs": runs, "missed": list(flown.missed)}


def _print_flown(flown: "FlownScenario", recording: Path) -> None:
    rows = []
    for run in flown.runs:
        found = flown.indicators.get(run.provenance.gains_name)
        rows.append(
            (
                run.provenance.plant,
                run.provenance.gains_name,
                run.status,
                "-" if found is None else f"{found.R_K:.4f}",
                "-" if found is None else f"{found.I_K:.3f}",
                *(
                    _cell(flown, run, channel, key, unit)
                    for key, unit in (
                        ("ITAE", 1.0),
                        ("MO_rad", 180.0 / math.pi),
                        ("settling_s", 1.0),
                    )
                    for channel in ("chi", "gamma")
                ),
            )
        )
    header = (
        "plant", "gains", "status", "R_K", "I_K",
        "ITAE χ", "ITAE γ", "MO χ", "MO γ", "settle χ", "settle γ",
    )  # fmt: skip
    print_table(flown.scenario.title, header, rows)
    say(
        "R_K in 1/s and I_K in s² hold for the kinematic law; ITAE in rad s², maximum overshoot MO "
        "in deg, settling to 5 % in s"
    )
    for run in flown.runs:
        if run.status != "completed":
            say(f"{run.label}: {run.status.replace('_', ' ')}: {run.reason}")
    say(f"recording: {recording}   (open it with: flighttune view {recording})")


def _cell(flown: "FlownScenario", run: "Run", channel: str, key: str, unit: float) -> str:
    from flighttune.metrics import has_step

    if (run.label, channel) not in flown.metrics.index:
        return "-"
    value = float(flown.metrics.at[(run.label, channel), key]) * unit
    if math.isfinite(value):
        return f"{value:.2f}"
    return "never" if has_step(run, channel) else "-"
