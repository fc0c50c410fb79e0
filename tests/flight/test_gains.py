"""What `tune` and `certify` make of a scenario: its law, its navigation and its envelope."""

import textwrap

import numpy as np
import pytest
from fuzzing import to_toml
from made_up import scenario_tables

import flighttune as ft
from flighttune.base.errors import InfeasibleError
from flighttune.control.certificates.make import certify_model
from flighttune.control.exact_law import rate_model

OWN = scenario_tables(
    law=[{"name": "mine", "kind": "python", "module": "law.py", "class": "Mine"}],
    plant=[{"kind": "point_mass"}],
)
LAW = """
    import flighttune as ft
    from flighttune.control.exact_law import rate_model

    class Mine:
        signals = {}

        def __init__(self, setup):
            self.dt = setup.dt

        def start(self, condition):
            pass

        def step(self, measured, reference, t):
            return 0.0, 1.0
"""
LINEAR = """
        def linear(self):
            K_P, K_I = [[2.0, 0.0], [0.0, 3.0]], [[0.5, 0.0], [0.0, 1.0]]
            return rate_model(), ft.PIGains(K_P=K_P, K_I=K_I, inputs=("chi_dot", "gamma_dot"))
"""
GAINS = ft.PIGains(  # those of the law
    K_P=np.diag([2.0, 3.0]), K_I=np.diag([0.5, 1.0]), inputs=("chi_dot", "gamma_dot")
)

# Shares by which a claim may be below R_K, and a proven rate below the slowest eigenvalue.
ROUNDED, CLAIMED = 1e-5, 2e-3


@pytest.fixture
def own(tmp_path):
    def written(text):
        (tmp_path / "law.py").write_text(textwrap.dedent(text))
        (tmp_path / "own.toml").write_text(to_toml(OWN))
        return tmp_path / "own.toml"

    return written


def test_a_law_of_ones_own_is_certified_by_the_loop_that_it_states(own):
    """Each channel is s^2 + k_P s + k_I."""
    file = own(LAW + LINEAR)

    found = ft.certify(file)

    assert found.name == "mine:paper"
    loop = ft.loop.closed_loop(rate_model(), GAINS)
    R_K = ft.loop.indicators(loop, errors=2).R_K
    assert found.certificate.claim.rate == pytest.approx(R_K, rel=ROUNDED)
    slowest = min(-np.roots(x).real.max() for x in ([1.0, 2.0, 0.5], [1.0, 3.0, 1.0]))
    (rate,) = found.certificate.exact_rates
    assert rate.rate == pytest.approx(slowest, rel=CLAIMED)
    assert found.certificate.scenario_sha256 == ft.load_scenario(file).sha256
    assert found.certificate.claim.radius is None


def test_what_a_law_of_ones_own_does_not_state_is_not_certified(own):
    file = own(LAW + LINEAR)
    for options in ({"envelope": True}, {"lag": (0.1, 0.2)}, {"navigation": "rtk"}):
        with pytest.raises(ft.InputError, match="must be absent for mine:paper"):
            ft.certify(file, **options)
    without = own(LAW)
    with pytest.raises(InfeasibleError, match=r"mine:paper: .* `linear\(\)`"):
        ft.certify(without)


def test_a_model_is_certified_with_gains_alone():
    model = rate_model()
    for options in ({"envelope": True}, {"lag": (0.1, 0.2)}, {"navigation": "rtk"}):
        with pytest.raises(ft.InputError, match="must be given for a model"):
            ft.certify(model, GAINS, **options)
    with pytest.raises(ft.InputError, match="`gains` must be given for a model"):
        ft.certify(model, "paper")


@pytest.mark.slow
def test_estimates_of_a_certificate_are_those_of_the_grade_at_its_airspeed_and_rate():
    changes = {"flight.V_a_mps": 40.0, "controller.rate_hz": 20.0}
    found = ft.certify("paper", "paper", navigation="standard", changes=changes)

    chi, gamma, _ = ft.loop.Navigation.of("standard").path_sd(0.05, 40.0)
    assert found.estimate_sd == pytest.approx((chi, gamma))
    assert found.navigation == "standard"


@pytest.mark.slow
def test_the_largest_envelope_of_a_certificate_is_proven_and_one_percent_more_is_not():
    found = ft.certify("paper", "paper", envelope=True)

    trim, ranges = found.ranges
    assert found.largest_factor > 1.0
    proven = [
        certify_model(
            found.model, found.gains, envelope=ranges.scaled(trim, x * found.largest_factor), g=9.81
        ).status
        for x in (0.99, 1.02)
    ]
    assert proven == ["certified", "refused"]


@pytest.mark.parametrize(
    ("options", "changes", "said"),
    [
        ({"envelope": True}, {"tuning.objective": "cost"}, "`objective` of .* must be R_K over"),
        ({"envelope": True, "lag": (0.1, 0.2)}, {}, "`lag` must be absent over an envelope"),
        ({"lag": (0.1, 0.2)}, {"tuning.objective": "cost"}, "`lag` must be absent"),
        ({"starts": 0}, {}, "`starts` must be"),
    ],
)
def test_what_gains_cannot_be_tuned_for_is_refused(options, changes, said):
    with pytest.raises(ft.InputError, match=said):
        ft.tune("paper", changes=changes, **options)
