"""A campaign file to a campaign that has been checked against its scenario."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from flighttune.campaign.planning.check import check_dispersions
from flighttune.campaign.planning.disperse_table import DisperseTable
from flighttune.campaign.planning.places import places_of, with_values
from flighttune.campaign.planning.schema import Campaign, CampaignTable
from flighttune.errors import InputError, ScenarioError
from flighttune.scenario.aircraft_check import check_aircraft, check_identified
from flighttune.scenario.load import load_scenario, toml_tables, validated
from flighttune.scenario.plant_table import PlantTable
from flighttune.scenario.schema import Scenario
from flighttune.shipped import campaign_file, campaign_names, scenario_file, scenario_names


def load_campaign(path: str | Path) -> Campaign:
    """Read and check a campaign file.

    Parameters
    ----------
    path : path-like
        A TOML file, or the name of a campaign that ships with the package.

    Returns
    -------
    Campaign
        Frozen and valid: at the median of everything dispersed the scenario can be flown.

    Raises
    ------
    ScenarioError
        If the file or its scenario cannot be read, a key is unknown, missing or impossible, or the
        scenario refuses a dispersion. One line that names file and key.
    """
    file = _existing(path)
    tables = toml_tables(file)
    for table in tables.get("disperse", []) if isinstance(tables.get("disperse"), list) else []:
        key = table.get("key") if isinstance(table, Mapping) else None
        if isinstance(key, str):
            validated(DisperseTable, table, f"{file}: [[disperse]] `{key}`")
    table = validated(CampaignTable, tables, str(file))
    base = load_scenario(_scenario_of(table.scenario, file))
    nominal = _nominal(table, base, str(file))
    central = check_dispersions(table, nominal, str(file))
    return Campaign.of(table, nominal=nominal, central=central)


def _existing(path: str | Path) -> Path:
    found = Path(path)
    if found.is_file():
        return found
    name = found.name.removesuffix(".toml")
    if name in campaign_names() and found.parent in (
        Path(), Path("campaigns"), Path("scenarios/campaigns")
    ):  # fmt: skip
        return campaign_file(name)
    raise ScenarioError(
        f"{path}: the campaign must be a file or one of {', '.join(campaign_names())}; "
        "there is no such file."
    )


def _scenario_of(name: str, file: Path) -> Path:
    """The file of a campaign's scenario: beside the campaign, or shipped."""
    for beside in (file.parent / name, file.parent / f"{name}.toml"):
        if beside.is_file():
            return beside
    if name.removesuffix(".toml") in scenario_names():
        return scenario_file(name)
    raise ScenarioError(
        f"{file}: `scenario` must be a file beside the campaign or one of "
        f"{', '.join(scenario_names())}, got {name!r}."
    )


def _nominal(table: CampaignTable, base: Scenario, source: str) -> Scenario:
    """The scenario with gains, plants, overrides and expectations of a campaign put in."""
    tables = base.as_dict()
    if table.gains is not None:
        tables["gains"] = _plain(table.gains)
    if table.plant is not None:
        tables["plant"] = _plain(table.plant)
    for key, value in _leaves(table.overrides):
        try:
            places = places_of(key, tables, value)
        except InputError as error:
            raise ScenarioError(f"{source}: [overrides] `{key}` {error}.") from None
        tables = with_values(tables, [(place, value) for place in places])
    tables["expect"] = _plain(table.success) or _of_those_flown(tables)
    whole = f"{source}: the scenario with the campaign's keys"
    scenario = validated(Scenario, tables, whole)
    check_aircraft(scenario, whole)
    check_identified(scenario, whole)
    return scenario


def _plain(tables: list[Any]) -> list[Any]:
    return [t if isinstance(t, str) else t.model_dump(mode="python", exclude_none=True)
            for t in tables]  # fmt: skip


def _of_those_flown(tables: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The scenario's expectations, without those of gains and plants that are not flown."""
    gains = [entry if isinstance(entry, str) else entry["name"] for entry in tables["gains"]]
    plants = [PlantTable.model_validate(plant).label for plant in tables["plant"]]
    return [
        expect
        for expect in tables.get("expect", [])
        if expect.get("gains") in (None, *gains) and expect.get("plant") in (None, *plants)
    ]


def _leaves(tables: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted path and value of everything in [overrides] that is not a table."""
    for name, value in tables.items():
        key = f"{above}{name}"
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{key}.")
        else:
            yield key, value
