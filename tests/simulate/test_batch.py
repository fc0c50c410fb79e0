"""The batched flights against the single run."""

import math

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.gains import paper_family
from flighttune.references.segments import Segment
from flighttune.simulate.batch import SIGNALS, fly_sampled
from flighttune.simulate.disturbance import Sinusoid
from flighttune.simulate.loop import simulate

SAME = 1e-12
RANGE = ([-math.pi / 4, -2.1], [math.pi / 4, 2.1])
MAGNITUDE = ft.Limits(
    lower=RANGE[0], upper=RANGE[1], rate_lower=[-math.inf] * 2, rate_upper=[math.inf] * 2
)
PRINTED = ft.Limits(
    lower=RANGE[0], upper=RANGE[1], rate_lower=[-math.pi / 6, -1.0], rate_upper=[math.pi / 6, 1.0]
)
START = ft.FlightCondition(V_a=25.0, chi=math.pi / 3, gamma=math.pi / 4, phi=math.pi / 3, n_z=1.0)
REF = (0.0, math.pi / 12)
WAVES = Sinusoid(chi_amplitude=0.1, chi_omega=0.15, gamma_amplitude=0.1, gamma_omega=0.15)


def paper(dt=0.01, limits=PRINTED, gains=(ft.PAPER_GAINS,), **settings):
    """Flights of the paper's manoeuvre."""
    laws = [ft.MimoPI(each, limits, dt=dt) for each in gains]
    return fly_sampled(laws, [START], REF, **{"duration": 1.0, "disturbances": [WAVES], **settings})


MANOEUVRE = ft.Reference(
    chi=3.0,
    gamma=0.1,
    chi_segments=(Segment(2.0, (0.0,), jumps=(2.5,)), Segment(4.0, (0.0, 3.0), rates=(-0.3,))),
    gamma_segments=(Segment(1.0, (0.0, 2.0, 4.0), jumps=(0.2, -0.4, 0.2)),),
)


def random_cases(count, seed):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        gains = ft.PIGains(
            K_P=ft.PAPER_GAINS.K_P + rng.normal(0.0, 0.8, (2, 2)),
            K_I=ft.PAPER_GAINS.K_I * rng.uniform(0.1, 1.5),
        )
        condition = ft.FlightCondition(
            V_a=rng.uniform(15.0, 40.0),
            chi=rng.uniform(-6.0, 6.0),
            gamma=rng.uniform(-0.5, 0.8),
            phi=rng.uniform(-1.2, 1.2),
            n_z=rng.choice([None, 1.0]),
        )
        amplitude, omega = rng.uniform(0.0, 0.2, 2), rng.uniform(0.05, 2.0, 2)
        waves = Sinusoid(
            chi_amplitude=amplitude[0],
            chi_omega=omega[0],
            gamma_amplitude=amplitude[1],
            gamma_omega=omega[1],
        )
        yield gains, condition, (ft.Limits.none(2), MAGNITUDE, PRINTED)[rng.integers(3)], waves


def flown_alone(case, reference, dt, *, feed_forward, **settings):
    gains, condition, limits, waves = case
    return simulate(
        ft.PointMassPlant(turn="paper", disturbance=waves),
        ft.MimoPI(gains, limits, dt=dt, feed_forward=feed_forward, **settings),
        reference,
        condition=condition,
        duration=8.0,
    )


@pytest.mark.slow
@pytest.mark.parametrize("anti_windup", ["none", "conditional", "back_calculation"])
@pytest.mark.parametrize(
    ("dt", "settings"),
    [
        (0.01, {}),
        (0.05, {"feed_forward": True}),
        (0.02, {"schedule_speed": 22.0, "tracking_time": 0.7}),
        (0.03, {"feed_forward": True, "wrapped": False}),
    ],
    ids=["plain", "feed_forward", "schedule", "not_wrapped"],
)
def test_a_batch_flies_what_the_single_run_flies(dt, settings, anti_windup):
    cases = list(random_cases(12, seed=round(1000 * dt)))
    samples = np.arange(round(8.0 / dt) + 1) * dt
    settings = {"feed_forward": False, **settings, "anti_windup": anti_windup}
    settings["wrapped"] = ("chi",) if settings.get("wrapped", True) else ()

    batch = fly_sampled(
        [ft.MimoPI(gains, limits, dt=dt, **settings) for gains, _, limits, _ in cases],
        [case[1] for case in cases],
        np.column_stack(MANOEUVRE.sampled(samples)),
        duration=8.0,
        disturbances=[case[3] for case in cases],
    )

    shared = [name for name in SIGNALS if not name.endswith("_rate")]
    for i, case in enumerate(cases):
        signals, stop = flown_alone(case, MANOEUVRE, dt, **settings)
        n = len(signals)
        assert batch.samples[i] == n
        assert (batch.ends[i] == 0) == (stop is None)
        for name in shared:
            alone = signals[name].to_numpy()
            assert batch.signal(name)[i, :n] == pytest.approx(alone, rel=SAME, abs=SAME), name


def test_a_flight_does_not_depend_on_those_flown_with_it_by_a_bit():
    gains = list(paper_family().values()) * 10

    together, first, others = (
        paper(0.02, MAGNITUDE, part, duration=5.0).trajectories
        for part in (gains, gains[:7], gains[7:])
    )

    assert np.array_equal(together, np.concatenate([first, others]), equal_nan=True)
