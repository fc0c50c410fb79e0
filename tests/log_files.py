"""Small logs of the kinds that aircraft write, made of the signals of a run."""

import csv
import struct

import numpy as np

import flighttune as ft

G = 9.80665

# Lags of the plant whose flight is written.
ROLL = ft.loop.InnerLag(order=2, natural_frequency=5.0, damping=0.8, delay=0.08)
LOAD = ft.loop.InnerLag(order=1, natural_frequency=6.0, delay=0.06)


def heavy_cessna(duration):
    """Turns and climbs in wind of a Cessna of 1.2 times its mass, for a `duration` in s."""
    turns = [90.0, -40.0, 70.0, -30.0, 60.0, -50.0]
    scenario = {
        "title": "Turns and climbs of a heavy Cessna",
        "gains": [{"name": "mine", "K_P": [[1.0, 0], [0, 2.0]], "K_I": [[0.05, 0], [0, 0.2]]}],
        "flight": {"V_a_mps": 50.0, "h_m": 800.0, "duration_s": duration},
        "reference": {
            "chi_deg": [
                {"shape": "step", "start_s": 2.0 + 6.5 * k, "change_deg": turns[k % 6]}
                for k in range(int((duration - 9.0) / 6.5))
            ],
            "gamma_deg": [
                {"shape": "step", "start_s": 4.0 + 5.0 * k, "change_deg": (-1.0) ** k * (3 + k % 3)}
                for k in range(int((duration - 10.0) / 5.0))
            ],
        },
        "limits": {"phi_deg": [-40, 40], "n_z": [0.4, 1.8]},
        "controller": {"rate_hz": 50.0, "feed_forward": True},
        "wind": {"speed_mps": 6.0, "from_deg": 240.0},
        "plant": [{"kind": "jsbsim", "aircraft": "c172p", "airframe": {"mass_factor": 1.2}}],
    }
    (run,) = ft.fly(ft.scenario_from(scenario)).runs
    assert run.status == "completed", run.outcome
    return run


def sampled(run, rate=25.0, *, seed=0, noise=True, dropouts=True, late=True):
    """Times and signals of a run as a log has them: noise, dropouts and late stamps (s)."""
    random = np.random.default_rng(seed)
    step = round(1.0 / (rate * (run.t[1] - run.t[0])))
    signals = {name: run.signals[name].to_numpy()[::step].copy() for name in run.signals}
    t = run.t[::step].copy()
    if noise:
        for name, size in (("phi", 0.003), ("n_z", 0.01), ("V_a", 0.2)):
            signals[name] += size * random.standard_normal(len(t))
    if late:
        t = np.sort(t + 0.004 * random.random(len(t)))
    kept = np.ones(len(t), dtype=bool)
    if dropouts:
        for start in random.integers(0, len(t) - 40, len(t) // 500):
            kept[start : start + 12] = False
    return t[kept], {name: values[kept] for name, values in signals.items()}


def fields(signals):
    """Ground velocity and position of signals."""
    chi, gamma = signals["chi"], signals["gamma"]
    level = signals.get("V_g", signals["V_a"] * np.cos(gamma))
    return {
        "vx": level * np.cos(chi),
        "vy": level * np.sin(chi),
        "vz": -level * np.tan(gamma),
        "x": signals["north"],
        "y": signals["east"],
        "z": signals["down"],
    }


def quaternion(phi, theta, psi):
    """From body axes to north-east-down, shape (n, 4): w, x, y, z."""
    c, s = zip(*((np.cos(0.5 * a), np.sin(0.5 * a)) for a in (phi, theta, psi)), strict=True)
    return np.column_stack(
        [
            c[0] * c[1] * c[2] + s[0] * s[1] * s[2],
            s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
            c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
            c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
        ]
    )


def write_ulog(path, t, signals, *, vehicle=2):
    """A ULog with the topics of PX4 and `flighttune.n_z_cmd`; version 1 of the format."""
    zero = 0.0 * t
    q = quaternion(signals["phi"], signals["gamma"], signals["chi"])
    q_cmd = quaternion(signals["phi_cmd"], zero, signals["chi"])
    ned = fields(signals)
    topics = {
        "vehicle_attitude": ("float[4] q;", q),
        "vehicle_attitude_setpoint": ("float[4] q_d;", q_cmd),
        "vehicle_local_position": (
            "".join(f"float {name};" for name in ned),
            np.column_stack([*ned.values()]),
        ),
        "airspeed_validated": ("float true_airspeed_m_s;", signals["V_a"][:, None]),
        "vehicle_acceleration": (
            "float[3] xyz;",
            np.column_stack([zero, zero, -G * signals["n_z"]]),
        ),
        "flighttune": ("float n_z_cmd;", signals["n_z_cmd"][:, None]),
        "vehicle_status": ("float vehicle_type;", zero[:, None] + vehicle),
    }
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), message("B", bytes(40))]
    for name, (layout, _) in topics.items():
        out.append(message("F", f"{name}:uint64_t timestamp;{layout}".encode()))
    for number, name in enumerate(topics):
        out.append(message("A", struct.pack("<BH", 0, number) + name.encode()))
    stamps, rows = np.round(1e6 * t).astype("<u8") + 10**6, []
    for number, (_, values) in enumerate(topics.values()):
        numbers = np.ascontiguousarray(values, dtype="<f4")
        length = 2 + 8 + 4 * numbers.shape[1]
        head = np.frombuffer(struct.pack("<HBH", length, ord("D"), number), "u1")
        rows += [np.tile(head, (len(t), 1)), stamps[:, None].view("u1"), numbers.view("u1")]
    path.write_bytes(b"".join(out) + np.hstack(rows).tobytes())
    return path


def message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


def write_dataflash(path, t, signals, *, vehicle="ArduPlane V4.5", old=False, events=()):
    """A DataFlash log with the messages of ArduPlane, and FTUN; `old` ones have a clock in ms.

    `events`: further messages by name, with their columns and values.
    """
    clock, per_s, code = ("TimeMS", 1e3, "I") if old else ("TimeUS", 1e6, "Q")
    ned = fields(signals)
    deg = np.degrees
    angles = [deg(signals[name]) for name in ("phi_cmd", "phi", "gamma")]
    messages = {
        "ATT": ("DesRoll,Roll,Pitch,Yaw", [*angles, deg(signals["chi"]) % 360.0]),
        "XKF1": ("PN,PE,PD,VN,VE,VD", [ned[name] for name in ("x", "y", "z", "vx", "vy", "vz")]),
        "IMU": ("AccZ", [-G * signals["n_z"]]),
        "ARSP": ("Airspeed", [signals["V_a"]]),
        "FTUN": ("NzCmd", [signals["n_z_cmd"]]),
    }
    if "cross_track" in signals:  # ArduPilot counts it from the aircraft to the track
        messages["NTUN"] = "AltE,XT", [signals["height_err"], -signals["cross_track"]]
    messages |= dict(events)
    out = [_format(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    out.append(_format(129, 75, "MSG", "QZ", "TimeUS,Message"))
    for number, (name, (columns, values)) in enumerate(messages.items(), 130):
        layout, size = code + "f" * len(values), struct.calcsize(f"<{code}")
        length = 3 + size + 4 * len(values)
        out.append(_format(number, length, name, layout, f"{clock},{columns}"))
    out.append(b"\xa3\x95" + struct.pack("<BQ64s", 129, 10**6, vehicle.encode()))
    stamps = np.round(per_s * (t + 1.0)).astype(f"<u{struct.calcsize(code)}")
    rows = []  # of each message, as bytes, shape (len(t), its length)
    for number, (_, values) in enumerate(messages.values(), 130):
        head = np.tile(np.frombuffer(struct.pack("<2sB", b"\xa3\x95", number), "u1"), (len(t), 1))
        numbers = np.column_stack(values).astype("<f4")
        rows += [head, stamps[:, None].view("u1"), numbers.view("u1")]
    path.write_bytes(b"".join(out) + np.hstack(rows).tobytes())
    return path


def straight_log(path, parameters, **ends):
    """A log of half a minute straight on with parameters, and signals from 0 to these ends."""
    t = np.linspace(0.0, 30.0, 601)
    still = dict.fromkeys(("phi", "gamma", "chi", "phi_cmd", "east", "down"), 0.0 * t)
    level = {
        "V_a": 25.0 + 0.0 * t,
        "north": 25.0 * t,
        "n_z": 1.0 + 0.0 * t,
        "n_z_cmd": 1.0 + 0.0 * t,
    }
    write_dataflash(path, t, still | level | {name: x * t / t[-1] for name, x in ends.items()})
    with path.open("ab") as log:
        log.write(
            b"\xa3\x95"
            + struct.pack("<BBB4s16s64s", 128, 200, 31, b"PARM", b"QNf", b"TimeUS,Name,Value")
        )
        for name, value in parameters.items():
            log.write(b"\xa3\x95" + struct.pack("<BQ16sf", 200, 10**6, name.encode(), value))
    return str(path)


def _format(number, length, name, layout, columns):
    body = struct.pack(
        "<BB4s16s64s", number, length, name.encode(), layout.encode(), columns.encode()
    )
    return b"\xa3\x95\x80" + body


def write_tlog(path, t, signals, *, kind=1):
    """A telemetry log, written by pymavlink; it has no load-factor command."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    sender, ned, out = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), fields(signals), []
    for k, stamp in enumerate(t):
        ms = round(1e3 * stamp) + 1000
        row = {name: float(values[k]) for name, values in signals.items()}
        place, velocity = ([float(ned[v + x][k]) for x in "xyz"] for v in ("", "v"))
        messages = [
            mavlink.MAVLink_attitude_message(
                ms, row["phi"], row["gamma"], row["chi"], 0.0, 0.0, 0.0
            ),
            mavlink.MAVLink_nav_controller_output_message(
                np.degrees(row["phi_cmd"]), 0.0, 0, 0, 0, 0.0, 0.0, 0.0
            ),
            mavlink.MAVLink_local_position_ned_message(ms, *place, *velocity),
            mavlink.MAVLink_vfr_hud_message(row["V_a"], row["V_a"], 0, 0, 0.0, 0.0),
        ]
        if k % 25 == 0:
            messages.insert(0, mavlink.MAVLink_heartbeat_message(kind, 3, 0, 0, 4, 3))
        for message in messages:
            out.append(struct.pack(">Q", 1_600_000_000_000_000 + 1000 * ms) + message.pack(sender))
    path.write_bytes(b"".join(out))
    return path


def write_csv(path, t, signals):
    """A table with columns of the names and units that need no saying."""
    ned = fields(signals)
    table = {
        "t_s": t,
        **{f"{name}_deg": np.degrees(signals[name]) for name in ("phi", "phi_cmd")},
        **{f"{name}": signals[name] for name in ("n_z", "n_z_cmd")},
        "V_a_mps": signals["V_a"],
        **{name: signals[name] for name in ("h", "theta") if name in signals},
        **{f"v_{axis}": ned[name] for axis, name in (("north", "vx"), ("east", "vy"))},
        "v_down_mps": ned["vz"],
    }
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table)
        writer.writerows(np.column_stack([*table.values()]).tolist())
    return path


WRITERS = {
    "flight.ulg": write_ulog,
    "flight.bin": write_dataflash,
    "flight.tlog": write_tlog,
    "flight.csv": write_csv,
}
COMMAND = {
    "flight.ulg": ["n_z_cmd=flighttune.n_z_cmd"],
    "flight.bin": ["n_z_cmd=FTUN.NzCmd"],
    "flight.csv": [],
}
"""Columns of the load-factor command, where the log has one."""
