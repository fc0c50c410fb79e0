"""Commands that find gains; gains by name or file, and how commands print them."""

import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from flighttune.cli import options
from flighttune.cli.show import NO, campaign_pool, fail, pick
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import columns, listed
from flighttune.present.tables import Column, Table, interval, percent

if TYPE_CHECKING:
    from flighttune.control.gains import PIGains
    from flighttune.control.margins import Margins
    from flighttune.scenario import Scenario

# Searches over an envelope, besides the one from the gains tuned at the trim.
ENVELOPE_STARTS = 2

MARGIN_COLUMNS = [
    *columns("loop"),
    Column("gain_decrease", "gain from"),
    Column("gain_increase", "gain to"),
    *columns("phase_margin_deg delay_margin_s lag_margin_s"),
]
RESULT_COLUMNS = columns("status R_K I_K E_K spectral_abscissa active method starts wall_s")
ENVELOPE_COLUMNS = [
    *columns("status"),
    Column("R_envelope", "rate over the envelope", "1/s"),
    *columns("R_K I_K E_K spectral_abscissa wall_s"),
]
DIAGNOSIS_COLUMNS = [
    Column("smallest_I_K", "smallest I_K", "s²"),
    Column("largest_R_K", "largest R_K", "1/s"),
    Column("common_factor", "factor on all limits that would be enough"),
]
LIMIT_COLUMNS = [
    Column("name", "limit"),
    Column("factor_alone", "factor on it alone that would be enough"),
    Column("smallest_I_K_without", "smallest I_K without it", "s²"),
]
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
BY_DEFAULT_NOTE = (
    "Margins of the linear loop of 6 dB and 35 deg are required by default: others under "
    "at_least.loop of [[expect]] replace them."
)
OF_LOOP = columns("R_K I_K E_K spectral_abscissa")
CERTIFICATE_STATUS = [Column("in_words", "status"), *columns("rate growth")]
OF_CERTIFICATE = [*CERTIFICATE_STATUS, *columns("radius")]


def tune(
    scenario: options.ScenarioArgument,
    envelope: Annotated[
        bool, Option("--envelope", help="Maximise the rate over the scenario's envelope.")
    ] = False,
    settings: options.SetOption = None,
    meet: Annotated[
        bool,
        Option("--meet", help="Find gains that meet the scenario's [[expect]], by flying them."),
    ] = False,
    also: Annotated[
        list[str] | None,
        Option(metavar="SCENARIO", help="With --meet: another scenario to meet as well."),
    ] = None,
    start: Annotated[
        str | None,
        Option(
            metavar="NAME|FILE",
            help="With --meet: gains to start from [default: the best of the tuned ones and the "
            "scenario's].",
        ),
    ] = None,
    budget: Annotated[
        int | None,
        Option(
            min=1,
            help="With --meet: maximum number of flights [default: 600, or 6000 with --campaign].",
        ),
    ] = None,
    metric: Annotated[
        str | None,
        Option(
            help="With --meet, without --campaign: what to minimise once all requirements are met "
            "by 20 %, ITAE or a column of campaign rows; or margin, which maximises the margin "
            "further [default: ITAE].",
        ),
    ] = None,
    campaign: Annotated[
        str | None,
        Option(
            metavar="CAMPAIGN",
            help="With --meet: campaign that disperses the scenario; the share of flights that "
            "succeed is maximised.",
        ),
    ] = None,
    success: Annotated[
        float | None, Option(help="With --campaign: share that must succeed [default: 0.95].")
    ] = None,
    page: Annotated[
        Path | None, Option(help="With --meet: HTML page to write, with all candidates.")
    ] = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    out: options.GainsFileOption = None,
    prove: Annotated[
        Path | None,
        Option(help="File for a proof that bounds R_K over all gains; `verify` checks it."),
    ] = None,
) -> Answer:
    """Find the gains with the largest R_K under the constraints of SCENARIO.

    With --meet, find gains with which its flights meet its requirements; exit status 1 if none
    are found, and the nearest are printed.
    """
    from flighttune.control.gains import gains_table
    from flighttune.control.margins import loop_margins
    from flighttune.scenario import load_scenario

    options.check_ending(out, ".json")
    options.check_ending(prove, ".json")
    options.check_ending(page, ".html", option="--page")
    of_meet = {
        "also": also,
        "start": start,
        "budget": budget,
        "metric": metric,
        "campaign": campaign,
        "success": success,
        "page": page,
        "workers": workers,
        "scheduler": scheduler,
    }
    if meet:
        for option, value in (("--envelope", envelope), ("--prove", prove)):
            if value:
                raise InputError(f"{option}: must be absent with --meet.")
        return _to_meet(scenario, settings, out, of_meet)
    for option, value in of_meet.items():
        if value is not None:
            raise InputError(f"--{option}: must be absent without --meet.")
    loaded = load_scenario(scenario, changes=options.changes(settings))
    if envelope and loaded.tuning.objective != "R_K":
        raise InputError("--envelope: `objective` of [tuning] must be R_K, got cost.")
    gains, search = _over_envelope(loaded) if envelope else _at_trim(loaded)
    tuned = search.values["status"] in ("optimal", "found")
    margins = loop_margins(loaded.linear_model(), gains) if tuned and gains else ()
    first, *others = search.tables
    answer = replace(
        search,
        values={**search.values, **gains_values(gains)},
        tables=[first, gains_table("gains", gains), margins_table(margins), *others],
        files={"out": out},
        failure="" if tuned else f"{scenario}: {search.values['reason']}",
    )
    if prove is not None:
        answer = _with_bound(loaded, answer, prove)
    if out is not None:
        save_answer(out, answer)
    return answer


def _with_bound(scenario: "Scenario", answer: Answer, file: Path) -> Answer:
    """The answer with a proven bound on R_K over all gains, whose proof is written to `file`."""
    from flighttune.certificates.bound import bound_rate
    from flighttune.files.value import write
    from flighttune.flight.outer_loop import tuning_problem

    problem = tuning_problem(scenario)
    bound = bound_rate(problem.model, problem.I_star, problem.scaling)
    if bound is None:
        fail(f"--prove: no proof was found for `I_star` {problem.I_star:g}.", NO)
    write(bound, file)
    return replace(
        answer,
        values={**answer.values, "bound": pick(bound, "claim I_star R_bound")},
        notes=[*answer.notes, f"proven {bound.claim}"],
        files={**answer.files, "proof": file},
    )


def frontier(
    scenario: options.ScenarioArgument,
    out: Annotated[Path | None, options.out_folder("runs/NAME")] = None,
    points: Annotated[int, Option(min=2, max=1000, help="Points of the frontier.")] = 25,
    settings: options.SetOption = None,
) -> Answer:
    """Tabulate and draw the largest R_K for each I_K, with the paper's and the scenario's gains.

    The same gains are drawn against E_K, the largest error that a disturbance can cause.
    """
    from flighttune.control.gains import paper_family
    from flighttune.files.whole import write_text
    from flighttune.flight.outer_loop import gain_set, tuning_problem
    from flighttune.present.chart import Sheet
    from flighttune.present.palette import line_styles
    from flighttune.scenario import load_scenario
    from flighttune.tuning.frontier import frontier as frontier_table
    from flighttune.tuning.frontier import frontier_chart

    loaded = load_scenario(scenario, changes=options.changes(settings))
    law, flight = loaded.laws[0], loaded.flight
    own = [name for name in loaded.gain_names if loaded.law_of(name)[0].by_gains]
    sets = {**paper_family(), **{name: gain_set(loaded, name) for name in own}}
    marked = {
        name: law.gains_from(gains, V_a=flight.V_a_mps, g=flight.g_mps2)
        for name, gains in sets.items()
        if gains is not None
    }
    table = frontier_table(tuning_problem(loaded), points=points, marked=marked)
    folder = out or Path("runs") / Path(scenario).stem
    csv, svg = folder / "frontier.csv", folder / "frontier.svg"
    write_text(csv, table.to_csv(index=False, lineterminator="\n"))
    styles = line_styles([("", name) for name in loaded.gain_names])
    of_gains = {name: style for (_, name), style in styles.items()}
    charts = [frontier_chart(table, of_gains, against=key) for key in ("I_K", "E_K")]
    Sheet(charts=charts, columns=1).save(svg)
    shown = columns("name I_K E_K R_K spectral_abscissa")
    rows = table[[column.key for column in shown]].to_dict(orient="records")
    return Answer(
        values={
            "points": [row for row in rows if row["name"] == "frontier"],
            "marked": {row["name"]: row for row in rows if row["name"] != "frontier"},
        },
        tables=[Table(shown, rows, loaded.title)],
        files={"csv": csv, "figure": svg},
    )


def _at_trim(scenario: "Scenario") -> "tuple[PIGains | None, Answer]":
    from flighttune.flight.outer_loop import tune_scenario, tuning_problem, tuning_scaling
    from flighttune.tuning.diagnosis import diagnosis

    result, scaling = tune_scenario(scenario), tuning_scaling(scenario)
    n, _, p = scenario.linear_model().shape
    why, tables = None, []
    if result.status == "infeasible":
        nearest = diagnosis(tuning_problem(scenario))
        why = pick(nearest, "smallest_I_K largest_R_K common_factor binding limits")
        tables = [
            Table(DIAGNOSIS_COLUMNS, [why], "within the limits"),
            Table(LIMIT_COLUMNS, nearest.limits, "limits"),
        ]
    values = {
        **pick(
            result, "status reason R_K I_K E_K cost spectral_abscissa active starts wall_s method"
        ),
        "scaling": [1.0] * (n + p) if scaling is None else scaling,
        "diagnosis": why,
    }
    by_cost = scenario.tuning.objective == "cost"
    shown = [*RESULT_COLUMNS, Column("cost", "quadratic cost")] if by_cost else RESULT_COLUMNS
    note = "units of state: scaled by [tuning]; `certify` gives R_K in plain ones too"
    return result.gains, Answer(
        values=values,
        tables=[Table(shown, [values], "tuning"), *tables],
        notes=["units of state: plain, as in `certify`" if scaling is None else note],
    )


def _over_envelope(scenario: "Scenario") -> "tuple[PIGains | None, Answer]":
    from flighttune.flight.outer_loop import trim_and_envelope, tuning_problem
    from flighttune.tuning.envelope import tune_over_envelope
    from flighttune.tuning.result import assessment

    trim, envelope = trim_and_envelope(scenario)
    problem, g = tuning_problem(scenario), scenario.flight.g_mps2
    result = tune_over_envelope(problem, envelope, trim, g=g, starts=ENVELOPE_STARTS)
    at_trim = {"E_K": None, "spectral_abscissa": None, "active": []}
    if result.gains is not None:
        at_trim = pick(assessment(problem, result.gains.K), "E_K spectral_abscissa active")
    values = {
        **pick(result, "status reason R_K I_K factor wall_s"),
        **at_trim,
        "starts": ENVELOPE_STARTS,
        "R_envelope": result.R,
        "R_envelope_bound": result.R_bound,
    }
    table = Table(ENVELOPE_COLUMNS, [values], "tuning over the envelope")
    return result.gains, Answer(values=values, tables=[table])


def _to_meet(
    source: str, settings: list[str] | None, out: Path | None, asked: dict[str, Any]
) -> Answer:
    """The answer of `tune --meet`, whose options are `asked`."""
    from flighttune.campaign.conform import distribution_of
    from flighttune.campaign.meet import BY_DEFAULT, ITAE, SUCCESS, meet
    from flighttune.campaign.planning.load import load_campaign
    from flighttune.control.gains import gains_table
    from flighttune.control.linear_model import closed_loop
    from flighttune.control.margins import loop_margins
    from flighttune.flight.outer_loop import certify_scenario
    from flighttune.scenario import load_scenario
    from flighttune.theory.indicators import indicators

    also, campaign, success, page = (asked[key] for key in ("also", "campaign", "success", "page"))
    if campaign and also:
        raise InputError("--also: must be absent with --campaign, which is about one scenario.")
    if success is not None and not campaign:
        raise InputError("--success: must be absent without --campaign.")
    scenario, starts = load_scenario(source, changes=options.changes(settings)), None
    if asked["start"] is not None:
        _, name, gains = chosen_gains(source, asked["start"], settings)
        starts = {name: gains}
    table = load_campaign(campaign, scenario) if campaign else None
    first = table.nominal if table else scenario
    with campaign_pool(asked["workers"], asked["scheduler"]) as pool:
        values, gains, trials = meet(
            [first, *map(load_scenario, also or [])],
            pool,
            start=starts,
            budget=asked["budget"],
            metric=asked["metric"] or ITAE,
            table=table,
            success=SUCCESS if success is None else success,
        )
    law = first.laws[0]
    model = first.linear_model(law)
    loop = indicators(closed_loop(model, gains), errors=len(model.errors))
    of_loop = pick(loop, "R_K I_K E_K spectral_abscissa")
    made = certify_scenario(first, gains, law=law)
    name, rows = Path(source).stem, values["requirements"]
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
            **gains_values(gains),
            **of_loop,
            "certificate": made.values,
        },
        tables=[
            *tables,
            Table(OF_LOOP, [of_loop]),
            margins_table(loop_margins(model, gains)),
            Table(OF_CERTIFICATE, [made.values], "certificate"),
        ],
        notes=[
            *(f"{row['measure']} on {row['run']}: {row['why']}" for row in rows if row["why"]),
            *[BY_DEFAULT_NOTE] * any(row["run"].endswith(BY_DEFAULT) for row in rows),
        ],
        verdict=_sentence(values),
        files={"out": out, "page": page},
        failure="" if values["status"] == "met" else f"{source}: {_sentence(values)}",
    )
    if out is not None:  # before the page: a fault in it must not lose the search
        save_answer(out, answer)
    if page is not None:
        from flighttune.reports.meet import write_meet_page

        told = [("also", name) for name in also or ()]
        told += [(key, asked[key]) for key in ("start", "budget", "metric")]
        told += [("campaign", campaign), ("success", success)]
        words = [(f"--{key}", str(value)) for key, value in told if value is not None]
        flown = f"{options.repeated(source, settings)} --meet {shlex.join(chain(*words))}"
        command = f"flighttune tune {flown}"
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


def chosen_gains(
    source: str, wanted: str | None, settings: list[str] | None
) -> "tuple[Scenario, str, PIGains]":
    """Scenario, and the name and gains of ``--gains``; exit status 1 if tuning finds none."""
    from flighttune.flight.outer_loop import scenario_and_gains

    return scenario_and_gains(source, wanted, options.changes(settings))


def gains_values(gains: "PIGains | None") -> dict[str, Any]:
    """``K_P`` and ``K_I`` as nested lists, null where there are no gains."""
    return {"K_P": None, "K_I": None} if gains is None else dict(gains.as_lists())


def margins_table(margins: "Sequence[Margins]") -> Table:
    """Stability margins: a row a channel, and one for all channels at once."""
    records = [
        {
            **pick(row, "loop gain_decrease gain_increase"),
            "phase_margin_deg": math.degrees(row.phase_margin),
            "delay_margin_s": row.delay_margin,
        }
        for row in margins
    ]
    if margins:
        records[-1] |= {
            "lag_margin_s": margins[-1].lag_margin,
            "disk_margin": margins[-1].disk_margin,
        }
    return Table(MARGIN_COLUMNS, records, "stability margins", name="margins")


def save_answer(path: Path, answer: Answer) -> None:
    """Write the JSON object of an answer to a file, whole or not at all."""
    from flighttune.files.whole import write_text

    write_text(path, answer.json() + "\n")
