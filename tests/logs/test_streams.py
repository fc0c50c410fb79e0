"""Streams of a log at their own rates become attitudes, commands and samples at one rate."""

import math
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flighttune as ft
from flighttune.logs import streams

NEXT_TO_ZERO = 1e-3
"""Error of angles (rad) where a part w that the log lacks is so small that its sign is open."""


def turn_with_a_reversal(count=400):
    """Roll, pitch and yaw (rad): a circle and a half to the right, then as far to the left."""
    t = np.linspace(0.0, 60.0, count)
    psi = 3.0 * np.pi * np.sin(np.pi * t / 60.0)
    return t, 0.7 * np.cos(np.pi * t / 60.0), 0.2 * np.sin(0.3 * t), psi


@pytest.mark.parametrize("parts", ["wxyz", "xyz"])
@pytest.mark.parametrize(("name", "ending"), [("q", ""), ("q_enu", ""), ("q_cmd", "_cmd")])
def test_angles_of_a_quaternion_are_those_of_its_rotation(name, ending, parts):
    t, phi, theta, psi = turn_with_a_reversal()
    enu = name == "q_enu"
    turns = (0.5 * np.pi - psi, -theta, phi) if enu else (psi, theta, phi)
    x, y, z, w = Rotation.from_euler("ZYX", np.column_stack(turns)).as_quat(canonical=False).T
    values = {"w": w, "x": x, "y": y, "z": z}
    raw = {f"{name}_{part}": (t, values[part]) for part in parts}
    raw |= {"v_north": (t, 25.0 * np.cos(psi)), "v_east": (t, 25.0 * np.sin(psi))}

    streams.with_angles(raw)

    assert not any(key.startswith("q") for key in raw)
    for key, expected in (("phi", phi), ("theta", theta), ("psi", psi)):
        times, found = raw[f"{key}{ending}"]
        assert (times == t).all()
        assert np.abs(np.exp(1j * found) - np.exp(1j * expected)).max() < NEXT_TO_ZERO


@pytest.mark.parametrize("seed", range(30))
def test_signs_of_w_are_those_that_cost_least_of_all(seed):
    """Noses off the course, and turns between samples: of 2^3 ways, those of a search of all."""
    rng, n = np.random.default_rng(seed), 3
    parts = rng.standard_normal((n, 4))
    w, *vector = (parts / np.linalg.norm(parts, axis=1, keepdims=True)).T
    vector, course = np.column_stack(vector), rng.uniform(-np.pi, np.pi, n)

    def cost(signs):
        q = Rotation.from_quat(np.column_stack([vector, signs * w]))
        off = 1.0 - np.cos(q.as_euler("ZYX")[:, 0] - course)
        inner = np.sum(q.as_quat(canonical=False)[1:] * q.as_quat(canonical=False)[:-1], axis=1)
        return np.sum(off) + streams.SMOOTH * np.sum(1.0 - np.abs(inner))

    found = streams._signs(w, vector, course)

    assert cost(found) == pytest.approx(min(cost(np.array(x)) for x in product((1, -1), repeat=n)))


def test_a_command_is_the_last_measured_value_plus_its_error():
    raw = {
        "phi": (np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.4])),
        "phi_err": (np.array([0.5, 1.0, 2.9, 3.5]), np.array([1.0, 1.0, -0.3, 0.2])),
    }

    streams._with_commands("a log", raw)

    t, commanded = raw["phi_cmd"]
    there = np.isfinite(commanded)
    assert t[there].tolist() == [1.0, 2.9, 3.5]  # none before the first measured value
    assert commanded[there] == pytest.approx([1.1, -0.1, 0.6])
    assert "phi_err" not in raw


@pytest.mark.parametrize(
    ("period", "expected"),
    [
        # of t^2 at 0.5, 0.75, 1 and 1.25 s, and at 1.5, 1.75, 2 and 2.25 s
        (0.25, [0.84375, 3.59375]),
        (0.75, [1.125, 4.125]),
    ],
)
def test_a_faster_stream_is_averaged_and_a_slower_one_interpolated(period, expected):
    times = np.arange(0.0, 3.1, period)

    assert streams._between(np.array([1.0, 2.0]), times, times**2, 1.0) == pytest.approx(expected)


def test_modes_and_states_last_until_the_last_attitude_from_the_first_one():
    attitude = np.arange(100.0, 161.0), np.zeros(61)
    raw = {
        "phi": attitude,
        "mode": (np.array([95.0, 130.0]), np.array([2.0, 3.0])),
        "armed": (np.array([90.0, 110.0, 140.0]), np.array([0.0, 1.0, 0.0])),
    }

    listed, said = streams.phases("a log", raw, {"2": "AUTO"}, {"armed": [1.0, 1.0]})

    assert listed == [("armed", 10.0, 40.0), ("AUTO", 0.0, 30.0), ("mode 3", 30.0, 60.0)]
    assert said == []
    assert raw == {"phi": attitude}


def test_a_state_that_does_not_end_lasts_until_the_last_attitude():
    raw = {"phi": (np.array([100.0, 160.0]), np.zeros(2)), "armed": (np.array([110.0]), np.ones(1))}

    assert streams.phases("a log", raw, {}, {"armed": [1.0, 1.0]})[0] == [("armed", 10.0, 60.0)]


@pytest.mark.parametrize(
    ("period", "other", "dt"),
    [(0.005, 0.5, 0.02), (0.5, 0.05, 0.05), (0.04, 0.1, 0.04), (4.0, 3.0, 0.2)],
)
def test_the_fastest_stream_sets_a_sample_time_of_20_to_200_ms(period, other, dt):
    """The times begin with the first roll, and end with the part or with the last roll."""
    t = 7.0 + period * np.arange(round(60.0 / period) + 1)
    slow = 7.0 + other * np.arange(round(60.0 / other) + 1)
    raw = {"phi": (t, np.sin(t)), "V_a": (slow, 20.0 + 0.1 * slow)}

    for start, end in ((0.0, math.inf), (12.0, 48.0)):
        times, values = streams.on_one_base("a log", dict(raw), start, end, table=False)

        last = min(end, 60.0) - start
        assert times == pytest.approx(dt * np.arange(round(last / dt) + 1))
        assert values["V_a"] == pytest.approx(20.0 + 0.1 * (7.0 + start + times), abs=0.1 * other)


def test_angles_between_samples_take_the_shorter_way_and_gaps_are_empty():
    """A course from 170 deg to 190 deg; no speed from 4 s to 9 s, over four periods of 1 s."""
    t = np.arange(201.0)
    chi = np.radians(np.where(t < 10.0, 170.0, -170.0))
    there = (t <= 4.0) | (t >= 9.0)
    raw = {"phi": (t, 0.0 * t), "chi": (t, chi), "V_a": (t[there], t[there])}

    times, values = streams.on_one_base("a log", raw, 0.0, math.inf, table=False)

    found = dict(zip(times.round(1), np.degrees(values["chi"]) % 360.0, strict=True))
    assert [found[x] for x in (9.0, 9.2, 9.8, 10.0)] == pytest.approx([170.0, 174.0, 186.0, 190.0])
    gap = (times > 4.05) & (times < 8.95)
    assert np.isnan(values["V_a"]).tolist() == gap.tolist()
    assert values["V_a"][~gap] == pytest.approx(times[~gap])


def test_a_table_that_repeats_a_slow_signal_is_a_line_between_its_new_values():
    """Rows at 10 Hz with a height once a second; a command is held until it changes."""
    t = 0.1 * np.arange(201)
    slow = np.floor(t + 1e-9)
    raw = {"phi": (t, np.sin(t)), "h": (t, slow), "phi_cmd": (t, 0.1 * slow)}

    for table, height in ((True, t), (False, slow)):
        _, values = streams.on_one_base("a log", dict(raw), 0.0, math.inf, table=table)

        assert values["h"] == pytest.approx(height, abs=1e-9)
        assert values["phi_cmd"] == pytest.approx(0.1 * slow, abs=1e-9)


SECONDS = np.arange(61.0)


@pytest.mark.parametrize(
    ("raw", "part", "says"),
    [
        ({"psi": (SECONDS, SECONDS)}, (0, 60), "must have roll in numbers at two times or more, "),
        ({"phi": (SECONDS[:1], SECONDS[:1])}, (0, 60), "must have roll in numbers at two times"),
        ({"phi": (SECONDS, SECONDS * np.nan)}, (0, 60), "must have roll in numbers at two times"),
        ({"phi": (5.1 * SECONDS, SECONDS)}, (0, 60), r"every 5\.1 s; .*COLUMN:ms"),
        ({"phi": (4.9e3 * SECONDS, SECONDS)}, (0, 60), r"every 4\.9e\+03 s; .*COLUMN:ms"),
        ({"phi": (5.1e3 * SECONDS, SECONDS)}, (0, 60), r"every 5\.1e\+03 s; .*COLUMN:us"),
        ({"phi": (SECONDS, SECONDS)}, (10, 11.9), r"from 10 to 11\.9 s .* the log has 60\.0 s"),
        ({"phi": (SECONDS, SECONDS)}, (59, 70), "must have more than 10 samples"),
        (
            {"phi": (SECONDS + 3600.0 * (SECONDS > 40), SECONDS)},
            (0, math.inf),
            r"a break of 3\.6e\+03 s at 40\.0 s; a part",
        ),
        (
            {"phi": (4.0 * np.arange(50_002), 0.1 * np.arange(50_002))},
            (0, math.inf),
            r"at most 1000000 samples without a break of over 3600 s, got 1e\+06 samples",
        ),
    ],
)
def test_a_log_without_usable_roll_or_clock_is_refused(raw, part, says):
    with pytest.raises(ft.RecordingError, match=f"a log: .*{says}"):
        streams.on_one_base("a log", dict(raw), *part, table=False)


def test_a_break_of_an_hour_and_a_period_of_five_seconds_are_read():
    t = np.append(5.0 * np.arange(200), [4595.0, 4600.0])

    times, _ = streams.on_one_base("a log", {"phi": (t, 0.0 * t)}, 0.0, math.inf, table=False)

    assert times[-1] == pytest.approx(4600.0)


@pytest.mark.parametrize(
    ("same", "period", "refused"),
    [(6, 0.1, True), (5, 0.1, False), (6, 0.02, False), (6, 0.021, True)],
)
def test_a_clock_that_tells_less_than_half_of_the_samples_apart_is_refused(same, period, refused):
    """So many of eleven samples have the time of the one before, and another roll."""
    t = period * np.cumsum(np.arange(11) > same)
    phi = np.arange(11.0)

    for roll, wrong in ((phi, refused), (0.0 * phi, False)):
        if wrong:
            with pytest.raises(ft.RecordingError, match=f"got {same} of 11 with the time"):
                streams._check_clock("a log", t, roll)
        else:
            streams._check_clock("a log", t, roll)


def test_messages_that_overtake_are_put_in_order_and_a_clock_that_jumps_back_is_refused():
    t = np.array([0.0, 6.0, 1.0, np.nan, 7.0, 7.0, 8.0])
    values = np.array([0.0, 6.0, 1.0, 3.0, 7.0, 7.5, np.nan])

    found, of = streams.in_order("a log", "h", (t, values))

    assert (found.tolist(), of.tolist()) == ([0.0, 1.0, 6.0, 7.0], [0.0, 1.0, 6.0, 7.0])
    with pytest.raises(ft.RecordingError, match=r"clock of `h` .* jump by -5\.1 s at 6\.0 s"):
        streams.in_order("a log", "h", (t + 0.0 * t - 0.1 * (t == 1.0), values))


@pytest.mark.parametrize(
    ("steps", "period"),
    [([], math.inf), ([3.0], 3.0), ([0.1] * 99 + [10.0], 0.1), ([0.1, 0.3] * 50 + [9.0, 9.0], 0.2)],
)
def test_the_period_is_the_mean_without_the_longest_hundredth_of_the_steps(steps, period):
    t = np.cumsum([5.0, *steps])

    # of 102 steps one is left out, and 9 s remain among 101
    expected = (100 * 0.2 + 9.0) / 101 if len(steps) == 102 else period
    assert streams._period(t) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("lengths", "fresh"),
    [
        ([5, 5, 5, 5], [0, 5, 10, 15]),
        ([5, 5, 15, 5], [0, 5, 10, 25]),
        ([5, 5, 16, 5], [0, 5, *range(10, 26), 26]),
        ([20, 20], [0, 20]),
        ([20, 21], [*range(41)]),  # it hardly changes: every row counts
    ],
)
def test_new_values_of_a_table_are_those_that_differ_and_those_of_a_long_rest(lengths, fresh):
    values = np.repeat(np.arange(len(lengths), dtype=float), lengths)

    assert streams._fresh(values).tolist() == fresh


def test_a_time_is_in_a_gap_between_samples_further_apart_and_half_of_it_beyond_the_ends():
    times = np.array([0.0, 1.0, 2.0, 6.0, 7.0])
    t = np.array([-1.6, -1.5, 0.0, 1.5, 2.0, 2.1, 5.9, 6.0, 6.5, 7.0, 8.5, 8.6])

    far = dict(zip(t, streams._far(t, times, 3.0), strict=True))

    assert [x for x, out in far.items() if out] == [-1.6, 2.1, 5.9, 8.6]
    assert not streams._far(np.array([2.1, 5.9]), times, 4.0).any()


def test_modes_in_words_have_their_times_and_how_many_more_there_are():
    listed = [streams.Phase("AUTO", 10.0 * k, 10.0 * k + 4.0) for k in range(8)]
    listed.insert(1, streams.Phase("LOITER", 4.0, 10.0))

    assert streams.in_words(listed) == [
        "AUTO for 32.0 s: 0.0 to 4.0, 10.0 to 14.0, 20.0 to 24.0, 30.0 to 34.0, 40.0 to 44.0, "
        "50.0 to 54.0 s and 2 times more",
        "LOITER for 6.0 s: 4.0 to 10.0 s",
    ]
    assert streams.in_words(listed[2:8])[0].endswith("60.0 to 64.0 s")


def test_what_sensors_did_wrong_is_said_with_its_first_time():
    t = np.array([0.0, 10.0, 20.0, 30.0])
    events = {
        "clip_x": (t, np.array([4.0, 4.0, 7.0, 2.0])),  # a count that starts again does not count
        "clip_z": (t, np.array([0.0, 1.0, 1.0, 1.0])),
        "vibe_y": (t, np.array([3.0, 30.0, 9.0, 1.0])),
        "fix": (t, np.array([3.0, 2.0, 3.0, 1.0])),
    }

    assert streams._of_sensors(events, 45.0) == [
        "The accelerometers clipped 4 times, first at 10.0 s.",
        "The accelerometers vibrate by up to 30 m/s².",
        "Satellites gave no position in three dimensions for 25.0 s, first at 10.0 s.",
    ]
    (said,) = streams._of_sensors({"vibe_z": (t, np.array([0.0, 30.1, 1.0, 1.0]))}, 45.0)
    assert said == "The accelerometers vibrate by up to 30.1 m/s², where up to 30 is acceptable."
    assert streams._of_sensors({"fix": (t, 3.0 + 0.0 * t), "clip_y": (t, 0.0 * t)}, 45.0) == []


def test_times_in_a_phase_are_one_with_its_ends():
    chosen = [streams.Phase("AUTO", 1.0, 2.0), streams.Phase("AUTO", 4.0, 5.0)]

    there = streams.inside(np.array([0.9, 1.0, 2.0, 2.1, 3.9, 4.0, 5.0, 5.1]), chosen)

    assert np.isnan(there).tolist() == [True, False, False, True, True, False, False, True]
    assert (there[[1, 2, 5, 6]] == 1.0).all()
