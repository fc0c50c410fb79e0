"""What a tube is asked about: a scenario's flights, from where, and under which disturbances."""

import math
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray, read_only_matrix
from flighttune.control.gains import PIGains
from flighttune.control.mimo_pi import MimoPI
from flighttune.errors import InputError
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.simulate.feasible import FeasibleReference
from flighttune.tube.lag import SampledLag
from flighttune.tube.sample import SampledLoop

MODELS = {
    "kinematic": "the paper's law",
    "point_mass": "the exact point mass",
    "point_mass_lag": "the exact point mass behind lags",
}
"""Kinds of plants whose flights can be enclosed, in words."""

ENCLOSED = tuple(MODELS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
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
        Between which the disturbance of the course and of the flight-path-angle rate is, in any
        shape, from each of the k samples to the next.
    """

    scenario: Scenario
    gains: PIGains
    plant: str
    start: float
    d_low: FloatArray
    d_high: FloatArray

    def __post_init__(self) -> None:
        _check_known(self.scenario, self.plant)
        if not (math.isfinite(self.start) and 0.0 <= self.start < math.pi / 4):
            raise InputError(
                f"`start` must lie in 0..45 deg, got {math.degrees(self.start):g} deg."
            )
        for name in ("d_low", "d_high"):
            object.__setattr__(self, name, read_only_matrix(name, getattr(self, name)))
        shape = (len(self.t), 2)
        if self.d_low.shape != shape or self.d_high.shape != shape:
            raise InputError(
                f"`d_low` and `d_high` must have shape {shape}, a row a sample, got "
                f"{self.d_low.shape} and {self.d_high.shape}."
            )
        if not (self.d_low <= self.d_high).all():
            raise InputError("`d_low` must not be above `d_high`.")
        loop = self.loop()
        for i, law in enumerate(loop.channels):
            if not law.lower <= loop.start[2 + i] <= law.upper:
                raise InputError(
                    f"`{('phi_deg', 'n_z')[i]}` of [flight] must start inside its range, "
                    f"got {loop.start[2 + i]:g} outside {law.lower:g}..{law.upper:g} (rad, 1)."
                )

    @property
    def model(self) -> str:
        """What flies, in words."""
        return MODELS[_enclosed(self.scenario, self.plant).kind]

    @property
    def t(self) -> FloatArray:
        """Times of the samples, s."""
        dt = 1.0 / self.scenario.controller.rate_hz
        return np.arange(round(self.scenario.flight.duration_s / dt) + 1, dtype=np.float64) * dt

    def controller(self) -> MimoPI:
        """A controller that has not flown."""
        settings = self.scenario.controller
        return MimoPI(
            self.gains,
            self.scenario.limits.limits(),
            dt=1.0 / settings.rate_hz,
            anti_windup=settings.anti_windup,
            feed_forward=settings.feed_forward,
        )

    def loop(self) -> SampledLoop:
        """The loop as it flies: the numbers of the controller and of the plant themselves."""
        scenario, controller = self.scenario, self.controller()
        table = _enclosed(scenario, self.plant)
        flight, condition, reference = scenario.flight, scenario.condition, scenario.followed()
        chi_ref, gamma_ref = reference.sampled(self.t)
        planned = np.zeros((len(self.t), 2))
        of_commands = isinstance(reference, FeasibleReference)
        if of_commands and controller.feed_forward:
            planned = reference.commands(self.t)
        return SampledLoop(
            channels=controller.law.channels,
            conditional=controller.law.conditional,
            feed_forward=controller.feed_forward and not of_commands,
            planned=planned,
            dt=controller.dt,
            g_over_v=flight.g_mps2 / flight.V_a_mps,
            chi_ref=chi_ref,
            gamma_ref=gamma_ref,
            d_low=self.d_low,
            d_high=self.d_high,
            start=(condition.chi, condition.gamma, condition.phi, condition.n_z_start),
            exact=table.kind != "kinematic",
            lags=tuple(SampledLag.of(lag, controller.dt) for lag in table.lags() or ()),
        )


def tube_problem(
    scenario: Scenario,
    gains: PIGains,
    *,
    plant: str | None = None,
    start: float = 0.0,
    disturbance: float | None = None,
) -> TubeProblem:
    """The flights of a scenario on one of its plants.

    Parameters
    ----------
    scenario : Scenario
    gains : PIGains
    plant : str, optional
        Label of a plant; by default the first whose flights can be enclosed.
    start : float, rad
        Course and flight-path angle start within this of the scenario's.
    disturbance : float, rad/s, optional
        The disturbance of each rate is within this of zero, in any shape; by default within the
        amplitudes of the scenario's sinusoid, or zero.

    Raises
    ------
    InputError
        If a value cannot be used, or the tube does not know the law.
    """
    table = scenario.disturbance
    flown = (0.0, 0.0) if table is None else (table.chi_amplitude, table.gamma_amplitude)
    if disturbance is not None and not (math.isfinite(disturbance) and disturbance > 0.0):
        raise InputError(f"`disturbance` must be positive, got {disturbance:g} rad/s.")
    if disturbance is not None and disturbance < max(map(abs, flown)):
        raise InputError(
            f"`disturbance` must be at least that of the scenario's [disturbance], "
            f"{max(map(abs, flown)):g} rad/s, got {disturbance:g} rad/s."
        )
    samples = round(scenario.flight.duration_s * scenario.controller.rate_hz) + 1
    within = np.abs(flown) if disturbance is None else np.full(2, disturbance)
    high = np.tile(within, (samples, 1))
    label = _enclosed(scenario, plant).label
    return TubeProblem(
        scenario=scenario, gains=gains, plant=label, start=start, d_low=-high, d_high=high
    )


def _enclosed(scenario: Scenario, plant: str | None) -> PlantTable:
    for table in scenario.plant:
        if table.label == plant or (plant is None and table.kind in ENCLOSED):
            return table
    known = ", ".join(table.label for table in scenario.plant)
    wanted = f"of kind {' or '.join(ENCLOSED)}" if plant is None else f"one of {known}"
    raise InputError(f"`plant` must be {wanted} for a tube, got {plant or known}.")


def _check_known(scenario: Scenario, plant: str) -> None:
    """Refuse what no set is known for."""
    table = _enclosed(scenario, plant)
    if table.kind not in ENCLOSED:
        raise InputError(
            f"`plant` must be of kind {' or '.join(ENCLOSED)} for a tube, got {table.label}."
        )
    swings = scenario.disturbance is not None and scenario.disturbance.as_wind
    for key, given in (("sensors", scenario.sensors), ("wind", scenario.windy or swings)):
        if given:
            raise InputError(f"`{key}` must not be in the scenario of a tube: it is not enclosed.")
    if scenario.controller.anti_windup == "back_calculation":
        raise InputError(
            "`anti_windup` of [controller] must be conditional or none for a tube, got "
            "back_calculation."
        )
