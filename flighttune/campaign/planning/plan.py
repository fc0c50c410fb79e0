"""A campaign ready to fly: gains as numbers, who flies what, and every draw on demand."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import pandas as pd

from flighttune.campaign.planning.check import acted, dispersed_places
from flighttune.campaign.planning.draws import SEED, cycle, drawn, factors
from flighttune.campaign.planning.places import Place, value_at, with_values
from flighttune.campaign.planning.plan_file import plan_differences, plan_fields, plan_tables
from flighttune.campaign.planning.schema import Campaign
from flighttune.control.gains import PIGains
from flighttune.errors import InputError
from flighttune.scenario.aircraft_check import check_aircraft
from flighttune.scenario.load import validated
from flighttune.scenario.schema import Scenario

BLOCK = 1024
"""Draws that are made at a time where they are asked for one by one."""


@dataclass(frozen=True, slots=True)
class Group:
    """Who flies: one plant with one gain set.

    Attributes
    ----------
    plant, gains : str
        Label of the plant, name of the gain set.
    """

    plant: str
    gains: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """What is flown in a campaign; the same plan gives the same draws to the bit anywhere.

    Run ``r`` is the flight of draw ``r // len(groups)`` by group ``r % len(groups)``: every draw is
    flown by every group, so that groups differ by nothing else.

    Attributes
    ----------
    campaign : Campaign
        The file, checked.
    gain_sets : mapping of str to PIGains or None
        By name; None where tuning found none.
    groups : tuple of Group
        Plant by plant; in wind aircraft first, as the other plants replay what they met.
    runs : int
        Flights in total.
    aircraft : mapping of str to str
        Hash of the files of every aircraft, by the name or folder in the scenario.

    Raises
    ------
    InputError
        If `runs` is not positive.
    """

    campaign: Campaign
    gain_sets: Mapping[str, PIGains | None]
    groups: tuple[Group, ...]
    runs: int
    aircraft: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise InputError(f"`runs` must be positive, got {self.runs}.")
        for name in ("gain_sets", "aircraft"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __getstate__(self) -> dict[str, Any]:
        made = {name: self.__dict__[name] for name in ("campaign", "groups", "runs")}
        return {**made, "gain_sets": dict(self.gain_sets), "aircraft": dict(self.aircraft)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.__post_init__()

    @property
    def scenario(self) -> Scenario:
        """The undispersed scenario, with the gains, plants and overrides of the campaign."""
        return self.campaign.nominal

    @property
    def keys(self) -> tuple[str, ...]:
        """The dispersed keys: columns of `parameters`."""
        return self.campaign.keys

    @property
    def draws(self) -> int:
        """Number of draws; the last one may be flown by the first groups alone."""
        return -(-self.runs // len(self.groups))

    @property
    def extendable(self) -> bool:
        """Whether draws do not depend on `runs`: a campaign of more runs begins with these."""
        return self.campaign.design != "latin_hypercube"

    @property
    def factors(self) -> tuple[str, ...]:
        """Factors of a Saltelli design in order of their blocks; none in other designs.

        The dispersed keys, and ``seed`` where chance plays a part in flight.
        """
        return factors(self.campaign)

    @cached_property
    def cycle(self) -> int:
        """Draws that belong together and are best flown together; a design has whole cycles.

        The cells of a grid; of a Saltelli design the blocks A, B and one a factor; else 1.
        """
        return cycle(self.campaign)

    def block_of(self, draw: int) -> str:
        """Block of a draw of a Saltelli design: ``A``, ``B``, or the factor that A takes from B."""
        return ("A", "B", *self.factors)[draw % self.cycle]

    def with_runs(self, runs: int) -> "Plan":
        """The same plan for another number of flights."""
        return replace(self, runs=runs)

    def with_gains_of(self, other: "Plan") -> "Plan":
        """The same plan with the gains as `other` has them, where they are of the same names.

        Tuning gives other last digits with another number of BLAS threads.
        """
        same = self.gain_sets.keys() == other.gain_sets.keys()
        return replace(self, gain_sets=other.gain_sets) if same else self

    def draw_of(self, run: int) -> int:
        """The draw that a run flies."""
        return run // len(self.groups)

    def group_of(self, run: int) -> Group:
        """The plant and gains of a run."""
        return self.groups[run % len(self.groups)]

    def parameters(self, first: int = 0, end: int | None = None) -> pd.DataFrame:
        """What is drawn for draws `first` to `end`.

        Parameters
        ----------
        first, end : int
            Draws wanted, `end` not among them; by default all.

        Returns
        -------
        DataFrame
            Index ``draw``; a column a dispersed key, in the unit of the key, and ``seed``. A key
            that ``adds`` or ``multiplies`` has here what is added or multiplied by.
        """
        end = self.draws if end is None else end
        return drawn(self.campaign, first, end, draws=self.draws)

    @cached_property
    def places(self) -> Mapping[str, tuple[Place, ...]]:
        """Every place in the scenario that a dispersed key means."""
        return dispersed_places(self.campaign.disperse, self.scenario, self.campaign.title)

    def values_of(self, draw: int) -> dict[str, Any]:
        """What is drawn for one draw, as plain values: by dispersed key, and ``seed``.

        Raises
        ------
        InputError
            If there is no such draw.
        """
        if not 0 <= draw < self.draws:
            raise InputError(f"`draw` must be 0 to {self.draws - 1}, got {draw}.")
        first, at = divmod(draw, BLOCK)
        if first not in self._blocks:
            end = min((first + 1) * BLOCK, self.draws)
            block = self.parameters(first * BLOCK, end)
            self._blocks.clear()
            self._blocks[first] = {name: column.tolist() for name, column in block.items()}
        return {name: column[at] for name, column in self._blocks[first].items()}

    @cached_property
    def _blocks(self) -> dict[int, dict[Any, list[Any]]]:
        return {}

    @cached_property
    def _tables(self) -> dict[str, Any]:
        return self.scenario.as_dict()

    @cached_property
    def _puts(self) -> tuple[tuple[str, Any, Place, Any], ...]:
        """Key, how it acts, place and the scenario's own value there."""
        return tuple(
            (table.key, table.acts, place, value_at(self._tables, place))
            for table in self.campaign.disperse
            for place in self.places[table.key]
        )

    def tables_of(self, draw: int) -> dict[str, Any]:
        """The scenario of a draw as the tables of a file, unchecked."""
        drawn = self.values_of(draw)
        put = [(place, acted(acts, drawn[key], own)) for key, acts, place, own in self._puts]
        return with_values(self._tables, [*put, ((SEED,), drawn[SEED])])

    def scenario_of(self, draw: int) -> Scenario:
        """The scenario of a draw.

        Raises
        ------
        ScenarioError
            If the scenario, or an aircraft, refuses a drawn value; the message names the keys.
        InputError
            If there is no such draw.
        """
        scenario = validated(Scenario, self.tables_of(draw), f"draw {draw}")
        check_aircraft(scenario, f"draw {draw}")
        return scenario

    def as_dict(self) -> dict[str, Any]:
        """The plan as plain values that JSON has words for; `plan_from` reads them."""
        return plan_tables(self)

    @cached_property
    def sha256(self) -> str:
        """Hash of the plan: the same for the same campaign, scenario, gains and aircraft."""
        text = json.dumps(self.as_dict(), sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()

    def differences(self, other: "Plan") -> tuple[str, ...]:
        """What of this plan is otherwise in a later one, a sentence each.

        Parameters
        ----------
        other : Plan
            The later one.

        Returns
        -------
        tuple of str
            ``key: was X, is Y``; empty where the two plan the same.
        """
        return plan_differences(self, other)


def plan_from(tables: Mapping[str, Any], source: str = "plan") -> Plan:
    """The plan that `Plan.as_dict` wrote, with the same bits.

    Parameters
    ----------
    tables : mapping
        As JSON gives them back.
    source : str
        The file they come from, or what else to call them.

    Raises
    ------
    ScenarioError
        If they are not a plan, or one of another version of the form.
    """
    fields = plan_fields(tables, source)
    groups = tuple(Group(plant=one["plant"], gains=one["gains"]) for one in fields.pop("groups"))
    return Plan(groups=groups, **fields)
