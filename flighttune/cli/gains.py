"""Commands that find gains, certify them and check certificates."""

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.show import campaign_display, campaign_pool, progress_bar
from flighttune.errors import InputError
from flighttune.present.answer import Answer


def tune(
    scenario: options.ScenarioArgument,
    envelope: Annotated[
        bool,
        Option(
            "--envelope", help="Maximise the rate over the envelope, or every identified condition."
        ),
    ] = False,
    settings: options.SetOption = None,
    out: options.GainsFileOption = None,
    prove: Annotated[
        Path | None,
        Option(help="File for a proof that bounds R_K over all gains; `verify` checks it."),
    ] = None,
    page: Annotated[
        Path | None, Option(help="HTML page to write, with flights by the gains.")
    ] = None,
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
        if envelope or prove or page:
            raise InputError("--envelope, --prove and --page must be absent with --frontier.")
        return _frontier(
            scenario, out or Path("runs") / Path(scenario).stem, points or 25, settings
        )
    if points is not None:
        raise InputError("--points must be absent without --frontier.")
    from flighttune.flight.gains import tune as tune_scenario
    from flighttune.flight.load import as_scenario

    options.check_ending(out, ".json")
    options.check_ending(prove, ".json", option="--prove")
    options.check_ending(page, ".html", option="--page")
    changed = options.changes(settings)
    result = tune_scenario(scenario, envelope=envelope, prove=prove is not None, changes=changed)
    page = page if result.solved else None
    answer = replace(result.answer(), files={"out": out, "proof": prove, "page": page})
    if prove is not None and result.bound is not None:
        result.bound.save(prove)
    if out is not None:
        answer.save(out)
    if page is not None:
        from flighttune.reports.meet import write_tune_page

        write_tune_page(page, as_scenario(scenario, changed), result, _command())
    return answer


def _frontier(scenario: str, folder: Path, points: int, settings: list[str] | None) -> Answer:
    from flighttune.flight.frontier import frontier

    result = frontier(scenario, points=points, changes=options.changes(settings))
    return replace(result.answer(), files=result.save(folder))


def _command() -> str:
    return shlex.join(["flighttune", *sys.argv[1:]])


def meet(
    scenario: options.ScenarioArgument,
    also: Annotated[
        list[str] | None, Option(metavar="SCENARIO", help="Another scenario to meet as well.")
    ] = None,
    start: Annotated[
        str | None,
        Option(
            metavar="NAME|FILE",
            help="Gains to start from [default: the best of the tuned ones and the scenario's].",
        ),
    ] = None,
    budget: Annotated[
        int | None,
        Option(
            min=1,
            help="Maximum number of flights, with those of the count on fresh draws [default: "
            "600, or 6000 with a campaign].",
        ),
    ] = None,
    metric: Annotated[
        str,
        Option(
            help="What to minimise once all requirements are met by 20 %: ITAE or a column of "
            "campaign rows; or margin, which maximises the margin further."
        ),
    ] = "ITAE",
    campaign: Annotated[
        str | None,
        Option(
            metavar="CAMPAIGN",
            help="Campaign that disperses the scenario; the share of flights that succeed is "
            "maximised.",
        ),
    ] = None,
    success: Annotated[
        float | None,
        Option(help="Share of the flights of a campaign that must succeed [default: 0.95]."),
    ] = None,
    page: Annotated[Path | None, Option(help="HTML page to write, with all candidates.")] = None,
    settings: options.SetOption = None,
    out: options.GainsFileOption = None,
) -> Answer:
    """Find gains with which flights of SCENARIO meet its [[expect]], by flying candidates.

    Exit status 1 if none are found; the nearest are printed.
    """
    options.check_ending(out, ".json")
    options.check_ending(page, ".html", option="--page")
    from flighttune.campaign.meet import meet as search

    with campaign_display() as observer:
        meeting = search(
            scenario,
            also=also or (),
            start=start,
            budget=budget,
            metric=metric,
            campaign=campaign,
            success=success,
            changes=options.changes(settings),
            **options.FLOWN_BY.get(),
            observer=observer,
        )
    answer = replace(meeting.answer(), files={"out": out, "page": page})
    if out is not None:  # before the page: a fault in it must not lose the search
        answer.save(out)
    if page is not None:
        from flighttune.reports.meet import write_meet_page

        write_meet_page(page, meeting, _command())
    return answer


def certify(
    scenario: options.ScenarioArgument,
    gains: options.GainsOption = None,
    envelope: Annotated[
        bool,
        Option("--envelope", help="Certify over the envelope, or at every identified condition."),
    ] = False,
    L_d: Annotated[
        float | None,
        Option(
            "--L-d",
            help="Bound on the derivative of the disturbance, rad/s^2 [default: the scenario's].",
        ),
    ] = None,
    out: Annotated[Path | None, Option(help="File to write the certificate to.")] = None,
    figure: Annotated[
        Path | None,
        Option(help="SVG file to write: Bode and Nyquist diagrams, eigenvalues, certified rate."),
    ] = None,
    settings: options.SetOption = None,
) -> Answer:
    """Compute R_K, I_K, E_K and margins of gains on the linear model of SCENARIO, and certify them.

    Exit status 1 if the loop is unstable or no certificate can be proven.
    """
    from flighttune.flight.gains import certify as certify_gains

    options.check_ending(figure, ".svg", option="--figure")
    certified = certify_gains(
        scenario, gains, envelope=envelope, L_d=L_d, changes=options.changes(settings)
    )
    proof = out if certified.certificate else None
    if certified.certificate is not None and out is not None:
        certified.certificate.save(out)
    if figure is not None:
        from flighttune.reports.charts import loop_sheet

        title = f"{Path(scenario).stem}; gains {certified.name}"
        loop_sheet(certified, title).save(figure)
    return replace(certified.answer(), files={"proof": proof, "figure": figure})


def verify(
    file: Annotated[
        Path,
        Argument(
            metavar="PATH",
            help="Certificate, bound on R_K, proof of a tube, or band; or a recording, its folder "
            "or the Parquet file of a run; or the folder of a campaign.",
        ),
    ],
    boxes: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="File of residual signals that confirms the boxes of a tube.",
        ),
    ] = None,
    run: Annotated[
        int | None,
        Option(min=0, help="Run of a campaign, or draw of a band, to fly again and record."),
    ] = None,
    count: Annotated[
        int | None,
        Option(
            metavar="K",
            min=1,
            help="Counted flights of a band to fly again [default: 59 at 5 %, 299 at 1 %], or runs "
            "of a campaign, drawn at random [default: 5].",
        ),
    ] = None,
    run_code: Annotated[
        bool,
        Option("--run-code", help="Fly flights of a band again that run Python files it names."),
    ] = False,
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
    from flighttune.campaign.claims import verify as verify_claim
    from flighttune.files.load import CLAIMS, DATASET, RECORDING, load_one

    value = load_one(file, CHECKED, *CLAIMS, DATASET, RECORDING)
    if run is None and isinstance(value, AnyClaim):
        with campaign_pool(None, None) as pool:
            checked = verify_claim(value, boxes=boxes, count=count, run_code=run_code, pool=pool)
        return replace(checked, source=str(file)).answer()
    if boxes or run_code:
        raise InputError(f"{file}: --boxes and --run-code must be absent where runs fly again.")
    return _fly_again(value, file, run, count)


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
