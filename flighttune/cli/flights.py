"""Commands that fly a scenario, fly a recording again, open one, and list what ships."""

import tomllib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.claims import runs_within
from flighttune.cli.show import fail, on_interrupt, pick, progress_bar, say, show, tell
from flighttune.errors import RecordingError, ScenarioError
from flighttune.files.shipped import aircraft_names, scenario_files
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Table

if TYPE_CHECKING:
    from flighttune.flight.fly import FlownScenario
    from flighttune.recording.record import RecordedFiles

# Metrics of the printed table; ``--json`` has them all.
RUN_COLUMNS = columns(
    "plant gains status metrics.chi.ITAE metrics.gamma.ITAE metrics.chi.MO_rad "
    "metrics.gamma.MO_rad metrics.chi.settling_s metrics.gamma.settling_s"
)
ROUTE_COLUMNS = columns(
    "plant gains status metrics.flight.cross_track_m metrics.flight.height_err_m "
    "metrics.flight.V_a_dev_mps metrics.chi.saturation_s metrics.gamma.saturation_s"
)

EQUAL = "equal to the bit"
REFLOWN_COLUMNS = columns("run status samples result")


def fly(
    scenario: options.ScenarioArgument,
    gains: options.GainSetsOption = None,
    out: Annotated[Path | None, options.out_folder("runs/NAME")] = None,
    view: Annotated[bool, Option("--view", help="Open the recording in the viewer.")] = False,
    claim: options.ClaimOption = None,
    settings: options.SetOption = None,
) -> None:
    """Fly every gain set of SCENARIO on each of its plants and record it."""
    from flighttune.flight.fly import fly as fly_scenario
    from flighttune.recording.record import record
    from flighttune.scenario import load_scenario

    loaded = load_scenario(scenario, changes=options.changes(settings), gains=gains or ())
    for note in loaded.notes:
        tell(f"{scenario}: {note}")
    name = Path(scenario).stem
    folder = out or Path("runs") / name
    with progress_bar() as progress:
        flown = fly_scenario(loaded, progress=progress)
    runs, claims = runs_within(flown.runs, claim)
    flown = replace(flown, runs=runs)
    files = record(flown, folder, name=name)
    answer = _flown(flown, files, claims, options.repeated(scenario, settings))
    show(answer)
    if view:
        _open(files.recording)
    if answer.failure:
        fail(answer.failure, answer.status)


def new(
    name: Annotated[str, Argument(metavar="NAME", help="The scenario to write, to NAME.toml.")],
    aircraft: Annotated[
        str | None,
        Option(
            help="Aircraft that flies, by name or folder [default: aerosonde, or that of --like].",
            autocompletion=aircraft_names,
        ),
    ] = None,
    like: Annotated[
        str | None,
        Option(
            metavar="SCENARIO",
            help="Scenario to make for the aircraft [default: a turn and a climb].",
            autocompletion=scenario_files,
        ),
    ] = None,
) -> Answer:
    """Write a scenario of your own, with comments, that an aircraft can fly."""
    from flighttune.scenario.new import new_scenario

    file = new_scenario(name, aircraft=aircraft, like=like)
    return Answer(files={"scenario": file})


def refly(
    recording: Annotated[
        Path,
        Argument(
            metavar="RECORDING",
            help="A recording, the folder of one, or a Parquet file of one run.",
        ),
    ],
) -> Answer:
    """Fly RECORDING again from the scenario and seed in it, and compare it bit by bit.

    Exit status 1 if a bit differs; the first difference is shown.
    """
    from flighttune.records.parquet import load_recording
    from flighttune.records.refly import refly as fly_again

    source = load_recording(recording)
    try:
        with progress_bar() as progress:
            flights = fly_again(source.runs, progress=progress)
    except (RecordingError, ScenarioError) as error:
        raise RecordingError(f"{recording}: {error}") from error
    versions = {name: pair for flight in flights for name, pair in flight.versions.items()}
    runs = []
    for flight in flights:
        change, label = flight.difference, flight.recorded.label
        runs.append(
            {
                "run": label,
                "status": flight.recorded.status,
                "samples": len(flight.recorded.signals),
                "equal": change is None,
                "difference": {"t_s": change.t, **pick(change, "what recorded reflown")}
                if change
                else None,
                "result": change.sentence if change else EQUAL,
            }
        )
    different = [f"{run['run']}: {run['result']}" for run in runs if not run["equal"]]
    return Answer(
        values={
            "equal": not different,
            "missing": source.missing,
            "versions": {
                name: {"recorded": then, "now": now} for name, (then, now) in versions.items()
            },
        },
        tables=[Table(REFLOWN_COLUMNS, runs, f"{recording}, flown again", name="runs")],
        notes=[
            *(f"missing: {line}" for line in source.missing),
            *(f"{name}: {then} then, {now} now" for name, (then, now) in versions.items()),
        ],
        failure=f"{recording}: {different[0]}" if different else "",
    )


def list_shipped() -> Answer:
    """List the scenarios and campaigns that come with the package, and all aircraft found."""
    from flighttune.files.shipped import aircraft_folders, campaign_files, is_shipped

    listed = {"scenarios": scenario_files(), "campaigns": campaign_files()}
    folders = aircraft_folders()
    places = [
        name if is_shipped(folder) else f"{name} ({folder})" for name, folder in folders.items()
    ]
    return Answer(
        values={"aircraft": list(folders)},
        tables=[
            Table(
                columns("name title"), [_heading(path) for path in files.values()], kind, name=kind
            )
            for kind, files in listed.items()
        ],
        notes=[f"aircraft: {', '.join(places)}"],
    )


def view(
    path: Annotated[Path, Argument(metavar="PATH", help="A recording, or the folder of one.")],
    port: Annotated[
        int | None,
        Option(
            min=1,
            max=65534,
            help="Serve the viewer to a browser at this port, its data at the next one; both can "
            "be tunnelled [default: a window; without a screen, a browser at 9090].",
        ),
    ] = None,
) -> None:
    """Open a recording in the Rerun viewer."""
    _open(path, port=port)


def _heading(path: Path) -> dict[str, str]:
    """Name, title and claim of a shipped file; the whole file is checked by a test, not here."""
    # Only the part before the first table is parsed: the rest takes ten times as long.
    tables = tomllib.loads(path.read_text(encoding="utf-8").partition("\n[")[0])
    return {"name": path.stem, "title": tables["title"], "verifies": tables.get("verifies", "")}


def _open(path: Path, *, port: int | None = None) -> None:
    from flighttune.recording.viewer import run_viewer, viewer
    from flighttune.records.parquet import recording_in

    recording = recording_in(path) if path.is_dir() else path
    if recording is None:
        raise RecordingError(f"{path}: the folder must hold a recording, got none.")
    command, url = viewer(recording, port=port)
    if port is not None:
        tunnel = " ".join(f"-L {p}:127.0.0.1:{p}" for p in (port, port + 1))
        say(f"open {url} in a browser, from elsewhere after: ssh {tunnel} HOST")
    elif url:
        say(f"no screen here; open {url} in a browser on this machine, Ctrl-C ends it")
    with on_interrupt(), suppress(KeyboardInterrupt):
        run_viewer(recording, command)


def _flown(flown: "FlownScenario", files: "RecordedFiles", claims: Answer, source: str) -> Answer:
    from flighttune.flight.advice import advice

    unknown = {"R_K": None, "I_K": None, "E_K": None}
    tuning, place = flown.scenario.tuning, "steady flight on the first reference"
    loop = f"linear loop on the kinematic law, {place}"
    if tuning.model == "identified":
        place = "nominal condition" if tuning.robust else place
        loop = f"linear loop on the identified aircraft, {place}"
    indicators = {name: pick(own, "R_K I_K E_K") for name, own in flown.indicators.items()}
    runs = [
        {**record, "indicators": indicators.get(record["gains"], unknown)}
        for record in flown.records(files.signals)
    ]
    gain_sets = [{"gains": name, **own} for name, own in indicators.items()]
    notes = [f"{run.label}: {run.outcome}" for run in flown.runs if run.status != "completed"]
    notes += claims.notes
    if any(run.provenance.aircraft for run in flown.runs):
        notes.append(f"Why aircraft and law differ: flighttune gap {source}")
    notes.append(f"A page to send: flighttune report {files.recording.parent}")
    claim, missed = flown.claim, flown.claim.missed
    bounds = [
        pick(bound, "run subject measure sense bound value met flown") for bound in claim.bounds
    ]
    next_step = advice(flown.scenario, flown.runs, source)
    more = f" ({len(missed) - 1} more)" if missed[1:] else ""
    return Answer(
        values={
            "runs": runs,
            "claim": {
                "claim": flown.scenario.verifies,
                **pick(claim, "verdict sentence"),
                **pick(claim.total, "requirements met not_flown"),
                "bounds": bounds,
                "next": next_step,
            },
            "missed": missed,
            **claims.values,
        },
        tables=[
            Table(
                RUN_COLUMNS if flown.scenario.route is None else ROUTE_COLUMNS,
                runs,
                flown.scenario.title,
                grouped=True,
            ),
            Table(columns("gains R_K I_K E_K"), gain_sets, loop),
        ],
        notes=notes,
        verdict=f"{claim.sentence}. {next_step}" if next_step else claim.sentence,
        files={"recording": files.recording},
        failure=claims.failure or (f"{missed[0]}{more}" if missed else ""),
    )
