"""The claim checked in every run: the certified ultimate set of its group's gains."""

from functools import lru_cache

import numpy as np

from flighttune.campaign.flying.alone import fly_group
from flighttune.campaign.planning.plan import Group, Plan
from flighttune.guarantee.flight_check import (
    SETTLED_FROM,
    UltimateSet,
    certified_loop,
    flight_check,
    largest_command,
)
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run
from flighttune.units import wrap_angle


@lru_cache(maxsize=512)
def claim_of(plan: Plan, group: Group) -> UltimateSet | None:
    """The claim of a group of a plan; None where there is none.

    There is none without gains, for a loop that is not stable, and where the undispersed flight
    that ``L_d`` is measured on was not completed or has no mismatch; nor for an aircraft, unless
    the campaign states ``L_d``: its tube says more. The loop is that of the law about wings-level
    flight on the first reference of the undispersed scenario.
    Every process computes the claims anew, to the same bits. PlantError if an aircraft cannot be
    built.
    """
    gains, scenario = plan.gain_sets[group.gains], plan.scenario
    law, _ = scenario.law_of(group.gains, gains)
    if gains is None or not law.by_gains:
        return None
    loop = certified_loop(scenario.kinematic_model(law), gains)
    table = plan.campaign.certificate
    L_d, t_from = (table.L_d_rad_s2, table.from_s) if table else (None, None)
    if t_from is None:
        t_from = SETTLED_FROM * scenario.flight.duration_s
    if L_d is None and scenario.plant_table(group.plant).aircraft is None:
        L_d = _measured(fly_group(plan, scenario, group), t_from)
    if loop is None or L_d is None:
        return None
    _, unit = loop
    return UltimateSet(unit=unit, L_d=L_d, t_from=t_from, commanded=_commanded(scenario))


def _commanded(scenario: Scenario) -> float:
    """Largest change commanded by the undispersed scenario, rad."""
    rate = scenario.controller.rate_hz
    t = np.arange(round(scenario.flight.duration_s * rate) + 1) / rate
    chi_ref, gamma_ref = scenario.followed().sampled(t)
    start = scenario.condition
    e_0 = wrap_angle(float(chi_ref[0]) - start.chi), float(gamma_ref[0]) - start.gamma
    return largest_command(chi_ref, gamma_ref, e_0)


def _measured(run: Run, t_from: float) -> float | None:
    """Bound of the mismatch of an undispersed flight from `t_from` on, if it has one."""
    check = flight_check(run) if run.status == "completed" else None
    if check is None or check.of_the_law:
        return None
    L_d = check.claim(t_from)[0].L_d
    return L_d if 0.0 < L_d < np.inf else None
