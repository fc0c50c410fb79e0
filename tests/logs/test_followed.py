"""The path of a log as a scenario: what the log commands, or else what it flew."""

from dataclasses import replace

import numpy as np
import pytest
from logged_turns import logged_turn

import flighttune as ft
from flighttune.flight import conditions
from flighttune.logs import followed

TENTH_DEG = np.deg2rad(0.1)


def turn(t):
    """The course that the log commands, rad."""
    return np.deg2rad(np.clip(10.0 * (t - 2.0), 0.0, 90.0))


def test_the_command_of_a_log_is_the_reference(tmp_path):
    log = ft.load_log(logged_turn(tmp_path / "flight.csv"))
    scenario = followed.followed(log, "aerosonde")
    t = np.arange(31.0)
    chi, gamma = conditions.reference_of(scenario).sampled(t)
    assert chi == pytest.approx(turn(t), abs=TENTH_DEG)
    assert gamma == pytest.approx(0.0, abs=TENTH_DEG)
    assert scenario.flight.V_a_mps == pytest.approx(25.0, abs=0.5)


def test_a_log_without_commands_is_followed_where_it_flew(tmp_path):
    log = ft.load_log(logged_turn(tmp_path / "flight.csv", "chi_ref", "gamma_ref"))
    t = np.arange(31.0)
    chi, _ = conditions.reference_of(followed.followed(log, "aerosonde")).sampled(t)
    flown = np.interp(t, log.t, log.signals["chi"])
    assert chi == pytest.approx(flown, abs=TENTH_DEG)
    assert np.abs(chi - turn(t)).max() > 10.0 * TENTH_DEG  # the flight lags and overshoots


def test_a_gap_of_the_log_is_bridged(tmp_path):
    log = ft.load_log(logged_turn(tmp_path / "flight.csv"))
    holed = log.signals.copy()
    holed.loc[4.0:6.0, "chi_ref"] = np.nan
    chi, _ = conditions.reference_of(
        followed.followed(replace(log, signals=holed), "aerosonde")
    ).sampled(np.array([5.0]))
    assert chi == pytest.approx(turn(5.0), abs=TENTH_DEG)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda x: x.drop(columns=["chi", "chi_ref"]), "must have chi_ref or chi, got neither"),
        (lambda x: x.drop(columns=["V_a", "V_g"]), "must have V_a or V_g, got neither"),
        (
            lambda x: x.set_index(30.0 * x.index),
            "must last at most 600 s .* got 900 s: name a part",
        ),
    ],
)
def test_a_log_that_cannot_be_followed_is_refused(tmp_path, change, what):
    log = ft.load_log(logged_turn(tmp_path / "flight.csv"))
    with pytest.raises(ft.InputError, match=what):
        followed.followed(replace(log, signals=change(log.signals)), "aerosonde")
