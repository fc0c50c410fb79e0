"""One adoption from beginning to end: what it writes, measures and records, and its attempts."""

import json
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
from places import SHIPPED_AIRCRAFT

import flighttune as ft
from flighttune.base.errors import PlantError
from flighttune.studies.adoption import adopt, survey
from flighttune.vehicles.aircraft.aircraft import AircraftConfig, load_aircraft
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.jsbsim.bench import AirframeState, Bench
from flighttune.vehicles.plants.jsbsim.fdm import Fdm

DEG = math.pi / 180.0
FILES = "aircraft.toml", "gains.json", "identified.json", "turn.toml", "adoption.json"

WRITTEN = 1e-4
"""Files have five digits."""

# Angles that a sweep of the lift takes in steps and interpolates move the stall so much.
OF_STALL = 0.01


@pytest.fixture(scope="module")
def adopted(tmp_path_factory):
    """The Aerosonde, adopted as a model of one's own; what was said meanwhile."""
    models, said = tmp_path_factory.mktemp("models"), []
    sonde = shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", models / "sonde")
    found = adopt.adopt(str(sonde / "aerosonde.xml"), models / "mine", say=said.append)
    return found, said


@pytest.mark.slow
def test_an_adoption_says_its_steps_and_writes_its_files(adopted):
    found, said = adopted

    steps = list(dict.fromkeys(x.split(":")[0] for x in said))
    assert steps == [f"step {k} of 9" for k in range(1, 10)]
    assert "step 5 of 9: trimming at 25 m/s" in said
    assert (found.status, found.reason, found.name, found.engines) == ("adopted", "", "mine", 1)
    assert sorted(file.name for file in found.folder.iterdir()) == sorted(FILES)
    assert {name: (found.folder / name).read_text() for name in FILES} == found.texts
    assert 'model = "../sonde/aerosonde.xml"' in found.texts["aircraft.toml"]
    assert found.draft is None
    assert 1.0 < found.seconds < 600.0
    assert found.identified.folder == found.folder


@pytest.mark.slow
def test_the_record_of_an_adoption_has_its_answers(adopted):
    found, _ = adopted
    record = json.loads(found.texts["adoption.json"])

    for name in ("status", "reason", "glide_ratio", "fit_percent", "flown"):
        assert record[name] == getattr(found, name)
    assert record["V_a_mps"] == found.V_a
    assert (record["notes"], record["trims"]) == ([*found.notes], [*found.trims])
    assert {*record["versions"]} == {"flighttune", "jsbsim"}
    nominal = json.loads(found.texts["identified.json"])["conditions"][0]["channels"]
    assert {*nominal} == {"phi", "n_z"}
    for name, channel in nominal.items():
        assert found.fit_percent[name] == pytest.approx(channel["fit_percent"], rel=WRITTEN)
        assert 90.0 <= found.fit_percent[name] <= 100.0
    assert record["stall_mps"] == pytest.approx(found.V_a / 1.6, rel=1e-9)


@pytest.mark.slow
def test_the_adopted_airspeed_and_glide_are_those_of_the_wings(adopted):
    """In JSBSim: most lift at the stall carries the weight; the glide ratio is lift over drag."""
    found, _ = adopted
    config = load_aircraft(found.folder)
    bench, stall = Bench(Fdm(config), 1000.0), json.loads(found.texts["adoption.json"])["stall_mps"]

    alphas = np.arange(5.0, 20.0, 0.25) * DEG
    lifts = [bench.accelerations(AirframeState(V_a=stall, alpha=a))["n_z"] for a in alphas]
    assert max(lifts) >= 1.0 - OF_STALL
    level = next(row for row in found.trims if row["gamma_deg"] == 0.0)
    fdm = bench.fdm
    trim = level["trim"]
    names = ("alpha", "elevator")
    state = {name: trim[f"{name}_deg"] * DEG for name in names}
    bench.accelerations(
        AirframeState(V_a=level["V_a_mps"], theta=state["alpha"], throttle=0.0, **state)
    )
    read = {name: fdm.reader(f"forces/fw{name}-aero-lbs")() for name in "xz"}
    print(read["z"] / read["x"], found.glide_ratio, max(lifts), alphas[np.argmax(lifts)] / DEG)
    assert 0
