"""A scenario: the tables of its file, checked against each other."""

import math
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import Any, Self

from pydantic import model_validator

from flighttune.base.errors import FlightTuneError, InputError
from flighttune.base.files.table import abridged, hash_of, refused_in_a_line
from flighttune.base.words import listed
from flighttune.control.gains import PIGains
from flighttune.control.gains_keys import GainsTable, on_aircraft
from flighttune.control.law import Law, made_law, split_name
from flighttune.control.law_keys import LAWS, LawTable, law_named
from flighttune.flight.requirement_keys import ExpectTable
from flighttune.flight.scenario.keys import ScenarioKeys
from flighttune.flight.scenario.rules import ROUNDING, RULES
from flighttune.routes.segments import Reference
from flighttune.routes.turn_back_keys import TurnBackTable
from flighttune.vehicles.identification.file import IdentifiedAircraft, load_identified
from flighttune.vehicles.plant_keys import PlantTable, flown_aircraft
from flighttune.vehicles.plants.sensors import Sensors

# Maximum number of airspeeds along a route to list one by one.
MAX_SPEEDS = 4


@refused_in_a_line
class Scenario(ScenarioKeys):
    """One manoeuvre: every gain set flies on every plant.

    Examples
    --------
    >>> scenario = ft.load_scenario("paper")
    >>> [plant.label for plant in scenario.plant], scenario.gain_names
    (['kinematic', 'jsbsim:aerosonde'], ('paper', 'tuned'))
    """

    @model_validator(mode="before")
    @classmethod
    def _turned_back(cls, values: Any) -> Any:
        if not (isinstance(values, Mapping) and values.get("turn_back")):
            return values
        return TurnBackTable.model_validate(values["turn_back"]).followed(values)

    @model_validator(mode="after")
    def _keeps_the_rules(self) -> Self:
        for refusal in chain.from_iterable(rule(self) for rule in RULES):
            raise ValueError(refusal)
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
        """A sentence for gains flown on another aircraft or airspeed, and `assumptions`.

        For one `plant` and one of `gain_names`, by default all.
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
        """Assumptions of its identified models and gains, one sentence each."""
        sentences = [*(self.assumed or ())]
        named = [self] if self.tuning.identified else []
        for table in (*named, *(x for x in self.plant if x.identified or x.aircraft)):
            with suppress(FlightTuneError):  # on another machine the file may be missing
                sentences += table.identified_model.assumptions
        for entry in self.gains:
            if isinstance(entry, GainsTable) and entry.tuned_for:
                sentences += entry.tuned_for.assumed or ()
        return tuple(dict.fromkeys(sentences))

    def assuming(self) -> "Scenario":
        """The scenario with its assumptions written in, so that recordings keep them."""
        if (found := [*self.assumptions]) == (self.assumed or []):
            return self
        return self.model_copy(update={"assumed": found})

    @property
    def code(self) -> tuple[str, ...]:
        """Python files of its laws and plants, which run in its flights."""
        return tuple(dict.fromkeys(table.module or "" for _, table in self.of_files()))

    def of_files(
        self, flown: Collection[str] | None = None
    ) -> tuple[tuple[str, LawTable | PlantTable], ...]:
        """Laws and plants in Python files, by key; only those `flown`, by name, or all."""
        listed = (*(("law", x) for x in self.law_tables), *(("plant", x) for x in self.plant))
        own = ((key, x) for key, x in listed if x.module)
        return tuple((key, x) for key, x in own if flown is None or x.name in flown)

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
        """A gain set of `gain_names` without the law, as in ``gains``."""
        return self._split(name)[1]

    def _split(self, name: str) -> tuple[str, str]:
        return split_name(name, [table.name for table in self.law_tables])

    def law_of(self, name: str, gains: PIGains | None = None) -> tuple[Law, str]:
        """The law that flies a gain set of `gain_names`, and the gain set's name in ``gains``."""
        law = self.law_table(name).law
        if gains is not None and law.by_gains and gains.inputs[:2] != law.inputs:
            law = self.law_for(gains)
        return law, self.listed_as(name)

    def law_for(self, gains: PIGains) -> Law:
        """The first law of the scenario that accepts gains unchanged, else their own law."""
        fitting = (law for law in self.laws if law.by_gains and law.inputs == gains.inputs[:2])
        return next(fitting, None) or made_law(gains.law)

    def plant_table(self, label: str) -> PlantTable:
        """The table of one of its plants."""
        plants = {table.label: table for table in self.plant}
        if label not in plants:
            raise InputError(f"`plant` must be one of {', '.join(plants)}, got {label}.")
        return plants[label]

    def sensors_on(self, label: str) -> Sensors | None:
        """Errors of the sensors on a plant, including a failure in flight; None if exact."""
        sensors = self.sensors and self.sensors.sensors(self.seed)
        airframe = next((table.airframe for table in self.plant if table.label == label), None)
        fault = airframe and airframe.fault
        if not (fault and fault.V_a_bias_mps):
            return sensors
        return replace(sensors or Sensors(), late=(fault.from_s, fault.V_a_bias_mps))

    @property
    def calm(self) -> bool:
        """Whether commands are undisturbed by air and errors of sensors."""
        seen = self.sensors or self.navigation
        return not (self.turbulence or self.gust or seen or self.disturbance)

    @cached_property
    def identified_model(self) -> IdentifiedAircraft:
        """The identified model for tuning, read once."""
        return load_identified(self.identified_name)

    @property
    def wind_source(self) -> PlantTable | None:
        """The plant whose wind plants without weather replay: the first aircraft in wind."""
        return self.aircraft[0] if self.windy and self.aircraft else None

    @property
    def air(self) -> str:
        """The air of the flight, in words."""
        air = {
            "wind": self.wind,
            "an oscillating wind": self.swinging,
            "a gust": self.gust,
            "turbulence": self.turbulence,
        }
        weather = listed([name for name, table in air.items() if table]) or "calm air"
        still = self.disturbance and not self.swinging
        return f"{weather}, with a disturbance" if still else weather

    @property
    def rolls_in(self) -> bool:
        """Whether a ramp of its reference rolls in, so that roll and lift are planned."""
        return self.reference is not None and bool(self.reference.ramps_in)

    @property
    def speed_priority(self) -> bool:
        """Whether the path angle of an aircraft gives way to its airspeed."""
        return self.airspeed or bool(self.controller.speed_priority)

    @property
    def airspeeds(self) -> tuple[float, ...]:
        """Commanded airspeeds, m/s, beginning with the start."""
        start, route = self.flight.V_a_mps, self.route
        if self.turn_back is not None:
            return (start, *(place.V_a_mps for place in self.turn_back.place))
        if route is not None:  # no flight continues after the last waypoint
            return (start, *(V for i, V in route.airspeeds.items() if i < len(route.waypoint)))
        if self.reference is None or not self.airspeed:
            return (start,)
        return (start, *self.reference.airspeeds(self.flight))

    @property
    def airspeed_words(self) -> str:
        """Commanded airspeeds in words: ``25 m/s``, ``20, 27 and 23 m/s``, ``25 to 30 m/s``."""
        speeds = list(dict.fromkeys(f"{V:.6g}" for V in self.airspeeds))
        if self.route is None or len(speeds) > MAX_SPEEDS:
            ends = min(self.airspeeds), max(self.airspeeds)
            speeds = [" to ".join(dict.fromkeys(f"{V:.6g}" for V in ends))]
        return f"{listed(speeds)} m/s{self.assumed_words}"

    @property
    def assumed_words(self) -> str:
        """Words for an assumed airspeed, or start airspeed; empty if it is stated."""
        if self.route is None or not self.route.airspeed_assumed:
            return ""
        changes = len({*self.airspeeds}) > 1
        return f" ({f'{self.airspeeds[0]:.6g} m/s at the start is ' * changes}assumed)"

    @cached_property
    def stated_reference(self) -> Reference:
        """The reference from its table, in SI; `reference_of` works for any scenario."""
        assert self.reference is not None  # a scenario without it has a route
        return self.reference.reference(self.flight)

    @property
    def feasible(self) -> bool:
        """Whether the reference is the fastest change within the limits."""
        return self.reference is not None and self.reference.shape == "feasible"

    def expected(self, plant: str, gains: str) -> list[ExpectTable]:
        """The requirements of a run of this plant and these gains."""
        return [table for table in self.expect if table.meant(plant, gains)]

    def check_over_time(self, what: str, *, airspeed: bool = False) -> None:
        """Refuse a route if a reference over time is needed, and an unsupported `airspeed`."""
        if self.route is not None:
            raise InputError(f"`route` must be absent for {what}: it needs a reference over time.")
        if self.airspeed and not airspeed:
            raise InputError(
                f"`V_mps` of [reference] must be absent for {what}, which knows course and path "
                "angle alone; without it the aircraft holds its airspeed by itself."
            )

    def as_dict(self) -> dict[str, Any]:
        """The scenario as plain values with defaults, as in a file."""
        return self.model_dump(mode="json", exclude_none=True)

    @property
    def sha256(self) -> str:
        """Hash of the scenario's values, independent of their notation."""
        return hash_of(self.as_dict())
