"""Advice for runs that exceed an upper bound, and likely mistakes in a user's law."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from flighttune.base.units import DEG
from flighttune.control.gains import PAPER_SPEED, paper_family
from flighttune.control.gains_keys import TUNED_FOR_AIRCRAFT, TUNED_IDENTIFIED
from flighttune.flight.flown import bound_checks
from flighttune.flight.loop.run import Run
from flighttune.flight.metrics import measures
from flighttune.flight.scenario.schema import Scenario

# Time that a command spends at a limit, s, from which the limit counts as a cause.
AT_LIMIT_S = 0.5
# Gains count as tuned for another airspeed from this relative difference on.
OTHER_AIRSPEED = 0.15
# A mistake in a law shows within this time, s, after the first error of this size, rad.
FIRST_S, FIRST_ERROR = 1.0, 1.0 * DEG
# Roll commands beyond half a turn and this many times the error must be degrees: usual gains are 1
# to 5, and become 57 to 290 in degrees.
NO_ROLL, NO_GAIN = math.pi, 20.0


def advice(scenario: Scenario, runs: Sequence[Run], source: str, slopes: Sequence[str] = ()) -> str:
    """One line of advice for runs that exceed an upper bound; empty without advice.

    It begins with likely mistakes in a user's law. `source` is the scenario as commands name it,
    and `slopes` are sentences on slopes of the reference that cannot be held.
    """
    lines, sound = dict[str, None](), list[Run]()
    for run in runs:
        name = run.provenance.gains_name
        if scenario.law_table(name).of_the_user and (doubt := mistake(run)):
            lines[f"{name}: {doubt}"] = None
        else:
            sound.append(run)
    ways = dict.fromkeys(
        way for run in sound for way in ways_of(scenario, run, runs, source, slopes)
    )
    return " ".join([*lines, *([f"To try next: {'; '.join(ways)}."] if ways else [])])


def mistake(run: Run) -> str:
    """A likely mistake in the law of a run, such as its sign or degrees; else empty."""
    columns = run.signals
    if len(columns) < 2:
        return ""
    roll = columns["phi_unlimited"].to_numpy()
    lift = columns["n_z_unlimited"] * np.cos(columns["phi"]) - np.cos(columns["gamma"])
    for channel, turn in (("chi", roll), ("gamma", lift.to_numpy())):
        error = columns[f"{channel}_err"].to_numpy()
        if channel == "gamma" and "gamma_given" in columns:  # the path angle may have given way
            error = (columns["gamma_given"] - columns["gamma"]).to_numpy()
        size = np.abs(error)
        for k in np.flatnonzero(size > FIRST_ERROR)[:1]:  # none or one
            end = int(np.searchsorted(run.t, run.t[k] + FIRST_S))
            away = (error * turn)[k:end] < 0.0
            if away.all() and (size[end - 1 :] > size[k]).all():
                return "the law turns away from the reference: is the sign of its output right?"
            least = max(NO_ROLL, NO_GAIN * np.median(size[k:end]))
            if channel == "chi" and np.median(np.abs(roll[k:end])) > least:
                return "its roll commands are more than half a turn: are they degrees?"
    return ""


def ways_of(
    scenario: Scenario, run: Run, runs: Sequence[Run], source: str, slopes: Sequence[str]
) -> Iterator[str]:
    """Phrases of advice for a run that exceeds an upper bound."""
    made_by, reference, V_a = run.provenance, scenario.reference, scenario.flight.V_a_mps
    tables = scenario.expected(made_by.plant, made_by.gains_name)
    ends = [table.status for table in tables if table.status] or ["completed"]
    measured = measures(run)
    checks = [check for check in bound_checks(tables, measured) if check.sense == "at_most"]
    missed = {(check.subject, check.measure) for check in checks if not check.met}
    if not missed or run.status not in ends:
        return
    at_limit = any(measured[channel]["saturation_s"] > AT_LIMIT_S for channel in ("chi", "gamma"))
    if at_limit and reference is not None and reference.shape is None:
        segments = isinstance(reference.chi_deg, list) or isinstance(reference.gamma_deg, list)
        slower = "a slower change, `rate_dps` of [reference]"
        within = 'a reference within the limits, `shape = "feasible"` in [reference]'
        yield f"{slower if segments else within}, as commands reach their limits"
    for law in runs if made_by.aircraft and made_by.law.by_gains else ():
        if law.provenance.aircraft or law.provenance.gains_name != made_by.gains_name:
            continue
        if any(
            check.met and (check.subject, check.measure) in missed
            for check in bound_checks(tables, measures(law))
        ):
            yield f"gains that meet it on the aircraft too, `flighttune meet {source}`"
    gains = made_by.listed
    better = not {*TUNED_FOR_AIRCRAFT} & {x for x in scenario.gains if isinstance(x, str)}
    if better and gains in paper_family() and abs(V_a / PAPER_SPEED - 1.0) > OTHER_AIRSPEED:
        yield f"`{TUNED_IDENTIFIED}` in `gains`, as {gains} is meant for {PAPER_SPEED:g} m/s"
    strayed = (run.signals["V_a"] / V_a - 1.0).abs().max() > OTHER_AIRSPEED
    if strayed and slopes:
        yield "a path that is less steep, as its airspeed cannot be held on this one"
    elif strayed and not (scenario.controller.schedule or made_by.law.same_everywhere):
        yield "`schedule = true` in [controller], as the airspeed changes in flight"
