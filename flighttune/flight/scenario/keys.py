"""The tables of a scenario, joined."""

from typing import Annotated

from pydantic import Field

from flighttune.base.errors import InputError
from flighttune.base.quantities import Table
from flighttune.control.controller_keys import ControllerTable, EnvelopeTable, LimitsTable
from flighttune.control.gains_keys import TUNED, GainsTable
from flighttune.control.law import DEFAULT, Law
from flighttune.control.law_keys import Laws, LawTable, law_named
from flighttune.control.tuning.tuning_keys import TuningTable
from flighttune.flight.loop.disturbance_keys import DisturbanceTable
from flighttune.flight.requirement_keys import ExpectTable
from flighttune.routes.reference_keys import ReferenceTable
from flighttune.routes.route_keys import RouteTable
from flighttune.routes.turn_back_keys import TurnBackTable
from flighttune.vehicles.flight_keys import FlightTable
from flighttune.vehicles.navigation_keys import NavigationTable, SensorsTable
from flighttune.vehicles.plant_keys import PlantTable
from flighttune.vehicles.weather_keys import GustTable, Seed, TurbulenceTable, WindTable


class ScenarioKeys(Table):
    """The keys of a scenario, and values that follow from keys alone."""

    title: Annotated[str, Field(min_length=1)]
    verifies: str = ""  # for the reader
    source: str = ""  # for the reader
    seed: Seed = 0  # seed of turbulence, sensor noise and tuning
    # The laws: a name, or a list of names or tables; the paper's law if left out
    law: Laws | None = None
    # names (paper, K1 to K6, tuned, tuned_identified, tuned_fed_back, tuned_gentle), files beside
    # the scenario, or tables
    gains: list[str | GainsTable] = Field(default_factory=lambda: ["paper", TUNED], min_length=1)
    flight: FlightTable
    reference: ReferenceTable | None = None
    route: RouteTable | None = None
    # Written by `flighttune mission --turn-back` instead of a route or a reference
    turn_back: TurnBackTable | None = None
    limits: LimitsTable = LimitsTable()  # limits of the commands
    controller: ControllerTable = ControllerTable()
    tuning: TuningTable = TuningTable()
    disturbance: DisturbanceTable | None = None  # the paper's disturbance, on the kinematic law
    wind: WindTable | None = None
    gust: GustTable | None = None
    turbulence: TurbulenceTable | None = None
    sensors: SensorsTable | None = None
    # What the autopilot knows of its motion; by default it knows its motion exactly
    navigation: NavigationTable | None = None
    # Ranges of flight over which `certify --envelope` seeks one proof
    envelope: EnvelopeTable | None = None
    expect: list[ExpectTable] = Field(default_factory=list)  # requirements for the runs
    # Assumptions of its identified models, as sentences; written by the program
    assumed: list[str] | None = None
    plant: Annotated[list[PlantTable], Field(min_length=1)]

    @property
    def law_tables(self) -> tuple[LawTable, ...]:
        """The tables of the flown laws, in order; by default the paper's law."""
        return tuple(self.law or (law_named(DEFAULT),))

    @property
    def laws(self) -> tuple[Law, ...]:
        """The flown laws, in order; by default the paper's law."""
        return tuple(table.law for table in self.law_tables)

    @property
    def gain_names(self) -> tuple[str, ...]:
        """Names of the flown gain sets, law by law; LAW:GAINS unless the law is the paper's."""
        listed = tuple(entry if isinstance(entry, str) else entry.name for entry in self.gains)
        return tuple(name for law in self.laws for name in law.names_of(listed))

    @property
    def aircraft(self) -> tuple[PlantTable, ...]:
        """Its plants that are aircraft, in order."""
        return tuple(plant for plant in self.plant if plant.aircraft is not None)

    @property
    def identified_name(self) -> str:
        """The aircraft or file that [tuning] names for its model, else the first plant's."""
        if self.tuning.identified is not None:
            return self.tuning.identified
        identified = (*self.aircraft, *(plant for plant in self.plant if plant.identified))
        if not identified:
            raise InputError(
                "`identified` of [tuning] must be given: no plant is an aircraft, got nothing"
            )
        return identified[0].aircraft or identified[0].identified or ""

    @property
    def windy(self) -> bool:
        """Whether the air moves on every plant, by [wind], [gust] or [turbulence]."""
        return any((self.wind, self.gust, self.turbulence))

    @property
    def airspeed(self) -> bool:
        """Whether the airspeed is a third channel, held by n_x."""
        if self.route is not None:
            return bool(self.route.holds_airspeed)
        return self.reference is not None and self.reference.V_mps is not None

    @property
    def swinging(self) -> bool:
        """Whether the disturbance is flown as an oscillating wind."""
        return self.disturbance is not None and self.disturbance.as_wind
