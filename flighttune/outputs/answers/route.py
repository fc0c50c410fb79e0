"""The answer of a planned route."""

from collections.abc import Sequence

from flighttune.flight.route import PlannedRoute
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.finding import PartFinding, headlines
from flighttune.outputs.answers.labels import columns

COLUMNS = columns(
    "kind name start_m length_m course turn radius_m roll roll_downwind gamma time_s", of="route"
)


def answer(route: PlannedRoute, findings: Sequence[PartFinding] = ()) -> Answer:
    """The stretches, the length and the time in still air and in wind.

    It begins with `findings` about the path.
    """
    path, slowest, time = route.reference.path, float(route.reference.V.min()), route.time
    stretches, in_wind, wind = route.stretches, "", f"a wind of {route.wind:.3g} m/s"
    if 0.0 < route.wind < slowest:
        in_wind = f", at most {path.length / (slowest - route.wind):.0f} s in {wind}"
    elif route.wind:
        in_wind = f", without an end against {wind}, which is faster than the aircraft"
    length = f"{path.length:.0f} m, {time:.0f} s in still air{in_wind}"
    flown = f"The path can be flown{route.except_slopes}: {length}."
    plants = ", ".join(table.label for table in route.scenario.plant)
    faults = [x for x in findings if x.status]
    return Answer(
        findings=findings,
        lines=[
            f"The path has {length}." if faults else flown,
            f"For {plants}: {route.conditions}.",
        ],
        changed=[*route.scenario.notes, *route.changed],
        values={
            "conditions": route.conditions,
            "length_m": path.length,
            "time_s": time,
            "stretches": stretches,
        },
        tables=[Table(COLUMNS, stretches, f"{route.scenario.title}: {route.conditions}")],
        verdict=headlines(findings)[0] if faults else length,
    )
