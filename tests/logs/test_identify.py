"""Lags from logs written by the tests are those of the plant flown; a model from logs flies."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import answer, flighttune
from flown_campaigns import flown_here
from log_files import LOAD, ROLL, sampled, write_csv, write_tlog, write_ulog
from made_up import made_up_run
from scipy.signal import lfilter, lsim

import flighttune as ft
from flighttune.flight.new import new_scenario
from flighttune.logs import identify
from flighttune.vehicles.identification import fit
from flighttune.vehicles.identification.fit import fit_percent

SAMPLE = 0.04
"""s: of the logs."""
LAG = 0.03
"""Relative error allowed of the lag without its delay, with noise, dropouts and late stamps."""
CORRELATION = 0.02  # of 40,000 samples, four times its error
JACKKNIFE = 0.5
"""Relative error of a width that is estimated from 24 stretches."""


@pytest.fixture(scope="module")
def log(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("identified") / "flight.csv"
    return write_csv(path, *sampled(flight))


@pytest.fixture(scope="module")
def identification(log):
    return ft.identify(log)


@pytest.fixture(scope="module")
def model(log, identification):
    identification.identified.save(log.with_name("mine.json"))
    return log.with_name("mine.json")


@pytest.mark.parametrize("share", [0.0, 0.6])
def test_what_turbulence_leaves_after_a_tenth_of_a_second_is_its_correlation(monkeypatch, share):
    count, dt = 40_000, 0.05
    white = np.random.default_rng(5).standard_normal(count)
    measured = lfilter([1.0], [1.0, -math.sqrt(share)], white)  # half of the time in each sample
    measured[0] = 0.0
    t = dt * np.arange(count)
    section = identify.Section(0, t, dt, np.zeros(count), measured, np.floor(t / 5.0))
    lag = ft.loop.InnerLag(order=1, natural_frequency=4.0)
    monkeypatch.setattr(fit, "best_lag", lambda *_: (lag,))  # the fit itself takes ten seconds

    excited = identify._Excited([section])

    assert excited._carried == pytest.approx(share, abs=CORRELATION)
    left = np.std(excited.fresh(lag)) / np.std(measured)
    assert left == pytest.approx(math.sqrt(1.0 - share**2), abs=CORRELATION)


@pytest.mark.soak
def test_lag_and_delay_come_back(identification):
    assert not identification.untold
    for channel, true in (("phi", ROLL), ("n_z", LOAD)):
        told = identification.channels[channel]
        assert told.lag.order == true.order
        assert told.lag.whole - told.lag.delay == pytest.approx(true.whole - true.delay, rel=LAG)
        assert told.lag.delay == pytest.approx(true.delay, abs=SAMPLE)
        low, high = told.frequency
        assert low < told.lag.natural_frequency < high < 1.2 * low
        assert told.fit_percent > 97.0


@pytest.mark.parametrize("at_s", [20.0, 45.0])
def test_the_residual_rates_of_a_log_are_the_largest_of_all_its_stretches(tmp_path, at_s):
    t = SAMPLE * np.arange(1800)
    chi = 0.03 * np.clip(t - at_s, 0.0, 4.0)
    table = {"t_s": t, "phi": 0.0, "phi_cmd": 0.0, "n_z": 1.0, "n_z_cmd": 1.0, "V_a": 20.0}
    table |= {"v_north": 20.0 * np.cos(chi), "v_east": 20.0 * np.sin(chi), "v_down": 0.0 * t}
    pd.DataFrame(table).to_csv(tmp_path / "flight.csv", index=False)

    told = ft.identify(tmp_path / "flight.csv", assume={"phi": 5.0, "n_z": 5.0}).identified.log

    assert told.residual_stretches > 5
    assert told.residual_rad_s["chi"] == pytest.approx(0.03, rel=1e-6)
    assert told.residual_rad_s["gamma"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("dt", "steps"), [(0.02, (0.01,)), (0.04, (0.01, 0.03))])
def test_a_step_between_two_samples_is_where_a_loop_of_50_Hz_would_give_it(dt, steps):
    """At 50 Hz in their middle, for a sample is 10 ms old in the mean; else at either time."""
    lag, t = ft.loop.InnerLag(order=1, natural_frequency=5.0), dt * np.arange(20)
    commanded = np.where(t < 4.5 * dt, 0.0, 1.0)

    answered = identify.response(lag, dt, commanded, 0.0)

    since = [np.maximum(0.0, t - 4.0 * dt - step) for step in steps]
    assert answered == pytest.approx(
        np.mean(1.0 - np.exp(-5.0 * np.array(since)), axis=0), abs=1e-9
    )


def test_the_interval_of_a_mean_is_students():
    """Five stretches of means 1 to 5: 3 within 2.776445 (t of 4, 97.5 %) times sqrt(2.5 / 5)."""
    means, late = np.arange(1.0, 6.0), np.zeros(1)

    ends = identify.interval_of(np.array([3.0]), np.ones((5, 1, 1)), (3.0 - means)[:, None], late)

    half = 2.776445 * np.sqrt(2.5 / 5.0)
    assert ends[:, 0] == pytest.approx([3.0 - half, 3.0 + half], rel=1e-6)


def test_the_interval_of_a_frequency_is_as_wide_as_its_noise_allows(monkeypatch):
    """White noise leaves a fit at least the inverse of the Fisher information as its variance."""
    t, frequency, noise = np.arange(0.0, 120.0, SAMPLE), 4.0, 0.5
    fine = np.linspace(t[0], t[-1], 40 * (len(t) - 1) + 1)
    commanded = 20.0 * np.sign(np.sin(0.5 * t + 0.1))

    def behind(rate, delay=0.0):
        kept = np.exp(-rate * (fine[1] - fine[0]))
        return lfilter([1.0 - kept], [1.0, -kept], np.interp(fine - delay, t, commanded))[::40]

    by = 0.01
    slopes = np.column_stack([behind(frequency * np.exp(by)), behind(frequency, by)])
    slopes = (slopes - behind(frequency)[:, None]) / by / noise
    error = math.sqrt(np.linalg.inv(slopes.T @ slopes)[0, 0])
    measured = behind(frequency) + noise * np.random.default_rng(3).standard_normal(len(t))
    section = identify.Section(0, t, SAMPLE, commanded, measured, np.floor(t / 5.0))
    lag = ft.loop.InnerLag(order=1, natural_frequency=frequency)
    monkeypatch.setattr(fit, "best_lag", lambda *_: (lag,))  # the fit itself takes ten seconds

    low, high = identify._Excited([section]).interval(lag)

    assert 0.5 * (low[0] + high[0]) == pytest.approx(math.log(frequency), abs=1e-12)
    assert high[0] - low[0] == pytest.approx(2.0 * 1.96 * error, rel=JACKKNIFE)


@pytest.mark.soak
def test_limits_are_those_seen(model):
    evidence = ft.loop.load_identified(model).log

    assert evidence.phi_deg[0] > -46.0
    assert evidence.phi_deg[1] < 46.0
    assert 10.0 < evidence.phi_rate_dps < 200.0
    assert evidence.assumed == ()


@pytest.mark.soak
def test_a_log_takes_no_airspeeds(log):
    with pytest.raises(ft.InputError, match=r"`V_a` and `gamma` must"):
        ft.identify(log, V_a=[25.0])


def test_of_an_aircraft_nothing_is_assumed():
    for options in ({"assume": {"n_z": 5.0}}, {"columns": ["phi=roll"]}):
        with pytest.raises(ft.InputError, match=r"`columns` and `assume` must be absent"):
            ft.identify("aerosonde", **options)


def test_every_channel_that_logs_cannot_tell_must_be_assumed(tmp_path):
    t = np.arange(0.0, 60.0, 0.1)
    table = {"t_s": t, "phi_deg": 20.0 * np.sin(0.5 * t), "v_north": 20.0, "v_east": 0.0}
    pd.DataFrame(table).to_csv(tmp_path / "flight.csv", index=False)

    for assume, missing in (({"n_z": 5.0}, "phi"), ({"phi": 5.0}, "n_z")):
        found = ft.identify(tmp_path / "flight.csv", assume=assume)

        assert found.identified is None
        assert {*found.untold} == {"phi", "n_z"}
        assert f"--assume {missing}=RAD_S" in found.missing
    both = ft.identify(tmp_path / "flight.csv", assume={"phi": 3.0, "n_z": 5.0}).identified
    lags = [lag.natural_frequency for lag in both.conditions[0].lags]
    assert lags == [3.0, 5.0]


@pytest.mark.slow
def test_what_the_logs_cannot_tell_is_said(flight, tmp_path):
    t, signals = sampled(flight)
    calm = {**signals, "phi_cmd": 0.03 * signals["phi_cmd"], "phi": 0.03 * signals["phi"]}
    calm["chi"] = calm["east"] = 0.0 * t
    calm["north"] = np.cumsum(signals["V_a"] * np.gradient(t))
    path = write_ulog(tmp_path / "calm.ulg", t, calm)

    found = ft.identify(path)

    assert found.identified is None
    assert found.untold["n_z"] == "the logs have no load-factor commands"
    assert "changed by more than 5 deg in 0 stretches" in found.untold["phi"]
    said = flighttune("identify", path, status=1, cwd=tmp_path)[1]
    assert "--assume phi=RAD_S" in said
    assert not (tmp_path / "runs").exists()


@pytest.mark.soak
def test_telemetry_identifies_roll_and_takes_the_other_channel_as_assumed(flight, tmp_path):
    path = write_tlog(tmp_path / "flight.tlog", *sampled(flight))

    said = answer("identify", path, "--assume", "n_z=5", "--out", "mine.json", cwd=tmp_path)

    roll, load = (said["conditions"][0]["channels"][name] for name in ("phi", "n_z"))
    assert said["log"]["assumed"] == ["n_z"]
    assert (load["natural_frequency_rad_s"], load["fit_percent"], load["cross"]) == (5.0, 0.0, None)
    assert roll["fit_percent"] > 97.0
    assert (tmp_path / "mine.svg").stat().st_size > 1000


@pytest.mark.soak
def test_several_logs_score_each_other(flight, log):
    whole = ft.load_log(log)
    halves = [f"{log}@0:75", f"{log}@75:150"]

    found = ft.identify(*halves)

    assert len(found.channels["phi"].by_log) == 2
    assert min(found.channels["phi"].by_log) > 97.0
    assert found.channels["phi"].fit_percent > 97.0
    assert found.identified.conditions[0].V_a == pytest.approx(
        whole.signals["V_a"].median(), abs=0.2
    )


@pytest.mark.soak
def test_a_model_from_logs_is_an_aircraft_without_an_airframe(model):
    folder = model.parent
    flighttune("new", "mine", "--aircraft", "mine.json", cwd=folder)

    flown = ft.fly(folder / "mine.toml")
    certification = ft.certify(folder / "mine.toml")
    c = ft.export(folder / "mine.toml", form="c", out=folder / "c")
    with flown_here():
        meeting = ft.meet(folder / "mine.toml", budget=6)

    assert [run.status for run in flown.runs] == ["completed"] * 2
    table = flown.scenario.plant_table("point_mass_lag")
    assert table.lags() == ft.loop.load_identified(model).conditions[0].lags
    assert certification.answer().failure == ""
    assert any(str(file).endswith(".c") for file in c.answer().files.values())
    assert meeting.answer().tables
    said = flighttune("gap", "mine.toml", status=2, cwd=folder)[1]
    assert "`plant` must be an aircraft (jsbsim)" in said


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"identified": "aerosonde", "roll_lag_rad_s": 3.0}, "`roll_lag_rad_s` must be absent"),
        ({"identified": "nowhere.json"}, r"\[plant\] `identified` must be an aircraft or a model"),
    ],
)
def test_lags_of_a_plant_are_given_or_identified(table, says):
    tables = ft.load_scenario("level_turn").as_dict()
    tables["plant"] = [{"kind": "point_mass_lag", **table}]
    tables["expect"] = []

    with pytest.raises(ft.InputError, match=says):
        ft.fly(ft.scenario_from(tables))


@pytest.mark.soak
def test_commands_of_a_log_fly_on_the_model_identified_from_it(log, model):
    told = answer("gap", log, "--aircraft", model, cwd=log.parent)

    law, _, identified, _ = told["differences"]
    assert identified["phi"] < 0.1 * law["phi"]
    factors = {row["factor"]: row["value"] for row in told["factors"]}
    assert set(factors) == {"phi_late", "n_z_late", "wind_north", "wind_east"}
    assert factors["phi_late"] == pytest.approx(0.0, abs=LAG * ROLL.whole)
    assert np.hypot(factors["wind_north"], factors["wind_east"]) < 0.2  # m/s: the noise of airspeed


@pytest.mark.counts
def test_the_tube_of_a_model_from_logs_is_of_the_residual_rates_that_they_show(model, tmp_path):
    """They are those of a known disturbance, a swing of the course rate of 0.02 rad/s in 10 s."""
    run = ft.load_log(model.with_name("flight.csv"))
    swing = 0.02 * 10.0 / (2.0 * np.pi) * -np.cos(2.0 * np.pi * run.t / 10.0)
    signals = run.signals.assign(chi=run.signals["chi"] + swing)
    shaken = ft.Run(signals=signals, status="completed", reason="", provenance=run.provenance)
    quiet, found = ft.loop.load_identified(model).log, ft.identify(shaken).identified
    found.save(tmp_path / "mine.json")
    found = ft.loop.load_identified(tmp_path / "mine.json")
    flighttune("new", "mine", "--aircraft", "mine.json", cwd=tmp_path)
    gains = ft.PIGains(K_P=np.eye(2), K_I=0.1 * np.eye(2))
    calm = {"reference.chi_deg": 15.0, "flight.duration_s": 4.0}

    tube = ft.tube(tmp_path / "mine.toml", gains, plant="point_mass_lag", changes=calm)

    mean = 0.02 * np.sin(0.1 * np.pi) / (0.1 * np.pi)  # of the swing, over 1 s about its peak
    assert found.log.residual_rad_s["chi"] == pytest.approx(mean, abs=quiet.residual_rad_s["chi"])
    assert found.log.residual_stretches > 20
    assert tube.status == "bounded"
    assert tube.problem.disturbance == max(found.log.residual_rad_s.values())
    assert "no claim about other flights" in " ".join(tube.answer().notes)


@pytest.mark.counts
@pytest.mark.parametrize(
    ("late", "says"),
    [(1.5, "is at an end of its range"), (math.inf, "roll rests while its commands change")],
)
def test_a_lag_beyond_the_range_of_the_fit_is_said(tmp_path, late, says):
    t = np.arange(2000) / 25.0
    command = 20.0 * np.sign(np.sin(0.5 * t))
    phi = np.interp(t - late, t, command) if late < math.inf else 0.0 * t
    table = {"t_s": t, "phi_deg": phi, "phi_cmd_deg": command, "v_north": 20.0, "v_east": 0.0}
    pd.DataFrame(table).to_csv(tmp_path / "flight.csv", index=False)

    found = ft.identify(tmp_path / "flight.csv", assume={"n_z": 5.0})

    reasons = [channel.reason for channel in found.channels.values()]
    assert says in " ".join([*reasons, *found.untold.values()])


def test_take_off_and_landing_are_below_half_the_usual_speed():
    speed = [0.0, 9.9, 10.1, 12.0, *[20.0] * 9, np.nan]
    run = made_up_run({"V_a": speed, "V_g": 0.0})

    assert identify.flying(run).tolist() == [False, False, *[True] * 11, False]
    assert not identify.flying(run, np.full(len(speed), np.nan)).any()


def test_a_fit_is_the_share_of_the_variance_and_none_where_nothing_varies():
    measured = np.array([0.0, 2.0, 0.0, 2.0])

    assert fit_percent(measured, measured) == 100.0
    assert fit_percent(measured, np.ones(4)) == 0.0
    assert fit_percent(measured, np.array([0.5, 1.5, 0.5, 1.5])) == pytest.approx(75.0)
    assert fit_percent(np.ones(4), np.ones(4)) == -math.inf


def section_log(seconds, *, dt=0.1, gap=None, command=None):
    """A log whose roll command changes by 12 deg all the time; its roll has a `gap` (s)."""
    t = dt * np.arange(round(seconds / dt))
    phi_cmd = 0.1 * np.sign(np.sin(2.0 * t)) if command is None else command(t)
    phi = np.where((t > gap[0]) & (t < gap[1]), np.nan, 0.0) if gap else 0.0 * t
    return made_up_run({"phi": phi, "phi_cmd": phi_cmd, "V_a": 20.0 + 0.0 * t}, t)


@pytest.mark.parametrize(
    ("log", "stretches"),
    [
        # after 3 s stretches of 5 s, and a last one of half of it or more
        (section_log(30.0), [(low, low + 5.0) for low in (3.0, 8.0, 13.0, 18.0, 23.0)]),
        (section_log(20.4), [(3.0, 8.0), (8.0, 13.0), (13.0, 18.0)]),
        (section_log(20.5), [(3.0, 8.0), (8.0, 13.0), (13.0, 18.0), (18.0, 20.5)]),
        (section_log(24.0, gap=(7.95, 9.95)), [(3.0, 8.0), (13.0, 18.0), (18.0, 23.0)]),
        # commands that rest show no lag
        (
            section_log(30.0, command=lambda t: 0.08 * np.sin(9.0 * np.minimum(t, 13.0))),
            [(3.0, 8.0), (8.0, 13.0)],
        ),
        (section_log(5.4), []),
        (section_log(5.5), [(3.0, 5.5)]),
    ],
)
def test_stretches_of_excitation_are_numbered_after_the_start_of_a_section(log, stretches):
    sections = [*identify._sections(log, 3, "phi", 7)]

    found = [
        (section.t[section.stretch == k][[0, -1]] + [0.0, section.dt]).tolist()
        for section in sections
        for k in np.unique(section.stretch[np.isfinite(section.stretch)])
    ]
    assert found == [pytest.approx(ends) for ends in stretches]
    numbers = np.concatenate([section.stretch for section in sections] or [[]])
    assert np.unique(numbers[np.isfinite(numbers)]).tolist() == [*range(7, 7 + len(stretches))]
    assert all(section.run == 3 for section in sections)


@pytest.mark.parametrize(
    ("lag", "options", "says"),
    [
        ({}, {}, ""),
        ({"natural_frequency": 20.0}, {"dt": 0.2}, "every 0.2 s is too coarse for 20 rad/s"),
        ({}, {"distinct": False}, "first and second order fit alike"),
        ({}, {"width": math.log(3.0) + 0.01}, "its ends would differ by more than a factor of 3"),
        ({}, {"width": math.log(3.0) - 0.01}, ""),
        ({"natural_frequency": 100.0}, {}, "is at an end of its range"),
        ({"natural_frequency": 0.201}, {}, "is at an end of its range"),
        ({"delay": 1.0}, {}, "5 rad/s behind 1 s, is at an end of its range"),
    ],
)  # fmt: skip
def test_an_interval_is_given_where_the_samples_show_one(lag, options, says):
    lag = ft.loop.InnerLag(**({"order": 1, "natural_frequency": 5.0, "delay": 0.1} | lag))
    options = {"dt": 0.02, "width": 0.1, "distinct": True} | options

    said = identify._why_no_range(
        lag, options["dt"], options["width"], distinct=options["distinct"]
    )

    assert (says in said) if says else said == ""


def test_limits_are_the_range_of_commands_and_the_fastest_response():
    """Five of 1001 samples are left out at either end, and the ten fastest rates."""
    t = 0.1 * np.arange(1001)
    command = np.radians(np.linspace(-20.0, 30.0, 1001))
    slow = made_up_run({"phi": 0.5 * command, "phi_cmd": command}, t)
    none = made_up_run({"V_a": 0.0 * t}, t)

    (low, high), rate = identify._range([slow, none], "phi")

    assert (low, high) == pytest.approx((-20.0 + 0.25, 30.0 - 0.25))
    assert rate == pytest.approx(0.25)  # 25 deg in 100 s
    alone = made_up_run({"phi": command}, t)
    assert identify._range([alone], "phi")[0] == pytest.approx((-19.75, 29.75))
    assert identify._range([none], "phi") == ((-45.0, 45.0), 60.0)
    assert identify._range([none], "n_z") == ((0.5, 1.5), 2.0)


@pytest.mark.parametrize(
    ("log", "says"),
    [
        (made_up_run({"phi": [0.0]}), "the logs have no roll commands"),
        (section_log(13.0), "more than 5 deg in 2 stretches of 5 s without a gap, and must in 4"),
    ],
)
def test_a_channel_that_logs_do_not_show_has_its_reason(log, says):
    assert says in identify._channel([log], "phi")


NOISE = 0.002  # rad


def behind_a_lag(seed, *denominator, delay=0.2):
    """Eight stretches of a log at 10 Hz whose commands change every 2 s, and roll behind a lag."""
    rng, fine = np.random.default_rng(seed), 0.01 * np.arange(4300)
    command = np.interp(fine, 2.0 * np.arange(22), 0.35 * rng.uniform(-1.0, 1.0, 22))
    late = np.interp(fine - delay, fine, command) - command[0]
    _, phi, _ = lsim(([denominator[-1]], denominator), late, fine)
    phi = (phi + command[0])[::10] + NOISE * rng.standard_normal(430)
    return made_up_run(
        {"phi": phi, "phi_cmd": command[::10], "V_a": np.full(430, 20.0)}, fine[::10]
    )


@pytest.mark.slow
def test_a_lag_of_second_order_is_found_in_two_logs_each_scored_by_the_other(monkeypatch):
    monkeypatch.setattr(fit, "TIME_STARTS", [(1.0, 0.01, 0.0, 0.0)])  # other starts end there too
    logs = [behind_a_lag(seed, 1.0, 2.0 * 0.4 * 4.0, 4.0**2) for seed in (1, 2)]

    found = identify._channel(logs, "phi")

    assert (found.lag.order, found.reason, found.stretches) == (2, "", 16)
    assert [found.lag.natural_frequency, found.lag.damping] == pytest.approx([4.0, 0.4], rel=0.01)
    for (low, high), true, width in ((found.frequency, 4.0, 0.1), (found.delay, 0.2, 0.03)):
        assert low < true < high < low + width
    # what is left of the variance of a log is that of the noise
    variance = [np.var(section.measured[30:]) for section in found.sections]
    left = [100.0 * (1.0 - NOISE**2 / part) for part in variance]
    assert found.by_log == pytest.approx(left, abs=0.01)
    assert min(left) < found.fit_percent < max(left)
    assert [section.run for section in found.sections] == [0, 1]


@pytest.mark.slow
def test_a_lag_of_first_order_is_found_in_one_log_and_none_where_roll_rests(monkeypatch):
    monkeypatch.setattr(fit, "TIME_STARTS", [(1.0, 0.01, 0.0, 0.0)])
    log = behind_a_lag(3, 1.0, 4.0)
    still = made_up_run(log.signals.assign(phi=0.1).to_dict("list"), log.t)

    found = identify._channel([log], "phi")

    assert (found.lag.order, found.reason, found.stretches) == (1, "", 8)
    assert found.frequency[0] < 4.0 < found.frequency[1] < 1.1 * found.frequency[0]
    assert found.delay[0] < 0.2 < found.delay[1]
    assert found.fit_percent > 99.9
    assert found.by_log == ()
    assert identify._channel([still], "phi") == "roll rests while its commands change"


@pytest.fixture
def rolled():
    """Rolls to 20 deg and back to -15 deg by commands of a third more, at 21 m/s."""
    t = 0.1 * np.arange(500)
    phi = np.where(np.sin(0.5 * t) > 0.0, 20.0, -15.0) / 57.29577951308232
    columns = {"phi": phi, "phi_cmd": 4.0 / 3.0 * phi, "V_a": 21.0376, "h": 123.44, "V_g": 20.0}
    return made_up_run({name: np.broadcast_to(x, 500) for name, x in columns.items()}, t)


def test_a_model_of_a_log_has_what_it_shows_and_what_is_assumed(rolled):
    lag = ft.loop.InnerLag(order=2, natural_frequency=4.0, damping=0.7, delay=0.1)
    channel = identify.ChannelOfLogs(
        lag=lag, fit_percent=99.0, by_log=(), frequency=(3.0, 5.0), delay=(0.0, 0.2), reason="",
        stretches=7, sections=(),
    )  # fmt: skip

    model = identify._aircraft([rolled], ("mine",), {"phi": channel}, {"n_z": 5.0})

    (condition,) = model.conditions
    assert (model.aircraft, condition.V_a, condition.gamma, condition.h) == (
        "mine",
        21.0376,
        0.0,
        123.4,
    )
    roll, lift = condition.channels["phi"], condition.channels["n_z"]
    assert (roll.order, roll.natural_frequency_rad_s, roll.delay_s) == (2, 4.0, 0.1)
    assert (roll.fit_percent, roll.residual) == (99.0, pytest.approx(0.1))
    assert (lift.order, lift.natural_frequency_rad_s, lift.fit_percent) == (1, 5.0, 0.0)
    log = model.log
    assert (log.logs, log.assumed, log.limits_assumed) == (("mine",), ("n_z",), ("n_z",))
    assert (log.frequency_95_rad_s, log.delay_95_s) == ({"phi": (3.0, 5.0)}, {"phi": (0.0, 0.2)})
    assert log.stretches == {"phi": 7}
    assert log.phi_deg == pytest.approx([-20.0, 80.0 / 3.0])
    assert (log.n_z, log.n_z_rate_per_s) == ((0.5, 1.5), 2.0)
    assert (log.residual_rad_s, log.residual_stretches) == (None, 0)


def test_a_new_scenario_of_a_model_from_logs_has_its_limits_and_its_start(
    rolled, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    model = identify._aircraft([rolled], ("mine",), {}, {"phi": 4.0, "n_z": 5.0})
    model.save(tmp_path / "mine.json")

    file = new_scenario("first", aircraft="mine.json")

    made = ft.load_scenario(file)
    assert (made.flight.V_a_mps, made.flight.h_m, made.flight.gamma_deg) == (21.04, 123.4, 0.0)
    assert made.limits.phi_deg == (-20.0, 26.7)  # three digits of what the log shows
    assert made.limits.n_z == (0.5, 1.5)
    rate = float(np.percentile(np.abs(np.gradient(rolled.signals["phi"], rolled.t)), 99.0))
    assert made.limits.phi_rate_dps == pytest.approx(math.degrees(rate), rel=2e-3)
    assert made.limits.n_z_rate_per_s == 2.0
    chi, gamma = made.stated_reference.sampled(np.array([0.0, made.flight.duration_s]))
    assert np.degrees(chi) == pytest.approx([30.0, 30.0])
    assert np.degrees(gamma) == pytest.approx([3.0, 3.0])
    first, second = made.plant
    assert (first.kind, second.kind) == ("kinematic", "point_mass_lag")
    assert Path(second.identified) == Path("mine.json")
    text = file.read_text()
    assert "# start: as in mine" in text
    assert "# as seen in the logs" in text
    assert "speed_priority" not in text
    assert "phi of mine follows its command at 4 rad/s" in text


def test_a_channel_that_never_moves_shows_no_limits_and_its_model_is_read_again(tmp_path):
    t = 0.1 * np.arange(500)
    still = {"phi": 0.1, "phi_cmd": 0.1, "n_z": 1.0, "V_a": 21.0, "V_g": 20.0, "h": 120.0}
    log = made_up_run({name: np.full(500, x) for name, x in still.items()}, t)

    found = ft.identify(log, assume={"phi": 4.0, "n_z": 5.0})

    for name, limits in (("phi", "-45 to 45, 60 per s"), ("n_z", "0.5 to 1.5, 2 per s")):
        assert found.untold[name].endswith(f"; its limits are assumed: {limits}")
    model = found.save(tmp_path / "mine.json")["model"]
    evidence = ft.loop.load_identified(model).log
    assert evidence.limits_assumed == ("phi", "n_z")
    assert (evidence.phi_deg, evidence.phi_rate_dps) == ((-45.0, 45.0), 60.0)


def test_without_an_assumption_there_is_no_model_and_the_remedy_is_said(tmp_path):
    log = made_up_run({"phi": [0.0, 0.0], "V_a": 20.0})

    found = ft.identify(log)

    assert found.identified is None
    assert found.title == "paper"
    lacks = "the logs have no load-factor commands"
    assert found.untold["n_z"] == f"{lacks}; its limits are assumed: 0.5 to 1.5, 2 per s"
    assert found.missing.startswith("the logs have no roll commands; ")
    assert "assume its bandwidth, --assume phi=RAD_S, or give logs that show it" in found.missing
    assert found.save(tmp_path / "x.json") == {"model": None, "figure": None}
    assert [*tmp_path.iterdir()] == []
    with pytest.raises(ft.InputError, match="`assume` must name phi or n_z, got theta"):
        ft.identify(log, assume={"theta": 3.0})
    with pytest.raises(ft.InputError, match="`V_a` and `gamma` must be absent with a log"):
        ft.identify(log, gamma=[0.0])
