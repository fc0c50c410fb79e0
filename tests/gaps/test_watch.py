"""What a monitor of logs expects, against signals whose laws are known, and lags in closed form."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_up import made_up_run

import flighttune as ft

RATE, SECONDS = 25.0, 80.0
T = np.arange(round(RATE * SECONDS)) / RATE
LAG_S = 0.5
"""Of all terms, s."""


def turning(folder, shift=0.0):
    """A log of turns of r = 0.5 sin(phi) + 0.1 p, each of other phases."""
    phi, p = 0.5 * np.sin(0.7 * T + shift), 0.35 * np.cos(0.7 * T + shift)
    r = 0.5 * np.sin(phi) + 0.1 * p
    table = {"t_s": T, "phi_rad": phi, "p": p, "r": r, "v_north": 20.0, "v_east": 0.0 * T}
    file = folder / f"turns-{shift:g}.csv"
    pd.DataFrame(table).to_csv(file, index=False)
    return ft.load_log(file)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    return [turning(folder, shift) for shift in (0.0, 1.0, 2.0)]


@pytest.fixture(scope="module")
def watch(logs):
    """What a monitor of these logs watches, to be changed."""
    return ft.monitor(*logs).watches[0]


def of_models(watch, *models, half=None, **options):
    """The watch with other models, each the changes of its own, and these limits."""
    (turn,) = watch.models
    models = tuple(replace(turn, **model) for model in models)
    half = np.ones(len(models)) if half is None else np.array(half)
    return replace(watch, models=models, middle=np.zeros(len(models)), half=half, **options)


def missing(watch, run, from_s=0.0, **model):
    """The residual of one model with its sign, which a score has lost."""
    model = {"terms": ("1",), "weights": (0.0,)} | model
    low = of_models(watch, model, from_s=from_s)
    return replace(low, middle=np.array([-1e3])).scores(run)[:, 0] - 1e3


def stepping(run, at_s, size, name="r"):
    """The run with a step of a signal."""
    extra = np.where(run.t > at_s - 0.5 / RATE, size, 0.0)
    return replace(run, signals=run.signals.assign(**{name: run.signals[name] + extra}))


def behind(run, at_s, lag=LAG_S):
    """What is left of a step behind a lag that is sampled."""
    return np.exp(-np.maximum(run.t - at_s + 1.0 / RATE, 0.0) / lag)


def test_logs_teach_the_law_that_they_obey_and_their_largest_residual(logs):
    odd = replace(logs[2], signals=logs[2].signals.assign(r=logs[2].signals["r"] + 0.3))
    learned = ft.monitor(*logs[:2], stepping(odd, 40.0, 0.2))

    models = learned.logs[2].models
    assert [(model.name, model.target) for model in models] == [("turn", "r")]
    assert models[0].weights == pytest.approx((0.0, 0.5, 0.1), abs=1e-6)
    assert learned.logs[2].peaks == pytest.approx(np.array([[0.0], [0.0], [0.5]]), abs=1e-6)
    assert learned.logs[2].why == "turn"
    # the others are taught by one that is off by 0.3 and, from 40 s on, by 0.5
    assert learned.logs[0].peaks[0][0] > 0.15
    for i, log in enumerate(learned.logs):
        others = [peak for j, (peak,) in enumerate(log.peaks) if j != i]
        assert log.limits[0] == pytest.approx(max(*others, 1e-12))
        assert log.score == pytest.approx(log.peaks[i][0] / log.limits[0])


def test_the_models_of_logs_are_those_whose_signals_there_are(logs):
    signals = {"V_a": 20.0 + np.sin(T), "f_y": np.cos(T), "phi_cmd": np.sin(2.0 * T)}
    known = {"turn": "r", "airspeed": "V_a", "side force": "f_y", "roll": "p", "speed change": "d"}

    def models(*names):
        made = [
            replace(run, signals=run.signals.assign(**{x: signals[x] * (2.0 + i) for x in names}))
            for i, run in enumerate(logs)
        ]
        return {model.name: model.target for model in ft.monitor(*made).watches[0].models}

    assert models() == {"turn": "r"}
    for names, expected in (
        (["f_y"], {"turn", "side force"}), (["phi_cmd"], {"turn", "roll"}),
        (["V_a"], {"turn", "airspeed", "speed change"}),
    ):  # fmt: skip
        found = models(*names)
        assert found.keys() == expected
        assert all(target.startswith(known[name]) for name, target in found.items())
    signals["V_err"] = np.sin(0.3 * T)
    assert models("V_a", "V_err")["airspeed"] == "V_err"  # the first of a name


def test_the_score_of_a_run_is_the_largest_so_far_by_the_watch_for_which_it_is_least(logs):
    noisy = [
        stepping(stepping(run, 30.0, 0.01 * (i + 1)), 31.0, -0.01 * (i + 1))
        for i, run in enumerate(logs)
    ]
    learned = ft.monitor(*noisy)
    run = stepping(stepping(logs[0], 40.0, 0.2), 60.0, -0.2)

    score = learned.on(run).signals["alarm_score"]

    first = round(8.0 * RATE)
    assert not score[:first].any()
    each = [x.scores(run).max(axis=1) for x in learned.watches]
    assert score[first:] == pytest.approx(np.min(np.maximum.accumulate(each, axis=1), axis=0))
    assert len({x.max().round(6) for x in each}) == 3
    assert learned.alarm(run).why == "turn"
    assert 40.0 < learned.alarm(run).at_s < 40.2
    for one, log in zip(learned.watches, learned.logs, strict=True):
        assert one.half == pytest.approx(max(x.score for x in learned.logs) * log.limits[0])
        assert one.from_s == 8.0


def test_a_step_that_is_not_expected_alarms_when_its_lag_reaches_the_limit(logs, watch):
    run = stepping(logs[0], 40.0, 0.2)
    own = {"weights": (0.0, 0.5, 0.1)}
    at = of_models(watch, own, half=[0.15], from_s=0.0)

    assert at.scores(run)[:, 0] == pytest.approx(0.2 / 0.15 * (1 - behind(run, 40.0)), abs=1e-6)
    for from_s in (0.0, 30.0):
        alarm = replace(at, from_s=from_s).alarm(run)
        assert alarm.why == "turn"
        assert alarm.at_s - 40.0 == pytest.approx(LAG_S * math.log(4.0), abs=1.0 / RATE)
    assert at.alarm(logs[0]) is None
    assert replace(at, half=np.array([0.2 + 1e-6])).alarm(run) is None


@pytest.mark.parametrize("order", [1, -1])
def test_an_alarm_names_the_signal_that_is_not_as_expected_wherever_it_stands(logs, watch, order):
    turn = {"weights": (0.0, 0.5, 0.1)}
    roll = {"name": "roll", "target": "p", "terms": ("d(phi)",), "weights": (1.0,)}
    halves, models = zip(*[(0.15, turn), (1.0, roll)][::order], strict=True)

    assert of_models(watch, *models, half=halves).alarm(stepping(logs[0], 40.0, 0.2)).why == "turn"


def test_a_residual_less_its_past_forgets_an_offset_and_then_a_step(logs, watch):
    """A step behind the lag, less itself behind the lag of the past, in continuous time."""
    past_s, step, began = 5.0, 0.2, 40.0
    run = stepping(stepping(logs[0], 0.0, 0.3), began, step)
    model = {"terms": watch.models[0].terms, "weights": (0.0, 0.5, 0.1), "target": "r"}

    found = missing(watch, run, **model, past_s=past_s)

    lags = behind(run, began, past_s) - behind(run, began)
    assert found == pytest.approx(step * past_s / (past_s - LAG_S) * lags, abs=step / RATE)
    assert found[run.t < began - 0.5 / RATE] == pytest.approx(0.0, abs=1e-6)
    # behind a lag of its own, from 0 on
    slow = missing(watch, stepping(logs[0], 0.0, 0.3), **model, mean_s=4.0)
    assert slow == pytest.approx(0.3 * (1.0 - behind(run, 0.0, 4.0)), abs=1e-6)


@pytest.mark.parametrize("mean_s", [0.0, 2.0])
def test_a_model_of_a_loss_counts_only_what_is_less_than_expected(watch, mean_s):
    run = made_up_run({"V_a": np.where(T < 40.0, 0.2, -0.3)}, T)

    both, loss = (missing(watch, run, target="V_a", mean_s=mean_s, loss=x) for x in (False, True))

    assert both.max() == pytest.approx(0.2, abs=1e-3)
    assert loss == pytest.approx(np.minimum(both, 0.0), abs=1e-9)
    assert loss.min() == pytest.approx(-0.3, abs=1e-3)


STILL = {
    "phi": 0.4, "gamma": 0.1, "theta": 0.25, "n_z": 1.3, "V_a": 22.0, "V_g": 25.0, "V_err": 1.2,
    "phi_cmd": 0.7, "theta_cmd": 0.15, "f_x": 2.5, "throttle": 0.6, "q": 0.05,
}  # fmt: skip
SLOW = 0.5 * (1.0 + math.tanh(1.2 / 1.5))


@pytest.mark.parametrize(
    ("term", "value"),
    [
        ("1", 1.0),
        ("V_a", 22.0),
        ("cos_phi", math.cos(0.4)),
        ("sin_phi/V_a", math.sin(0.4) / 22.0),
        ("to_roll", 0.3),
        ("to_pitch", -0.1),
        ("n_z/V_a/V_a", 1.3 / 22.0**2),
        ("V_g*sin_gamma/V_a", 25.0 * math.sin(0.1) / 22.0),
        ("slow*sin_gamma", SLOW * math.sin(0.1)),
        # thrust less drag over weight, without what lift has along the path
        ("slow*excess", SLOW * (2.5 / 9.80665 - 1.3 * (math.sin(0.25) - math.sin(0.1)))),
        ("q/V_a", 0.05 / 22.0),
        ("d(V_a)", 0.0),
    ],
)
def test_a_term_is_the_product_of_its_quantities(watch, term, value):
    run = made_up_run({name: [x] * 9 for name, x in STILL.items()}, T[:9])

    assert missing(watch, run, target=term) == pytest.approx(value, abs=1e-9)
    # and what is missing is a target without its terms
    less = missing(watch, run, target="V_a", terms=(term, "1"), weights=(2.0, 3.0))
    assert less == pytest.approx(22.0 - 2.0 * value - 3.0, abs=1e-9)


def test_of_a_sensor_that_errs_what_it_measures_is_watched(watch):
    run = made_up_run({"V_a": [25.0] * 9, "V_a_meas": [22.0] * 9}, T[:9])

    assert missing(watch, run, target="V_a") == pytest.approx(22.0)


def test_a_rate_of_a_ramp_is_its_slope_behind_the_lag(watch):
    run = made_up_run({"V_a": 20.0 + 0.8 * T, "V_g": 2.0 + 0.0 * T}, T)

    for target, slope in (("d(V_a)/V_g", 0.4), ("d(V_a)*V_g", 1.6), ("V_g*d(V_a)", 1.6)):
        found = missing(watch, run, 6.0, target=target)
        # of a ramp that is sampled the lag is longer by a part of a sample
        assert found == pytest.approx(np.full(len(T) - round(6.0 * RATE), slope), rel=0.05)


def test_a_term_of_a_gap_keeps_the_value_before_and_the_first_the_one_after(watch):
    V_a = np.where((T > 40.0) & (T < 44.0), np.nan, np.where(T < 42.0, 20.0, 30.0))
    V_a[:5] = np.nan

    found = missing(watch, made_up_run({"V_a": V_a}, T), target="V_a")

    assert found[[0, -1]] == pytest.approx([20.0, 30.0])
    assert found[T == 43.0] == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("columns", "from_s", "says"),
    [
        ({"V_a": np.zeros(9)}, 0.0, "V_a must be finite"),
        ({"V_a": np.ones(9)}, 0.32, "must be over 0.32 s long, got 0.3 s"),
        ({"V_g": np.ones(9)}, 0.0, "must have V_a to be watched"),
    ],
)
def test_what_cannot_be_watched_is_refused(watch, columns, from_s, says):
    with pytest.raises(ft.InputError, match=says):
        missing(watch, made_up_run(columns, T[:9]), from_s, target="1/V_a")
