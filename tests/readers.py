"""Readers of files that anybody may have written, each of a path."""

import shutil

import numpy as np

from flighttune.base.files import xml
from flighttune.campaigns.engine import fliers, kept, pool
from flighttune.campaigns.planning import forecast
from flighttune.claims import rates_keys
from flighttune.logs import parameters
from flighttune.routes import fence, maps, mission
from flighttune.studies.adoption import flightgear

HOME = 47.4, 8.5

read_route = mission.read_route
read_parameters = parameters.flown_now
read_rates = rates_keys.load_rates
read_description = flightgear.of_flightgear


def read_fence(path):
    return fence.read_fence(path, HOME, fence.fence_tables([path]))


def read_terrain(path):
    return maps.ground_at(path, np.array([[47.4, 8.5], [47.41, 8.51]]))


def read_forecast(path, heights=(20.0, 100.0)):
    return forecast.spread_of(path, HOME, heights)


def read_model(path):
    return xml.read_xml(path, str(path))


def kept_flights(path, plan=None):
    """The number of flights in the file of a killed command, to which those of a plan are added."""
    with pool.WorkerPool(fliers.Fliers(workers=1), at_once=False) as workers:
        own = kept.KeptRows(path, {}, workers).file  # with digits of what decides in its name
        if path.exists():
            shutil.copyfile(path, own)
        rows = kept.KeptRows(path, {}, workers)
        if plan is not None:
            rows.flown(plan, {})
            shutil.copyfile(own, path)
        return len(rows)
