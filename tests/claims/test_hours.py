"""The flights of a claim per flight hour: what they draw, and how each is ended, one by one."""

import math

import numpy as np
import pytest
from flown_campaigns import flown_here
from forging import changed
from small_claims import BESIDE_M, LEG_M, STRAIGHT, stated_hours, stated_term

import flighttune as ft

WINDOW_S = 10.0  # the longest of the flights that are stated
RECEIVER, AIRFRAME = "navigation.fault.", "plant.airframe.fault."


def hours_with(path, fault, ending=None, flights=6, ended_s=None, **tables):
    """The claim of a file whose only fault and whose ending are these."""

    def change(x):
        own = {"kind": "engine", "per_hour": 1e-3, "source": "a log", "flights": flights} | fault
        x["rates"] |= {"fault": [own], "ending": {"kind": "cut"} | (ending or {})}
        if ended_s is not None:
            own["ended_s"] = ended_s
        x["terms"] = [stated_term(8), stated_term(flights, 0, ended_s)]
        x.update(tables)

    return ft.load(changed(stated_hours(), path / "x.json", change))


# A fault of the file of rates, what its flights draw (key: range), and what is the same in all.
TRAVEL = -25.0, 25.0  # of each surface of the Aerosonde, in its aircraft.toml
DRAWN = [
    ({"kind": "engine"}, {}, {"throttle_factor": 0.01}),
    ({"kind": "aileron_stuck"}, {"aileron_stuck_deg": TRAVEL}, {}),
    ({"kind": "elevator_stuck", "stuck_deg": [-5.0, 3.0]}, {"elevator_stuck_deg": (-5.0, 3.0)}, {}),
    ({"kind": "rudder_stuck"}, {"rudder_stuck_deg": TRAVEL}, {}),
    ({"kind": "actuator_slow", "factor": [2.0, 4.0]}, {"actuator_lag_factor": (2.0, 4.0)}, {}),
    ({"kind": "airspeed_wrong", "bias_mps": [-2.0, 1.0]}, {"V_a_bias_mps": (-2.0, 1.0)}, {}),
    ({"kind": "receiver_jump", "jump_m": [5.0, 9.0]},
     {"jump_m": (5.0, 9.0), "course_deg": (-180.0, 180.0)}, {}),
    ({"kind": "receiver_lost", "drift_mps": [0.1, 0.5]},
     {"drift_mps": (0.1, 0.5), "course_deg": (-180.0, 180.0)}, {}),
    ({"kind": "link_lost"}, {}, {}),
]  # fmt: skip


@pytest.mark.parametrize(("fault", "ranges", "same"), DRAWN)
def test_a_fault_is_drawn_at_any_time_of_the_flight_and_of_any_size(fault, ranges, same, tmp_path):
    hourly = hours_with(tmp_path, fault)
    plan = hourly.flights_of(hourly.terms[1]).plan.with_runs(200)
    prefix = RECEIVER if fault["kind"].startswith("receiver") else AIRFRAME
    wanted = {f"{prefix}{key}": ends for key, ends in ranges.items()}
    wanted[f"{prefix}from_s"] = 0.0, WINDOW_S

    drawn = plan.parameters()

    assert {key for key in drawn if ".fault." in key} == {*wanted}
    for key, (low, high) in wanted.items():
        margin = 0.05 * (high - low)
        assert low <= drawn[key].min() < low + margin
        assert high - margin < drawn[key].max() <= high
    tables = plan.scenario_of(7).as_dict()
    of = tables["navigation"] if prefix == RECEIVER else tables["plant"][-1]["airframe"]
    given = {key.removeprefix(prefix): drawn[key][7] for key in wanted} | same
    assert {key: of["fault"][key] for key in given} == pytest.approx(given)
    assert "ending" not in tables["route"]


def test_flights_of_each_term_have_draws_of_their_own():
    hourly = ft.load(stated_hours())
    seeds = [hourly.flights_of(term).plan.campaign.seed for term in hourly.terms]
    assert seeds == [hourly.flights.campaign.seed + i for i in range(3)]
    for term in hourly.terms:
        again = hourly.flights_of(term).plan.with_runs(2).parameters()
        assert (again.iloc[0] != again.iloc[1]).any()


MANOEUVRES = {"turn_back": "turn_back", "circle": "circle", "glide": "straight"}


def longest_after(kind):
    """Length of the path from where it leaves the route, m: of ends of the route to either side."""
    lengths = []
    for at_m in (0.0, LEG_M):
        for side in (-1, 1):
            ending = {"kind": kind, "at_m": at_m, "side": side}
            there = ft.route("circuit", changes=STRAIGHT | {"route.ending": ending})
            lengths.append(there.reference.path.length - at_m)
    return max(lengths)


@pytest.mark.parametrize("how", ["cut", "parachute", *MANOEUVRES])
def test_flights_can_end_as_they_are_to(how, tmp_path):
    keys = {"opens_s": 1.0, "sink_mps": 5.0} if how == "parachute" else {}
    hourly = hours_with(tmp_path, {}, {"kind": how, **keys}, ended_s=0.5)
    plain = hourly.flights_of(hourly.terms[0]).plan
    plan = hourly.flights_of(hourly.terms[1]).plan.with_runs(60)

    drawn, tables = plan.parameters(), plan.scenario_of(0).as_dict()
    fault = tables["plant"][-1]["airframe"]["fault"]
    assert fault["ended_by"] == ("thrust" if how == "glide" else "cut")
    assert (f"{AIRFRAME}ended_s" in drawn) == (how in ("cut", "glide"))
    assert fault.get("ended_s", 1e6) == 1e6  # until it is known, none is ended
    assert plain.scenario.as_dict()["route"].get("ending") is None
    longer = plan.scenario.flight.duration_s - plain.scenario.flight.duration_s
    if how in MANOEUVRES:
        assert tables["route"]["ending"]["kind"] == MANOEUVRES[how]
        assert {*drawn["route.ending.side"]} == {-1, 1}
        assert longer == 2.0 * math.ceil(longest_after(MANOEUVRES[how]) / 25.0)
        assert hourly.exposure.beyond_s == pytest.approx(longer)
    else:
        assert "ending" not in tables["route"]
        assert longer == hourly.exposure.beyond_s == 0.0


def test_flights_end_by_an_alarm_as_by_a_fault(tmp_path):
    model = {"name": "airspeed", "target": "V_a", "terms": ["1"], "weights": [25.0]}
    alarms = {"models": [model], "middle": [0.0], "half": [1.0]}
    ending = {"kind": "turn_back", "monitor": "m.npz"}
    hourly = hours_with(tmp_path, {}, ending, alarms=alarms)

    for term in hourly.terms:  # also without a fault, and without a time after it
        assert hourly.flights_of(term).plan.scenario.route.ending.kind == "turn_back"
    assert hourly.exposure.beyond_s > 0.0


# ---------------------------------------------------------------- times of flights
def times(left, end, ended_at):
    return {"left_s": left, "end_s": end, "ended_at_s": ended_at}


def test_times_are_those_that_a_plan_can_have(tmp_path):
    """A flight is ended 0.5 s after the fault that it draws, if it lasts so long."""
    hourly = hours_with(tmp_path, {}, flights=3, ended_s=0.5)
    flights = hourly.flights_of(hourly.terms[1])
    at = (flights.plan.with_runs(3).parameters()[f"{AIRFRAME}from_s"] + 0.5).tolist()
    cap = flights.plan.scenario.flight.duration_s

    def refused(end, ended_at):
        stated = stated_term(3, 0, 0.5) | times([-1.0] * 3, end, ended_at)
        other = hours_with(tmp_path, {}, flights=3, ended_s=0.5,
                           terms=[stated_term(8), stated])  # fmt: skip
        try:
            other.flights_of(other.terms[1]).check_times(other.terms[1])
        except ft.InputError as error:
            return str(error)
        return ""

    ends = [11.0] * 3
    window = max(hourly.terms[0].end_s)
    assert window == WINDOW_S
    assert refused(ends, at) == ""
    assert refused([at[0], 11.0, 11.0], at) == ""  # at its last sample
    assert refused([at[0] - 0.01, 11.0, 11.0], [-1.0, *at[1:]]) == ""
    assert f"got {at[2] + 0.02:g} s of flight 2" in refused(ends, [*at[:2], at[2] + 0.02])
    assert "got -1 s of flight 1" in refused(ends, [at[0], -1.0, at[2]])
    assert f"got {cap + 1.0:g} of flight 1" in refused([11.0, cap + 1.0, 11.0], at)
    assert refused([11.0, cap, 11.0], at) == ""


def test_a_term_counts_the_flights_that_left_and_those_that_were_ended(tmp_path):
    stated = stated_term(4, 0, 0.5)
    stated |= times([0.0, -1.0, 3.0, -1.0], [9.0] * 4, [0.0, 2.0, -1.0, 9.0])
    hourly = hours_with(tmp_path, {}, flights=4, ended_s=0.5, terms=[stated_term(8), stated])
    term = hourly.terms[1]
    assert (term.count.outside, term.count.flights, term.ended, len(term)) == (2, 4, 3, 4)
    for bad in ([9.1, -1.0, 0.0, 0.0], [-0.5, -1.0, 0.0, 0.0]):
        with pytest.raises(ft.InputError, match=rf"got {bad[0]:g} and 0 of flight 0"):
            hours_with(tmp_path, {}, flights=4, ended_s=0.5,
                       terms=[stated_term(8), stated | {"left_s": bad}])  # fmt: skip


# ---------------------------------------------------------------- flights, one by one
def outside_at(run):
    """First look, 0.1 s apart and at the end, at which a flight is beside the fence or behind."""
    looks = np.unique([*range(0, len(run.t), 2), len(run.t) - 1])  # of 20 Hz
    north, east = run.signals["north"].to_numpy()[looks], run.signals["east"].to_numpy()[looks]
    out = (np.abs(east) > BESIDE_M) | (north < -100.0) | (north > 250.0)
    return float(run.t[looks][out.argmax()]) if out.any() else -1.0


def flown_alone(flights, number, after_s):
    """A flight of a term, flown as a flight of its own until its ending and then as it ends."""
    plan, how, at = flights.plan.with_runs(number + 1), flights.leaving.how, -1.0
    values = plan.values_of(number)
    ends = values.get(f"{AIRFRAME}from_s", math.inf) + after_s
    (run,) = ft.fly(plan.dispersed(values, number)).runs
    if ends > run.t[-1] or -1.0 < outside_at(run) < ends:
        return run, ends if ends <= run.t[-1] else -1.0
    if how in ("cut", "glide"):
        values[f"{AIRFRAME}ended_s"] = ends
    if how in MANOEUVRES:
        at = np.interp(ends + flights.leaving.lead_s, run.t, run.signals["along"])
        values["route.ending.at_m"] = float(at)
    (run,) = ft.fly(plan.dispersed(values, number)).runs
    return run, ends


@pytest.mark.soak
@pytest.mark.parametrize("how", ["cut", "turn_back", "circle"])
def test_flights_are_ended_at_their_time_and_place(how, tmp_path):
    hourly = hours_with(tmp_path, {"kind": "aileron_stuck", "stuck_deg": [-0.5, 0.5]},
                        {"kind": how}, ended_s=0.5)  # fmt: skip
    for number, term in enumerate(hourly.terms):
        flights = hourly.flights_of(term)
        runs = [0, 2] if number == 0 else [1, 2, 4]
        with flown_here() as pool:
            assert flights.flown(pool, [], "none") == []
            found = flights.flown(pool, runs, "some")
        for run, of in zip(runs, found, strict=True):
            alone, ended = flown_alone(flights, run, 0.5)
            assert of.end_s == pytest.approx(alone.t[-1])
            assert of.ended_s == pytest.approx(ended)
            left = outside_at(alone)
            if left < 0.0 and alone.status != "completed":
                left = alone.t[-1]  # where its model ends: no fall is declared
            assert of.left_s == pytest.approx(left, abs=0.051)
