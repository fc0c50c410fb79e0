"""Parameters of an autopilot as ground stations and logs write them, and what flies of them."""

import math
import re

import pytest
from commands import flighttune
from log_files import dataflash, tlog, ulog

import flighttune as ft

TURN = """
title = "turn"
gains = ["paper"]
flight = { V_a_mps = 25.0, chi_deg = 5.0, duration_s = 0.1 }
reference = { chi_deg = 0.0, gamma_deg = 0.0 }
plant = [{ kind = "kinematic" }]
"""
HEAD = """# Onboard parameters for Vehicle 1
#
# Vehicle: {vehicle}
# Version: {version}
# Vehicle-Id Component-Id Name Value Type
"""
REAL, WHOLE = 9, 6  # MAVLink's numbers of types


def params(path, values, *, vehicle="Fixed Wing", version="1.15.4 "):
    """A file as QGroundControl writes it."""
    rows = "".join(f"1\t1\t{name}\t{value:.18f}\t9\n" for name, value in values.items())
    path.write_text(HEAD.format(vehicle=vehicle, version=version) + rows)
    return path


def param(path, values, separator=","):
    """A file as Mission Planner writes it."""
    rows = "\n".join(f"{name}{separator}{value!r}" for name, value in values.items())
    path.write_text("#NOTE: 1/2/2024 Plane: mine\n" + rows + "  # comment\n")
    return path


FORMS = {
    "params": params,
    "param": param,
    "spaced": lambda path, values: param(path, values, "\t"),
    "ulg": lambda path, values: ulog(path, {"a": ([1.0], {"b": [1.0]})}, values, (1, 15, 4, 255)),
    "bin": lambda path, values: dataflash(path, {}, values, "ArduPlane V4.5.7 (0123abcd)"),
    "tlog": lambda path, values: tlog(path, {}, 1, [(n, x, REAL, 1) for n, x in values.items()]),
}
OF = {
    "NPFG_PERIOD": ("1.15", ("params", "ulg", "tlog")),
    "FW_L1_PERIOD": ("1.13", ("params",)),
    "NAVL1_PERIOD": ("4.5", ("param", "spaced", "bin", "tlog")),
}


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """The guidance that flies with a file of parameters, and its answer."""
    turn = tmp_path_factory.mktemp("turn") / "turn.toml"
    turn.write_text(TURN)
    return lambda path, version=None: (
        ft.compare(turn, autopilot=path, flights=1, version=version).now
    )


@pytest.fixture
def read(flown, tmp_path):
    """The guidance of a text of parameters."""

    def read(text, version=None):
        (tmp_path / "x.param").write_text(text)
        return flown(tmp_path / "x.param", version)

    return read


def inside(row):
    """A value of a parameter inside its published range."""
    ends = [float(x) for x in re.findall(r"-?\d[\d.e+]*", row["range"])[:2]]
    low, high = ends if len(ends) > 1 else (ends[0], ends[0] + 2.0)
    other, same = (low + share * (high - low) for share in (0.3, 0.4))
    return same if other == row["value"] else other


@pytest.mark.parametrize("period", OF)
def test_every_parameter_of_a_guidance_is_read_in_every_form_that_holds_it(flown, tmp_path, period):
    """Its default stands in a file without it, and lies within the published range."""
    version, forms = OF[period]
    rows = flown(FORMS[forms[0]](tmp_path / "x", {period: 15.0}), version).rows
    assert len(rows) > 10
    values = {row["name"]: inside(row) for row in rows}
    for row in rows:
        assert row["from"].startswith("default of ") or row["name"] == period
        ends = [float(x) for x in re.findall(r"-?\d[\d.e+]*", row["range"])[:2]]
        assert ends[0] <= row["value"] <= (ends[1:] or [math.inf])[0], row
    for form in forms:
        now = flown(FORMS[form](tmp_path / f"x.{form}", values), version)

        assert now.law.parameters == pytest.approx(values, rel=1e-6), form
        assert {row["from"] for row in now.rows} == {f"x.{form}"}
        assert (now.beyond, now.unused, now.rest) == ([], [], 0)


@pytest.mark.parametrize("form", ["params", "ulg"])
def test_parameters_of_px4_have_their_version_airspeed_and_rest(flown, tmp_path, form):
    values = {"NPFG_PERIOD": 12.5, "FW_AIRSPD_TRIM": 21.0, "NPFG_GSP_MAX_TK": 5.0, "RC1_MIN": 1e3}
    now = flown(FORMS[form](tmp_path / "px4", values))

    assert now.law.parameters == {"NPFG_PERIOD": 12.5}
    assert now.name == "NPFG and TECS of PX4 1.15.4"
    assert (now.unused, now.airspeed, now.rest) == (
        ["NPFG_GSP_MAX_TK"],
        ("FW_AIRSPD_TRIM", 21.0),
        1,
    )


FORMER = {"NAVL1_PERIOD": 14.0, "LIM_ROLL_CD": 5500.0, "TECS_THR_DAMP": 0.5, "RC1_MIN": 1e3}


@pytest.mark.parametrize("form", ["param", "bin", "tlog"])
def test_names_that_are_no_longer_used_are_read_in_their_unit(flown, tmp_path, form):
    now = flown(FORMS[form](tmp_path / "x", FORMER), "4.4")

    assert now.law.parameters == {"NAVL1_PERIOD": 14.0, "ROLL_LIMIT_DEG": 55.0}
    assert (now.name, now.unused) == ("L1 and TECS of ArduPilot 4.4", ["TECS_THR_DAMP"])


def test_telemetry_has_the_autopilot_among_its_components_and_whole_numbers_by_their_bytes(
    flown, tmp_path
):
    """https://mavlink.io/en/services/parameter.html: PX4 encodes integers by their bytes."""
    import struct

    def same(value):
        return struct.unpack("<f", struct.pack("<i", value))[0]

    sent = [("NPFG_PERIOD", 12.5, REAL, 1), ("MAV_TYPE", same(22), WHOLE, 1)]
    sent += [("NPFG_LB_PERIOD", same(1), WHOLE, 1), ("NPFG_PERIOD", 99.0, REAL, 154)]
    now = flown(tlog(tmp_path / "x.tlog", {}, 22, sent), "1.15")
    assert now.law.parameters == {"NPFG_PERIOD": 12.5, "NPFG_LB_PERIOD": 1.0}
    with pytest.raises(ft.InputError, match="got MAV_TYPE 2"):
        flown(tlog(tmp_path / "x.tlog", {}, 2, [("NAVL1_PERIOD", 14.0, REAL, 1)]), "4.5")


READ = [
    # text | version | parameters | words of the notes, or none
    ("NAVL1_PERIOD,14\nLIM_ROLL_CD,5500\nROLL_LIMIT_DEG,40", "4.5", {"NAVL1_PERIOD": 14.0,
     "ROLL_LIMIT_DEG": 40.0}, "5500 and ROLL_LIMIT_DEG 40: ROLL_LIMIT_DEG is"),
    ("1\t1\tNPFG_PERIOD\t12\t9\n1\t154\tNPFG_PERIOD\t99\t9", "1.15", {"NPFG_PERIOD": 12.0},
     "also 99 of component 154: 12"),
    ("1\t154\tNPFG_PERIOD\t99\t9\n1\t1\tNPFG_PERIOD\t12\t9", "1.15", {"NPFG_PERIOD": 12.0},
     "also 99 of component 154: 12"),
    ("1\t1\tNPFG_PERIOD\t15\t9\n1\t1\tNPFG_PERIOD\t25\t9", "1.15", {"NPFG_PERIOD": 25.0},
     "also 15 before: 25"),
    ("1\t1\tNPFG_PERIOD\t12\t9\n2\t1\tNPFG_PERIOD\t14\t9", "1.15", {"NPFG_PERIOD": 12.0},
     "also 14 of component 1 of vehicle 2: 12"),
    ("1\t1\tNPFG_PERIOD\t12\t9\n1\t154\tNPFG_PERIOD\t12\t9", "1.15", {"NPFG_PERIOD": 12.0}, None),
    ("ROLL_LIMIT_DEG 50\nTECS_TIME_CONST 4 @READONLY", None, {"NAVL1_PERIOD": 17.0,
     "ROLL_LIMIT_DEG": 50.0, "TECS_TIME_CONST": 4.0}, "17 s, flies, as .* 15 oth"),
    ("NPFG_PERIOD,12.5", "1.17.0 beta", {"NPFG_PERIOD": 10.0, "NPFG_DAMPING": 0.7071},
     "do not use NPFG_P"),
    ("NPFG_PERIOD,12.5", "1.17.0", {"NPFG_PERIOD": 12.5}, None),
    ("NPFG_PERIOD,12.5", "1.18.0", {"NPFG_PERIOD": 12.5}, "1.18.0 is newer than 1.17"),
    ("NPFG_PERIOD,12.5", "2.0.0", {"NPFG_PERIOD": 12.5}, "2.0.0 is newer than 1.17"),
    ("FW_L1_PERIOD,15\nNPFG_PERIOD,11", "1.13", {"FW_L1_PERIOD": 15.0}, None),
    ("FW_L1_PERIOD,15\nNPFG_PERIOD,11\nFW_USE_NPFG,1", "1.13", {"NPFG_PERIOD": 11.0}, None),
    ("FW_T_CLMB_MAX,6", "1.15", {"FW_T_CLMB_MAX": 6.0, "NPFG_PERIOD": 10.0}, None),
    ("FW_T_CLMB_MAX,6", "1.13", {"FW_T_CLMB_MAX": 6.0, "FW_L1_PERIOD": 20.0}, None),
    ("FW_T_CLMB_MAX,6\nFW_USE_NPFG,1", "1.13", {"FW_T_CLMB_MAX": 6.0, "NPFG_PERIOD": 10.0}, None),
    ("FW_L1_PERIOD,15", "1.12", {"FW_L1_PERIOD": 15.0}, "has an older TECS"),
    ("FW_L1_PERIOD,15\nFW_T_TIME_CONST,5", "1.11", {"FW_L1_PERIOD": 15.0},
     "FW_T_TIME_CONST, the time"),
    ("NAVL1_PERIOD,17\nROLL_LIMIT_DEG,45", "4.3", {"NAVL1_PERIOD": 17.0, "ROLL_LIMIT_DEG": 45.0},
     "ROLL_LIMIT_DEG is of ArduPilot 4.5 or newer: is 4.3 your"),
    ("NAVL1_PERIOD,17\nLIM_ROLL_CD,4500", "4.6", {"NAVL1_PERIOD": 17.0, "ROLL_LIMIT_DEG": 45.0},
     "LIM_ROLL_CD is of ArduPilot 4.4 or older: is 4.6 your"),
    ("NPFG_PERIOD,12\nMPC_XY_P,1\nMC_ROLL_P,6\nVT_TYPE,2\nMPC_Z_P,1\nMC_YAW_P,3", "1.15",
     {"NPFG_PERIOD": 12.0}, None),
]  # fmt: skip


@pytest.mark.parametrize(("text", "version", "parameters", "words"), READ)
def test_what_flies_is_that_of_the_first_autopilot_and_of_its_version(
    read, text, version, parameters, words
):
    now = read(text, version)

    assert now.law.parameters == parameters
    assert (
        re.search(words, " ".join(now.notes)) if words else not any("also" in x for x in now.notes)
    )
    if words is None and version:
        assert "your version" not in str(now.notes)


TOLD = [
    # release notes of ArduPlane 4.5: ROLL_LIMIT_DEG replaces LIM_ROLL_CD; pull request 22191, of
    # ArduPlane 4.4, has the present TECS and TECS_HDEM_TCONST
    ("NAVL1_PERIOD,17\nROLL_LIMIT_DEG,45", "ArduPilot 4.5 or newer", False),
    ("NAVL1_PERIOD,17\nTECS_HDEM_TCONST,3", "ArduPilot 4.4 or newer", False),
    ("LIM_ROLL_CD,4500\nTECS_HDEM_TCONST,3", "ArduPilot 4.4", False),
    ("FW_L1_PERIOD,20\nFW_T_TIME_CONST,5", "PX4 1.12 or older", True),
    ("FW_L1_PERIOD,20\nFW_T_ALT_TC,5", "PX4 1.13", False),
]


@pytest.mark.parametrize(("text", "words", "older"), TOLD)
def test_a_file_without_a_version_tells_it_by_names_that_came_or_went(read, text, words, older):
    now = read(text)
    assert now.name == f"L1 and TECS of {words}"
    assert now.older_tecs is older


@pytest.mark.parametrize("text", ["NAVL1_PERIOD,17", "LIM_ROLL_CD,4500", "FW_L1_PERIOD,20"])
def test_a_file_whose_names_tell_no_version_asks_for_it_with_one_that_fits(read, text):
    with pytest.raises(ft.InputError, match=r"x\.param: `version` must be given") as refused:
        read(text)
    now = read(text, re.search(r"--version ([\d.]+)", str(refused.value))[1])
    assert not now.older_tecs
    assert read(text, "1.11" if "FW" in text else "4.3").older_tecs


@pytest.mark.parametrize(
    ("name", "size", "period", "version"),
    [
        ("AIRSPEED_CRUISE", 1.0, "NAVL1_PERIOD", "4.5"),
        ("TRIM_ARSPD_CM", 0.01, "NAVL1_PERIOD", "4.4"),
        ("FW_AIRSPD_TRIM", 1.0, "NPFG_PERIOD", "1.15"),
        ("FW_AIRSPD_TRIM", 1.0, "FW_L1_PERIOD", "1.13"),
    ],
)
def test_the_airspeed_of_an_autopilot_is_read_in_mps(read, name, size, period, version):
    now = read(f"{period},17\n{name},{18.0 / size:g}\n", version)

    assert now.airspeed == (name, pytest.approx(18.0))
    assert name not in now.unused


def test_a_value_beyond_its_published_range_flies_and_is_said(read):
    now = read("NAVL1_PERIOD,62\nPTCH2SRV_TCONST,0.3\nTECS_PTCH_DAMP,0.1\nROLL_LIMIT_DEG,90\n")

    assert now.beyond == ["NAVL1_PERIOD 62 (1 to 60 s)", "PTCH2SRV_TCONST 0.3 (0.4 to 1 s)"]
    assert now.law.parameters["NAVL1_PERIOD"] == 62.0


REFUSED = r"""
ATC_RAT_RLL_P,0.1;PSC_POSXY_P,1 | got ATC_RAT_RLL_P and PSC_POSXY_P of a copter
NAVL1_PERIOD,10;CRUISE_SPEED,2;TURN_RADIUS,1 | CRUISE_SPEED and TURN_RADIUS of a rov
NAVL1_PERIOD,8;SURFACE_DEPTH,-10 | SURFACE_DEPTH of a submarine
TECS_SINK_MAX,5;ATC_STR_RAT_P,1;MODE1,0 | of a rover or boat beside TECS_SINK_MAX of
MPC_XY_P,1;MC_ROLL_P,6;FW_AIRSPD_TRIM,15 | MC_ROLL_P and MPC_XY_P of a copter
FRAME_CLASS,1;NAVL1_PERIOD,8 | FRAME_CLASS of a copter or rover
NAVL1_PERIOD,8;NPFG_PERIOD,9 | one autopilot, got NAVL1_PERIOD of ArduPilot and NPFG_PE
FW_T_CLMB_MAX,5 | --version 1.15: the file has neither NPFG_PERIOD
NAVL1_PERIOD,15,5 | line 1 must be NAME,VALUE .* with a decimal point, got .*15,5
NAVL1_PERIOD;15,5 | line 1 must be NAME,VALUE
1 1 NPFG_PERIOD 12,5 9 | line 1 must be NAME,VALUE .* with a decimal point
NAVL1_PERIOD = 15 | line 1 must be NAME,VALUE
NAVL1_PERIOD,17;NAVL1_DAMPING,fast | line 2 must be NAME,VALUE
NAVL1_PERIOD,175 | near their published ranges, got NAVL1_PERIOD 175 \(1 to 60 s\)
NAVL1_DAMPING,75;TECS_SPDWEIGHT,5 | 75 \(0.6 to 1\) and TECS_SPDWEIGHT 5 \(0 to 2\)
ROLL_LIMIT_DEG,4500 | 4500 \(0 to 90 deg; 45 in hundredths of a degree\)
LIM_ROLL_CD,45 | LIM_ROLL_CD 45 \(0.45 deg\), which is in hundredths of a degree
LIM_ROLL_CD,450000 | LIM_ROLL_CD 450000 \(4500 deg\) \(0 to 90 deg\)
NAVL1_PERIOD,nan | `NAVL1_PERIOD` must be a positive number, got nan
NAVL1_PERIOD,-3 | x.param: `NAVL1_PERIOD` must be a positive number, got -3
# Vehicle: Multi-Rotor;NPFG_PERIOD,8 | got Multi-Rotor
NPFG_PERIOD,8;MAV_TYPE,2 | got MAV_TYPE 2
NPFG_PERIOD 8 | `version` must be given, as by --version 1.15
# Version: -1.-1.-1;NPFG_PERIOD,8 | `version` must be given, as by --version 1.15
# Version: 0.0.0;NPFG_PERIOD,8 | `version` must be given, as by --version 1.15
RC1_MIN,1000 | got none of NAVL1_PERIOD, NPFG_PERIOD, FW_L1_PERIOD in 1 parameters
"""


@pytest.mark.parametrize("row", REFUSED.strip().splitlines())
def test_what_is_no_guidance_of_an_aeroplane_is_refused_in_a_line(read, row):
    text, words = row.split(" | ")
    with pytest.raises(ft.InputError, match=words):
        read(text.replace(";", "\n"))


def test_a_copter_s_log_a_wrong_version_and_no_file_are_refused(flown, tmp_path):
    file = dataflash(tmp_path / "copter.bin", {}, FORMER, "ArduCopter V4.5.7")
    for path, version, words in (
        (file, None, "of an aeroplane, got ArduCopter"),
        (param(tmp_path / "x.param", FORMER), "banana", r"must be such as 1\.15, got 'banana'"),
        (tmp_path / "gone.param", None, "no such file"),
    ):
        with pytest.raises(ft.InputError, match=words):
            flown(path, version)


STATED = {
    "NAVL1_DAMPING,0.75\r\nNAVL1_PERIOD,17\r\nTECS_TIME_CONST,5\r\nROLL_LIMIT_DEG,45\r\n": ".param",
    "#NOTE: plane\n\nNAVL1_PERIOD    17.000000   # flown\nTECS_HDEM_TCONST 3\n": ".param",
    "NAVL1_PERIOD 17\nROLL_LIMIT_DEG 45 @READONLY\nNAVL1_DAMPING 0.75": ".parm",
    HEAD.format(vehicle="Fixed Wing", version="1.15.4 ")
    + "1\t1\tNPFG_PERIOD\t10.0\t9\n1\t42\tNPFG_PERIOD\t10.0\t9\n": ".params",
}
AIM = TURN + "[[expect]]\nat_most.chi.peak_deg = 400.0\n"


@pytest.mark.soak
@pytest.mark.parametrize("text", STATED)
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_a_search_changes_values_alone_and_all_else_stays_to_the_byte(tmp_path, text, mark):
    ending = STATED[text]
    (tmp_path / "aim.toml").write_text(AIM)
    (tmp_path / f"mine{ending}").write_bytes((mark + text).encode())
    command = (
        "meet",
        "aim.toml",
        "--with",
        f"mine{ending}",
        "--budget",
        6,
        "--out",
        f"new{ending}",
    )

    flighttune(*command, cwd=tmp_path, status=None)

    if (tmp_path / f"new{ending}").exists():
        found = (tmp_path / f"new{ending}").read_bytes().decode()
        assert found.startswith(mark)
        lines = [x for x in found.removeprefix(mark).splitlines() if x[:2] != "# " or x in text]
        assert [re.sub(r"[\d.]+", "0", x) for x in lines if x] == [
            re.sub(r"[\d.]+", "0", x) for x in text.splitlines() if x
        ]
