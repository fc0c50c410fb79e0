"""A campaign ready to fly: gains as numbers, groups of plant and gains, and draws on demand."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from flighttune.base.arguments import checked_class
from flighttune.base.errors import InfeasibleError, InputError, RecordingError, ScenarioError
from flighttune.base.files.load import CAMPAIGN
from flighttune.base.files.table import abridged, hash_of, json_tables, validated
from flighttune.base.quantities import Table
from flighttune.base.words import listed
from flighttune.campaigns.planning.draws import cycle, dispersed_places, drawn, with_drawn
from flighttune.campaigns.planning.schema import Campaign, CampaignTable
from flighttune.control.gains import PIGains
from flighttune.control.gains_keys import TUNED, TUNED_FOR_AIRCRAFT, default_gains
from flighttune.flight.entry import Entry, entry_of
from flighttune.flight.load import check_scenario
from flighttune.flight.models import gain_sets
from flighttune.flight.scenario.load import Place, as_recorded, leaves, with_values
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.aircraft.aircraft import files_hash

# Version of a plan's plain values; other versions are refused
VERSION = 1

# The file of the plan in the folder of a campaign, and the version of such folders
FORMAT = 3

TUNED_SETS = TUNED, *TUNED_FOR_AIRCRAFT

# Largest difference between two tunings of the same problem, as a share of the largest gain
TUNING_ROUNDING = 1e-6

# Number of draws made at once when they are requested one by one
BLOCK = 1024


class Group(NamedTuple):
    """Flights of one plant with one gain set."""

    plant: str  # label
    gains: str  # name of the gain set

    @property
    def label(self) -> str:
        """``plant / gains``, as `Run.label`."""
        return f"{self.plant} / {self.gains}"


def draws_in_words(flights: int, groups: Sequence[Group]) -> str:
    """A number of flights in words: ``7.5 draws, each by 4 gain sets on 2 plants``."""
    plants, gains = map(set, zip(*groups, strict=True))
    counts = {"draw": round(flights / len(groups), 1), "gain set": len(gains), "plant": len(plants)}
    draws, sets, on = (f"{n:.12g} {what}{'s' * (n != 1)}" for what, n in counts.items())
    return f"{draws}, each by {sets} on {on}"


@checked_class
@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Flights of a campaign; the same plan gives the same draws on any machine, to the bit.

    Run ``r`` is the flight of draw ``r // len(groups)`` by group ``r % len(groups)``. Every group
    flies every draw, so that groups differ in nothing else.

    Attributes
    ----------
    campaign : Campaign
        The file, checked.
    gain_sets : mapping of str to PIGains or None
        Gain sets by name; None where tuning was infeasible.
    groups : tuple of Group
        Plant by plant; in wind aircraft first, because the other plants replay their wind.
    runs : int
        Flights in total.
    aircraft : mapping of str to str
        Hash of the files of every aircraft, by its name or folder in the scenario.

    Raises
    ------
    InputError
        If `runs` is not positive.

    Examples
    --------
    >>> plan = ft.plan_campaign(ft.load_campaign("first_campaign"))
    >>> plan.parameters(0, 3).shape
    (3, 5)
    """

    campaign: Campaign
    gain_sets: Mapping[str, PIGains | None]
    groups: tuple[Group, ...]
    runs: int
    aircraft: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise InputError(f"`runs` must be positive, got {self.runs}.")

    @property
    def scenario(self) -> Scenario:
        """The undispersed scenario, with the gains, plants and overrides of the campaign."""
        return self.campaign.nominal

    @property
    def code(self) -> tuple[str, ...]:
        """Python files of its laws and plants, which run during its flights."""
        listed = self.scenario.of_files(self.flown)
        return tuple(dict.fromkeys(table.module or "" for _, table in listed))

    @property
    def flown(self) -> frozenset[str]:
        """Names of its laws and labels of its plants, if a group flies them."""
        laws = {self.entry(group).law.name for group in self.groups}
        return frozenset(laws | {group.plant for group in self.groups})

    @property
    def keys(self) -> tuple[str, ...]:
        """The dispersed keys: columns of `parameters`."""
        return self.campaign.keys

    @property
    def draws(self) -> int:
        """Number of draws; only the first groups may fly the last draw."""
        return -(-self.runs // len(self.groups))

    @property
    def extendable(self) -> bool:
        """Whether draws are independent of `runs`: a longer campaign begins with the same draws."""
        return self.campaign.design != "latin_hypercube"

    @cached_property
    def cycle(self) -> int:
        """Number of draws that belong together: one per cell of a grid, else 1."""
        return cycle(self.campaign)

    def chosen_group(self, plant: str | None, gains: str | None) -> Group:
        """The requested group; by default the first plant with its default gains."""
        plants = [table.label for table in self.scenario.plant]
        chosen = plant or plants[0]
        if chosen not in plants:
            raise InputError(f"`plant` must be one of {', '.join(plants)}, got {plant}.")
        names = list(self.gain_sets)
        name = gains or default_gains(names)
        if self.gain_sets.get(name) is None:
            got = f"{name!r}, which tuning did not find" if name in names else repr(name)
            raise InputError(f"`gains` must be one of {', '.join(names)}, got {got}.")
        return Group(chosen, name)

    def entry(self, group: Group, scenario: Scenario | None = None) -> Entry:
        """A group in the scenario of a draw, by default in the undispersed scenario."""
        entry = _entry(self, group)
        return entry if scenario is None else entry.within(scenario)

    def of_group(self, group: Group) -> "Plan":
        """The same plan restricted to one of its groups."""
        return replace(self, groups=(group,), gain_sets={group.gains: self.gain_sets[group.gains]})

    def with_runs(self, runs: int) -> "Plan":
        """The same plan with another number of flights."""
        return replace(self, runs=runs)

    def with_seed(self, seed: int | None) -> "Plan":
        """The same plan with draws of another seed; None: no change."""
        if seed is None:
            return self
        return replace(self, campaign=self.campaign.model_copy(update={"seed": seed}))

    def with_tuned_gains_of(self, other: "Plan") -> "Plan":
        """The same plan with the tuned gains of `other` if they agree to rounding."""
        # The last digits of tuned gains depend on the number of BLAS threads.
        gain_sets = dict(self.gain_sets)
        for name, mine in self.gain_sets.items():
            theirs, tuned = other.gain_sets.get(name), name.rpartition(":")[2] in TUNED_SETS
            if tuned and mine is not None and theirs is not None:
                close = TUNING_ROUNDING * np.abs(mine.K).max()
                if np.allclose(mine.numbers, theirs.numbers, 0.0, close):
                    gain_sets[name] = theirs
        return replace(self, gain_sets=gain_sets)

    def draw_of(self, run: int) -> int:
        """The draw that a run flies."""
        return run // len(self.groups)

    def group_of(self, run: int) -> Group:
        """The plant and gains of a run."""
        return self.groups[run % len(self.groups)]

    def parameters(self, first: int = 0, end: int | None = None) -> pd.DataFrame:
        """Drawn values of draws `first` up to, but not including, `end`; by default of all draws.

        Columns are the dispersed keys, in their units, and ``seed``; a key that ``adds`` or
        ``multiplies`` has the addends or the factors.
        """
        end = self.draws if end is None else end
        return drawn(self.campaign, first, end, draws=self.draws)

    @cached_property
    def places(self) -> Mapping[str, tuple[Place, ...]]:
        """The places in the scenario that each dispersed key refers to."""
        return dispersed_places(self.campaign.disperse, self.scenario, self.campaign.title)

    def values_of(self, draw: int) -> dict[str, Any]:
        """Drawn values of one draw by dispersed key, and its ``seed``, as plain values."""
        if not 0 <= draw < self.draws:
            raise InputError(f"`draw` must be 0 to {self.draws - 1}, got {draw}.")
        block, place = divmod(draw, BLOCK)
        return dict(_block(self, block)[place])

    @cached_property
    def _tables(self) -> dict[str, Any]:
        return self.scenario.as_dict()

    def dispersed(self, drawn: Mapping[str, Any], draw: int) -> Scenario:
        """The scenario with drawn values in it; `draw` is named in errors."""
        tables = with_drawn(self._tables, self.campaign.disperse, self.places, drawn)
        # the seed, and keys that only a search sets, such as switching times of a disturbance
        others = [key for key in drawn if key not in self.places]
        tables = with_values(tables, [((*key.split("."),), drawn[key]) for key in others])
        if self.scenario.turn_back is None:  # these may change any table
            for key, table in tables.items():
                if table is self._tables.get(key):  # it has been checked before
                    tables[key] = getattr(self.scenario, key)
        scenario = validated(Scenario, tables, f"draw {draw}")
        check_scenario(scenario, f"draw {draw}")
        return scenario

    def scenario_of(self, draw: int) -> Scenario:
        """The scenario of a draw."""
        return self.dispersed(self.values_of(draw), draw)

    def as_dict(self) -> dict[str, Any]:
        """The plan as plain values for JSON; `plan_from` reads them."""
        return {
            "version": VERSION,
            "runs": self.runs,
            "groups": [group._asdict() for group in self.groups],
            "gains": {
                name: None if gains is None else gains.as_lists()
                for name, gains in self.gain_sets.items()
            },
            "aircraft": self.aircraft,
            "campaign": plain(self.campaign),
            "nominal": plain(self.campaign.nominal),
            "central": plain(self.campaign.central),
        }

    @cached_property
    def sha256(self) -> str:
        """Hash of the plan: the same for the same campaign, scenario, gains and aircraft."""
        return hash_of(self.as_dict())

    def differences(self, other: "Plan") -> tuple[str, ...]:
        """Changes from this plan to a later plan, as ``key: was X, is Y``; empty if equal."""
        was, now = _leaves(self), _leaves(other)
        pairs = {key: (was.get(key), now.get(key)) for key in was | now}
        return tuple(
            f"{key}: was {abridged(then) if key in was else 'not given'}, "
            f"is {abridged(later) if key in now else 'not given'}"
            for key, (then, later) in pairs.items()
            if repr(then) != repr(later)
        )


@lru_cache(maxsize=1)
def _block(plan: Plan, block: int) -> list[dict[Any, Any]]:
    """Drawn values of `BLOCK` draws of a plan."""
    first = block * BLOCK
    return plan.parameters(first, min(first + BLOCK, plan.draws)).to_dict("records")


def plan_campaign(campaign: Campaign, *, runs: int | None = None) -> Plan:
    """Tune the gains of a campaign and form its groups.

    Parameters
    ----------
    campaign : Campaign
        The campaign that `load_campaign` returns.
    runs : int, optional
        Total number of flights; by default from the file, or one flight per cell and group of a
        grid.

    Returns
    -------
    Plan
        A gain set that tuning did not find is None; the status of its runs reports this.

    Raises
    ------
    InputError, ScenarioError
        If `runs` is not positive, or an identified model is needed and missing.
    InfeasibleError
        If tuning finds none of the gain sets.

    Examples
    --------
    >>> plan = ft.plan_campaign(ft.load_campaign("first_campaign"), runs=20)
    >>> plan.draws, len(plan.groups)
    (5, 4)
    """
    scenario = campaign.nominal
    sets, tuning = gain_sets(scenario)
    if all(gains is None for gains in sets.values()):  # known before any flight
        why = f": {tuning.reason.removesuffix('.')}" if tuning and tuning.reason else ""
        raise InfeasibleError(
            f"{campaign.title}: `gains` must be feasible: tuning found no {listed([*sets], 'or')}"
            f"{why}."
        )
    windy = campaign.central.windy  # aircraft then fly first; others replay their wind
    plants = sorted(scenario.plant, key=lambda plant: windy and plant.aircraft is None)
    groups = tuple(Group(plant.label, name) for plant in plants for name in scenario.gain_names)
    if runs is None:
        runs = campaign.runs or cycle(campaign) * len(groups)
    hashes = aircraft_hashes(scenario)
    return Plan(campaign=campaign, gain_sets=sets, groups=groups, runs=runs, aircraft=hashes)


@lru_cache(maxsize=64)  # cached, since every draw needs it
def _entry(plan: Plan, group: Group) -> Entry:
    return entry_of(plan.scenario, group.gains, plan.gain_sets[group.gains], group.plant)


def aircraft_hashes(scenario: Scenario) -> dict[str, str]:
    """Hash of the files of each aircraft of a scenario."""
    names = {plant.aircraft for plant in scenario.plant if plant.aircraft is not None}
    return {name: files_hash(name) for name in sorted(names)}


def plan_from(tables: Mapping[str, Any], source: str = "plan") -> Plan:
    """The plan that `Plan.as_dict` wrote, to the bit; `source` names its file in errors."""
    if tables.get("version") != VERSION:
        got = abridged(tables.get("version"))
        raise ScenarioError(f"{source}: `version` of a plan must be {VERSION}, got {got}.")
    nominal, central = (
        validated(Scenario, as_recorded(tables[key]), source) for key in ("nominal", "central")
    )
    table = validated(CampaignTable, tables["campaign"], source)
    return Plan(
        campaign=Campaign.of(table, nominal=nominal, central=central),
        gain_sets={
            name: None if lists is None else PIGains.from_lists(**lists)
            for name, lists in tables["gains"].items()
        },
        groups=tuple(Group(**group) for group in tables["groups"]),
        runs=tables["runs"],
        aircraft={**tables["aircraft"]},
    )


def recorded_plan(folder: str | Path) -> tuple[Plan, dict[str, str]]:
    """The plan in a campaign's folder, and versions of the libraries that affect its rows."""
    path = Path(folder) / CAMPAIGN
    if not os.path.exists(path):
        raise RecordingError(f"{folder}: must hold a campaign, got no {CAMPAIGN}.")
    try:
        tables = json_tables(path)
        if tables.get("format") != FORMAT:
            raise RecordingError(
                f"{path}: `format` must be {FORMAT}, got {abridged(tables.get('format'))}: fly the "
                "campaign again with this version."
            )
        if tables.pop("sha256", None) != hash_of(tables):
            raise RecordingError(
                f"{path}: the file must be as it was written, but its hash differs: fly the "
                "campaign again."
            )
        return plan_from(tables["plan"], str(path)), tables["versions"]
    except ScenarioError as error:
        raise RecordingError(str(error)) from error


def plain(table: Table) -> dict[str, Any]:
    """The tables of a campaign or scenario as plain values, without defaults of None."""
    # `Plan.as_dict` writes the two scenarios of a campaign separately
    return table.model_dump(mode="python", exclude={"nominal", "central"}, exclude_none=True)


def _leaves(plan: Plan) -> dict[str, Any]:
    """Values of a plan that affect its rows, by name."""
    tables = plan.as_dict()
    campaign, scenario = tables["campaign"], tables["nominal"]
    campaign["disperse"] = {table["key"]: table for table in campaign["disperse"]}
    for name in ("runs", "title", "verifies", "source"):  # the last three are only notes for people
        campaign.pop(name, None)
        scenario.pop(name, None)
    return {
        "runs": plan.runs,
        **dict(leaves(campaign)),
        **dict(leaves(scenario, "scenario.")),
        **dict(leaves(tables["gains"], "gains as numbers, ")),
        **dict(leaves(plan.aircraft, "files of aircraft ")),
    }
