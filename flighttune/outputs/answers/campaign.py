"""What a campaign says that was flown."""

from flighttune.base.answers.answer import Answer, Table
from flighttune.base.answers.labels import columns, endings_table
from flighttune.base.words import duration, pick, rate
from flighttune.campaigns.engine.engine import CampaignOutcome
from flighttune.campaigns.planning.plan import draws_in_words
from flighttune.campaigns.statistics.findings import answer_words


def answer(outcome: CampaignOutcome) -> Answer:
    """Flights by their status, and the time they took; status 130 if they were interrupted.

    Status 1 if the share asked for is not surely reached by all groups.
    """
    speed = f"{duration(outcome.wall_s)}, {rate(outcome.rate_per_s)} a second"
    interrupted = (
        f"interrupted, {outcome.runs} of {outcome.planned} runs are in {outcome.dataset}; "
        "go on with the same command and --resume"
    )
    answered = answer_words(outcome.sure, outcome.until_sure)
    most = f" of at most {outcome.planned}" if outcome.until_sure else ""
    reached = all(answer == "yes" for answer in outcome.sure.values())
    said = "planned runs completed failed crashed succeeded statuses flown kept"
    return Answer(
        values=pick(outcome, f"{said} wall_s rate_per_s interrupted{' sure' * bool(outcome.sure)}"),
        tables=[
            Table(columns(" ".join(outcome.by_group[0])), outcome.by_group),
            endings_table(outcome.endings),
        ],
        notes=[
            f"{outcome.runs}{most} flights = {draws_in_words(outcome.runs, outcome.groups)}",
            f"flown now: {outcome.flown} in {speed}" if outcome.flown else "nothing was missing",
            *outcome.assumed,
        ],
        verdict=answered if reached else "",
        files={"dataset": outcome.dataset},
        failure=interrupted if outcome.interrupted else "" if reached else answered,
        status=130 if outcome.interrupted else 1,
    )
