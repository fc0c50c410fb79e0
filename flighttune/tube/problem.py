"""The flights that a tube encloses: scenario, gains, starts and disturbances."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.arrays import FloatArray, read_only_matrix
from flighttune.conformance import Conformance
from flighttune.control.exact_law import ExactLaw, acts_on_rates
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.control.limits import Limits
from flighttune.control.mimo_pi import ChannelLaw, MimoPI
from flighttune.errors import InputError
from flighttune.flight.fly import controller_of
from flighttune.plants.wind import course_of, velocity_along
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.simulate.feasible import FeasibleReference
from flighttune.tube.lag import SampledLag
from flighttune.tube.sample import Inversion, SampledLoop

MODELS = {
    "kinematic": "the paper's law",
    "point_mass": "the exact point mass",
    "point_mass_lag": "the exact point mass behind lags",
    "jsbsim": "the exact point mass behind the identified lag",
}
"""Kinds of plants whose flights can be enclosed, in words."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TubeProblem:
    """All flights of one gain set on one plant of a scenario.

    Attributes
    ----------
    scenario : Scenario
    gains : PIGains
    plant : str
        Label of the plant.
    start : float, rad
        Course and flight-path angle start within this of the scenario's.
    d_low, d_high : ndarray, shape (k, 2), rad/s
        Bounds on the disturbances of the course and the flight-path-angle rate, of any shape, from
        each of the k samples to the next.
    reference : ndarray, shape (k, 6), rad, rad, rad, 1, rad/s, rad/s
        Course and flight-path angle to follow, the commands planned for them (zeros where none
        are), and their rates.
    limits : Limits
        Of the commands.
    lags : tuple of InnerLag, length 0 or 2
        Of roll and load factor.
    roll : ndarray, shape (k, 4), rad; or None
        As of `SampledLoop`: for an aircraft whose feed-forward sees its roll.
    counted : ndarray, shape (k, 4), rad; or None
        Lowest and highest error of course and of path angle that was counted for flights of an
        aircraft.
    start_known : bool
        Whether the path over ground begins where the scenario says.
    basis : str
        Where the disturbance bounds of an aircraft come from; empty for other plants.
    law : str
        Name of the exact law in the scenario, if the gains belong to one.
    conformance : Conformance or None
        Where the boxes of an aircraft are from; None where that is not known, as of a proof file.
    """

    scenario: Scenario
    gains: PIGains
    plant: str
    start: float
    d_low: FloatArray
    d_high: FloatArray
    reference: FloatArray
    limits: Limits
    lags: tuple[InnerLag, ...] = ()
    roll: FloatArray | None = None
    counted: FloatArray | None = None
    start_known: bool = True
    basis: str = ""
    law: str = "exact"
    conformance: Conformance | None = None

    def __post_init__(self) -> None:
        _check_known(self.scenario, self.plant)
        if not (math.isfinite(self.start) and 0.0 <= self.start < math.pi / 4):
            raise InputError(
                f"`start` must lie in 0..45 deg, got {math.degrees(self.start):g} deg."
            )
        if self.scenario.wind is not None and self.start > 0.0:
            raise InputError(
                f"`start` must be 0 in wind, got {math.degrees(self.start):g} deg: the path over "
                "ground begins elsewhere than that through the air."
            )
        k = len(self.t)
        for name, columns in (("d_low", 2), ("d_high", 2), ("reference", 6)):
            given = read_only_matrix(name, getattr(self, name))
            if given.shape != (k, columns):
                raise InputError(f"`{name}` must have shape {(k, columns)}, got {given.shape}.")
            object.__setattr__(self, name, given)
        if not (self.d_low <= self.d_high).all():
            raise InputError("`d_low` must not be above `d_high`.")
        seen = sees_roll_flown(self.scenario, self.plant, self.reference)
        if (self.roll is not None) != seen:
            raise InputError("`roll` must be given just where a feed-forward sees the roll flown.")
        for name in ("roll", "counted"):
            if (given := getattr(self, name)) is None:
                continue
            pairs = read_only_matrix(name, given)
            if pairs.shape != (k, 4) or not (pairs[:, ::2] <= pairs[:, 1::2]).all():
                raise InputError(
                    f"`{name}` must be lower and upper bounds, twice, at every sample."
                )
            object.__setattr__(self, name, pairs)
        condition = self.scenario.condition
        ends = [replace(condition, gamma=condition.gamma + x) for x in (-self.start, self.start)]
        for name, lower, upper, starts in zip(
            ("phi_deg", "n_z"),
            self.limits.lower,
            self.limits.upper,
            ([condition.phi], [condition.n_z_start, *(one.n_z_start for one in ends)]),
            strict=True,
        ):
            if not lower <= min(starts) <= max(starts) <= upper:
                raise InputError(
                    f"`{name}` of [flight] must start inside its range, got {min(starts):g} to "
                    f"{max(starts):g} outside {lower:g}..{upper:g} (rad, 1)."
                )

    @property
    def model(self) -> str:
        """The plant enclosed, in words."""
        kind = MODELS[self.scenario.plant_table(self.plant).kind]
        return f"{kind}; {self.basis}" if self.basis else kind

    @property
    def t(self) -> FloatArray:
        """Times of the samples, s."""
        return sample_times(self.scenario)

    @property
    def path_at_start(self) -> tuple[float, float]:
        """Course and path angle over ground; [flight] has those through the air, rad."""
        condition, wind = self.scenario.condition, self.scenario.wind
        if wind is None:
            return condition.chi, condition.gamma
        north, east, down = velocity_along(condition.V_a, condition.chi, condition.gamma)
        w_north, w_east, w_down = wind.profile().at(condition.h)
        chi, gamma = course_of((north + w_north, east + w_east, down + w_down))
        return condition.chi + math.remainder(chi - condition.chi, math.tau), gamma

    def controller(self) -> MimoPI | ExactLaw:
        """A controller in its initial state."""
        return controller_of(self.scenario, f"{self.law}:", self.gains, self.limits)

    @cached_property
    def loop(self) -> SampledLoop:
        """The loop that flies, with the numbers of its controller and its plant."""
        controller, flight, condition = (
            self.controller(),
            self.scenario.flight,
            self.scenario.condition,
        )
        chi, gamma = self.path_at_start
        planned, inversion = self.reference[:, 2:4], None
        if isinstance(controller, ExactLaw):
            law = controller.law
            channels = tuple(map(ChannelLaw, law.K_P, law.K_I_dt, *zip(*law.bounds, strict=True)))
            speed = flight.V_a_mps * law.per_g
            inversion = Inversion(self.reference[:, 4:], speed, law.lift_floor, law.brake)
            feed_forward, planned = False, np.zeros_like(planned)
        else:
            channels = controller.law.channels
            feed_forward = controller.feed_forward and not planned.any()
        return SampledLoop(
            channels=channels,
            conditional=controller.law.conditional,
            feed_forward=feed_forward,
            planned=planned,
            dt=controller.dt,
            g_over_v=flight.g_mps2 / flight.V_a_mps,
            chi_ref=self.reference[:, 0],
            gamma_ref=self.reference[:, 1],
            d_low=self.d_low,
            d_high=self.d_high,
            start=(chi, gamma, condition.phi, condition.n_z),
            exact=self.scenario.plant_table(self.plant).kind != "kinematic",
            lags=tuple(SampledLag.of(lag, controller.dt) for lag in self.lags),
            inversion=inversion,
            roll=self.roll,
        )


def tube_problem(
    scenario: Scenario,
    gains: PIGains,
    *,
    plant: str | None = None,
    start: float = 0.0,
    disturbance: float | None = None,
    conformance: Conformance | None = None,
    law: str = "exact",
) -> TubeProblem:
    """The flights of a scenario on one of its plants.

    Parameters
    ----------
    scenario : Scenario
    gains : PIGains
    plant : str, optional
        Label of a plant; by default the first aircraft with a conformance, else the first plant
        that is none.
    start : float, rad
        Course and flight-path angle start within this of the scenario's.
    disturbance : float, rad/s, optional
        The disturbance of each rate is within this of zero, in any shape; by default within the
        amplitudes of the scenario's [disturbance], or zero.
    conformance : Conformance, optional
        Of an aircraft: its model flies, under every disturbance in its boxes.
    law : str
        Name of the exact law in the scenario, if the gains belong to one.

    Raises
    ------
    InputError
        If a value cannot be used, or the tube does not know the law.
    """
    kinds = ("jsbsim",) if conformance else tuple(kind for kind in MODELS if kind != "jsbsim")
    table = _chosen(scenario, plant, kinds)
    _check_known(scenario, table.label)
    t = sample_times(scenario)
    reference = scenario.followed()
    followed = np.zeros((len(t), 6))
    followed[:, :2] = np.stack(reference.sampled(t), axis=1)
    followed[:, 4:] = np.stack(reference.rates(t), axis=1)
    if isinstance(reference, FeasibleReference) and scenario.controller.feed_forward:
        followed[:, 2:4] = reference.commands(t)
    limits, lags, basis = scenario.limits.limits(), table.lags() or (), ""
    roll, counted, start_known = None, None, True
    if table.aircraft is None:
        d_high = _within(scenario, disturbance, len(t))
        d_low = -d_high
    else:
        if acts_on_rates(gains):
            raise InputError(
                "`gains` must be of the paper's law for the tube of an aircraft: the exact law "
                "sees the airspeed, for which no box is known."
            )
        if conformance is None:
            raise InputError(
                f"`conformance` must be given for the tube of an aircraft, got {table.label} "
                "without: `flighttune conform` makes one."
            )
        if disturbance is not None:
            raise InputError("`disturbance` must not be given with a conformance: its boxes are.")
        conformance.check(scenario, table, gains, start)
        if not conformance.holds:
            raise InputError(f"conformance: must hold, got: {conformance.sentence}.")
        limits = limits.within(load_aircraft(table.aircraft).limits.limits())
        lags, basis = conformance.model.lags, conformance.sentence
        boxes = conformance.boxes.over(t, followed[:, 0], followed[:, 1])
        low, high = (np.concatenate([one, one[-1:]]) for one in boxes)
        d_low, d_high = low[:, :2], high[:, :2]
        if sees_roll_flown(scenario, table.label, followed):
            roll = np.stack([low[:, 2], high[:, 2], low[:, 3], high[:, 3]], axis=1)
        counted = np.stack([low[:, 4], high[:, 4], low[:, 5], high[:, 5]], axis=1)
        start_known = scenario.wind is not None or not conformance.distribution.windy
    return TubeProblem(
        scenario=scenario,
        gains=gains,
        plant=table.label,
        start=start,
        d_low=d_low,
        d_high=d_high,
        reference=followed,
        limits=limits,
        lags=lags,
        roll=roll,
        counted=counted,
        start_known=start_known,
        basis=basis,
        law=law,
        conformance=None if table.aircraft is None else conformance,
    )


def sees_roll_flown(scenario: Scenario, plant: str, reference: FloatArray) -> bool:
    """Whether a feed-forward sees the roll of an aircraft, which is not all that of its model."""
    aircraft = scenario.plant_table(plant).aircraft is not None
    return aircraft and scenario.controller.feed_forward and not reference[:, 2:4].any()


def sample_times(scenario: Scenario) -> FloatArray:
    """Times of the samples of the controller, s."""
    dt = 1.0 / scenario.controller.rate_hz
    return np.arange(round(scenario.flight.duration_s / dt) + 1, dtype=np.float64) * dt


def _chosen(scenario: Scenario, plant: str | None, kinds: tuple[str, ...]) -> PlantTable:
    """The plant of a label; without one the first of one of `kinds`."""
    if plant is not None:
        return scenario.plant_table(plant)
    for table in scenario.plant:
        if table.kind in kinds:
            return table
    known = ", ".join(table.label for table in scenario.plant)
    raise InputError(f"`plant` must be of kind {' or '.join(kinds)} for this tube, got {known}.")


def _within(scenario: Scenario, disturbance: float | None, samples: int) -> FloatArray:
    """Upper bounds of a disturbance that is within as much of zero, shape (samples, 2)."""
    table = scenario.disturbance  # a sinusoid, its sign, or switched: never beyond its amplitude
    flown = (0.0, 0.0) if table is None else (table.chi_amplitude, table.gamma_amplitude)
    if disturbance is not None and not (math.isfinite(disturbance) and disturbance > 0.0):
        raise InputError(f"`disturbance` must be positive, got {disturbance:g} rad/s.")
    if disturbance is not None and disturbance < max(map(abs, flown)):
        raise InputError(
            f"`disturbance` must be at least that of the scenario's [disturbance], "
            f"{max(map(abs, flown)):g} rad/s, got {disturbance:g} rad/s."
        )
    return np.tile(np.abs(flown) if disturbance is None else np.full(2, disturbance), (samples, 1))


def _check_known(scenario: Scenario, plant: str) -> None:
    """Refuse what no set is known for."""
    # Wind and turbulence of an aircraft are in its residual rates, whose boxes were counted there.
    moving = scenario.plant_table(plant).aircraft is None and scenario.windy
    swings = scenario.disturbance is not None and scenario.disturbance.as_wind
    for key, given in (("sensors", scenario.sensors), ("wind", moving or swings)):
        if given:
            raise InputError(f"`{key}` must not be in the scenario of a tube: it is not enclosed.")
    if scenario.controller.anti_windup == "back_calculation":
        raise InputError(
            "`anti_windup` of [controller] must be conditional or none for a tube, got "
            "back_calculation."
        )
