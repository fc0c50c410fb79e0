"""What a monitor expects, against signals whose laws are known, and lags in closed form."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_up import made_up_run

import flighttune as ft
from flighttune.gaps import watch as watching

RATE, SECONDS = 25.0, 80.0
T = np.arange(round(RATE * SECONDS)) / RATE
ROUNDING = 1e-9


@pytest.fixture
def turning(tmp_path):
    """A log of coordinated turns at a speed that changes: r = 9.81 sin(phi) / V_g + `extra`."""

    def run(extra=0.0):
        phi, V_g = 0.5 * np.sin(0.7 * T), 20.0 + 2.0 * np.cos(0.3 * T)
        r = 9.81 * np.sin(phi) / V_g + extra
        p = 0.35 * np.cos(0.7 * T)
        table = {"t_s": T, "phi_rad": phi, "p": p, "r": r, "v_north": V_g, "v_east": 0.0 * T}
        pd.DataFrame(table).to_csv(tmp_path / "turns.csv", index=False)
        return ft.load_log(tmp_path / "turns.csv")

    return run


def test_a_lag_answers_a_step_as_its_exponential():
    found = watching.lagged(np.ones(100), 0.02, 0.5, 0.0)

    assert found == pytest.approx(1.0 - np.exp(-0.02 * np.arange(1, 101) / 0.5), abs=1e-12)


def test_flights_teach_the_law_that_they_obey(turning):
    models = watching.models_of(turning().signals)
    assert [model.name for model in models] == ["turn"]

    (learned,) = watching.taught(models, [watching.moments(watching.columns_of(models, turning()))])

    assert learned.weights == pytest.approx((0.0, 9.81, 0.0), abs=1e-6)


def test_of_a_sensor_that_errs_what_it_measures_is_watched(turning):
    run = turning()
    run = replace(run, signals=run.signals.assign(V_a=25.0, V_a_meas=22.0))

    ((*_, airspeed),) = watching.columns_of(watching.models_of({"V_a"}), run)

    assert airspeed == pytest.approx(22.0, rel=ROUNDING)


@pytest.mark.slow
def test_a_step_that_is_not_expected_alarms_when_its_lag_reaches_the_limit(turning):
    models = watching.models_of(turning().signals)
    models = watching.taught(models, [watching.moments(watching.columns_of(models, turning()))])
    run = turning(np.where(T >= 40.0, 0.2, 0.0))
    watch = watching.Watch(models=models, middle=np.zeros(1), half=np.array([0.15]))

    missing = watching.residuals(models, watching.columns_of(models, run), 1.0 / RATE)[:, 0]
    alarm = watch.alarm(run)

    since = np.maximum(T[: len(missing)] - 40.0 + 1.0 / RATE, 0.0)
    assert missing == pytest.approx(0.2 * (1.0 - np.exp(-since / watching.LAG_S)), abs=1e-6)
    assert alarm is not None
    assert alarm.why == "turn"
    assert alarm.at_s - 40.0 == pytest.approx(watching.LAG_S * math.log(4.0), abs=1.0 / RATE)
    assert watch.alarm(turning()) is None


TURN = watching.SignalModel(name="turn", target="r", terms=("sin_phi/V_g",), weights=(9.81,))
ROLL = watching.SignalModel(name="roll", target="p", terms=("d(phi)",), weights=(1.0,))


def watch_of(*halves):
    return watching.Watch(
        models=tuple(x for x, _ in halves),
        middle=np.zeros(2),
        half=np.array([half for _, half in halves]),
    )


@pytest.mark.parametrize("order", [1, -1])
def test_an_alarm_names_the_signal_that_is_not_as_expected_wherever_it_stands(turning, order):
    watch = watch_of(*[(TURN, 0.15), (ROLL, 1.0)][::order])

    alarm = watch.alarm(turning(np.where(T >= 40.0, 0.2, 0.0)))

    assert alarm is not None
    assert alarm.why == "turn"


@pytest.mark.parametrize("order", [1, -1])
def test_a_score_is_the_largest_so_far_by_the_watch_for_which_it_is_least(turning, order):
    watches = [watch_of((TURN, half), (ROLL, 1.0)) for half in (0.1, 0.4)]

    score = watching.score_so_far(
        watches[::order], turning(np.where((T >= 40.0) & (T < 60.0), 0.2, 0.0))
    )

    assert score[-1] == pytest.approx(0.2 / 0.4, abs=1e-3)


@pytest.mark.slow
def test_a_residual_less_its_past_forgets_an_offset_and_then_a_step(turning):
    """A step behind the lag, less itself behind the lag of the past, in continuous time."""
    past_s, step, offset, began = 5.0, 0.2, 0.3, 40.0
    models = watching.models_of(turning().signals)
    (model,) = watching.taught(models, [watching.moments(watching.columns_of(models, turning()))])
    run = turning(offset + np.where(T >= began, step, 0.0))

    (missing,) = watching.residuals(
        [replace(model, past_s=past_s)], watching.columns_of(models, run), 1.0 / RATE
    ).T

    since = np.maximum(T[: len(missing)] - began + 1.0 / RATE, 0.0)
    lags = np.exp(-since / past_s) - np.exp(-since / watching.LAG_S)
    assert missing == pytest.approx(
        step * past_s / (past_s - watching.LAG_S) * lags, abs=step / RATE
    )
    assert missing[T[: len(missing)] < began] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("mean_s", [0.0, 2.0])
def test_a_model_of_a_loss_counts_only_what_is_less_than_expected(turning, mean_s):
    models = watching.models_of(turning().signals)
    (model,) = watching.taught(models, [watching.moments(watching.columns_of(models, turning()))])
    columns = watching.columns_of(models, turning(np.where(T < 40.0, 0.2, -0.3)))

    both, loss = (
        watching.residuals([replace(model, mean_s=mean_s, loss=loss)], columns, 1.0 / RATE)[:, 0]
        for loss in (False, True)
    )

    assert both.max() == pytest.approx(0.2, abs=1e-3)
    assert loss == pytest.approx(np.minimum(both, 0.0), abs=1e-12)
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
def test_a_term_is_the_product_of_its_quantities(term, value):
    model = watching.SignalModel(name="some", target=term, terms=(term,))
    ((column, target),) = watching.columns_of(
        [model], made_up_run({k: [x] * 9 for k, x in STILL.items()}, T[:9])
    )

    assert column == pytest.approx(np.full(9, value), abs=1e-12)
    assert target.tolist() == column.tolist()


def test_a_rate_of_a_ramp_is_its_slope_behind_the_lag():
    run = made_up_run({"V_a": 20.0 + 0.8 * T, "V_g": 2.0 + 0.0 * T}, T)
    model = watching.SignalModel(name="some", target="d(V_a)*V_g", terms=("d(V_a)/V_g",))

    ((over, times),) = watching.columns_of([model], run, from_s=6.0)

    # of a ramp that is sampled the lag is longer by a part of a sample
    assert over == pytest.approx(np.full(len(T) - round(6.0 * RATE), 0.4), rel=0.05)
    assert times == pytest.approx(4.0 * over)


def test_a_term_of_a_gap_keeps_the_value_before_and_the_first_the_one_after():
    V_a = np.where((T > 40.0) & (T < 44.0), np.nan, np.where(T < 42.0, 20.0, 30.0))
    V_a[:5] = np.nan
    model = watching.SignalModel(name="some", target="V_a", terms=("1",))

    ((_, target),) = watching.columns_of([model], made_up_run({"V_a": V_a}, T))

    assert target[0] == 20.0
    assert target[T == 43.0] == pytest.approx(20.0)
    assert target[-1] == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("columns", "from_s", "says"),
    [
        ({"V_a": np.zeros(9)}, 0.0, "V_a must be finite"),
        ({"V_a": np.ones(9)}, 0.32, "must be over 0.32 s long, got 0.3 s"),
    ],
)
def test_what_cannot_be_watched_is_refused(columns, from_s, says):
    model = watching.SignalModel(name="some", target="1/V_a", terms=("1",))
    with pytest.raises(ft.InputError, match=says):
        watching.columns_of([model], made_up_run(columns, T[:9]), from_s)


def test_of_models_of_one_name_the_first_with_all_its_signals_counts():
    first, second = (
        watching.SignalModel(name="turn", target="r", terms=(x,)) for x in ("V_a", "V_g")
    )
    other = watching.SignalModel(name="roll", target="p", terms=("1",))
    models = [first, other, second]

    for signals, expected in (
        ("r V_a V_g p", {first, other}), ("r V_g p", {second, other}), ("r p", {other}),
    ):  # fmt: skip
        assert {*watching.models_of(set(signals.split()), models)} == expected


def test_an_alarm_of_a_later_start_has_the_time_of_the_run():
    watch = watching.Watch(
        models=(TURN, ROLL), middle=np.array([0.0, 0.1]), half=np.array([0.2, 0.3])
    )
    p = 0.1 + 1.0 * (T >= 50.0)
    signals = {"r": 0.0 * T, "phi": 0.0 * T, "V_g": 20.0 + 0.0 * T, "p": p}
    late = replace(watch, from_s=30.0)

    for each in (watch, late):
        alarm = each.alarm(made_up_run(signals, T))
        assert alarm.why == "roll"
        # 0.3 over the middle of a step of 1 behind a lag
        assert alarm.at_s - 50.0 == pytest.approx(
            watching.LAG_S * math.log(1.0 / 0.7), abs=1.0 / RATE
        )
    assert late.scores(made_up_run(signals, T))[0] == pytest.approx([0.0, 0.0], abs=1e-12)
