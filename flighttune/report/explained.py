"""The gap of an aircraft run that was flown before: its ladder, mismatch and certified set."""

from dataclasses import dataclass

from flighttune.control.closed_loop import closed_loop, disturbance_entry
from flighttune.errors import InputError
from flighttune.gap.certified_set import LoopFlown, Verdict, loop_flown
from flighttune.gap.free_flight import FreeFlight, free_flight
from flighttune.gap.ladder import Ladder, climb
from flighttune.gap.mismatch import Mismatch, mismatch
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run
from flighttune.theory.indicators import indicators


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExplainedGap:
    """What the aircraft adds to the paper's law, step by step.

    Attributes
    ----------
    name : str
        What flew: the gains, and the name of the plant where it has one.
    run : Run
        The aircraft's, cut to the time all rungs flew.
    ladder : Ladder
    mismatch : Mismatch
    loop : LoopFlown or None
        None where the linear loop has no certificate.
    verdict : Verdict or None
        Whether the certified ultimate set held over the whole flight.
    free : FreeFlight or None
        The part of the flight that no limit holds, in the reach of the linear loop.
    """

    name: str
    run: Run
    ladder: Ladder
    mismatch: Mismatch
    loop: LoopFlown | None
    verdict: Verdict | None
    free: FreeFlight | None


def explained_gap(scenario: Scenario, aircraft: Run, name: str) -> ExplainedGap:
    """Fly the lower rungs beside a recorded flight of an aircraft of the scenario.

    Parameters
    ----------
    scenario : Scenario
    aircraft : Run
    name : str
        What to call it.

    Raises
    ------
    InputError
        If the flight is too short, or without gains.
    """
    gains = aircraft.provenance.gains
    if gains is None:
        raise InputError(f"`aircraft` must have gains, got none for {aircraft.label}.")
    ladder = climb(scenario, aircraft)
    top = ladder.runs[-1]
    found = mismatch(top, V_a=scenario.flight.V_a_mps, g=scenario.flight.g_mps2)
    model = scenario.linear_model()
    A_K = closed_loop(model, gains)
    certified = model.shape[0] == 2 and indicators(A_K).status == "stable" and found.L_d > 0.0
    entry = disturbance_entry(model)
    loop = loop_flown(top, found, A_K, entry) if certified else None
    return ExplainedGap(
        name=name,
        run=top,
        ladder=ladder,
        mismatch=found,
        loop=loop,
        verdict=loop and loop.verdict(),
        free=free_flight(top, found, A_K, entry) if certified else None,
    )
