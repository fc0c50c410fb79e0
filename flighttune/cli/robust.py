"""``tune --robust``: gains chosen by flying them on the draws of a campaign."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flighttune.cli.gain_sets import gains_json, print_gains, write_json
from flighttune.cli.show import NO, fail, print_json, print_table, say

if TYPE_CHECKING:
    from flighttune.campaign.choice.choice import Judged, RobustChoice

INTERRUPTED = 130

RobustOption = Annotated[
    str | None,
    typer.Option(
        "--robust", metavar="CAMPAIGN",
        help="A campaign file, or a shipped one's name, whose draws decide.",
    ),
]  # fmt: skip
MetricOption = Annotated[
    list[str] | None,
    typer.Option(
        help="Column of a campaign's rows, less of which is better; several are added up. By "
        "default chi.ITAE."
    ),
]
PercentileOption = Annotated[
    float | None, typer.Option(help="Of the metric, that shall be low; by default 95.")
]
MinSuccessOption = Annotated[
    float | None,
    typer.Option(help="Part of the draws, 0 to 1, on which the gains must succeed; by default 0."),
]
CandidatesOption = Annotated[
    int | None, typer.Option(min=2, max=200, help="Points of the frontier; by default 12.")
]
DrawsOption = Annotated[
    int | None, typer.Option(min=1, help="Draws to decide on; by default the campaign's.")
]
PlantOption = Annotated[
    list[str] | None,
    typer.Option(help="Plant to fly; by default all: a draw counts as on its worst plant."),
]
WorkersOption = Annotated[
    int | None, typer.Option(min=1, help="Processes that fly; by default one a core.")
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS", help="Fly on the workers of a dask scheduler, tcp://HOST:PORT."
    ),
]
OutOption = Annotated[
    Path | None, typer.Option(help="JSON file to write; `--gains` of other commands reads it.")
]


def tune_by_flying(
    campaign: str,
    given: dict[str, Any],
    *,
    workers: int | None,
    scheduler: str | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Choose gains of the frontier by flying them, and say how sure that is."""
    from flighttune.campaign import load_campaign
    from flighttune.campaign.choice.choice import RobustSettings
    from flighttune.campaign.choice.robust import tune_robust
    from flighttune.cli.campaign_progress import CampaignOnlooker

    settings = RobustSettings(**given)
    loaded, onlooker = load_campaign(campaign), CampaignOnlooker()
    with onlooker.ends_at_ctrl_c(), onlooker.shown():
        found = tune_robust(
            loaded, settings, workers=workers, scheduler=scheduler, onlooker=onlooker
        )
    told = _json(found, campaign)
    if out is not None and found.status == "chosen":
        write_json(out, told)
    if as_json:
        print_json(told)
    elif found.best is not None:
        _print(found, loaded.title)
        if out is not None and found.status == "chosen":
            say(f"gains: {out}")
    if found.status != "chosen":
        fail(f"{campaign}: {found.reason}", INTERRUPTED if found.status == "interrupted" else NO)


def _print(found: "RobustChoice", title: str) -> None:
    best = found.best
    assert best is not None
    of = f"{found.percentile:g}th percentile of {' + '.join(found.metrics)}"
    header = (
        "gains", "I_K [s²]", "R_K [1/s]", "draws", "succeed [%]", "percentile", "behind", "best",
    )  # fmt: skip
    print_table(f"{title}: {of}", header, [_row(one) for one in (*found.candidates, *found.own)])
    print_gains(f"{found.status}: {best.candidate.name}", best.candidate.gains)
    say(
        f"{of}: {best.percentile:.4g} (95 % interval {_interval(best.lo, best.hi)}); "
        f"{100.0 * best.success:.1f} % of {best.draws} draws succeed "
        f"({100.0 * best.success_lo:.1f} to {100.0 * best.success_hi:.1f} %)"
    )
    say(
        f"the best of {len(found.candidates)} candidates with probability {found.p_best:.2f}; it "
        f"loses {found.loss:.2g} to the true best in mean; {found.flights} flights"
    )
    for one in found.own:
        more = "more" if one.behind >= 0.0 else "less"
        told = "" if one.behind_lo > 0.0 or one.behind_hi < 0.0 else ", which may be chance"
        say(
            f"the campaign's own {one.candidate.name} has {abs(one.behind):.3g} {more} "
            f"({one.behind_lo:.3g} to {one.behind_hi:.3g}){told}"
        )


def _row(one: "Judged") -> tuple[str, ...]:
    behind = f"{one.behind:.3g} ({one.behind_lo:.3g} to {one.behind_hi:.3g})"
    return (
        one.candidate.name,
        f"{one.candidate.I_K:.5g}",
        f"{one.candidate.R_K:.4f}",
        str(one.draws),
        f"{100.0 * one.success:.1f}",
        f"{one.percentile:.4g} ({_interval(one.lo, one.hi)})",
        "dropped" if one.dropped else behind,
        "-" if math.isnan(one.p_best) else f"{one.p_best:.3f}",
    )


def _interval(lo: float, hi: float) -> str:
    return f"{lo:.4g} to {hi:.4g}"


def _json(found: "RobustChoice", campaign: str) -> dict[str, Any]:
    best = found.best
    return {
        "status": found.status,
        "reason": found.reason,
        "campaign": campaign,
        "name": None if best is None else best.candidate.name,
        **gains_json(None if best is None else best.candidate.gains),
        "R_K": None if best is None else best.candidate.R_K,
        "I_K": None if best is None else best.candidate.I_K,
        "metrics": list(found.metrics),
        "percentile": found.percentile,
        "value": None if best is None else best.percentile,
        "interval": None if best is None else [best.lo, best.hi],
        "success": None if best is None else best.success,
        "success_interval": None if best is None else [best.success_lo, best.success_hi],
        "p_best": found.p_best,
        "loss": found.loss,
        "draws": found.draws,
        "flights": found.flights,
        "candidates": [_judged_json(one) for one in found.candidates],
        "beside": [_judged_json(one) for one in found.own],
    }


def _judged_json(one: "Judged") -> dict[str, Any]:
    return {
        "name": one.candidate.name,
        **gains_json(one.candidate.gains),
        "R_K": one.candidate.R_K,
        "I_K": one.candidate.I_K,
        "draws": one.draws,
        "value": one.percentile,
        "interval": [one.lo, one.hi],
        "success": one.success,
        "success_interval": [one.success_lo, one.success_hi],
        "p_best": one.p_best,
        "dropped": one.dropped,
        "behind": one.behind,
        "behind_interval": [one.behind_lo, one.behind_hi],
    }
