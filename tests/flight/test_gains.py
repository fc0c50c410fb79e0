"""What `tune` and `certify` make of a scenario: its law, its navigation and its envelope."""

import pytest

import flighttune as ft


@pytest.mark.slow
def test_estimates_of_a_certificate_are_those_of_the_grade_at_its_airspeed_and_rate():
    changes = {"flight.V_a_mps": 40.0, "controller.rate_hz": 20.0}
    found = ft.certify("paper", "paper", navigation="standard", changes=changes)

    chi, gamma, _ = ft.loop.Navigation.of("standard").path_sd(0.05, 40.0)
    assert found.estimate_sd == pytest.approx((chi, gamma))
    assert found.navigation == "standard"


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
