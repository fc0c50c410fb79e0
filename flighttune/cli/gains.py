"""Commands that find gains, certify them and check certificates."""

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.show import campaign_display, campaign_pool
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
) -> Answer:
    """Find the gains with the largest R_K under the constraints of SCENARIO."""
    from flighttune.files.value import write
    from flighttune.files.whole import write_text
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
        write(result.bound, prove)
    if out is not None:
        write_text(out, answer.json() + "\n")
    if page is not None:
        from flighttune.reports.meet import write_tune_page

        write_tune_page(page, as_scenario(scenario, changed), result, _command())
    return answer


def frontier(
    scenario: options.ScenarioArgument,
    out: Annotated[Path | None, options.out_folder("runs/NAME")] = None,
    points: Annotated[int, Option(min=2, max=1000, help="Points of the frontier.")] = 25,
    settings: options.SetOption = None,
) -> Answer:
    """Tabulate and draw the largest R_K for each I_K, with the paper's and the scenario's gains.

    The same gains are drawn against E_K, the largest error that a disturbance can cause.
    """
    from flighttune.files.whole import write_text
    from flighttune.flight.frontier import frontier as find_frontier

    result = find_frontier(scenario, points=points, changes=options.changes(settings))
    folder = out or Path("runs") / Path(scenario).stem
    csv, svg = folder / "frontier.csv", folder / "frontier.svg"
    write_text(csv, result.table.to_csv(index=False, lineterminator="\n"))
    result.sheet.save(svg)
    return replace(result.answer(), files={"csv": csv, "figure": svg})


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
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    out: options.GainsFileOption = None,
) -> Answer:
    """Find gains with which flights of SCENARIO meet its [[expect]], by flying candidates.

    Exit status 1 if none are found; the nearest are printed.
    """
    options.check_ending(out, ".json")
    options.check_ending(page, ".html", option="--page")
    from flighttune.campaign.meet import meet as search
    from flighttune.files.whole import write_text

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
            workers=workers,
            scheduler=scheduler,
            observer=observer,
        )
    answer = replace(meeting.answer(), files={"out": out, "page": page})
    if out is not None:  # before the page: a fault in it must not lose the search
        write_text(out, answer.json() + "\n")
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
    from flighttune.files.value import write
    from flighttune.flight.gains import certify as certify_gains

    options.check_ending(figure, ".svg", option="--figure")
    certified = certify_gains(
        scenario, gains, envelope=envelope, L_d=L_d, changes=options.changes(settings)
    )
    proof = out if certified.certificate else None
    if certified.certificate is not None and out is not None:
        write(certified.certificate, out)
    if figure is not None:
        from flighttune.reports.charts import loop_sheet

        title = f"{Path(scenario).stem}; gains {certified.name}"
        loop_sheet(certified, title).save(figure)
    return replace(certified.answer(), files={"proof": proof, "figure": figure})


def verify(
    file: Annotated[
        Path, Argument(metavar="FILE", help="Certificate, bound on R_K, proof of a tube, or band.")
    ],
    boxes: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="File of `flighttune band --of residual` that confirms the boxes of a tube.",
        ),
    ] = None,
    count: Annotated[
        int | None,
        Option(
            metavar="K",
            min=1,
            help="Counted flights of a band to fly again [default: 59 at 5 %, 299 at 1 %].",
        ),
    ] = None,
    run_code: Annotated[
        bool,
        Option("--run-code", help="Fly flights of a band again that run Python files it names."),
    ] = False,
) -> Answer:
    """Check the claim in a file: certificate, bound on R_K, tube or band.

    Proofs are checked without the solver or the search that found them. The claim of a band, also
    of the boxes of a tube, is computed again from its plan and what its file keeps of each flight.
    All flights that its shape was learned from are flown again, and so many of those counted that
    a forgery which doubles epsilon is found with a probability of 95 %.

    Exit status 1 if it does not support what it claims.
    """
    from flighttune.campaign.claims import verify as verify_claim

    with campaign_pool(None, None) as pool:
        checked = verify_claim(file, boxes=boxes, count=count, run_code=run_code, pool=pool)
    return checked.answer()
