"""Whether a scenario can be flown at the median of everything that a campaign disperses."""

import re
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

from pydantic import ValidationError

from flighttune.campaign.planning.copula import factor
from flighttune.campaign.planning.disperse_table import Acts, DisperseTable
from flighttune.campaign.planning.places import Place, places_of, value_at, with_values
from flighttune.campaign.planning.schema import CampaignTable
from flighttune.errors import InputError, ScenarioError
from flighttune.scenario.aircraft_check import check_aircraft
from flighttune.scenario.schema import Scenario
from flighttune.scenario.sentence import mistakes

NOT_DISPERSED = {
    "plant.kind": "give each plant in a [[plant]]",
    "plant.aircraft": "give each aircraft in a [[plant]]",
    "plant.name": "it is what a plant is called",
    "seed": "every draw has a seed of its own",
    "gains": "give each gain set in `gains`",
    "tuning": "gains are tuned once, on the undispersed scenario",
    "envelope": "it is the range of a claim, and not flown",
    "expect": "what a run must come to is the same for all",
    "title": "it is for the reader",
    "verifies": "it is for the reader",
    "source": "it is for the reader",
}
"""Tables and keys of a scenario that differ for no draw, and why."""


def dispersed_places(
    tables: Sequence[DisperseTable], scenario: Scenario, source: str
) -> dict[str, tuple[Place, ...]]:
    """Every place that each dispersed key means.

    Parameters
    ----------
    tables : sequence of DisperseTable
    scenario : Scenario
        The undispersed one.
    source : str
        File of the campaign.

    Raises
    ------
    ScenarioError
        If a key is nowhere in the scenario, may not be dispersed, or is given twice.
    """
    values = scenario.as_dict()
    found: dict[str, tuple[Place, ...]] = {}
    for table in tables:
        where = f"{source}: [[disperse]] `{table.key}`"
        named = re.sub(r"\[[^\]]*\]", "", table.key)
        for fixed in {named, named.split(".")[0]} & set(NOT_DISPERSED):
            raise ScenarioError(f"{where} must not be dispersed: {NOT_DISPERSED[fixed]}.")
        try:
            places = places_of(table.key, values, _probe(table))
        except InputError as error:
            raise ScenarioError(f"{where} {_stopped(error)}") from None
        for other, theirs in found.items():
            if any(_overlap(mine, theirs_one) for mine in places for theirs_one in theirs):
                raise ScenarioError(f"{where} must be dispersed once, but `{other}` means it too.")
        for place in places if table.acts != "sets" else ():
            own = value_at(values, place)
            if isinstance(own, bool) or not isinstance(own, (int, float)):
                raise ScenarioError(
                    f"{where} must be a number in the scenario for `acts` {table.acts!r}, "
                    f"got {'nothing' if own is None else repr(own)}."
                )
        found[table.key] = places
    return found


def acted(acts: Acts, value: Any, own: Any) -> Any:
    """What a drawn value makes of the scenario's own.

    Parameters
    ----------
    acts : {"sets", "adds", "multiplies"}
    value : plain value
        Drawn; a number where it does not set.
    own : plain value or None
        What the undispersed scenario has; a number where it is not set.
    """
    match acts:
        case "sets":
            return value
        case "adds":
            return own + value
        case "multiplies":
            return own * value


def check_dispersions(table: CampaignTable, nominal: Scenario, source: str) -> Scenario:
    """The scenario at the median of everything dispersed.

    Parameters
    ----------
    table : CampaignTable
    nominal : Scenario
        The undispersed one.
    source : str
        File of the campaign.

    Raises
    ------
    ScenarioError
        If the scenario refuses a median, or keys or correlations cannot be what they say.
    """
    _check_correlations(table, source)
    places = dispersed_places(table.disperse, nominal, source)
    central = _at_medians(table.disperse, nominal, places)
    if isinstance(central, str):
        guilty = _guilty(table.disperse, nominal, places)
        raise ScenarioError(_refused(source, guilty, central))
    return central


def _at_medians(
    tables: Sequence[DisperseTable], nominal: Scenario, places: Mapping[str, tuple[Place, ...]]
) -> Scenario | str:
    """The scenario, or what is wrong with it."""
    values = nominal.as_dict()
    put = [
        (place, acted(table.acts, table.of().central, value_at(values, place)))
        for table in tables
        for place in places[table.key]
    ]
    try:
        scenario = Scenario.model_validate(with_values(values, put))
        check_aircraft(scenario, "")
    except ValidationError as error:
        return mistakes(error, Scenario)
    except ScenarioError as error:
        return str(error).removeprefix(": ")
    return scenario


def _guilty(
    tables: Sequence[DisperseTable], nominal: Scenario, places: Mapping[str, tuple[Place, ...]]
) -> Sequence[DisperseTable]:
    """Those of which each alone must go for the flight to be possible, or a pair that must, or all.

    More than one that alone must go are those that clash with each other.
    """

    def possible_without(guilty: Sequence[DisperseTable]) -> bool:
        rest = [one for one in tables if one not in guilty]
        return not isinstance(_at_medians(rest, nominal, places), str)

    alone = [one for one in tables if possible_without([one])]
    pairs = () if alone else combinations(tables, 2)
    return alone or next((pair for pair in pairs if possible_without(pair)), tables)


def _refused(source: str, guilty: Sequence[DisperseTable], says: str) -> str:
    named = ", ".join(f"`{table.key}`" for table in guilty)
    if "is not a known key" in says:
        return f"{source}: [[disperse]] {named} must be a key of the scenario: {says}"
    medians = ", ".join(repr(table.of().central) for table in guilty)
    return f"{source}: [[disperse]] {named}: the scenario refuses the median {medians}: {says}"


def _check_correlations(table: CampaignTable, source: str) -> None:
    kinds = {one.key: one.distribution for one in table.disperse}
    seen: set[frozenset[str]] = set()
    for one in table.correlation:
        for key in one.keys:
            if kinds.get(key) not in ("normal", "log_normal", "uniform"):
                raise ScenarioError(
                    f"{source}: [[correlation]] `keys` must be dispersed with normal, log_normal "
                    f"or uniform, got {key!r} with {kinds.get(key, 'none')}."
                )
        if frozenset(one.keys) in seen:
            raise ScenarioError(
                f"{source}: [[correlation]] `keys` must be given once, got {one.keys} twice."
            )
        seen.add(frozenset(one.keys))
    try:
        factor(table.correlation)
    except InputError as error:
        raise ScenarioError(f"{source}: {error}.") from None


def _stopped(error: InputError) -> str:
    """What an error says, with a full stop unless it asks something."""
    return str(error) if str(error).endswith("?") else f"{error}."


def _probe(table: DisperseTable) -> Any:
    """A value by which to see which plants have a key."""
    central = table.of().central
    if table.acts == "sets" or not isinstance(central, (int, float)):
        return central
    return 1.0 if table.acts == "multiplies" else 0.0


def _overlap(a: Place, b: Place) -> bool:
    shorter = min(len(a), len(b))
    return a[:shorter] == b[:shorter]
