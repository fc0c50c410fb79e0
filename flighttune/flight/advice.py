"""Advice where flights miss what their scenario requires."""

from collections.abc import Iterator, Sequence

from flighttune.control.gains import PAPER_SPEED, paper_family
from flighttune.control.law import split_name
from flighttune.flight.expectations import bound_checks
from flighttune.metrics import measures
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import TUNED_IDENTIFIED
from flighttune.simulate.run import Run

# Time that a command spends at a limit, s, from which the limit counts as a cause.
AT_LIMIT_S = 0.5

# Relative difference of airspeeds from which gains count as those of another airspeed.
OTHER_AIRSPEED = 0.15


def advice(scenario: Scenario, runs: Sequence[Run], source: str) -> str:
    """One line with what may help the runs that miss an upper bound; empty if nothing is known to.

    `source` is the scenario as the commands in the line name it.
    """
    ways = dict.fromkeys(way for run in runs for way in _ways(scenario, run, runs, source))
    return f"To try next: {'; '.join(ways)}." if ways else ""


def _ways(scenario: Scenario, run: Run, runs: Sequence[Run], source: str) -> Iterator[str]:
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
            yield f"gains that meet it on the aircraft too, `flighttune tune {source} --meet`"
    gains = split_name(made_by.gains_name)[1]
    better = TUNED_IDENTIFIED not in scenario.gains
    if better and gains in paper_family() and abs(V_a / PAPER_SPEED - 1.0) > OTHER_AIRSPEED:
        yield f"`{TUNED_IDENTIFIED}` in `gains`, as {gains} is meant for {PAPER_SPEED:g} m/s"
    strayed = (run.signals["V_a"] / V_a - 1.0).abs().max() > OTHER_AIRSPEED
    if strayed and not scenario.controller.schedule:
        yield "`schedule = true` in [controller], as the airspeed changes in flight"
