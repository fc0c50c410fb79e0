"""What a monitor expects, against signals whose laws are known, and lags in closed form."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import flighttune as ft
from flighttune.gaps.watch import (
    LAG_S,
    SignalModel,
    Watch,
    columns_of,
    lagged,
    models_of,
    moments,
    residuals,
    score_so_far,
    taught,
)

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
    found = lagged(np.ones(100), 0.02, 0.5, 0.0)

    assert found == pytest.approx(1.0 - np.exp(-0.02 * np.arange(1, 101) / 0.5), abs=1e-12)


def test_flights_teach_the_law_that_they_obey(turning):
    models = models_of(turning().signals)
    assert [model.name for model in models] == ["turn"]

    (learned,) = taught(models, [moments(columns_of(models, turning()))])

    assert learned.weights == pytest.approx((0.0, 9.81, 0.0), abs=1e-6)


def test_of_a_sensor_that_errs_what_it_measures_is_watched(turning):
    run = turning()
    run = replace(run, signals=run.signals.assign(V_a=25.0, V_a_meas=22.0))

    ((*_, airspeed),) = columns_of(models_of({"V_a"}), run)

    assert airspeed == pytest.approx(22.0, rel=ROUNDING)


def test_a_step_that_is_not_expected_alarms_when_its_lag_reaches_the_limit(turning):
    models = models_of(turning().signals)
    models = taught(models, [moments(columns_of(models, turning()))])
    run = turning(np.where(T >= 40.0, 0.2, 0.0))
    watch = Watch(models=models, middle=np.zeros(1), half=np.array([0.15]))

    missing = residuals(models, columns_of(models, run), 1.0 / RATE)[:, 0]
    alarm = watch.alarm(run)

    since = np.maximum(T[: len(missing)] - 40.0 + 1.0 / RATE, 0.0)
    assert missing == pytest.approx(0.2 * (1.0 - np.exp(-since / LAG_S)), abs=1e-6)
    assert alarm is not None
    assert alarm.why == "turn"
    assert alarm.at_s - 40.0 == pytest.approx(LAG_S * math.log(4.0), abs=1.0 / RATE)
    assert watch.alarm(turning()) is None


TURN = SignalModel(name="turn", target="r", terms=("sin_phi/V_g",), weights=(9.81,))
ROLL = SignalModel(name="roll", target="p", terms=("d(phi)",), weights=(1.0,))


def watch_of(*halves):
    return Watch(
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

    score = score_so_far(watches[::order], turning(np.where((T >= 40.0) & (T < 60.0), 0.2, 0.0)))

    assert score[-1] == pytest.approx(0.2 / 0.4, abs=1e-3)


def test_a_residual_less_its_past_forgets_an_offset_and_then_a_step(turning):
    """A step behind the lag, less itself behind the lag of the past, in continuous time."""
    past_s, step, offset, began = 5.0, 0.2, 0.3, 40.0
    models = models_of(turning().signals)
    (model,) = taught(models, [moments(columns_of(models, turning()))])
    run = turning(offset + np.where(T >= began, step, 0.0))

    (missing,) = residuals([replace(model, past_s=past_s)], columns_of(models, run), 1.0 / RATE).T

    since = np.maximum(T[: len(missing)] - began + 1.0 / RATE, 0.0)
    lags = np.exp(-since / past_s) - np.exp(-since / LAG_S)
    assert missing == pytest.approx(step * past_s / (past_s - LAG_S) * lags, abs=step / RATE)
    assert missing[T[: len(missing)] < began] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("mean_s", [0.0, 2.0])
def test_a_model_of_a_loss_counts_only_what_is_less_than_expected(turning, mean_s):
    models = models_of(turning().signals)
    (model,) = taught(models, [moments(columns_of(models, turning()))])
    columns = columns_of(models, turning(np.where(T < 40.0, 0.2, -0.3)))

    both, loss = (
        residuals([replace(model, mean_s=mean_s, loss=loss)], columns, 1.0 / RATE)[:, 0]
        for loss in (False, True)
    )

    assert both.max() == pytest.approx(0.2, abs=1e-3)
    assert loss == pytest.approx(np.minimum(both, 0.0), abs=1e-12)
    assert loss.min() == pytest.approx(-0.3, abs=1e-3)
