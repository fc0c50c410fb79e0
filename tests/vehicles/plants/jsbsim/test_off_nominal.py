"""An aircraft off the nominal against its equations of motion, with the factors in them."""

import hashlib
import math
import re
import tempfile
from pathlib import Path

import jsbsim
import numpy as np
import pytest
from airframes import fdm_of
from airframes import off_nominal as keys_of
from places import SHIPPED_AIRCRAFT
from published_aerosonde import FT, LBF, accelerations, evaluated, measured

import flighttune as ft

DEG = math.pi / 180.0
ONE_PER_MILLE = 1e-3
READ_BACK = 1e-9  # relative
LAG = 1.0 / 25.0  # s, of the surface actuators

SURFACES, STILL = ("aileron", "elevator", "rudder"), (0.0, 0.0, 0.0)

FACTORS = (
    *("mass", "ixx", "iyy", "izz", "ixz", "thrust", "lift", "drag", "side_force"),
    *("roll_moment", "pitch_moment", "yaw_moment"),
)
COEFFICIENTS = (
    *("CL", "CL_alpha", "CL_q", "CL_de", "CD_0", "CD_i", "CD_de", "CY_beta", "CY_da", "CY_dr"),
    *("Cl_beta", "Cl_p", "Cl_r", "Cl_da", "Cl_dr", "Cm_0", "Cm_alpha", "Cm_q", "Cm_de"),
    *("Cn_beta", "Cn_p", "Cn_r", "Cn_da", "Cn_dr"),
)
ALONE = [
    {},
    *({name: 1.09} for name in FACTORS),
    *({"cg_shift": tuple(0.03 * axis)} for axis in np.eye(3)),
    *({"coefficients": ((name, 1.5),)} for name in COEFFICIENTS),
]
ALL = {
    "mass": 0.9, "cg_shift": (-0.01, 0.005, 0.02), "ixx": 1.1, "iyy": 1.05, "izz": 0.95,
    "ixz": 0.7, "lift": 1.05, "drag": 0.9, "side_force": 1.1, "roll_moment": 1.2,
    "pitch_moment": 0.9, "yaw_moment": 0.85, "thrust": 1.15, "actuator_lag": 1.3,
    "coefficients": (("aero/coefficient/Cm_alpha", 0.8), ("Cl_p", 1.3), ("CD_0", 1.2)),
}  # fmt: skip


def off_nominal(cg_shift=(0.0, 0.0, 0.0), coefficients=(), **factors):
    shift = dict(zip(("cg_aft_m", "cg_right_m", "cg_down_m"), cg_shift, strict=True))
    factors = {f"{name}_factor": factor for name, factor in factors.items()}
    return keys_of(**shift, coefficient_factors=dict(coefficients), **factors)


def aircraft(name, **off):
    return fdm_of(ft.loop.JSBSimPlant(name, off_nominal=off_nominal(**off)).config)


@pytest.mark.parametrize("off", [*ALONE, ALL], ids=str)
def test_accelerations_are_those_of_the_published_coefficients_with_the_factors(off):
    state = 27.0, 5 * DEG, 3 * DEG, (0.8, 0.3, -0.5), (-0.15, -0.1, 0.12), 0.5

    fdm = evaluated(aircraft("aerosonde", **off), *state)
    force, angular = measured(fdm)

    expected, expected_angular = accelerations(*state, off_nominal(**off))
    body = np.array(force) / (fdm.reader("inertia/mass-slugs")() * LBF / FT)
    assert list(body) == pytest.approx(list(expected), rel=ONE_PER_MILLE, abs=0.01)
    assert angular == pytest.approx(list(expected_angular), rel=ONE_PER_MILLE, abs=0.01)
    changed = [*expected, *expected_angular] != pytest.approx(
        [float(x) for part in accelerations(*state) for x in part], rel=5e-3
    )
    assert changed or off == {} or off.get("coefficients", [("",)])[0][0] in ("CD_de", "Cl_dr")


@pytest.mark.parametrize(("name", "scale"), [("aerosonde", 0.0), ("c172p", 1.0), ("a4", 1.0)])
def test_mass_centre_of_gravity_and_inertia_of_the_whole_aircraft_are_scaled(name, scale):
    shift, factor = (0.03, 0.02 * scale, -0.01), {"ixx": 1.1, "iyy": 0.9, "izz": 1.02, "ixz": 0.7}
    nominal, off = aircraft(name), aircraft(name, mass=1.15, cg_shift=shift, **factor)

    def read(fdm, what):
        return fdm.reader(f"inertia/{what}")()

    moved = [(read(off, f"cg-{a}-in") - read(nominal, f"cg-{a}-in")) * FT / 12 for a in "xyz"]
    assert read(off, "weight-lbs") == pytest.approx(1.15 * read(nominal, "weight-lbs"), READ_BACK)
    assert moved == pytest.approx([shift[0], shift[1], -shift[2]], abs=1e-9)
    for what in ("ixx", "iyy", "izz", "ixz", "ixy", "iyz"):
        expected = factor.get(what, 1.0) * read(nominal, f"{what}-slugs_ft2")
        assert read(off, f"{what}-slugs_ft2") == pytest.approx(expected, rel=READ_BACK, abs=1e-9)


AXES = [
    ("side_force", "forces/fwy-aero-lbs", "CY"),
    ("roll_moment", "moments/l-aero-lbsft", "Cl"),
    ("pitch_moment", "moments/m-aero-lbsft", "Cm"),
    ("yaw_moment", "moments/n-aero-lbsft", "Cn"),
    ("drag", "forces/fwx-aero-lbs", "CD"),
    ("lift", "forces/fwz-aero-lbs", "CL"),
]


@pytest.mark.parametrize(("key", "total", "prefix"), AXES, ids=[axis[0] for axis in AXES])
def test_aircraft_of_jsbsim_get_more_of_every_function_of_an_axis(key, total, prefix):
    state = 52.0, 4 * DEG, 2 * DEG, (0.2, 0.1, -0.1), (0.05, -0.05, 0.04), 0.6
    fdms = [evaluated(aircraft("c172p", **off), *state) for off in ({}, {key: 1.25})]
    catalog = fdms[0].names("aero/coefficient/")
    parts = [n for n in catalog if n.startswith(f"aero/coefficient/{prefix}")]
    unsteady = [n for n in parts if n.endswith("adot")]  # of the evaluation before

    nominal, scaled = (
        fdm.reader(total)() - sum(fdm.reader(name)() for name in unsteady) for fdm in fdms
    )
    part = sum(fdms[0].reader(name)() for name in parts if name not in unsteady)

    assert scaled - nominal == pytest.approx(0.25 * part, rel=ONE_PER_MILLE)
    assert abs(part) > 10.0


@pytest.mark.parametrize(("name", "V_a"), [("aerosonde", 25.0), ("c172p", 50.0), ("a4", 200.0)])
def test_thrust_at_a_throttle_is_scaled_for_every_kind_of_engine(name, V_a):
    thrust = []
    for factor in (1.0, 1.2):
        fdm = evaluated(aircraft(name, thrust=factor), V_a, 0.02, 0.0, STILL, STILL, 0.6)
        fdm.settle_engine()
        fdm.evaluate()
        thrust.append(fdm.reader("propulsion/engine[0]/thrust-lbs")())

    assert thrust[0] > 0.0
    assert thrust[1] / thrust[0] == pytest.approx(1.2, rel=1e-6)


@pytest.mark.parametrize(("name", "V_a"), [("aerosonde", 25.0), ("a4", 200.0)])
@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_surfaces_follow_a_step_with_the_lag_times_the_factor(name, V_a, factor):
    fdm = evaluated(aircraft(name, actuator_lag=factor), V_a, 0.02, 0.0, STILL, STILL, 0.5)
    watched = SURFACES[: 2 if name == "a4" else 3]  # its yaw damper moves the rudder as well
    for surface in watched:
        fdm.writer(f"ft/{surface}-trim-rad")(0.01)
    position = [fdm.reader(f"ft/{surface}-rad") for surface in watched]
    begun = [read() for read in position]

    for _ in range(10):  # 50 ms
        fdm.run()

    moved = [(read() - before) / 0.01 for read, before in zip(position, begun, strict=True)]
    since = 0.05 - 0.5 / 200.0  # trapezoidal rule: half a step
    reached = 1.0 - math.exp(-since / (factor * LAG))
    assert moved == pytest.approx([reached] * len(moved), abs=ONE_PER_MILLE)


def flown(**plant):
    plant = ft.loop.JSBSimPlant("aerosonde", **plant)
    plant.start(ft.loop.FlightCondition(V_a=25.0))
    for _ in range(100):
        plant.advance(0.4, 1.1, 0.02)
    return plant.observe()


def test_a_nominal_aircraft_flies_to_the_same_bits_with_factors_of_one():
    ones = off_nominal(coefficients=(("Cm_alpha", 1.0),))

    assert flown() == flown(off_nominal=off_nominal()) == flown(off_nominal=ones)
    assert flown() != flown(off_nominal=off_nominal(ixx=1.001))


def digest(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def test_shipped_files_stay_as_they_are_and_nothing_is_left_behind(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    ours = [SHIPPED_AIRCRAFT / name for name in ("aerosonde", "c172p")]
    shipped = [*ours, Path(jsbsim.get_default_root_dir()) / "aircraft" / "c172p"]
    before = [digest(folder) for folder in shipped]

    aircraft("aerosonde", **ALL)
    aircraft("c172p", mass=1.1, lift=0.9, thrust=0.9, actuator_lag=1.5)

    assert [digest(folder) for folder in shipped] == before
    assert list(tmp_path.iterdir()) == []


REFUSED = [
    ({"mass": 0.1}, "c172p", r"`mass_factor` must be above 0\.202, what load and fuel weigh"),
    ({"iyy": 1.01}, "a4", r"`iyy_factor` must leave principal inertias"),
    ({"coefficients": (("Cm_alpa", 1.1),)}, "aerosonde", r"`coefficient_factors\.Cm_alpa` must .*"
     r"did you mean Cm_alpha\?"),
    ({"coefficients": (("CLalpha", 1.1),)}, "c172p", r"`coefficient_factors\.CLalpha` must be a"),
]  # fmt: skip


@pytest.mark.parametrize(("off", "name", "message"), REFUSED, ids=[str(one[0]) for one in REFUSED])
def test_what_cannot_be_is_refused_by_the_name_of_its_key(off, name, message):
    with pytest.raises(ft.InputError, match=message) as caught:
        ft.loop.JSBSimPlant(name, off_nominal=off_nominal(**off))

    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("file", "pattern", "text", "off", "message"),
    [
        ("aerosonde.xml", '"SIDE"', '"Y"', {"side_force": 1.1}, "`side_force_factor` .* no SIDE"),
        ("aerosonde.xml", "Cl_r", "Cl_p", {"coefficients": (("Cl_p", 1.1),)}, "it means aero/c.*,"),
    ],
)
def test_what_an_aircraft_lacks_is_refused(changed_aircraft, file, pattern, text, off, message):
    folder = changed_aircraft(file, pattern, text)

    with pytest.raises(ft.InputError, match=message):
        ft.loop.JSBSimPlant(folder, off_nominal=off_nominal(**off))


def test_an_engine_of_another_kind_cannot_be_scaled(changed_aircraft):
    for pattern in ("<electric_engine", "</electric_engine"):
        rocket = pattern.replace("electric", "rocket")
        folder = changed_aircraft("Engines/aerosonde_motor.xml", pattern, rocket)

    with pytest.raises(ft.InputError, match=r"`thrust_factor` .* <rocket_engine>"):
        ft.loop.JSBSimPlant(folder, off_nominal=off_nominal(thrust=0.9))


def test_the_page_names_every_coefficient_of_the_aerosonde():
    page = (Path(__file__).parents[4] / "docs/off_nominal.md").read_text(encoding="utf-8")
    model = (SHIPPED_AIRCRAFT / "aerosonde" / "aerosonde.xml").read_text(encoding="utf-8")

    told = re.findall(r"`(\w+)`", re.split(r"[Tt]he Aerosonde has ", page)[1].split(". The")[0])

    assert sorted(told) == sorted(re.findall(r'name="aero/coefficient/(\w+)"', model))
