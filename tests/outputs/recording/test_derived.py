"""Signals that a recording derives: the parts of the gap, and the distance from the law."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_run

from flighttune.gaps.residual import mismatch
from flighttune.outputs.recording import plots
from flighttune.outputs.recording.entities import runs_to_draw

HALF_A_SAMPLE = 0.006
"""Part of a mean over an interval from the value at its end, rad/s."""


def test_the_parts_of_the_gap_add_up_to_what_the_law_leaves_out(four_runs):
    kinematic, aircraft = plots.with_derived(runs_to_draw(four_runs[:2]))
    d = mismatch(aircraft.run).d
    for i, channel in enumerate(("chi", "gamma")):
        parts = sum(aircraft.run.signals[f"{part}_{channel}"] for part in plots.PARTS).to_numpy()
        assert parts[:-1] == pytest.approx(d[:, i], abs=HALF_A_SAMPLE)
        assert np.abs(d[:, i]).max() > 10.0 * HALF_A_SAMPLE
    assert "distance" not in kinematic.run.signals
    apart = aircraft.run.signals[["north", "east", "down"]].to_numpy()
    apart = apart - kinematic.run.signals[["north", "east", "down"]].to_numpy()
    distance = aircraft.run.signals["distance"].to_numpy()
    assert distance == pytest.approx(np.linalg.norm(apart, axis=1))
    height = kinematic.run.signals["h"].to_numpy() + kinematic.run.signals["down"].to_numpy()
    assert height == pytest.approx(1000.0)


@pytest.mark.parametrize(
    ("values", "share", "ends"),
    [
        ([0.0, 20.0], 1.0, (-1.0, 21.0)),
        # labels 10 apart: 0 alone lies between -9 and 9, and 10 is as near as -10
        ([-9.0, 9.0], 0.1, (-9.0 - 0.95, 10.0 + 0.95)),
        ([-9.5, 8.0], 0.1, (-10.0 - 0.9, 8.0 + 0.9)),
        ([1.0, 2.5], 0.1, (1.0 - 0.075, 2.5 + 0.075)),
        # labels 4 and 5 would need an axis of more than twice the range
        ([4.0, 4.4], 0.1, (4.0 - 0.02, 4.4 + 0.02)),
        ([np.nan, 3.0, 3.0], 1.0, None),
        ([1e9, 1e9 + 1.0], 1.0, None),
        ([np.nan], 1.0, None),
    ],
)
def test_an_axis_has_two_labels_where_they_are_near(values, share, ends):
    run = made_up_run({"V_a": values})

    found = plots.value_range(plots.Plot("V_a", "Airspeed"), [run], share=share)

    assert found == (ends if ends is None else pytest.approx(ends))


def test_an_axis_has_room_for_references_limits_and_what_is_measured():
    limits = {"limits": {"phi_deg": [-45.0, 40.0], "n_z": [0.0, 2.0], "phi_rate_dps": 30.0}}
    run = made_up_run({"phi": np.radians([0.0, 10.0])}, scenario=limits)
    other = made_up_run({"phi_cmd": np.radians([0.0, 80.0])})

    plot = plots.Plot("phi", "Roll", thin="phi_cmd", limit="phi")
    # a run without the signal is not on the plot
    assert plots.value_range(plot, [run, other], share=1.0) == pytest.approx((-49.25, 44.25))
    both = made_up_run({"phi": [0.0, 0.0], "phi_cmd": np.radians([0.0, 80.0])}, scenario=limits)
    assert plots.value_range(plot, [run, both], share=1.0) == pytest.approx((-51.25, 86.25))
    assert plots.limits_of(limits, "n_z") == (0.0, 2.0)
    assert plots.limits_of(limits, "phi_rate") is None
    assert plots.limits_of({}, "phi") is None


def test_courses_are_shown_in_degrees_without_jumps_and_measured_ones_beside_them():
    chi = np.radians([170.0, 179.0, -172.0, np.nan, -160.0])
    signals = made_up_run({"chi": chi, "chi_meas": chi + 0.01, "V_a": 25.0, "phi": 0.5}).signals

    shown = plots.displayed(signals, "chi")
    there = np.isfinite(shown)
    assert shown[there] == pytest.approx([170.0, 179.0, 188.0, 200.0])
    whole = signals.dropna()
    measured = plots.displayed(whole, "chi_meas") - plots.displayed(whole, "chi")
    assert measured == pytest.approx(np.degrees(0.01))
    assert plots.displayed(signals, "V_a") == pytest.approx(25.0)
    assert plots.displayed(signals, "phi") == pytest.approx(np.degrees(0.5))


def test_a_plant_without_height_and_ground_speed_has_them_from_its_path():
    t = 0.1 * np.arange(40)
    places = {"north": 3.0 * t, "east": -4.0 * t, "down": 2.0 * t}
    run = made_up_run(places, t, scenario={"flight": {"h_m": 500.0}})

    derived = plots._over_ground(run)

    assert derived["h"] == pytest.approx(500.0 - 2.0 * t)
    assert derived["V_g"] == pytest.approx(5.0)
    assert plots._over_ground(made_up_run(places | {"h": 1.0, "V_g": 2.0}, t)) == {}
    assert "h" not in plots._over_ground(made_up_run(places, t))


def test_a_run_is_compared_with_the_one_below_and_its_place_with_the_first():
    t = 0.1 * np.arange(40)

    def run(chi, north, until=40):
        columns = {"chi": chi, "gamma": 0.1 * chi, "north": north, "east": 0.0, "down": 0.0}
        columns = {name: np.broadcast_to(x, t.shape)[:until] for name, x in columns.items()}
        return made_up_run(columns, t[:until])

    lowest, below, own = run(0.0, 0.0, 20), run(0.2 + t, 5.0), run(0.5 + t, 3.0)

    found = plots._compared(own, [lowest, below])

    assert found["step_chi"] == pytest.approx(0.3)
    assert found["step_gamma"] == pytest.approx(0.03)
    assert found["distance"][:20] == pytest.approx(3.0)
    assert np.isnan(found["distance"][20:]).all()
    assert plots._compared(own, []) == {}


def test_plots_are_those_of_signals_that_a_run_has_without_the_wind_of_calm_air():
    t = 0.1 * np.arange(5)

    def shown(plant="kinematic", units=None, **signals):
        run = made_up_run({name: x + 0.0 * t for name, x in signals.items()}, t, plant=plant)
        tabs = plots.shown_plots([replace(run, units=units or {})])
        return {plot.signal: plot for tab in tabs.values() for plot in tab}

    calm = {"chi": 0.1, "V_a": 25.0, "wind_north": 1e-9, "wind_east": -1e-9, "distance": 3.0}
    assert {*shown(**calm)} == {"chi", "V_a"}
    windy = shown("jsbsim:aerosonde", **calm | {"wind_east": -2.0}, V_a_meas=25.0)
    assert {*windy} == {"chi", "V_a", "wind_east", "distance"}
    assert windy["V_a"].measured == "V_a_meas"
    assert windy["chi"].measured == ""
    own = shown(**calm, mine=3.0, units={"mine": "kg"})
    assert own["mine"].heading == "mine [kg]"
    assert own["chi"].heading.endswith("[deg]")
