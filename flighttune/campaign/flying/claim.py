"""The claim that is looked at in every run: the certified ultimate set of its group's gains."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.campaign.flying.alone import nominal_flights, plant_table
from flighttune.campaign.planning.plan import Group, Plan
from flighttune.control.closed_loop import closed_loop, disturbance_entry
from flighttune.control.linear_model import kinematic_model
from flighttune.gap.certified_set import too_wide
from flighttune.gap.mismatch import mismatch
from flighttune.gap.ultimate_set import ROUNDING, Kept, error_states, kept
from flighttune.metrics import signal_arrays
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run
from flighttune.theory.attractor import invariant_ellipsoid
from flighttune.theory.indicators import indicators
from flighttune.units import wrap_angle

HALF = 0.5
"""Part of the flight from which a claim is looked at where the campaign gives no time."""

FEWEST_SAMPLES = 4
LOOKED_AT = ("chi", "gamma", "chi_ref", "gamma_ref", "chi_err", "gamma_err")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Claim:
    """The set that errors do not leave while the disturbance changes no faster than `L_d`.

    Attributes
    ----------
    shape : ndarray, shape (4, 4)
        Of the invariant ellipsoid for L_d = 1: s is in the set where ``s' shape s <= L_d^2``.
    L_d : float, rad/s^2
        Bound of the rate of the disturbance.
    t_from : float, s
        Time from which flights are looked at.
    tube : tuple of float, rad
        Largest errors of course and of flight-path angle in the set.
    asked : float, rad
        Largest change of course or of flight-path angle that the undispersed flight is asked for.
    """

    shape: FloatArray
    L_d: float
    t_from: float
    tube: tuple[float, float]
    asked: float

    @property
    def says_nothing(self) -> bool:
        """Whether the set is so wide that hardly a flight would be outside: see `too_wide`."""
        return too_wide(self.tube, self.asked)

    def of_run(self, run: Run) -> Kept | None:
        """Whether the claim holds in a flight; None where it was not completed."""
        if run.status != "completed" or len(run.signals) < FEWEST_SAMPLES:
            return None
        found = signal_arrays(run, LOOKED_AT)
        t = run.signals.index.to_numpy(dtype=float)
        return self.of(
            t,
            errors=(found["chi_err"], found["gamma_err"]),
            references=(found["chi_ref"], found["gamma_ref"]),
            flown=(found["chi"], found["gamma"]),
        ).item()

    def of(
        self,
        t: FloatArray,
        *,
        errors: tuple[FloatArray, FloatArray],
        references: tuple[FloatArray, FloatArray],
        flown: tuple[FloatArray, FloatArray],
    ) -> np.ndarray:
        """Whether the claim holds in completed flights.

        Parameters
        ----------
        t : ndarray, shape (k,), s
            Times of the samples.
        errors, references, flown : tuple of ndarray, shape (..., k), rad
            Of course and of flight-path angle.

        Returns
        -------
        ndarray of str, shape (...)
            As `Kept`.
        """
        first = int(np.searchsorted(t[:-1] + 0.5 * np.diff(t), self.t_from))
        before = max(first - 1, 0)
        dt = np.diff(t[before:])
        found = error_states(
            t[before:],
            errors=(errors[0][..., before:], errors[1][..., before:]),
            references=(references[0][..., before:], references[1][..., before:]),
            rates=(np.diff(flown[0][..., before:]) / dt, np.diff(flown[1][..., before:]) / dt),
        )
        inside = found.level(self.shape) <= (self.L_d * (1.0 + ROUNDING)) ** 2
        late = slice(first - before, None)
        return kept(inside[..., late], found.moved[..., late])


def claims(plan: Plan) -> Mapping[Group, Claim | None]:
    """The claim of each group of a plan.

    Parameters
    ----------
    plan : Plan

    Returns
    -------
    mapping of Group to Claim or None
        None where the gains have none: they were not found, their loop is not stable, or the
        undispersed flight that is to give ``L_d`` was not completed or has no mismatch, being that
        of the law itself.

    Raises
    ------
    PlantError
        If an aircraft cannot be built.

    Notes
    -----
    The loop is that of the kinematic law about wings-level flight on the first reference of the
    undispersed scenario: the disturbance is what that law does not know. Every process computes the
    claims anew, to the same bits, and keeps those of its last plans.
    """
    return _claims(_Same(plan))


class _Same:
    """A plan that equals every other one of the same content."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    def __hash__(self) -> int:
        return hash(self.plan.sha256)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.plan.sha256 == other.plan.sha256


@lru_cache(maxsize=8)
def _claims(same: _Same) -> Mapping[Group, Claim | None]:
    plan = same.plan
    table = plan.campaign.certificate
    scenario = plan.scenario
    t_from = table.from_s if table else None
    t_from = HALF * scenario.flight.duration_s if t_from is None else t_from
    given = table.L_d_rad_s2 if table else None
    flights = {} if given else nominal_flights(plan)
    found: dict[Group, Claim | None] = {}
    for group in plan.groups:
        law = not given and _is_the_law(scenario, group)
        L_d = None if law else given or _measured(scenario, flights.get(group), t_from)
        found[group] = _claim(plan, group, L_d, t_from)
    return MappingProxyType(found)


def _is_the_law(scenario: Scenario, group: Group) -> bool:
    """Whether a flight is that of the law itself: the mismatch measured is rounding."""
    kinematic = plant_table(scenario, group.plant).kind == "kinematic"
    return kinematic and scenario.disturbance is None and not scenario.windy


def _claim(plan: Plan, group: Group, L_d: float | None, t_from: float) -> Claim | None:
    gains, scenario = plan.gain_sets[group.gains], plan.scenario
    if gains is None or L_d is None:
        return None
    _, gamma = scenario.followed().sampled(np.zeros(1))
    flight = scenario.flight
    model = kinematic_model(V_a=flight.V_a_mps, gamma=float(gamma[0]), g=flight.g_mps2)
    A_K = closed_loop(model, gains)
    if indicators(A_K).status != "stable":
        return None
    unit = invariant_ellipsoid(A_K, disturbance_entry(model), L_d=1.0)
    shape = np.asarray(np.linalg.inv(unit.W), dtype=np.float64)
    widths = (np.sqrt(np.diag(unit.W))[2:] * L_d).tolist()
    return Claim(
        shape=shape,
        L_d=L_d,
        t_from=t_from,
        tube=(widths[0], widths[1]),
        asked=_asked(scenario),
    )


def _asked(scenario: Scenario) -> float:
    """Largest change of course or of flight-path angle from the start to the reference, rad."""
    t = np.arange(0.0, scenario.flight.duration_s, 1.0 / scenario.controller.rate_hz)
    chi, gamma = scenario.followed().sampled(t)
    start = scenario.condition
    turn = chi - chi[0] + wrap_angle(float(chi[0]) - start.chi)
    return float(max(np.abs(turn).max(), np.abs(gamma - start.gamma).max()))


def _measured(scenario: Scenario, run: Run | None, t_from: float) -> float | None:
    """Largest rate of the mismatch of a flight from `t_from` on; None where it tells none."""
    if run is None or run.status != "completed" or len(run.signals) < FEWEST_SAMPLES:
        return None
    found = mismatch(run, V_a=scenario.flight.V_a_mps, g=scenario.flight.g_mps2)
    middle = found.t + 0.5 * np.diff(run.signals.index.to_numpy(dtype=float))
    strength = np.linalg.norm(found.d_dot, axis=1)
    first = min(int(np.searchsorted(middle, t_from)), len(strength) - 1)
    L_d = float(strength[first:].max())
    return L_d if 0.0 < L_d < np.inf else None
