"""The flights that a tube encloses: scenario, gains, starts and disturbances."""

import hashlib
import json
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.arrays import FloatArray
from flighttune.conformance import Conformance
from flighttune.conformance.file import conformance_tables
from flighttune.conformance.residual import COUNTED
from flighttune.control.controller import Controller
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.control.law import Law, SampledController
from flighttune.control.limits import Limits
from flighttune.errors import InputError
from flighttune.flight.fly import law_setup
from flighttune.guarantee.bounds import Bounds
from flighttune.plants.base import PLANT_KINDS
from flighttune.plants.weather import course_of, velocity_along
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.simulate.feasible import FeasibleReference
from flighttune.tube.lag import SampledLag
from flighttune.tube.sample import Inversion, SampledLoop


@dataclass(frozen=True, kw_only=True, eq=False)
class AircraftBoxes:
    """Boxes counted for an aircraft's flights, at the k samples of one flight."""

    # Bounds on `COUNTED`: from each sample to the next on the residual rates of course and
    # flight-path angle, of any shape; on the roll seen minus that behind the lag, and its change
    # to the next sample; on the errors.
    bounds: Bounds
    lags: tuple[InnerLag, ...]  # of roll and load factor, in the model whose rates were subtracted
    start_known: bool  # whether the path over ground begins where the scenario says
    conformance_sha256: str  # hash of the conformance that the boxes come from
    # Source of the boxes; None if they come from the file of a tube and were not compared
    conformance: Conformance | None = None

    @classmethod
    def of(
        cls,
        conformance: Conformance,
        scenario: Scenario,
        plant: PlantTable,
        gains: PIGains,
        start: float,
        reference: FloatArray,
    ) -> "AircraftBoxes":
        """The boxes of a conformance for one scenario.

        Raises InputError if the conformance does not cover these flights, or claims nothing.
        """
        conformance.check(scenario, plant, gains, start)
        if not conformance.holds:
            raise InputError(f"conformance: must hold, got: {conformance.sentence}.")
        t = sample_times(scenario)
        boxes = conformance.boxes.over(t, reference[:, 0], reference[:, 1])
        # The boxes of the last sample are never used; the arrays are as long as the others.
        low, high = (np.concatenate([ends, ends[-1:]]) for ends in (boxes.low, boxes.high))
        return cls(
            bounds=Bounds(t, low, high, COUNTED),
            lags=conformance.model.lags,
            start_known=scenario.wind is not None or not conformance.distribution.windy,
            conformance_sha256=conformance_sha256(conformance),
            conformance=conformance,
        )

    def difference(self, other: "AircraftBoxes") -> str | None:
        """Name of the first part that differs, `conformance` aside; None if none does."""
        if not np.array_equal(self.bounds.pairs, other.bounds.pairs):
            return "boxes"
        names = ("lags", "start_known", "conformance_sha256")
        return next((x for x in names if getattr(self, x) != getattr(other, x)), None)


def conformance_sha256(conformance: Conformance) -> str:
    """Hash of all values of a conformance, the same however its file is laid out."""
    values = json.dumps(conformance_tables(conformance), sort_keys=True)
    return hashlib.sha256(values.encode()).hexdigest()


@dataclass(frozen=True, kw_only=True, eq=False)
class TubeProblem:
    """All flights of one gain set on one plant of a scenario."""

    scenario: Scenario
    gains: PIGains
    plant: str  # label of the plant
    start: float  # rad: course and flight-path angle start within this of the scenario's
    disturbance: float | None  # rad/s: see `tube_problem`
    boxes: AircraftBoxes | None  # None unless the plant is an aircraft
    law: Law  # law that flies the gains
    # shape (k, 6), rad, rad, rad, 1, rad/s, rad/s: course and flight-path angle to follow, the
    # commands planned for them (zeros where none are), and their rates, as `reference_of` makes
    # them.
    reference: FloatArray

    def __post_init__(self) -> None:
        _check_enclosed(self.scenario, self.table, self.gains, self.law)
        if not (math.isfinite(self.start) and 0.0 <= self.start < math.pi / 4):
            raise InputError(
                f"`start` must lie in 0..45 deg, got {math.degrees(self.start):g} deg."
            )
        if self.scenario.wind is not None and self.start > 0.0:
            raise InputError(
                f"`start` must be 0 in wind, got {math.degrees(self.start):g} deg: the path over "
                "ground begins elsewhere than that through the air."
            )
        if (self.boxes is None) != (self.table.aircraft is None):
            raise InputError(
                f"`conformance` must be given for the tube of an aircraft, got {self.plant} "
                "without: `flighttune conform` makes one."
                if self.boxes is None
                else f"`boxes` must be of an aircraft, got {self.plant}."
            )
        if self.boxes is None:
            _check_disturbance(self.scenario, self.disturbance)
        else:
            if self.disturbance is not None:
                raise InputError(
                    "`disturbance` must not be given with a conformance: its boxes are."
                )
        condition, limits = self.scenario.condition, self.limits
        ends = [replace(condition, gamma=condition.gamma + x) for x in (-self.start, self.start)]
        for name, lower, upper, starts in zip(
            ("phi_deg", "n_z"),
            limits.lower,
            limits.upper,
            ([condition.phi], [condition.n_z_start, *(end.n_z_start for end in ends)]),
            strict=True,
        ):
            if not lower <= min(starts) <= max(starts) <= upper:
                raise InputError(
                    f"`{name}` of [flight] must start inside its range, got {min(starts):g} to "
                    f"{max(starts):g} outside {lower:g}..{upper:g} (rad, 1)."
                )

    @property
    def table(self) -> PlantTable:
        """The plant in the scenario."""
        return self.scenario.plant_table(self.plant)

    @property
    def model(self) -> str:
        """The plant enclosed, in words, and what was counted for it."""
        kind = self.table.family.enclosed or ""
        return kind if self.conformance is None else f"{kind}; {self.conformance.sentence}"

    @property
    def conformance(self) -> Conformance | None:
        """Conformance from which the boxes of an aircraft were rebuilt."""
        return None if self.boxes is None else self.boxes.conformance

    @property
    def aircraft_checked(self) -> bool | None:
        """Whether the boxes were rebuilt from a conformance; None for a plant without boxes."""
        return None if self.boxes is None else self.conformance is not None

    @property
    def disturbances(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds on the disturbances of the two rates, shape (k, 2), rad/s."""
        if self.boxes is not None:
            return self.boxes.bounds.low[:, :2], self.boxes.bounds.high[:, :2]
        swing = self.scenario.disturbance
        flown = (0.0, 0.0) if swing is None else (swing.chi_amplitude, swing.gamma_amplitude)
        within = np.abs(flown) if self.disturbance is None else np.full(2, self.disturbance)
        high = np.tile(within, (len(self.t), 1))
        return -high, high

    @property
    def roll(self) -> FloatArray | None:
        """See `SampledLoop.roll`; None unless the feed-forward of an aircraft sees the roll."""
        sees_roll = self.scenario.controller.feed_forward and not self.reference[:, 2:4].any()
        if self.boxes is None or not sees_roll:
            return None
        return self.boxes.bounds.pairs[:, 2:4].reshape(-1, 4)

    @property
    def limits(self) -> Limits:
        """Limits of the commands: of the scenario and, for an aircraft, of its folder."""
        limits, aircraft = self.scenario.limits.limits(), self.table.aircraft
        return (
            limits if aircraft is None else limits.within(load_aircraft(aircraft).limits.limits())
        )

    @property
    def lags(self) -> tuple[InnerLag, ...]:
        """Lags of roll and load factor; empty where the plant has none."""
        return self.boxes.lags if self.boxes else self.table.lags() or ()

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

    def controller(self) -> Controller:
        """A controller in its initial state."""
        return self.law.controller(law_setup(self.scenario, self.gains, self.limits))

    @cached_property
    def loop(self) -> SampledLoop:
        """The loop that flies, with the numbers of its controller and its plant."""
        flight, condition = self.scenario.flight, self.scenario.condition
        controller = sampled(self.scenario, self.gains, self.limits, self.law)
        dt = 1.0 / self.scenario.controller.rate_hz
        chi, gamma = self.path_at_start
        d_low, d_high = self.disturbances
        planned, inversion = self.reference[:, 2:4], None
        if (law := controller.inverts) is not None:
            speed = flight.V_a_mps * law.per_g
            inversion = Inversion(self.reference[:, 4:], speed, law.lift_floor, law.brake)
            planned = np.zeros_like(planned)
        return SampledLoop(
            channels=controller.channels,
            conditional=controller.conditional,
            feed_forward=controller.feed_forward and not planned.any(),
            planned=planned,
            dt=dt,
            g_over_v=flight.g_mps2 / flight.V_a_mps,
            chi_ref=self.reference[:, 0],
            gamma_ref=self.reference[:, 1],
            d_low=d_low,
            d_high=d_high,
            start=(chi, gamma, condition.phi, condition.n_z),
            exact=self.table.family.turn == "exact",
            lags=tuple(SampledLag.of(lag, dt) for lag in self.lags),
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
    law: Law | None = None,
) -> TubeProblem:
    """The flights of a scenario on one of its plants.

    `plant` is a label; by default the first aircraft with a conformance, else the first plant that
    is none. Course and flight-path angle start within `start` (rad) of the scenario's. The
    disturbance of each rate is within `disturbance` (rad/s) of zero, in any shape; by default
    within the amplitudes of the scenario's [disturbance], or zero. With the `conformance` of an
    aircraft its model flies, under every disturbance in its boxes. The `law` is by default the
    first of the scenario that takes the gains. Raises InputError if a value cannot be used, or the
    tube does not know the law.
    """
    table = _chosen(scenario, plant, aircraft=conformance is not None)
    law = law or scenario.law_for(gains)
    _check_enclosed(scenario, table, gains, law)
    reference, boxes = reference_of(scenario), None
    if conformance is not None:
        boxes = AircraftBoxes.of(conformance, scenario, table, gains, start, reference)
    return TubeProblem(
        scenario=scenario,
        gains=gains,
        plant=table.label,
        start=start,
        disturbance=disturbance,
        boxes=boxes,
        law=law,
        reference=reference,
    )


def reference_of(scenario: Scenario) -> FloatArray:
    """Reference of a scenario at its samples, as `TubeProblem.reference`."""
    t, reference = sample_times(scenario), scenario.followed()
    followed = np.zeros((len(t), 6))
    followed[:, :2] = np.stack(reference.sampled(t), axis=1)
    followed[:, 4:] = np.stack(reference.rates(t), axis=1)
    if isinstance(reference, FeasibleReference) and scenario.controller.feed_forward:
        followed[:, 2:4] = reference.commands(t)
    followed.flags.writeable = False
    return followed


def sample_times(scenario: Scenario) -> FloatArray:
    """Times of the samples of the controller, s."""
    dt = 1.0 / scenario.controller.rate_hz
    return np.arange(sample_count(scenario), dtype=np.float64) * dt


def sample_count(scenario: Scenario) -> int:
    """Number of the samples of the controller, the first and the last one included."""
    return round(scenario.flight.duration_s / (1.0 / scenario.controller.rate_hz)) + 1


def _chosen(scenario: Scenario, plant: str | None, *, aircraft: bool) -> PlantTable:
    """The plant of a label; without one the first that is an aircraft, or the first that is not."""
    kinds = [
        name
        for name, kind in PLANT_KINDS.items()
        if kind.enclosed is not None and ("aircraft" in kind.keys) == aircraft
    ]
    tables = scenario.plant if plant is None else [scenario.plant_table(plant)]
    for table in tables:
        if table.family.enclosed is not None and (plant or table.kind in kinds):
            return table
    labels = ", ".join(table.label for table in tables)
    raise InputError(f"`plant` must be of kind {' or '.join(kinds)} for this tube, got {labels}.")


def sampled(scenario: Scenario, gains: PIGains, limits: Limits, law: Law) -> SampledController:
    """The law as the sets follow it.

    Raises InputError if no tube knows the law, or it takes other gains.
    """
    if law.inputs != gains.inputs:
        raise InputError(
            f"`law` must take gains on {' and '.join(gains.inputs)}, got {law.name}, which acts on "
            f"{' and '.join(law.inputs)}."
        )
    controller = law.sampled(law_setup(scenario, gains, limits))
    if controller is None:
        raise law.refusal("sampled", "enclosed")
    return controller


def _check_disturbance(scenario: Scenario, disturbance: float | None) -> None:
    """Refuse a bound that is not positive, or that the scenario's own disturbance exceeds."""
    if disturbance is None:
        return
    if not (math.isfinite(disturbance) and disturbance > 0.0):
        raise InputError(f"`disturbance` must be positive, got {disturbance:g} rad/s.")
    table = scenario.disturbance
    flown = 0.0 if table is None else max(abs(table.chi_amplitude), abs(table.gamma_amplitude))
    if disturbance < flown:
        raise InputError(
            "`disturbance` must be at least that of the scenario's [disturbance], "
            f"{flown:g} rad/s, got {disturbance:g} rad/s."
        )


def _check_enclosed(scenario: Scenario, table: PlantTable, gains: PIGains, law: Law) -> None:
    """Refuse a loop that the sets cannot follow."""
    # Wind and turbulence of an aircraft are in its residual rates, whose boxes were counted there.
    moving = table.aircraft is None and scenario.windy
    swings = scenario.disturbance is not None and scenario.disturbance.as_wind
    for key, stated in (("sensors", scenario.sensors), ("wind", moving or swings)):
        if stated:
            raise InputError(f"`{key}` must not be in the scenario of a tube: it is not enclosed.")
    if scenario.controller.anti_windup == "back_calculation":
        raise InputError(
            "`anti_windup` of [controller] must be conditional or none for a tube, got "
            "back_calculation."
        )
    controller = sampled(scenario, gains, scenario.limits.limits(), law)
    # Both follow the measured airspeed, which varies on an aircraft, and no box of it was counted.
    if table.aircraft is not None and controller.inverts is not None:
        raise InputError(
            f"`gains` must be of the paper's law for the tube of an aircraft: the {law.name} law "
            "sees the airspeed, for which no box is known."
        )
    if table.aircraft is not None and scenario.controller.schedule:
        raise InputError(
            "`schedule` of [controller] must be false for the tube of an aircraft, got true: the "
            "gains then follow the airspeed, for which no box is known."
        )
