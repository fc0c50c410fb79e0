"""Exact rates in certificates: those of flights of the loop, and not to be forged."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft


@pytest.fixture(scope="module")
def mission():
    return ft.certify("mission", changes={"tuning.model": "identified"}).certificate


@pytest.mark.slow
def test_a_certificate_keeps_its_exact_rates_in_its_file(mission, tmp_path):
    mission.save(tmp_path / "proof.json")

    read = ft.load(tmp_path / "proof.json")

    assert read.sentence == mission.sentence
    assert ft.verify(tmp_path / "proof.json").valid
    assert "sampled at 50 Hz" in read.sentence


FORGERIES = {
    "rate": lambda rate: {"rate": 1.002 * rate.rate},
    "Q": lambda rate: {"Q": rate.Q - 0.1 * np.eye(len(rate.Q))},
    "units": lambda rate: {"units": rate.units * np.linspace(1.0, 3.0, len(rate.units))},
}
SAMPLED = {
    "dt": lambda _: {"dt": 0.021},
    "delay": lambda x: {"lags": tuple(replace(lag, delay=lag.delay + 0.005) for lag in x.lags)},
    "law": lambda x: {"trapezoidal": not x.trapezoidal},
}


@pytest.mark.parametrize(
    ("place", "forgery"),
    [*((place, name) for place in (0, 1) for name in FORGERIES), *((1, x) for x in SAMPLED)],
)
def test_a_forged_exact_rate_is_not_valid(mission, place, forgery):
    rate = mission.exact_rates[place]
    if forgery in FORGERIES:
        changed = FORGERIES[forgery](rate)
    else:
        changed = {"sampling": replace(rate.sampling, **SAMPLED[forgery](rate.sampling))}

    verification = ft.verify(replace(mission, exact_rates=(replace(rate, **changed),))).verification

    assert not verification.valid
    assert "loop)" in verification.reason


def test_each_of_two_exact_rates_is_proven(mission):
    continuous, sampled = mission.exact_rates
    faster = replace(sampled, rate=1.002 * sampled.rate)

    verification = ft.verify(replace(mission, exact_rates=(continuous, faster))).verification

    assert "(sampled loop)" in verification.reason


def test_a_weak_certificate_is_weak_by_its_continuous_rate(mission):
    continuous, sampled = mission.exact_rates
    halved_in = np.log(2.0) / 0.001 / 60.0  # minutes

    weak = replace(mission, exact_rates=(replace(continuous, rate=0.001), sampled))

    assert "halves errors" not in mission.in_words
    assert f"halves errors in {halved_in:.2g} minutes" in weak.in_words


def test_exact_rates_are_of_the_trim_alone_and_continuous_first(mission):
    there = replace(mission.claim, conditions=((25.0, 0.1),))
    other = replace(mission.model, errors=("own", "other"))

    with pytest.raises(ft.InputError, match="`exact_rates` must be empty with"):
        replace(mission, claim=there, models=(mission.model,))
    with pytest.raises(ft.InputError, match="continuous loop, then of the sampled one"):
        replace(mission, exact_rates=mission.exact_rates[::-1])
    with pytest.raises(ft.InputError, match="must have the states, inputs and errors"):
        replace(mission, exact_rates=(), claim=there, models=(other,))


def test_exact_rates_are_of_the_gains_of_their_certificate(mission):
    slower = replace(mission.gains, K_I=0.9 * mission.gains.K_I)

    assert not ft.verify(replace(mission, gains=slower)).valid


def test_certify_says_why_the_sampled_loop_has_no_exact_rate():
    changes = {"tuning.model": "identified", "controller.rate_hz": 1000.0}  # 25 ms late, twice

    answer = ft.certify("paper", "paper", changes=changes).answer()

    assert [rate["loop"] for rate in answer.values["certificate"]["exact_rates"]] == ["continuous"]
    assert any("sampled at 1000 Hz" in note for note in answer.notes)


def test_a_sampled_loop_has_the_integral_of_its_law(mission):
    """The exact law sums each error after its command, the paper's takes the trapezoid."""
    sampling, model = mission.exact_rates[1].sampling, mission.model
    other = replace(sampling, trapezoidal=not sampling.trapezoidal)

    checks = [x.checks(model, mission.gains) for x in (sampling, other)]
    assert not sampling.trapezoidal
    assert [[check.exact for check in each] for each in checks] == [[True, True], [True, False]]


def slowest(error, dt):
    """Rate of the slowest pair of modes, by the recursion that late errors of a flight obey."""
    before = np.array([error[i : i + 2] for i in range(len(error) - 2)])
    a, b = np.linalg.lstsq(before, error[2:])[0]
    return -np.log(np.abs(np.roots([1.0, -b, -a])).max()) / dt


AEROSONDE = {"model": "identified", "identified": "aerosonde"}
BEHIND = {"kind": "point_mass_lag", "identified": "aerosonde"}
ASSUMED = {"kind": "point_mass_lag", "roll_lag_rad_s": 5.0, "n_z_lag_rad_s": 8.0}
FLOWN = [
    ("exact", (1.5, 1.3), (0.8, 0.5), (0.0, 0.0), AEROSONDE, BEHIND),
    ("exact", (1.1, 1.7), (0.8, 0.5), (0.4, 0.3), AEROSONDE, BEHIND),
    ("paper", (2.6, 3.9), (1.9, 1.2), (0.0, 0.0), AEROSONDE, BEHIND),
    ("paper", (3.4, 3.0), (2.0, 1.2), (0.0, 0.0), {"lag_rad_s": [5.0, 8.0]}, ASSUMED),
]


@pytest.mark.parametrize(("law", "K_P", "K_I", "feedback", "tuning", "plant"), FLOWN)
def test_the_true_rate_of_a_sampled_loop_is_that_of_its_flight(
    law, K_P, K_I, feedback, tuning, plant
):
    """Of errors so small that the point mass behind its lags is linear."""
    gains = {"name": "own", "law": law, "K_P": np.diag(K_P).tolist(), "K_I": np.diag(K_I).tolist()}
    made = made_up_scenario(
        law=[law],
        gains=[gains | ({"feedback": [*feedback]} if any(feedback) else {})],
        flight={"duration_s": 14.0},
        reference={"chi_deg": 0.01, "gamma_deg": 0.01},
        tuning=tuning,
        plant=[plant],
        controller={"rate_hz": 20.0, "feed_forward": law == "paper"},
    )
    _, sampled = ft.certify(made).values["exact_rates"]
    (run,) = ft.fly(made).runs
    late = (run.signals[f"{channel}_err"].to_numpy()[120:] for channel in ("chi", "gamma"))

    assert sampled["loop"].startswith("sampled at 20 Hz")
    rate = min(slowest(error, 0.05) for error in late)
    assert sampled["true_rate"] == pytest.approx(rate, rel=2e-4)
    assert 0.99 * sampled["true_rate"] <= sampled["decay"] < sampled["true_rate"]
