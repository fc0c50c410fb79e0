"""Logs of every kind written from one flight come back as that flight; bad ones are one line."""

import math
import re
import socket
import struct
import time
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from log_files import COMMAND, WRITERS, message, sampled, write_dataflash, write_tlog, write_ulog

import flighttune as ft
from flighttune.logs import log, read
from flighttune.logs.streams import phases

FT = 0.3048
"""One foot, m."""

ENOUGH_S = 30.0
"""Of the flight in a log of each kind."""

SINGLE = 2e-5
"""Rounding of an angle or speed to 32 bits, and of a stamp to 1 ms at 1 rad/s, over 40 ms."""
BETWEEN = 0.03
"""What a straight line between samples at 25 Hz misses of a signal, rad and 1."""


def until(end, t, signals):
    """The first samples of a flight: the readers of telemetry and DataFlash take 10 ms a second."""
    early = t < end
    return t[early], {name: values[early] for name, values in signals.items()}


@pytest.fixture(scope="session", params=[*WRITERS])
def written(request, clean, tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / request.param
    return WRITERS[request.param](path, *until(ENOUGH_S, *clean))


@pytest.fixture(scope="session")
def run(written):
    return ft.load_log(written, columns=COMMAND.get(written.name, ()))


@pytest.fixture
def table(clean, tmp_path):
    """A table of half of the flight, with columns made from it changed or taken out."""
    t, signals = until(75.0, *clean)

    def write(drop=(), **columns):
        path = WRITERS["flight.csv"](tmp_path / "flight.csv", t, signals)
        made = {name: make(signals) for name, make in columns.items()}
        pd.read_csv(path).drop(columns=[*drop]).assign(**made).to_csv(path, index=False)
        return path

    return write


@pytest.mark.soak
def test_a_log_is_the_flight_in_our_signals_units_and_signs(run, flight):
    step = run.t[1] - run.t[0]
    assert step == pytest.approx(0.04, abs=2e-4)
    signals = run.signals.dropna()
    assert len(signals) > 0.99 * ENOUGH_S / 0.04
    t = signals.index.to_numpy()
    for name in {"chi", "gamma", "phi", "n_z", "V_a", "north", "east", "down"} & set(signals):
        true = flight.signals[name].to_numpy()
        true = np.interp(t, flight.t, np.unwrap(true) if name == "chi" else true)
        off = signals[name].to_numpy() - true
        off = np.angle(np.exp(1j * off)) if name == "chi" else off
        size = 1.0 if name in ("north", "east", "down") else BETWEEN
        assert np.max(np.abs(off)) < size, name
    missing = " ".join(run.provenance.log["missing"])
    assert ("n_z_cmd" in missing) == ("n_z_cmd" not in run.signals)
    for name in {"phi_cmd", "n_z_cmd"} & set(signals):
        commands = np.interp(t, flight.t, flight.signals[name].to_numpy())
        assert np.median(np.abs(signals[name].to_numpy() - commands)) < SINGLE


@pytest.mark.slow
def test_the_content_says_what_a_log_is(written, run, tmp_path):
    other = tmp_path / "anything.dat"
    other.write_bytes(written.read_bytes())
    if written.suffix == ".csv":  # any text may be a table: its ending says so
        with pytest.raises(ft.RecordingError, match=r"anything\.dat: must be a ULog"):
            ft.load_log(other)
        return

    assert len(ft.load_log(other).signals) == len(run.signals)


@pytest.mark.slow
def test_a_gap_is_a_gap(clean, tmp_path):
    t, signals = clean
    kept = (t < 50.0) | (t > 53.0)
    path = write_ulog(tmp_path / "gap.ulg", t[kept], {n: v[kept] for n, v in signals.items()})

    run = ft.load_log(path)

    gap = run.signals["phi"].isna()
    assert gap.sum() * (run.t[1] - run.t[0]) == pytest.approx(3.0, abs=0.1)
    assert run.signals["phi"][40.0:49.9].notna().all()
    (said,) = run.provenance.log["gaps"]
    assert said.startswith("Gaps of 2.1 % of the time in ")
    assert "phi" in said


@pytest.mark.soak
def test_a_dataflash_log_with_a_clock_in_ms_is_read(clean, tmp_path):
    new, old = (
        ft.load_log(write_dataflash(tmp_path / f"{old}.bin", *until(ENOUGH_S, *clean), old=old))
        for old in (False, True)
    )

    assert old.duration == pytest.approx(new.duration, abs=0.002)
    phi = new.signals["phi"].to_numpy()[:1000]
    assert old.signals["phi"].to_numpy()[:1000] == pytest.approx(phi, abs=BETWEEN)


def test_of_two_sensors_of_one_kind_in_a_ulog_the_first_is_read(clean, tmp_path):
    t, signals = until(10.0, *clean)
    path = write_ulog(tmp_path / "flight.ulg", t, signals)
    second = [message("A", struct.pack("<BH", 1, 99) + b"airspeed_validated")]
    for stamp in (1e6 * t).astype(int).tolist():
        second.append(message("D", struct.pack("<HQf", 99, stamp + 10**6, 77.0)))
    path.write_bytes(path.read_bytes() + b"".join(second))

    V_a = ft.load_log(path).signals["V_a"]

    assert V_a.max() == pytest.approx(signals["V_a"].max(), rel=SINGLE)


def test_a_dataflash_log_that_was_converted_to_text_is_read(tmp_path):
    """Mission Planner writes such; its angles are in deg. A log of the age of clocks in ms."""
    formats = (
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        ("FMT, 1, 17, ATT, Icccc, TimeMS,DesRoll,Roll,Pitch,Yaw"),
    )
    rows = [f"ATT, {5000 + 100 * i}, 12.00, {0.1 * i:.2f}, 2.00, 90.00" for i in range(200)]
    gps = "FMT, 2, 30, GPS, BIHff, Status,TimeMS,Week,Spd,GCrs"
    fixes = [f"GPS, 3, {5000 + 200 * i}, 1800, 22.0, 90.0" for i in range(100)]
    path = tmp_path / "old.log"
    path.write_text("\n".join([*formats, gps, *rows, *fixes, ""]))

    signals = ft.load_log(path).signals

    assert signals["phi"][10.0] == pytest.approx(np.deg2rad(10.0))
    assert signals["phi_cmd"][10.0] == pytest.approx(np.deg2rad(12.0))


@pytest.mark.parametrize(
    ("fields", "seconds"),
    [
        ({"TimeUS": 2_500_000}, 2.5),
        ({"TimeUS": 0, "TimeMS": 2500}, 0.0),
        ({"TimeMS": 2500}, 2.5),
        ({"TimeMS": 345_600_000, "T": 2500}, 2.5),  # of GPS before 2015: the time of the week
        ({"TimeMS": 345_600_000, "T": 0}, 0.0),
        ({"Roll": 3.0}, math.nan),
    ],
)
def test_a_message_of_a_dataflash_log_has_the_time_since_boot(fields, seconds):
    message = SimpleNamespace(**fields)

    assert read._dataflash_clock(message) == pytest.approx(seconds, nan_ok=True)


def test_the_part_of_a_log_in_a_flight_mode_has_the_times_of_that_mode_alone(tmp_path):
    """FBWA (mode 5 of ArduPlane), AUTO (10), FBWA, AUTO, FBWA and LOITER (12) last 5 s each."""
    modes = (5, 10, 5, 10, 5, 12)
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 1, 17, ATT, Icccc, TimeMS,DesRoll,Roll,Pitch,Yaw",
        "FMT, 2, 30, GPS, BIHff, Status,TimeMS,Week,Spd,GCrs",
        "FMT, 3, 20, MODE, IB, TimeMS,Mode",
        *(f"MODE, {5000 + 5000 * k}, {mode}" for k, mode in enumerate(modes)),
        *(f"ATT, {5000 + 100 * i}, 12.00, {0.1 * i:.2f}, 2.00, 90.00" for i in range(300)),
        *(f"GPS, 3, {5000 + 200 * i}, 1800, 22.0, 90.0" for i in range(150)),
    ]
    path = tmp_path / "modes.log"
    path.write_text("\n".join([*lines, ""]))

    for mode, first, last in (("auto", 1, 3), ("FBWA", 0, 4), ("Loiter", 5, 5)):
        part = ft.load(f"{path}@{mode}")

        phi, t = np.degrees(part.signals["phi"].to_numpy()), part.t - part.t[0] + 5.0 * first
        assert t[-1] == pytest.approx(5.0 * last + 4.9, abs=0.11)  # the end of the last
        into, number = np.modf(t / 5.0)
        flown = (number % 2 == first % 2) & (0.01 < into) & (into < 0.99)
        assert phi[flown] == pytest.approx(t[flown], abs=0.11)
        assert np.isnan(phi[(number % 2 != first % 2) & (0.01 < into) & (into < 0.99)]).all()
    with pytest.raises(ft.InputError, match="which has FBWA, AUTO, LOITER, got 'LAND'"):
        ft.load(f"{path}@LAND")


@pytest.mark.soak
@pytest.mark.parametrize("form", [{"sep": ";", "decimal": ","}, {"sep": ";"}, {"sep": "\t"}])
def test_a_table_has_commas_semicolons_or_tabs_between_its_cells(table, form):
    path = table()
    expected = ft.load_log(path).signals
    pd.read_csv(path).to_csv(path, index=False, **form)
    assert ft.load_log(path).signals.equals(expected)

    labels, *rows = path.read_text().splitlines()
    units = form["sep"].join(["[-]"] * len(labels.split(form["sep"])))
    path.write_text("\n".join([labels.replace(form["sep"], form["sep"] + " "), units, *rows]))
    assert ft.load_log(path).signals.equals(expected)


@pytest.mark.slow
@pytest.mark.parametrize("day", ["%d.%m.%Y", "%m/%d/%Y", "%d/%m/%Y", "%Y-%m-%d"])
@pytest.mark.parametrize("start", ["2026-06-11 23:59:50", "2026-06-12 23:59:50", "2026-06-25"])
def test_dates_are_read_past_midnight_whatever_comes_first(tmp_path, day, start):
    t, path = np.arange(300) / 5.0, tmp_path / "flight.csv"
    stamps = pd.date_range(start, periods=len(t), freq="200ms").strftime(f"{day} %H:%M:%S.%f")
    columns = {"time": stamps, "phi_deg": 10.0 * np.sin(t), "V_a_mps": 25.0}
    pd.DataFrame(columns).to_csv(path, index=False)

    run = ft.load_log(path)

    assert run.t == pytest.approx(t, abs=1e-9)
    assert run.signals["phi"].to_numpy() == pytest.approx(np.radians(10.0 * np.sin(t)), abs=1e-9)


def test_dates_are_read_although_a_row_has_a_number(tmp_path):
    t, path = np.arange(300) / 5.0, tmp_path / "flight.csv"
    stamps = [str(x) for x in pd.date_range("2026-06-11 12:00:00", periods=300, freq="200ms")]
    columns = {"time": [*stamps[:-1], "0.0"], "phi_deg": 10.0 * np.sin(t), "V_a_mps": 25.0}
    pd.DataFrame(columns).to_csv(path, index=False)

    run = ft.load_log(path)

    assert len(run.t) > 290
    assert run.t == pytest.approx(t[: len(run.t)], abs=1e-9)


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_a_table_of_older_programs_is_read_and_its_other_columns_listed(tmp_path, encoding):
    t, path = np.arange(300) / 25.0, tmp_path / "flight.csv"
    columns = {"t_s ": t, "phi_deg ": 10.0 * np.sin(t), "V_a_mps ": 25.0, "Höhe [°]": 1.0}
    pd.DataFrame(columns).to_csv(path, index=False, encoding=encoding)

    run = ft.load_log(path)

    assert run.signals["phi"].to_numpy() == pytest.approx(np.radians(10.0 * np.sin(t)), abs=1e-9)
    said = "No signal is read from Höhe [°]; --column NAME=COLUMN:UNIT reads one."
    assert said in run.provenance.log["missing"]


@pytest.mark.parametrize(
    ("label", "value"),
    [
        ("V_a_kt", 50.0),
        ("V_a [km/h]", 92.6),
        ("V_a[kt]", 50.0),
        ("/fdm/jsbsim/velocities/vt-fps", 84.39),
        ("velocities/vt-fps", 84.39),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
@pytest.mark.slow
def test_units_in_the_labels_of_a_table_are_read(clean, tmp_path, label, value, encoding):
    """50 kn are 92.6 km/h and 84.39 ft/s."""
    (t, signals), path = clean, tmp_path / "flight.csv"
    before, jsbsim, _ = label.rpartition("velocities/vt-fps")
    time = f"{before}simulation/sim-time-sec" if jsbsim else "t [s]"
    roll = f"{before}attitude/phi-deg" if jsbsim else "phi (°)"
    load = "n_z [-]" if "[kt]" in label else "n_z [g]"
    columns = {time: t, roll: np.degrees(signals["phi"]), label: value, load: signals["n_z"]}
    pd.DataFrame(columns).to_csv(path, index=False, encoding=encoding)

    read = ft.load_log(path).signals

    assert read["phi"].to_numpy() == pytest.approx(signals["phi"], abs=1e-9)
    assert read["V_a"].to_numpy() == pytest.approx(50.0 * 0.514444, abs=1e-3)
    assert read["n_z"].to_numpy() == pytest.approx(signals["n_z"], abs=1e-9)


@pytest.mark.slow
def test_a_clock_of_whole_seconds_is_refused(table):
    """Of 25 samples with one time the first would be kept, and a fast lag taken for a slow one."""
    path = table()
    pd.read_csv(path).assign(t_s=lambda rows: np.floor(rows["t_s"])).to_csv(path, index=False)

    with pytest.raises(ft.InputError, match="must tell samples apart"):
        ft.load_log(path)


@pytest.mark.slow
def test_two_signals_may_have_one_field_of_a_message(clean, tmp_path):
    path = write_dataflash(tmp_path / "flight.bin", *until(ENOUGH_S, *clean))

    signals = ft.load_log(path, columns=["theta=ATT.Roll:deg"]).signals

    assert (signals["theta"] == signals["phi"]).all()


@pytest.mark.soak
def test_a_log_is_cut_into_flight_modes_and_says_what_its_sensors_show(clean, tmp_path):
    t, signals = until(44.02, *clean)
    in_auto = ((t >= 12.0) & (t < 24.0)) | ((t >= 36.0) & (t < 40.0))
    events = {
        "MODE": ("Mode", [np.where(in_auto, 10.0, 5.0)]),
        "STAT": ("isFlying,Armed", [t > 8.0, t > 4.0]),
        "GPS": ("Status", [np.where((t > 28.0) & (t < 32.0), 2.0, 3.0)]),
        "VIBE": (
            "VibeX,Clip0",
            [np.where(t > 32.0, 40.0, 5.0), np.floor(np.maximum(0.0, t - 32.0))],
        ),
    }
    path = write_dataflash(tmp_path / "flight.bin", t, signals, events=events)

    whole, part = ft.load_log(path), ft.load(f"{path}@auto")
    log = whole.provenance.log

    end = f"{t[-1]:.1f}"
    assert log["phases"] == [
        f"armed for {t[-1] - 4.0:.1f} s: 4.0 to {end} s",
        f"airborne for {t[-1] - 8.0:.1f} s: 8.0 to {end} s",
        f"FBWA for {t[-1] - 16.0:.1f} s: 0.0 to 12.0, 24.0 to 36.0, 40.0 to {end} s",
        "AUTO for 16.0 s: 12.0 to 24.0, 36.0 to 40.0 s",
    ]
    assert re.search(r"clipped 1[12] times, first at 33\.0 s", log["sensors"][0])
    assert "up to 40 m/s², where up to 30 is acceptable" in log["sensors"][1]
    assert re.search(r"for (3\.9|4\.0) s, first at 28\.0 s", log["sensors"][2])
    assert part.duration == pytest.approx(28.0, abs=0.1)
    assert part.signals["phi"][:12.0].notna().all()
    assert part.signals["phi"][12.1:23.9].isna().all()
    assert part.signals["phi"].iloc[100] == pytest.approx(whole.signals["phi"].iloc[400])
    page = ft.report(path, tmp_path / "page.html").path.read_text()
    rows = re.findall(r"<t[dh][^>]*>(flight modes|sensors)</t[dh]>", page)
    assert rows == ["flight modes", "sensors"]
    with pytest.raises(ft.InputError, match=r"FBWA, AUTO, got 'LAND'"):
        ft.load(f"{path}@LAND")


@pytest.mark.parametrize("axes", ["xyz", "zxy"])
def test_clips_and_vibration_are_those_of_all_three_axes(axes):
    t, first, second, third = np.arange(20.0), *axes
    stream = {
        "phi": (t, 0.0 * t),
        f"clip_{first}": (t, np.where(t >= 9.0, 4.0, 0.0)),
        f"clip_{second}": (t, np.where(t >= 5.0, 3.0, 1.0)),
        f"vibe_{third}": (t, 35.0 + 0.0 * t),
        f"vibe_{first}": (t, 8.0 + 0.0 * t),
    }

    _, said = phases("flight.bin", stream, {}, {})

    assert said == [
        "The accelerometers clipped 6 times, first at 5.0 s.",
        "The accelerometers vibrate by up to 35 m/s², where up to 30 is acceptable.",
    ]


@pytest.mark.parametrize("socket_type", ["", "UDP"])
def test_what_jsbsim_writes_to_a_file_or_a_socket_needs_no_columns(tmp_path, socket_type):
    import jsbsim

    path, sink = tmp_path / "flight.csv", socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sink.bind(("127.0.0.1", 0))
    sink.settimeout(1.0)
    kind, place = 'type="CSV"', str(path)
    if socket_type:
        path, place = tmp_path / "captured", "127.0.0.1"
        kind = f'type="SOCKET" protocol="UDP" port="{sink.getsockname()[1]}"'
    directive = tmp_path / "output.xml"
    parts = "".join(f"<{part}> ON </{part}>" for part in ("rates", "velocities", "position"))
    directive.write_text(f'<output name="{place}" {kind} rate="20">{parts}</output>')
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
    packets = []
    with sink, suppress(TimeoutError):
        while socket_type:
            packets.append(sink.recv(65_536))
    if socket_type:
        path.write_bytes(b"".join(packets))

    run = ft.load_log(path)

    first, (t, q, theta) = run.signals.iloc[0], np.transpose(rows)
    assert first["psi"] == pytest.approx(np.radians(-10.0), abs=0.001)
    assert first["h"] == pytest.approx(4000.0 * FT, abs=1.0)
    assert first["V_g"] == pytest.approx(first["V_a"], abs=0.5)
    for name, true in (("q", q), ("theta", theta)):
        there = np.interp(run.t[1:-1], t, true)
        assert run.signals[name].to_numpy()[1:-1] == pytest.approx(there, abs=BETWEEN), name


@pytest.mark.parametrize("value", [-1e308, np.inf])
def test_samples_that_no_flight_has_are_left_out_and_said(table, value):
    path = table()
    frame = pd.read_csv(path)
    fastest = np.hypot(frame["v_north"], frame["v_east"]).max()
    frame.loc[len(frame) // 2, "v_north"] = value
    frame.to_csv(path, index=False)

    run = ft.load_log(path)

    assert run.signals["V_g"].max() <= fastest
    assert "v_north: samples of 1e+09 or more left out, 1" in run.provenance.log["gaps"]


def test_a_signal_of_a_table_that_never_changes_is_its_value(table):
    """Ten rows have an airspeed, always the same: one measurement, repeated."""
    path = table(V_a_mps=lambda x: np.where(np.arange(len(x["V_a"])) < 10, 24.0, np.nan))

    assert set(ft.load_log(path).signals["V_a"].dropna()) == {24.0}


def test_units_signs_and_names_of_a_table_are_given(clean, tmp_path):
    t, signals = clean
    path, given = tmp_path / "named.csv", tmp_path / "columns.toml"
    named = {"clock": 1e3 * t, "bank": -np.degrees(signals["phi"]), "speed": 3.6 * signals["V_a"]}
    pd.DataFrame({**named, "vn": signals["V_a"]}).to_csv(path, index=False)
    given.write_text('t = "clock:ms"\nphi = "bank:-deg"\nv_north = "vn"\nv_east = "vn"\n')

    run = ft.load_log(path, columns=[given, "V_a=speed:km/h"])

    for name in ("phi", "V_a"):
        assert run.signals[name].to_numpy()[1:-1] == pytest.approx(signals[name][1:-1], abs=1e-9)
    alone = ft.load_log(path, columns=str(given))
    assert alone.signals["phi"].equals(run.signals["phi"])


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("n_z", lambda n_z: -n_z, "after its sign was turned"),
        ("north", lambda north: north / FT, r"from the path: a factor of 0.3048 .* to north"),
        ("phi", lambda phi: -phi, r"phi is -1 times .*: a factor of -1 would do"),
        ("phi", np.degrees, r"phi is something else"),
    ],
)
@pytest.mark.slow
def test_what_a_log_says_about_its_own_signs_is_said(clean, tmp_path, name, change, says):
    t, signals = clean

    run = ft.load_log(write_ulog(tmp_path / "x.ulg", t, signals | {name: change(signals[name])}))

    assert re.search(says, str(run.provenance.log["checks"]))
    assert np.nanmedian(run.signals["n_z"]) > 0.8


@pytest.mark.soak
@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({"n_z": "excess"}, r"n_z is 0\.0.*: a change by \+1 would do"),
        (
            {f"v_{axis}": f"v_{axis}:kn" for axis in ("north", "east")} | {"V_a": "V_a_mps:kn"},
            r"phi is 1\.9.* speed in turns: a factor of 1\.944 would do \(m/s read as kn\) to v_",
        ),
        ({"phi": "phi_deg"}, r"phi goes up to .* rad: a factor of 0\.01745 would do"),
        ({"phi_cmd": "phi_cmd_deg:-deg"}, "phi_cmd is -.*: a factor of -1 would do"),
        ({"chi": "magnetic"}, r"chi is -12.* deg off .*: magnetic.* a change by \+12"),
        *(
            pytest.param(*case, marks=pytest.mark.counts)
            for case in (
                ({"n_z": "n_z_mps2"}, "n_z, .*: a factor of 0.102 would do"),
                ({"n_z": "n_z:-1"}, "n_z, .*: a factor of -1 would do"),
                ({"V_a": "V_a_mps:kn"}, r"V_a in turns .*: a factor of 1\.944 .*m/s read as kn\)"),
                ({"V_a": "feet"}, r"V_a in turns .*: a factor of 0\.3048 .*\(ft/s read as m/s\)"),
                ({"phi": "phi_deg:-deg"}, "(p|phi) is -.*: a factor of -1 would do"),
                ({"p": "p:-1"}, "p is -.*: a factor of -1 would do"),
                ({"p": "p:deg"}, r"p is .*: a factor of 57\.3 would do"),
                ({"h": "h_feet"}, r"the slope of h .*: a factor of 0\.3048 would do"),
            )
        ),
    ],
)
def test_a_column_that_others_contradict_is_said_with_its_factor(clean, table, columns, says):
    path = table(
        feet=lambda x: x["V_a"] / FT,
        n_z_mps2=lambda x: 9.80665 * x["n_z"],
        excess=lambda x: x["n_z"] - 1.0,
        magnetic=lambda x: x["chi"] - np.radians(12.0),
        p=lambda x: np.gradient(x["phi"], clean[0][: len(x["phi"])]),
        h_feet=lambda x: -x["down"] / FT,
    )

    wrong = ft.load_log(path, columns=columns)

    assert ft.load_log(path).provenance.log["wrong"] == []
    assert re.search(says, wrong.provenance.log["wrong"][0])
    for refuse in (ft.identify, lambda run: ft.gap(run, aircraft="aerosonde")):
        with pytest.raises(ft.InputError, match=r"columns .* log must agree"):
            refuse(wrong)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({"theta": "theta:-rad"}, r"theta is -.* gamma and lift: a factor of -1 would do"),
        ({"h": "h_feet"}, r"theta is .* gamma and lift: a factor of 0\.3048 would do .*to h"),
    ],
)
def test_pitch_and_height_without_a_vertical_speed_are_checked(table, columns, says):
    def theta(x):
        lift = np.cos(x["phi"]) * x["n_z"] * (22.0 / x["V_a"]) ** 2
        return x["gamma"] + np.radians(3.0) * lift

    heights = {"h": lambda x: -x["down"], "h_feet": lambda x: -x["down"] / FT}
    path = table(drop=["v_down_mps"], theta=theta, **heights)

    right, wrong, passed = (
        ft.load_log(path, columns=given).provenance.log
        for given in ({}, columns, {**columns, "trusted": "gamma, n_z"})
    )

    assert right["wrong"] == passed["wrong"] == []
    assert any(re.search(says, reason) for reason in wrong["wrong"])
    assert re.search(f"{says}.*, which --column trusted= passes", str(passed["checks"]))


@pytest.mark.slow
def test_only_what_is_said_of_a_trusted_signal_passes(table):
    path, speed = table(), {"V_a": "V_a_mps:km/h"}

    said = [
        ft.load_log(path, columns={**speed, "trusted": name}).provenance.log["wrong"]
        for name in ("h", "V_a")
    ]

    assert re.search(r"V_a in turns .*\(m/s read as km/h\)", said[0][0])  # no height
    assert said[1] == []
    with pytest.raises(ft.InputError, match="trusted: `thetta` must"):
        ft.load_log(path, columns={"trusted": "thetta"})


@pytest.mark.slow
def test_reports_comparisons_and_recordings_take_logs(flight, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_ulog(tmp_path / "flight.ulg", *sampled(flight))

    page = ft.report("flight.ulg@10:60", "log.html")
    both = ft.compare("flight.ulg@0:20", "paper_as_printed@paper")
    each = ft.compare("flight.ulg@0:20", "paper@paper")

    assert "A real flight of 50.0 s." in page.summary
    assert "The log has no h, n_z_cmd or wind_north." in page.path.read_text(encoding="utf-8")
    assert both.comparable
    assert both.pairs[0].a.duration == pytest.approx(20.0, abs=0.05)
    assert both.max_distance > 10.0
    assert [pair.b.provenance.plant for pair in each.pairs] == ["kinematic", "jsbsim:aerosonde"]
    from flighttune.outputs.pages.page import write_comparison_page
    from flighttune.outputs.recording.record import write_log, write_overlay

    write_comparison_page(both, "both.html")
    write_overlay(both, "both.rrd")
    write_log(ft.load_log("flight.ulg"), "log.rrd")
    assert all((tmp_path / name).stat().st_size > 10_000 for name in ("both.rrd", "log.rrd"))
    ft.plot(ft.load_log("flight.ulg")).save("log.svg")


def stamped(change):
    return lambda path, t, signals: write_ulog(path, np.where(t > 100.0, t + change, t), signals)


def still(path, t, signals):
    rest = {name: 0.0 * values for name, values in signals.items()}
    return write_ulog(path, t, {**rest, "n_z": 1.0 + 0.0 * t})


def empty(path, t, signals):
    return write_ulog(path, t[:0], {name: values[:0] for name, values in signals.items()})


def content(data):
    return lambda path, t, signals: path.write_bytes(data) and path


@pytest.mark.soak
@pytest.mark.parametrize(
    ("make", "name", "says"),
    [
        (lambda *a: write_ulog(*a, vehicle=1), "x.ulg", "must be the log of an aeroplane"),
        (lambda *a: write_dataflash(*a, vehicle="ArduCopter V4"), "x.bin", "an aeroplane"),
        (lambda *a: write_tlog(*a, kind=2), "x.tlog", "must be the log of an aeroplane"),
        (still, "x.ulg", "must be the log of a flight, got a speed of at most 0"),
        (stamped(-40.0), "x.ulg", "the clock of `.*` must run forward, got a jump by -"),
        (content(b"a,b\n1,2\n"), "x.csv", "the time must be a column `t`"),
        (content(b"t,phi\n0,5,0,1\n"), "x.csv", "2 labels and 4 cells; with decimal commas"),
        (content(b"t,phi,V_g\n0,0,9\n50,0,9\n"), "x.csv", "one every 50 s; .*t=COLUMN:ms"),
        (content(b"t,roll\n0,0\n1,0\n"), "x.csv", "must have roll in numbers .*--column phi="),
        (empty, "x.ulg", "must have roll in numbers"),
        (stamped(40_000.0), "x.ulg", "without a break of over 3600 s"),
        (
            content(b"ULog\x01\x12\x35\x01" + bytes(3)),
            "x.ulg",
            "must be a ULog log, got a damaged one",
        ),
    ],
)
def test_what_is_no_flight_is_refused_in_one_line(flight, tmp_path, make, name, says):
    t, signals = sampled(flight)
    path = make(tmp_path / name, t, signals)

    with pytest.raises(ft.InputError, match=says) as error:
        ft.load_log(path)

    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        (["chi=heding:deg"], "the column of `chi` must be one of the file's, got 'heding'"),
        (["course=V_a_mps"], "`course` must be a signal"),
        (["V_a=V_a_mps:furlong"], "`V_a_mps` must be one of .*got 'furlong'"),
    ],
)
def test_a_wrong_column_is_one_line(table, columns, says):
    with pytest.raises(ft.InputError, match=says):
        ft.load_log(table(), columns=columns)


@pytest.mark.parametrize(("label", "unit"), [("phi [grad]", "grad"), ("time (min)", "min")])
def test_a_label_with_an_unknown_unit_is_refused_unless_the_column_is_given(
    clean, tmp_path, label, unit
):
    (t, signals), path = clean, tmp_path / "flight.csv"
    columns = {"t": t, "phi_rad": signals["phi"], "V_a": signals["V_a"], label: t}
    pd.DataFrame(columns).to_csv(path, index=False)

    with pytest.raises(ft.InputError, match=re.escape(label) + f"` must be .*got '{unit}'"):
        ft.load_log(path)

    read = ft.load_log(path, columns=["t=t:s", "phi=phi_rad:rad"])
    assert read.signals["phi"].to_numpy() == pytest.approx(signals["phi"], abs=1e-9)


@pytest.mark.soak
def test_two_columns_of_a_signal_must_agree(table):
    file = table(phi_rad=lambda signals: signals["phi"])
    assert ft.load_log(file).signals["phi"].abs().max() > 0.1
    off = 32.0 * np.pi  # 100.5 m, of angles 16 whole turns
    with pytest.raises(ft.RecordingError, match=r"columns of `h` must agree"):
        ft.load_log(table(h_m=lambda x: -x["down"], h=lambda x: off - x["down"]))
    file = table(phi_rad=lambda signals: -signals["phi"])
    with pytest.raises(ft.RecordingError, match=r"must agree, got phi_rad and phi_deg"):
        ft.load_log(file)
    assert ft.load_log(file, columns="phi=phi_deg:deg").signals["phi"].abs().max() > 0.1


@pytest.mark.soak
def test_a_format_that_asks_for_all_memory_ends_the_reading_alone(tmp_path, monkeypatch):
    monkeypatch.setattr("flighttune.logs.read.PATIENCE_S", 2.0)
    layouts = [f"m{k}:m{k + 1}[65535] a;" for k in range(4)]
    layouts = [*layouts, "m4:uint8_t x;", "vehicle_attitude:uint64_t timestamp;m0[65535] q;"]
    data = [b"ULog\x01\x12\x35\x01" + bytes(8), message("B", bytes(40))]
    data += [message("F", layout.encode()) for layout in layouts]
    data += [message("A", struct.pack("<BH", 0, 0) + b"vehicle_attitude")]
    path = tmp_path / "bomb.ulg"
    path.write_bytes(b"".join([*data, message("D", bytes(2 + 8 + 100))]))

    with pytest.raises(ft.RecordingError, match=r"must be (read in 900|a ULog)"):
        ft.load_log(path)


def test_a_reader_may_wait_for_its_turn_but_not_compute_for_ever(tmp_path, monkeypatch):
    monkeypatch.setattr("flighttune.logs.read.PATIENCE_S", 0.2)
    log = tmp_path / "flight.ulg"
    log.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8))

    def reads(reader):
        monkeypatch.setitem(read._PARAMETERS, "ULog", reader)
        return read.read_parameters(log)

    def computes(_):
        while True:
            pass

    assert reads(lambda _: time.sleep(0.5) or "read") == "read"
    with pytest.raises(ft.RecordingError, match=r"reader did not end within 0.2 s of processor"):
        reads(computes)


@pytest.mark.parametrize(
    ("name", "source", "column"),
    [
        ("phi", "ATT.Roll:deg", ("ATT.Roll", np.pi / 180.0)),
        ("phi", "ATT.Roll:-deg", ("ATT.Roll", -np.pi / 180.0)),
        ("phi", "roll", ("roll", 1.0)),
        ("phi", "a:b:rad", ("a:b", 1.0)),
        ("V_a", "x:kt", ("x", 1852.0 / 3600.0)),
        ("V_a", "x:km/h", ("x", 1.0 / 3.6)),
        ("h", "x:ft", ("x", FT)),
        ("lat", "x:1e-7deg", ("x", 1e-7 * np.pi / 180.0)),
        ("chi", "x:cdeg", ("x", 0.01 * np.pi / 180.0)),
        ("f_z", "x:mG", ("x", 9.80665e-3)),
        ("f_z", "x:-g", ("x", -9.80665)),
        ("n_z", "x:g", ("x", 1.0)),  # the unit of a load factor is g
        ("n_z", "x:mG", ("x", 1e-3)),
        ("n_z", "x:m/s2", ("x", 1.0)),
        ("t", "x:us", ("x", 1e-6)),
    ],
)
def test_a_column_has_its_unit_and_its_sign(name, source, column):
    (found,) = log.given_columns({name: source}).values()

    assert found.source == column[0]
    assert found.factor == pytest.approx(column[1], rel=1e-9)
    assert log.given_columns(f"{name}={source}") == {name: found}


def test_columns_of_several_places_are_joined_and_the_last_one_counts(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text('phi = "a:deg"\nchi = "b"\n')

    found = log.given_columns([file, "phi=c"])

    assert {name: column.source for name, column in found.items()} == {"phi": "c", "chi": "b"}
    file.write_text("phi = 3\n")
    with pytest.raises(ft.InputError, match=r'mine\.toml: `phi` must be text "COLUMN:UNIT", got 3'):
        log.given_columns(file)
    refused = {"roll=x": "`roll` must be a signal", "phi=x:grad": "must be one of .*grad"}
    for given, says in refused.items():
        with pytest.raises(ft.InputError, match=f"--column: .*{says}"):
            log.given_columns(given)


def sources(header, **given):
    """Sources and factors of the signals of a table, in the order in which they are tried."""
    found = log.columns_of(log.given_columns(given), "f.csv", "csv", header)
    return {name: [column.source for column in each] for name, each in found.items()}


def test_columns_of_a_table_are_named_by_their_signal_and_unit():
    header = ["time", "phi_deg", "phi", "V_a [kn]", "n_z [-]", "theta (deg)", "other"]

    assert sources(header) == {
        "t": ["time"], "phi": ["phi_deg", "phi"], "V_a": ["V_a [kn]"], "n_z": ["n_z [-]"],
        "theta": ["theta (deg)"],
    }  # fmt: skip
    given = sources(header, t="other", phi="phi:deg")
    assert (given["t"], given["phi"]) == (["other"], ["phi"])
    with pytest.raises(ft.InputError, match=r"the time must be a column `t`.* columns a and b"):
        sources(["a", "b"])
    with pytest.raises(ft.InputError, match="column of `phi` must be one of the file's, got 'x'"):
        sources(header, phi="x")


def test_the_clock_of_messages_is_their_own_and_given_columns_replace_the_known():
    found = log.columns_of(log.given_columns({"t": "x", "phi": "A.b"}), "f.bin", "DataFlash", [])

    assert "t" not in found
    assert [column.source for column in found["phi"]] == ["A.b"]
    assert [column.source for column in found["theta"]] == ["ATT.Pitch"]


def test_gaps_are_said_from_half_a_thousandth_of_the_time_on():
    columns = {"phi": np.zeros(10_000), "chi": np.zeros(10_000), "V_a": np.zeros(10_000)}
    columns["phi"][:5], columns["chi"][:4], columns["V_a"][:2500] = np.nan, np.nan, np.nan

    assert log._gaps(columns) == ["Gaps of 0.1 to 25.0 % of the time in phi and V_a."]
    assert log._gaps({"V_a": columns["V_a"]}) == ["Gaps of 25.0 % of the time in V_a."]
    assert log._gaps({"chi": columns["chi"]}) == []


@pytest.mark.parametrize(
    ("part", "ends"),
    [
        ("10:20.5", (10.0, 20.5)),
        (":20", (0.0, 20.0)),
        ("10:", (10.0, 30.0)),
        ("20:10", None),
        ("10:10", None),
        ("-1:10", None),
        ("one:10", None),
    ],
)
def test_a_part_of_a_log_is_from_a_time_to_another(tmp_path, part, ends):
    t = 0.1 * np.arange(301)
    path = tmp_path / "a.csv"
    signals = {"t": t, "phi": 0.1 * np.sin(t), "phi_cmd": 0.0 * t, "V_a": t}
    pd.DataFrame(signals).to_csv(path, index=False)

    if ends is None:
        with pytest.raises(ft.InputError, match="the part of a log must be START:END in s"):
            ft.load(f"{path}@{part}")
        return
    V_a = ft.load(f"{path}@{part}").signals["V_a"]
    assert (V_a.iloc[0], V_a.iloc[-1]) == pytest.approx(ends)


@pytest.mark.parametrize(
    ("values", "others", "angle", "contradict"),
    [
        (100.0, 100.9, False, False),  # 1 % of the largest
        (100.0, 101.1, False, True),
        (3.1, -3.1, True, True),  # 0.08 of a turn less
        (3.14, -3.14, True, False),
        (0.5, 0.5 + 2.0 * np.pi, True, False),
        (0.5, 0.5 + 2.0 * np.pi, False, True),
        (np.nan, 1.0, False, False),
        (1e9, 1.0, False, False),
    ],
)
def test_columns_contradict_each_other_by_more_than_a_hundredth(values, others, angle, contradict):
    first, second = np.full(9, values), np.full(9, others)
    first[:4] = second[:4]  # the median counts

    assert read._contradict(first, second, angle=angle) == contradict
