"""Identification of plants whose lag is known, and of the Aerosonde on flights it has not seen."""

import json
import math
import re
from functools import partial
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from places import SHIPPED_AIRCRAFT
from scipy import signal

import flighttune as ft
from flighttune.vehicles.identification import file, fit

LIMITS = ft.loop.Limits(
    lower=np.array([-0.8, -2.0]),
    upper=np.array([0.8, 2.2]),
    rate_lower=np.array([-0.5, -1.0]),
    rate_upper=np.array([0.5, 1.0]),
)
LEVEL = ft.loop.FlightCondition(V_a=25.0)

FINE = 1e-3
"""Step of the synthetic plants, s; their delays are whole numbers of it."""

RECOVERED = 0.02
"""Relative error of a recovered frequency, damping or time constant."""

DELAY_RECOVERED = 1e-3
"""s: one step of the synthetic plant."""

GOOD_FIT = 90.0
"""Share of the variance, in percent, asked of a flight that was not used."""

EXACT = 1e-9

INTERPOLATED = 2e-4
"""Of the hold of commands, which is curved between lines."""

SAME_FIT, SAME_DELAY = 1e-3, 1e-4
"""Differences between two identifications of one aircraft, relative and in s."""


class SyntheticPlant:
    """Channels that follow transfer functions, stepped by SciPy's zero-order hold."""

    kind = "synthetic"
    signals = ft.loop.COMMON_SIGNALS

    def __init__(self, *channels, cross=0.0, largest=math.inf):
        self._given, self._cross, self._largest = channels, cross, largest

    def start(self, condition):
        self._channels = [
            [*signal.cont2discrete(signal.tf2ss(num, den), FINE)[:3], np.zeros((len(den) - 1, 1)),
             [0.0] * (1 + round(delay / FINE))]
            for num, den, delay in self._given
        ]  # fmt: skip

    def observe(self):
        phi, n_z = (float((C @ x)[0, 0]) for _, _, C, x, _ in self._channels)
        return (0.0, 0.0, phi, 1.0 + n_z + self._cross * phi, 25.0, 0.0, 0.0, 0.0)

    def advance(self, phi_cmd, n_z_cmd, duration):
        if abs(phi_cmd) > self._largest:
            return ft.loop.Stop("left_envelope", f"rolled to {phi_cmd:.3f} rad")
        for channel, command in zip(self._channels, (phi_cmd, n_z_cmd - 1.0), strict=True):
            A, B, _, x, pending = channel
            for _ in range(round(duration / FINE)):
                pending.append(command)
                pending.pop(0)
                x = A @ x + B * pending[0]
            channel[3] = x
        return None


def transfer(lag):
    """Numerator, denominator and delay (s) of a lag."""
    w = lag.natural_frequency
    if lag.order == 1:
        return [w], [1.0, w], lag.delay
    pair = [1.0, 2.0 * lag.damping * w, w * w]
    return [w * w], pair if lag.order == 2 else np.polymul([lag.lag, 1.0], pair), lag.delay


FIRST = ft.loop.InnerLag(order=1, natural_frequency=4.0, delay=0.05)
SECOND = ft.loop.InnerLag(order=2, natural_frequency=8.0, damping=0.6, delay=0.12)
THIRD = ft.loop.InnerLag(order=3, natural_frequency=9.0, damping=0.5, lag=0.3, delay=0.02)


@pytest.mark.soak
@pytest.mark.parametrize("lags", [(FIRST, SECOND), (THIRD, SECOND)], ids=["low", "third order"])
def test_lags_of_every_order_are_recovered(lags):
    plant = partial(SyntheticPlant, *map(transfer, lags))

    condition = fit.identify_plant(plant, LEVEL, LIMITS).condition

    for found, true in zip(condition.lags, lags, strict=True):
        assert found.order == true.order
        for name in ("natural_frequency", "damping", "lag", "bandwidth"):
            assert getattr(found, name) == pytest.approx(getattr(true, name), rel=RECOVERED)
        assert found.delay == pytest.approx(true.delay, abs=DELAY_RECOVERED)
    # The manoeuvre that was not used for the fit is explained.
    assert min(channel.fit_percent for channel in condition.channels.values()) > 99.9


def test_responses_are_those_of_the_channels_without_the_hold_of_commands():
    """Each command moves at the lines of the other channel too, and roll acts on load factor.

    A gain and a delay are interpolated between lines without an error. Below its first line, a
    channel has none to interpolate.
    """
    lines = fit.multisines(LIMITS)[1]
    omega = np.fft.rfftfreq(fit.SAMPLES, fit.DT / math.tau)
    commanded = np.zeros((len(omega), 2), complex)
    for i, line in enumerate(lines):
        commanded[line, i] = np.exp(1j * line**2)
        commanded[line, 1 - i] = (0.5, 0.0)[i] * np.exp(0.7j * line)
    roll, lift = (gain * np.exp(-1j * omega * delay) for gain, delay in ((0.8, 0.03), (1.2, 0.06)))
    coupling = 0.25 * np.exp(-0.1j * omega)
    # The step of a held command less the step that ends it, over a sample.
    hold = np.ones_like(coupling)
    hold[1:] = (1.0 - np.exp(-1j * omega[1:] * fit.DT)) / (1j * omega[1:] * fit.DT)
    measured = np.column_stack([roll, lift]) * commanded
    measured[:, 1] += coupling * commanded[:, 0]
    before = np.ones((500, 2))  # which does not count
    experiment = tuple(
        np.vstack([before, np.fft.irfft(x, axis=0)]) for x in (commanded, measured * hold[:, None])
    )

    first, second = fit.frequency_responses(experiment, lines)
    (alone,) = fit.frequency_responses(tuple(x[:, :1] for x in experiment), lines[:1])

    assert first.omega == pytest.approx(omega[lines[0]])
    assert second.omega == pytest.approx(omega[lines[1]])
    assert first.own == pytest.approx(roll[lines[0]])
    assert second.own == pytest.approx(lift[lines[1]])
    assert first.other[1:] == pytest.approx(coupling[lines[0]][1:], abs=INTERPOLATED)
    assert second.other == pytest.approx(np.zeros(len(lines[1])), abs=EXACT)
    assert alone.own == pytest.approx(first.own)
    assert alone.other is None


@pytest.mark.parametrize("true", [FIRST, SECOND, THIRD], ids=["first", "second", "third"])
def test_of_lags_fitted_to_a_response_the_best_is_that_which_made_it(true):
    """Real and imaginary parts have an error of 0.002, which alternates."""
    omega = np.geomspace(*fit.BAND, 15)
    error = 0.002 * (-1.0) ** np.arange(15) * (1.0 + 1.0j)
    response = fit.FrequencyResponse(omega, true.response(omega) + error)

    found = fit.candidates(response)

    best = found[0]
    assert best.lag.order == true.order
    for name in ("natural_frequency", "damping", "lag"):
        assert getattr(best.lag, name) == pytest.approx(getattr(true, name), rel=RECOVERED)
    assert best.lag.delay == pytest.approx(true.delay, abs=3.0 * DELAY_RECOVERED)
    assert sorted(each.lag.order for each in found) == [1, 2, 3]
    for each in found:
        apart = np.abs(each.lag.response(omega) - response.own)
        assert each.residual == pytest.approx(np.sqrt(np.mean(apart**2)))
    assert [each.bic for each in found] == sorted(each.bic for each in found)
    # by Schwarz, of 30 numbers, where one parameter more is worth its logarithm
    one, two, three = sorted(found, key=lambda each: each.lag.order)
    for low, high in ((one, two), (two, three)):
        gained = 60.0 * math.log(low.residual / high.residual)
        assert low.bic - high.bic == pytest.approx(gained - math.log(30.0))


def test_no_order_is_gained_below_the_finest_distance_and_a_lag_beyond_the_band_is_found():
    """The distance is 0.001 in each of 30 numbers; the lag responds to the whole band."""
    omega = np.geomspace(*fit.BAND, 15)
    true = ft.loop.InnerLag(order=1, natural_frequency=60.0, delay=0.02)

    found = fit.candidates(fit.FrequencyResponse(omega, true.response(omega)))

    assert [each.lag.order for each in found] == [1, 2, 3]
    assert found[0].lag.natural_frequency == pytest.approx(60.0, rel=RECOVERED)
    expected = [30.0 * math.log(1e-6) + (order + 1) * math.log(30.0) for order in (1, 2, 3)]
    assert [each.bic for each in found] == pytest.approx(expected)


def test_the_same_seed_gives_the_same_excitation_and_another_one_another():
    one, same, other = (fit.multisines(LIMITS, seed=seed)[0] for seed in (1, 1, 2))

    assert np.array_equal(one, same)
    assert not np.allclose(one, other)


@pytest.mark.parametrize("changes", [fit.multisines(LIMITS)[0], fit.check_manoeuvre(LIMITS)])
def test_excitations_stay_inside_the_limits(changes):
    commands = changes + np.array([0.0, 1.0])
    rates = np.diff(commands, axis=0) / fit.DT

    assert (commands > LIMITS.lower).all()
    assert (commands < LIMITS.upper).all()
    assert (rates > LIMITS.rate_lower).all()
    assert (rates < LIMITS.rate_upper).all()


def test_an_aircraft_that_takes_no_excitation_says_why():
    plant = partial(SyntheticPlant, transfer(FIRST), transfer(SECOND), largest=1e-6)

    with pytest.raises(ft.loop.PlantError, match=r"0\.125 .*rolled to"):
        fit.respond(plant, LEVEL, fit.check_manoeuvre(LIMITS))


@pytest.mark.parametrize("lag", [FIRST, THIRD], ids=["first order", "third order"])
def test_prediction_in_time_is_what_scipy_simulates(lag):
    t = np.arange(0.0, 8.0, fit.DT)
    command = np.sin(0.7 * t) + (t > 2.0)
    num, den, delay = transfer(lag)
    fine = np.arange(0.0, 8.0, FINE)
    held = command[np.clip(np.floor((fine - delay) / fit.DT + 1e-6).astype(int), 0, None)]
    A, B, C, D, _ = signal.cont2discrete(signal.tf2ss(num, den), FINE)
    _, flown, _ = signal.dlsim((A, B, C, D, FINE), held)

    every = round(fit.DT / FINE)
    assert fit.lag_response(lag, fit.DT, command, 0.0) == pytest.approx(
        flown[::every, 0], abs=EXACT
    )


@pytest.mark.soak
@pytest.mark.parametrize("name", ["paper", "level_turn"])
def test_aerosonde_is_explained_on_a_whole_scenario(name):
    (run,) = (
        r for r in ft.fly(ft.load_scenario(name)).runs if r.label == "jsbsim:aerosonde / paper"
    )
    signals = run.signals
    dt = signals.index[1]
    lags = ft.loop.load_identified("aerosonde").conditions[0].lags
    for channel, lag in zip(("phi", "n_z"), lags, strict=True):
        command, flown = signals[f"{channel}_cmd"].to_numpy(), signals[channel].to_numpy()
        model = flown[0] + fit.lag_response(lag, dt, command - command[0], 0.0)
        assert fit.fit_percent(flown, model) > GOOD_FIT


@pytest.mark.counts
@pytest.mark.parametrize("aircraft", ["aerosonde", "c172p", "a4", "x8"])
def test_identifying_again_gives_the_shipped_model(aircraft):
    shipped = ft.loop.load_identified(aircraft).conditions[0]

    again = ft.identify(aircraft).identified.conditions[0]

    assert again.V_a == shipped.V_a
    for channel in ("phi", "n_z", "n_x"):
        one, other = shipped.channels[channel], again.channels[channel]
        assert one.lag.order == other.lag.order
        for value in ("natural_frequency", "damping", "lag"):
            assert getattr(one.lag, value) == pytest.approx(getattr(other.lag, value), rel=SAME_FIT)
        assert one.lag.delay == pytest.approx(other.lag.delay, abs=SAME_DELAY)
        assert other.fit_percent > GOOD_FIT


def test_the_file_holds_the_linear_model_with_names(tmp_path):
    path = tmp_path / "model.json"
    ft.loop.load_identified("aerosonde").save(path)

    table = json.loads(path.read_text())["conditions"][0]

    model, channels = table["model"], table["channels"]
    A, B, C = (np.array(model[name]) for name in "ABC")
    s = 2.0j
    response = C @ np.linalg.solve(s * np.eye(len(A)) - A, B)
    roll = channels["phi"]
    w, z, h = roll["natural_frequency_rad_s"], roll["damping"], roll["delay_s"]
    pade = (1.0 - s * h / 2.0) / (1.0 + s * h / 2.0)
    lag = pade * w**2 / (s**2 + 2.0 * z * w * s + w**2) / (1.0 + s * roll["lag_s"])
    expected = -(9.80665 / 25.0) / s * lag
    assert roll["order"] == 3
    assert model["inputs"] == ["phi_cmd", "n_z_cmd"]
    assert response[0, 0] == pytest.approx(expected, rel=1e-4)
    assert roll["bandwidth_rad_s"] == pytest.approx(13.1, abs=0.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t["conditions"][0]["channels"]["phi"].update(delay_s=-1.0), r"phi\.delay_s`"),
        (
            lambda t: t["conditions"][1]["model"]["A"][0].__setitem__(0, "<b>"),
            r"`conditions\[1\]\.model\.A\[0\]\[0\]` must be 0\.0, as the lags .*, got '<b>'",
        ),
        (
            lambda t: t["conditions"][0]["channels"]["n_z"].update(bandwidth_rad_s=99.0),
            r"channels\.n_z\.bandwidth_rad_s` must be .*, got 99\.0",
        ),
    ],
)
def test_a_file_that_holds_something_else_is_refused_by_name(tmp_path, change, message):
    table = json.loads((SHIPPED_AIRCRAFT / "aerosonde" / "identified.json").read_text())
    change(table)
    path = tmp_path / "wrong.json"
    path.write_text(json.dumps(table))

    with pytest.raises(ft.ScenarioError, match=rf"wrong\.json: .*{message}"):
        ft.loop.load_identified(path)


def test_the_table_of_the_page_is_what_the_shipped_files_say():
    page = (Path(__file__).parents[3] / "docs/identification.md").read_text(encoding="utf-8")
    cell = r" *(\S+) *"
    told = re.findall(
        rf"^\|(?: (\w+), (\d+) m/s)? \| (roll|load factor) \|{cell}\|{cell}\|{cell}\|{cell}\|$",
        page, re.MULTILINE,
    )  # fmt: skip
    assert [row[0] for row in told] == ["aerosonde", "", "c172p", "", "a4", ""]

    shipped = []
    for name, V_a, *_ in told[::2]:
        found = json.loads((SHIPPED_AIRCRAFT / name / "identified.json").read_text())
        at = next(
            one for one in found["conditions"]
            if (one["V_a_mps"], one["gamma_deg"]) == (float(V_a), 0.0)
        )  # fmt: skip
        for channel in ("phi", "n_z"):
            lag = at["channels"][channel]
            digits = ("order", 0), ("bandwidth_rad_s", 1), ("delay_s", 3), ("fit_percent", 1)
            shipped.append([f"{lag[key]:.{places}f}" for key, places in digits])
    assert [list(row[3:]) for row in told] == shipped


def test_the_nearest_condition_is_on_the_side_of_the_path_angle_that_is_asked():
    model = ft.loop.load_identified("aerosonde")
    (first, *_) = model.conditions
    sides = tuple(first.model_copy(update={"gamma": gamma}) for gamma in (-0.1, 0.1))
    for conditions in (sides, sides[::-1]):
        both = model.model_copy(update={"conditions": conditions})
        assert [both.nearest(25.0, x).gamma for x in (-0.3, -0.02, 0.02, 0.3)] == [
            *(-0.1, -0.1, 0.1, 0.1)
        ]


def test_the_table_of_a_lag_has_the_numbers_of_its_order():
    lags = {
        1: ft.loop.InnerLag(order=1, natural_frequency=6.0, delay=0.047),
        2: ft.loop.InnerLag(order=2, natural_frequency=12.0, damping=0.6, delay=0.033),
        3: ft.loop.InnerLag(order=3, natural_frequency=9.0, damping=0.7, lag=0.05, delay=0.011),
    }

    tables = {order: file.lag_table(lag) for order, lag in lags.items()}

    assert [tables[order]["damping"] for order in lags] == [None, 0.6, 0.7]
    assert [tables[order]["lag_s"] for order in lags] == [None, None, 0.05]
    assert [tables[order]["delay_s"] for order in lags] == [0.047, 0.033, 0.011]


def test_contradictions_of_a_file_name_their_key_and_both_values():
    """Numbers are equal to within one part in ten thousand."""
    derived = {"a": [1.0, {"b": 2.0}], "c": "x", "d": 3}

    def said(**stated):
        return [*file._contradictions(derived | stated, derived)]

    assert said() == []
    assert said(a=[1.00009, {"b": 2}]) == []
    assert said(a=[1.0, {"b": 2.0005}]) == [
        "`a[1].b` must be 2.0, as the lags of the file make it, got 2.0005"
    ]
    assert [x.partition(" must")[0] for x in said(a=[1.0], c="y", d=4)] == ["`a`", "`c`", "`d`"]
    assert said(e=1) == ["`e` is not a known key; the keys are a, c, d"]
    assert file._same(1e-5, 0.0)
    assert not file._same(3e-4, 0.0)


def test_numbers_of_a_file_are_rounded_but_for_those_that_are_exact():
    nested = {"V_a_mps": 25.123456789, "lags": [1.23456789, {"order": 2, "name": "a"}], "n": None}

    found = file.rounded(nested, 3, ["V_a_mps"])

    assert found == {"V_a_mps": 25.123456789, "lags": [1.23, {"order": 2, "name": "a"}], "n": None}
    assert file.rounded((123456.0, -0.0012345), 2) == [120000.0, -0.0012]


def test_the_nearest_condition_counts_octaves_of_airspeed_and_degrees_of_climb():
    """Twice the airspeed is as far as 60 deg of climb."""
    made = ft.loop.load_identified("aerosonde")
    conditions = [
        made.conditions[0].model_copy(update={"V_a": V_a, "gamma": gamma})
        for V_a, gamma in ((20.0, 0.0), (40.0, 0.0), (20.0, 0.3))
    ]
    of = made.model_copy(update={"conditions": tuple(conditions)})

    # The middle of 20 and 40 m/s in octaves is 28.28 m/s.
    at = [(28.0, 0.0), (28.6, 0.0), (5.0, 0.14), (5.0, 0.16)]
    at += [(20.0 * 2.0**0.66, math.radians(60.0 * x)) for x in (-0.9, 0.9)]

    nearest = [conditions.index(of.nearest(*where)) for where in at]

    assert nearest == [0, 1, 0, 2, 1, 2]


def test_files_of_a_model_that_changed_or_are_gone_are_named(tmp_path):
    kept, changed, gone = (str(tmp_path / f"{name}.json") for name in ("kept", "changed", "gone"))
    for path in (kept, changed, gone):
        Path(path).write_text("{}")
    known = {}
    for path in (kept, changed, gone, "aerosonde"):
        known |= file.files_of(path)
    assert file.files_of(None) == {}
    assert known[kept] == sha256(b"{}").hexdigest()
    assert file.changed_files(known) == []

    Path(changed).write_text("[]")
    Path(gone).unlink()

    assert file.changed_files(known | {"nothing": "0"}) == [changed, gone, "nothing"]


def test_a_residual_of_logs_is_said_with_its_logs_and_stretches():
    evidence = file.LogEvidence.model_construct(logs=("a.csv", "b.csv"), residual_stretches=7)

    assert "in the 7 stretches of 5 s of a.csv, b.csv" in evidence.sentence
