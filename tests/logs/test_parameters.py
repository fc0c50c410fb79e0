"""Parameters of an autopilot as ground stations and logs write them."""

import re
import struct

import pytest
from log_files import _format, message
from pymavlink.mavutil import mavlink

import flighttune as ft
from flighttune.control.laws.autopilot import guidance
from flighttune.logs.parameters import flown_now

HEAD = """# Onboard parameters for Vehicle 1
#
# Stack: PX4 Pro
# Vehicle: {vehicle}
# Version: {version}
# Git Revision: 0123456789abcdef
#
# Vehicle-Id Component-Id Name Value Type
"""


def write_params(path, values, *, vehicle="Fixed Wing", version="1.15.4 "):
    """A file as QGroundControl writes it."""
    rows = "".join(f"1\t1\t{name}\t{value:.18f}\t9\n" for name, value in values.items())
    path.write_text(HEAD.format(vehicle=vehicle, version=version) + rows)
    return path


def write_ulog(path, values, version=(1, 15, 4, 255)):
    """A ULog with parameters and the version of PX4, and no flight."""
    release = int.from_bytes(bytes(version), "big")
    key = b"uint32_t ver_sw_release"
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), message("B", bytes(40))]
    out.append(message("I", struct.pack("<B", len(key)) + key + struct.pack("<I", release)))
    for name, value in values.items():
        key = f"float {name}".encode()
        out.append(message("P", struct.pack("<B", len(key)) + key + struct.pack("<f", value)))
    out.append(message("F", b"vehicle_status:uint64_t timestamp;"))
    out.append(message("A", struct.pack("<BH", 0, 0) + b"vehicle_status"))
    out.append(message("D", struct.pack("<HQ", 0, 10**6)))
    path.write_bytes(b"".join(out))
    return path


def write_dataflash(path, values, vehicle="ArduPlane V4.5.7 (0123abcd)"):
    """A DataFlash log with parameters and the vehicle, and no flight."""
    out = [_format(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    out.append(_format(129, 75, "MSG", "QZ", "TimeUS,Message"))
    out.append(_format(130, 31, "PARM", "QNf", "TimeUS,Name,Value"))
    out.append(b"\xa3\x95" + struct.pack("<BQ64s", 129, 10**6, vehicle.encode()))
    for name, value in values.items():
        out.append(b"\xa3\x95" + struct.pack("<BQ16sf", 130, 10**6, name.encode(), value))
    path.write_bytes(b"".join(out))
    return path


def write_tlog(path, values, vehicle=1, whole=()):
    """A telemetry log with the vehicle and parameters, `whole` as the bytes of integers."""
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    sent = [mavlink.MAVLink_heartbeat_message(vehicle, 3, 0, 0, 4, 3)]
    kept = [(name, value, mavlink.MAV_PARAM_TYPE_REAL32) for name, value in values.items()]
    for name, value in whole:
        (same,) = struct.unpack("<f", struct.pack("<i", value))
        kept.append((name, same, mavlink.MAV_PARAM_TYPE_INT32))
    sent += [mavlink.MAVLink_param_value_message(name.encode(), x, k, 9, 0) for name, x, k in kept]
    path.write_bytes(b"".join(struct.pack(">Q", 10**15) + each.pack(link) for each in sent))
    return path


PX4 = {"NPFG_PERIOD": 12.5, "FW_AIRSPD_TRIM": 21.0, "NPFG_GSP_MAX_TK": 5.0, "RC1_MIN": 1000.0}
PLANE = {"NAVL1_PERIOD": 14.0, "LIM_ROLL_CD": 5500.0, "TECS_THR_DAMP": 0.5, "RC1_MIN": 1000.0}


@pytest.mark.parametrize("write", [write_params, write_ulog])
def test_parameters_of_px4_are_read_by_their_names(tmp_path, write):
    now = flown_now(write(tmp_path / "px4.ulg", PX4))

    assert now.law.parameters == {"NPFG_PERIOD": 12.5}
    assert now.name == "NPFG and TECS of PX4 1.15.4"
    assert now.unused == ["NPFG_GSP_MAX_TK"]
    assert now.airspeed == ("FW_AIRSPD_TRIM", 21.0)
    assert now.rest == 1
    rows = {row["name"]: row for row in now.rows}
    assert rows["NPFG_PERIOD"] == {
        "name": "NPFG_PERIOD", "value": 12.5, "range": "1 to 100 s", "from": "px4.ulg"
    }  # fmt: skip
    assert rows["FW_R_LIM"]["value"] == 50.0
    assert rows["FW_R_LIM"]["from"] == "default of PX4 1.14"


@pytest.mark.parametrize("separator", [",", " ", "\t"])
def test_mission_planner_separates_as_it_likes(tmp_path, separator):
    file = tmp_path / "plane.param"
    lines = [f"{name}{separator}{value}" for name, value in PLANE.items()]
    file.write_text("#NOTE: 1/2/2024 Plane: mine\n" + "\n".join(lines) + "  # comment\n")
    now = flown_now(file, "4.4")

    assert now.law.parameters == {"NAVL1_PERIOD": 14.0, "ROLL_LIMIT_DEG": 55.0}
    assert now.name == "L1 and TECS of ArduPilot 4.4"
    assert (now.unused, now.rest) == (["TECS_THR_DAMP"], 1)


def test_a_parameter_by_its_new_name_stands_before_that_by_its_former(tmp_path):
    file = tmp_path / "plane.param"
    file.write_text("NAVL1_PERIOD,14\nLIM_ROLL_CD,5500\nROLL_LIMIT_DEG,40\n")

    now = flown_now(file, "4.5")

    assert now.law.parameters["ROLL_LIMIT_DEG"] == 40.0
    assert now.notes[:1] == ["LIM_ROLL_CD is 5500 and ROLL_LIMIT_DEG 40: ROLL_LIMIT_DEG is used."]


def test_a_log_of_ardupilot_has_its_parameters_and_version(tmp_path):
    now = flown_now(write_dataflash(tmp_path / "plane.bin", PLANE))

    assert now.law.parameters == {"NAVL1_PERIOD": 14.0, "ROLL_LIMIT_DEG": 55.0}
    assert now.name == "L1 and TECS of ArduPilot 4.5.7"


def test_a_telemetry_log_has_its_parameters_and_vehicle(tmp_path):
    file = tmp_path / "flight.tlog"
    now = flown_now(write_tlog(file, PLANE), "4.4")
    assert now.law.parameters == {"NAVL1_PERIOD": 14.0, "ROLL_LIMIT_DEG": 55.0}

    # https://mavlink.io/en/services/parameter.html: PX4 encodes integers by their bytes
    whole = ("MAV_TYPE", 22), ("NPFG_LB_PERIOD", 1), ("NPFG_UB_PERIOD", 0)
    now = flown_now(write_tlog(file, PX4, 22, whole), "1.15")
    assert now.law.parameters == {
        "NPFG_PERIOD": 12.5, "NPFG_LB_PERIOD": 1.0, "NPFG_UB_PERIOD": 0.0
    }  # fmt: skip
    with pytest.raises(ft.InputError, match="got MAV_TYPE 2"):
        flown_now(write_tlog(file, PLANE, 2))


def test_px4_of_before_npfg_flies_l1_unless_it_is_told_otherwise(tmp_path):
    both = {"FW_L1_PERIOD": 15.0, "NPFG_PERIOD": 11.0}
    file = tmp_path / "px4.params"
    assert flown_now(write_params(file, both, version="1.13.3")).law.parameters == {
        "FW_L1_PERIOD": 15.0
    }
    write_params(file, {**both, "FW_USE_NPFG": 1.0}, version="1.13.3")
    assert flown_now(file).law.parameters == {"NPFG_PERIOD": 11.0}
    write_params(file, {"FW_L1_PERIOD": 15.0}, version="1.12.3")
    assert "has an older TECS" in " ".join(flown_now(file).notes)
    write_params(file, {"FW_L1_PERIOD": 15.0, "FW_T_TIME_CONST": 5.0}, version="1.11.0")
    assert "FW_T_TIME_CONST, the time in which" in " ".join(flown_now(file).notes)


def test_builds_of_px4_that_do_not_use_the_period_are_flown_without_it(tmp_path):
    file = write_params(tmp_path / "px4.params", PX4, version="1.17.0 beta")
    held = {"NPFG_PERIOD": 10.0, "NPFG_DAMPING": 0.7071}
    assert flown_now(file).law.parameters == held
    assert "do not use NPFG_PERIOD" in " ".join(flown_now(file).notes)
    assert flown_now(file, "1.17.0").law.parameters == {"NPFG_PERIOD": 12.5}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ATC_RAT_RLL_P,0.1\nPSC_POSXY_P,1", "got ATC_RAT_RLL_P and PSC_POSXY_P of a copter"),
        ("NAVL1_PERIOD,10\nCRUISE_SPEED,2\nTURN_RADIUS,1", "CRUISE_SPEED and TURN_RADIUS of a rov"),
        ("NAVL1_PERIOD,8\nSURFACE_DEPTH,-10", "SURFACE_DEPTH of a submarine"),
        ("TECS_SINK_MAX,5\nATC_STR_RAT_P,1\nMODE1,0", "of a rover or boat beside TECS_SINK_MAX of"),
        ("MPC_XY_P,1\nMC_ROLL_P,6\nFW_AIRSPD_TRIM,15", "MC_ROLL_P and MPC_XY_P of a copter"),
        ("FRAME_CLASS,1\nNAVL1_PERIOD,8", "FRAME_CLASS of a copter or rover"),
        (
            "NAVL1_PERIOD,8\nNPFG_PERIOD,9",
            "one autopilot, got NAVL1_PERIOD of ArduPilot and NPFG_PE",
        ),
        (
            "FW_T_CLMB_MAX,5",
            "`version` must be given, as by --version 1.15: the file has neither NPFG_PERIOD",
        ),
        ("NAVL1_PERIOD,15,5", "line 1 must be NAME,VALUE .* with a decimal point, got .*15,5"),
        ("NAVL1_PERIOD 15,5", "line 1 must be NAME,VALUE .* with a decimal point, got .*15,5"),
        ("NAVL1_PERIOD;15,5", "line 1 must be NAME,VALUE"),
        ("1\t1\tNPFG_PERIOD\t12,5\t9", "line 1 must be NAME,VALUE .* with a decimal point"),
        ("NAVL1_PERIOD = 15", "line 1 must be NAME,VALUE"),
        (
            "NAVL1_PERIOD,175",
            r"near their published ranges, got NAVL1_PERIOD 175 \(1 to 60 s\): is a",
        ),
        ("NAVL1_DAMPING,75\nTECS_SPDWEIGHT,5", r"75 \(0.6 to 1\) and TECS_SPDWEIGHT 5 \(0 to 2\)"),
        ("ROLL_LIMIT_DEG,4500", r"4500 \(0 to 90 deg; 45 in hundredths of a degree\)"),
        (
            "LIM_ROLL_CD,45",
            r"LIM_ROLL_CD 45 \(0.45 deg\), which is in hundredths of a degree: in deg",
        ),
        ("LIM_ROLL_CD,450000", r"LIM_ROLL_CD 450000 \(4500 deg\) \(0 to 90 deg\)"),
        ("NAVL1_PERIOD,nan", "`NAVL1_PERIOD` must be a positive number, got nan"),
        (HEAD.format(vehicle="Multi-Rotor", version="1.15.4"), "got Multi-Rotor"),
        ("NPFG_PERIOD,8\nMAV_TYPE,2", "got MAV_TYPE 2"),
        ("NPFG_PERIOD 8", "`version` must be given, as by --version 1.15"),
        ("NAVL1_PERIOD,-3", "x.param: `NAVL1_PERIOD` must be a positive number, got -3"),
        ("NAVL1_PERIOD\n", "x.param: line 1 must be NAME,VALUE or"),
        ("NAVL1_PERIOD,fast", "x.param: line 1 must be NAME,VALUE or"),
        ("RC1_MIN,1000", "got none of NAVL1_PERIOD, NPFG_PERIOD, FW_L1_PERIOD in 1 parameters"),
    ],
)
def test_what_is_no_guidance_of_an_aeroplane_is_refused_in_a_line(tmp_path, text, words):
    file = tmp_path / "x.param"
    file.write_text(text)
    with pytest.raises(ft.InputError, match=words):
        flown_now(file)


def test_a_copter_s_log_is_refused(tmp_path):
    file = write_dataflash(tmp_path / "copter.bin", PLANE, vehicle="ArduCopter V4.5.7")
    with pytest.raises(ft.InputError, match="of an aeroplane, got ArduCopter"):
        flown_now(file)


CHANGED = "AIRSPEED_CRUISE 15\nROLL_LIMIT_DEG 50\nTECS_TIME_CONST 4 @READONLY\nRLL2SRV_TCONST 0.4\n"


def test_a_file_of_changed_parameters_flies_the_defaults_of_the_others_and_says_so(tmp_path):
    """17 s is the default of NAVL1_PERIOD in AP_L1_Control.cpp of ArduPilot 4.5."""
    file = tmp_path / "changed.param"
    file.write_text(CHANGED)
    now = flown_now(file)

    assert now.law.parameters == {
        "NAVL1_PERIOD": 17.0, "ROLL_LIMIT_DEG": 50.0, "TECS_TIME_CONST": 4.0
    }  # fmt: skip
    assert now.unused == ["RLL2SRV_TCONST"]
    assert now.notes == [
        "NAVL1_PERIOD is not in the file: its default in ArduPilot 4.5, 17 s, flies, as those of "
        "15 others."
    ]
    rows = {row["name"]: row["from"] for row in now.rows}
    assert rows["NAVL1_PERIOD"] == "default of ArduPilot 4.5"
    assert rows["ROLL_LIMIT_DEG"] == "changed.param"


@pytest.mark.parametrize(
    ("version", "more", "period"),
    [
        ("1.15.4", {}, {"NPFG_PERIOD": 10.0}),
        ("1.13.3", {}, {"FW_L1_PERIOD": 20.0}),
        ("1.13.3", {"FW_USE_NPFG": 1.0}, {"NPFG_PERIOD": 10.0}),
    ],
)
def test_the_guidance_of_changed_parameters_of_px4_is_that_of_its_version(
    tmp_path, version, more, period
):
    file = write_params(tmp_path / "px4.params", {"FW_T_CLMB_MAX": 6.0} | more, version=version)

    assert flown_now(file).law.parameters == {"FW_T_CLMB_MAX": 6.0} | period


def test_a_vtol_of_px4_has_parameters_of_copters(tmp_path):
    values = PX4 | {"MPC_XY_P": 1.0, "MC_ROLL_P": 6.0, "MC_PITCH_P": 6.0, "VT_TYPE": 2.0}
    values |= {"MC_YAW_P": 3.0, "MPC_Z_P": 1.0, "MPC_THR_HOVER": 0.5}

    assert flown_now(write_params(tmp_path / "v.params", values)).law.parameters == {
        "NPFG_PERIOD": 12.5
    }


def test_a_value_beyond_its_published_range_flies_and_is_said(tmp_path):
    file = tmp_path / "plane.param"
    file.write_text("NAVL1_PERIOD,62\nPTCH2SRV_TCONST,0.3\nTECS_PTCH_DAMP,0.1\nROLL_LIMIT_DEG,90\n")
    now = flown_now(file)

    assert now.beyond == ["NAVL1_PERIOD 62 (1 to 60 s)", "PTCH2SRV_TCONST 0.3 (0.4 to 1 s)"]
    assert now.law.parameters["NAVL1_PERIOD"] == 62.0


@pytest.mark.parametrize(
    ("rows", "period", "said"),
    [
        (["1 1 NPFG_PERIOD 12 9", "1 154 NPFG_PERIOD 99 9"], 12.0,
         "NPFG_PERIOD is also 99 of component 154: 12 is used."),
        (["1 154 NPFG_PERIOD 99 9", "1 1 NPFG_PERIOD 12 9"], 12.0,
         "NPFG_PERIOD is also 99 of component 154: 12 is used."),
        (["1 1 NPFG_PERIOD 15 9", "1 1 NPFG_PERIOD 25 9"], 25.0,
         "NPFG_PERIOD is also 15 before: 25 is used."),
        (["1 1 NPFG_PERIOD 12 9", "2 1 NPFG_PERIOD 14 9"], 12.0,
         "NPFG_PERIOD is also 14 of component 1 of vehicle 2: 12 is used."),
        (["1 1 NPFG_PERIOD 12 9", "1 154 NPFG_PERIOD 12 9", "1 154 MNT_RATE 9 9"], 12.0, ""),
    ],
)  # fmt: skip
def test_the_parameters_are_those_of_the_autopilot_of_the_first_vehicle(
    tmp_path, rows, period, said
):
    file = tmp_path / "px4.params"
    file.write_text("\n".join(row.replace(" ", "\t") for row in rows) + "\n")
    now = flown_now(file, "1.15")

    assert now.law.parameters == {"NPFG_PERIOD": period}
    assert now.notes == ([said] if said else [])


def test_a_telemetry_log_has_the_parameters_of_the_autopilot_among_its_components(tmp_path):
    file = write_tlog(tmp_path / "flight.tlog", PLANE)
    gimbal = mavlink.MAVLink(None, srcSystem=1, srcComponent=154)
    sent = mavlink.MAVLink_param_value_message(b"NAVL1_PERIOD", 99.0, 9, 9, 0)
    with file.open("ab") as log:
        log.write(struct.pack(">Q", 10**15) + sent.pack(gimbal))

    assert flown_now(file, "4.4").law.parameters["NAVL1_PERIOD"] == 14.0


def test_every_default_is_within_its_published_range():
    for table in guidance().values():
        for name, x, _, _, low, high in table["parameters"]:
            assert low <= x <= high, name


@pytest.mark.parametrize("unknown", ["-1.-1.-1", "0.0.0", "banana"])
def test_a_placeholder_for_a_version_states_none(tmp_path, unknown):
    file = write_params(tmp_path / "px4.params", PX4, version=unknown)
    with pytest.raises(ft.InputError, match=r"`version` must be given, as by --version 1\.15"):
        flown_now(file)
    assert flown_now(file, "1.15").name.endswith("PX4 1.15")
    with pytest.raises(ft.InputError, match=r"`version` must be such as 1\.15, got 'banana'"):
        flown_now(file, "banana")


def test_every_airspeed_of_an_autopilot_is_read_in_mps(tmp_path):
    """MAVLink has m/s; ArduPilot's older TRIM_ARSPD_CM has cm/s."""
    file = tmp_path / "x.param"
    for period, table in guidance().items():
        for name, unit in table["airspeed"].items():
            file.write_text(f"{period},17\n{name},{18.0 / unit:g}\n")
            now = flown_now(file, table["versions"][0])

            assert now.airspeed == (name, pytest.approx(18.0))
            assert name not in now.unused


def test_a_newer_version_is_told(tmp_path):
    file = tmp_path / "px4.params"
    for version, told in (("1.17.0", False), ("1.18.0", True), ("2.0.0", True)):
        notes = flown_now(write_params(file, PX4, version=version)).notes
        assert ("is newer than 1.17" in str(notes)) == told


@pytest.mark.parametrize(
    ("rows", "words", "older"),
    [
        # release notes of ArduPlane 4.5: ROLL_LIMIT_DEG replaces LIM_ROLL_CD; pull request 22191,
        # of ArduPlane 4.4, has the present TECS and TECS_HDEM_TCONST
        ("NAVL1_PERIOD,17\nROLL_LIMIT_DEG,45", "ArduPilot 4.5 or newer", False),
        ("NAVL1_PERIOD,17\nTECS_HDEM_TCONST,3", "ArduPilot 4.4 or newer", False),
        ("LIM_ROLL_CD,4500\nTECS_HDEM_TCONST,3", "ArduPilot 4.4", False),
        ("FW_L1_PERIOD,20\nFW_T_TIME_CONST,5", "PX4 1.12 or older", True),
        ("FW_L1_PERIOD,20\nFW_T_ALT_TC,5", "PX4 1.13", False),
    ],
)
def test_a_file_without_a_version_tells_it_by_names_that_came_or_went(tmp_path, rows, words, older):
    file = tmp_path / "x.param"
    file.write_text(rows)
    now = flown_now(file)
    assert now.name == f"L1 and TECS of {words}"
    assert now.older_tecs is older
    assert ("has an older TECS" in str(now.notes)) is older


@pytest.mark.parametrize("rows", ["NAVL1_PERIOD,17", "LIM_ROLL_CD,4500", "FW_L1_PERIOD,20"])
def test_a_file_whose_names_tell_no_version_asks_for_it(tmp_path, rows):
    file = tmp_path / "x.param"
    file.write_text(rows)
    other = "4.3" if "FW" not in rows else "1.11"
    with pytest.raises(ft.InputError, match=r"x\.param: `version` must be given, as by") as refused:
        flown_now(file)
    example = re.search(r"--version ([\d.]+)", str(refused.value))[1]
    now = flown_now(file, example)
    assert not now.older_tecs
    assert "is that your version" not in " ".join(now.notes).replace(f"is {example} ", "is that ")
    assert flown_now(file, other).older_tecs


def test_names_that_a_version_does_not_have_are_said(tmp_path):
    file = tmp_path / "x.param"
    file.write_text("NAVL1_PERIOD,17\nROLL_LIMIT_DEG,45\n")
    assert "ROLL_LIMIT_DEG is of ArduPilot 4.5 or newer: is 4.3 your" in str(
        flown_now(file, "4.3").notes
    )
    assert "your version" not in str(flown_now(file, "4.6.1").notes)
    assert "4.7.1 is newer than 4.6" in str(flown_now(file, "4.7.1").notes)
    file.write_text("NAVL1_PERIOD,17\nLIM_ROLL_CD,4500\n")
    assert "LIM_ROLL_CD is of ArduPilot 4.4 or older: is 4.6 your" in str(
        flown_now(file, "4.6").notes
    )
