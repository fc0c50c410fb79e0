"""The claim checked in every run: the certified ultimate set of its group's gains."""

from collections.abc import Collection

import numpy as np

from flighttune.campaign.flying.alone import nominal_flights
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

Claims = dict[Group, UltimateSet | None]
"""The claim of each group; None where there is none."""


def claims(plan: Plan, groups: Collection[Group] | None = None) -> Claims:
    """The claim of each group of a plan, or of some of its groups.

    There is none without gains, for a loop that is not stable, and where the undispersed flight
    that ``L_d`` is measured on was not completed or has no mismatch; nor for an aircraft, unless
    the campaign states ``L_d``: its tube says more. The loop is that of the law about wings-level
    flight on the first reference of the undispersed scenario.
    Every process computes the claims anew, to the same bits. PlantError if an aircraft cannot be
    built.
    """
    groups = plan.groups if groups is None else groups
    table = plan.campaign.certificate
    t_from = table.from_s if table else None
    if t_from is None:
        t_from = SETTLED_FROM * plan.scenario.flight.duration_s
    if table and table.L_d_rad_s2:
        bounds: dict[Group, float | None] = dict.fromkeys(groups, table.L_d_rad_s2)
    else:
        own = [group for group in groups if plan.scenario.plant_table(group.plant).aircraft is None]
        nominal = nominal_flights(plan, own)
        bounds = {group: _measured(run, t_from) for group, run in nominal.items()}
    return {group: _claim(plan, group, bounds.get(group), t_from) for group in groups}


def _claim(plan: Plan, group: Group, L_d: float | None, t_from: float) -> UltimateSet | None:
    gains, scenario = plan.gain_sets[group.gains], plan.scenario
    law, _ = scenario.law_of(group.gains, gains)
    if gains is None or L_d is None or not law.by_gains:
        return None
    loop = certified_loop(scenario.kinematic_model(law), gains)
    if loop is None:
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
