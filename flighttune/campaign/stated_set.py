"""The flights that a campaign states, or starts and disturbances about a scenario."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flighttune.arrays import check_not_negative
from flighttune.campaign.dataset import CAMPAIGN, open_dataset
from flighttune.campaign.planning.load import campaign_on, load_campaign
from flighttune.campaign.planning.plan import Plan, on_plants, plan_campaign
from flighttune.campaign.planning.schema import (
    MEASURES,
    Campaign,
    CampaignTable,
    Dispersion,
    Uniform,
)
from flighttune.errors import InputError
from flighttune.files.shipped import campaign_files, scenario_files
from flighttune.files.table import toml_tables
from flighttune.flight.load import load_scenario
from flighttune.present.names import CHANNEL_SYMBOLS
from flighttune.scenario.load import scenario_from, with_gains
from flighttune.scenario.schema import GainsTable, Scenario
from flighttune.tubes.enclosure import Tube
from flighttune.units import DEG_PER_RAD

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
) -> Plan:
    """The plan of a campaign in a folder or file, or of flights about a scenario.

    About a scenario, starts are off by up to `start_deg`, and square waves of up to `disturbance`
    (rad/s) disturb both rates, for its first plant of a `kind`. `gains` that source does not have,
    by name or file, take the place of its own.
    """
    check_not_negative(start_deg=start_deg, disturbance=disturbance)
    sizes = disturbance, disturbance
    if _is_scenario(source):
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


def _is_scenario(source: str) -> bool:
    path = Path(source)
    if path.is_file() and path.suffix == ".toml":
        return "scenario" not in toml_tables(path)
    stem = path.name.removesuffix(".toml")
    return stem in scenario_files() and stem not in campaign_files()


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
    settling = (column for column in row if column.startswith(("chi.", "gamma.")))
    for column in dict.fromkeys((*MEASURES, *settling)):
        subject, name = column.split(".", 1)
        value = row.get(column)
        measured.setdefault(subject, {})[name] = math.nan if value is None else value
    return measured
