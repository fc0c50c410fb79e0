"""Commands that find gains, certify them and check certificates."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from flighttune.base.errors import InputError
from flighttune.base.files.whole import keep_on_error, together
from flighttune.cli.options import (
    RUN_CODE,
    Verb,
    check_ending,
    flown_by,
    kept_flights,
    this_command,
)
from flighttune.cli.show import progress_bar
from flighttune.outputs.answers.answer import Answer


def tune(
    tune_scenario: Verb,
    source: str,
    changes: dict[str, Any],
    out: Path | None,
    prove: Path | None,
    page: Path | None,
    frontier: bool,
    points: int | None,
) -> Answer:
    """Find the gains with the largest R_K under the constraints of SCENARIO."""
    if frontier:
        if page or tune_scenario.keywords.keys() - {"changes"}:
            options = "--envelope, --lag, --prove and --page"
            raise InputError(f"{options} must be absent with --frontier.")
        if out is not None and (out.is_file() or out.suffix in (".json", ".csv", ".svg")):
            raise InputError(f"{out}: `--out` must be a folder with --frontier, got a file.")
        from flighttune.flight.gains import frontier as frontier_of

        table = frontier_of(source, points=points or 25, changes=changes)
        return replace(table.answer(), files=table.save(out or Path("runs") / Path(source).stem))
    if points is not None:
        raise InputError("--points must be absent without --frontier.")
    check_ending(out, ".json")
    result = tune_scenario(prove=prove is not None)
    page = page if result.solved else None
    answer = replace(result.answer(), files={"out": out, "proof": prove, "page": page})
    with together():
        if prove is not None and result.bound is not None:
            result.bound.save(prove)
        if out is not None:
            answer.save(out)
        if page is not None:
            from flighttune.flight.load import as_scenario
            from flighttune.outputs.pages.meet import write_tune_page

            write_tune_page(page, as_scenario(source, changes), result, this_command())
    return answer


def meet(search: Verb, scenario: str, page: Path | None, out: Path | None) -> Answer:
    """Find gains with which flights of SCENARIO meet its [[expect]], by flying candidates.

    Exit status 1 if none are found; the nearest are printed. --with FILE searches the parameters of
    PX4 or ArduPilot instead, and writes none that are worse. After a kill the same command goes on.
    """
    search = partial(search, kept=kept_flights(scenario, "searched"))
    if search.keywords.get("autopilot") is not None:
        return retune(search, page, out)
    check_ending(out, ".json")
    meeting = search()
    answer = replace(meeting.answer(), files={"out": out, "page": page})
    with together():
        if out is not None:
            keep_on_error(out)
            answer.save(out)
        if page is not None:
            from flighttune.outputs.pages.meet import write_meet_page

            write_meet_page(page, meeting, this_command())
    return answer


def retune(search: Verb, page: Path | None, out: Path | None) -> Answer:
    """Search an autopilot's parameters, and write them if they are better."""
    if page is not None:
        raise InputError("--page must be absent with --with.")
    of_mission_planner, of_qgroundcontrol = (".param", ".parm"), (".params",)
    check_ending(out, *of_qgroundcontrol, *of_mission_planner)
    stated = Path(search.keywords["autopilot"])
    for endings in (of_mission_planner, of_qgroundcontrol):
        if stated.suffix.lower() in endings:  # the file that is written has its format
            check_ending(out, *endings)
    if out is not None and out.resolve() == stated.resolve():
        raise InputError(f"{out}: --out must be another file than --with, which is kept.")
    retuned = search()
    if out is not None and retuned.better:
        retuned.save_parameters(out)
    return replace(retuned.answer(), files={"out": out if retuned.better else None})


def certify(certify_gains: Verb, source: str, out: Path | None, figure: Path | None) -> Answer:
    """Compute R_K, I_K, E_K and margins of gains on the linear model of SCENARIO, and certify them.

    Exit status 1 if the loop is unstable or no certificate can be proven.
    """
    certified = certify_gains()
    proof = out if certified.certificate else None
    with together():
        if proof is not None:
            certified.certificate.save(proof)
        if figure is not None:
            from flighttune.outputs.pages.charts import loop_sheet

            loop_sheet(certified, f"{Path(source).stem}; gains {certified.name}").save(figure)
    return replace(certified.answer(), files={"proof": proof, "figure": figure})


def verify(verify_claim: Verb, claim: Path, count: int | None, run: int | None) -> Answer:
    """Check the claim in a file, or fly recorded runs again and compare them bit by bit.

    Proofs are checked without the solver or the search that found them. The claim of a band, also
    of the boxes of a tube, is computed again from its plan and what its file keeps of each flight.
    All flights that its shape was learned from are flown again, and so many of those counted that
    a forgery which doubles epsilon is found with a probability of 95 %. Of a recording all runs are
    flown again, from the scenario and seed in it, of a campaign some. With --run N, that one is
    recorded, in runs/NAME-run-N. Python files that it names are run with --run-code alone. Limits
    and scores of a monitor of logs are found again.

    Exit status 1 if the claim is not supported, or a bit of a run differs.
    """
    from flighttune.base.files.load import CLAIMS, DATASET, RECORDING, kind_of, load_one
    from flighttune.claims.counted import Counted
    from flighttune.claims.verify import CHECKED
    from flighttune.outputs.recording.record import record
    from flighttune.studies.refly import refly

    if run is None and kind_of(claim) in CLAIMS:
        return verify_claim(claim=claim).answer()
    value = load_one(claim, CHECKED, *CLAIMS, DATASET, RECORDING)
    if verify_claim.keywords.keys() - {"count"}:
        raise InputError(f"{claim}: --count alone must be given where runs fly again.")
    run_code = RUN_CODE.get()
    if isinstance(value, Counted):
        with flown_by() as by:
            again = refly(value, run, count=count, run_code=run_code, **by)
    else:
        with progress_bar() as progress:
            again = refly(value, run, count=count, run_code=run_code, progress=progress)
    again = replace(again, source=str(claim))
    if again.flown is None:
        return again.answer()
    name = f"{claim.name.removesuffix('.npz')}-run-{run}"
    files = record(again.flown, Path("runs") / name, name=name)
    return replace(again.answer(files.signals), files={"recording": files.recording})
