"""Counts of half a second of a turn, flown in this process; and the files of counts, forged."""

import json

import numpy as np
from dispersed import KINEMATIC, SOFT, plan_of, tables_of, uniform
from flown_campaigns import flown_here

import flighttune as ft
from flighttune.base.files.array import write_sealed
from flighttune.campaigns.flying.rows import rows_flown

START = uniform("flight.chi_deg", -5.0, 5.0), uniform("flight.gamma_deg", 3.0, 7.0)
FEW = {"epsilon": 0.3, "confidence": 0.9, "learn": 10}
# the least N with 0.7^N <= 0.1, and with at most five outside
ALONE, WITH_FIVE = 7, 29


def small_plan(*disperse, plants=(KINEMATIC,), design="random", **tables):
    """Half a second from random starts."""
    scenario = tables_of(plants, **{"gains": [SOFT], **tables})
    scenario["flight"]["duration_s"] = 0.5
    return plan_of(scenario, *(disperse or START), runs=12, design=design)


def count(plan=None, rows=rows_flown, kind=ft.band, **settings):
    """The band, or another kind of count, of a small plan."""
    with flown_here(rows):
        return kind(plan or small_plan(), **{**FEW, **settings})


def forged(band, path, about=None, **arrays):
    """The file of a band with other values, and the SHA-256 of what it says then."""
    band.save(path)
    with np.load(path) as file:
        members = {**file, **arrays}
    tables = {**json.loads(str(members["band"])), **(about or {})}
    write_sealed(path, {**members, "band": np.array(json.dumps(tables))})
    return path
