"""A campaign to a plan: gains tuned once, groups in the order they fly."""

import hashlib

from flighttune.campaign.planning.draws import cycle
from flighttune.campaign.planning.plan import Group, Plan
from flighttune.campaign.planning.schema import Campaign
from flighttune.outer_loop import gain_set, tune_scenario
from flighttune.plants.jsbsim.aircraft import load_aircraft
from flighttune.scenario.tuning_table import TUNED


def plan_campaign(campaign: Campaign, *, runs: int | None = None) -> Plan:
    """Tune the gains of a campaign, and say who flies what.

    Parameters
    ----------
    campaign : Campaign
        As `load_campaign` returns it.
    runs : int, optional
        Flights in total; by default what the file says, and of a grid without it one flight a cell
        and group.

    Returns
    -------
    Plan
        A gain set that tuning did not find is None: its runs say so.

    Raises
    ------
    InputError, ScenarioError
        If `runs` is not positive, or an identified model is needed and there is none.
    """
    scenario = campaign.nominal
    names = [entry if isinstance(entry, str) else entry.name for entry in scenario.gains]
    tuning = tune_scenario(scenario) if TUNED in names else None
    windy = campaign.central.windy
    plants = sorted(scenario.plant, key=lambda plant: windy and plant.aircraft is None)
    groups = tuple(Group(plant.label, name) for plant in plants for name in names)
    if runs is None:
        runs = campaign.runs or cycle(campaign) * len(groups)
    flown = {plant.aircraft for plant in plants if plant.aircraft is not None}
    return Plan(
        campaign=campaign,
        gain_sets={name: gain_set(scenario, name, tuning) for name in names},
        groups=groups,
        runs=runs,
        aircraft={name: files_hash(name) for name in sorted(flown)},
    )


def files_hash(aircraft: str) -> str:
    """Hash of the names and contents of an aircraft's files.

    Raises
    ------
    InputError
        If there is no such aircraft.
    """
    folder = load_aircraft(aircraft).folder
    found = hashlib.sha256()
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        if file.suffix in (".xml", ".toml", ".json"):
            content = file.read_bytes()
            found.update(f"{file.relative_to(folder).as_posix()} {len(content)}\n".encode())
            found.update(content)
    return found.hexdigest()
