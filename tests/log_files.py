"""Logs of the kinds that aircraft write: of any messages, and of the signals of a run."""

import struct

import numpy as np
import pandas as pd

import flighttune as ft

G = 9.80665
MAGIC = b"ULog\x01\x12\x35\x01"


def heavy_cessna(duration):
    """Turns and climbs in wind of a Cessna of 1.2 times its mass, for a `duration` in s."""

    def steps(first, every, last, change):
        count = int((duration - last) / every)
        return [
            {"shape": "step", "start_s": first + every * k, "change_deg": change(k)}
            for k in range(count)
        ]

    turns = [90.0, -40.0, 70.0, -30.0, 60.0, -50.0]
    scenario = {
        "title": "Turns and climbs of a heavy Cessna",
        "gains": [{"name": "mine", "K_P": [[1.0, 0], [0, 2.0]], "K_I": [[0.05, 0], [0, 0.2]]}],
        "flight": {"V_a_mps": 50.0, "h_m": 800.0, "duration_s": duration},
        "reference": {
            "chi_deg": steps(2.0, 6.5, 9.0, lambda k: turns[k % 6]),
            "gamma_deg": steps(4.0, 5.0, 10.0, lambda k: (-1.0) ** k * (3 + k % 3)),
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


def message(kind, body):
    """A message of a ULog."""
    return struct.pack("<HB", len(body), ord(kind)) + body


def ulog(path, topics, parameters=(), version=None):
    """A ULog: times (s) and fields of each topic, a field of several values of shape (n, k)."""
    out = [MAGIC + struct.pack("<Q", 0), message("B", bytes(40))]
    if version is not None:
        key = b"uint32_t ver_sw_release"
        number = struct.pack(">I", int.from_bytes(bytes(version), "big"))[::-1]
        out.append(message("I", bytes([len(key)]) + key + number))
    for name, value in dict(parameters).items():
        key = f"float {name}".encode()
        out.append(message("P", bytes([len(key)]) + key + struct.pack("<f", value)))
    fields = {
        name: {key: np.reshape(x, (len(t), -1)) for key, x in values.items()}
        for name, (t, values) in topics.items()
    }
    for name, of in fields.items():
        sizes = "".join(
            f"float{f'[{x.shape[1]}]' if x.shape[1] > 1 else ''} {key};" for key, x in of.items()
        )
        out.append(message("F", f"{name}:uint64_t timestamp;{sizes}".encode()))
    out += [message("A", struct.pack("<BH", 0, i) + x.encode()) for i, x in enumerate(topics)]
    rows = []
    for number, (name, (t, _)) in enumerate(topics.items()):
        numbers = np.hstack([*fields[name].values()]).astype("<f4")
        head = struct.pack("<HBH", 10 + 4 * numbers.shape[1], ord("D"), number)
        stamps = np.round(1e6 * np.asarray(t)).astype("<u8") + 10**6
        rows += _rows(stamps, head, numbers)
    path.write_bytes(b"".join([*out, *_in_order(rows)]))
    return path


def _rows(stamps, head, numbers):
    return [
        (int(stamp), head + stamp.tobytes() + row.tobytes())
        for stamp, row in zip(stamps, numbers, strict=True)
    ]


def _in_order(rows):
    return [row for _, row in sorted(rows, key=lambda pair: pair[0])]


def _format(number, length, name, layout, columns):
    words = (x.encode() for x in (name, layout, columns))
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, *words)


def dataflash(path, messages, parameters=(), vehicle="ArduPlane V4.5", *, old=False):
    """A DataFlash log: times (s) and columns of each message; `old` ones have a clock in ms."""
    clock, per_s, code = ("TimeMS", 1e3, "I") if old else ("TimeUS", 1e6, "Q")
    out = [_format(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    out.append(_format(129, 75, "MSG", "QZ", "TimeUS,Message"))
    out.append(_format(130, 31, "PARM", "QNf", "TimeUS,Name,Value"))
    rows = []
    for number, (name, (t, columns)) in enumerate(messages.items(), 131):
        size = 3 + struct.calcsize(f"<{code}") + 8 * len(columns)
        labels = f"{clock},{','.join(columns)}"
        out.append(_format(number, size, name, code + "d" * len(columns), labels))
        stamps = np.round(per_s * (np.asarray(t) + 1.0)).astype(f"<u{struct.calcsize(code)}")
        values = np.column_stack([*columns.values()]).astype("<f8")
        rows += _rows(stamps, b"\xa3\x95" + bytes([number]), values)
    out.append(b"\xa3\x95" + struct.pack("<BQ64s", 129, 10**6, vehicle.encode()))
    for name, value in dict(parameters).items():
        out.append(b"\xa3\x95" + struct.pack("<BQ16sf", 130, 10**6, name.encode(), value))
    path.write_bytes(b"".join([*out, *_in_order(rows)]))
    return path


def tlog(path, messages, kind=1, parameters=()):
    """A telemetry log of MAVLink, in which fields are whole numbers where it says so.

    `parameters`: name, value and type of each, of component 1 or of the one that is last.
    """
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    classes = {x.msgname: x for x in mavlink.mavlink_map.values()}
    rows = [(0, mavlink.MAVLink_heartbeat_message(kind, 3, 0, 0, 4, 3).pack(sender))]
    for name, (t, fields) in messages.items():
        of = classes[name]
        types = dict(zip(of.fieldnames, of.fieldtypes, strict=True))
        for k, stamp in enumerate(np.asarray(t)):
            values = {"time_boot_ms": round(1e3 * stamp) + 1000, "autopilot": 3, "type": kind}
            values |= {key: float(x[k]) for key, x in fields.items()}
            row = [
                values.get(key, 0) if types[key] == "float" else round(values.get(key, 0))
                for key in of.fieldnames
            ]
            rows.append((1000 * round(1e3 * stamp) + 10**6, of(*row).pack(sender)))
    for name, value, of_type, component in parameters:
        said = mavlink.MAVLink_param_value_message(name.encode(), value, of_type, 9, 0)
        rows.append((1, said.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=component))))
    rows.sort(key=lambda pair: pair[0])
    path.write_bytes(b"".join(struct.pack(">Q", 16 * 10**14 + t) + x for t, x in rows))
    return path


def fields(signals):
    """Velocity over ground and position of signals."""
    chi, gamma = signals["chi"], signals["gamma"]
    level = signals.get("V_g", signals["V_a"] * np.cos(gamma))
    velocity = {"vx": level * np.cos(chi), "vy": level * np.sin(chi), "vz": -level * np.tan(gamma)}
    return velocity | {"x": signals["north"], "y": signals["east"], "z": signals["down"]}


def quaternion(phi, theta, psi):
    """From body axes to north-east-down, shape (n, 4): w, x, y, z."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_euler("ZYX", np.column_stack([psi, theta, phi])).as_quat().T
    return np.column_stack([w, x, y, z])


def write_ulog(path, t, signals, *, vehicle=2):
    """A ULog with the topics of PX4 and `flighttune.n_z_cmd`."""
    zero = 0.0 * t
    q = quaternion(signals["phi"], signals["gamma"], signals["chi"])
    q_cmd = quaternion(signals["phi_cmd"], zero, signals["chi"])
    acceleration = np.column_stack([zero, zero, -G * signals["n_z"]])
    topics = {
        "vehicle_attitude": {"q": q},
        "vehicle_attitude_setpoint": {"q_d": q_cmd},
        "vehicle_local_position": fields(signals),
        "airspeed_validated": {"true_airspeed_m_s": signals["V_a"]},
        "vehicle_acceleration": {"xyz": acceleration},
        "flighttune": {"n_z_cmd": signals["n_z_cmd"]},
        "vehicle_status": {"vehicle_type": zero + vehicle},
    }
    return ulog(path, {name: (t, values) for name, values in topics.items()})


def write_dataflash(path, t, signals, *, vehicle="ArduPlane V4.5", parameters=()):
    """A DataFlash log with the messages of ArduPlane, and FTUN."""
    ned, deg = fields(signals), np.degrees
    angles = {"DesRoll": deg(signals["phi_cmd"]), "Roll": deg(signals["phi"])}
    angles |= {"Pitch": deg(signals["gamma"]), "Yaw": deg(signals["chi"]) % 360.0}
    path_of = dict(zip(("VN", "VE", "VD", "PN", "PE", "PD"), ned.values(), strict=True))
    messages = {
        "ATT": angles,
        "XKF1": path_of,
        "IMU": {"AccZ": -G * signals["n_z"]},
        "ARSP": {"Airspeed": signals["V_a"]},
        "FTUN": {"NzCmd": signals["n_z_cmd"]},
    }
    if "cross_track" in signals:  # ArduPilot counts it from the aircraft to the track
        messages["NTUN"] = {"AltE": signals["height_err"], "XT": -signals["cross_track"]}
    messages = {name: (t, columns) for name, columns in messages.items()}
    return dataflash(path, messages, parameters, vehicle)


def straight_log(path, parameters, **ends):
    """A log of half a minute straight on with parameters, and signals from 0 to these ends."""
    t = np.linspace(0.0, 30.0, 601)
    signals = dict.fromkeys(("phi", "gamma", "chi", "phi_cmd", "east", "down"), 0.0 * t)
    signals |= dict.fromkeys(("n_z", "n_z_cmd"), 1.0 + 0.0 * t)
    signals |= {"V_a": 25.0 + 0.0 * t, "north": 25.0 * t}
    signals |= {name: x * t / t[-1] for name, x in ends.items()}
    return str(write_dataflash(path, t, signals, parameters=parameters))


def write_tlog(path, t, signals, *, kind=1):
    """A telemetry log; it has no load-factor command."""
    angles = dict(zip(("roll", "pitch", "yaw"), ("phi", "gamma", "chi"), strict=True))
    speed = signals["V_a"]
    messages = {
        "HEARTBEAT": (t[::25], {}),
        "ATTITUDE": (t, {key: signals[name] for key, name in angles.items()}),
        "NAV_CONTROLLER_OUTPUT": (t, {"nav_roll": np.degrees(signals["phi_cmd"])}),
        "LOCAL_POSITION_NED": (t, fields(signals)),
        "VFR_HUD": (t, {"airspeed": speed, "groundspeed": speed}),
    }
    return tlog(path, messages, kind)


def write_csv(path, t, signals):
    """A table with columns of the names and units that need no saying."""
    ned = fields(signals)
    table = {
        "t_s": t,
        **{f"{name}_deg": np.degrees(signals[name]) for name in ("phi", "phi_cmd")},
        **{name: signals[name] for name in ("n_z", "n_z_cmd")},
        "V_a_mps": signals["V_a"],
        **{name: signals[name] for name in ("h", "theta") if name in signals},
        **{f"v_{axis}": ned[name] for axis, name in (("north", "vx"), ("east", "vy"))},
        "v_down_mps": ned["vz"],
    }
    pd.DataFrame(table).to_csv(path, index=False)
    return path
