"""The inner loop's computer has a rate of its own, and JSBSim's step may be shorter."""

import numpy as np
import pytest
from airframes import fdm_of
from made_up import shortened

import flighttune as ft
from flighttune.vehicles.plants.jsbsim import plant as jsbsim_plant
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.plant import steps_for
from flighttune.vehicles.plants.jsbsim.trim import trim

LAST_DIGIT = 0.01
"""Of an ITAE as it is printed, rad s^2."""

SHARE = 0.004
"""Part by which the metrics of a propeller aircraft may move."""


@pytest.mark.soak
@pytest.mark.parametrize(
    ("aircraft", "scenario", "seconds", "allowed"),
    [
        ("aerosonde", "paper_identified", 20.0, {"abs": LAST_DIGIT}),
        ("c172p", "c172_cruise_turn", 40.0, {"rel": SHARE}),
    ],
)
def test_half_the_step_moves_the_ITAE_by_little(aircraft, scenario, seconds, allowed, monkeypatch):
    plant = [{"kind": "jsbsim", "aircraft": aircraft}]
    scenario = shortened(scenario, seconds, plant=plant, gains=["paper", "K5"])
    whole = ft.fly(scenario).metrics["ITAE"]
    monkeypatch.setattr(jsbsim_plant, "steps_for", lambda config, rate: 2 * steps_for(config, rate))

    half = ft.fly(scenario).metrics["ITAE"]

    assert half.to_numpy() == pytest.approx(whole.to_numpy(), **allowed)


@pytest.mark.parametrize("aircraft", ["aerosonde", "c172p"])
def test_the_computer_runs_once_in_so_many_steps(aircraft):
    steps = 4
    config = ft.loop.JSBSimPlant(aircraft).config
    plant = ft.loop.JSBSimPlant(config, steps=steps)
    plant.start(ft.loop.FlightCondition(V_a=config.design.V_a))
    plant.advance(0.3, 1.2, 0.1)
    fdm = plant._run.__self__  # the JSBSim executive itself: no public way to look between samples
    seen = []
    for _ in range(5 * steps):
        fdm.run()
        seen.append((fdm["ft/aileron-cmd-rad"], fdm["ft/aileron-rad"]))

    command, surface = np.array(seen).T
    new = np.flatnonzero(np.diff(command)) + 1
    assert new.tolist() == list(range(steps - 1, 5 * steps, steps))  # the step that ends a sample
    assert np.all(np.diff(surface) != 0.0)


@pytest.mark.parametrize("aircraft", ["aerosonde", "c172p", "a4"])
def test_the_trim_does_not_hang_on_the_step(aircraft):
    config = ft.loop.JSBSimPlant(aircraft).config
    condition = ft.loop.FlightCondition(V_a=config.design.V_a, h=config.design.h)
    points = [trim(Fdm(config, steps=n), condition) for n in (1, 3)]

    assert points[0].alpha == pytest.approx(points[1].alpha, abs=1e-9)


def test_a_sample_of_the_outer_loop_is_whole_steps():
    config, rates = ft.loop.JSBSimPlant("aerosonde").config, (50.0, 200.0, 80.0, 240.0, 7.0, 1000.0)

    assert [steps_for(config, rate) for rate in rates] == [1, 1, 2, 6, 7, 5]
    with pytest.raises(ft.InputError, match=r"`controller\.rate_hz` .*200 Hz.* 7\.3"):
        steps_for(config, 7.3)


def test_time_at_rest_does_not_count_and_ends_early_where_it_may():
    fdm = fdm_of("c172p")

    # A share of 0 never ends the wait, a share of 1 does so with the second sample.
    assert not fdm.hold(0.1)
    assert fdm.hold(0.1, still=1.0)
    assert fdm.reader("simulation/sim-time-sec")() == 0.0
    assert fdm.reader("simulation/dt")() == pytest.approx(1.0 / fdm.rate)
