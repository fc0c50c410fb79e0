"""The claim checked in every run: the certified ultimate set of its group's gains."""

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from flighttune.campaign.flying.alone import nominal_flights
from flighttune.campaign.planning.plan import Group, Plan
from flighttune.guarantee.flight_check import flight_check
from flighttune.guarantee.ultimate_set import (
    SETTLED_FROM,
    UltimateSet,
    certified_loop,
    largest_command,
)
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run
from flighttune.units import wrap_angle


def claims(plan: Plan) -> Mapping[Group, UltimateSet | None]:
    """The claim of each group of a plan.

    Parameters
    ----------
    plan : Plan

    Returns
    -------
    mapping of Group to UltimateSet or None
        None where there is no claim: no gains were found, their loop is not stable, or the
        undispersed flight from which ``L_d`` is measured was not completed, or is one of the law
        itself and has no mismatch.

    Raises
    ------
    PlantError
        If an aircraft cannot be built.

    Notes
    -----
    The loop is that of the kinematic law about wings-level flight on the first reference of the
    undispersed scenario. Every process computes the claims anew, to the same bits, and keeps those
    of its last plans.
    """
    return _claims(_PlanByContent(plan))


class _PlanByContent:
    """A plan that compares equal to any other with the same content."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    def __hash__(self) -> int:
        return hash(self.plan.sha256)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _PlanByContent) and self.plan.sha256 == other.plan.sha256


@lru_cache(maxsize=8)
def _claims(by_content: _PlanByContent) -> Mapping[Group, UltimateSet | None]:
    plan = by_content.plan
    table = plan.campaign.certificate
    t_from = table.from_s if table else None
    if t_from is None:
        t_from = SETTLED_FROM * plan.scenario.flight.duration_s
    if table and table.L_d_rad_s2:
        bounds: dict[Group, float | None] = dict.fromkeys(plan.groups, table.L_d_rad_s2)
    else:
        bounds = {group: _measured(run, t_from) for group, run in nominal_flights(plan).items()}
    return MappingProxyType(
        {group: _claim(plan, group, bounds[group], t_from) for group in plan.groups}
    )


def _claim(plan: Plan, group: Group, L_d: float | None, t_from: float) -> UltimateSet | None:
    gains, scenario = plan.gain_sets[group.gains], plan.scenario
    law, _ = scenario.law_of(group.gains, gains)
    if gains is None or L_d is None or not law.by_gains:
        return None
    loop = certified_loop(scenario.kinematic_model(law), gains)
    commanded = _commanded(scenario)
    return loop and UltimateSet(loop=loop, L_d=L_d, t_from=t_from, commanded=commanded)


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
    L_d = check.verdict(t_from).claim.L_d
    return L_d if 0.0 < L_d < np.inf else None
