"""Commands that fly and open flights, and list what ships."""

import tomllib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.options import Verb, of
from flighttune.cli.show import fail, on_interrupt, say, show
from flighttune.errors import CampaignError, InputError, OutputError, RecordingError
from flighttune.files.shipped import (
    aircraft_folders,
    campaign_files,
    is_shipped,
    listed_files,
    scenario_files,
)
from flighttune.present.answer import Answer, Table
from flighttune.present.names import columns

KEPT = "what has been flown is kept, go on with the same command and --resume"


@of("flight.fly:fly", out="Folder to write to [default: runs/NAME].")
def fly(
    fly_scenario: Verb,
    scenario: str,
    out: Path,
    view: Annotated[bool, Option("--view", help="Open the recording in the viewer.")] = False,
    claim: options.ClaimOption = None,
) -> None:
    """Fly every gain set of SCENARIO on each of its plants and record it."""
    from flighttune.campaign.claims import within
    from flighttune.recording.record import record

    name, flown = Path(scenario).stem, within(fly_scenario(), claim or ())
    files = record(flown, out, name=name)
    answer = replace(flown.answer(files.signals), files={"recording": files.recording})
    show(answer)
    if view:
        _open(files.recording)
    if answer.failure:
        fail(answer.failure, answer.status)


@of(
    "flight.new:new_scenario",
    name={"metavar": "NAME"},
    overshoot={"metavar": "DEG"},
    settle={"metavar": "S"},
)
def new(new_scenario: Verb, like: Annotated[str | None, Option(hidden=True)] = None) -> Answer:
    """Write a scenario of your own, with comments, that an aircraft can fly."""
    if like is not None:
        file = scenario_files().get(like, like)
        raise InputError(
            f"`--like` must be absent: copy {file}, and set its aircraft, [flight] and [limits]; "
            "`flighttune list` has all."
        )
    return Answer(files={"scenario": new_scenario()})


# Scenarios that `list` shows first: one of each kind of question.
BEGIN_WITH = "level_turn", "paper", "mission", "gust_in_turn", "circuit", "survey"


def list_shipped() -> Answer:
    """List the scenarios and campaigns that come with the package, and all aircraft found."""
    scenarios = listed_files()
    first = {name: scenarios.pop(name) for name in BEGIN_WITH}
    files = {"begin_with": first, "scenarios": scenarios, "campaigns": campaign_files()}
    studies = [name for name in scenario_files() if name not in first | scenarios]
    aircraft = aircraft_folders()
    places = [x if is_shipped(folder) else f"{x} ({folder})" for x, folder in aircraft.items()]
    return Answer(
        values={"aircraft": list(aircraft)},
        tables=[
            Table(columns("name title"), rows, kind.replace("_", " "), name=kind)
            for kind, paths in files.items()
            for rows in [[*map(_heading, paths.values())]]
        ],
        notes=[f"studies: {', '.join(studies)}", f"aircraft: {', '.join(places)}"],
    )


def _heading(path: Path) -> dict[str, str]:
    """Name, title and claim of a shipped file; the whole file is checked by a test, not here."""
    # Only the part before the first table is parsed: the rest takes ten times as long.
    tables = tomllib.loads(path.read_text(encoding="utf-8").partition("\n[")[0])
    return {"name": path.stem, "title": tables["title"], "verifies": tables.get("verifies", "")}


def view(
    path: Annotated[
        Path,
        Argument(
            metavar="PATH",
            help="A recording, or the folder of one; or the log of a real flight, recorded first.",
        ),
    ],
    port: Annotated[
        int | None,
        Option(
            min=1,
            max=65534,
            help="Serve the viewer to a browser at this port, its data at the next one; both can "
            "be tunnelled [default: a window; without a screen, a browser at 9090].",
        ),
    ] = None,
    column: options.ColumnOption = None,
    out: Annotated[
        Path | None,
        Option(help="Recording (.rrd) of a log to write [default: runs/NAME/NAME.rrd]."),
    ] = None,
) -> None:
    """Open a recording, or the log of a real flight, in the Rerun viewer."""
    from flighttune.files.load import LOG, written

    if (log := written(path, LOG, columns=column or ())) is not None:
        from flighttune.recording.record import write_log

        name = log.provenance.gains_name
        path = out or Path("runs") / name / f"{name}.rrd"
        write_log(log, path)
        say(f"recording: {path}")
    _open(path, port=port)


def _open(path: Path, *, port: int | None = None) -> None:
    from flighttune.recording.record import run_viewer, viewer
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


@of("campaign.engine.engine:run_campaign", out="Folder of the dataset [default: runs/NAME].")
def campaign(
    run_campaign: Verb,
    campaign: str,
    runs: int | None,
    resume: bool,
    out: Path,
    gains: Annotated[
        list[str] | None,
        Option(help=f"{options.GAINS} to fly; repeatable [default: those of the file]."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        Option("--set", metavar="KEY=VALUE", help=f"{options.SETTING}; repeatable."),
    ] = None,
    dry_run: Annotated[
        bool, Option("--dry-run", help="Show plan, time and disk space; write nothing.")
    ] = False,
) -> Answer:
    """Fly CAMPAIGN and write a dataset with one row per run.

    A flight that fails is a result: the exit status stays 0. It is 2 if the campaign was
    cut short, 130 after Ctrl-C; --resume flies the missing runs.
    """
    from flighttune.campaign.dataset import open_dataset
    from flighttune.campaign.engine.engine import forecast
    from flighttune.files.load import CAMPAIGN
    from flighttune.planning.load import load_campaign
    from flighttune.planning.plan import plan_campaign

    changes = options.changes(settings, "--set", "KEY=VALUE")
    planned = load_campaign(campaign, changes=changes, gains=gains or ())
    plan, file_of_plan = plan_campaign(planned, runs=runs), out / CAMPAIGN
    if resume and runs is None and file_of_plan.exists():
        # a campaign that was extended by --runs keeps its length
        plan = plan.with_runs(max(plan.runs, open_dataset(out).plan.runs))
    if dry_run:
        return forecast(plan, options.FLOWN_BY.get()["workers"])
    try:
        done = run_campaign(campaign=plan, out=out, runs=None)
    except (CampaignError, OutputError) as error:
        if not file_of_plan.exists():
            raise
        raise type(error)(f"{str(error).removesuffix('.')}; {KEPT}") from error
    return done.answer()
