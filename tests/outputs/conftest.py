"""Real results of short flights by the names of rows of `results.txt`, each made once."""

import json
from functools import cache

import numpy as np
import pandas as pd
import pytest
from made_up import scenario_file
from plans import plan_file, waypoint
from scipy.integrate import cumulative_trapezoid

import flighttune as ft

KINEMATIC, AEROSONDE = {"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}
LIMITS = {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 30.0}
LIMITS |= {"n_z": [-2.1, 2.1], "n_z_rate_per_s": 1.0}
FEW = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "workers": 1}
CORNER = [{"north_m": n, "east_m": e} for n, e in ((0.0, 0.0), (300.0, 0.0), (300.0, 250.0))]
PLACED = {"route.waypoint": CORNER, "route.lat_deg": 47.4, "route.lon_deg": 8.5}
RING = [[8.499, 47.399], [8.506, 47.399], [8.506, 47.404], [8.499, 47.404], [8.499, 47.399]]
NARROW = [[x, y if y < 47.4 else 47.4027] for x, y in RING]  # 0.7 m beyond the first leg
CAMPAIGN = """
title = "small"
scenario = "turn.toml"
runs = 40
seed = 1
gains = ["paper", "K1"]
success = [{ at_most = { chi = { peak_deg = 7.0 } } }]
[[disperse]]
key = "flight.chi_deg"
distribution = "uniform"
lower = 4.0
upper = 9.0
"""
RATES = """
target_per_hour = 1.0
flights = 8
fault = [{ kind = "engine", per_hour = 1e-3, source = "made up", flights = 6, ended_s = 2.0 }]
ending = { kind = "cut", fall_per_height = 1.0 }
"""


def turn(seconds=0.5, plants=(KINEMATIC,), gains=("paper",), **changes):
    """A turn by 5 deg; tables that are given are merged into its own."""
    tables = {
        "title": "turn", "gains": [*gains], "plant": [*plants], "limits": LIMITS,
        "flight": {"V_a_mps": 25.0, "chi_deg": 5.0, "duration_s": seconds},
        "reference": {"chi_deg": 0.0, "gamma_deg": 0.0},
    }  # fmt: skip
    for key, value in changes.items():
        tables[key] = {**tables.get(key, {}), **value} if isinstance(value, dict) else value
    return ft.scenario_from(tables)


def course_of(bound, **changes):
    """Tables of a turn that must keep to an ITAE of course."""
    return {"expect": [{"at_most": {"chi": {"ITAE": bound}}}], **changes}


def log_file(path, seconds=72.0, drift=0.03):
    """A log of a rolling aircraft, too little to be identified, whose course drifts for 4 s."""
    t = np.arange(0.0, seconds, 0.04)
    phi = 0.02 * np.sin(t)
    chi = cumulative_trapezoid(9.81 / 20.0 * np.tan(phi), t, initial=0.0)
    chi += drift * np.clip(t - 20.0, 0.0, 4.0)
    table = {"t_s": t, "phi": phi, "phi_cmd": phi, "n_z": 1.0, "n_z_cmd": 1.0, "V_a": 20.0}
    table |= {"v_north": 20.0 * np.cos(chi), "v_east": 20.0 * np.sin(chi), "v_down": 0.0 * t}
    pd.DataFrame(table).to_csv(path, index=False)
    return path


class Results:
    """What each row of `results.txt` is of; files are written into a folder."""

    def __init__(self, folder):
        self.folder, self.of = folder, cache(lambda name: getattr(self, name)())
        ring = {"type": "Polygon", "coordinates": [RING]}
        (folder / "wide.geojson").write_text(json.dumps(ring))
        (folder / "narrow.geojson").write_text(json.dumps(ring | {"coordinates": [NARROW]}))
        scenario_file(folder / "turn.toml", turn())
        (folder / "c.toml").write_text(CAMPAIGN)
        (folder / "rates.toml").write_text(RATES)
        (folder / "my.parm").write_text("NAVL1_PERIOD 14\nROLL_LIMIT_DEG 45\n")

    def flown(self):
        return ft.fly(turn(3.0, (KINEMATIC, AEROSONDE), ("paper", "K1"), **course_of(1.0)))

    def missed(self):
        return ft.fly(turn(9.0, gains=("paper", "K1"), **course_of(0.5)))

    def met(self):
        return ft.fly(turn(12.0, gains=["K1"], **course_of(0.5)))

    def certified(self):
        return ft.certify("paper", "paper")

    def over_envelope(self):
        return ft.certify("paper", "paper", envelope=True)

    def tuned(self):
        return ft.tune("paper")

    def infeasible(self):
        return ft.tune("paper", starts=1, changes={"tuning.I_star": 4.0})

    def frontier(self):
        return ft.frontier("paper", points=3)

    def tube(self):
        return ft.tube(turn())

    def band(self):
        return ft.band(turn(), start_deg=2.0, **FEW)

    def monitor(self):
        return ft.monitor(turn(), start_deg=2.0, **FEW | {"learn": 20})

    def residual(self):
        return ft.residual(turn(plants=(AEROSONDE,)), start_deg=2.0, **FEW | {"learn": 20})

    def gradient(self):
        return ft.gradient(turn(plants=(AEROSONDE,)), measures=["chi.ITAE"])

    def gap(self):
        return ft.gap(turn(3.0, (KINEMATIC, AEROSONDE)))

    def meeting(self):
        return ft.meet(turn(8.0, **course_of(0.4)), budget=12)

    def trims(self):
        return ft.trim("aerosonde", V_a=[20.0, 25.0], gamma=[-0.1, 0.0, 0.9])

    def designed(self):
        return ft.design("aerosonde")

    def identified(self):
        return ft.identify("aerosonde", V_a=[25.0], gamma=[0.0])

    def of_log(self):
        return ft.identify(log_file(self.folder / "log.csv"), assume={"phi": 5.0, "n_z": 4.0})

    def unidentified(self):
        return ft.identify(log_file(self.folder / "log.csv"), assume={"phi": 5.0})

    def route(self):
        return ft.route("circuit", changes=PLACED)

    def worst(self):
        return ft.worst(self.of("band"), budget=32, workers=1)

    def in_c(self):
        return ft.export(turn(), "paper", out=self.folder / "in_c", form="c")

    def exported(self):
        return ft.export(turn(1.0, (AEROSONDE,)), "paper", out=self.folder / "exported")

    def compared(self):
        return ft.compare(ft.fly(turn(9.0)), ft.fly(turn(9.0, gains=["K1"])))

    def verified(self):
        return ft.verify(self.of("certified").certificate)

    def reflown(self):
        ft.record(ft.fly(turn(gains=("paper", "K1"))), self.folder / "recorded")
        return ft.refly(self.folder / "recorded")

    def corridor(self):
        kept = {"plant": "kinematic", "gains": "paper", "out": self.folder / "corridor.npz"}
        return ft.band("circuit", changes=PLACED, **kept, **FEW)

    def mission(self):
        return ft.mission(self.of("corridor"), fences=[self.folder / "wide.geojson"], workers=1)

    def outside(self):
        return ft.mission(self.of("corridor"), fences=[self.folder / "narrow.geojson"], workers=1)

    def campaign(self):
        return ft.run_campaign(self.folder / "c.toml", self.folder / "flown", workers=1)

    def beside(self):
        legs = (47.4, 8.5), (47.402, 8.5), (47.402, 8.504)
        plan = plan_file(self.folder / "m.plan", *(waypoint(*place, 300.0) for place in legs))
        return ft.compare(plan, autopilot=self.folder / "my.parm", flights=2, workers=1)


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    return Results(tmp_path_factory.mktemp("results"))
