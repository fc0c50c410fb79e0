"""A scenario in SI: its start, the limits of its commands, its reference and its air."""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import wraps
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np

from flighttune.base.errors import InputError
from flighttune.base.units import DEG
from flighttune.control.controller_keys import LimitsTable
from flighttune.control.inner_loop import InnerLag
from flighttune.control.limits import Limits
from flighttune.control.wind import climb_through_air
from flighttune.flight.scenario.schema import Scenario
from flighttune.routes.feasible import FeasibleReference, Manoeuvre, feasible_reference
from flighttune.routes.follow import RouteReference
from flighttune.routes.route_keys import RouteTable
from flighttune.routes.segments import Reference
from flighttune.vehicles.plant_keys import PlantTable
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.weather import Weather, WindProfile, through_air

# Default share of every limit that a feasible reference reserves for the feedback.
MARGIN = 0.2

# Number of times at which the slopes of a reference are computed.
REFERENCE_SAMPLES = 401

# Number of courses in a turn, besides the first, at which its slope in the wind is computed.
TURN_COURSES = 8

# Roll just below 90 deg, rad, at which any turn rate is reachable.
STEEPEST_ROLL = math.pi / 2.0 - 1e-6

AnyReference: TypeAlias = Reference | FeasibleReference | RouteReference
T = TypeVar("T")


def _kept(found: Callable[[Scenario], T]) -> Callable[[Scenario], T]:
    """A cached value of a scenario; like a cached property, a copy computes it again."""

    @wraps(found)
    def kept(scenario: Scenario, /) -> T:
        values = vars(scenario)
        if found.__name__ not in values:
            values[found.__name__] = found(scenario)
        return values[found.__name__]

    return kept


@_kept
def stated_condition(scenario: Scenario) -> FlightCondition:
    """Condition stated in [flight]; on a route its angles count from the route's start."""
    f = scenario.flight
    chi, gamma = (0.0, 0.0) if scenario.route is None else reference_of(scenario).initial
    return FlightCondition(
        V_a=f.V_a_mps,
        h=f.h_m,
        chi=chi + f.chi_deg * DEG,
        gamma=gamma + f.gamma_deg * DEG,
        phi=f.phi_deg * DEG,
        n_z=f.n_z,
    )


@_kept
def start_condition(scenario: Scenario) -> FlightCondition:
    """Condition at the start of the flight in its steady wind: the path through the air."""
    start, wind = stated_condition(scenario), scenario.wind
    if wind is None or scenario.flight.start == "heading":
        return start
    try:
        return through_air(start, wind.profile().at(start.h))
    except InputError as error:
        key = "level" if wind.level else "speed_mps"
        raise InputError(f"`{key}` of [wind] {error}") from error


@_kept
def command_limits(scenario: Scenario) -> Limits:
    """Limits of the commands on every plant, from [limits] or else from the first aircraft."""
    if (aircraft := scenario.aircraft) and scenario.limits == LimitsTable():
        return aircraft[0].config.limits.limits(airspeed=scenario.airspeed)
    return scenario.limits.limits(airspeed=scenario.airspeed)


def limits_on(scenario: Scenario, plants: Iterable[PlantTable]) -> Limits:
    """Limits of the commands that satisfy the scenario and, for aircraft, their own limits."""
    limits = command_limits(scenario)
    for plant in plants:
        if plant.aircraft is not None:
            limits = limits.within(plant.config.limits.limits(airspeed=scenario.airspeed))
    return limits


def weather_of(scenario: Scenario) -> Weather | None:
    """Motion of the air around the full aircraft; None for still air."""
    disturbance, wind = scenario.disturbance, scenario.wind
    swing = disturbance if disturbance and disturbance.as_wind else None
    if not (scenario.windy or swing):
        return None
    V_a, (chi, gamma) = scenario.flight.V_a_mps, reference_of(scenario).initial
    return Weather(
        wind=wind.profile() if wind else WindProfile(),
        gust=scenario.gust.gust(V_a) if scenario.gust else None,
        turbulence=scenario.turbulence.turbulence() if scenario.turbulence else None,
        oscillation=swing.sinusoid().as_wind(V_a, chi, gamma) if swing else None,
    )


@_kept
def reference_of(scenario: Scenario) -> AnyReference:
    """The reference of the outer loop; InputError if it cannot be flown."""
    if scenario.feasible:
        return feasible_reference(manoeuvre_of(scenario))
    if scenario.route is not None:
        return _route_reference(scenario, scenario.route)
    return scenario.stated_reference


def _route_reference(scenario: Scenario, table: RouteTable) -> RouteReference:
    """A route above the ground, within the limits of the scenario and of all its aircraft."""
    f, limits = scenario.flight, limits_on(scenario, scenario.plant)
    phi = float(min(limits.upper[0], -limits.lower[0]))
    phi_rate = float(min(limits.rate_upper[0], -limits.rate_lower[0]))
    for key, value in (("phi_deg", phi), ("phi_rate_dps", phi_rate)):
        if not 0.0 < value < math.inf:
            raise InputError(f"[limits] `{key}` must be given, and on both sides, for a route.")
    route = table.reference(f, phi=phi, phi_rate=phi_rate)
    heights = route.path.up[route.path.s <= route.path.length]
    on = route.path.stretch_at(float(route.path.s[heights.argmin()]))
    places = [(point.up, point.name) for point in table.waypoints()]
    up, where = min([*places, (float(heights.min()), f"the {on.words}")])
    if (lowest := f.h_m + up) <= f.ground_m:
        raise InputError(
            f"`up_m` of [[route.waypoint]] must be above `ground_m`, {f.ground_m:g} m above "
            f"sea level, everywhere on the route, got {lowest:.0f} m at {where}. If the ground "
            f"is lower there, set `flight.ground_m` below {lowest:.0f}."
        )
    return route


class Slope(NamedTuple):
    """A climb or descent of a reference, by its path through the air."""

    air: float  # rad: path angle through the air, which thrust and drag balance
    gamma: float  # rad: over ground
    V_a: float  # m/s
    words: str  # where

    @property
    def over_ground(self) -> str:
        """The path angle over ground in words, as an addition; empty if both angles are equal."""
        air, ground = (f"{x / DEG:.1f} deg" for x in (self.air, self.gamma))
        return "" if air == ground else f" through the air ({ground} over ground)"


def slopes(scenario: Scenario) -> list[Slope]:
    """Slopes of the reference of a scenario in its steady wind."""
    reference, f = reference_of(scenario), scenario.flight
    profile = scenario.wind.profile() if scenario.wind else WindProfile()
    if not isinstance(reference, RouteReference):
        chi, gamma = reference.sampled(np.linspace(0.0, f.duration_s, REFERENCE_SAMPLES))
        angles = zip(chi.tolist(), gamma.tolist(), strict=True)
        places = [(*x, f.h_m, f.V_a_mps, "reference") for x in dict.fromkeys(angles)]
    else:
        path, places = reference.path, []
        for x in path.stretches:
            s = x.start + 0.5 * x.length
            up, V_a = (float(np.interp(s, path.s, y)) for y in (path.up, reference.V))
            courses = x.course + x.turn * np.linspace(0.0, 1.0, 1 + TURN_COURSES * bool(x.turn))
            places += [(chi, x.gamma, f.h_m + up, V_a, x.words) for chi in courses.tolist()]
    found = []
    for chi, gamma, h, V_a, words in places:
        sine = climb_through_air(chi, gamma, V_a, profile.at(h))
        found.append(Slope(math.asin(min(max(sine, -1.0), 1.0)), gamma, V_a, words))
    return found


def slopes_not_held(scenario: Scenario) -> tuple[str, ...]:
    """A sentence for the steepest climb and descent that an aircraft cannot hold."""
    from flighttune.vehicles.plants.jsbsim.trim import (
        steepest,  # JSBSim is not needed if only the law flies
    )

    found, h, notes = slopes(scenario), scenario.flight.h_m, []
    for slope, way in ((min(found), "descends"), (max(found), "climbs")):
        for plant in scenario.plant if slope.air and (way == "climbs") == (slope.air > 0.0) else ():
            condition = FlightCondition(V_a=slope.V_a, h=h, gamma=slope.air)
            if plant.aircraft and (can := steepest(plant.config, condition)):
                notes.append(
                    f"The {slope.words} {way} at {abs(slope.air) / DEG:.1f} deg"
                    f"{slope.over_ground}; {plant.label} holds {slope.V_a:g} m/s up to "
                    f"{abs(can[0]) / DEG:.1f} deg, as beyond it {can[1]}."
                )
    return tuple(notes)


def manoeuvre_of(scenario: Scenario) -> Manoeuvre:
    """The change of a feasible reference, within the limits less the margin."""
    reference, f, limits = scenario.reference, scenario.flight, command_limits(scenario)
    assert reference is not None  # a feasible reference has these
    for plant in scenario.aircraft:
        own, design = plant.config.limits.limits(), plant.config.design
        # Below the design airspeed of an aircraft its largest load factor falls with the square of
        # airspeed, like lift.
        lift = 1.0 if design is None else min(1.0, (f.V_a_mps / design.V_a) ** 2)
        at_lift = np.array([1.0, lift])
        limits = limits.within(replace(own, lower=at_lift * own.lower, upper=at_lift * own.upper))
    # Bounds of roll and load factor, and of their rates, less the margin about level flight.
    share = 1.0 - (MARGIN if reference.margin is None else reference.margin)
    level = np.array([[0.0, 1.0], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]])
    ends = np.array([limits.lower, limits.upper, limits.rate_lower, limits.rate_upper])
    bounds = level + share * (ends - level)
    if not np.isfinite(bounds).all():
        raise InputError(
            "`phi_deg`, `n_z`, `phi_rate_dps` and `n_z_rate_per_s` of [limits] must all be "
            "given with a reference of shape feasible."
        )
    lower, upper, rate_lower, rate_upper = map(tuple, bounds.tolist())
    chi, gamma = (DEG * x for x in reference.begins(f))
    end = scenario.stated_reference
    phi, n_z = f.phi_deg * DEG, f.n_z
    return Manoeuvre(
        V_a=f.V_a_mps,
        g=f.g_mps2,
        start=(chi, gamma),
        end=(end.chi, end.gamma),
        u_0=(phi, math.cos(gamma) / math.cos(phi) if n_z is None else n_z),
        lower=lower,
        upper=upper,
        rate_lower=rate_lower,
        rate_upper=rate_upper,
        lags=lags_of(scenario.plant[0], f.V_a_mps, gamma),
        dt=1.0 / scenario.controller.rate_hz,
    )


def lags_of(plant: PlantTable, V_a: float, gamma: float) -> tuple[InnerLag, InnerLag] | None:
    """Lags of roll and load factor, if any; for an aircraft, the nearest identified lags."""
    if plant.aircraft is None:
        return plant.lags()
    return plant.identified_model.nearest(V_a, gamma).lags


def lead_on(scenario: Scenario, plant: PlantTable | None) -> tuple[float, float]:
    """Lags (s) of roll and lift behind their plan on a plant; None is a plant without lags."""
    if scenario.route is None and not scenario.rolls_in:
        return 0.0, 0.0
    _, gamma = reference_of(scenario).initial
    lags = plant and lags_of(plant, scenario.flight.V_a_mps, gamma)
    # Each lag is the ramp lag plus half a sample for held commands.
    phi, n_z = (0.0, 0.0) if lags is None else (lags[0].whole, lags[1].whole)
    hold = 0.5 / scenario.controller.rate_hz
    return phi + hold, n_z + hold


def check_roll_in(scenario: Scenario) -> None:
    """Refuse ramps that roll in faster than the limits allow in still air, and name the remedy."""
    reference, f = scenario.reference, scenario.flight
    if reference is None or not scenario.rolls_in:
        return
    limits = limits_on(scenario, scenario.plant)
    rates = np.minimum(limits.rate_upper, -limits.rate_lower)
    keys = {"chi_deg": ("phi_deg", "phi_rate_dps"), "gamma_deg": ("n_z", "n_z_rate_per_s")}
    for channel, ramp in reference.ramps_in:
        i, (key, rate_key) = [*keys].index(channel), keys[channel]
        where, per_load = f"[reference.{channel}]", f.V_a_mps * DEG / f.g_mps2
        load = ramp.rate_dps * per_load
        bound = float(limits.upper[i] if load > 0.0 else limits.lower[i])
        roll = min(max(bound, -STEEPEST_ROLL), STEEPEST_ROLL)
        largest = math.tan(roll) if i == 0 else bound - 1.0
        if abs(load) > abs(largest):
            raise InputError(
                f"{where} `rate_dps` must lie within {largest / per_load:.4g} deg/s where it rolls "
                f"in, for which `{key}` of [limits] has the lift at {f.V_a_mps:g} m/s, got "
                f"{ramp.rate_dps:g} deg/s."
            )
        if ramp.roll_in_s < (least := abs(load) / float(rates[i])):
            enough = math.ceil(1000.0 * least) / 1000.0  # rounded up, so that it suffices
            raise InputError(
                f"{where} `roll_in_s` must be at least {enough:g} s, in which `{rate_key}` of "
                f"[limits] gives the rate of {ramp.rate_dps:g} deg/s, got {ramp.roll_in_s:g} s."
            )
