"""A scenario: its tables, checked against each other, and what they mean in SI."""

import math
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.control.gains import COMMANDS, PIGains, paper_family
from flighttune.control.inner_loop import with_input_delay, with_input_lag
from flighttune.control.law import DEFAULT, Law, Trim, law_name, made_law, split_name
from flighttune.control.limits import Limits
from flighttune.control.linear_model import LinearModel
from flighttune.errors import InputError
from flighttune.files.shipped import nearest_name
from flighttune.files.table import hash_of
from flighttune.identification.file import DesignModel, design_model, load_identified
from flighttune.plants.base import FlightCondition
from flighttune.plants.weather import Weather, WindProfile, path_through_air
from flighttune.present.names import listed
from flighttune.quantities import FASTEST_WIND, STEEPEST_DEG, Table
from flighttune.references.feasible import FeasibleReference, Manoeuvre, feasible_reference
from flighttune.references.follow import RouteReference
from flighttune.references.path import Ability
from flighttune.references.segments import Reference
from flighttune.scenario import tables
from flighttune.scenario.route import RouteTable
from flighttune.scenario.tables import LAWS, TUNED, TUNED_IDENTIFIED, GainsTable, law_named
from flighttune.units import DEG

# Samples of the controller in a flight: five and a half hours at 50 Hz, 200 MB of signals.
MAX_SAMPLES = 1_000_000

# deg, and share of a duration.
ROUNDING = 1e-9


# Share of every limit that a reference of shape feasible leaves to the feedback by default.
MARGIN = 0.2


class Scenario(Table):
    """One manoeuvre: every gain set flies on every plant.

    Examples
    --------
    >>> scenario = ft.load_scenario("paper")
    >>> [plant.label for plant in scenario.plant], scenario.gain_names
    (['kinematic', 'jsbsim:aerosonde'], ('paper', 'tuned'))
    """

    title: Annotated[str, Field(min_length=1)]
    verifies: str = ""
    source: str = ""
    seed: tables.Seed = 0
    law: tables.Laws | None = None
    gains: list[str | GainsTable] = Field(default_factory=lambda: ["paper", TUNED], min_length=1)
    flight: tables.FlightTable
    reference: tables.ReferenceTable | None = None
    route: RouteTable | None = None
    limits: tables.LimitsTable = tables.LimitsTable()
    controller: tables.ControllerTable = tables.ControllerTable()
    tuning: tables.TuningTable = tables.TuningTable()
    disturbance: tables.DisturbanceTable | None = None
    wind: tables.WindTable | None = None
    gust: tables.GustTable | None = None
    turbulence: tables.TurbulenceTable | None = None
    sensors: tables.SensorsTable | None = None
    envelope: tables.EnvelopeTable | None = None
    expect: list[tables.ExpectTable] = Field(default_factory=list)
    plant: Annotated[list[tables.PlantTable], Field(min_length=1)]

    @model_validator(mode="after")
    def _consistent(self) -> "Scenario":
        available = [TUNED, *paper_family(), TUNED_IDENTIFIED]
        for entry in self.gains:
            if isinstance(entry, str) and entry not in available:
                raise ValueError(
                    f"`gains` must be one of {', '.join(available)}, a file of gains (.json, "
                    f".toml) or a table with K_P and K_I, got {entry!r}"
                    + nearest_name(entry, available).removesuffix(".")
                )
        for law in self.laws:
            if self.tuning.input_limits and law.inputs != COMMANDS:
                raise ValueError(
                    f"`input_limits` of [tuning] must be absent with the {law.kind} law: its gains "
                    "act on rates, not on roll and load factor"
                )
        if TUNED_IDENTIFIED in self.gains or self.tuning.model == "identified":
            self._identified()
        plants = [plant.label for plant in self.plant]
        laws = [law.name for law in self.laws]
        for key, labels in (("law", laws), ("gains", self.gain_names), ("plant", plants)):
            if len(set(labels)) < len(labels):
                hint = "; a `name` of its own distinguishes a plant" if key == "plant" else ""
                raise ValueError(
                    f"`{key}` must not name anything twice, got {', '.join(labels)}{hint}"
                )
        plants = list(dict.fromkeys((*plants, *(plant.kind for plant in self.plant))))
        for table in self.expect:
            for key, labels in (("gains", self.gain_names), ("plant", plants)):
                if getattr(table, key) not in (None, *labels):
                    raise ValueError(
                        f"`{key}` of [[expect]] must be one of {', '.join(labels)}, "
                        f"got {getattr(table, key)!r}"
                    )
        return self

    @model_validator(mode="after")
    def _followed_once(self) -> "Scenario":
        if (self.reference is None) == (self.route is None):
            raise ValueError("`reference` or `route` must be given, and not both")
        if self.route is not None and "duration_s" not in self.flight.model_fields_set:
            raise ValueError(
                "`duration_s` of [flight] must be given with [route]: its longest time"
            )
        return self

    @model_validator(mode="after")
    def _can_be_flown(self) -> "Scenario":
        duration, rate = self.flight.duration_s, self.controller.rate_hz
        if not 2.0 <= duration * rate <= MAX_SAMPLES:
            raise ValueError(
                "`duration_s` of [flight] must be at least two samples of the controller and at "
                f"most {MAX_SAMPLES}, got {duration:g} s at {rate:g} Hz"
            )
        times = list(self.reference.starts() if self.reference else ())
        if self.gust:
            times.append(("[gust] `start_s`", self.gust.start_s))
        if self.disturbance:
            times += self.disturbance.last_switches()
        for key, time in times:
            if time >= duration:
                raise ValueError(
                    f"{key} must lie before the end of the flight "
                    f"(`duration_s` of [flight], {duration:g} s), got {time:g} s"
                )
        t, gamma_deg = 0.0, self.flight.gamma_deg
        if self.reference is not None:
            t, gamma_deg = self.reference.steepest(gamma_deg, duration)
        if abs(gamma_deg) > STEEPEST_DEG + ROUNDING:
            raise ValueError(
                f"[reference] `gamma_deg` must stay within +-{STEEPEST_DEG:g} deg, "
                f"got {gamma_deg:g} deg at t = {t:g} s"
            )
        return self

    @model_validator(mode="after")
    def _air_fits(self) -> "Scenario":
        disturbance, aircraft = self.disturbance, any(plant.aircraft for plant in self.plant)
        for name in () if aircraft else ("gust", "turbulence"):
            if getattr(self, name):
                raise ValueError(
                    f"`{name}` must be absent without a jsbsim plant: the others replay its wind"
                )
        if self.wind and self.wind.level and not aircraft:
            raise ValueError("`level` of [wind] must be absent without a jsbsim plant")
        if disturbance is None:
            return self
        if aircraft and not disturbance.as_wind:
            raise ValueError(
                "`disturbance` must be absent where a plant is jsbsim, or have `as_wind`: the "
                "sinusoid is a term of the kinematic law"
            )
        if disturbance.path == "air" and self.windy:
            raise ValueError(
                '`path` of [disturbance] must be "ground" where there is other wind, which plants '
                "that are no aircraft meet over ground"
            )
        for channel in ("chi", "gamma") if disturbance.as_wind else ():
            amplitude = abs(getattr(disturbance, f"{channel}_amplitude"))
            omega = getattr(disturbance, f"{channel}_omega_rad_s")
            wind = self.flight.V_a_mps * amplitude / omega if amplitude else 0.0
            if wind > FASTEST_WIND:
                raise ValueError(
                    f"[disturbance] `{channel}_amplitude` must be that of a wind of at most "
                    f"{FASTEST_WIND:g} m/s with as_wind, got one of {wind:.3g} m/s"
                )
        return self

    @model_validator(mode="after")
    def _starts_in_its_wind(self) -> "Scenario":
        try:
            _ = self.stated_condition
        except InputError:  # a route that cannot be flown: `check_aircraft` says why
            return self
        try:
            _ = self.condition
        except InputError as error:
            key = "level" if self.wind and self.wind.level else "speed_mps"
            raise ValueError(f"`{key}` of [wind] {error}") from error
        return self

    @model_validator(mode="after")
    def _errors_can_be_bounded(self) -> "Scenario":
        law = self.laws[0]
        if self.tuning.E_star is not None and not law.by_gains:
            raise ValueError(
                f"`E_star` of [tuning] must be absent with the law {law.name}, which has no linear "
                f"model, got {self.tuning.E_star:g}"
            )
        return self

    @model_validator(mode="after")
    def _scaling_fits(self) -> "Scenario":
        if self.tuning.state_scaling is not None:
            n, _, p = self.linear_model().shape
            if len(self.tuning.state_scaling) != n + p:
                raise ValueError(
                    f"`state_scaling` of [tuning] must be {n + p} numbers, one a state and one an "
                    f"error, got {len(self.tuning.state_scaling)}"
                )
        return self

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for each deviation of the flight from the file."""
        of_route = tuple(self.route.notes) if self.route is not None else ()
        duration, dt = self.flight.duration_s, 1.0 / self.controller.rate_hz
        flown = round(duration / dt) * dt
        if math.isclose(flown, duration, rel_tol=ROUNDING):
            return of_route
        return (
            *of_route,
            f"[flight] `duration_s` {duration:g} is no whole number of samples at "
            f"{self.controller.rate_hz:g} Hz: {flown:.6g} s are flown",
        )

    @property
    def code(self) -> tuple[str, ...]:
        """Python files of its laws and plants, which run when it is flown."""
        listed = (*self.law_tables, *self.plant)
        return tuple(dict.fromkeys(table.module for table in listed if table.module))

    @property
    def law_tables(self) -> tuple[tables.LawTable, ...]:
        """The tables of the laws flown, in order; the paper's by default."""
        return tuple(self.law or (law_named(DEFAULT),))

    @property
    def laws(self) -> tuple[Law, ...]:
        """The laws flown, in order; the paper's by default."""
        return tuple(table.law() for table in self.law_tables)

    @property
    def gain_names(self) -> tuple[str, ...]:
        """Names of the gain sets flown, law by law: as listed with the paper's, else LAW:GAINS."""
        listed = tuple(entry if isinstance(entry, str) else entry.name for entry in self.gains)
        return tuple(name for law in self.laws for name in law.names_of(listed))

    def law_table(self, name: str) -> tables.LawTable:
        """The table of the law that flies a gain set; `name` as for `law_of`."""
        listed = {table.name: table for table in self.law_tables}
        law = law_name(name, listed)
        if law not in listed and law not in LAWS:
            raise InputError(
                f"`gains` must name a law of {', '.join(dict.fromkeys([*listed, *LAWS]))} before "
                f"the colon, got {name!r}."
            )
        return listed.get(law) or law_named(law)

    def law_of(self, name: str, gains: PIGains | None = None) -> tuple[Law, str]:
        """The law that flies a gain set, and the gain set as ``gains`` lists it.

        `name` is one of `gain_names`. A law that the scenario does not name but can
        (``exact:tuned``) has its default settings; without a law it is the paper's, or the only one
        there is. `gains` may come from a file: if they act on other inputs than those of the named
        law, the law is `law_for` of the gains.
        """
        law, own = self.law_table(name).law(), split_name(name)[1]
        if gains is not None and law.by_gains and gains.inputs != law.inputs:
            law = self.law_for(gains)
        return law, own

    def law_for(self, gains: PIGains) -> Law:
        """The first law of the scenario that takes gains as they are, else the one they are of."""
        fitting = (law for law in self.laws if law.by_gains and law.inputs == gains.inputs)
        return next(fitting, None) or made_law(gains.law)

    def plant_table(self, label: str) -> tables.PlantTable:
        """The table of one of its plants."""
        plants = {table.label: table for table in self.plant}
        if label not in plants:
            raise InputError(f"`plant` must be one of {', '.join(plants)}, got {label}.")
        return plants[label]

    @property
    def windy(self) -> bool:
        """Whether the air moves on every plant, by [wind], [gust] or [turbulence]."""
        return any((self.wind, self.gust, self.turbulence))

    @property
    def wind_source(self) -> tables.PlantTable | None:
        """The plant whose wind those replay that have no weather: the first aircraft in wind."""
        aircraft = (plant for plant in self.plant if plant.aircraft is not None)
        return next(aircraft, None) if self.windy else None

    def weather(self) -> Weather | None:
        """Motion of the air around the full aircraft; None for still air."""
        swing = self.disturbance if self.disturbance and self.disturbance.as_wind else None
        if not (self.windy or swing):
            return None
        V_a, (chi, gamma) = self.flight.V_a_mps, self.followed().initial
        return Weather(
            wind=self.wind.profile() if self.wind else WindProfile(),
            gust=self.gust.gust(V_a) if self.gust else None,
            turbulence=self.turbulence.turbulence() if self.turbulence else None,
            oscillation=swing.sinusoid().as_wind(V_a, chi, gamma) if swing else None,
        )

    @property
    def air(self) -> str:
        """The air flown in, in words."""
        disturbance = self.disturbance
        blows = disturbance is not None and disturbance.as_wind
        air = {
            "wind": self.wind,
            "an oscillating wind": blows,
            "a gust": self.gust,
            "turbulence": self.turbulence,
        }
        weather = listed([name for name, table in air.items() if table]) or "calm air"
        return f"{weather}, with a disturbance" if disturbance and not blows else weather

    @property
    def command_limits(self) -> Limits:
        """Limits of the commands on every plant: those of [limits], else of the first aircraft."""
        aircraft = [plant.aircraft for plant in self.plant if plant.aircraft is not None]
        if aircraft and self.limits == tables.LimitsTable():
            return load_aircraft(aircraft[0]).limits.limits()
        return self.limits.limits()

    @property
    def condition(self) -> FlightCondition:
        """Condition in which the flight starts in its steady wind: the path through the air."""
        start, wind = self.stated_condition, self.wind
        if wind is None or self.flight.start == "heading":
            return start
        at_start = wind.profile().at(start.h)
        chi, gamma = path_through_air(start.V_a, start.chi, start.gamma, at_start)
        return replace(start, chi=chi, gamma=gamma)

    @property
    def stated_condition(self) -> FlightCondition:
        """Condition that [flight] states; on a route its angles count from those of its start."""
        f = self.flight
        chi, gamma = (0.0, 0.0) if self.route is None else self.followed().initial
        return FlightCondition(
            V_a=f.V_a_mps,
            h=f.h_m,
            chi=chi + f.chi_deg * DEG,
            gamma=gamma + f.gamma_deg * DEG,
            phi=f.phi_deg * DEG,
            n_z=f.n_z,
        )

    @property
    def feasible(self) -> bool:
        """Whether the reference is the fastest change within the limits."""
        return self.reference is not None and self.reference.shape == "feasible"

    def followed(self) -> Reference | FeasibleReference | RouteReference:
        """The reference that the outer loop follows.

        An InputError says that no feasible reference was found, that a route cannot be flown, or
        that limits are missing.
        """
        f = self.flight
        if self.feasible:
            return feasible_reference(self.manoeuvre)
        if self.route is not None:
            route = self.route.reference(self._ability)
            heights = f.h_m + route.path.up[route.path.s <= route.path.length]
            if (lowest := heights.min()) <= f.ground_m:
                raise InputError(
                    f"`up_m` of [[route.waypoint]] must be above `ground_m` {f.ground_m:g} m "
                    f"everywhere on the route, got a height of {lowest:.0f} m."
                )
            return route
        assert self.reference is not None  # one of both is there
        return self.reference.reference(chi_deg=f.chi_deg, gamma_deg=f.gamma_deg)

    @property
    def _ability(self) -> Ability:
        """Limits of a route: the share of those of the scenario and of all its aircraft."""
        assert self.route is not None
        limits, f = self.command_limits, self.flight
        for plant in self.plant:
            if plant.aircraft is not None:
                limits = limits.within(load_aircraft(plant.aircraft).limits.limits())
        phi = float(min(limits.upper[0], -limits.lower[0]))
        phi_rate = float(min(limits.rate_upper[0], -limits.rate_lower[0]))
        for key, value in (("phi_deg", phi), ("phi_rate_dps", phi_rate)):
            if not 0.0 < value < math.inf:
                raise InputError(f"[limits] `{key}` must be given, and on both sides, for a route.")
        return self.route.ability(
            V_a=f.V_a_mps, g=f.g_mps2, phi=phi, phi_rate=phi_rate, duration=f.duration_s
        )

    @property
    def manoeuvre(self) -> Manoeuvre:
        """The change that a reference of shape feasible makes, within the limits less the margin.

        The limits are those of the scenario and of all its aircraft; the lag is that of the first
        plant. Below the airspeed an aircraft is designed for its largest load factor falls with the
        square of airspeed, as lift does.
        """
        reference, f, limits = self.reference, self.flight, self.command_limits
        assert reference is not None  # of shape feasible
        for plant in self.plant:
            if plant.aircraft is not None:
                limits = limits.within(_lift_and_limits(plant.aircraft, f.V_a_mps))
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
        chi_from, gamma_from = reference.chi_from_deg, reference.gamma_from_deg
        chi = DEG * (f.chi_deg if chi_from is None else chi_from)
        gamma = DEG * (f.gamma_deg if gamma_from is None else gamma_from)
        end = reference.reference(chi_deg=f.chi_deg, gamma_deg=f.gamma_deg)
        phi, n_z, first = self.condition.phi, self.condition.n_z, self.plant[0]
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
            lags=first.lags()
            if first.aircraft is None
            else load_identified(first.aircraft).nearest(f.V_a_mps, gamma).lags,
            dt=1.0 / self.controller.rate_hz,
        )

    def _identified(self) -> str:
        """Aircraft or file the identified model comes from."""
        flown = [plant.aircraft for plant in self.plant if plant.aircraft is not None]
        source = self.tuning.identified or next(iter(flown), None)
        if source is None:
            raise InputError(
                "`identified` of [tuning] must be given: no plant is an aircraft, got nothing"
            )
        return source

    def identified_models(
        self, law: Law | None = None, *, everywhere: bool = False
    ) -> tuple[DesignModel, ...]:
        """A law, by default the first, behind the identified inner loop and half a sample of delay.

        The model is about wings-level flight on the first reference with the lags of the nearest
        condition. If `everywhere`, or where [tuning] says ``robust``, there is one model for each
        condition, at its own airspeed and climb.
        """
        identified, law = load_identified(self._identified()), law or self.laws[0]
        V_a, gamma = self.flight.V_a_mps, self.followed().initial[1]
        g, hold = self.flight.g_mps2, 0.5 / self.controller.rate_hz
        if everywhere or self.tuning.robust:
            speed = V_a if self.controller.schedule else None
            return tuple(
                design_model(condition, g=g, hold=hold, schedule_speed=speed, law=law)
                for condition in identified.conditions
            )
        nearest = identified.nearest(V_a, gamma)
        return (design_model(nearest, g=g, V_a=V_a, gamma=gamma, hold=hold, law=law),)

    def kinematic_model(self, law: Law | None = None) -> LinearModel:
        """A law alone, by default the first, about wings-level flight on the first reference."""
        f = self.flight
        trim = Trim(V_a=f.V_a_mps, gamma=self.followed().initial[1], g=f.g_mps2)
        return (law or self.laws[0]).linear_model(trim)

    def linear_model(self, law: Law | None = None) -> LinearModel:
        """The model that [tuning] names, about wings-level flight on the first reference.

        Of an identified aircraft that is the first condition where [tuning] says ``robust``. The
        law is the first by default.
        """
        if self.tuning.model == "identified":
            return self.identified_models(law)[0].model
        model = self.kinematic_model(law)
        if self.tuning.lag_rad_s is not None:
            model = with_input_lag(model, self.tuning.lag_rad_s)
        if self.tuning.sample_delay:
            model = with_input_delay(model, 0.5 / self.controller.rate_hz)
        return model

    def expected(self, plant: str, gains: str) -> list[tables.ExpectTable]:
        """The requirements of a run of this plant and these gains."""
        return [table for table in self.expect if table.meant(plant, gains)]

    def check_over_time(self, what: str) -> None:
        """Refuse a route for what needs a reference over time."""
        if self.route is not None:
            raise InputError(f"`route` must be absent for {what}: it needs a reference over time.")

    def as_dict(self) -> dict[str, Any]:
        """The scenario as plain values, defaults filled in, as it would stand in a file."""
        return self.model_dump(mode="json", exclude_none=True)

    @property
    def sha256(self) -> str:
        """Hash of the scenario's values, the same for every way to write them."""
        return hash_of(self.as_dict())


def _lift_and_limits(aircraft: str, V_a: float) -> Limits:
    """Limits of an aircraft's commands at an airspeed (m/s), with no more lift than there is."""
    config = load_aircraft(aircraft)
    limits = config.limits.limits()
    share = 1.0 if config.design is None else min(1.0, (V_a / config.design.V_a) ** 2)
    at_lift = np.array([1.0, share])
    return replace(limits, lower=at_lift * limits.lower, upper=at_lift * limits.upper)
