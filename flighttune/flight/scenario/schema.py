"""A scenario: the tables of its file, checked against each other."""

import math
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import Annotated, Any

from pydantic import Field, model_validator

from flighttune.base.errors import FlightTuneError, InputError
from flighttune.base.files.shipped import nearest_name
from flighttune.base.files.table import abridged, hash_of, refused_in_a_line
from flighttune.base.quantities import FASTEST_WIND, STEEPEST_DEG, Table
from flighttune.base.words import listed
from flighttune.control.controller_keys import ControllerTable, EnvelopeTable, LimitsTable
from flighttune.control.gains import COMMANDS, PIGains, paper_family
from flighttune.control.gains_keys import (
    TUNED,
    TUNED_FED_BACK,
    TUNED_IDENTIFIED,
    GainsTable,
    on_aircraft,
)
from flighttune.control.law import DEFAULT, Law, made_law, split_name
from flighttune.control.law_keys import LAWS, Laws, LawTable, law_named
from flighttune.control.tuning.tuning_keys import TuningTable
from flighttune.flight.loop.disturbance_keys import DisturbanceTable
from flighttune.flight.metrics import CHANNELS, OFF_ROUTE, UNSETTLED, required_names
from flighttune.flight.requirement_keys import ExpectTable
from flighttune.routes.reference_keys import ReferenceTable
from flighttune.routes.route_keys import RouteTable
from flighttune.routes.segments import Reference
from flighttune.routes.turn_back_keys import TurnBackTable
from flighttune.vehicles.flight_keys import FlightTable
from flighttune.vehicles.identification.file import IdentifiedAircraft, load_identified
from flighttune.vehicles.plant_keys import PlantTable, flown_aircraft
from flighttune.vehicles.plants.sensors import Sensors
from flighttune.vehicles.weather_keys import (
    GustTable,
    Seed,
    SensorsTable,
    TurbulenceTable,
    WindTable,
)

# Samples of the controller in a flight: five and a half hours at 50 Hz, 200 MB of signals.
MAX_SAMPLES = 1_000_000

# Most airspeeds along a route that are named one by one.
MAX_SPEEDS = 4

# deg, and share of a duration.
ROUNDING = 1e-9


@refused_in_a_line
class Scenario(Table):
    """One manoeuvre: every gain set flies on every plant.

    Examples
    --------
    >>> scenario = ft.load_scenario("paper")
    >>> [plant.label for plant in scenario.plant], scenario.gain_names
    (['kinematic', 'jsbsim:aerosonde'], ('paper', 'tuned'))
    """

    title: Annotated[str, Field(min_length=1)]
    verifies: str = ""  # for the reader
    source: str = ""  # for the reader
    seed: Seed = 0  # of turbulence, sensor noise and tuning
    # What turns errors into commands: a name, a list of names or tables; the paper's if left out
    law: Laws | None = None
    # names (paper, K1 to K6, tuned, tuned_identified, tuned_fed_back), files beside the scenario,
    # or tables
    gains: list[str | GainsTable] = Field(default_factory=lambda: ["paper", TUNED], min_length=1)
    flight: FlightTable
    reference: ReferenceTable | None = None
    route: RouteTable | None = None
    # Written by `flighttune mission --turn-back` in place of a route and a reference
    turn_back: TurnBackTable | None = None
    limits: LimitsTable = LimitsTable()  # of the commands
    controller: ControllerTable = ControllerTable()
    tuning: TuningTable = TuningTable()
    disturbance: DisturbanceTable | None = None  # the paper's, on the kinematic law
    wind: WindTable | None = None
    gust: GustTable | None = None
    turbulence: TurbulenceTable | None = None
    sensors: SensorsTable | None = None
    # Conditions over which `certify --envelope` looks for one proof
    envelope: EnvelopeTable | None = None
    expect: list[ExpectTable] = Field(default_factory=list)  # what the runs must achieve
    # Sentences on what its identified models assume; written by the program
    assumed: list[str] | None = None
    plant: Annotated[list[PlantTable], Field(min_length=1)]

    @model_validator(mode="before")
    @classmethod
    def _turned_back(cls, values: Any) -> Any:
        if not (isinstance(values, Mapping) and values.get("turn_back")):
            return values
        return TurnBackTable.model_validate(values["turn_back"]).followed(values)

    @model_validator(mode="after")
    def _consistent(self) -> "Scenario":
        available = [TUNED, *paper_family(), TUNED_IDENTIFIED, TUNED_FED_BACK]
        for entry in self.gains:
            if isinstance(entry, str) and entry not in available:
                raise ValueError(
                    f"`gains` must be one of {', '.join(available)}, a file of gains (.json, "
                    f".toml) or a table with K_P and K_I, got {abridged(entry)}"
                    + nearest_name(entry, available).removesuffix(".")
                )
        laws = self.laws
        for law in laws:
            if self.tuning.input_limits and law.inputs != COMMANDS:
                raise ValueError(
                    f"`input_limits` of [tuning] must be absent with the {law.kind} law: its gains "
                    "act on rates, not on roll and load factor"
                )
        if self.tuning.objective == "rms" and self.turbulence is None:
            raise ValueError(
                '`turbulence` must be given with objective = "rms" of [tuning]: calm air has no '
                "spectrum"
            )
        on_identified = TUNED_IDENTIFIED in self.gains or TUNED_FED_BACK in self.gains
        if on_identified or self.tuning.model == "identified":
            _ = self.identified_name
        labels_of = {"law": [law.name for law in laws], "gains": [*self.gain_names]}
        labels_of["plant"] = [plant.label for plant in self.plant]
        for key, labels in labels_of.items():
            if len(set(labels)) < len(labels):
                hint = "; a `name` of its own distinguishes a plant" if key == "plant" else ""
                raise ValueError(
                    f"`{key}` must not name anything twice, got {', '.join(labels)}{hint}"
                )
        labels_of["plant"] += [plant.kind for plant in self.plant]
        for key, label in (
            (key, getattr(x, key)) for x in self.expect for key in ("gains", "plant")
        ):
            if label not in (None, *labels_of[key]):
                labels = ", ".join(dict.fromkeys(labels_of[key]))
                raise ValueError(
                    f"`{key}` of [[expect]] must be one of {labels}, got {abridged(label)}"
                )
        return self

    @model_validator(mode="after")
    def _follows_by_its_law(self) -> "Scenario":
        law, E_star = self.laws[0], self.tuning.E_star
        if E_star is not None and not law.by_gains:
            raise ValueError(
                f"`E_star` of [tuning] must be absent with the law {law.name}, which has no linear "
                f"model, got {E_star:g}"
            )
        if (self.reference is None) == (self.route is None):
            raise ValueError("`reference` or `route` must be given, and not both")
        if self.route is not None and "duration_s" not in self.flight.model_fields_set:
            raise ValueError(
                "`duration_s` of [flight] must be given with [route]: its longest time"
            )
        for channel, names in required_names([t.model_dump() for t in self.expect]).items():
            if self.route is None and channel in OFF_ROUTE:
                raise ValueError(f"`{channel}` of [[expect]] must be absent without [route]")
            if self.route is not None and channel in CHANNELS and UNSETTLED[0] in names:
                raise ValueError(
                    f"`{channel}.settling_s` of [[expect]] must be absent with [route], whose "
                    "guidance commands small changes all the time: bound `flight.cross_track_m` "
                    "and `flight.height_err_m`"
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
        times = [
            (f"[reference.{key}] `start_s`", segment.start_s)
            for key, segment in (self.reference.segments if self.reference else ())
        ]
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
            t, gamma_deg = self.reference.steepest(self.flight)
        if abs(gamma_deg) > STEEPEST_DEG + ROUNDING:
            raise ValueError(
                f"[reference] `gamma_deg` must stay within +-{STEEPEST_DEG:g} deg, "
                f"got {gamma_deg:g} deg at t = {t:g} s"
            )
        return self

    @model_validator(mode="after")
    def _air_fits(self) -> "Scenario":
        disturbance, aircraft = self.disturbance, self.aircraft
        if not aircraft:
            why = "without a jsbsim plant: the others replay its wind"
            self.must_lack(why, "gust", "turbulence")
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
    def _airspeed_fits(self) -> "Scenario":
        if not self.airspeed:
            if any("V" in {**t.at_most, **t.at_least} for t in self.expect):
                raise ValueError("`V` of [[expect]] must be absent without `V_mps` of [reference]")
            return self
        for key, absent in (
            ("`objective` of [tuning] must not be cost", self.tuning.objective != "cost"),
            ("`lag_rad_s` of [tuning] must be absent", self.tuning.lag_rad_s is None),
            ("`envelope` must be absent", self.envelope is None),
        ):
            if not absent:
                raise ValueError(f"{key} where the airspeed is followed")
        for plant in self.plant:
            limits_n_x = self.limits.n_x if plant.aircraft is None else plant.config.limits.n_x
            where = "[limits]" if plant.aircraft is None else f"[limits] of {plant.aircraft}"
            if limits_n_x is None:
                raise ValueError(
                    f"`n_x` of {where} must be given where the airspeed is followed, for the plant "
                    f"{plant.label}"
                )
        return self

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for each deviation of the flight from the file."""
        notes = [*self.gains_notes(), *(self.route.notes if self.route is not None else ())]
        duration, dt = self.flight.duration_s, 1.0 / self.controller.rate_hz
        flown = round(duration / dt) * dt
        if not math.isclose(flown, duration, rel_tol=ROUNDING):
            notes.append(
                f"[flight] `duration_s` {duration:g} is no whole number of samples at "
                f"{self.controller.rate_hz:g} Hz: {flown:.6g} s are flown"
            )
        return tuple(notes)

    def gains_notes(self, plant: str | None = None, gains: str | None = None) -> tuple[str, ...]:
        """A sentence for gains that were tuned for others than they fly here, and `assumptions`.

        They are those of one `plant` and one of `gain_names`, by default of all.
        """
        sets = (entry for entry in self.gains if isinstance(entry, GainsTable))
        flown = [x for x in sets if gains is None or self.listed_as(gains) == x.name]
        if not any(entry.tuned_for for entry in flown):
            return self.assumptions
        aircraft = flown_aircraft(self.plant if plant is None else [self.plant_table(plant)])
        speeds = self.airspeeds[:1] if self.controller.schedule else self.airspeeds
        unlike = (
            f"The gains {entry.name} were tuned for {tuned.words}; here they fly on "
            f"{on_aircraft(aircraft)} at {self.airspeed_words}."
            for entry in flown
            if (tuned := entry.tuned_for) and tuned.unlike(aircraft, speeds)
        )
        return (*unlike, *self.assumptions)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What its identified models and gains assume, a sentence each."""
        sentences = [*(self.assumed or ())]
        named = [self] if self.tuning.identified else []
        for table in (*named, *(x for x in self.plant if x.identified or x.aircraft)):
            with suppress(FlightTuneError):  # elsewhere the file may be missing, or never was
                sentences += table.identified_model.assumptions
        for entry in self.gains:
            if isinstance(entry, GainsTable) and entry.tuned_for:
                sentences += entry.tuned_for.assumed or ()
        return tuple(dict.fromkeys(sentences))

    def assuming(self) -> "Scenario":
        """The scenario with its assumptions written in, so that they stay where it is recorded."""
        if (found := [*self.assumptions]) == (self.assumed or []):
            return self
        return self.model_copy(update={"assumed": found})

    @property
    def code(self) -> tuple[str, ...]:
        """Python files of its laws and plants, which run when it is flown."""
        return tuple(dict.fromkeys(table.module or "" for _, table in self.of_files()))

    def of_files(
        self, flown: Collection[str] | None = None
    ) -> tuple[tuple[str, LawTable | PlantTable], ...]:
        """Laws and plants in Python files, by key; of those `flown`, by name, or of all."""
        listed = (*(("law", x) for x in self.law_tables), *(("plant", x) for x in self.plant))
        own = ((key, x) for key, x in listed if x.module)
        return tuple((key, x) for key, x in own if flown is None or x.name in flown)

    @property
    def law_tables(self) -> tuple[LawTable, ...]:
        """The tables of the laws flown, in order; the paper's by default."""
        return tuple(self.law or (law_named(DEFAULT),))

    @property
    def laws(self) -> tuple[Law, ...]:
        """The laws flown, in order; the paper's by default."""
        return tuple(table.law for table in self.law_tables)

    @property
    def gain_names(self) -> tuple[str, ...]:
        """Names of the gain sets flown, law by law: as listed with the paper's, else LAW:GAINS."""
        listed = tuple(entry if isinstance(entry, str) else entry.name for entry in self.gains)
        return tuple(name for law in self.laws for name in law.names_of(listed))

    def law_table(self, name: str) -> LawTable:
        """The table of the law that flies a gain set; `name` as for `law_of`."""
        listed = {table.name: table for table in self.law_tables}
        law, _ = self._split(name)
        if law not in listed and law not in LAWS:
            laws = ", ".join(dict.fromkeys([*listed, *LAWS]))
            raise InputError(
                f"`gains` must name a law of {laws} before the colon, got {abridged(name)}."
            )
        return listed.get(law) or law_named(law)

    def listed_as(self, name: str) -> str:
        """A gain set of `gain_names` as ``gains`` lists it, without the law."""
        return self._split(name)[1]

    def _split(self, name: str) -> tuple[str, str]:
        return split_name(name, [table.name for table in self.law_tables])

    def law_of(self, name: str, gains: PIGains | None = None) -> tuple[Law, str]:
        """The law that flies a gain set of `gain_names`, and the gain set as ``gains`` lists it."""
        law = self.law_table(name).law
        if gains is not None and law.by_gains and gains.inputs[:2] != law.inputs:
            law = self.law_for(gains)
        return law, self.listed_as(name)

    def law_for(self, gains: PIGains) -> Law:
        """The first law of the scenario that takes gains as they are, else the one they are of."""
        fitting = (law for law in self.laws if law.by_gains and law.inputs == gains.inputs[:2])
        return next(fitting, None) or made_law(gains.law)

    def plant_table(self, label: str) -> PlantTable:
        """The table of one of its plants."""
        plants = {table.label: table for table in self.plant}
        if label not in plants:
            raise InputError(f"`plant` must be one of {', '.join(plants)}, got {label}.")
        return plants[label]

    def sensors_on(self, label: str) -> Sensors | None:
        """Errors of the sensors on a plant, with one that fails in flight; None if exact."""
        sensors = self.sensors and self.sensors.sensors(self.seed)
        airframe = next((table.airframe for table in self.plant if table.label == label), None)
        fault = airframe and airframe.fault
        if not (fault and fault.V_a_bias_mps):
            return sensors
        return replace(sensors or Sensors(), late=(fault.from_s, fault.V_a_bias_mps))

    @property
    def calm(self) -> bool:
        """Whether neither air nor sensors move a command all the time."""
        return not (self.turbulence or self.gust or self.sensors or self.disturbance)

    @property
    def aircraft(self) -> tuple[PlantTable, ...]:
        """Its plants that are aircraft, in order."""
        return tuple(plant for plant in self.plant if plant.aircraft is not None)

    @property
    def identified_name(self) -> str:
        """The aircraft or file that [tuning] names for its model, else that of the first plant."""
        if self.tuning.identified is not None:
            return self.tuning.identified
        identified = (*self.aircraft, *(plant for plant in self.plant if plant.identified))
        if not identified:
            raise InputError(
                "`identified` of [tuning] must be given: no plant is an aircraft, got nothing"
            )
        return identified[0].aircraft or identified[0].identified or ""

    @cached_property
    def identified_model(self) -> IdentifiedAircraft:
        """The identified model that gains are tuned on, read once."""
        return load_identified(self.identified_name)

    @property
    def windy(self) -> bool:
        """Whether the air moves on every plant, by [wind], [gust] or [turbulence]."""
        return any((self.wind, self.gust, self.turbulence))

    @property
    def wind_source(self) -> PlantTable | None:
        """The plant whose wind those replay that have no weather: the first aircraft in wind."""
        return self.aircraft[0] if self.windy and self.aircraft else None

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
    def rolls_in(self) -> bool:
        """Whether a ramp of its reference rolls in: roll and lift are planned for it."""
        return self.reference is not None and bool(self.reference.ramps_in)

    @property
    def airspeed(self) -> bool:
        """Whether the airspeed is a third channel, which laws hold by n_x."""
        if self.route is not None:
            return bool(self.route.holds_airspeed)
        return self.reference is not None and self.reference.V_mps is not None

    @property
    def speed_priority(self) -> bool:
        """Whether the path angle of an aircraft gives way to its airspeed."""
        return self.airspeed or bool(self.controller.speed_priority)

    @property
    def airspeeds(self) -> tuple[float, ...]:
        """Airspeeds that are asked for, m/s, that of the start first."""
        start, route = self.flight.V_a_mps, self.route
        if self.turn_back is not None:
            return (start, *(place.V_a_mps for place in self.turn_back.place))
        if route is not None:  # no flight goes on after the last waypoint
            return (start, *(V for i, V in route.airspeeds.items() if i < len(route.waypoint)))
        if self.reference is None or not self.airspeed:
            return (start,)
        return (start, *self.reference.airspeeds(self.flight))

    @property
    def airspeed_words(self) -> str:
        """Airspeeds that are asked for: ``25 m/s``, ``20, 27 and 23 m/s``, ``25 to 30 m/s``."""
        speeds = list(dict.fromkeys(f"{V:.6g}" for V in self.airspeeds))
        if self.route is None or len(speeds) > MAX_SPEEDS:
            ends = min(self.airspeeds), max(self.airspeeds)
            speeds = [" to ".join(dict.fromkeys(f"{V:.6g}" for V in ends))]
        return f"{listed(speeds)} m/s{self.assumed_words}"

    @property
    def assumed_words(self) -> str:
        """That the airspeed, or that of the start, is assumed; empty if it is stated."""
        if self.route is None or not self.route.airspeed_assumed:
            return ""
        changes = len({*self.airspeeds}) > 1
        return f" ({f'{self.airspeeds[0]:.6g} m/s at the start is ' * changes}assumed)"

    @cached_property
    def stated_reference(self) -> Reference:
        """The reference that its table states, in SI; `reference_of` has that of any scenario."""
        assert self.reference is not None  # else there is a route
        return self.reference.reference(self.flight)

    @property
    def feasible(self) -> bool:
        """Whether the reference is the fastest change within the limits."""
        return self.reference is not None and self.reference.shape == "feasible"

    def expected(self, plant: str, gains: str) -> list[ExpectTable]:
        """The requirements of a run of this plant and these gains."""
        return [table for table in self.expect if table.meant(plant, gains)]

    def check_over_time(self, what: str, *, airspeed: bool = False) -> None:
        """Refuse a route for what needs a reference over time, and an `airspeed` it cannot have."""
        if self.route is not None:
            raise InputError(f"`route` must be absent for {what}: it needs a reference over time.")
        if self.airspeed and not airspeed:
            raise InputError(
                f"`V_mps` of [reference] must be absent for {what}, which knows course and path "
                "angle alone; without it the aircraft holds its airspeed by itself."
            )

    def as_dict(self) -> dict[str, Any]:
        """The scenario as plain values, defaults filled in, as it would stand in a file."""
        return self.model_dump(mode="json", exclude_none=True)

    @property
    def sha256(self) -> str:
        """Hash of the scenario's values, the same for every way to write them."""
        return hash_of(self.as_dict())
