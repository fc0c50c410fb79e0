"""Aircraft in JSBSim, and copies of their folders that can be changed or broken."""

import shutil

from places import SHIPPED_AIRCRAFT

from flighttune.vehicles.aircraft.aircraft import load_aircraft, save_gains
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.model_files import model_hash


def fdm_of(aircraft, **settings):
    """The flight dynamics of an aircraft in JSBSim."""
    return Fdm(load_aircraft(aircraft), **settings)


def of_this_model(folder):
    """Let the gains in a folder be those of its model as it is now."""
    config = load_aircraft(folder)
    save_gains(config.gains.model_copy(update={"made_for": model_hash(config)}), folder)


def changed_aerosonde(folder, change):
    """A copy of the Aerosonde whose main file is `change` of its text; its folder."""
    shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", folder)
    file = folder / "aerosonde.xml"
    file.write_text(change(file.read_text()))
    of_this_model(folder)
    return folder
