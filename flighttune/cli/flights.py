"""Commands that fly and open flights, and list what ships."""

import tomllib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from flighttune.base import errors
from flighttune.base.files import shipped
from flighttune.base.files.whole import together
from flighttune.base.screen import LOCAL
from flighttune.campaigns.engine import flyer
from flighttune.cli.explain import page_note
from flighttune.cli.options import COMMANDS, WORKERS, Verb, check_ending
from flighttune.cli.show import fail, on_interrupt, say, show
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.labels import columns

KEPT = "what has been flown is kept, go on with the same command and --resume"


def fly(
    fly_scenario: Verb, scenario: str, out: Path, view: bool, claims: list[Path] | None
) -> None:
    """Fly every gain set of SCENARIO on each of its plants and record it."""
    from flighttune.claims.verify import within
    from flighttune.outputs.recording.record import record

    name, flown = Path(scenario).stem, within(fly_scenario(), claims or ())
    files = record(flown, out, name=name)
    answer = replace(flown.answer(files.signals), files={"recording": files.recording})
    show(answer)
    if view:
        _open(files.recording)
    if answer.failure:
        fail(answer.failure, answer.status)


def mission(
    count_mission: Verb,
    source: str,
    changes: dict[str, Any],
    page: Path | None,
    out: Path | None,
    plan: bool,
) -> Answer:
    """Plan a mission, fly it, and count whether it stays inside its fence.

    The answer has the corridor of its flights, the probability that a new one leaves the fence and
    where they come nearest to it. Exit status 1 if the planned path or the contingency volume
    leaves the fence, or the count does not support a probability of at most epsilon; 2 if the
    mission cannot be flown.
    """
    from flighttune.base.files.load import BAND, kind_of

    settings = count_mission.keywords
    flies = not plan and kind_of(source) != BAND
    if flies and settings.get("scheduler") is None:
        flyer.get_ready(settings.get("workers"))  # they import meanwhile what this process does
    from flighttune.claims.mission import mission_plan
    from flighttune.outputs.pages.claim import write_claim_page

    of_route = "fences", "aircraft", "terrain", "wind", "changes", "out"
    if plan:
        check_ending(out, ".geojson", ".kml", ".plan")
        for name in [x for x in settings if x not in of_route] + ["page"] * bool(page):
            typed = COMMANDS["The first day"]["mission"].get(name, {}).get("flags", [name])[0]
            raise errors.InputError(f"`{typed}` must be absent with --plan, which flies nothing.")
        return mission_plan(source, **settings).answer()
    check_ending(out, ".npz")
    if flies:
        out = out or Path("runs") / f"{Path(source).stem}-band.npz"
    try:
        with together():
            odds = count_mission(out=out)
            answer, file = odds.answer(), out or Path(source)
            if page is not None:
                write_claim_page(odds.band, str(file), page, odds)
    except errors.InfeasibleError:  # the plan tells the reason
        of_plan = {key: settings[key] for key in of_route[:4] if key in settings}
        return mission_plan(source, changes=changes, **of_plan).answer()
    notes = [*answer.notes, *([] if page else [page_note(file)])]
    return replace(answer, notes=notes, files={**answer.files, "page": page})


def new(new_scenario: Verb, like: str | None) -> Answer:
    """Write a scenario of your own, with comments, that an aircraft can fly."""
    if like is not None:
        file = shipped.scenario_files().get(like, like)
        raise errors.InputError(
            f"`--like` must be absent: copy {file}, and set its aircraft, [flight] and [limits]; "
            "`flighttune list` has all."
        )
    from flighttune.flight.load import load_scenario  # imported here, because --help must be quick

    file = new_scenario()
    return Answer(notes=load_scenario(file).assumptions, files={"scenario": file})


# Scenarios that `list` shows first, one for each kind of question.
BEGIN_WITH = "level_turn", "paper", "mission", "gust_in_turn", "circuit", "survey"


def list_shipped() -> Answer:
    """List the scenarios and campaigns that come with the package, and all aircraft found."""
    scenarios = shipped.listed_files()
    first = {name: scenarios.pop(name) for name in BEGIN_WITH}
    files = {"begin_with": first, "scenarios": scenarios, "campaigns": shipped.campaign_files()}
    studies = [name for name in shipped.scenario_files() if name not in first | scenarios]
    aircraft = shipped.aircraft_folders()
    places = [
        x if shipped.is_shipped(folder) else f"{x} ({folder})" for x, folder in aircraft.items()
    ]
    return Answer(
        values={"aircraft": list(aircraft)},
        tables=[
            Table(columns("name title"), rows, kind.replace("_", " "), name=kind)
            for kind, paths in files.items()
            for rows in [[*map(_heading, paths.values())]]
        ],
        notes=[f"studies: {', '.join(studies)}", f"aircraft: {', '.join(places)}"],
        whole=True,
    )


def _heading(path: Path) -> dict[str, str]:
    """Name, title and claim of a shipped file; a test checks the whole file."""
    # Only the part before the first table is parsed; the rest would take ten times as long.
    tables = tomllib.loads(path.read_text(encoding="utf-8").partition("\n[")[0])
    return {"name": path.stem, "title": tables["title"], "verifies": tables.get("verifies", "")}


def view(path: Path, port: int | None, columns: list[str] | None, out: Path | None) -> None:
    """Open a recording, or the log of a real flight, in the Rerun viewer."""
    from flighttune.base.files.load import LOG, written

    if (log := written(path, LOG, columns=columns or ())) is not None:
        from flighttune.outputs.recording.record import write_log

        path = out or path
        write_log(log, path)
        say(f"recording: {path}")
    _open(path, port=port)


def _open(path: Path, *, port: int | None = None) -> None:
    from flighttune.flight.records.parquet import recording_in
    from flighttune.outputs.recording.record import run_viewer, viewer

    recording = recording_in(path) if path.is_dir() else path
    if recording is None:
        raise errors.RecordingError(f"{path}: the folder must hold a recording, got none.")
    command, url = viewer(recording, port=port)
    with on_interrupt(), suppress(KeyboardInterrupt):
        if port is not None:
            tunnel = " ".join(f"-L {p}:127.0.0.1:{p}" for p in (port, port + 1))
            say(f"Open {url} in a browser; on another computer, run `ssh {tunnel} HOST` first.")
        elif url:
            say(
                f"There is no screen here. Open {url} in a browser on this machine; Ctrl-C ends it."
            )
        run_viewer(recording, command)


def open_page(opened: Verb, until_closed: bool) -> None:
    """Open a page in the browser on which gains are moved and the flights follow."""
    with opened() as page, on_interrupt(), suppress(KeyboardInterrupt):
        tunnel = f"`ssh -L {page.port}:{LOCAL}:{page.port} HOST`"
        say(f"Open {page.url} in a browser. On another computer, run {tunnel} first.")
        say("Ctrl-C ends the page.")
        page.wait(until_closed=until_closed)


def campaign(
    run_campaign: Verb,
    campaign: str,
    runs: int | None,
    resume: bool,
    out: Path,
    gains: list[str] | None,
    until_sure: float | None,
    navigation: Any,  # a grade, or exact
    changes: dict[str, Any],
    dry_run: bool,
) -> Answer:
    """Fly CAMPAIGN and write a dataset with one row per run.

    A flight that fails is a result: the exit status stays 0, but is 1 if --until-sure is not
    answered by yes. It is 2 if the campaign was cut short, 130 after Ctrl-C; --resume flies the
    missing runs.
    """
    from flighttune.base.files.load import CAMPAIGN
    from flighttune.campaigns.dataset import open_dataset
    from flighttune.campaigns.engine.engine import forecast
    from flighttune.campaigns.planning.knowing import knowing
    from flighttune.campaigns.planning.plan import plan_campaign
    from flighttune.campaigns.planning.source import load_campaign

    planned = load_campaign(campaign, changes=changes, gains=gains or (), until_sure=until_sure)
    planned = knowing(planned, navigation)
    plan, file_of_plan = plan_campaign(planned, runs=runs), out / CAMPAIGN
    if resume and runs is None and file_of_plan.exists():
        # a campaign extended by --runs keeps its length
        plan = plan.with_runs(max(plan.runs, open_dataset(out).plan.runs))
    if dry_run:
        return forecast(plan, WORKERS.get().get("workers")).answer()
    try:
        done = run_campaign(campaign=plan, out=out, runs=None, navigation=None)
    except (errors.CampaignError, errors.OutputError) as error:
        if not file_of_plan.exists():
            raise
        raise type(error)(f"{str(error).removesuffix('.')}; {KEPT}") from error
    return done.answer()
