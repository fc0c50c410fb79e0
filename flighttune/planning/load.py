"""Loading a campaign file, checked against its scenario."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flighttune.errors import InputError, ScenarioError
from flighttune.files.mistakes import abridged, shown, validated
from flighttune.files.shipped import campaign_files, scenario_files
from flighttune.files.table import toml_tables
from flighttune.flight.load import check_identified, check_scenario, load_scenario
from flighttune.planning.draws import copula_factor, dispersed_places, with_drawn
from flighttune.planning.schema import DISTRIBUTIONS, Campaign, CampaignTable
from flighttune.plants.base import goes_by
from flighttune.scenario.load import (
    existing_file,
    gain_entries,
    title_with,
    with_changes,
    with_gains,
)
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import GainsTable, PlantTable


def load_campaign(
    path: str | Path,
    scenario: Scenario | None = None,
    *,
    changes: Mapping[str, Any] | None = None,
    gains: Sequence[str] = (),
    until_sure: float | None = None,
) -> Campaign:
    """Read and check a campaign file.

    Parameters
    ----------
    path : path-like
        A TOML file, or the name of a campaign that ships with the package.
    scenario : Scenario, optional
        A scenario in place of the one that the file names.
    changes : mapping of str to value, optional
        Values of the scenario to set by dotted key, besides those of ``[overrides]``.
    gains : sequence of str, optional
        Gain sets in place of the campaign's, as of `load_scenario`.
    until_sure : float, 1, optional
        Share of successful flights to ask for, in place of the file's.

    Returns
    -------
    Campaign
        Frozen and valid: at the median of everything dispersed the scenario can be flown.

    Raises
    ------
    ScenarioError
        If the file or its scenario cannot be read, a key is unknown, missing or impossible, or the
        scenario refuses a dispersion. One line that names file and key.

    Examples
    --------
    >>> ft.load_campaign("first_campaign").runs
    40
    """
    table, file = campaign_table(path, changes, until_sure)
    campaign = campaign_about(table, file, scenario, gains)
    if campaign.until_sure is not None and not campaign.nominal.expect:
        raise ScenarioError(f"{file}: `until_sure` must be with [[success]], got no requirement.")
    return campaign


def campaign_table(
    path: str | Path, changes: Mapping[str, Any] | None = None, until_sure: float | None = None
) -> tuple[CampaignTable, Path]:
    """The tables of a campaign file with values to set, and the file; its scenario is not read."""
    folders = "campaigns", "scenarios/campaigns"
    file = existing_file(path, "campaign", campaign_files(), folders)
    tables = toml_tables(file)
    _check_disperse(tables.get("disperse"), str(file))
    if "gains" in tables:
        tables["gains"] = gain_entries(tables["gains"], file.parent)
    if until_sure is not None:
        tables["until_sure"] = until_sure
    if changes:
        tables |= {
            "overrides": {**tables.get("overrides", {}), **changes},
            "title": title_with(tables, changes),
        }
    return validated(CampaignTable, tables, str(file)), file


def campaign_about(
    table: CampaignTable, file: Path, scenario: Scenario | None, gains: Sequence[str] = ()
) -> Campaign:
    """The campaign of a file's tables, about a scenario in place of the one that they name."""
    base = scenario or load_scenario(_scenario_of(table.scenario, file))
    nominal = _nominal(table, base, str(file))
    if gains:
        nominal = with_gains(nominal, gains, str(file))
        table = table.model_copy(update={"gains": nominal.gains})
    return campaign_on(table, nominal, str(file))


def campaign_on(table: CampaignTable, nominal: Scenario, source: str) -> Campaign:
    """The campaign of tables about a scenario that has the gains, plants and overrides already."""
    try:
        copula_factor(table.correlation)
    except InputError as error:
        raise ScenarioError(f"{source}: {error}.") from None
    places = dispersed_places(table.disperse, nominal, source)
    medians = {dispersion.key: dispersion.central for dispersion in table.disperse}
    tables = with_drawn(nominal.as_dict(), table.disperse, places, medians)
    where = f"{source}: the scenario at the median of [[disperse]]"
    central = validated(Scenario, tables, where)
    check_scenario(central, where)
    return Campaign.of(table, nominal=nominal, central=central)


def _scenario_of(name: str, file: Path) -> Path:
    """The file of a campaign's scenario: beside the campaign, or shipped."""
    for beside in (file.parent / name, file.parent / f"{name}.toml"):
        if beside.is_file() and beside != file:
            return beside
    shipped = scenario_files()
    if name.removesuffix(".toml") in shipped:
        return shipped[name.removesuffix(".toml")]
    raise ScenarioError(
        f"{file}: `scenario` must be a file beside the campaign or one of "
        f"{', '.join(shipped)}, got {abridged(name)}."
    )


def _nominal(table: CampaignTable, base: Scenario, source: str) -> Scenario:
    """The scenario with gains, plants, overrides and requirements of a campaign put in."""
    own = {entry.name: entry for entry in base.gains if isinstance(entry, GainsTable)}
    entries = table.gains or []
    if any(isinstance(entry, str) and ":" in entry for entry in entries):  # LAW:GAINS, as of `fly`
        tables_given = [entry for entry in entries if isinstance(entry, GainsTable)]
        names = [entry if isinstance(entry, str) else entry.name for entry in entries]
        base, entries = with_gains(base, names, source, tables_given), []
    tables = base.as_dict()
    if entries:
        tables["gains"] = _plain([own.get(x, x) if isinstance(x, str) else x for x in entries])
    if table.plant is not None:
        tables["plant"] = _plain(table.plant)
    tables = with_changes(tables, table.overrides, f"{source}: [overrides]")
    tables["expect"] = _plain(table.success) or _expectations(tables)
    whole = f"{source}: the scenario with the campaign's keys"
    scenario = validated(Scenario, tables, whole)
    check_scenario(scenario, whole)
    check_identified(scenario, whole)
    return scenario


def _plain(tables: list[Any]) -> list[Any]:
    return [
        table if isinstance(table, str) else table.model_dump(mode="python", exclude_none=True)
        for table in tables
    ]


def _expectations(tables: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The scenario's requirements, without those of gains and plants that are not flown."""
    gains = [entry if isinstance(entry, str) else entry["name"] for entry in tables["gains"]]
    plants = [PlantTable.model_validate(plant).label for plant in tables["plant"]]
    return [
        expect
        for expect in tables.get("expect", [])
        if expect.get("gains") in (None, *gains)
        and any(goes_by(label, expect.get("plant")) for label in plants)
    ]


def _check_disperse(tables: Any, source: str) -> None:
    """Check each [[disperse]] separately, so that a mistake in it names its key."""
    for table in tables if isinstance(tables, list) else []:
        if not isinstance(table, Mapping):
            continue
        key, kind = table.get("key"), table.get("distribution")
        where = f"{source}: [[disperse]]" + (f" `{shown(key)}`" if isinstance(key, str) else "")
        if not isinstance(kind, str) or kind not in DISTRIBUTIONS:
            kinds = ", ".join(DISTRIBUTIONS)
            raise ScenarioError(
                f"{where} `distribution` must be one of {kinds}, got {abridged(kind)}."
            )
        validated(DISTRIBUTIONS[kind], table, where)
