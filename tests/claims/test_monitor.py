"""The count of a monitor: its claim, its file, a forgery, and a fault that it finds."""

from dataclasses import replace

import pytest

import flighttune as ft
from flighttune.claims.count import allowed_outside
from flighttune.flight.fly import fly_alone

pytestmark = pytest.mark.slow

SHORT = {"flight.duration_s": 4.0}
FEW = {"epsilon": 0.3, "confidence": 0.9, "learn": 20, "workers": 1}


@pytest.fixture(scope="module")
def monitor():
    return ft.monitor("level_turn", start_deg=2.0, changes=SHORT, **FEW)


def flight(draw, fault=None):
    """A flight of the monitor's kind with other starts than it counted, flown alone."""
    tables = ft.load_scenario("level_turn", changes=SHORT).as_dict()
    tables["flight"] |= {"chi_deg": 0.1 * draw, "gamma_deg": -0.1 * draw}
    (table,) = [x for x in tables["plant"] if x["kind"] == "jsbsim"]
    if fault:
        table["airframe"] = {"fault": {"from_s": 1.0} | fault}
    scenario = ft.scenario_from(tables | {"expect": []})
    (plant,) = scenario.aircraft
    return fly_alone(scenario, plant, ft.PAPER_GAINS, "paper")


def test_the_limits_are_those_that_the_count_allows(monitor):
    counted = len(monitor.scores)
    assert counted == 29
    assert monitor.outside == allowed_outside(counted, 0.3, 0.9)
    assert "raises an alarm with probability at most 0.3" in monitor.sentence


def test_a_fault_alarms_after_it_began_and_a_healthy_flight_does_not(monitor):
    assert monitor.watch.alarm(flight(3)) is None

    alarm = monitor.watch.alarm(flight(3, {"aileron_stuck_deg": 5.0}))

    assert alarm is not None
    assert 1.0 <= alarm.at_s < 2.0
    assert alarm.why in ("roll", "turn")


def test_its_file_is_verified_and_other_weights_are_not(monitor, tmp_path):
    monitor.save(tmp_path / "monitor.npz")
    read = ft.load(tmp_path / "monitor.npz")
    assert read.sha256 == monitor.sha256
    assert ft.verify(read, count=2).valid

    first, *others = read.about.models
    weights = tuple(1.001 * weight for weight in first.weights)
    models = (replace(first, weights=weights), *others)
    forged = replace(read, about=replace(read.about, models=models))

    verified = ft.verify(forged, count=2)

    assert not verified.valid
    assert "airspeed" in verified.reason or "equal to the bit" in verified.reason


def test_models_of_other_signals_are_refused(monitor, tmp_path):
    changed = replace(monitor, about=replace(monitor.about, models=monitor.about.models[1:]))
    changed.save(tmp_path / "monitor.npz")

    with pytest.raises(ft.InputError, match=r"`models` .* those of the `signals`"):
        ft.load(tmp_path / "monitor.npz")
