"""What fails in flight: nothing before its time, and by the stated amount from then on."""

import math

import pytest
from airframes import off_nominal
from made_up import made_up_scenario

import flighttune as ft

LEVEL = ft.loop.FlightCondition(V_a=25.0)
SAMPLE, FROM_S = 0.02, 0.2
ROUNDING = 1e-9
FULL_THRUST = 120.0  # N, of the Aerosonde's ideal motor: aircraft/aerosonde/README.md


def flown(samples, **fault):
    """Signals at each sample of a plant, and its aircraft at the end."""
    off = off_nominal(fault={"from_s": FROM_S, **fault}) if fault else None
    plant = ft.loop.JSBSimPlant("aerosonde", off_nominal=off)
    plant.start(LEVEL)
    rows = []
    for _ in range(samples):
        rows.append(dict(zip(plant.signals, plant.observe(), strict=True)))
        plant.advance(0.0, 1.0, SAMPLE)
    return [*rows, dict(zip(plant.signals, plant.observe(), strict=True))], plant.fdm


FAULTS = [
    {"lift_factor": 0.8},
    {"drag_factor": 1.5},
    {"throttle_factor": 0.06},
    {"actuator_lag_factor": 4.0},
    {"cg_aft_m": 0.025},
    {"aileron_stuck_deg": 5.0},
    {"V_a_bias_mps": -4.0},
    {"lift_factor": 0.8, "ended_s": 0.3},
    {"drag_factor": 1.5, "ended_s": 0.3, "ended_by": "thrust"},
]


@pytest.mark.parametrize("fault", FAULTS, ids=" ".join)
def test_a_fault_changes_nothing_before_its_time(fault):
    healthy, _ = flown(11)
    rows, _ = flown(11, **fault)

    for before, row in zip(healthy[:11], rows[:11], strict=True):
        assert list(row.values()) == pytest.approx(list(before.values()), abs=ROUNDING)
    assert list(rows[11].values()) != pytest.approx(list(healthy[11].values()), abs=ROUNDING)


def test_lift_and_thrust_are_the_stated_share():
    rows, _ = flown(11, lift_factor=0.8)
    assert rows[11]["n_z"] / rows[10]["n_z"] == pytest.approx(0.8, abs=0.01)  # thrust helps lift

    rows, _ = flown(12, throttle_factor=0.06)
    assert rows[12]["thrust"] == pytest.approx(0.06 * FULL_THRUST * rows[12]["throttle"], rel=0.05)


def test_the_centre_of_gravity_moves_and_the_mass_stays():
    (_, before), (_, after) = flown(5, cg_aft_m=0.025), flown(11, cg_aft_m=0.025)

    moved = after.reader("inertia/cg-x-in")() - before.reader("inertia/cg-x-in")()
    assert moved * 0.0254 == pytest.approx(0.025, rel=1e-9)
    # before it moves the part that slides changes nothing
    for name in ("weight-lbs", *(f"i{x}-slugs_ft2" for x in ("xx", "yy", "zz", "xz"))):
        values = [fdm.reader(f"inertia/{name}")() for fdm in (before, flown(1)[1], after)]
        assert values[:2] == pytest.approx(values[1:2] * 2, rel=1e-9)
        assert (values[2] == pytest.approx(values[1], rel=1e-9)) == (name[:2] in ("we", "ix"))


def test_a_surface_is_stuck_where_it_is_said_and_actuators_are_as_slow_as_said():
    rows, _ = flown(30, aileron_stuck_deg=5.0)
    assert [row["aileron"] for row in rows[12:]] == pytest.approx([math.radians(5.0)] * 19)

    _, fdm = flown(11, actuator_lag_factor=4.0)
    assert fdm.reader("ft/fault/actuator_rate")() == 25.0 / 4.0


@pytest.mark.parametrize("ended_by", ["cut", "thrust"])
def test_an_end_closes_the_throttle_and_a_cut_moves_what_is_not_stuck_to_its_stop(ended_by):
    ended = {"ended_s": 0.3, "ended_by": ended_by}
    rows, _ = flown(17, aileron_stuck_deg=5.0, **ended)
    free, _ = flown(17, V_a_bias_mps=0.1, **ended)

    assert rows[14]["thrust"] > 5.0
    assert rows[-1]["thrust"] == free[-1]["thrust"] == 0.0
    # up is negative; stops of aircraft/aerosonde/aircraft.toml
    stops = {"aileron": 25.0, "elevator": -25.0, "rudder": 25.0}
    for name, stop in stops.items():
        at = [math.degrees(of[-1][name]) for of in (rows, free)]
        stuck = 5.0 if name == "aileron" else stop
        if ended_by == "cut":
            assert at == pytest.approx([stuck, stop])
        else:
            assert max(map(abs, at)) < 20.0


@pytest.mark.parametrize("factor", [1.5, 2.0])
def test_actuators_of_varied_aircraft_have_their_own_lag_before_and_after_a_fault(factor):
    for other in (1.2, factor):  # one after the other in a process
        fault = {"from_s": FROM_S, "actuator_lag_factor": 4.0}
        off = off_nominal(actuator_lag_factor=other, fault=fault)
        plant = ft.loop.JSBSimPlant("aerosonde", off_nominal=off)
        plant.start(LEVEL)
        rate = plant.fdm.reader("ft/fault/actuator_rate")
        before = rate()
        for _ in range(11):
            plant.advance(0.0, 1.0, SAMPLE)

        assert (before, rate()) == pytest.approx((25.0 / other, 25.0 / other / 4.0), rel=1e-12)


@pytest.mark.soak
def test_an_airspeed_sensor_that_reads_low_makes_the_aircraft_fly_as_much_too_fast():
    """The inner loop holds what it measures, and the law is told the same airspeed."""
    bias, from_s = -3.0, 1.0
    airframe = {"fault": {"from_s": from_s, "V_a_bias_mps": bias}}
    plant = {"kind": "jsbsim", "aircraft": "aerosonde", "airframe": airframe}
    flight = {"V_a_mps": 25.0, "duration_s": 40.0}
    (run,) = ft.fly(made_up_scenario(law=["exact"], flight=flight, plant=[plant])).runs

    told = run.signals["V_a_meas"] - run.signals["V_a"]
    assert told[run.t < from_s - 1e-9].tolist() == [0.0] * int((run.t < from_s - 1e-9).sum())
    assert told[run.t >= from_s - 1e-9].to_numpy() == pytest.approx(bias, abs=ROUNDING)
    assert run.signals["V_a"].iloc[-1] == pytest.approx(25.0 - bias, abs=0.1)


def test_a_surface_that_an_aircraft_has_not_is_refused():
    off = off_nominal(fault={"from_s": 1.0, "rudder_stuck_deg": 1.0})
    with pytest.raises(ft.InputError, match=r"`rudder_stuck_deg` .* left out: .*x8"):
        ft.loop.JSBSimPlant("x8", off_nominal=off)
