"""The fastest change of course within limits: what cannot be is refused before any flight."""

import time

import pytest
from made_up import scenario_tables

import flighttune as ft

TABLES = scenario_tables(
    flight={"chi_deg": 30.0, "duration_s": 10.0},
    reference={"shape": "feasible", "gamma_deg": 5.0, "margin": 0.1},
    limits={
        "phi_deg": [-30.0, 40.0], "phi_rate_dps": 20.0, "n_z": [0.0, 1.8], "n_z_rate_per_s": 1.0,
    },
    controller={"feed_forward": True},
    plant=[{"kind": "point_mass"}],
)  # fmt: skip
LAG = {"kind": "point_mass_lag", "roll_lag_rad_s": 0.05, "n_z_lag_rad_s": 5.0}


def changed(**tables):
    return {
        **TABLES,
        **{name: {**TABLES[name], **x} if isinstance(x, dict) else x for name, x in tables.items()},
    }


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"flight": {"phi_deg": 37.0}}, "`phi`.*begin"),
        ({"flight": {"n_z": 1.75}, "limits": {"n_z": [0.2, 1.8]}}, "`n_z`.*begin"),
        ({"limits": {"n_z": [1.2, 1.8]}}, "`n_z` must hold that of steady flight"),
        ({"limits": {"phi_deg": [0.0, 40.0]}}, "`phi`.*to the left.*got 0 deg"),
        ({"limits": {"phi_deg": [-4.5e-5, 40.0]}}, "`phi`.*to the left.*got 4.05e-05 deg"),
        ({"flight": {"chi_deg": -30.0}, "limits": {"phi_deg": [-30.0, 4.5e-5]}},
         "`phi`.*to the right, so that the turn of 30 deg .*got 4.05e-05 deg"),
        ({"limits": {"phi_rate_dps": 1e-6}}, "within the limits in 200 s, got none"),
        ({"plant": [LAG]}, "lag of the first plant must settle within 200 s .* got 240 s"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_line_and_takes_no_time(tables, message):
    began = time.process_time()
    with pytest.raises(ft.InputError, match=message) as raised:
        ft.fly(ft.scenario_from(changed(**tables)), gains=["paper"])

    assert "\n" not in str(raised.value)
    assert time.process_time() - began < 3.0  # without bounds: minutes


def test_the_margin_is_taken_off_every_limit():
    """A flight of the law follows it, and rolls to nine tenths of the limit."""
    scenario = ft.scenario_from(changed(flight={"duration_s": 6.0}))

    signals = ft.fly(scenario, gains=["paper"]).runs[0].signals

    assert signals[["chi_err", "gamma_err"]].abs().max().max() < 0.02
    assert signals["phi"].min() == pytest.approx(-0.4712, abs=0.01)  # 0.9 of 30 deg
