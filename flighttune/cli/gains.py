"""Commands that find gains, certify them and check certificates."""

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from typer import Option

from flighttune.cli import options
from flighttune.cli.options import Verb, of
from flighttune.cli.show import campaign_display, progress_bar
from flighttune.errors import InputError
from flighttune.present.answer import Answer


@of(
    "flight.gains:tune",
    source=options.SCENARIO,
    lag=options.LAG,
    starts=None,
    out="Gains file to write, .json; `--gains` of other commands reads it.",
    prove="File (.json) for a proof that bounds R_K over all gains; `verify` checks it.",
    page="Page (.html) to write, with flights by the gains.",
)
def tune(
    tune_scenario: Verb,
    source: str,
    changes: dict[str, Any],
    out: Path | None,
    prove: Path | None,
    page: Path | None,
    frontier: Annotated[
        bool,
        Option(
            "--frontier",
            help="Tabulate and draw, into the folder --out [default: runs/NAME], the largest R_K "
            "for each I_K, and the paper's and the scenario's gains against I_K and E_K.",
        ),
    ] = False,
    points: Annotated[
        int | None, Option(min=2, max=1000, help="Points of the frontier [default: 25].")
    ] = None,
) -> Answer:
    """Find the gains with the largest R_K under the constraints of SCENARIO."""
    if frontier:
        if page or tune_scenario.keywords.keys() - {"changes"}:
            raise InputError(
                "--envelope, --lag, --prove and --page must be absent with --frontier."
            )
        if out is not None and (out.is_file() or out.suffix in (".json", ".csv", ".svg")):
            raise InputError(f"{out}: `--out` must be a folder with --frontier, got a file.")
        from flighttune.flight.gains import frontier as frontier_of

        table = frontier_of(source, points=points or 25, changes=changes)
        return replace(table.answer(), files=table.save(out or Path("runs") / Path(source).stem))
    if points is not None:
        raise InputError("--points must be absent without --frontier.")
    options.check_ending(out, ".json")
    result = tune_scenario(prove=prove is not None)
    page = page if result.solved else None
    answer = replace(result.answer(), files={"out": out, "proof": prove, "page": page})
    if prove is not None and result.bound is not None:
        result.bound.save(prove)
    if out is not None:
        answer.save(out)
    if page is not None:
        from flighttune.flight.load import as_scenario
        from flighttune.reports.meet import write_tune_page

        write_tune_page(page, as_scenario(source, changes), result, _command())
    return answer


def _command() -> str:
    return shlex.join(["flighttune", *sys.argv[1:]])


@of(
    "campaign.meet:meet",
    also={"metavar": "SCENARIO"},
    start={"metavar": "NAME|FILE"},
    page="Page (.html) to write, with all candidates.",
    out="Gains file (.json) to write; `--gains` of other commands reads it.",
)
def meet(search: Verb, page: Path | None, out: Path | None) -> Answer:
    """Find gains with which flights of SCENARIO meet its [[expect]], by flying candidates.

    Exit status 1 if none are found; the nearest are printed.
    """
    meeting = search()
    answer = replace(meeting.answer(), files={"out": out, "page": page})
    if out is not None:  # before the page: a fault in it must not lose the search
        answer.save(out)
    if page is not None:
        from flighttune.reports.meet import write_meet_page

        write_meet_page(page, meeting, _command())
    return answer


@of(
    "flight.gains:certify",
    source=options.SCENARIO,
    lag=options.LAG,
    out="File to write the certificate to.",
    figure="Figure (.svg) to write: Bode and Nyquist diagrams, eigenvalues, certified rate.",
)
def certify(certify_gains: Verb, source: str, out: Path | None, figure: Path | None) -> Answer:
    """Compute R_K, I_K, E_K and margins of gains on the linear model of SCENARIO, and certify them.

    Exit status 1 if the loop is unstable or no certificate can be proven.
    """
    certified = certify_gains()
    proof = out if certified.certificate else None
    if certified.certificate is not None and out is not None:
        certified.certificate.save(out)
    if figure is not None:
        from flighttune.reports.charts import loop_sheet

        loop_sheet(certified, f"{Path(source).stem}; gains {certified.name}").save(figure)
    return replace(certified.answer(), files={"proof": proof, "figure": figure})


@of(
    "campaign.claims:verify",
    claim={
        "metavar": "PATH",
        "help": "Certificate, bound on R_K, proof of a tube, or band; or a recording, its folder "
        "or the Parquet file of a run; or the folder of a campaign.",
    },
    boxes={"metavar": "FILE"},
    count={
        "metavar": "K",
        "min": 1,
        "help": "Counted flights of a band to fly again [default: 59 at 5 %, 299 at 1 %], or runs "
        "of a campaign, drawn at random [default: 5].",
    },
)
def verify(
    verify_claim: Verb,
    claim: Path,
    count: int | None,
    run: Annotated[
        int | None,
        Option(min=0, help="Run of a campaign, or draw of a band, to fly again and record."),
    ] = None,
) -> Answer:
    """Check the claim in a file, or fly recorded runs again and compare them bit by bit.

    Proofs are checked without the solver or the search that found them. The claim of a band, also
    of the boxes of a tube, is computed again from its plan and what its file keeps of each flight.
    All flights that its shape was learned from are flown again, and so many of those counted that
    a forgery which doubles epsilon is found with a probability of 95 %. Of a recording all runs are
    flown again, from the scenario and seed in it, of a campaign some. With --run N, that one is
    recorded, in runs/NAME-run-N.

    Exit status 1 if the claim is not supported, or a bit of a run differs.
    """
    from flighttune.campaign.claims import CHECKED, AnyClaim
    from flighttune.campaign.engine.pool import WorkerPool
    from flighttune.files.load import CLAIMS, DATASET, RECORDING, load_one

    value = load_one(claim, CHECKED, *CLAIMS, DATASET, RECORDING)
    if run is None and isinstance(value, AnyClaim):
        by = options.FLOWN_BY.get()
        with campaign_display() as observer, WorkerPool(**by, observer=observer) as pool:
            checked = verify_claim(claim=value, pool=pool)
        return replace(checked, source=str(claim)).answer()
    if verify_claim.keywords.keys() - {"count"}:
        raise InputError(f"{claim}: --boxes and --run-code must be absent where runs fly again.")
    return _fly_again(value, claim, run, count)


def _fly_again(value: Any, file: Path, run: int | None, count: int | None) -> Answer:
    """Fly runs or flights again, and record the one that was chosen."""
    from flighttune.campaign.refly import refly
    from flighttune.claims.band import Band
    from flighttune.recording.record import record

    if isinstance(value, Band):
        with campaign_display() as observer:
            again = refly(value, run, count=count, observer=observer)
    else:
        with progress_bar() as progress:
            again = refly(value, run, count=count, progress=progress)
    again = replace(again, source=str(file))
    if again.flown is None:
        return again.answer()
    name = f"{file.name.removesuffix('.npz')}-run-{run}"
    files = record(again.flown, Path("runs") / name, name=name)
    return replace(again.answer(files.signals), files={"recording": files.recording})
