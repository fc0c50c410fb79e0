"""The command that finds gains which meet requirements, by flying them."""

import shlex
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

from typer import Option

from flighttune.cli import options
from flighttune.cli.gains import chosen_gains, save_answer
from flighttune.cli.show import campaign_pool, pick
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import columns, listed
from flighttune.present.tables import Column, Table, interval, percent

REQUIREMENT_COLUMNS = [
    *columns("run"),
    Column("measure", "requirement"),
    Column("sense", "must be"),
    Column("bound", "bound"),
    Column("value", "value"),
    Column("start", "at the start"),
    Column("margin", "margin", "%", percent),
    Column("active", "active"),
]
SHARE_COLUMNS = [
    *REQUIREMENT_COLUMNS[:4],
    Column("share", "met", "%", percent),
    Column("share_start", "met at the start", "%", percent),
]
TRADE_COLUMNS = [
    *REQUIREMENT_COLUMNS[:5],
    Column("alone", "best seen"),
    Column("beside", "best seen with the others met", missing="none"),
]
LOOP_COLUMNS = columns("R_K I_K E_K spectral_abscissa")
CERTIFICATE_COLUMNS = [Column("in_words", "status"), *columns("rate growth radius")]
BY_DEFAULT_NOTE = (
    "Margins of the linear loop of 6 dB and 35 deg are required by default: others under "
    "at_least.loop of [[expect]] replace them."
)


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
        Option(min=1, help="Maximum number of flights [default: 600, or 6000 with a campaign]."),
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
        float, Option(help="Share of the flights of a campaign that must succeed.")
    ] = 0.95,
    page: Annotated[Path | None, Option(help="HTML page to write, with all candidates.")] = None,
    settings: options.SetOption = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    out: options.GainsFileOption = None,
) -> Answer:
    """Find gains with which flights of SCENARIO meet its [[expect]], by flying candidates.

    Exit status 1 if none are found; the nearest are printed.
    """
    from flighttune.campaign.counted_flights import distribution_of
    from flighttune.campaign.meet import BY_DEFAULT
    from flighttune.campaign.meet import meet as search
    from flighttune.campaign.planning.load import load_campaign
    from flighttune.control.gains import gains_lists, gains_table
    from flighttune.control.linear_model import closed_loop
    from flighttune.control.margins import loop_margins, margins_table
    from flighttune.flight.load import load_scenario
    from flighttune.flight.models import certify_scenario, linear_model
    from flighttune.theory.indicators import indicators

    options.check_ending(out, ".json")
    options.check_ending(page, ".html", option="--page")
    if campaign and also:
        raise InputError("--also: must be absent with --campaign, which is about one scenario.")
    loaded, starts = load_scenario(scenario, changes=options.changes(settings)), None
    if start is not None:
        _, name, gains = chosen_gains(scenario, start, settings)
        starts = {name: gains}
    table = load_campaign(campaign, loaded) if campaign else None
    first = table.nominal if table else loaded
    with campaign_pool(workers, scheduler) as pool:
        values, gains, trials = search(
            [first, *map(load_scenario, also or [])],
            pool,
            start=starts,
            budget=budget,
            metric=metric,
            table=table,
            success=success,
        )
    law = first.laws[0]
    model = linear_model(first, law)
    loop = indicators(closed_loop(model, gains), errors=len(model.errors))
    of_loop = pick(loop, "R_K I_K E_K spectral_abscissa")
    made = certify_scenario(first, gains, law=law)
    name, rows = Path(scenario).stem, values["requirements"]
    tables = [
        Table(
            SHARE_COLUMNS if table else REQUIREMENT_COLUMNS,
            rows,
            _of_start(values) or name,
        ),
        Table(TRADE_COLUMNS, values["trade_offs"], "the best of each among the gains flown here"),
        gains_table("gains", gains),
    ]
    if table:
        labels = [plant.label for plant in table.nominal.plant]
        tables += [distribution_of(table, label).table(label) for label in labels]
    answer = Answer(
        values={
            **values,
            **gains_lists(gains),
            **of_loop,
            "certificate": made.values,
        },
        tables=[
            *tables,
            Table(LOOP_COLUMNS, [of_loop]),
            margins_table(loop_margins(model, gains)),
            Table(CERTIFICATE_COLUMNS, [made.values], "certificate"),
        ],
        notes=[
            *(f"{row['measure']} on {row['run']}: {row['why']}" for row in rows if row["why"]),
            *[BY_DEFAULT_NOTE] * any(row["run"].endswith(BY_DEFAULT) for row in rows),
        ],
        verdict=_sentence(values),
        files={"out": out, "page": page},
        failure="" if values["status"] == "met" else f"{scenario}: {_sentence(values)}",
    )
    if out is not None:  # before the page: a fault in it must not lose the search
        save_answer(out, answer)
    if page is not None:
        from flighttune.reports.meet import write_meet_page

        given = [("also", name) for name in also or ()]
        given += [("start", start), ("budget", budget), ("metric", metric)]
        given += [("campaign", campaign), ("success", success if campaign else None)]
        words = [(f"--{key}", str(value)) for key, value in given if value is not None]
        command = (
            f"flighttune meet {options.repeated(scenario, settings)} {shlex.join(chain(*words))}"
        )
        summary = [text for text in (_of_start(values), _sentence(values)) if text]
        write_meet_page(page, first, values, tables, trials, summary, command)
    return answer


def _of_start(values: dict[str, Any]) -> str:
    """That the gains of the start need no search, if they do not."""
    n = len(values["requirements"])
    return f"{values['start']} already meets all {n} requirements" if values["start_met"] else ""


def _sentence(values: dict[str, Any]) -> str:
    """Whether the requirements are met, after how many flights, and which are active."""
    requirements, flights = values["requirements"], f"{values['flights']} flights"
    n, missed = len(requirements), sum(not row["margin"] >= 0.0 for row in requirements)
    if counted := values["success"]:
        own, start = (
            interval(*(100.0 * counted[key][end] for end in ("value", "lo", "hi")))
            for key in ("share", "of_start")
        )
        by = "lower end of the interval" if counted["by"] == "lo" else "estimate"
        return (
            f"On {counted['share']['n']} fresh draws {own} % of the flights meet all requirements, "
            f"{start} % with {values['start']}; {100.0 * counted['wanted']:g} % are wanted, by the "
            f"{by} ({flights})."
        )
    if missed:
        return f"{missed} of {n} requirements missed, after {flights}; these are the nearest gains."
    least = 100.0 * min(row["margin"] for row in requirements)
    met, metric = (
        f"All {n} requirements are met by {least:.1f} %, after {flights}",
        values["metric"],
    )
    if metric["name"] == "margin":
        return f"{met}."
    active = [f"{row['measure']} on {row['run']}" for row in requirements if row["active"]]
    limits = f"; {listed(active)} hold{'s' * (len(active) == 1)} it off" if active else ""
    return (
        f"{met}. {metric['name']} is {metric['value']:.4g}, {metric['start']:.4g} at the start"
        f"{limits}."
    )
