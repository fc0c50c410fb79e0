"""Aircraft in JSBSim, in weather or off the nominal, and copies of their folders to change."""

import shutil

import numpy as np
from places import SHIPPED_AIRCRAFT

import flighttune as ft
from flighttune.vehicles.aircraft.aircraft import OffNominal, load_aircraft, save_gains
from flighttune.vehicles.plants import weather as air
from flighttune.vehicles.plants.base import AirPathPlant
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.model_files import model_hash


def fdm_of(aircraft, **settings):
    """The flight dynamics of an aircraft in JSBSim."""
    return Fdm(ft.loop.JSBSimPlant(aircraft).config, **settings)


def varied(aircraft, **keys):
    """An aircraft with the keys of `airframe` in a scenario: factors, shifts and a fault."""
    return ft.loop.JSBSimPlant(aircraft, off_nominal=off_nominal(**keys)).config


def off_nominal(**keys):
    """Factors, shifts and a fault by the keys of `airframe` in a scenario."""
    return OffNominal.model_validate(keys)


def blowing(wind=None, turbulence=None, gust=None, oscillation=None):
    """Weather of a wind (north, east, down) or (height, wind) pairs, and of keys of the others."""
    levels = wind and (wind if isinstance(wind[0], tuple) else ((0.0, wind),))
    given = {
        "wind": wind and air.WindProfile(levels),
        "turbulence": turbulence and air.Turbulence(**turbulence),
        "gust": gust and air.Gust(**gust),
        "oscillation": oscillation and air.OscillatingWind(**oscillation),
    }
    return air.Weather(**{name: value for name, value in given.items() if value})


def wind_record(t, wind):
    """A wind that is linear between samples, for a point mass."""
    return air.WindRecord(t=np.asarray(t), wind=np.asarray(wind))


def seen_through_air(plant):
    """A plant whose course and path angle are those through the air."""
    return AirPathPlant(plant)


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
