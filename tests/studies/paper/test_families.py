"""The flights of the paper against an independent integration and sums done by hand."""

import math

import numpy as np
import pytest
from made_up import made_up_run
from scipy.integrate import solve_ivp

import flighttune as ft
from flighttune.studies.paper import flight as paper
from flighttune.studies.paper import parameters as printed

SAME_PATH = 1e-6
SAME_MEASURE = 1e-9
HALF_A_SAMPLE = 0.005
PRINTED_DIGITS = 5e-4


def independent(K_P, K_I, amplitude, omega, t):
    """The paper's law with commands cut off at their ranges, by an implicit integrator."""
    g_over_v, gamma_c = 9.81 / 25.0, math.pi / 12
    K_P, K_I = np.array(K_P), np.array(K_I)

    def rates(now, s):
        u = K_P @ s[:2] + K_I @ s[2:]
        phi = min(max(u[0], -math.pi / 4), math.pi / 4)
        n_z = min(max(u[1], -2.1), 2.1)
        return [
            -g_over_v * math.tan(phi) - amplitude * math.sin(omega * now),
            -g_over_v * (n_z * math.cos(phi) - math.cos(gamma_c - s[1]))
            - amplitude * math.cos(omega * now),
            s[0],
            s[1],
        ]

    start = [-math.pi / 3, math.pi / 12 - math.pi / 4, 0.0, 0.0]
    return solve_ivp(
        rates, (0.0, t[-1]), start, "LSODA", t_eval=t, rtol=1e-11, atol=1e-12, max_step=0.02
    ).y[:2]


K_P = [[1.6968, 0.5906], [-0.5906, 1.9556]]
K_I = [[3.4869, 0.1784], [-0.1784, 3.4869]]


WAVE = printed.disturbance(printed.PRINTED_DISTURBANCE)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "epsilon", "disturbance", "amplitude", "omega"),
    [
        ("K*", 0.0, printed.PRINTED_DISTURBANCE, 0.1, 0.15),
        ("K1", -4.0, printed.PRINTED_DISTURBANCE, 0.1, 0.15),
        ("K6", 1.0, printed.PRINTED_DISTURBANCE, 0.1, 0.15),
        ("K*", 0.0, "d9", 0.3, 0.2),
    ],
)
def test_the_families_fly_as_an_independent_integrator_does(
    study, name, epsilon, disturbance, amplitude, omega
):
    flight = paper.fly(study.gains[name], printed.disturbance(disturbance))
    shift = -epsilon * np.eye(2)

    e_chi, e_gamma = independent(K_P + shift, K_I + shift, amplitude, omega, flight.t)

    assert np.max(np.abs(flight.channels["chi"] - e_chi)) < SAME_PATH
    assert np.max(np.abs(flight.channels["gamma"] - e_gamma)) < SAME_PATH
    peak, when = flight.peak("chi")
    assert peak == pytest.approx(e_chi.max(), abs=SAME_PATH)
    assert when == pytest.approx(flight.t[e_chi.argmax()], abs=HALF_A_SAMPLE)


def test_the_rates_of_error_are_the_derivatives_of_the_errors(study):
    flight = paper.fly(study.star, None)
    smooth = np.flatnonzero(flight.t > 12.0)[1:-1]

    for channel in ("chi", "gamma"):
        e, rate = flight.channels[channel], flight.channels[f"{channel}_dot"]
        slope = (e[smooth + 1] - e[smooth - 1]) / 0.02
        assert rate[smooth] == pytest.approx(slope, abs=1e-4)


@pytest.mark.slow
def test_measures_of_the_errors_are_those_of_every_other_run(study):
    flight = paper.fly(study.gains["K2"], WAVE)
    columns = {f"{c}_err": flight.channels[c] for c in ("chi", "gamma")}
    columns |= {"chi_ref": 0.0, "gamma_ref": np.pi / 12.0}
    for i, name in enumerate(("phi", "n_z")):
        columns |= {f"{name}_cmd": flight.u[:, i], f"{name}_limited": 0.0}

    theirs = ft.loop.channel_metrics(made_up_run(columns, flight.t))

    for key in ("ITAE", "MO_rad", "PT_s", "MS_rad", "ST_rad"):
        ours = flight.measures.loc[["chi", "gamma"], key].to_numpy()
        assert ours == pytest.approx(theirs[key].to_numpy(), rel=SAME_MEASURE)


def test_the_first_commands_of_the_printed_gains_are_those_worked_out_by_hand(study):
    use = paper.initial_commands(study.star)

    chi, gamma = -math.pi / 3, -math.pi / 6
    phi = (1.6968 + 0.34869) * chi + (0.5906 + 0.01784) * gamma
    ends = use.loc["phi", ["value", "lower", "upper"]]
    assert [*ends] == pytest.approx([phi, -math.pi / 4, math.pi / 4], abs=1e-12)
    for name, value in (("phi", -2.461), ("n_z", -0.569), ("phi rate", -3.745)):
        assert use["value"][name] == pytest.approx(value, abs=PRINTED_DIGITS)
    assert paper.largest_share(study.star) == pytest.approx(
        use["value"]["phi rate"] / (-math.pi / 6), rel=1e-12
    )


def test_decay_and_oscillations_of_a_known_signal():
    t = np.linspace(0.0, 10.0, 1001)

    assert paper.decay_rate(t, 3.0 * np.exp(-0.7 * t)) == pytest.approx(0.7, rel=1e-9)
    assert paper.oscillations(np.cos(t)) == 3


def made_up_flight(error, *, limited=(), reason=""):
    """Twenty seconds with these errors at the end; commands are limited at these times (s)."""
    t, zeros = np.arange(2001) * 0.01, np.zeros((2001, 2))
    u = np.isin(t, np.array(limited))[:, None] * [1.0, 0.0]
    errors = np.where((t < 17.995)[:, None], 1.0, error)
    names = dict.fromkeys(("x", "error_rate", "integral", "unlimited"), zeros)
    return paper.PaperFlight(t=t, error=errors, u=u, reason=reason, **names)


@pytest.mark.parametrize(
    ("error", "reason", "converged"),
    [
        ((0.04, -0.04), "", True),
        ((0.06, 0.0), "", False),
        ((0.0, -0.06), "", False),
        ((0.0, 0.0), "chi 1000 rad", False),
    ],
)
def test_errors_have_converged_if_both_end_with_two_seconds_near_the_origin(
    error, reason, converged
):
    flight = made_up_flight(error, reason=reason)

    assert flight.converged == converged
    assert flight.status == ("diverged" if reason else "completed")


def test_commands_are_released_when_a_limit_last_holds():
    assert made_up_flight(0.0, limited=(0.5, 3.25)).released == pytest.approx(3.25)
    assert made_up_flight(0.0).released == 0.0
