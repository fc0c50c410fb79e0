"""Lags from logs written by the tests are those of the plant flown; a model from logs flies."""

import math

import numpy as np
import pandas as pd
import pytest
from commands import flighttune
from scipy.signal import lsim

import flighttune as ft

NOISE = 0.002
"""Of the responses, rad and 1."""


def behind(lag, command, fine):
    """The response of a lag, by SciPy: numerator over denominator, behind a delay (s)."""
    denominator, delay = lag
    late = np.interp(fine - delay, fine, command) - command[0]
    _, response, _ = lsim(([denominator[-1]], denominator), late, fine)
    return response + command[0]


ROLL, LIFT = ([1.0, 2.0 * 0.4 * 4.0, 4.0**2], 0.2), ([1.0, 6.0], 0.1)
"""A lag of second order of 4 rad/s damped by 0.4, and of first order of 6 rad/s."""


def table(seconds, *, seed=1, lift=True, dt=0.1):
    """A log at 10 Hz whose commands change every 2 s, with roll and load behind their lags."""
    rng, fine = np.random.default_rng(seed), 0.01 * np.arange(round(100 * seconds))
    roll, load = (
        np.interp(fine, every * np.arange(99), size * rng.uniform(-1.0, 1.0, 99))
        for every, size in ((2.0, 0.35), (1.5, 0.4))
    )
    step = round(100 * dt)
    made = {"t": fine, "phi": behind(ROLL, roll, fine), "phi_cmd": roll, "V_a": 0.0 * fine + 20.0}
    if lift:
        made |= {"n_z": 1.0 + behind(LIFT, load, fine), "n_z_cmd": 1.0 + load}
    made = {name: column[::step] for name, column in made.items()}
    noisy = {
        x: made[x] + NOISE * rng.standard_normal(len(made["t"])) for x in {"phi", "n_z"} & {*made}
    }
    return pd.DataFrame(made | noisy)


def log_of(folder, table, name="flight.csv"):
    pd.DataFrame(table).to_csv(folder / name, index=False)
    return folder / name


def assert_roll(channel):
    lag = channel.lag
    assert (lag.order, channel.reason) == (2, "")
    assert [lag.natural_frequency, lag.damping] == pytest.approx([4.0, 0.4], rel=0.02)
    for (low, high), true, width in ((channel.frequency, 4.0, 0.2), (channel.delay, 0.2, 0.04)):
        assert low < true < high < low + width
    assert channel.fit_percent == pytest.approx(100.0, abs=0.1)


@pytest.mark.slow
def test_the_lag_of_roll_comes_back_with_its_interval_and_the_other_is_assumed(tmp_path):
    found = ft.identify(log_of(tmp_path, table(24.0, lift=False)), assume={"n_z": 5.0})

    assert_roll(found.channels["phi"])
    assert found.channels["phi"].stretches == 4  # of 5 s, after 3 s
    (condition,) = found.identified.conditions
    roll, lift = condition.channels["phi"], condition.channels["n_z"]
    assert (lift.natural_frequency_rad_s, lift.fit_percent, lift.residual) == (5.0, 0.0, 1.0)
    assert roll.residual == pytest.approx((1.0 - roll.fit_percent / 100.0) ** 0.5)
    assert condition.V_a == pytest.approx(20.0)
    assert found.identified.log.assumed == ("n_z",)
    assert list(found.identified.log.frequency_95_rad_s) == ["phi"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Two logs with both channels, and what they identify; each is scored by the other."""
    folder = tmp_path_factory.mktemp("identified")
    logs = [log_of(folder, table(28.0, seed=k), f"{k}.csv") for k in (1, 2)]
    found = ft.identify(*logs)
    return folder, logs, found, found.save(folder / "mine.json")["model"]


@pytest.mark.soak
def test_both_channels_of_two_logs_come_back_and_each_log_scores_the_other(whole):
    _, _, found, model = whole
    assert_roll(found.channels["phi"])
    lift = found.channels["n_z"].lag
    assert (lift.order, found.untold) == (1, {})
    assert [lift.natural_frequency, lift.delay] == pytest.approx([6.0, 0.1], rel=0.05)
    # what is left of the variance of a log is that of the noise
    left = [
        100.0 * (1.0 - NOISE**2 / np.var(x.measured[30:])) for x in found.channels["phi"].sections
    ]
    assert found.channels["phi"].by_log == pytest.approx(left, abs=0.03)
    assert found.title == "1 and 1 more"
    evidence = ft.loop.load_identified(model).log
    assert evidence.stretches == {"phi": 10, "n_z": 10}
    assert evidence.phi_deg == pytest.approx([-20.0, 20.0], abs=4.0)  # the lag rounds steps off


@pytest.mark.soak
def test_a_model_from_logs_is_an_aircraft_without_an_airframe(whole):
    folder, _, _, _ = whole
    flighttune("new", "mine", "--aircraft", "mine.json", cwd=folder)

    flown = ft.fly(folder / "mine.toml", changes={"flight.duration_s": 2.0, "expect": []})
    assert [run.status for run in flown.runs] == ["completed"] * 2
    assert "jsbsim" in flighttune("gap", "mine.toml", status=2, cwd=folder)[1]


@pytest.mark.soak
@pytest.mark.parametrize(
    ("late", "says"),
    [(1.5, "is at an end of its range"), (math.inf, "roll rests while its commands change")],
)
def test_a_lag_beyond_the_range_of_the_fit_is_said(tmp_path, late, says):
    t = np.arange(300) / 10.0
    command = 20.0 * np.sign(np.sin(0.5 * t))
    phi = np.interp(t - late, t, command) if late < math.inf else 0.0 * t
    made = {"t_s": t, "phi_deg": phi, "phi_cmd_deg": command, "V_a": 20.0}

    found = ft.identify(log_of(tmp_path, made), assume={"n_z": 5.0})

    reasons = [channel.reason for channel in found.channels.values()]
    assert says in " ".join([*reasons, *found.untold.values()])


T = 0.1 * np.arange(600)
STEPS = 0.1 * np.sign(np.sin(2.0 * T))


@pytest.mark.parametrize(
    ("made", "stretches"),
    [
        # of 5 s after 3 s of each section; the last may have half of it
        ({"phi": np.where(T < 10.4, 0.0, np.nan)}, 1),
        ({"phi": np.where(T < 10.6, 0.0, np.nan)}, 2),
        ({"phi": np.where(T < 18.1, 0.0, np.nan)}, 3),
    ],
)
def test_too_few_stretches_of_excitation_are_counted(tmp_path, made, stretches):
    base = {"t": T, "phi": 0.0 * T, "phi_cmd": STEPS, "V_a": 20.0 + 0.0 * T}
    found = ft.identify(log_of(tmp_path, base | made), assume={"phi": 5.0, "n_z": 5.0})

    words = "" if stretches is None else f"5 deg in {stretches} stretches of 5 s"
    assert words in found.untold["phi"]
    assert found.identified.log.assumed == ("phi", "n_z")


@pytest.mark.parametrize("at_s", [10.0, 25.0])
def test_the_residual_rates_of_a_log_are_the_largest_of_all_its_stretches(tmp_path, at_s):
    t = 0.04 * np.arange(900)
    chi = 0.03 * np.clip(t - at_s, 0.0, 4.0)
    made = {"t_s": t, "phi": 0.0, "phi_cmd": 0.0, "n_z": 1.0, "n_z_cmd": 1.0, "V_a": 20.0}
    made |= {"v_north": 20.0 * np.cos(chi), "v_east": 20.0 * np.sin(chi), "v_down": 0.0 * t}

    told = ft.identify(log_of(tmp_path, made), assume={"phi": 5.0, "n_z": 5.0}).identified.log

    assert told.residual_stretches > 4
    assert told.residual_rad_s["chi"] == pytest.approx(0.03, rel=1e-6)
    assert told.residual_rad_s["gamma"] == pytest.approx(0.0, abs=1e-9)


def test_limits_are_the_range_of_commands_and_the_fastest_response_else_assumed(tmp_path):
    """Half a hundredth of the commands is left out at either end; heights are medians."""
    command = np.radians(np.linspace(-20.0, 30.0, 600))
    made = {"t": T, "phi": 0.5 * command, "phi_cmd": command, "V_a": 21.0, "h": 123.44, "n_z": 1.0}
    path = log_of(tmp_path, made)

    found = ft.identify(path, assume={"phi": 4.0, "n_z": 5.0})

    log = found.identified.log
    assert log.phi_deg == pytest.approx((-19.75, 29.75), abs=1e-3)
    assert log.phi_rate_dps == pytest.approx(25.0 / T[-1], rel=1e-6)
    assert (log.n_z, log.n_z_rate_per_s, log.limits_assumed) == ((0.5, 1.5), 2.0, ("n_z",))
    assert (log.residual_rad_s, log.residual_stretches) == (None, 0)
    assert "its limits are assumed: 0.5 to 1.5, 2 per s" in found.untold["n_z"]
    (condition,) = found.identified.conditions
    assert (condition.V_a, condition.gamma, condition.h) == (21.0, 0.0, 123.4)
    assert [lag.natural_frequency for lag in condition.lags] == [4.0, 5.0]
    model = found.save(tmp_path / "mine.json")["model"]
    assert ft.loop.load_identified(model).log.limits_assumed == log.limits_assumed


REFUSED = [
    ({"V_a": [25.0]}, "`V_a` and `gamma` must be absent with a log"),
    ({"gamma": [0.0]}, "`V_a` and `gamma` must be absent with a log"),
    ({"assume": {"theta": 3.0}}, "`assume` must name phi or n_z, got theta"),
]


def test_without_an_assumption_there_is_no_model_and_the_remedy_is_said(tmp_path):
    path = log_of(tmp_path, {"t": T, "phi": 0.1 * np.sin(T), "V_a": 20.0})

    for assume, missing in (({}, "phi"), ({"n_z": 5.0}, "phi"), ({"phi": 5.0}, "n_z")):
        found = ft.identify(path, assume=assume)
        assert found.identified is None
        assert {*found.untold} == {"phi", "n_z"}
        assert f"--assume {missing}=RAD_S" in found.missing
        assert found.save(tmp_path / "x.json") == {"model": None, "figure": None}
    assert "no roll commands" in found.untold["phi"]
    assert "no load-factor commands" in found.untold["n_z"]
    assert not (tmp_path / "x.json").exists()
    for options, words in REFUSED:
        with pytest.raises(ft.InputError, match=words):
            ft.identify(path, **options)
    for options in ({"assume": {"n_z": 5.0}}, {"columns": ["phi=roll"]}):
        with pytest.raises(ft.InputError, match="`columns` and `assume` must be absent"):
            ft.identify("aerosonde", **options)
    said = flighttune("identify", path, status=1, cwd=tmp_path)[1]
    assert "--assume phi=RAD_S" in said


@pytest.mark.parametrize(
    ("made", "says"),
    [
        ({"identified": "aerosonde", "roll_lag_rad_s": 3.0}, "`roll_lag_rad_s` must be absent"),
        ({"identified": "nowhere.json"}, r"\[plant\] `identified` must be an aircraft or a model"),
    ],
)
def test_lags_of_a_plant_are_given_or_identified(made, says):
    tables = ft.load_scenario("level_turn").as_dict()
    tables |= {"plant": [{"kind": "point_mass_lag", **made}], "expect": []}
    with pytest.raises(ft.InputError, match=says):
        ft.fly(ft.scenario_from(tables))
