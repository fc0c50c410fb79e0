"""Campaign files, checked against their scenarios, and sources of flights as a value."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import check_not_negative
from flighttune.base.errors import InputError, ScenarioError, naming
from flighttune.base.files.load import DATASET, SHOWN, kind_of
from flighttune.base.files.shipped import campaign_files, scenario_files
from flighttune.base.files.table import abridged, shown, toml_tables, validated
from flighttune.base.signals import CHANNEL_SYMBOLS
from flighttune.campaigns.planning.draws import copula_factor, dispersed_places, with_drawn
from flighttune.campaigns.planning.forecast import Spread, spread_of
from flighttune.campaigns.planning.knowing import Knowledge, knowing
from flighttune.campaigns.planning.plan import Plan, plan_campaign, recorded_plan
from flighttune.campaigns.planning.schema import (
    DISTRIBUTIONS,
    Campaign,
    CampaignTable,
    Dispersion,
    Uniform,
)
from flighttune.control.gains_keys import TUNED_FOR_AIRCRAFT, GainsTable
from flighttune.flight import models
from flighttune.flight.load import check_identified, check_scenario, is_model, load_scenario
from flighttune.flight.route import AIRCRAFT, mission_scenario, planned_route
from flighttune.flight.scenario import load
from flighttune.flight.scenario.schema import Scenario
from flighttune.routes.fence import own_fence
from flighttune.vehicles.aircraft.aircraft import OffNominal, load_aircraft
from flighttune.vehicles.plant_keys import PlantTable
from flighttune.vehicles.plants.base import goes_by
from flighttune.vehicles.plants.jsbsim.plant import check_off_nominal

# Folders that the name of a shipped campaign may begin with.
FOLDERS = "campaigns", "scenarios/campaigns"


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
        A scenario that replaces the scenario in the file.
    changes : mapping of str to value, optional
        Values of the scenario to set by dotted key, besides ``[overrides]``.
    gains : sequence of str, optional
        Gain sets that replace the campaign's, as in `load_scenario`.
    until_sure : float, 1, optional
        Required share of successful flights, which replaces the value in the file.

    Returns
    -------
    Campaign
        Frozen and valid: the scenario can be flown at the median of all dispersed keys.

    Raises
    ------
    ScenarioError
        If the file or its scenario cannot be read, a key is unknown, missing or impossible, or the
        scenario refuses a dispersion. One line names file and key.

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
    """The tables of a campaign file with values set, and the file; its scenario is not read."""
    file = load.existing_file(path, "campaign", campaign_files(), FOLDERS)
    tables = load.with_code(toml_tables(file), file)
    if "flight" in tables and "scenario" not in tables:
        raise ScenarioError(
            f"{file}: must be a campaign, got a scenario, which `flighttune fly` flies."
        )
    _check_disperse(tables.get("disperse"), str(file))
    if "gains" in tables:
        tables["gains"] = load.gain_entries(tables["gains"], file.parent)
    if until_sure is not None:
        tables["until_sure"] = until_sure
    if changes:
        tables |= {
            "overrides": {**tables.get("overrides", {}), **changes},
            "title": load.title_with(tables, changes),
        }
    return validated(CampaignTable, tables, str(file)), file


def campaign_about(
    table: CampaignTable, file: Path, scenario: Scenario | None, gains: Sequence[str] = ()
) -> Campaign:
    """The campaign of a file's tables, with a scenario that replaces the file's scenario."""
    base = scenario or load_scenario(_scenario_of(table.scenario, file))
    nominal = _nominal(table, base, str(file))
    if gains:
        nominal = load.with_gains(nominal, gains, str(file))
        table = table.model_copy(update={"gains": nominal.gains})
    return campaign_on(table, nominal, str(file))


def campaign_on(table: CampaignTable, nominal: Scenario, source: str) -> Campaign:
    """The campaign of tables for a scenario that already has gains, plants and overrides."""
    with naming(source, ScenarioError):
        copula_factor(table.correlation)
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
        if os.path.isfile(beside) and beside != file:
            return beside
    shipped = scenario_files()
    if name.removesuffix(".toml") in shipped:
        return shipped[name.removesuffix(".toml")]
    raise ScenarioError(
        f"{file}: `scenario` must be a file beside the campaign or one of "
        f"{', '.join(shipped)}, got {abridged(name)}."
    )


def _nominal(table: CampaignTable, base: Scenario, source: str) -> Scenario:
    """The scenario with the gains, plants, overrides and requirements of a campaign."""
    own = {entry.name: entry for entry in base.gains if isinstance(entry, GainsTable)}
    entries = table.gains or []
    if any(isinstance(entry, str) and ":" in entry for entry in entries):  # LAW:GAINS, as in `fly`
        tables_given = [entry for entry in entries if isinstance(entry, GainsTable)]
        names = [entry if isinstance(entry, str) else entry.name for entry in entries]
        base, entries = load.with_gains(base, names, source, tables_given), []
    tables = base.as_dict()
    if entries:
        tables["gains"] = _plain([own.get(x, x) if isinstance(x, str) else x for x in entries])
    if table.plant is not None:
        tables["plant"] = _plain(table.plant)
    tables = load.with_changes(tables, table.overrides, f"{source}: [overrides]")
    tables["expect"] = _plain(table.success) or _expectations(tables)
    whole = f"{source}: the scenario with the campaign's keys"
    scenario = validated(Scenario, tables, whole)
    check_scenario(scenario, whole)
    check_identified(scenario, whole)
    return scenario.assuming()


def _plain(tables: list[Any]) -> list[Any]:
    return [
        table if isinstance(table, str) else table.model_dump(mode="python", exclude_none=True)
        for table in tables
    ]


def _expectations(tables: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The scenario's requirements for the flown gains and plants."""
    gains = [entry if isinstance(entry, str) else entry["name"] for entry in tables["gains"]]
    plants = [PlantTable.model_validate(plant).label for plant in tables["plant"]]
    return [
        expect
        for expect in tables.get("expect", [])
        if expect.get("gains") in (None, *gains)
        and any(goes_by(label, expect.get("plant")) for label in plants)
    ]


def _check_disperse(tables: Any, source: str) -> None:
    """Check each [[disperse]] separately, so that a message names its key."""
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


# Default campaign for the air and dispersions of a mission, and its dispersions in m, which suit
# only the size of its own aircraft.
LIKE, SHIFTS = "circuit_in_wind", ("cg_aft_m", "cg_right_m", "cg_down_m")

# Most plans of a route for the wind at its heights.
PLANNED_AGAIN = 3

INERTIAS = "ixx_factor", "iyy_factor", "izz_factor"

# Default range of angular frequencies of a disturbance, rad/s, and its phases, deg.
FREQUENCIES, PHASES_DEG = (0.05, 6.0), (-180.0, 180.0)


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flights:
    """Flights that can be flown, drawn and counted, from any source.

    Attributes
    ----------
    place : str
        The source of the flights, for messages and names of files.
    scenario : Scenario
        The undispersed scenario.
    campaign : Campaign or None
        The campaign with its dispersions; None for a scenario alone.
    recorded : Plan or None
        The plan of a flown campaign.
    mission : Path or None
        The file of a mission.
    start_deg : float, deg
        Half-width of the drawn starts of a scenario, in course and path angle.
    disturbance : tuple of two float, rad/s
        Maximum size of square waves that disturb the rates of course and path angle.

    Examples
    --------
    >>> flights = ft.flights("level_turn").starting(2.0)
    >>> flights.plan(plant="kinematic").keys
    ('flight.chi_deg', 'flight.gamma_deg')
    """

    place: str
    scenario: Scenario
    campaign: Campaign | None = None
    recorded: Plan | None = None
    mission: Path | None = None
    start_deg: float = 0.0
    disturbance: tuple[float, float] = (0.0, 0.0)

    @property
    def fences(self) -> tuple[Path, ...]:
        """Files with a fence of their own: the mission, if its kind has fences."""
        return () if self.mission is None else own_fence(self.mission)

    def starting(self, within_deg: float) -> "Flights":
        """Flights of a scenario from starts drawn within this half-width, deg; 0: no change."""
        check_not_negative(start_deg=within_deg)
        self._check_scenario("start_deg", within_deg)
        return replace(self, start_deg=within_deg or self.start_deg)

    def disturbed(self, largest: float) -> "Flights":
        """Flights of a scenario with both rates disturbed by up to this, rad/s; 0: no change."""
        check_not_negative(disturbance=largest)
        self._check_scenario("disturbance", largest)
        return replace(self, disturbance=(largest, largest) if largest else self.disturbance)

    def knowing(self, navigation: Knowledge | None) -> "Flights":
        """Flights whose autopilots know their motion by a grade; None: as stated, see `knowing`."""
        if self.recorded is not None:
            if navigation is not None:
                raise InputError(
                    f"{self.place}: `navigation` must be absent for a campaign already flown."
                )
            return self
        campaign = self.campaign and knowing(self.campaign, navigation)
        return replace(self, scenario=knowing(self.scenario, navigation), campaign=campaign)

    def in_wind(self, forecast: str | Path | None, *, plans: bool = True) -> "Flights":
        """Flights along a route in a wind drawn from a forecast; None: no change.

        The forecast is Open-Meteo's JSON or CSV, or NetCDF, also ``FILE@FROM/TO``. Its range
        over members, these times and the heights of the route replaces the campaign's wind, and
        its largest wind is that for which turns are planned, unless not `plans`.
        """
        if forecast is None:
            return self
        campaign = self.campaign
        if self.recorded is not None or campaign is None or campaign.nominal.route is None:
            raise InputError(
                f"{self.place}: `wind` must be with a mission, or a campaign about a route."
            )
        route, spread = in_forecast(campaign.central, forecast, plans=plans)
        planned_for = route.route and route.route.wind_mps
        return replace(self, campaign=in_spread(campaign, spread, self.place, planned_for))

    def with_own_requirements(self) -> "Flights":
        """Flights of a mission without the requirements of the campaign that gives its draws."""
        assert self.campaign is not None  # of a mission
        own = {"expect": self.scenario.expect}
        nominal = self.campaign.nominal.model_copy(update=own)
        table = self.campaign.model_copy(update={"success": []})
        return replace(self, campaign=campaign_on(table, nominal, self.place))

    def _check_scenario(self, name: str, value: float) -> None:
        if value and self.campaign is not None:
            raise InputError(
                f"{self.place}: `{name}` must be absent for what is no scenario: missions and "
                "campaigns draw their own."
            )

    def plan(
        self, *, plant: str | None = None, gains: str | None = None, kind: str | None = None
    ) -> Plan:
        """The plan with tuned gains. For a scenario: of its first plant of this kind.

        `gains` by name or file, if unknown to the source, replace its own gains.
        """
        if self.mission and plant is not None:
            raise InputError(f"{self.place}: `plant` must be absent for a mission.")
        scenario, campaign = self.scenario, self.campaign
        if campaign is None:
            if gains not in (None, *scenario.gain_names):
                scenario = load.with_gains(scenario, [gains], self.place)
            labels = [table.label for table in scenario.plant if kind in (None, table.kind)]
            chosen, name = plant or next(iter(labels), None), Path(self.place).stem
            plan = plan_campaign(about(scenario, name, chosen, self.start_deg, self.disturbance))
            return plan.with_runs(len(plan.groups))
        if not (self.mission or self.recorded) and gains not in (None, *scenario.gain_names):
            scenario = load.with_gains(scenario, [gains], self.place)
            table = campaign.model_copy(update={"gains": scenario.gains})
            campaign = campaign_on(table, scenario, self.place)
        if self.mission and not self.recorded:
            campaign = self._with_found_gains(campaign)
        plan = self.recorded or plan_campaign(campaign)
        if self.mission or self.recorded:
            plan.chosen_group(None, gains)  # this refuses other gains
        return plan

    def _with_found_gains(self, campaign: Campaign) -> Campaign:
        """The campaign of a mission, with the first gains that tuning finds, which it says."""
        found = models.with_found_gains(campaign.nominal)
        if found.gains == campaign.nominal.gains:
            return campaign
        tables = found.as_dict()
        lacking = f"tuning finds no {campaign.nominal.gains[0]} gains within the limits"
        said = f"{lacking}: {found.gains[0]} flies"
        tables["route"]["notes"] = [*tables["route"].get("notes", []), said]
        return campaign_on(campaign, load.scenario_from(tables), self.place)


def in_forecast(
    scenario: Scenario, forecast: str | Path, *, plans: bool
) -> tuple[Scenario, Spread]:
    """A scenario whose turns are planned for a forecast if it `plans`, and the forecast's spread.

    The largest wind of the spread covers all winds that are drawn, at all heights and times.
    """
    # Wider turns may change the heights of the route, and so the wind.
    spread = _spread_along(scenario, forecast)
    for _ in range(PLANNED_AGAIN if plans else 0):
        planned_for = {"route.wind_mps": spread.speed_mps[1]}
        changed = load.with_changes(scenario.as_dict(), planned_for, str(forecast))
        scenario = load.scenario_from(changed)
        if (again := _spread_along(scenario, forecast)) == spread:
            break
        spread = again
    return scenario, spread


def _spread_along(scenario: Scenario, forecast: str | Path) -> Spread:
    """The spread of a forecast over the heights of a route."""
    path, origin, h_0 = planned_route(scenario).where
    up = path.up[path.s <= path.length] + h_0 - scenario.flight.ground_m
    return spread_of(forecast, origin, (float(up.min()), float(up.max())))


def in_spread(
    campaign: Campaign, spread: Spread, place: str, planned_for: float | None
) -> Campaign:
    """A campaign whose wind is drawn uniformly from the spread of a forecast.

    `planned_for`: wind for which its turns are planned, m/s; None for their own.
    """
    drawn = [x for x in campaign.disperse if not x.key.startswith("wind.")]
    kept = {x.key for x in drawn}
    fixed = {}
    for key in ("speed_mps", "from_deg"):
        low, high = getattr(spread, key)
        fixed[key] = low
        if low < high:
            drawn.append(Uniform(key=f"wind.{key}", lower=low, upper=high))
    tables = campaign.nominal.as_dict()
    tables["wind"] = fixed
    if planned_for is not None:
        tables["route"]["wind_mps"] = planned_for
    tables["route"]["notes"] = [*tables["route"].get("notes", []), spread.words]
    table = campaign.model_copy(
        update={
            "title": f"{campaign.title}, in the wind of {spread.source}",
            "disperse": drawn,
            "correlation": [x for x in campaign.correlation if {*x.keys} <= kept],
        }
    )
    return campaign_on(table, load.scenario_from(tables), place)


def flights(
    source: Flights | Scenario | Campaign | Plan | str | Path,
    *,
    aircraft: str | None = None,
    like: str | None = None,
    terrain: str | Path | None = None,
    changes: Mapping[str, Any] | None = None,
) -> Flights:
    """The flights of a source: the only function that asks for the kind of a source.

    Parameters
    ----------
    source : Flights, Scenario, Campaign, Plan, str or Path
        A scenario or campaign, its file, or its name if shipped; the folder of a flown campaign; or
        a mission: ``.plan`` of QGroundControl, ``.waypoints`` of Mission Planner, KML or GeoJSON.
    aircraft : str, optional
        Aircraft that flies a mission, or file of an identified model (.json), which flies as its
        lags; by default ``aerosonde``.
    like : str, optional
        Campaign with the air and dispersions for a mission; by default light turbulence, wind to 8
        m/s and the dispersions of the aircraft.
    terrain : str or Path, optional
        Raster of heights (GeoTIFF, .hgt) for a mission's heights above terrain.
    changes : mapping of str to value, optional
        Values to set by dotted key in a source that is read from a file.

    Returns
    -------
    Flights

    Raises
    ------
    InputError, ScenarioError
        If the source does not exist or cannot be read, or an argument does not suit its kind.

    Examples
    --------
    >>> ft.flights("first_campaign").plan().draws
    10
    """
    if not isinstance(source, str | Path):
        if changes or aircraft or like:
            raise InputError("`aircraft`, `like` and `changes` must be given with a file.")
        return source if isinstance(source, Flights) else _of(source)
    place = str(source)
    if mission := mission_scenario(place, aircraft, changes, terrain):
        drawn = _about_mission(mission, aircraft or AIRCRAFT, like)
        return Flights(place=place, scenario=mission, campaign=drawn, mission=Path(place))
    if aircraft is not None or like is not None:
        raise InputError(f"{place}: `aircraft` and `like` must be absent: it is no mission.")
    if _is_scenario(place):
        return _of(load_scenario(place, changes=changes), place)
    if (kind := kind_of(place)) not in ("", DATASET):
        raise InputError(f"{place}: must be what can be flown, got {SHOWN[kind]}.")
    if not kind:
        names = {**scenario_files(), **campaign_files()}
        file = load.existing_file(place, "scenario, campaign or mission", names, FOLDERS)
        return _of(load_campaign(file, changes=changes), place)
    if changes:
        raise InputError(f"{place}: `--set` must be absent for a campaign already flown.")
    return _of(recorded_plan(place)[0], place)


def _of(stated: Scenario | Campaign | Plan, place: str = "") -> Flights:
    if isinstance(stated, Scenario):
        return Flights(place=place or stated.title, scenario=stated)
    if isinstance(stated, Campaign):
        return Flights(place=place or stated.title, scenario=stated.nominal, campaign=stated)
    place, campaign = place or stated.campaign.title, stated.campaign
    return Flights(place=place, scenario=campaign.nominal, campaign=campaign, recorded=stated)


def _is_scenario(source: str | Path) -> bool:
    """Whether a file or name belongs to a scenario; if not, to a campaign."""
    path = Path(source)
    if os.path.isfile(path) and path.suffix == ".toml":
        return "scenario" not in toml_tables(path)
    stem = path.name.removesuffix(".toml")
    return stem in scenario_files() and stem not in campaign_files()


def _about_mission(scenario: Scenario, aircraft: str, like: str | None) -> Campaign:
    """Flights of a mission with the draws of the campaign `like`."""
    table, file, words = (_wind_of if is_model(aircraft) else _dispersed)(aircraft, like)
    title = f"{scenario.title}, flown as {file.stem}{words}"
    return campaign_about(table, file, scenario).model_copy(update={"title": title})


def _dispersed(aircraft: str, like: str | None = None) -> tuple[CampaignTable, Path, str]:
    """The campaign `like` with the dispersions that an aircraft can have, its file and a note."""
    own = LIKE if aircraft == AIRCRAFT else f"{LIKE}_{aircraft}"
    shipped = own in campaign_files()
    table, file = campaign_table(like or (own if shipped else LIKE), {"plant.aircraft": aircraft})
    if like is not None or shipped:
        return table, file, ""
    left_out, words = SHIFTS, ""
    if not _possible_inertias(aircraft, table.disperse):
        left_out += INERTIAS
        words = " with the aircraft's own inertias"
    drawn = [x for x in table.disperse if not x.key.endswith(left_out)]
    related = [x for x in table.correlation if not x.keys[0].endswith(left_out)]
    return table.model_copy(update={"disperse": drawn, "correlation": related}), file, words


def _wind_of(aircraft: str, like: str | None = None) -> tuple[CampaignTable, Path, str]:
    """The wind of the campaign `like` for the lags of a model, its file and a note."""
    table, file = campaign_table(like or LIKE)
    drawn = [x for x in table.disperse if x.key.startswith("wind.")]
    lags = PlantTable(kind="point_mass_lag", identified=aircraft)
    kept = {"plant": [lags], "overrides": {}, "disperse": drawn, "correlation": []}
    return table.model_copy(update=kept), file, " by the lags of a model"


def airframes(scenario: Scenario) -> Campaign:
    """Flights of the first aircraft of a scenario on airframes that differ, in its own air.

    They differ from that of the scenario as those of a mission by default do.
    """
    plant = scenario.aircraft[0]
    assert plant.aircraft is not None  # of a plant that is one
    table, file, _ = _dispersed(plant.aircraft)
    airframe = "plant.airframe."
    drawn = [
        x.model_copy(update={"acts": "multiplies" if x.key.endswith("_factor") else "adds"})
        for x in table.disperse
        if x.key.startswith(airframe)
    ]
    related = [x for x in table.correlation if x.keys[0].startswith(airframe)]
    flown = plant.model_copy(update={"airframe": plant.airframe or OffNominal()})
    kept = {"plant": [flown], "gains": None, "overrides": {}, "success": []}
    table = table.model_copy(update={"disperse": drawn, "correlation": related, **kept})
    return campaign_about(table, file, scenario)


def _possible_inertias(aircraft: str, drawn: Sequence[Dispersion]) -> bool:
    """Whether an aircraft can have the smallest and largest drawn inertias."""
    config = load_aircraft(aircraft)
    of = {x.key.rpartition(".")[2]: x for x in drawn if x.key.endswith(INERTIAS)}
    # Some models are flat: their inertias about two axes add up to the inertia about the third.
    for largest in of:  # the inertia about one axis, with the smallest about the other two
        ends = {key: x.at(np.array([float(key == largest)])).item() for key, x in of.items()}
        off = OffNominal.model_validate(ends)
        try:
            check_off_nominal(config.with_off_nominal(off))
        except InputError:
            return False
    return True


def about(
    scenario: Scenario,
    name: str,
    plant: str | None,
    start_deg: float,
    disturbance: tuple[float, float],
) -> Campaign:
    """A campaign of one plant of a scenario, with uniform starts and disturbances."""
    if plant in [table.label for table in scenario.plant]:  # callers refuse an unknown plant
        # another plant may not allow the disturbance
        kept = [table for table in scenario.plant if table.label == plant]
        expect = [x for x in scenario.expect if goes_by(plant, x.plant)]
        tuning = scenario.tuning
        stated = tuning.model, *scenario.gains
        tuned_on = any(name in stated for name in ("identified", *TUNED_FOR_AIRCRAFT))
        if tuned_on and scenario.aircraft and not kept[0].aircraft:
            # Gains stay tuned for the first aircraft, even if it is no longer among the plants.
            first = tuning.identified or scenario.aircraft[0].aircraft
            tuning = tuning.model_copy(update={"identified": first})
        scenario = scenario.model_copy(update={"plant": kept, "expect": expect, "tuning": tuning})
    tables = scenario.as_dict()
    drawn: list[Dispersion] = []
    if start_deg:
        if scenario.reference is not None:  # it stays where it is, so that flights begin beside it
            begun = scenario.reference.beginning(scenario.flight)
            tables["reference"] = begun.model_dump(mode="json", exclude_none=True)
        for key in ("flight.chi_deg", "flight.gamma_deg"):
            drawn.append(Uniform(key=key, lower=-start_deg, upper=start_deg, acts="adds"))
    for channel, size in zip(CHANNEL_SYMBOLS, disturbance, strict=True):
        if not size:
            continue
        tables["disturbance"] = {"wave": "square"}
        ranges = {"amplitude": (-size, size), "omega_rad_s": FREQUENCIES, "phase_deg": PHASES_DEG}
        for key, (low, high) in ranges.items():
            drawn.append(Uniform(key=f"disturbance.{channel}_{key}", lower=low, upper=high))
    table = CampaignTable(title=scenario.title, scenario=name, runs=1, disperse=drawn)
    return campaign_on(table, load.scenario_from(tables), name)
