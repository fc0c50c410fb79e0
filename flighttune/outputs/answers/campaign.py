"""The answers of a campaign, before and after its flights."""

from flighttune.base.words import duration, pick, rate
from flighttune.campaigns.engine.engine import CampaignOutcome, Forecast
from flighttune.campaigns.planning.plan import draws_in_words
from flighttune.campaigns.statistics.findings import answer_words
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.early import finding_of_early
from flighttune.outputs.answers.finding import PartFinding, unmet
from flighttune.outputs.answers.labels import columns, endings_table

COST_COLUMNS = columns("core_s workers wall_s rows_bytes signals_bytes", of="cost")


def planned(forecast: Forecast) -> Answer:
    """Flights, dispersions, signals kept and the cost of a plan."""
    plan, cost = forecast.plan, forecast.cost
    campaign, keep = plan.campaign, plan.campaign.keep
    disperse = [table.model_dump(mode="json", exclude_none=True) for table in campaign.disperse]
    keys = " ".join(dict.fromkeys(key for table in disperse for key in table))
    values = {
        "title": campaign.title,
        **pick(plan, "runs draws"),
        **pick(campaign, "design seed time_limit_s"),
        "disperse": disperse,
        "keep": keep.model_dump(mode="json"),
        **cost,
    }
    tables = [
        Table(columns("runs draws design seed time_limit_s"), [values], campaign.title),
        Table(columns(keys), disperse, "dispersed"),
    ]
    if cost:
        title = f"cost, from {cost['timed_runs']} runs flown now"
        tables.insert(1, Table(columns("plant gains run_s"), cost["groups"], "groups"))
        tables.append(Table(COST_COLUMNS, [values], title))
    counted = draws_in_words(plan.runs, plan.groups)
    unknown = "time and space are not estimated: that runs the code of"
    kept = f"the first {keep.failures} failures, the worst {keep.worst} by {keep.worst_by}"
    return Answer(
        values=values,
        tables=tables,
        notes=[
            f"{'at most ' if campaign.until_sure else ''}{plan.runs} flights = {counted}",
            f"signals kept: {kept}, a sample of {keep.sample}",
            *(f"{unknown} {file}" for file in plan.code),
        ],
    )


def succeeded_in_words(outcome: CampaignOutcome) -> str:
    """Number of flights that meet every requirement, with the best and worst group."""
    said = f"{outcome.succeeded} of {outcome.runs} flights meet every requirement"
    shares = {
        f"{group['group']} ({group['succeeded']} of {group['runs']})": group["succeeded"]
        / group["runs"]
        for group in outcome.by_group
        if group["runs"]
    }
    if len({*shares.values()}) < 2:
        return f"{said}."
    best, worst = (pick_of(shares, key=shares.__getitem__) for pick_of in (max, min))
    return f"{said}: the largest share with {best}, the smallest with {worst}."


def mostly_early(outcome: CampaignOutcome) -> list[PartFinding]:
    """A finding if most flights ended early, and not as a requirement states."""
    if 2 * outcome.succeeded >= outcome.runs:
        return []
    return finding_of_early({"": outcome.endings}, outcome.runs)


def flown(outcome: CampaignOutcome) -> Answer:
    """Flights by status, and their time; exit status 130 after an interrupt.

    Exit status 1 unless all groups surely reach the required share.
    """
    speed = f"{duration(outcome.wall_s)}, {rate(outcome.rate_per_s)} a second"
    interrupted = (
        f"interrupted, {outcome.runs} of {outcome.planned} runs are in {outcome.dataset}; "
        "go on with the same command and --resume"
    )
    answered = answer_words(outcome.sure, outcome.until_sure)
    most = f" of at most {outcome.planned}" if outcome.until_sure else ""
    reached = all(said == "yes" for said in outcome.sure.values())
    kept = "planned runs completed failed crashed succeeded statuses flown kept"
    return Answer(
        values=pick(outcome, f"{kept} wall_s rate_per_s interrupted{' sure' * bool(outcome.sure)}")
        | outcome.compiled.values,
        tables=[
            Table(columns(" ".join(outcome.by_group[0])), outcome.by_group),
            endings_table(outcome.endings),
        ],
        lines=[succeeded_in_words(outcome), *([answered] if answered and reached else [])],
        notes=[
            f"{outcome.runs}{most} flights = {draws_in_words(outcome.runs, outcome.groups)}",
            f"flown now: {outcome.flown} in {speed}" if outcome.flown else "nothing was missing",
            *outcome.compiled.notes,
            *outcome.assumed,
        ],
        verdict=answered if reached else "",
        files={"dataset": outcome.dataset},
        findings=(
            unmet(interrupted, 130)
            if outcome.interrupted
            else [*mostly_early(outcome), *([] if reached else unmet(answered))]
        ),
    )
