"""The answers of a tube, and of a search for the largest disturbance."""

from dataclasses import asdict
from typing import Any

from flighttune.base.signals import CHANNEL_SYMBOLS
from flighttune.base.units import DEG_PER_RAD
from flighttune.base.words import pick, quoted
from flighttune.claims.tubes.enclosure import LEFT, Tube
from flighttune.claims.tubes.problem import QUANTITIES, TubeProblem, residual_of_logs
from flighttune.claims.tubes.tube import TriedDisturbances
from flighttune.outputs.answers.answer import Answer, Column, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns, endings_table
from flighttune.outputs.answers.tables import gains_table

WIDTH_COLUMNS = columns("error max end ever", of="tube")
FLIGHT_COLUMNS = columns(
    "plant duration_s V_a_mps rate_hz start.chi start.gamma within end.chi end.gamma", of="tube"
)
DISTURBANCE_COLUMNS = columns("channel low high", of="tube")
TRIED_COLUMNS = [Column("disturbance", "disturbance", "rad/s", ".2g"), *columns("status reason")]
LIMIT_KEYS = ("lower", "upper", "rate_lower", "rate_upper")
LIMIT_COLUMNS = [*columns(f"command {' '.join(LIMIT_KEYS)}"), Column("held_s", "can hold", "s")]


def answer(tube: Tube, gains: str = "") -> Answer:
    """The enclosed flights and the widths; a failure if the set is not bounded.

    `gains`: name of the gains, if known.
    """
    problem, widths = tube.problem, tube.half_widths
    counted, family = problem.band, problem.table.family.enclosed
    bounded = tube.status == "bounded"
    low, high = (ends.tolist() for ends in disturbances(problem))
    flown = f"gains {gains}, {family}" if gains else family
    title = f"{quoted(problem.scenario.title)}; {flown}: {tube.status}"
    disturbed = [
        {"channel": channel, "low": lower, "high": upper}
        for channel, lower, upper in zip(CHANNEL_SYMBOLS, low, high, strict=True)
    ]
    return Answer(
        values={
            **pick(tube, "status reason probability sentence"),
            "inside": tube.reason != LEFT,
            "flown": tube.flown and asdict(tube.flown),
            "model": problem.model,
            "half_width_deg": widths,
            "limits_can_hold": {
                name: tube.held_intervals(i) for i, name in enumerate(QUANTITIES[2:])
            },
            "handed_over_s": tube.handed_over,
            "gains": problem.gains.as_lists(),
            "start_rad": problem.start,
            "disturbance_rad_s": [low, high],
            "counted": counted.sentence if counted else None,
            "aircraft_checked": problem.aircraft_checked,
            "scenario": problem.scenario.as_dict(),
        },
        tables=[
            Table(WIDTH_COLUMNS, [{"error": key, **row} for key, row in widths.items()], title),
            Table(FLIGHT_COLUMNS, [flights(problem)], "flights"),
            Table(DISTURBANCE_COLUMNS, disturbed, "any disturbance of the rates"),
            Table(LIMIT_COLUMNS, limits(tube), "limits, rates per second"),
            gains_table("gains", problem.gains),
            endings_table(counted.endings if counted else ()),
        ],
        notes=notes(tube),
        verdict=tube.sentence if bounded else "",
        findings=[] if bounded else unmet(tube.reason),
    )


def disturbances(problem: TubeProblem) -> tuple[Any, Any]:
    """The lowest and the highest disturbance of each rate, rad/s."""
    low, high = problem.disturbances
    return low.min(axis=0), high.max(axis=0)


def flights(problem: TubeProblem) -> dict[str, Any]:
    """The enclosed flights."""
    scenario = problem.scenario
    return {
        "plant": problem.plant,
        **pick(scenario.flight, "duration_s V_a_mps"),
        "rate_hz": scenario.controller.rate_hz,
        "start": dict(zip(CHANNEL_SYMBOLS, problem.path_at_start, strict=True)),
        "within": problem.start,
        "end": dict(zip(CHANNEL_SYMBOLS, problem.reference[-1, :2].tolist(), strict=True)),
    }


def limits(tube: Tube) -> list[dict[str, Any]]:
    """The limits of each command, and the times at which they may act."""
    units = (("phi_cmd [deg]", DEG_PER_RAD), ("n_z_cmd", 1.0))
    return [
        {
            "command": name,
            **{key: float(getattr(tube.problem.limits, key)[i]) * unit for key in LIMIT_KEYS},
            "held_s": [f"{begin:g} to {end:g}" for begin, end in tube.held_intervals(i)] or "never",
        }
        for i, (name, unit) in enumerate(units)
    ]


def notes(tube: Tube) -> list[str]:
    """Validity after the end, counted boxes, and the source of the disturbance."""
    problem = tube.problem
    told = [*problem.scenario.gains_notes(problem.plant)]
    if tube.status != "bounded":
        lost = "`flighttune band` bounds such flights with a probability, without a model."
        told += [lost] if problem.boxes else []
    elif tube.hand_over is None:
        told.append(
            "Nothing is claimed beyond the end of the scenario: no invariant set was found."
        )
    else:
        told.append(
            f"From {tube.handed_over:.2f} s on no limit holds a command, if later "
            "disturbances stay within those at the end."
        )
    if problem.band is not None:
        told.append(f"counted: {problem.band.sentence}")
        told += [tube.flown.sentence] if tube.flown else []
        told.append("Check the boxes too: flighttune verify PROOF --boxes FILE")
    if problem.disturbance and problem.disturbance == residual_of_logs(problem.table):
        evidence = problem.table.identified_model.log
        told.append(f"The disturbance is the {evidence and evidence.sentence}.")
    if tube.probability is not None:
        told.append(tube.probability.sentence)
    return told


def tried(found: TriedDisturbances) -> Answer:
    """The tried disturbances; a failure if the set is bounded for none of them."""
    records = [
        {"disturbance": size, **pick(tube, "status reason")} for size, tube in found.tried.items()
    ]
    bounded = found.largest is not None
    verdict = f"largest disturbance for which the set is bounded: {found.largest} rad/s"
    return Answer(
        values={"largest_disturbance": found.largest},
        tables=[Table(TRIED_COLUMNS, records, "tried", name="tried")],
        verdict=verdict if bounded else "",
        findings=[] if bounded else unmet("for no disturbance tried the set is bounded."),
    )
