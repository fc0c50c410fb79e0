"""The parts of answers about runs: their claims, speed priority and styles."""

from collections.abc import Iterable, Sequence

import numpy as np

from flighttune.base.units import DEG
from flighttune.base.words import matrix, number, pick
from flighttune.flight.loop.run import SCORE, Run, given_way
from flighttune.outputs.answers.answer import Answer, Table, facts_table
from flighttune.outputs.answers.finding import PartFinding, unmet
from flighttune.outputs.drawing.palette import LineStyle, line_styles


def facts(run: Run) -> Table:
    """End, duration and gains of a run."""
    said = {"outcome": run.outcome, "flown": f"{run.duration:g} s, {len(run.signals)} samples"}
    if len(run.signals) and {"chi_err", "gamma_err"} <= set(run.signals):
        chi, gamma = (float(run.signals[f"{n}_err"].iloc[-1]) / DEG for n in ("chi", "gamma"))
        said["errors at the end"] = f"χ {number(chi)}°, γ {number(gamma)}°"
    said["signals"] = ", ".join(map(str, run.signals.columns))
    if (gains := run.provenance.gains) is not None:
        said["gains"] = f"K_P {matrix(gains.K_P)}, K_I {matrix(gains.K_I)}"
        if gains.feeds_back:
            said["gains"] += f", feedback {', '.join(map(number, gains.feedback))}"
    return facts_table(run.label, said)


def priority_notes(runs: Iterable[Run]) -> list[str]:
    """Time of airspeed priority in a run, and its effect on the path angle."""
    notes = []
    for run in runs:
        less = given_way(run.signals)
        gave_way = less > 0.0
        if gave_way.any():
            t, share = run.t[gave_way], 100.0 * float(np.mean(gave_way))
            cost = f"the path angle gives way by up to {less.max() / DEG:.1f} deg"
            if "height_err" in run.signals:
                below = run.signals["height_err"].max()
                cost = f"the flight is up to {below:.0f} m below the route"
            notes.append(
                f"{run.label}: speed has priority from {t[0]:.1f} s on, in {share:.0f} % of the "
                f"flight; {cost}."
            )
    return notes


def claim_notes(runs: Iterable[Run]) -> list[str]:
    """Whether runs are inside their claims, and the claims in words."""
    runs = list(runs)
    said = [f"{run.label}: {claim.said(run.signals)}" for run in runs for claim in run.claims]
    claims = [
        f"{claim.title[0].upper()}{claim.title[1:]}: {claim.sentence}."
        for run in runs
        for claim in run.claims
        if not claim.no_claim
    ]
    return [*said, *dict.fromkeys(claims)]


def not_claimed(runs: Iterable[Run]) -> list[str]:
    """A sentence for each claim that does not cover a run."""
    return [
        f"{run.label}: {claim.said(run.signals)}"
        for run in runs
        for claim in run.claims
        if claim.no_claim
    ]


def run_styles(runs: Iterable[Run]) -> dict[str, LineStyle]:
    """Line style of every run by label, equal in all pictures of these runs."""
    pairs = [(run.provenance.plant, run.provenance.gains_name) for run in runs]
    return {f"{plant} / {name}": style for (plant, name), style in line_styles(pairs).items()}


def claimed(runs: Sequence[Run]) -> Answer:
    """The claims about runs, as part of an answer."""
    claims, failures, unclaimed = [], [], not_claimed(runs)
    for run in runs:
        for claim in run.claims:
            inside, alarm = claim.contains(run.signals), claim.alarm
            row = {
                "run": run.label,
                **pick(claim, "kind title sentence no_claim"),
                "inside": inside,
            }
            if SCORE in claim.units:
                row["alarm"] = alarm and alarm._asdict()
            claims.append(row)
            # A flight outside a proven tube is a failure, and so is an alarm.
            if claim.no_claim:
                continue
            if alarm is not None:
                failures.append(f"{run.label}: {alarm.sentence}")
            elif claim.kind == "proven" and not inside:
                failures.append(f"{run.label}: the flight leaves its {claim.title}.")
    check = "Claims are drawn as their files state them: flighttune verify FILE checks one."
    return Answer(
        values={"claims": claims},
        lines=unclaimed,
        notes=[*(x for x in claim_notes(runs) if x not in unclaimed), *([check] if claims else [])],
        findings=[
            *(finding for reason in failures for finding in unmet(reason)),
            *(PartFinding(found="open", reason=reason) for reason in unclaimed),
        ],
    )
