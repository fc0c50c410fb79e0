"""The flights that a tube encloses: scenario, gains, starts and disturbances.

The disturbances of an aircraft lie in boxes of its residual signals, from a count.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from flighttune.base.arrays import FloatArray, check_positive
from flighttune.base.errors import InputError
from flighttune.claims.counted import SAME_GAINS
from flighttune.claims.distribution import ROUNDING_DEG, STARTS, flown_values
from flighttune.claims.residual import Residual
from flighttune.claims.tubes.dynamics import SampledLag
from flighttune.claims.tubes.sample import PLANNED, RATES, REFERENCE, SampledLoop
from flighttune.control.controller import LawSetup, SelfLimiting
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.control.law import Law, SampledController
from flighttune.control.limits import Limits
from flighttune.flight.conditions import lead_on, reference_of
from flighttune.flight.entry import Entry
from flighttune.flight.loop.run import Bounds, given_way
from flighttune.flight.models import law_setup
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps.residual import ConformantModel, residuals_of
from flighttune.routes import feasible, segments
from flighttune.vehicles.plant_keys import PlantTable
from flighttune.vehicles.plants import base, weather
from flighttune.vehicles.plants.base import FlightCondition

# Quantities that a tube bounds: errors in rad, commands in rad and 1
QUANTITIES = ("chi_err", "gamma_err", "phi_cmd", "n_z_cmd")

# Meaning of the boxes of a tube.
OF_RESIDUALS = "`boxes` must be of residual signals (`ft.residual`)"


@dataclass(frozen=True, kw_only=True, eq=False)
class AircraftBoxes:
    """Counted boxes of an aircraft's flights, at the k samples of a flight."""

    # Bounds on `RESIDUALS`: on the residual rates of course and flight-path angle, of any shape,
    # from each sample to the next; on the seen roll minus the lag's roll, and its change to the
    # next sample.
    bounds: Bounds
    lags: tuple[InnerLag, ...]  # lags of roll and load factor in the model of the residuals
    band_sha256: str  # hash of the whole content of the band's file


@dataclass(frozen=True, kw_only=True, eq=False)
class TubeProblem:
    """All flights of one gain set on one plant of a scenario."""

    entry: Entry
    start: float  # rad: half-width of the starts in course and flight-path angle
    disturbance: float | None  # rad/s: see `tube_problem`
    band: Residual | None  # count of an aircraft's residual signals: source of its boxes
    # shape (k, 6), rad, rad, rad, 1, rad/s, rad/s: reference course and flight-path angle, planned
    # commands (or zeros), and rates; see `reference_samples`
    reference: FloatArray
    # Boxes from the file of a tube: compared with the band's boxes, or trusted without a band
    stored: AircraftBoxes | None = None

    def __post_init__(self) -> None:
        self._check_law()
        self._check_start()
        if (self.boxes is None) != (self.table.aircraft is None):
            raise InputError(
                f"`boxes` must be given for the tube of an aircraft, got {self.plant} without: "
                "`ft.residual` counts them."
                if self.boxes is None
                else f"`boxes` must be of an aircraft, got {self.plant}."
            )
        if self.disturbance is None:
            return
        if self.boxes is not None:
            raise InputError("`disturbance` must not be given with boxes, which bound it.")
        check_positive("rad/s", disturbance=self.disturbance)
        if self.disturbance < (swing := max(self._swing)):
            raise InputError(
                "`disturbance` must be at least that of the scenario's [disturbance], "
                f"{swing:g} rad/s, got {self.disturbance:g} rad/s."
            )

    def _check_law(self) -> None:
        """Refuse a loop that the sets cannot follow."""
        scenario, aircraft = self.scenario, self.table.aircraft is not None
        # Wind and turbulence of an aircraft are in its residual rates, whose boxes were counted in
        # them.
        moving = scenario.windy and not aircraft
        swings = scenario.disturbance is not None and scenario.disturbance.as_wind
        sensors = scenario.sensors_on(self.table.label)
        inside = {"sensors": sensors, "navigation": scenario.navigation, "wind": moving or swings}
        for key, value in inside.items():
            if value:
                raise InputError(
                    f"`{key}` must not be in the scenario of a tube: it is not enclosed."
                )
        if scenario.controller.anti_windup == "back_calculation":
            raise InputError(
                "`anti_windup` of [controller] must be conditional or none for a tube, got "
                "back_calculation."
            )
        # For a point mass too, `sampled` refuses unknown laws.
        inverts = self.sampled.inverts is not None
        if not aircraft:
            return
        # All of these follow the measured airspeed, which varies on an aircraft without a counted
        # box.
        if scenario.rolls_in:
            raise InputError(
                "`roll_in_s` must be absent from the tube of an aircraft: roll is planned for the "
                "airspeed measured there, of which no box was counted. That of a point mass behind "
                "lags encloses it."
            )
        if inverts:
            raise InputError(
                f"`gains` must be of the paper's law for the tube of an aircraft: the "
                f"{self.law.name} law sees the airspeed, for which no box is known."
            )
        if scenario.controller.schedule:
            raise InputError(
                "`schedule` of [controller] must be false for the tube of an aircraft, got true: "
                "the gains then follow the airspeed, for which no box is known."
            )

    def _check_start(self) -> None:
        if not (math.isfinite(self.start) and 0.0 <= self.start < math.pi / 4):
            raise InputError(
                f"`start` must lie in 0..45 deg, got {math.degrees(self.start):g} deg."
            )
        if self.scenario.wind is not None and self.start > 0.0:
            raise InputError(
                f"`start` must be 0 in wind, got {math.degrees(self.start):g} deg: the path over "
                "ground begins elsewhere than that through the air."
            )
        condition, limits = self.entry.condition, self.limits
        ends = [replace(condition, gamma=condition.gamma + x) for x in (-self.start, self.start)]
        n_z = [end.n_z_start for end in (condition, *ends)]
        for i, (name, starts) in enumerate((("phi_deg", [condition.phi]), ("n_z", n_z))):
            lower, upper = limits.lower[i], limits.upper[i]
            if not lower <= min(starts) <= max(starts) <= upper:
                raise InputError(
                    f"`{name}` of [flight] must start inside its range, got {min(starts):g} to "
                    f"{max(starts):g} outside {lower:g}..{upper:g} (rad, 1)."
                )

    @property
    def scenario(self) -> Scenario:
        """The flown scenario."""
        return self.entry.scenario

    @property
    def gains(self) -> PIGains:
        """The flown gains."""
        return self.entry.found_gains

    @property
    def law(self) -> Law:
        """The law that flies the gains."""
        return self.entry.law

    @property
    def table(self) -> PlantTable:
        """The plant in the scenario."""
        return self.entry.plant

    @property
    def plant(self) -> str:
        """Label of the plant."""
        return self.table.label

    @property
    def model(self) -> str:
        """The enclosed plant and its counted boxes, in words."""
        kind = self.table.family.enclosed or ""
        return kind if self.band is None else f"{kind}; {self.band.sentence}"

    @cached_property
    def boxes(self) -> AircraftBoxes | None:
        """Counted or stored boxes of an aircraft; None for another plant."""
        band, stored = self.band, self.stored
        if band is None:
            return stored
        if not isinstance(band, Residual):
            raise InputError(f"{OF_RESIDUALS}, got a {type(band).__name__}.")
        if not band.claims:
            raise InputError(f"{OF_RESIDUALS}, got no claim.")
        lags, sha256 = band.model.lags, band.sha256
        boxes = AircraftBoxes(bounds=band.bounds(self.t), lags=lags, band_sha256=sha256)
        self._check_covered(band)
        if stored is not None:
            same = {
                "boxes": np.array_equal(boxes.bounds.pairs, stored.bounds.pairs),
                "lags": boxes.lags == stored.lags,
                "band_sha256": boxes.band_sha256 == stored.band_sha256,
            }
            for name in same:
                if not same[name]:
                    raise InputError(f"`{name}` must be that of the band, got another.")
        return boxes

    def _check_covered(self, band: Residual) -> None:
        """Refuse a problem that no counted flight of the band can belong to."""
        scenario, plant, counted = self.scenario, self.table, band.flights
        aircraft = counted.scenario.plant_table(counted.plant).aircraft
        if plant.aircraft != aircraft or counted.changed:
            raise InputError(
                f"boxes: `aircraft` must be {aircraft} with the files it was flown with, got "
                f"{plant.aircraft or plant.kind}."
            )
        for name in ("K_P", "K_I"):
            theirs, mine = getattr(counted.gains, name), getattr(self.gains, name)
            if not np.allclose(theirs, mine, rtol=SAME_GAINS, atol=0.0):
                raise InputError(
                    f"boxes: `{name}` must be that of {counted.gains_name}, {theirs.tolist()}, got "
                    f"{mine.tolist()}."
                )
        if why := counted.distribution.difference(scenario, plant):
            raise InputError(f"boxes: must be of the flights of the scenario: {why}.")
        if self.start and counted.distribution.reference_moves:
            raise InputError(
                "boxes: must be of flights that begin beside the reference of the scenario, got "
                "flights whose references begin at their own starts: count them again."
            )
        if (V_a := scenario.flight.V_a_mps) != band.model.V_a:
            raise InputError(
                f"boxes: `flight.V_a_mps` must be that of their model, {band.model.V_a:g} m/s, got "
                f"{V_a:g} m/s."
            )
        flight, start_deg = flown_values(scenario, plant), math.degrees(self.start)
        for key in STARTS if self.start else ():
            low, *_, high = counted.distribution.dispersed.get(key, 2 * [flight[key]])
            most = min(flight[key] - low, high - flight[key])
            if start_deg > most + ROUNDING_DEG:
                raise InputError(
                    f"boxes: `start` must be at most {most:.4g} deg from `{key}`, as in the "
                    f"flights counted, got {start_deg:.4g} deg."
                )
        if counted.distribution.windy and scenario.wind is None:
            raise InputError(
                "`wind` must be stated, as the flights counted had wind, got none: the path over "
                "ground begins elsewhere than that through the air."
            )

    @property
    def aircraft_checked(self) -> bool | None:
        """Whether the boxes were rebuilt from a band; None for a plant without boxes."""
        return None if self.boxes is None else self.band is not None

    @property
    def _swing(self) -> tuple[float, float]:
        """Amplitudes of the scenario's [disturbance], rad/s."""
        table = self.scenario.disturbance
        return (
            (0.0, 0.0) if table is None else (abs(table.chi_amplitude), abs(table.gamma_amplitude))
        )

    @property
    def disturbances(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds on the disturbances of the two rates, shape (k, 2), rad/s."""
        if self.boxes is not None:
            return self.boxes.bounds.low[:, :2], self.boxes.bounds.high[:, :2]
        within = self._swing if self.disturbance is None else (self.disturbance, self.disturbance)
        high = np.tile(within, (len(self.t), 1))
        return -high, high

    @cached_property
    def conformant(self) -> ConformantModel | None:
        """The model of an aircraft's residual signals; None for another plant."""
        flight, boxes = self.scenario.flight, self.boxes
        if boxes is None:
            return None
        phi, n_z = boxes.lags
        return ConformantModel(V_a=flight.V_a_mps, g=flight.g_mps2, lags=(phi, n_z))

    def outside_boxes(self, signals: pd.DataFrame, start: FlightCondition) -> str:
        """Where the residual signals of a flight leave their boxes; empty if they do not.

        The tube of an aircraft is of flights inside its boxes alone.
        """
        model, boxes = self.conformant, self.boxes
        if model is None or boxes is None:
            return ""
        if len(signals) < len(self.t):
            return f"it ends at {signals.index[-1]:.2f} s"
        if given_way(signals).any():
            return "speed has priority in it"
        # Roll is part of the model only if the controller sees it.
        used = self.loop.boxes.shape[1]
        values, bounds = residuals_of(model, signals, start)[:, :used], boxes.bounds.pairs[:-1]
        outside = (values < bounds[:, :used, 0]) | (values > bounds[:, :used, 1])
        if not outside.any():
            return ""
        sample, signal = np.argwhere(outside)[0].tolist()
        return f"its {boxes.bounds.names[signal]} leaves its box at {self.t[sample]:.2f} s"

    @property
    def limits(self) -> Limits:
        """Limits of the commands: of the scenario and, for an aircraft, of its folder."""
        return self.entry.limits

    @property
    def lags(self) -> tuple[InnerLag, ...]:
        """Lags of roll and load factor; empty for a plant without lags."""
        return self.boxes.lags if self.boxes else self.table.lags() or ()

    @property
    def t(self) -> FloatArray:
        """Times of the samples, s."""
        return sample_times(self.scenario)

    @property
    def path_at_start(self) -> tuple[float, float]:
        """Course and path angle at the start over ground, rad; the condition has those in air."""
        condition, wind = self.entry.condition, self.scenario.wind
        if wind is None:
            return condition.chi, condition.gamma
        north, east, down = weather.velocity_along(condition.V_a, condition.chi, condition.gamma)
        w_north, w_east, w_down = wind.profile().at(condition.h)
        chi, gamma = weather.course_of((north + w_north, east + w_east, down + w_down))
        return condition.chi + math.remainder(chi - condition.chi, math.tau), gamma

    def controller(self) -> SelfLimiting:
        """A controller in its initial state."""
        return self.law.controller(self._setup)

    @property
    def _setup(self) -> LawSetup:
        """The setup of the law on this plant."""
        return law_setup(self.scenario, self.gains, self.limits, at_once=not self.lags)

    @cached_property
    def sampled(self) -> SampledController:
        """The law as the sets follow it; InputError for an unknown law or unknown gains."""
        if self.law.inputs != self.gains.inputs:
            raise InputError(
                f"`law` must take gains on {' and '.join(self.gains.inputs)}, got "
                f"{self.law.name}, which acts on {' and '.join(self.law.inputs)}."
            )
        controller = self.law.sampled(self._setup)
        if controller is None:
            raise self.law.refusal("sampled", "enclosed")
        return controller

    @cached_property
    def loop(self) -> SampledLoop:
        """The flown loop, with the numbers of its controller and plant."""
        flight, controller = self.scenario.flight, self.sampled
        condition = self.entry.condition
        reference = self.reference.copy()
        # A law that inverts follows the rates of the reference, and the paper's law the planned
        # commands.
        reference[:, PLANNED if controller.inverts else RATES] = 0.0
        lift = np.zeros(len(reference))
        if controller.feed_forward and self.scenario.rolls_in:
            lift, reference[:, PLANNED.stop - 1] = reference[:, PLANNED.stop - 1].copy(), 0.0
        elif controller.feed_forward and not reference[:, PLANNED].any():
            lift = np.cos(reference[:, REFERENCE.stop - 1])
        feed_forward = bool(lift.any())
        boxes = np.stack(self.disturbances, axis=2)
        if self.boxes is not None and feed_forward:
            boxes = self.boxes.bounds.pairs
        dt = 1.0 / self.scenario.controller.rate_hz
        return SampledLoop(
            law=controller._replace(feed_forward=feed_forward),
            reference=np.column_stack([reference, lift]),
            boxes=boxes,
            dt=dt,
            V_a=flight.V_a_mps,
            g=flight.g_mps2,
            start=(*self.path_at_start, condition.phi, condition.n_z),
            exact=self.table.family.turn == "exact",
            lags=tuple(SampledLag.of(lag, dt) for lag in self.lags),
        )


def tube_problem(
    entry: Entry,
    *,
    start: float = 0.0,
    disturbance: float | None = None,
    band: Residual | None = None,
) -> TubeProblem:
    """The flights of an entry, for a plant that a tube can enclose.

    Course and flight-path angle start within `start` (rad) of the scenario's values. The
    disturbance of each rate is within `disturbance` (rad/s) of zero, in any shape. By default it is
    within the amplitudes of the scenario's [disturbance], or zero; for a plant identified from
    logs, within their largest residual rate. With the `band` of an aircraft's residual signals, its
    model flies under every disturbance in the boxes.
    """
    if disturbance is None:
        disturbance = residual_of_logs(entry.plant)
    return TubeProblem(
        entry=entry,
        start=start,
        disturbance=disturbance,
        band=band,
        reference=reference_samples(entry.scenario, entry.plant),
    )


def enclosed_plant(scenario: Scenario, plant: str | None, *, aircraft: bool) -> PlantTable:
    """The plant with this label, or the first aircraft or other plant that a tube can enclose."""
    scenario.check_over_time("a tube")
    kinds = [
        name
        for name, kind in base.PLANT_KINDS.items()
        if kind.enclosed is not None and ("aircraft" in kind.keys) == aircraft
    ]
    tables = scenario.plant if plant is None else [scenario.plant_table(plant)]
    enclosed = [x for x in tables if x.family.enclosed and (plant or x.kind in kinds)]
    if not enclosed:
        labels = ", ".join(table.label for table in tables)
        raise InputError(
            f"`plant` must be of kind {' or '.join(kinds)} for this tube, got {labels}."
        )
    return enclosed[0]


def residual_of_logs(table: PlantTable) -> float | None:
    """Largest residual rate (rad/s) of the logs from which a plant was identified, if any."""
    evidence = table.identified_model.log if table.identified is not None else None
    if evidence is None or evidence.residual_rad_s is None:
        return None
    return max(evidence.residual_rad_s.values())


def reference_samples(scenario: Scenario, plant: PlantTable) -> FloatArray:
    """Reference of a scenario at its samples, as `TubeProblem.reference`."""
    t, reference = sample_times(scenario), reference_of(scenario)
    followed = np.zeros((len(t), 6))
    followed[:, REFERENCE] = np.stack(reference.sampled(t), axis=1)
    if scenario.rolls_in:
        assert isinstance(reference, segments.Reference)  # planned rates of ramps
        rates = np.stack(reference.rates(t, lead_on(scenario, plant)))
        turn, bend = rates * scenario.flight.V_a_mps / reference.g
        if scenario.controller.feed_forward:
            # The vertical lift in weights replaces the planned load factor.
            lift = np.cos(followed[:, REFERENCE][:, 1]) + bend
            followed[:, PLANNED] = np.column_stack([np.arctan(turn), lift])
    else:
        rates = np.stack(reference.rates(t))
    if isinstance(reference, feasible.FeasibleReference) and scenario.controller.feed_forward:
        followed[:, PLANNED] = reference.commands(t)
    followed[:, RATES] = rates.T
    followed.flags.writeable = False
    return followed


def sample_times(scenario: Scenario) -> FloatArray:
    """Times of the samples of the controller, s."""
    return np.arange(sample_count(scenario), dtype=float) * (1.0 / scenario.controller.rate_hz)


def sample_count(scenario: Scenario) -> int:
    """Number of samples of the controller, including the first and the last."""
    return round(scenario.flight.duration_s / (1.0 / scenario.controller.rate_hz)) + 1
