"""The answer of a search for an autopilot's parameters."""

import math
from collections.abc import Sequence

from flighttune.base.words import MISSING, listed
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.beside import (
    TRACKING,
    airspeeds,
    kept_errors,
    margins_at,
    with_airspeed,
)
from flighttune.outputs.answers.early import finding_of_early, most
from flighttune.outputs.answers.finding import PartFinding, unmet
from flighttune.outputs.answers.labels import columns
from flighttune.studies.beside import CONFIDENCE, CUT, YOURS, airspeed_words, lags_alone
from flighttune.studies.retune import (
    DRAWS,
    FINAL_DRAWS,
    TUNED,
    WEIGHTS,
    Candidate,
    Constraint,
    Retuned,
)

CHANGES = columns("name old new range why", of="retuned")
ACCURACY = columns("of yours tuned unit better flights share", of="retuned_errors")
EMULATED = (
    "All flights are of an emulation of guidance and height above the inner loop of this program, "
    "not of the firmware. The emulation flies the energy balance of TECS. The throttle is this "
    "aircraft's: the total energy, the underspeed and the throttle limits of TECS are left out."
)
NOT_SEARCHED = (
    "Not searched: the weight of the airspeed, which protects an aircraft whose engine fails, and "
    "the time constants of roll and pitch, which belong to the inner loop."
)

# Why a parameter of the guidance was changed: what it sets, by its role.
SETS = {
    "period": "speed of the return to the track",
    "damping": "overshoot of the track",
    "height_tc": "speed of the return to the height",
    "demand_tc": "filter of the commanded height",
    "height_ahead": "rate of the commanded height",
    "damp": "damping of the pitch",
    "integral": "steady error of the height",
}


def answer(retuned: Retuned) -> Answer:
    """Whether the parameters found are better, both on fresh draws, and the changes."""
    rows, accuracy = changes(retuned), retuned.accuracy
    said, early = sentence(retuned), mostly_early(retuned)
    words, far = airspeed_words(retuned.plan, retuned.now)
    lines = [] if early else [said, errors(retuned), margins(retuned)]
    return Answer(
        lines=with_airspeed(lines, f"{words} {other_aircraft(retuned)}", far),
        values={
            "guidance": retuned.now.name,
            "airspeed": airspeeds(retuned.plan, retuned.now),
            "better": retuned.better,
            "against": [*retuned.against],
            "held_by": [*map(str, retuned.held_by)],
            "changes": rows,
            "accuracy": accuracy,
            "lost": {YOURS: retuned.start.lost, TUNED: retuned.best.lost},
            "lost_at_most": retuned.lost_at_most,
            "cost": {YOURS: retuned.start.cost, TUNED: retuned.best.cost},
            "tracking": retuned.tracking,
            "flights": retuned.flights,
            "candidates": retuned.candidates,
            "finalists": retuned.finalists,
        },
        tables=[
            Table(CHANGES, rows, f"parameters of {retuned.now.name}"),
            Table(ACCURACY, accuracy, kept_errors(retuned.plan.draws)[1]),
            Table(TRACKING, retuned.tracking, "the log, and the flights with your parameters"),
        ],
        notes=[
            told(retuned),
            *retuned.plan.scenario.assumptions,
            *retuned.notes,
            EMULATED,
            NOT_SEARCHED,
        ],
        findings=early or ([] if retuned.better else unmet(said)),
    )


def mostly_early(retuned: Retuned) -> list[PartFinding]:
    """A finding if most of the fresh flights with the result ended early."""
    ended = retuned.rows[retuned.rows["status"] != "completed"]
    lost = {x: ended[ended["gains"] == x].to_dict(orient="records") for x in (YOURS, TUNED)}
    if not most(lost[TUNED], retuned.plan.draws):
        return []
    sides = {"with your parameters": lost[YOURS], "with the tuned ones": lost[TUNED]}
    return finding_of_early(sides, retuned.plan.draws)


def changes(retuned: Retuned) -> list[dict[str, object]]:
    """Old and new value, range and purpose of each changed parameter."""
    old, ranges = retuned.start.law.parameters, {x["name"]: x["range"] for x in retuned.now.rows}
    sets = {name: SETS[role] for name, role in retuned.searched.items()}
    return [
        {"name": name, "old": old[name], "new": value, "range": ranges[name], "why": sets[name]}
        for name, value in retuned.changes.items()
    ]


def sentence(retuned: Retuned) -> str:
    """Whether the result is better, the lost aircraft first."""
    n, lost = retuned.plan.draws, f"{retuned.start.lost} | {retuned.best.lost}"
    counted = f"Lost {lost} of {n} fresh draws, yours | tuned"
    after = f"after {retuned.flights} flights of {retuned.candidates} candidates"
    if retuned.against:
        refused = f" What costs less is refused by {constraints(retuned.held_by)}."
        refused *= bool(retuned.held_by and not retuned.changes)
        return f"{counted}. Nothing is written, {after}: {listed(retuned.against)}.{refused}"
    held = constraints(retuned.held_by) or "no bound"
    larger = f" These errors in the table below are larger with them: {listed(retuned.larger)}."
    larger *= bool(retuned.larger)
    return f"{counted}. The tuned parameters are better, {after}. They are held by {held}.{larger}"


def constraints(held: Sequence[Constraint]) -> str:
    """Constraints in words, those of a kind together."""
    kinds: dict[str, list[str]] = {}
    for kind, of in held:
        kinds.setdefault(kind, []).append(of)
    *first, last = [
        f"the {kind}{'s' * (len(of) > 1)} of {listed(of)}" for kind, of in kinds.items()
    ] or [""]
    return f"{', '.join(first)}, and {last}" if first else last


def other_aircraft(retuned: Retuned) -> str:
    """How to fly another aircraft, or that of a log."""
    more = "`--aircraft` names another aircraft"
    if lags_alone(retuned.plan):
        more = "a search on lags alone once chose wrongly, as said below"
    elif retuned.of_log:
        more = f"`--aircraft {retuned.file}` flies the lags of the log instead"
    return f"{more[0].upper()}{more[1:]}."


def told(retuned: Retuned) -> str:
    """What so many fresh draws can tell, and what they cannot."""
    n, most = retuned.plan.draws, retuned.lost_at_most
    shares = " | ".join(f"{100.0 * most[name]:.2g} %" for name in (YOURS, TUNED))
    sure = "No difference is sure in so few draws"
    if (k := retuned.sure_from) <= n:
        sure = f"A difference is sure if one is better in {k} of them"
    return (
        f"Of {retuned.candidates} candidates on {DRAWS} draws {retuned.finalists} flew on "
        f"{FINAL_DRAWS} others, and the best of these on {n} that are fresh. "
        f"{n} draws show, at a confidence of {CONFIDENCE:g}, that at most {shares} of all flights "
        f"are lost. {sure}. Rarer losses and smaller differences need more `flights`."
    )


def errors(retuned: Retuned) -> str:
    """Mean errors of both with their cost."""
    both = retuned.start, retuned.best
    parts = [
        f"{name} {known(old)} | {known(new)} {unit}"
        for (name, (_, unit)), old, new in zip(
            WEIGHTS.items(), *(x.errors[: len(WEIGHTS)] for x in both), strict=True
        )
    ]
    weights = " + ".join(f"{w:g} {name} [{unit}]" for name, (w, unit) in WEIGHTS.items() if w)
    cost = " | ".join(known(x.cost) for x in both)
    return f"Root mean squares: {', '.join(parts)}; cost {cost}, which is {weights}."


def known(value: float, form: str = ".3g") -> str:
    """A number; a dash if no flight completed that would tell it."""
    return f"{value:{form}}" if math.isfinite(value) else MISSING


def margins(retuned: Retuned) -> str:
    """Margins of both loops, and the ratios of the rates of the commands."""

    def of(candidate: Candidate, place: int) -> str:
        return margins_at(candidate.margins, place)

    cuts = "; ".join(
        f"{name} {of(retuned.start, i)} | {of(retuned.best, i)}" for i, name in enumerate(CUT)
    )
    roll, lift = retuned.best.rates / retuned.start.rates
    rates = f"{known(roll, '.2f')} and {known(lift, '.2f')} times yours"
    return f"Margins: {cuts}. Rates of the commands of roll and lift: {rates}."
