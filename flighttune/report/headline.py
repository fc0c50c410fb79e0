"""The headline of a report: whether it converges, is certified, and what the aircraft changes."""

from collections.abc import Sequence

from flighttune.present.frame import Question, share_verdict
from flighttune.report.facts import CONVERGED_AT_LEAST, CONVERGED_PART, Facts
from flighttune.simulate.run import TUBE_SIGNALS
from flighttune.units import DEG_PER_RAD

CRITERION = (
    "A run converges if it was completed and over the last quarter of the flight both errors stay "
    f"within {100.0 * CONVERGED_PART:.0f} % of their largest, or within "
    f"{CONVERGED_AT_LEAST * DEG_PER_RAD:.1f}°."
)


def headline(facts: Facts, tubes: Sequence[str] = ()) -> tuple[Question, ...]:
    """Questions about the runs; `tubes` are sentences on their tubes."""
    questions = [_converges(facts), *_enclosed(facts, tubes), _certified(facts)]
    if facts.aircraft is not None:
        questions.append(
            Question(
                question="What did the full aircraft change?",
                verdict="none",
                short=f"paths up to {facts.aircraft.max_distance:.0f} m apart",
            )
        )
    return tuple(questions)


def _converges(facts: Facts) -> Question:
    good = sum(facts.final_errors[run.label].converged for run in facts.runs)
    count = len(facts.runs) + len(facts.grounded)
    return Question(
        question="Does it converge?",
        verdict=share_verdict(good, count),
        short=f"{good} of {count} runs",
        criterion=CRITERION,
    )


def _enclosed(facts: Facts, tubes: Sequence[str]) -> list[Question]:
    """Answer from the tubes of the runs."""
    if not tubes:
        return []
    count = sum(set(TUBE_SIGNALS) <= set(run.signals) for run in facts.runs)
    return [
        Question(
            question="How far can it be off?",
            verdict="none",
            short=f"a tube around {count} of {len(facts.runs)} runs",
            sentences=tuple(tubes),
        )
    ]


def _certified(facts: Facts) -> Question:
    broken = any(check.t_broken is not None for check in facts.checks.values())
    good = sum(gain_set.trim.status == "certified" for gain_set in facts.gains)
    return Question(
        question="Is it certified?",
        # a proof about the linear law does not say that the aircraft converges: never "yes"
        verdict="partly" if broken else "none" if good else "no",
        short=f"{good} of {len(facts.gains)} at the trim, on the linear law only"
        + ("; broken in flight" if broken else ""),
    )
