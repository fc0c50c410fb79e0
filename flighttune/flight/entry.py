"""An entry: one gain set by one law on one plant of a scenario, resolved once from names."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from flighttune.base.errors import InputError
from flighttune.control.gains import PIGains
from flighttune.control.law import Law
from flighttune.control.limits import Limits
from flighttune.flight import conditions
from flighttune.flight.own import with_own
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.plant_keys import PlantTable
from flighttune.vehicles.plants.base import FlightCondition


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """One gain set flown by one law on one plant of a scenario; each flight belongs to an entry."""

    scenario: Scenario
    plant: PlantTable
    law: Law
    gains: PIGains | None  # None if tuning found no gains
    name: str  # name of the gains in runs: ``tuned``, ``exact:tuned``

    @property
    def label(self) -> str:
        """``plant / gains``, as `Run.label`."""
        return f"{self.plant.label} / {self.name}"

    @property
    def listed(self) -> str:
        """Name of the gains without the law, as the scenario lists them."""
        return self.scenario.listed_as(self.name)

    @property
    def found_gains(self) -> PIGains:
        """Its gains; InputError if tuning found none."""
        if self.gains is None:
            raise InputError(
                f"`gains` must be there to fly, got none for {self.name}: its tuning was "
                "infeasible."
            )
        return self.gains

    @cached_property
    def limits(self) -> Limits:
        """Limits of the commands by the scenario and, for an aircraft, by its folder."""
        return conditions.limits_on(self.scenario, [self.plant])

    @property
    def reference(self) -> conditions.AnyReference:
        """The reference that the outer loop follows."""
        return conditions.reference_of(self.scenario)

    @property
    def condition(self) -> FlightCondition:
        """Condition in which the flight starts in its steady wind."""
        return conditions.start_condition(self.scenario)

    @cached_property
    def lead(self) -> tuple[float, float]:
        """Lags (s) of roll and lift behind their plan on the plant."""
        return conditions.lead_on(self.scenario, self.plant)

    @cached_property
    def wind_from(self) -> "Entry | None":
        """The aircraft whose wind the plant replays; None for an aircraft, or in still air."""
        source = self.scenario.wind_source
        if source is None or self.plant.aircraft is not None:
            return None
        return replace(self, plant=source)

    @property
    def own(self) -> tuple[tuple[str, str], ...]:
        """The part from a user's file: ``law`` or ``plant``, and its name."""
        flown = self.law.name, self.plant.label
        return tuple((key, table.name or "") for key, table in self.scenario.of_files(flown))

    def within(self, scenario: Scenario) -> "Entry":
        """The same plant, law and gains in another scenario that has them."""
        return entry_of(scenario, self.name, self.gains, self.plant.label)

    def bound(self, *parts: str) -> "Entry":
        """The entry with the user's class for its ``law`` or ``plant``, by default both."""
        names = {"law": self.law.name, "plant": self.plant.label}
        scenario = with_own(self.scenario, flown=[names[part] for part in parts or names])
        if scenario is self.scenario:
            return self
        laws = {table.name: table.law for table in scenario.law_tables}
        law, table = laws.get(self.law.name, self.law), scenario.plant_table(self.plant.label)
        return replace(self, scenario=scenario, law=law, plant=table)


def entry_of(
    scenario: Scenario, name: str, gains: PIGains | None, label: str | None = None
) -> Entry:
    """The entry of gains by their name in runs, on the plant of a label, by default the first."""
    law, _ = scenario.law_of(name, gains)
    table = scenario.plant[0] if label is None else scenario.plant_table(label)
    return Entry(scenario=scenario, plant=table, law=law, gains=gains, name=name)


def entries(scenario: Scenario, gain_sets: Mapping[str, PIGains | None]) -> tuple[Entry, ...]:
    """Every gain set on every plant, plant by plant."""
    first = [entry_of(scenario, name, gains) for name, gains in gain_sets.items()]
    return tuple(replace(entry, plant=table) for table in scenario.plant for entry in first)
