"""Properties and engines for single parts of compiled steps."""

from xml.etree.ElementTree import fromstring

import numpy as np

from flighttune.vehicles.compiled import engine_files, properties, trace

DT = 1.0 / 120.0


def state_of(values=(), **attributes):
    """Properties before a step of JSBSim's usual length."""
    now = properties.Properties(trace.Graph(), DT)
    for name, value in dict(values).items():
        now[name] = value
    for name, value in attributes.items():
        setattr(now, name, value)
    return now


def engine_of(motor, pusher="<direct/>", thruster=""):
    """The first engine of an aircraft, whose thruster points ahead."""
    thruster = fromstring(f"<thruster>{thruster}</thruster>")
    return engine_files.EngineFile(
        0, fromstring(motor), thruster, fromstring(pusher), np.eye(3).tolist()
    )
