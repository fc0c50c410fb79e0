"""The sampled loop against the continuous law, behind sensors, and the shape of what it returns."""

import gc
import math
import os
import weakref
from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from flighttune.base.files.code import JSBSIM
from flighttune.base.processors import cores
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.control.mimo_pi import INTEGRAL_SIGNALS
from flighttune.flight.loop import loop
from flighttune.flight.loop.loop import LOOP_SIGNALS, Flight, simulate
from flighttune.routes.segments import Segment
from flighttune.studies.paper import parameters as printed
from flighttune.studies.paper.flight import fly
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.sensors import DrawnErrors

PEAK_TOLERANCE = 0.002
PAPER_LIMITS = ft.loop.Limits(
    lower=np.array([-math.pi / 4, -2.1]),
    upper=np.array([math.pi / 4, 2.1]),
    rate_lower=np.array([-math.pi / 6, -1.0]),
    rate_upper=np.array([math.pi / 6, 1.0]),
)
PAPER_START = ft.loop.FlightCondition(V_a=25.0, chi=math.pi / 3, gamma=math.pi / 4)
PAPER_REFERENCE = ft.loop.Reference(chi=0.0, gamma=math.pi / 12)


def test_the_papers_mode_peaks_where_the_continuous_law_does():
    (run,) = ft.fly("paper_as_printed", "paper").runs

    continuous = fly(ft.PAPER_GAINS, printed.disturbance(printed.PRINTED_DISTURBANCE)).error.max(
        axis=0
    )
    peaks = run.signals[["chi_err", "gamma_err"]].max().to_numpy()
    assert peaks == pytest.approx(continuous, abs=PEAK_TOLERANCE)


def simulated(
    plant=ft.loop.PointMassPlant, limits=None, reference=PAPER_REFERENCE, condition=PAPER_START,
    duration=10.0, sensors=None, **law,
):  # fmt: skip
    return simulate(
        plant(turn="paper"),
        ft.loop.MimoPI(ft.PAPER_GAINS, limits, dt=0.02, **law),
        reference,
        condition=condition,
        duration=duration,
        sensors=sensors,
    )


def flown(anti_windup, duration=40.0):
    return simulated(limits=PAPER_LIMITS, anti_windup=anti_windup, duration=duration)[0]


@pytest.mark.parametrize("anti_windup", ["conditional", "back_calculation"])
def test_with_anti_windup_the_rate_limited_loop_converges(anti_windup):
    errors = flown(anti_windup)[["chi_err", "gamma_err"]]

    assert np.abs(errors.loc[30.0:].to_numpy()).max() < math.radians(0.1)


def test_without_anti_windup_the_rate_limited_loop_never_settles():
    errors = flown("none", duration=120.0)["chi_err"].loc[90.0:]

    assert np.abs(errors.to_numpy()).max() > math.radians(30.0)


def test_a_row_is_written_every_sample_with_a_unit_for_every_column():
    signals = flown("conditional", duration=10.0)

    assert len(signals) == 501
    assert signals.index.name == "t"
    assert signals.index[-1] == pytest.approx(10.0, abs=1e-12)
    assert set(LOOP_SIGNALS) <= set(signals.columns) <= set(SIGNAL_UNITS)
    assert np.isfinite(signals.to_numpy()).all()


def test_with_feed_forward_level_flight_needs_no_integral():
    climb = ft.loop.FlightCondition(V_a=25.0, gamma=0.3)

    signals, _ = simulated(
        reference=ft.loop.Reference(chi=0.0, gamma=0.3), condition=climb, feed_forward=True
    )

    assert np.abs(signals["n_z_integral"]).max() < 1e-12
    assert np.abs(signals["gamma_err"]).max() < 1e-12


class StopsAfterThreeSamples(ft.loop.PointMassPlant):
    """A plant that meets the ground in its third sample."""

    def start(self, condition):
        super().start(condition)
        self.left = 3

    def advance(self, phi_cmd, n_z_cmd, duration):
        self.left -= 1
        super().advance(phi_cmd, n_z_cmd, duration)
        return ft.loop.Stop("ground_contact", "hit the ground") if self.left == 0 else None


def test_a_flight_given_up_midway_frees_its_plant_at_once():
    plant, law = ft.loop.PointMassPlant(turn="paper"), ft.loop.MimoPI(ft.PAPER_GAINS, dt=0.02)
    flight = Flight(plant, law, PAPER_REFERENCE, PAPER_START, 10.0)
    next(flight.samples())
    kept = weakref.ref(plant)

    del flight, plant

    assert kept() is None


@pytest.mark.slow
@pytest.mark.parametrize("by_jsbsim", ["", "1"])
def test_a_flight_of_an_aircraft_leaves_nothing_that_python_must_look_for(monkeypatch, by_jsbsim):
    monkeypatch.setenv(JSBSIM, by_jsbsim)
    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    tables = ft.load_scenario("circuit").as_dict() | {"navigation": {"grade": "standard"}}
    tables["flight"] |= {"duration_s": 30.0}
    route = tables["route"]
    route["waypoint"] = [{"north_m": north, "east_m": 0.0} for north in (0.0, 150.0)]
    scenario = ft.scenario_from(tables)
    ft.fly(scenario)
    gc.collect()
    gc.disable()
    try:
        ft.fly(scenario)
        left = [x for x in gc.get_objects() if type(x) in (Flight, JSBSimPlant, DrawnErrors)]
    finally:
        gc.enable()

    assert left == []


def test_a_flight_that_ends_early_keeps_what_was_flown_and_its_reason():
    signals, stop = simulated(StopsAfterThreeSamples)

    assert len(signals) == 3
    assert stop == ft.loop.Stop("ground_contact", "hit the ground")


@pytest.mark.parametrize(("duration", "samples"), [(0.02, 2), (0.06, 4), (0.58, 30), (0.575, 30)])
def test_a_flight_has_a_sample_at_both_ends_of_its_nearest_whole_number(duration, samples):
    """Over 0.02, 0.58 is a little less than 29 in binary."""
    assert len(flown("conditional", duration)) == samples


def test_commands_are_planned_for_the_rates_of_each_lag_later_at_the_path_angle():
    turn = Segment(0.1, (0.0, 2.0), rates=(0.2,), roll_in=0.2)
    reference = ft.loop.Reference(
        chi=0.0, gamma=0.3, chi_segments=(turn,), gamma_segments=(replace(turn, rates=(0.05,)),)
    )
    plant, law = ft.loop.PointMassPlant(turn="paper"), ft.loop.MimoPI(ft.PAPER_GAINS, dt=0.02)
    start = ft.loop.FlightCondition(V_a=25.0, gamma=0.3, phi=0.2)
    flight = Flight(plant, law, reference, start, 1.0, None, (0.16, 0.04))

    measured, ref, *_ = next(flight.samples())

    # the mean of a rate over 0.2 s grows evenly, from 0.1 s before its beginning on
    chi_dot, gamma_dot = 0.2 * (0.16 / 0.2), 0.05 * (0.04 / 0.2)
    assert (ref.chi_dot, ref.gamma_dot) == pytest.approx((chi_dot, gamma_dot))
    per_g = 25.0 / ft.loop.Reference(chi=0.0, gamma=0.0).g
    lift = math.cos(0.3) + gamma_dot * per_g
    assert ref.planned == pytest.approx((math.atan(chi_dot * per_g), lift / math.cos(measured.phi)))


@pytest.mark.parametrize("duration", [0.0, 0.01, math.nan, math.inf])
def test_a_flight_lasts_at_least_one_sample(duration):
    with pytest.raises(ft.InputError, match="`duration`"):
        simulated(duration=duration)


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["jsbsim:aerosonde", "kinematic"])
def test_a_law_sees_pitch_and_elevator_of_an_airframe(plant):
    seen = []

    class Looks:
        dt, signals = 0.02, {}

        def __init__(self, setup):
            pass

        def start(self, condition):
            pass

        def step(self, measured, reference, t):
            seen.append((measured.theta, measured.elevator))
            return 0.2, 1.1

    changes = {"flight.duration_s": 1.0, "expect": []}
    flown = ft.fly(ft.load_scenario("paper", changes=changes), laws={"looks": Looks})

    (run,) = (x for x in flown.runs if x.label == f"{plant} / looks:paper")
    if plant == "kinematic":
        assert (None, None) in seen
    else:
        recorded = run.signals[["theta", "elevator"]].to_numpy()
        assert [x for x in seen if x[0] is not None] == list(map(tuple, recorded.tolist()))


START = ft.loop.FlightCondition(V_a=25.0, chi=2.5)
TURN = ft.loop.Reference(chi=2.5, gamma=0.1, chi_segments=(Segment(1.0, (0.0, 4.0), rates=(0.3,)),))
LIMITS = ft.loop.Limits(
    lower=[-0.8, -2.0], upper=[0.8, 2.0], rate_lower=[-0.5, -1.0], rate_upper=[0.5, 1.0]
)
NOISY = ft.loop.Sensors(bias=(0.02, -0.01, 1.0), noise_sd=(0.01, 0.02, 0.5), seed=3)
MICRORADIAN = 1e-6
SENSED = "chi", "gamma", "V_a"


def sensed(sensors, reference=TURN, limits=LIMITS, duration=8.0, **law):
    """What a flight from a course to a turn shows, where the law sees it through sensors."""
    law |= {"condition": START, "duration": duration, "sensors": sensors}
    return simulated(limits=limits, reference=reference, **law)[0]


def test_sensors_without_error_change_no_bit_of_what_was_there():
    perfect, alone = sensed(ft.loop.Sensors()), sensed(None)

    loop = [*LOOP_SIGNALS[:-2], *INTEGRAL_SIGNALS, *LOOP_SIGNALS[-2:]]
    assert list(alone.columns) == [*ft.loop.PointMassPlant(turn="paper").signals, *loop]
    assert perfect[list(alone.columns)].equals(alone)
    seen = [f"{name}_meas" for name in SENSED]
    assert [column for column in perfect if column not in alone] == seen


def test_errors_are_the_true_ones_and_what_was_seen_stands_beside_them():
    signals = sensed(NOISY)

    errors = NOISY.errors(len(signals), 0.02)
    for j, name in enumerate(SENSED):
        seen, true = (signals[column].to_numpy() for column in (f"{name}_meas", name))
        assert np.array_equal(seen, true + errors[:, j])
    apart = signals["chi_ref"] - signals["chi"]
    assert signals["chi_err"].tolist() == [math.remainder(angle, math.tau) for angle in apart]
    assert np.array_equal(signals["gamma_err"], signals["gamma_ref"] - signals["gamma"])


def test_the_controller_acts_on_what_it_sees():
    first = sensed(NOISY, limits=None).iloc[0]

    seen = [first[f"{c}_ref"] - first[f"{c}_meas"] for c in ("chi", "gamma")]
    assert [first["phi_cmd"], first["n_z_cmd"]] == pytest.approx(
        ft.PAPER_GAINS.K_P @ seen, rel=1e-12
    )


def test_integral_action_leaves_the_bias_as_the_true_error():
    sensors = ft.loop.Sensors(bias=(0.05, -0.03, 0.0))

    last = sensed(sensors, ft.loop.Reference(chi=2.6, gamma=0.1), duration=60.0).iloc[-1]

    assert [last["chi_err"], last["gamma_err"]] == pytest.approx([0.05, -0.03], abs=MICRORADIAN)


def test_a_schedule_goes_by_the_airspeed_that_was_measured():
    sensors = ft.loop.Sensors(bias=(0.0, 0.0, 5.0))
    fast, true = (
        sensed(one, ft.loop.Reference(chi=2.6, gamma=0.1), limits=None, schedule_speed=25.0).iloc[0]
        for one in (sensors, None)
    )

    assert fast["phi_cmd"] == pytest.approx(true["phi_cmd"] * 30.0 / 25.0, rel=1e-12)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system has no such call")
def test_cores_are_those_that_this_process_may_use():
    allowed = os.sched_getaffinity(0)
    assert cores() == len(allowed)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        assert cores() == 1
    finally:
        os.sched_setaffinity(0, allowed)
