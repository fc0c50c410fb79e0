"""Messages at their own rates, read as one flight: angles, gaps, clocks, states and sensors."""

import math
import re

import numpy as np
import pandas as pd
import pytest
from log_files import dataflash
from scipy.spatial.transform import Rotation

import flighttune as ft

NEXT_TO_ZERO = 2e-3
"""Error of angles (rad) where a part w that the log lacks is so small that its sign is open."""


def csv(folder, table, **options):
    pd.DataFrame(table).to_csv(folder / "f.csv", index=False)
    return ft.load_log(folder / "f.csv", **options)


def turn_with_a_reversal(count=301):
    """Roll, pitch and yaw (rad): a circle and a half to the right, then as far to the left."""
    t = np.linspace(0.0, 60.0, count)
    psi = 3.0 * np.pi * np.sin(np.pi * t / 60.0)
    return t, 0.7 * np.cos(np.pi * t / 60.0), 0.2 * np.sin(0.3 * t), psi


@pytest.mark.parametrize("parts", ["wxyz", "xyz"])
@pytest.mark.parametrize(("name", "ending"), [("q", ""), ("q_enu", ""), ("q_cmd", "_cmd")])
def test_angles_of_a_quaternion_are_those_of_its_rotation(tmp_path, name, ending, parts):
    """Also where w, whose sign is that of a steady flight with its nose ahead, is left out."""
    t, phi, theta, psi = turn_with_a_reversal()
    enu = name == "q_enu"
    angles = (0.5 * np.pi - psi, -theta, phi) if enu else (psi, theta, phi)
    quaternion = Rotation.from_euler("ZYX", np.column_stack(angles)).as_quat(canonical=False)
    values = dict(zip("xyzw", quaternion.T, strict=True))
    table = {"t": t} | {f"{name}_{part}": values[part] for part in parts}
    table |= {"v_north": 25.0 * np.cos(psi), "v_east": 25.0 * np.sin(psi)}
    table |= {"phi": phi} if ending else {}

    signals = csv(tmp_path, table).signals

    for key, expected in (("phi", phi), ("theta", theta)):
        found = signals[f"{key}{ending}"].to_numpy()
        off = np.abs(np.exp(1j * found) - np.exp(1j * expected))
        assert np.nanmax(off) < NEXT_TO_ZERO, key
        assert np.isfinite(off).all()
    if not ending:
        off = np.exp(1j * signals["psi"].to_numpy()) - np.exp(1j * psi)
        assert np.abs(off).max() < NEXT_TO_ZERO


@pytest.mark.parametrize(
    ("period", "other", "dt"),
    [(0.005, 0.5, 0.02), (0.5, 0.05, 0.05), (0.04, 0.1, 0.04), (4.0, 3.0, 0.2)],
)
def test_the_fastest_message_sets_a_sample_time_of_20_to_200_ms(tmp_path, period, other, dt):
    """Faster ones are averaged, slower ones are lines between their values."""
    t, slow = period * np.arange(12.0 / period + 1), other * np.arange(12.0 / other + 1)
    messages = {"ATT": (t, {"Roll": 0.1 * t**2}), "ARSP": (slow, {"Airspeed": 20.0 + 0.1 * slow})}
    path = dataflash(tmp_path / "f.bin", messages)

    for start, end in ((4.0, 8.0) if period < 0.1 else (0.0, math.inf),):
        run = ft.load_log(path, start=start, end=end)
        assert run.t == pytest.approx(dt * np.arange(round((min(end, 12.0) - start) / dt) + 1))
        whole = start + run.t
        inside = (whole > 0.5) & (whole < 11.5)
        V_a = run.signals["V_a"].to_numpy()[inside]
        assert V_a == pytest.approx(20.0 + 0.1 * whole[inside], abs=0.11 * period)
        roll = np.degrees(run.signals["phi"].to_numpy())[inside]
        # a chord lies above a parabola by up to a quarter of the square of half its length
        assert roll == pytest.approx(
            0.1 * whole[inside] ** 2,
            abs=0.026 * period**2 + 2e-3 * dt + 0.1 * whole.max() * (period < dt) * dt * 0.3,
        )


def test_angles_between_samples_take_the_shorter_way_and_gaps_are_empty(tmp_path):
    """A course from 170 deg to 190 deg; no speed from 4 s to 9 s, over four periods of 1 s."""
    t = np.arange(101.0)
    there = (t <= 4.0) | (t >= 9.0)
    messages = {
        "ATT": (t, {"Roll": 0.0 * t}),
        "GPS": (t, {"GCrs": np.where(t < 10.0, 170.0, -170.0), "Spd": 20.0 + 0.0 * t}),
        "ARSP": (t[there], {"Airspeed": t[there]}),
    }

    run = ft.load_log(dataflash(tmp_path / "f.bin", messages))

    course = dict(zip(run.t.round(1), np.degrees(run.signals["chi"]) % 360.0, strict=True))
    assert [course[x] for x in (9.0, 9.2, 9.8, 10.0)] == pytest.approx(
        [170.0, 174.0, 186.0, 190.0], abs=0.4
    )
    V_a = run.signals["V_a"].to_numpy()
    gap = (run.t > 4.05) & (run.t < 8.95)
    assert np.isnan(V_a).tolist() == gap.tolist()
    assert V_a[~gap] == pytest.approx(run.t[~gap])


def test_a_signal_lasts_half_a_gap_beyond_its_ends(tmp_path):
    """Roll at 8 Hz for 60 s, and a speed once a second from 10 s to 50 s: a gap is over 4 s."""
    t = 0.125 * np.arange(481)
    there = (t % 1.0 == 0.0) & (t >= 10.0) & (t <= 50.0)
    table = {"t": t, "phi": 0.1 * np.sin(t), "V_a": np.where(there, 10.0 + t, np.nan)}

    V_a = csv(tmp_path, table).signals["V_a"].to_numpy()

    inside = (t >= 8.0) & (t <= 52.0)
    assert np.isfinite(V_a).tolist() == inside.tolist()
    assert V_a[inside] == pytest.approx(10.0 + t[inside].clip(10.0, 50.0))


@pytest.mark.parametrize("lengths", [10, 25])
def test_a_table_that_repeats_a_slow_signal_is_a_line_between_its_new_values(tmp_path, lengths):
    """Rows at 10 Hz with a height once a second; a command is held until it changes.

    What changes less often than every twentieth row is taken as it is.
    """
    t = 0.1 * np.arange(401)
    slow = np.floor(t / (0.1 * lengths) + 1e-9)
    table = {"t": t, "phi": 0.1 * np.sin(t), "h": slow, "phi_cmd": 0.05 * slow, "V_a": 20.0}

    signals = csv(tmp_path, table).signals

    line = np.interp(t, t[::lengths], slow[::lengths])
    assert signals["h"].to_numpy() == pytest.approx(line if lengths == 10 else slow, abs=1e-9)
    assert signals["phi_cmd"].to_numpy() == pytest.approx(0.05 * slow, abs=1e-9)
    assert set(signals["V_a"]) == {20.0}


def test_messages_that_overtake_are_put_in_order(tmp_path):
    t = 0.1 * np.arange(200)
    table = pd.DataFrame({"t": t, "phi": 0.2 * np.sin(t), "V_a": 20.0 + t})
    table.loc[50:60] = table.loc[60:50:-1].to_numpy()
    table.loc[100] = np.nan

    run = csv(tmp_path, table)

    assert run.t == pytest.approx(t, abs=1e-9)
    assert run.signals["V_a"].to_numpy() == pytest.approx(20.0 + t)


STILL = 0.0 * np.arange(46.0)
SECONDS = np.arange(46.0)


def events(folder, **streams):
    """A log of 45 s that begins at 5 s by its clock, with events (times and values)."""
    t = np.arange(5.0, 51.0)
    topics = {"mode": "MODE.ModeNum", "armed": "STAT.Armed", "fix": "GPS.Status"}
    topics |= {f"clip_{x}": f"VIBE.Clip{i}" for i, x in enumerate("xyz")}
    topics |= {f"vibe_{x}": f"VIBE.Vibe{x.upper()}" for x in "xyz"}
    messages = {"ATT": (t, {"Roll": STILL}), "ARSP": (t, {"Airspeed": 20.0 + STILL})}
    for name, (times, values) in streams.items():
        topic, _, field = topics[name].partition(".")
        messages.setdefault(topic, (np.array(times, float), {}))[1][field] = np.array(values, float)
    return ft.load_log(dataflash(folder / "f.bin", messages)).provenance.log


def test_modes_and_states_last_from_the_first_attitude_to_the_last(tmp_path):
    """The first mode began before; a tenth change of a state is not listed with its times."""
    flips = np.arange(6.0, 26.0)
    log = events(tmp_path, mode=([0, 20, 30], [5, 10, 77]), armed=(flips, flips % 2))

    states = dict(line.split(" for ") for line in log["phases"])
    assert states["FBWA"] == "15.0 s: 0.0 to 15.0 s"
    assert states["AUTO"] == "10.0 s: 15.0 to 25.0 s"
    assert states["mode 77"] == "20.0 s: 25.0 to 45.0 s"
    assert states["armed"].startswith("34.0 s: 2.0 to 3.0, 4.0 to 5.0, 6.0 to 7.0, 8.0 to 9.0, ")
    assert states["armed"].endswith(" s and 4 times more")


@pytest.mark.parametrize(
    ("streams", "numbers"),
    [
        # a count that starts again does not count
        ({"clip_x": ([5, 15, 25, 35], [4, 4, 7, 2]), "clip_z": ([5, 15, 25, 35], [0, 1, 1, 1])},
         [(4, 10.0)]),
        ({"clip_y": ([5, 15], [3, 3])}, []),
        ({"vibe_y": ([5, 15, 25], [3, 30, 9])}, [(30,)]),
        ({"vibe_x": ([5, 15], [3, 8]), "vibe_z": ([5, 15], [30.1, 1])}, [(30.1, 30)]),
        ({"fix": ([5, 15, 25, 35], [3, 2, 3, 1])}, [(25.0, 10.0)]),
        ({"fix": ([5, 15], [3, 4])}, []),
    ],
)  # fmt: skip
def test_what_sensors_did_wrong_is_said_with_its_first_time(tmp_path, streams, numbers):
    said = events(tmp_path, **streams)["sensors"]

    found = [[float(x) for x in re.findall(r"[\d.]*\d", line.replace("m/s²", ""))] for line in said]
    assert found == [list(row) for row in numbers]
