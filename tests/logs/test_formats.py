"""One flight in every form that a log has: each column that is known comes back in SI."""

import math
import struct
import tomllib

import numpy as np
import pandas as pd
import pytest
from log_files import dataflash, message, quaternion, tlog, ulog
from places import ROOT
from scipy import constants as si

import flighttune as ft

SOURCES = tomllib.loads((ROOT / "flighttune/logs/sources.toml").read_text(encoding="utf-8"))
KINDS = {"ULog": ulog, "DataFlash": dataflash, "MAVLink": tlog}
TAKEN = {"MAVLink": 1e-3, "ULog": 2e-5, "DataFlash": 1e-6, "csv": 1e-9}
"""Rounding: telemetry has mm/s, mG and 1e-7 deg; ULog has 32 bits."""

UNITS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "angle": {"rad": 1.0}
    | dict.fromkeys(("deg", "°"), si.degree)
    | {"cdeg": si.degree / 100.0, "1e-7deg": 1e-7 * si.degree},
    "rate": {"rad/s": 1.0, "deg/s": si.degree, "°/s": si.degree},
    "length": {"m": 1.0, "mm": si.milli, "cm": si.centi, "km": si.kilo, "ft": si.foot},
    "speed": {"m/s": 1.0, "cm/s": si.centi, "ft/s": si.foot, "km/h": si.kmh}
    | dict.fromkeys(("kn", "kt"), si.knot),
    "load": {"1": 1.0, "g": 1.0, "mG": 1e-3},
    "force": dict.fromkeys(("m/s^2", "m/s2", "m/s²"), 1.0) | {"g": si.g, "mG": 1e-3 * si.g},
}
OF_UNITS = {"time": "t", "angle": "psi", "rate": "p", "length": "h", "speed": "V_a"}
OF_UNITS |= {"load": "n_z", "force": "f_z"}
DT = 0.06
T = DT * np.arange(150)  # below the ten seconds from which columns are checked


def flight():
    """A climbing turn in wind, in every signal that some log has."""
    chi, gamma = 0.5 + 0.08 * T, 0.05 + 0.02 * np.sin(0.3 * T)
    V_g = 24.0 + np.sin(0.2 * T)
    over = {"v_north": V_g * np.cos(chi), "v_east": V_g * np.sin(chi), "v_down": -V_g * gamma}
    path = {x.removeprefix("v_"): DT * np.cumsum(v) for x, v in over.items()}
    angles = {"phi": 0.2 + 0.1 * np.sin(T), "theta": 0.1 * np.cos(0.5 * T), "psi": chi - 0.1}
    angles |= {"chi": chi, "phi_cmd": 0.1 + 0.1 * np.sin(T), "chi_ref": chi + 0.02}
    rates = {x: 0.1 * np.sin(T + k) for k, x in enumerate("pqr")}
    air = {"V_a": 20.0 + np.cos(0.2 * T), "wind_north": 3.0 + 0.1 * np.sin(T), "wind_east": -4.0}
    air |= {"wind_speed": np.hypot(air["wind_north"], 4.0)}
    air["wind_from"] = np.arctan2(4.0, -air["wind_north"])
    errors = {"cross_track": 5.0 * np.sin(T), "height_err": 2.0 * np.cos(T), "V_g": V_g}
    n_z = 1.2 + 0.1 * np.sin(T)
    lat, lon = math.radians(47.4) + path["north"] / 6.37e6, math.radians(8.5) + path["east"] / 4.3e6
    q = zip("wxyz", quaternion(angles["phi"], angles["theta"], angles["psi"]).T, strict=True)
    command = quaternion(angles["phi_cmd"], 0.0 * T, 0.0 * T).T
    found = over | path | angles | rates | air | errors | {"n_z": n_z, "f_z": -si.g * n_z}
    found |= {"lat": lat, "lon": lon, "h": 500.0 - path["down"], "n_z_cmd": 1.0 + 0.1 * np.cos(T)}
    found |= {f"q_{x}": v for x, v in q}
    found |= {f"q_cmd_{x}": v for x, v in zip("wxyz", command, strict=True)}
    return {name: values + 0.0 * T for name, values in found.items()}


FLIGHT = flight()
EVENTS = {
    # before, from 3 s, from 6 s on; of the number in each kind of log
    "mode": ((3, 4, 3), (10, 12, 10), (67371008, 50593792, 67371008)),
    "armed": ((1, 2, 2), (0, 1, 1), (0, 128, 255)),
    "airborne": ((1, 1, 0), (0, 0, 1), (1, 1, 2)),
    "fix": ((3, 2, 3),) * 3,
    "clip_x": ((0, 2, 2),) * 3,
    "clip_y": ((4, 4, 5),) * 3,
    "clip_z": ((0, 0, 0),) * 3,
    "vibe_x": ((1, 5, 1),) * 3,
    "vibe_y": ((1, 1, 2),) * 3,
    "vibe_z": ((1, 1, 31),) * 3,
    "vehicle": ((2, 2, 2),) * 3,
}


def values_of(kind, name):
    if name not in EVENTS:
        return FLIGHT[name]
    values = EVENTS[name][[*KINDS].index(kind)]
    return np.select([T < 2.99, T < 5.99], values[:2], values[2]).astype(float)


def unit_of(words, name):
    """SI value of the unit in a source, with its sign."""
    unit = words.removeprefix("-")
    sizes = {"": 1.0} | {u: x for k, of in UNITS.items() if k != "load" for u, x in of.items()}
    return sizes[unit] * (-1.0 if words.startswith("-") else 1.0)


def written(path, kind, rank, but=()):
    """A log with the source of this rank of each signal, and the names that it has."""
    topics, names = {}, []
    for name, each in SOURCES[kind].items():
        if name in but or (name.startswith("q_") and "phi" in SOURCES[kind]):
            continue
        source, _, unit = each[min(rank, len(each) - 1)].partition(":")
        topic, _, field = source.partition(".")
        values = values_of(kind, name) / unit_of(unit, name)
        names.append(name)
        of = topics.setdefault(topic, (T, {}))[1]
        key, bracket, index = field.partition("[")
        if bracket:  # a field of several values
            of.setdefault(key, np.zeros((len(T), 4)))[:, int(index[:-1])] = values
        else:
            of[field] = values
    return KINDS[kind](path, topics), names


def assert_flight(run, names, kind):
    """Signals are those flown, from what the log has."""
    for name in names:
        values = run.signals[name].to_numpy()
        expected = FLIGHT[name]
        if name in ("north", "east", "down"):
            expected = expected - expected[0]
        off = (
            np.angle(np.exp(1j * (values - expected)))
            if abs(expected).max() < 7
            else (values - expected)
        )
        assert np.abs(off).max() < 30.0 * TAKEN[kind], name


ANGLES = "phi theta psi phi_cmd"
REST = "n_z V_a h north east down V_g chi"
HAVE = {
    "ULog": f"{ANGLES} {REST} p q r chi_ref wind_north wind_east cross_track",
    "DataFlash": f"{ANGLES} {REST} p q r wind_north wind_east cross_track height_err",
    "MAVLink": f"{ANGLES} {REST} p q r wind_north wind_east cross_track height_err",
}
PLACES = ("north", "east", "down", "v_north", "v_east", "v_down", "V_g", "chi")


@pytest.mark.parametrize("rank", [0, 1])
@pytest.mark.parametrize("kind", KINDS)
def test_every_source_of_a_binary_log_is_read_in_its_unit_and_sign(tmp_path, kind, rank):
    # a message of telemetry has all its fields: its second source of a velocity is alone
    but = ("north", "east", "down") if (kind, rank) == ("MAVLink", 1) else ()
    path, names = written(tmp_path / "log.dat", kind, rank, but=but)

    run = ft.load_log(path)

    assert_flight(run, [x for x in HAVE[kind].split() if x not in but], kind)
    log = run.provenance.log
    assert log["kind"] == kind
    states = dict(line.split(" for ") for line in log["phases"])
    last = f"{T[-1]:.1f} s"
    assert states["armed"].endswith(f": 3.0 to {last}")
    assert states["airborne"].endswith(f": 6.0 to {last}")
    first, second = ("MISSION", "LOITER") if kind != "DataFlash" else ("AUTO", "LOITER")
    assert states[first].endswith(f": 0.0 to 3.0, 6.0 to {last}")
    assert states[second] == "3.0 s: 3.0 to 6.0 s"
    clipped, shaken, lost = log["sensors"]
    assert "3 times, first at 3.0 s" in clipped
    assert f"up to {5 if kind == 'ULog' else 31} m/s²" in shaken
    assert "3.0 s, first at 3.0 s" in lost
    assert {*names} <= {*SOURCES[kind]}


def test_places_on_earth_alone_give_position_and_velocity(tmp_path):
    """Radii of the meridian and of the parallel on the ellipsoid WGS 84."""
    path, _ = written(tmp_path / "log.dat", "DataFlash", 0, but=PLACES)

    signals = ft.load_log(path).signals

    a, e2, lat = 6_378_137.0, 6.69437999014e-3, FLIGHT["lat"]
    across = 1.0 - e2 * math.sin(lat[0]) ** 2
    north = a * (1.0 - e2) / across**1.5 * (lat - lat[0])
    east = a / math.sqrt(across) * math.cos(lat[0]) * (FLIGHT["lon"] - FLIGHT["lon"][0])
    assert signals["north"].to_numpy() == pytest.approx(north, abs=0.05)
    assert signals["east"].to_numpy() == pytest.approx(east, abs=0.05)
    assert signals["down"].to_numpy() == pytest.approx(FLIGHT["h"][0] - FLIGHT["h"], abs=0.01)
    speeds = np.hypot(np.gradient(north, DT), np.gradient(east, DT))
    assert signals["V_g"].to_numpy()[2:-2] == pytest.approx(speeds[2:-2], abs=0.3)
    climb = np.arctan2(np.gradient(FLIGHT["h"], DT), speeds)
    assert signals["gamma"].to_numpy()[2:-2] == pytest.approx(climb[2:-2], abs=0.02)


@pytest.mark.parametrize("rank", range(4))
def test_every_label_of_jsbsim_is_read_with_and_without_its_path(tmp_path, rank):
    table = {}
    for name, each in SOURCES["JSBSim"].items():
        label, _, unit = each[min(rank, len(each) - 1)].partition(":")
        if rank == 3:
            label = label.removeprefix("/fdm/jsbsim/")
        values = T if name == "t" else FLIGHT[name]
        table[label] = values / unit_of(unit, name) / (-1.0 if name == "f_z" else 1.0)
    pd.DataFrame(table).to_csv(tmp_path / "jsbsim.csv", index=False)

    run = ft.load_log(tmp_path / "jsbsim.csv")

    names = [x for x in SOURCES["JSBSim"] if x not in ("t", "v_north", "v_east", "v_down", "f_z")]
    assert run.t == pytest.approx(T)
    for name in (x for x in names if x not in ("chi", "V_g", "psi")):
        assert run.signals[name].to_numpy() == pytest.approx(FLIGHT[name], rel=1e-9), name
    assert not run.provenance.log["missing"] or "No signal" not in str(run.provenance.log)


def said_of_units():
    """The units that a refusal lists, which are all that there are."""
    with pytest.raises(ft.InputError, match="furlong") as refusal:
        ft.load_log("nowhere.csv", columns={"V_a": "x:furlong"})
    return str(refusal.value).partition("one of ")[2].partition(", with a minus")[0].split(", ")


def test_every_unit_that_is_known_has_the_factor_of_its_definition(tmp_path):
    """A round of the table below writes one column of each kind, in its next unit."""
    assert {*said_of_units()} == {unit for of in UNITS.values() for unit in of}
    for k in range(max(map(len, UNITS.values()))):
        table, columns, signs = {}, {}, {}
        for i, (kind, of) in enumerate(UNITS.items()):
            unit, size = [*of.items()][k % len(of)]
            name, sign = OF_UNITS[kind], -1.0 if (i + k) % 2 and kind != "time" else 1.0
            values = T if kind == "time" else FLIGHT[name]
            table[f"col {i}"] = sign * values / size
            columns[name] = f"col {i}:{'-' * (sign < 0)}{unit}"
            signs[name] = unit
        alone = columns.pop("n_z" if k % 2 else "f_z")
        table["phi"] = FLIGHT["phi"]
        pd.DataFrame(table).to_csv(tmp_path / "f.csv", index=False)

        run = ft.load_log(tmp_path / "f.csv", columns=columns)

        assert alone
        assert run.t == pytest.approx(T, abs=1e-9)
        for name in ("psi", "p", "h", "V_a", "n_z"):
            assert run.signals[name].to_numpy() == pytest.approx(FLIGHT[name]), (name, signs)


LABELS = [
    (("t", "phi_deg", "V_a_kt", "n_z", "h_ft"), (1.0, si.degree, si.knot, 1.0, si.foot)),
    (("time [s]", "phi [deg]", "V_a[kt]", "n_z [-]", "h_m"), (1.0, si.degree, si.knot, 1.0, 1.0)),
    (("timestamp_ms", "phi (°)", "V_a [km/h]", "n_z [g]", "h (cm)"), (1e-3, si.degree, si.kmh, 1.0,
     0.01)),
    (("t (us)", "phi_rad", "V_a_fps", "n_z (m/s2)", "h [km]"), (1e-6, 1.0, si.foot, 1.0, 1e3)),
    (("time_s ", "phi ", "V_a_kmh ", "n_z ", "h_m "), (1.0, 1.0, si.kmh, 1.0, 1.0)),
]  # fmt: skip
FORMS = [
    {},
    {"sep": ";", "decimal": ","},
    {"sep": "\t", "encoding": "latin-1"},
    {"encoding": "utf-16"},
    {"sep": ";"},
]


@pytest.mark.parametrize(("labels", "form"), [*zip(LABELS, FORMS, strict=True)])
def test_a_table_is_read_by_its_labels_in_every_dialect(tmp_path, labels, form):
    names = ("t", "phi", "V_a", "n_z", "h")
    values = {"t": T} | FLIGHT
    table = {
        label: values[name] / unit for name, label, unit in zip(names, *labels, strict=True)
    } | {"Höhe [°]": 1.0}
    pd.DataFrame(table).to_csv(tmp_path / "f.csv", index=False, **form)

    run = ft.load_log(tmp_path / "f.csv")

    assert run.t == pytest.approx(T, abs=1e-9)
    for name in names[1:]:
        assert run.signals[name].to_numpy() == pytest.approx(FLIGHT[name]), name
    assert "from Höhe [°];" in " ".join(run.provenance.log["missing"])


@pytest.mark.parametrize("day", ["%d.%m.%Y", "%m/%d/%Y", "%Y-%m-%d"])
@pytest.mark.parametrize("start", ["2026-06-11 23:59:55", "2026-06-25"])
def test_dates_are_read_past_midnight_whatever_comes_first(tmp_path, day, start):
    stamps = pd.date_range(start, periods=150, freq="60ms").strftime(f"{day} %H:%M:%S.%f")
    table = pd.DataFrame({"time": stamps, "phi": FLIGHT["phi"], "V_a_mps": 25.0})
    table.loc[149, "time"] = "0.0"  # a row with a number
    table.to_csv(tmp_path / "f.csv", index=False)

    run = ft.load_log(tmp_path / "f.csv")

    assert run.t[:149] == pytest.approx(T[:149], abs=1e-9)
    assert run.signals["phi"].to_numpy()[:149] == pytest.approx(FLIGHT["phi"][:149])


def test_columns_of_several_places_are_joined_and_the_last_one_counts(tmp_path):
    pd.DataFrame({"clock": 1e3 * T, "bank": -FLIGHT["phi"], "v:w": FLIGHT["V_a"]}).to_csv(
        tmp_path / "f.csv", index=False
    )
    (tmp_path / "mine.toml").write_text('t = "clock:ms"\nphi = "gone"\nV_a = "v:w:m/s"\n')

    run = ft.load_log(tmp_path / "f.csv", columns=[tmp_path / "mine.toml", "phi=bank:-rad"])

    assert run.t == pytest.approx(T)
    assert run.signals["phi"].to_numpy() == pytest.approx(FLIGHT["phi"])
    assert run.signals["V_a"].to_numpy() == pytest.approx(FLIGHT["V_a"])


@pytest.mark.parametrize("old", [False, True])
def test_a_field_may_be_two_signals_and_a_command_is_the_measured_value_plus_its_error(
    tmp_path, old
):
    """Errors come between the measured values, of which the last one counts."""
    later = T[1:-1] + 0.03
    messages = {
        "ATT": (T, {"Roll": np.degrees(FLIGHT["phi"])}),
        "ARSP": (T, {"Airspeed": 20 + 0 * T}),
    }
    messages["ERR"] = later, {"Phi": 0.1 * np.cos(later)}
    path = dataflash(tmp_path / "f.dat", messages, old=old)
    columns = ["theta=ATT.Roll:deg", "phi_err=ERR.Phi"]

    run = ft.load_log(path, columns=columns)

    assert run.t == pytest.approx(T, abs=1e-9)
    signals = run.signals
    assert signals["theta"].to_numpy() == pytest.approx(FLIGHT["phi"], abs=1e-6)
    command = np.interp(T, later, FLIGHT["phi"][1:-1] + 0.1 * np.cos(later))
    assert signals["phi_cmd"].to_numpy()[2:-2] == pytest.approx(command[2:-2], abs=1e-6)


@pytest.mark.soak
def test_a_dataflash_log_that_was_converted_to_text_is_read_and_cut_into_modes(tmp_path):
    """Mission Planner writes such: FBWA (mode 5 of ArduPlane), AUTO (10), LOITER (12), 5 s each."""
    modes = (5, 10, 5, 10, 5, 12)
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 1, 17, ATT, Icccc, TimeMS,DesRoll,Roll,Pitch,Yaw",
        "FMT, 2, 30, GPS, BIHffI, Status,TimeMS,Week,Spd,GCrs,T",
        "FMT, 3, 20, MODE, IB, TimeMS,Mode",
        *(f"MODE, {5000 + 5000 * k}, {mode}" for k, mode in enumerate(modes)),
        *(f"ATT, {5000 + 100 * i}, 12.00, {0.1 * i:.2f}, 2.00, 90.00" for i in range(300)),
        # the clock of old GPS messages is that of the week, beside T
        *(
            f"GPS, 3, {10**8 + 200 * i}, 1800, {22 + 0.01 * i}, 90.0, {5000 + 200 * i}"
            for i in range(150)
        ),
    ]
    path = tmp_path / "modes.log"
    path.write_text("\n".join([*lines, ""]))

    whole = ft.load(path)
    assert whole.signals["V_g"].to_numpy()[100] == pytest.approx(22.5)
    assert whole.signals["phi_cmd"].to_numpy()[100] == pytest.approx(math.radians(12.0))
    for mode, first, last in (("auto", 1, 3), ("FBWA", 0, 4), ("Loiter", 5, 5)):
        part = ft.load(f"{path}@{mode}")
        phi, t = np.degrees(part.signals["phi"].to_numpy()), part.t - part.t[0] + 5.0 * first
        assert t[-1] == pytest.approx(5.0 * last + 4.9, abs=0.11)  # the end of the last
        into, number = np.modf(t / 5.0)
        own = (number % 2 == first % 2) & (0.02 < into) & (into < 0.98)
        other = (number % 2 != first % 2) & (0.02 < into) & (into < 0.98)
        assert phi[own] == pytest.approx(t[own], abs=0.11)
        assert np.isnan(phi[other]).all()
    with pytest.raises(ft.InputError, match="FBWA, AUTO, LOITER, got 'LAND'"):
        ft.load(f"{path}@LAND")


@pytest.mark.parametrize("ends", [(3.0, 6.12), (0.0, 6.0), (3.0, math.inf)])
def test_a_part_of_a_log_is_from_a_time_to_another(tmp_path, ends):
    path = tmp_path / "a.csv"
    pd.DataFrame({"t": T, "phi": FLIGHT["phi"], "phi_cmd": 0.0, "V_a": T}).to_csv(path, index=False)
    words = ":".join("" if x in (0.0, math.inf) else f"{x:g}" for x in ends)

    V_a = ft.load(f"{path}@{words}").signals["V_a"]

    assert (V_a.iloc[0], V_a.iloc[-1]) == pytest.approx((ends[0], min(ends[1], T[-1])))


def test_of_two_sensors_of_one_kind_the_first_is_read(tmp_path):
    topics = {"vehicle_attitude": {"q": quaternion(*(FLIGHT[x] for x in ("phi", "theta", "psi")))}}
    topics["airspeed_validated"] = {"true_airspeed_m_s": FLIGHT["V_a"]}
    path = ulog(tmp_path / "flight.ulg", {name: (T, x) for name, x in topics.items()})
    second = [message("A", struct.pack("<BH", 1, 99) + b"airspeed_validated")]
    for stamp in (1e6 * T).astype(int).tolist():
        second.append(message("D", struct.pack("<HQf", 99, stamp + 10**6, 77.0)))
    path.write_bytes(path.read_bytes() + b"".join(second))

    assert ft.load_log(path).signals["V_a"].to_numpy() == pytest.approx(FLIGHT["V_a"], rel=1e-6)


def test_whatever_jsbsim_writes_itself_needs_no_columns(tmp_path):
    import jsbsim

    path, directive = tmp_path / "flight.csv", tmp_path / "output.xml"
    parts = "".join(f"<{part}> ON </{part}>" for part in ("rates", "velocities", "position"))
    directive.write_text(f'<output name="{path}" type="CSV" rate="20">{parts}</output>')
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.load_model("c172p")
    fdm.set_output_directive(str(directive))
    fdm["ic/h-sl-ft"], fdm["ic/vc-kts"], fdm["ic/psi-true-deg"] = 4000.0, 100.0, 350.0
    fdm.run_ic()
    rows = []
    while fdm.get_sim_time() < 3.0:
        fdm.run()
        rows.append((fdm.get_sim_time(), fdm["velocities/q-rad_sec"], fdm["attitude/theta-rad"]))
    del fdm
    text = path.read_text()
    socket = tmp_path / "socket.csv"  # with a mark before its labels, and none before rows
    socket.write_text(f"<LABELS>,{text}")

    for file in (path, socket):
        run = ft.load_log(file)
        first, (t, q, theta) = run.signals.iloc[0], np.transpose(rows)
        assert first["psi"] == pytest.approx(math.radians(-10.0), abs=1e-3)
        assert first["h"] == pytest.approx(4000.0 * si.foot, abs=1.0)
        for name, true in (("q", q), ("theta", theta)):
            there = np.interp(run.t[1:-1], t, true)
            assert run.signals[name].to_numpy()[1:-1] == pytest.approx(there, abs=0.03), name


def test_gaps_of_a_log_and_values_that_no_flight_has_are_left_out_and_said(tmp_path):
    """A fifth of nine seconds is a gap of all, and one sample of a speed is none."""
    table = pd.DataFrame({"t": T, **{x: FLIGHT[x] for x in ("phi", "v_north", "v_east", "h")}})
    table.loc[100, "v_north"] = -1e308
    table[(T < 3.6) | (T > 5.4)].to_csv(tmp_path / "f.csv", index=False)

    run = ft.load_log(tmp_path / "f.csv")

    assert DT * run.signals["phi"].isna().sum() == pytest.approx(1.8, abs=0.2)
    assert run.signals["V_g"].max() < 26.0
    gaps, large = run.provenance.log["gaps"]
    share = float(gaps.split()[2])
    assert share == pytest.approx(100.0 * run.signals["phi"].isna().mean(), abs=0.06)
    assert "phi" in gaps
    assert large == "v_north: samples of 1e+09 or more left out, 1"


REFUSED = """
t,b;1,2                          | must be a column `t`.* columns t and b|roll in numbers
a,b;1,2                          | the time must be a column `t`.* columns a and b
t,phi;0,5,0,1                    | 2 labels and 4 cells
t,phi,V_g;0,0,9;50,0,9           | one every 50 s; .*t=COLUMN:ms
t,phi,V_g;0,0,9;6000,0,9         | one every 6e.03 s; .*t=COLUMN:us
t,roll;0,0;1,0                   | must have roll in numbers .*--column phi=
t,phi [grad];0,0;1,0             | `phi \\[grad\\]` must be .*got 'grad'
t,phi;0,0;0.1,0;0.2,0            | more than 10 samples, the log has 0.2 s
"""


@pytest.mark.parametrize("row", REFUSED.strip().splitlines())
def test_what_is_no_flight_is_refused_in_one_line(tmp_path, row):
    text, _, words = row.partition("|")
    (tmp_path / "x.csv").write_text(text.strip().replace(";", "\n") + "\n")

    with pytest.raises(ft.InputError, match=words.strip()) as refusal:
        ft.load_log(tmp_path / "x.csv")
    assert "\n" not in str(refusal.value)


COLUMNS_REFUSED = """
chi=heding:deg    | the column of `chi` must be one of the file's, got 'heding'
course=V_a        | `course` must be a signal
V_a=V_a:furlong   | `V_a` must be one of .*got 'furlong'
trusted=thetta    | trusted: `thetta` must
@-1:10            | must be START:END in s
@20:10            | must be START:END in s
@10:10            | must be START:END in s
@one:10           | must be START:END in s
@AUTO             | which has no flight mode, got 'AUTO'
"""


@pytest.mark.parametrize("row", COLUMNS_REFUSED.strip().splitlines())
def test_a_wrong_column_or_part_is_one_line(tmp_path, row):
    given, _, words = (x.strip() for x in row.partition("|"))
    table = {"t": T, "phi": FLIGHT["phi"], "V_a": FLIGHT["V_a"]}
    pd.DataFrame(table).to_csv(tmp_path / "f.csv", index=False)
    part, columns = (given, ()) if given.startswith("@") else ("", given)

    with pytest.raises(ft.InputError, match=words):
        ft.load(f"{tmp_path / 'f.csv'}{part}", columns=columns)


def table_of(**columns):
    return {"t": T, "phi": FLIGHT["phi"], "V_g": 20.0 + 0.0 * T} | columns


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (table_of(phi_rad=-FLIGHT["phi"]), "columns of `phi` must agree, got phi_rad and phi"),
        (table_of(h_m=100.0 + T, h=102.2 + T), "columns of `h` must agree"),
        (table_of(h_m=100.0 + T, h=101.0 + T), ""),
        (table_of(psi=3.1 + 0 * T, psi_deg=-181.0 + 0 * T), ""),
        (table_of(psi=0.5 + 0 * T, psi_rad=0.5 + 2 * math.pi + 0 * T), ""),
        (table_of(t=np.floor(T)), "clock must tell samples apart"),
        (table_of(t=2.0 * DT * np.floor(np.arange(150) / 2.0)), ""),
        (table_of(V_g=4.9 + 0 * T, V_a=9.0), "a speed of at most 4.9 m/s"),
        (table_of(V_g=5.0 + 0 * T, V_a=1.0), ""),
        ({"t": T, "phi": FLIGHT["phi"], "V_a": 4.0}, "a speed of at most 4 m/s"),
        ({"t": T, "phi": FLIGHT["phi"]}, "got no airspeed, no roll commands, no ground speed"),
        ({"t": T, "phi": FLIGHT["phi"], "phi_cmd": 0.0}, ""),
        (table_of(t=T + 4000.0 * (T > 6.03)), "a break of 4e.03 s at 6.0 s; a part"),
        (table_of(t=T + 3000.0 * (T > 6.03)), ""),
        (table_of(t=T - 6.0 * (T > 6.03)), "must run forward, got a jump by -5.94 s at 6.0 s"),
        (table_of(t=T - 3.0 * (T > 6.03)), ""),
    ],
)
def test_columns_and_clocks_that_cannot_be_of_a_flight_are_refused(tmp_path, table, words):
    pd.DataFrame(table).to_csv(tmp_path / "f.csv", index=False)
    if not words:
        assert len(ft.load_log(tmp_path / "f.csv").signals) > 70
        return
    with pytest.raises(ft.RecordingError, match=words):
        ft.load_log(tmp_path / "f.csv")


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda p: dataflash(p, {"ATT": (T, {"Roll": T}), "GPS": (T, {"Spd": 20 + 0 * T})},
         vehicle="ArduCopter V4"), "without wings .ArduCopter.*no airspeed"),
        (lambda p: tlog(p, {"ATTITUDE": (T, {}), "VFR_HUD": (T, {"airspeed": 9 + 0 * T})}, 13),
         "without wings .type 13.*no roll commands"),
        (lambda p: ulog(p, {"vehicle_attitude": (T, {"q": np.eye(4)[[0] * 150]}),
         "vehicle_status": (T, {"vehicle_type": 1 + 0 * T})}), "without wings .type 1 of PX4"),
        (lambda p: p.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(3)) and p, "ULog log, got a dam"),
        (lambda p: p.write_text("t,phi\n0,0\n") and p, "must be a ULog .*got another file"),
    ],
)  # fmt: skip
def test_a_vehicle_without_wings_and_another_file_are_refused(tmp_path, write, words):
    with pytest.raises(ft.RecordingError, match=words):
        ft.load_log(write(tmp_path / "x.dat"))


@pytest.mark.soak
def test_a_format_that_asks_for_all_memory_ends_the_reading_alone(tmp_path):
    layouts = [f"m{k}:m{k + 1}[65535] {'a' * 200};" for k in range(4)]
    layouts = [*layouts, "m4:uint8_t x;", "vehicle_attitude:uint64_t timestamp;m0[65535] q;"]
    data = [b"ULog\x01\x12\x35\x01" + bytes(8), message("B", bytes(40))]
    data += [message("F", layout.encode()) for layout in layouts]
    data += [message("A", struct.pack("<BH", 0, 0) + b"vehicle_attitude")]
    path = tmp_path / "bomb.ulg"
    path.write_bytes(b"".join([*data, message("D", bytes(2 + 8 + 100))]))

    with pytest.raises(ft.RecordingError, match=r"must be (read in 900|a ULog)"):
        ft.load_log(path)
