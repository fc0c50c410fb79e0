"""The flights that a campaign states, or starts and disturbances about a scenario."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flighttune.arrays import check_not_negative
from flighttune.campaign.dataset import CAMPAIGN, open_dataset
from flighttune.errors import InputError
from flighttune.files.shipped import campaign_files, scenario_files
from flighttune.files.table import toml_tables
from flighttune.flight.load import load_scenario, route_scenario
from flighttune.flight.route import AIRCRAFT, is_mission
from flighttune.flights.load import campaign_on, load_campaign
from flighttune.flights.plan import Plan, on_plants, plan_campaign
from flighttune.flights.schema import (
    MEASURES,
    Campaign,
    CampaignTable,
    Dispersion,
    Uniform,
)
from flighttune.present.names import CHANNEL_SYMBOLS
from flighttune.references.mission import read_route
from flighttune.scenario.load import scenario_from, with_gains
from flighttune.scenario.schema import GainsTable, Scenario
from flighttune.tubes.enclosure import Tube
from flighttune.units import DEG_PER_RAD

# Campaign whose air and dispersions a mission has by default, and dispersions in m, which are right
# for the size of its aircraft alone.
LIKE, SHIFTS = "circuit_in_wind", ("cg_aft_m", "cg_right_m", "cg_down_m")

# Angular frequencies of a disturbance without a stated one, rad/s.
FREQUENCIES = (0.05, 6.0)


def planned(
    source: str,
    *,
    plant: str | None = None,
    kind: str | None = None,
    start_deg: float = 0.0,
    disturbance: float = 0.0,
    gains: str | None = None,
    changes: Mapping[str, Any] | None = None,
    aircraft: str | None = None,
    like: str | None = None,
    skip: bool = False,
) -> Plan:
    """The plan of a campaign in a folder or file, or of flights about a scenario or a mission.

    A mission is flown by an `aircraft`, in the air and with the dispersions of the campaign `like`;
    `skip` leaves out its commands that have no place.
    About a scenario, starts are off by up to `start_deg`, and square waves of up to `disturbance`
    (rad/s) disturb both rates, for its first plant of a `kind`. `gains` that source does not have,
    by name or file, take the place of its own.
    """
    check_not_negative(start_deg=start_deg, disturbance=disturbance)
    sizes = disturbance, disturbance
    if is_mission(source):
        if start_deg or disturbance or plant is not None:
            raise InputError("`plant`, `start_deg` and `disturbance` must be absent for a mission.")
        mission = read_route(Path(source), skip=skip)
        scenario = route_scenario(Path(source), mission, aircraft or AIRCRAFT, changes)
        plan = plan_campaign(_about_mission(scenario, aircraft or AIRCRAFT, like))
        plan.chosen_group(None, gains)  # refuses others than those of the campaign
        return plan
    if aircraft is not None or like is not None or skip:
        raise InputError(f"{source}: `aircraft`, `like`, `skip` must be absent: it is no mission.")
    if is_scenario(source):
        scenario = load_scenario(source, changes=changes)
        if gains not in (None, *scenario.gain_names):
            scenario = with_gains(scenario, [gains], source)
        labels = [table.label for table in scenario.plant if kind in (None, table.kind)]
        chosen = plant or next(iter(labels), None)
        plan = plan_campaign(_about(scenario, Path(source).stem, chosen, start_deg, sizes))
        return plan.with_runs(len(plan.groups))
    if start_deg or disturbance:
        raise InputError("`start_deg` and `disturbance` are for scenarios: campaigns have theirs.")
    if (Path(source) / CAMPAIGN).is_file():
        if changes:
            raise InputError(f"{source}: `--set` must be absent for a campaign already flown.")
        plan = open_dataset(source).plan
        plan.chosen_group(None, gains)  # refuses others than its own
        return plan
    campaign = load_campaign(source, changes=changes)
    if gains not in (None, *campaign.nominal.gain_names):
        nominal = with_gains(campaign.nominal, [gains], source)
        table = campaign.model_copy(update={"gains": nominal.gains})
        campaign = campaign_on(table, nominal, source)
    return plan_campaign(campaign)


def enclosed(tube: Tube) -> Plan:
    """The plan of the flights that a tube encloses."""
    problem, sizes = tube.problem, disturbance_of(tube)
    gains = {**problem.gains.as_lists(), "law": problem.gains.law}
    table = GainsTable.model_validate({"name": "tube", **gains})
    title = problem.scenario.title
    scenario = with_gains(problem.scenario, [f"{problem.law.name}:tube"], title, [table])
    start_deg = problem.start * DEG_PER_RAD
    return plan_campaign(_about(scenario, "tube", problem.plant, start_deg, sizes))


def disturbance_of(tube: Tube) -> tuple[float, float]:
    """Bounds on the disturbances of both rates that can be searched, rad/s."""
    if tube.problem.boxes is not None:
        return 0.0, 0.0
    chi, gamma = tube.problem.disturbances[1].max(axis=0).tolist()
    return chi, gamma


def is_scenario(source: str | Path) -> bool:
    """Whether a file or name is that of a scenario; if not, of a campaign."""
    path = Path(source)
    if path.is_file() and path.suffix == ".toml":
        return "scenario" not in toml_tables(path)
    stem = path.name.removesuffix(".toml")
    return stem in scenario_files() and stem not in campaign_files()


def _about_mission(scenario: Scenario, aircraft: str, like: str | None) -> Campaign:
    """Flights of a mission that are drawn as those of the campaign `like`."""
    shipped = like_of(aircraft)
    campaign = load_campaign(
        like or shipped or LIKE, scenario, changes={"plant.aircraft": aircraft}
    )
    update: dict[str, Any] = {"title": f"{scenario.title}, flown as {like or shipped or LIKE}"}
    if like is None and shipped is None:
        update["disperse"] = [x for x in campaign.disperse if not x.key.endswith(SHIFTS)]
    return campaign.model_copy(update=update)


def like_of(aircraft: str) -> str | None:
    """The shipped campaign with dispersions of an aircraft on a circuit, if there is one."""
    name = LIKE if aircraft == AIRCRAFT else f"{LIKE}_{aircraft}"
    return name if name in campaign_files() else None


def _about(
    scenario: Scenario,
    name: str,
    plant: str | None,
    start_deg: float,
    disturbance: tuple[float, float],
) -> Campaign:
    """Starts and disturbances of one plant of a scenario, all equally likely."""
    if plant in [table.label for table in scenario.plant]:  # callers refuse an unknown one
        scenario = on_plants(scenario, [plant])  # another may not stand the disturbance
    tables = scenario.as_dict()
    drawn: list[Dispersion] = []
    if start_deg:
        for key in ("flight.chi_deg", "flight.gamma_deg"):
            drawn.append(Uniform(key=key, lower=-start_deg, upper=start_deg, acts="adds"))
    if any(disturbance):
        for channel, size in zip(CHANNEL_SYMBOLS, disturbance, strict=True):
            if not size:
                continue
            for key, low, high in (
                ("amplitude", -size, size),
                ("omega_rad_s", *FREQUENCIES),
                ("phase_deg", -180.0, 180.0),
            ):
                drawn.append(Uniform(key=f"disturbance.{channel}_{key}", lower=low, upper=high))
        tables["disturbance"] = {"wave": "square"}
    table = CampaignTable(title=scenario.title, scenario=name, runs=1, disperse=drawn)
    return campaign_on(table, scenario_from(tables), name)


def measured_in(row: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """The measures of a row by their subject, as `flighttune.metrics.measures` has them."""
    measured: dict[str, dict[str, float]] = {}
    # Settling times of the scenario's own, and the airspeed where it is a channel.
    more = (column for column in row if column.startswith(("chi.", "gamma.", "V.")))
    for column in dict.fromkeys((*MEASURES, *more)):
        subject, name = column.split(".", 1)
        value = row.get(column)
        measured.setdefault(subject, {})[name] = math.nan if value is None else value
    return measured
