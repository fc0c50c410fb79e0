"""Declared rates of faults, flights that leave a volume, and the claim per flight hour."""

import math
import re
import shutil
from dataclasses import replace
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest
from flown_campaigns import flown_here
from forging import Opened
from made_up_band import count_of
from made_up_hours import SHORT, fence_around, made_up_hours, short_plan
from scipy import stats

import flighttune as ft
from flighttune.base.files import code
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.rows import scenario_of_run
from flighttune.claims import counting, hourly_flights, mission, per_hour, rates_keys
from flighttune.claims.counted_flights import turning_back
from flighttune.claims.leaving import NEVER, Alarms, Left, Volume
from flighttune.claims.turn_back import TurnBack
from flighttune.flight.route import planned_route
from flighttune.gaps.watch import SignalModel
from flighttune.outputs.answers import per_hour as answers
from flighttune.routes.volumes import CONTINGENCY

FAULT = 'kind = "engine"\nper_hour = 1e-3\nsource = "a log"\n'
STUCK = 'kind = "rudder_stuck"\nper_hour = 1e-3\nsource = "a log"\n'

# Routes that climb, and come back near their start, turning right and left.
RIGHT, LEFT = (
    {
        "route.waypoint": [
            {"north_m": n, "east_m": side * e, "up_m": up}
            for n, e, up in ((0, 0, 0), (2400, 0, 20), (2400, 2400, 20), (50, 2400, 0))
        ]
    }
    for side in (1.0, -1.0)
)


@pytest.mark.parametrize(
    ("fault", "line"),
    [
        (FAULT.replace("engine", "wing"), r"`kind` must be one of engine, aileron_stuck"),
        (FAULT.replace("per_hour", "rate"), r"`rate`"),
        (FAULT.replace("1e-3", "1.5"), r"`per_hour` must be less than or equal to 1, got 1.5"),
        (FAULT.replace('source = "a log"\n', ""), r"`source`"),
        (FAULT + "factor = [2.0, 4.0]\n", r"`factor` must be absent for the fault engine"),
        (FAULT + "detected_s = 3.0\nended_s = 2.0\n", r"`ended_s` must be at least `detected_s`"),
        (FAULT + "detected_s = 3.0\n", r"`ended_s` must be given beside `detected_s`"),
        (FAULT.replace("engine", "receiver_jump"), r"`jump_m` must be given for the fault"),
        (
            FAULT.replace("engine", "aileron_floating"),
            r"hinge moments.*; declare aileron_stuck, got",
        ),
        (FAULT + 'ending = "circle"\n', r"`ending` must be absent without `ended_s` and without"),
        (
            FAULT + 'ended_s = 2.0\nending = "land"\n',
            r"`ending` must be 'cut', 'parachute', 'turn_back'",
        ),
        (FAULT + "[ending]\nafter_alarm_s = 2.0\n", r"`after_alarm_s` must be absent without a"),
        (FAULT + "[ending]\nsink_mps = 5.0\n", r"`sink_mps` must be absent without a parachute"),
        (
            FAULT + 'ended_s = 2.0\nending = "parachute"\n[ending]\nsink_mps = 5.0\n',
            r"`opens_s` of \[ending\] must be given for a parachute",
        ),
    ],
)
def test_a_bad_fault_is_refused_in_one_line(tmp_path, fault, line):
    file = tmp_path / "rates.toml"
    file.write_text(f"[[fault]]\n{fault}")
    with pytest.raises(ft.ScenarioError, match=line) as refused:
        rates_keys.load_rates(file)
    assert "\n" not in str(refused.value)
    assert str(file) in str(refused.value)


def rates(**fault):
    stated = {"kind": "engine", "per_hour": 0.1, "source": "a log", "flights": 6, **fault}
    return rates_keys.RatesTable.model_validate({"flights": 8, "fault": [stated]})


@pytest.mark.parametrize(
    ("own", "words"), [({}, "glide after 5 s"), ({"ending": "turn_back"}, "turn back after 5 s")]
)
def test_a_fault_names_what_is_flown_then(own, words):
    stated = rates(ended_s=5.0, **own).model_dump(exclude_none=True)
    table = rates_keys.RatesTable.model_validate({**stated, "ending": {"kind": "glide"}})
    assert table.name_of(0, 5.0) == f"engine, {words}"
    assert table.name_of(None, None) == "healthy flight"


@pytest.mark.slow
def test_an_aircraft_without_a_rudder_cannot_have_it_stuck():
    stated = ft.flights("circuit_in_wind_x8").knowing(None)
    plan = counting.drawn(stated)
    with pytest.raises(ft.InputError, match="rudder_stuck: it has no rudder"):
        hourly_flights.check_rates(plan, rates(kind="rudder_stuck"))


@pytest.mark.slow
def test_a_surface_cannot_be_stuck_beyond_its_travel():
    plan = short_plan()
    for range_deg in ([0.0, 40.0], [-40.0, 0.0]):
        stuck = rates(kind="aileron_stuck", stuck_deg=range_deg)
        with pytest.raises(ft.InputError, match=r"`stuck_deg` of aileron_stuck must lie in the tr"):
            hourly_flights.check_rates(plan, stuck)
    faulty = short_plan({**SHORT, "plant.airframe.fault": {"from_s": 2.0}})
    with pytest.raises(ft.InputError, match="without a fault of their own"):
        hourly_flights.check_rates(faulty, rates())


@pytest.mark.parametrize(
    ("kind", "of_faults"), [("glide", [{}]), ("glide", ["circle"]), ("cut", ["circle", "glide"])]
)
def test_a_law_that_does_not_hold_the_airspeed_cannot_glide(kind, of_faults):
    (fault,) = rates().model_dump(exclude_none=True)["fault"]
    faults = [
        {**fault, "kind": name, **({"ending": how, "ended_s": 2.0} if how else {})}
        for name, how in zip(("engine", "link_lost"), of_faults, strict=False)
    ]
    table = rates_keys.RatesTable.model_validate({"fault": faults, "ending": {"kind": kind}})
    with pytest.raises(ft.InputError, match="`speed_priority` must be true"):
        hourly_flights.check_rates(short_plan(), table)


def box(half):
    corners = ((-half, -half), (half, -half), (half, half), (-half, half))
    return Volume(rings=(corners,), outside=(False,), low=None, high=50.0)


def square(half):
    """The fence of such a volume, around the start of the short route."""
    return fence_around(half, ends=(-half, half), top=50.0)


def test_margins_are_distances_to_the_sides_and_the_top():
    places = np.array([[0.0, 0.0, 0.0], [90.0, 0.0, 60.0], [120.0, 0.0, 0.0]])
    assert box(100.0).margins(places)[:, :2] == pytest.approx(
        np.array([[100.0, 50.0], [10.0, -10.0], [-20.0, 50.0]])
    )


@pytest.mark.soak
def test_flights_in_a_wide_volume_stay_and_in_a_narrow_one_all_leave(tmp_path):
    with flown_here():
        wide, narrow = (
            per_hour.count_per_hour(
                short_plan(), rates(), fence=square(half), confidence=0.9, fliers=Fliers(workers=1)
            )
            for half in (1e4, 100.0)
        )
    # From the middle of the box, the route of 300 m leaves it after 100 m: 3.0 to 6.0 s at 25 m/s
    # over ground in up to 8 m/s of wind.
    assert wide.terms[0].count.outside == 0
    assert narrow.terms[0].count.outside == 8
    assert all(3.0 < left < 6.0 for left in narrow.terms[0].left_s)
    assert narrow.bound.total > wide.bound.total

    file = tmp_path / "hours.json"
    narrow.save(file)
    loaded = per_hour.load_per_hour(file)
    assert loaded.bound == narrow.bound
    with flown_here():
        assert ft.verify(file, count=2, workers=1).valid

    opened = Opened.of(file)
    opened.tables["terms"][0]["left_s"] = [-1.0] * 8
    opened.write(file, anew=True)
    with flown_here():
        verified = ft.verify(file, count=8, workers=1)
    assert not verified.valid
    assert "healthy flight must be as JSBSim flies it again" in verified.reason


def test_flights_fewer_than_stated_are_refused(tmp_path):
    made_up_hours(40.0).save(file := tmp_path / "hours.json")
    opened = Opened.of(file)
    for times in ("left_s", "end_s", "ended_at_s"):
        opened.tables["terms"][0][times].pop()
    opened.write(file, anew=True)
    with pytest.raises(ft.ScenarioError, match="`terms` must be the flights that `rates` states"):
        per_hour.load_per_hour(file)


def test_a_file_of_0_5_0_is_told_in_a_line_to_be_made_again(tmp_path):
    made_up_hours(40.0).save(file := tmp_path / "hours.json")
    opened = Opened.of(file)
    del opened.tables["sha256"], opened.tables["fence"], opened.tables["around"]
    opened.tables["format"] = "flighttune flight hours 1"
    opened.write(file, anew=False)
    with pytest.raises(ft.ScenarioError, match=r"`format` must be .*; make the file again") as old:
        ft.verify(file)
    assert "\n" not in str(old.value)


def ends(how, alarms=None, **fault):
    stated = rates(kind="link_lost", **fault).model_dump(exclude_none=True)
    table = rates_keys.RatesTable.model_validate(
        {**stated, "ending": {"kind": how, "fall_per_height": 0.0}}
    )
    return hourly_flights.Ends(plan=short_plan(), rates=table, volume=box(1e4), alarms=alarms)


@pytest.mark.slow
def test_a_flight_that_turns_back_is_the_same_to_the_bit_until_it_is_ended():
    flights = ends("turn_back", ended_s=2.0).term(0, 2.0, 6.0)
    with flown_here() as pool:
        (flown,) = flights.flown(pool, [0], "counting")
    drawn = flights.plan.values_of(0)
    assert flown.ended_s == drawn["plant.airframe.fault.from_s"] + 2.0
    on, back = (
        ft.fly(scenario_of_run(flights.plan, 0, {**drawn, **ending})).runs[0]
        for ending in ({}, {"route.ending.at_m": flown.at_m})
    )
    before = on.t <= flown.ended_s
    assert back.signals[: before.sum()].equals(on.signals[before])
    # It rolls in at once, and flies back to its start; a route of 300 m is too short to settle on.
    assert back.signals["phi"].loc[flown.ended_s : flown.ended_s + 2.0].abs().max() > 0.1
    assert np.hypot(*back.signals[["north", "east"]].iloc[-1]) < 10.0
    assert flown.end_s == back.t[-1]


@pytest.mark.parametrize("how", ["turn_back", "circle"])
@pytest.mark.parametrize("legs", [SHORT, RIGHT, LEFT])
def test_a_flight_has_time_for_its_ending_from_every_place(how, legs):
    """Twice the time in still air, also where turning to one side takes longest."""
    flights = replace(ends(how, ended_s=2.0), plan=short_plan(legs))
    planned = flights.term(0, 2.0, 6.0).plan.scenario
    given = planned.flight.duration_s - flights.plan.scenario.flight.duration_s
    path, tables = planned_route(flights.plan.scenario).reference.path, planned.as_dict()

    lengths = []
    for at_m in np.linspace(0.0, path.length, 7).tolist():
        for side in (-1, 1):
            tables["route"]["ending"] |= {"at_m": at_m, "side": side}
            ended = planned_route(ft.scenario_from(tables)).reference.path.length - at_m
            assert given >= 1.9 * ended / 25.0, (at_m, side)  # 2 to a twentieth between places
            lengths.append(ended)
    assert given <= 2.1 * max(lengths) / 25.0 + 2.0


@pytest.mark.soak
@pytest.mark.parametrize("how", ["cut", "circle"])
def test_the_first_alarm_of_a_monitor_ends_any_flight(how):
    # A made-up monitor that expects an airspeed of 25 m/s to a thousandth: it alarms soon.
    model = SignalModel(name="airspeed", target="V_a", terms=("1",), weights=(25.0,))
    alarms = Alarms(models=(model,), middle=(0.0,), half=(1e-3,))
    healthy = ends(how, alarms).term(None, None, 0.0)
    with flown_here() as pool:
        (flown,) = healthy.flown(pool, [0], "counting")
    assert 0.0 <= flown.ended_s < 2.0
    # After a cut the aircraft leaves its envelope within seconds; two circles take longer.
    assert flown.end_s < 10.0 if how == "cut" else flown.end_s > 20.0


def test_a_monitor_is_a_file_of_flights_of_the_aircraft(tmp_path):
    file = tmp_path / "rates.toml"
    file.write_text(f'[ending]\nmonitor = "none.npz"\n[[fault]]\n{FAULT}')
    with pytest.raises(ft.InputError, match=r"none\.npz"):
        ft.mission("circuit_in_wind", changes=SHORT, turn_back=30.0, rates=file)


@pytest.mark.parametrize(("alarms", "early", "shortest_s"), [(False, 2, 90.0), (True, 10, 90.0)])
def test_a_few_flights_that_end_early_do_not_shorten_the_exposure(alarms, early, shortest_s):
    ends = tuple([5.0] * early + [90.0] * (200 - early))
    inside = (-1.0,) * 200
    healthy = hourly_flights.FlownTerm(
        fault=None, ended_s=None, left_s=inside, end_s=ends, ended_at_s=inside
    )
    struck = hourly_flights.FlownTerm(
        fault=0, ended_s=None, left_s=inside, end_s=ends, ended_at_s=inside
    )
    stated = rates(flights=200).model_copy(update={"flights": 200})
    hourly = per_hour.PerHour(
        rates=stated.model_dump(mode="json", exclude_none=True),
        confidence=0.9,
        plan={"nominal": {"flight": {"duration_s": 100.0}}},
        volume=box(1e4),
        alarms=Alarms(models=(), middle=(), half=()) if alarms else None,
        terms=(healthy, struck),
    )
    assert hourly.exposure.shortest_s == shortest_s
    # No flight left: p is bounded by 1 - alpha^(1/n) in closed form, alpha shared by four counts.
    p = 1.0 - (0.1 / 4) ** (1 / 200)
    hours = hourly.bound.hours
    assert hourly.bound.healthy == pytest.approx(p / hours, rel=1e-9)
    assert 0.8 * 90.0 < 3600.0 * hours < 90.0


def test_the_answer_names_the_latest_time_and_every_kind_of_fault():
    assert {*answers.FAULTS} == {*rates_keys.KINDS}
    assert {*answers.ENDINGS} == {*get_args(rates_keys.HowEnded)}
    inside, two_left = (-1.0,) * 300, (-1.0,) * 200 + (4.0,) * 100
    numbers = {"end_s": (90.0,) * 300, "ended_at_s": inside}
    healthy = hourly_flights.FlownTerm(fault=None, ended_s=None, left_s=inside, **numbers)
    struck = hourly_flights.FlownTerm(fault=0, ended_s=1.0, left_s=inside, **numbers)
    later = hourly_flights.FlownTerm(fault=0, ended_s=3.0, left_s=two_left, **numbers)
    stated = rates(kind="aileron_stuck", per_hour=1.0, ended_s=1.0, flights=300)
    stated = stated.model_copy(update={"flights": 300, "target_per_hour": 0.9})
    hourly = per_hour.PerHour(
        rates=stated.model_dump(mode="json", exclude_none=True),
        confidence=0.9,
        plan={"nominal": {"flight": {"duration_s": 100.0}}},
        volume=box(1e4),
        terms=(healthy, struck),
        later=(replace(struck, ended_s=2.0), later),
    )
    said = " ".join(hourly.answer().summary)
    assert "The target holds if a flight is ended within 2 s of a stuck aileron." in said

    assert "declared" not in " ".join(answers.endings(hourly))  # none was ended
    falls = {**hourly.rates, "ending": {"kind": "cut", "fall_per_height": 1.5}}
    cut = replace(struck, ended_at_s=(5.0,) * 300)
    hourly = replace(hourly, rates=falls, terms=(healthy, cut))
    assert answers.endings(hourly)[1] == (
        "An aircraft that falls comes down 1.5 m away per metre of height, as declared."
    )
    chute = {"kind": "parachute", "opens_s": 2.0, "sink_mps": 5.0}
    sinks = answers.endings(replace(hourly, rates={**falls, "ending": chute}))
    assert sinks[1:] == ["The parachute opens after 2 s and sinks by 5 m/s, as declared."]
    plain = {**falls, "ending": {"kind": "cut"}}
    assert len(answers.endings(replace(hourly, rates=plain))) == 1
    falls["ending"] |= {"monitor": "m.npz", "after_alarm_s": 2.0}
    watched = replace(hourly, rates=falls, alarms=Alarms(models=(), middle=(), half=()))
    assert (
        answers.endings(watched)[-1]
        == "A flight is ended 2 s after the first alarm of the monitor."
    )
    # Faults begin within the longest flight, and the mean flight has a bound below the shortest.
    said = " ".join(answers.notes(hourly))
    assert "begins at any time of the first 90 s, and a flight lasts 8" in said


def test_without_a_fence_the_volume_is_the_room_around_the_route_and_not_the_hole_within():
    # a loop that is wider than twice the room, 100 m above the ground
    planned = ft.route("circuit", changes={"flight.ground_m": 900.0})
    path, (band, room) = planned.reference.path, (SimpleNamespace(claims=True) for _ in "ab")
    band.flights = SimpleNamespace(route=planned, central=planned.scenario)
    around = SimpleNamespace(width=30.0, high=40.0)
    room.volumes = lambda _: {"geography": None, CONTINGENCY: around, "buffer": None}
    odds = SimpleNamespace(band=band, room=room)

    said = mission.around_of(odds)
    volume = Volume.around(planned.where, planned.scenario.flight.ground_m, said)

    assert (said.width_m, said.high_m) == (30.0, 40.0)

    at = path.beside(path.points(200.0))[:, :3]
    off = [[-25.0, 0.0, 0.0], [-35.0, 0.0, 0.0], [*at[:, :2].mean(axis=0), 0.0]]
    beside = volume.margins(np.vstack([np.column_stack([at[:, :2], np.zeros(len(at))]), off]))
    assert (beside[: len(at), 0] > 25.0).all()
    inside, outside, hole = beside[-3:, 0]
    assert inside > 0.0 > max(outside, hole)
    ground, start = planned.scenario.flight.ground_m, planned.scenario.flight.h_m
    assert (ground, start) == (900.0, 1000.0)
    assert volume.high == pytest.approx(40.0 - 100.0)
    for lacking in ({"band": replaced(band)}, {"room": replaced(room)}, {"room": None}):
        with pytest.raises(ft.InputError, match="none is claimed by its count"):
            mission.around_of(SimpleNamespace(**{**vars(odds), **lacking}))


@pytest.fixture(scope="module")
def in_its_room(tmp_path_factory):
    """The files of a mission without a fence, with counts that are made up: band, room, hours."""
    folder, plan = tmp_path_factory.mktemp("room"), short_plan()

    def made_up(kind, plan, away):
        measured, few = kind.measures.chosen(plan, None), {"epsilon": 0.3, "confidence": 0.9}
        return count_of(kind, plan.with_runs(17), measured, away, np.ones(7), **few)

    band = made_up(ft.Band, plan, [5.0, 2.0])
    room = made_up(TurnBack, turning_back(plan, 30.0), [90.0, 3.4])
    around = mission.around_of(mission.MissionOdds(band=band, room=room, files={}))
    plan = hourly_flights.hourly_plan(plan)
    hourly = replace(
        made_up_hours(40.0), fence=None, around=around,
        volume=per_hour.volume_of(plan, None, around),
    )  # fmt: skip
    band.save(folder / "band.npz")
    room.save(folder / "band-turn-back.npz")
    hourly.save(folder / "band-per-hour.json")
    return folder / "band-per-hour.json"


def test_a_contingency_volume_is_that_of_the_counts_beside_its_file(in_its_room, tmp_path):
    """The corridor of 5 m and the room of 90 m to each side; another width is refused."""
    hourly = ft.load(in_its_room)

    assert hourly.around.width_m == pytest.approx(95.0, abs=1.0)  # whole metres
    hourly.check_volume()
    assert mission.check_hours(hourly, in_its_room) == ""
    wide = replace(hourly.around, width_m=400.0)
    volume = per_hour.volume_of(hourly.flights, None, wide)
    wide = replace(hourly, around=wide, volume=volume)
    wide.check_volume()
    with pytest.raises(ft.InputError, match=r"contingency volume of band\.npz, 9[56] m"):
        mission.check_hours(wide, in_its_room)
    wide.save(in_its_room.with_name("other-per-hour.json"))
    assert "are the maker's" in mission.check_hours(wide, tmp_path / "other-per-hour.json")
    wide.save(tmp_path / "band-per-hour.json")
    for name in ("band.npz", "band-turn-back.npz"):
        shutil.copy(in_its_room.with_name(name), tmp_path / name)
    verified = ft.verify(tmp_path / "band-per-hour.json")
    assert not verified.valid
    assert "`around` must be" in verified.reason
    with pytest.raises(ft.InputError, match=r"`volume` must be that of the fence or the room"):
        replace(hourly, volume=volume).check_volume()
    with pytest.raises(ft.InputError, match=r"`fence` or `around` must say"):
        replace(hourly, around=None).check_volume()


def replaced(count):
    """A count that claims nothing."""
    return SimpleNamespace(**{**vars(count), "claims": False})


@pytest.mark.parametrize(
    ("otherwise", "files", "says"),
    [
        ("law is exact", {}, "gains of the mission: law is exact"),
        ("", {"aerosonde": "0" * 64}, "the files of its aircraft are others"),
        ("", {}, None),
    ],
)
def test_the_monitor_on_board_is_of_the_aircraft_law_and_gains_that_are_flown(
    monkeypatch, otherwise, files, says
):
    plan = short_plan()
    flights = SimpleNamespace(
        flown_otherwise=lambda *_: otherwise, aircraft={**plan.aircraft, **files}
    )
    watch = SimpleNamespace(middle=np.array([1.0]), half=np.array([2.0]), models=())
    monitor = SimpleNamespace(watch=watch, flights=flights)
    monkeypatch.setattr(mission, "load_one", lambda *_: monitor)
    stated = {**rates().model_dump(), "ending": {"monitor": "m.npz"}}
    declared = rates_keys.RatesTable.model_validate(stated)

    if says is None:
        alarms = mission._alarms(declared, declared, plan)
        assert (alarms.middle, alarms.half) == ((1.0,), (2.0,))
    else:
        with pytest.raises(ft.InputError, match=rf"m\.npz: `monitor` must be .*{says}"):
            mission._alarms(declared, declared, plan)


def test_a_flight_of_a_claim_lasts_three_times_its_time_in_still_air_and_is_drawn_anew():
    """The route of 300 m takes 12 s at 25 m/s."""
    plan = short_plan()
    hourly = hourly_flights.hourly_plan(plan)
    changes = {**SHORT, "flight.duration_s": 20.0}

    assert hourly.scenario.flight.duration_s == 36.0
    assert hourly.campaign.seed == plan.campaign.seed + 1
    assert hourly_flights.hourly_plan(short_plan(changes)).scenario.flight.duration_s == 20.0


FROM_S, RECEIVER_S = "plant.airframe.fault.from_s", "navigation.fault.from_s"


@pytest.mark.parametrize(
    ("how", "fault", "ended_s", "drawn"),
    [
        # a size without a range is fixed: an engine at 1 %
        ("cut", {"kind": "engine"}, 2.0, {FROM_S: (0.0, 30.0), "ended_s": (1e6, 1e6)}),
        ("glide", {"kind": "engine"}, 2.0,
         {FROM_S: (0.0, 30.0), "ended_s": (1e6, 1e6), "side": (-1, 1)}),
        ("circle", {"kind": "receiver_jump", "jump_m": (10.0, 20.0)}, 2.0,
         {RECEIVER_S: (0.0, 30.0), "jump_m": (10.0, 20.0), "course_deg": (-180.0, 180.0),
          "side": (-1, 1)}),
        # the travel of the aileron of the Aerosonde
        ("cut", {"kind": "aileron_stuck"}, None,
         {FROM_S: (0.0, 30.0), "aileron_stuck_deg": (-25.0, 25.0)}),
        ("cut", {"kind": "aileron_stuck", "stuck_deg": (-3.0, 5.0)}, None,
         {FROM_S: (0.0, 30.0), "aileron_stuck_deg": (-3.0, 5.0)}),
        ("parachute", {"kind": "airspeed_wrong", "bias_mps": (-2.0, 3.0)}, 1.0,
         {FROM_S: (0.0, 30.0), "V_a_bias_mps": (-2.0, 3.0)}),
    ],
)  # fmt: skip
def test_flights_with_a_fault_are_drawn_over_its_window_and_its_sizes(how, fault, ended_s, drawn):
    stated = rates(**fault).model_dump(exclude_none=True)
    chute = {"sink_mps": 5.0, "opens_s": 1.0} if how == "parachute" else {}
    table = rates_keys.RatesTable.model_validate({**stated, "ending": {"kind": how, **chute}})
    plan = short_plan()
    before = hourly_flights.Ends(plan=plan, rates=table, volume=box(1e4), alarms=None)

    flights = before.term(0, ended_s, 30.0)

    values = flights.plan.with_runs(64).parameters(0, 64)
    own = {key.split(".")[-1] if key not in (FROM_S, RECEIVER_S) else key: values[key]
           for key in flights.plan.keys if key not in plan.keys}  # fmt: skip
    assert own.keys() == drawn.keys()
    for key, (low, high) in drawn.items():
        assert low <= own[key].min() <= low + 0.2 * (high - low), key
        assert high - 0.2 * (high - low) <= own[key].max() <= high, key
    assert (flights.leaving.how, flights.leaving.after_s) == (how, ended_s)
    assert flights.plan.campaign.seed == plan.campaign.seed + 1
    (aircraft,) = flights.plan.scenario.plant
    in_air = None if aircraft.airframe is None else aircraft.airframe.fault
    assert (in_air is None) == (RECEIVER_S in drawn)
    if fault["kind"] == "engine":
        assert (in_air.throttle_factor, in_air.ended_by) == (
            0.01, {"cut": "cut", "glide": "thrust"}[how],
        )  # fmt: skip


def test_flights_that_nothing_ends_are_those_without_an_ending():
    plan = short_plan()
    flights = hourly_flights.Ends(plan=plan, rates=rates(), volume=box(1e4), alarms=None)

    assert flights.term(None, None, 0.0).plan is plan
    ended = replace(flights, alarms=WATCHED).term(None, None, 0.0).plan
    assert [key for key in ended.keys if key not in plan.keys] == ["plant.airframe.fault.ended_s"]
    assert ended.campaign.seed == plan.campaign.seed


WATCHED = Alarms(models=(), middle=(), half=())


def term_of(fault, how, alarms=None, **ending):
    """The flights of a term that are ended so, 2 s after the fault."""
    stated = {**rates(**fault).model_dump(exclude_none=True), "ending": {"kind": how, **ending}}
    table = rates_keys.RatesTable.model_validate(stated)
    flights = hourly_flights.Ends(plan=short_plan(), rates=table, volume=box(1e4), alarms=alarms)
    return flights.term(0, 2.0, 30.0)


STUCK_AILERON = {"kind": "aileron_stuck"}


@pytest.mark.parametrize(
    ("fault", "from_s"),
    [(STUCK_AILERON, FROM_S), ({"kind": "receiver_jump", "jump_m": (1.0, 2.0)}, RECEIVER_S)],
)
def test_a_cut_that_no_alarm_advances_is_flown_once_with_its_time(fault, from_s):
    flown_runs, flights = [], term_of(fault, "cut")

    def rows(plan, runs, draws, **options):
        flown_runs.append([*runs])
        for run in runs:
            # the first attempt of run 3 runs out of time
            lost = run == 3 and len(flown_runs) == 1
            left = [NEVER, 9.0, draws[run][hourly_flights.ENDED_S], NEVER]
            yield {"run": run} if lost else {"run": run, "left": left}

    with flown_here(rows) as pool:
        flown = flights.flown(pool, [1, 3], "counting")

    begin = flights.plan.with_runs(4).parameters()[from_s]
    assert [x.ended_s for x in flown] == pytest.approx([begin[1] + 2.0, begin[3] + 2.0])
    assert flown_runs == [[1, 3], [3]]


@pytest.mark.parametrize(
    ("how", "alarms", "stated"),
    [
        ("cut", WATCHED, {hourly_flights.ENDED_S: 5.0}),
        ("glide", None, {hourly_flights.ENDED_S: 5.0, hourly_flights.ENDED_AT_M: 100.0}),
        ("circle", None, {hourly_flights.ENDED_AT_M: 100.0}),
        ("parachute", None, None),
    ],
)
def test_flights_that_are_inside_at_their_ending_fly_again_as_they_end(how, alarms, stated):
    """A parachute is the exception: its descent follows from the state."""
    first = {
        0: Left(NEVER, 9.0, 5.0, 100.0),
        1: Left(NEVER, 9.0, NEVER, NEVER),  # not ended
        2: Left(4.0, 9.0, 5.0, 100.0),  # left before its ending
        3: Left(6.0, 9.0, 5.0, 100.0),
        4: Left(5.0, 9.0, 5.0, 100.0),
        5: Left(0.0, 9.0, 5.0, 100.0),
    }
    flown_runs, again = [], {}

    def rows(plan, runs, draws, **options):
        flown_runs.append([*runs])
        for run in runs:
            if draws is not None:
                again[run] = draws[run]
                yield {"run": run, "left": [NEVER, 50.0, 5.0, 100.0]}
            elif run in first:
                yield {"run": run, "left": [*first[run]]}
            else:
                yield {"run": run}  # without a sample, in each attempt

    chute = {"sink_mps": 5.0, "opens_s": 1.0} if how == "parachute" else {}
    flights = term_of(STUCK_AILERON, how, alarms, **chute)
    with flown_here(rows) as pool:
        pool.progress.budget = 10
        flown = flights.flown(pool, [*range(7)], "counting")

    runs = [] if stated is None else [0, 3, 4]
    at_end = dict.fromkeys(runs, Left(NEVER, 50.0, 5.0, 100.0))
    assert flown == [*({**first, **at_end}[run] for run in range(6)), (0.0, 0.0, NEVER, NEVER)]
    assert flown_runs[:2] == [[*range(7)], [6]]
    assert [*again] == runs
    for drawn in again.values():
        assert {**drawn, **stated} == drawn
        assert (hourly_flights.ENDED_AT_M in drawn) == (hourly_flights.ENDED_AT_M in stated)
    assert pool.progress.budget == 10 + len(runs)


def test_flights_that_nothing_ends_are_flown_once():
    flights = hourly_flights.Ends(plan=short_plan(), rates=rates(), volume=box(1e4), alarms=None)

    def rows(plan, runs, draws, **options):
        assert draws is None
        return [{"run": run, "left": [NEVER, 9.0 + run, NEVER, NEVER]} for run in runs]

    with flown_here(rows) as pool:
        flown = flights.term(None, None, 0.0).flown(pool, [2, 5], "counting")

    assert [x.end_s for x in flown] == [11.0, 14.0]


def test_flights_of_a_term_are_counted_from_their_times():
    """A flight with a time of 0 s is counted, one with -1 is not."""
    some = hourly_flights.FlownTerm(
        fault=0, ended_s=1.0, left_s=(-1.0, 0.0, 3.0, 5.0), end_s=(9.0,) * 4,
        ended_at_s=(0.0, -1.0, 2.0, 3.0),
    )  # fmt: skip
    more = some.with_flights([Left(-1.0, 8.0, 5.0, 70.0), Left(4.0, 7.0, -1.0, -1.0)])

    assert (some.count.outside, some.count.flights, some.ended) == (3, 4, 3)
    assert (more.count.outside, len(more), more.ended) == (4, 6, 4)
    assert more.left_s == (-1.0, 0.0, 3.0, 5.0, -1.0, 4.0)
    assert more.end_s == (*(9.0,) * 4, 8.0, 7.0)
    assert more.ended_at_s == (0.0, -1.0, 2.0, 3.0, 5.0, -1.0)
    with pytest.raises(ft.InputError, match="three times of each"):
        replace(some, end_s=(9.0,))


def test_an_exact_position_has_no_receiver_that_fails():
    faulty = rates(kind="receiver_jump", jump_m=(1.0, 2.0))
    exact = ft.flights("circuit_in_wind", changes=SHORT).knowing("exact")
    with pytest.raises(ft.InputError, match="receiver_jump with exact navigation"):
        hourly_flights.check_rates(counting.drawn(exact), faulty)


def counted(left, fault=None, ended_s=None):
    """The flights of a term: 300 of 100 s, of which so many leave."""
    inside = (-1.0,) * 300
    times = {"end_s": (100.0,) * 300, "ended_at_s": inside}
    return hourly_flights.FlownTerm(
        fault=fault, ended_s=ended_s, left_s=(5.0,) * left + inside[left:], **times
    )


def hours(healthy=0, faulty=0, target=None, later=(), **fault):
    """A claim of one fault an hour that ends flights after 1 s."""
    stated = rates(kind="aileron_stuck", per_hour=1.0, ended_s=1.0, **{"flights": 300, **fault})
    stated = stated.model_copy(update={"flights": 300, "target_per_hour": target})
    return per_hour.PerHour(
        rates=stated.model_dump(mode="json", exclude_none=True), confidence=0.9,
        plan={"nominal": {"flight": {"duration_s": 120.0}}}, volume=box(1e4),
        terms=(counted(healthy), counted(faulty, 0, 1.0)),
        later=tuple(counted(left, 0, ended_s) for left, ended_s in later),
    )  # fmt: skip


def until_a_fault(per_hour, seconds):
    """Mean time to the first fault, or to the end of a flight that lasts so long, h."""
    return (1.0 - math.exp(-per_hour * seconds / 3600.0)) / per_hour


def test_the_bound_of_a_claim_is_that_of_its_counts():
    """Bounds are by Clopper and Pearson at 0.1 / 4; three of 300 flights may be below 100 s."""

    def upper(k, n=300, alpha=0.1 / 4):
        return stats.beta.ppf(1.0 - alpha, k + 1, n - k)

    bound = hours(2, 4).bound

    mean_h = (1.0 - upper(3)) * until_a_fault(1.0, 100.0)
    window, cap, odd = 100.0 / 3600.0, 120.0 / 3600.0, upper(0)
    assert bound.healthy == pytest.approx(upper(2) / mean_h)
    assert bound.faults == pytest.approx([(window * upper(4) + odd * cap) / mean_h])
    pairs = window * (cap - 0.5 * window) + 0.5 * odd * cap**2
    assert bound.several == pytest.approx(pairs / mean_h)
    # with a target the fault whose time is searched has a second count
    assert hours(2, 4, target=0.5).bound.each == pytest.approx(1.0 - 0.1 / 5)


def two_faults(**changes):
    """A claim with a second fault, at half of the rate, and flights of unequal lengths."""
    (first,) = (claim := hours(target=0.9)).rates["fault"]
    second = {**first, "kind": "engine", "per_hour": 0.5}
    times = (110.0, *(90.0,) * 3, *(100.0,) * 296)
    terms = replace(counted(0), end_s=times), counted(4, 0, 1.0), counted(290, 1, 1.0)
    return replace(claim, rates={**claim.rates, "fault": [first, second]}, terms=terms, **changes)


def few_with_a_fault():
    """A claim whose fault struck three flights, none of which left."""
    few = {"left_s": (-1.0,) * 3, "end_s": (100.0,) * 3, "ended_at_s": (-1.0,) * 3}
    struck = hourly_flights.FlownTerm(fault=0, ended_s=1.0, **few)
    (fault,) = (claim := hours()).rates["fault"]
    stated = {**claim.rates, "fault": [{**fault, "flights": 3}]}
    return replace(claim, rates=stated, terms=(counted(0), struck))


def test_each_fault_has_its_rate_its_flights_and_its_shares_of_the_confidence():
    """Seven counts share 0.1: three of healthy flights, two of each fault; 90 s is too short."""
    claim = two_faults(later=(counted(0, 1, 1.0), counted(290, 1, 2.0)))

    def upper(k):
        return stats.beta.ppf(1.0 - 0.1 / 7, k + 1, 300 - k)

    mean_h = (1.0 - upper(3)) * until_a_fault(1.5, 100.0)
    window, cap = 110.0 / 3600.0, 120.0 / 3600.0
    terms = [
        rate * (window * upper(k) + upper(0) * cap) / mean_h
        for rate, k in ((1.0, 4), (0.5, 290), (0.5, 0))
    ]
    assert claim.bound.faults == pytest.approx(terms[:2])
    assert claim.largest == 1
    better = claim.total_with(claim.later[0])
    assert claim.bound.total - better == pytest.approx(terms[1] - terms[2])
    assert claim.latest == ("engine", 1.0)
    with pytest.raises(ft.InputError, match=r"`later` must be flights of one fault"):
        two_faults(later=(counted(0, 0, 1.0), counted(0, 1, 1.0)))


@pytest.mark.parametrize(
    ("later", "latest"),
    [
        ([], None),
        ([(0, 1.0), (3, 2.0), (0, 3.0)], 3.0),
        # the first failure ends the sequence, whatever comes after it
        ([(0, 1.0), (200, 2.0), (0, 3.0)], 1.0),
        ([(200, 1.0), (0, 2.0)], None),
    ],
)
def test_the_latest_time_of_ending_is_that_before_the_first_failure(later, latest):
    claim = hours(target=1.0, later=later)
    alone = claim.bound.total

    assert alone < 1.0 < hours(0, 200, target=1.0).bound.total
    assert claim.latest == (latest and ("aileron_stuck", latest))
    assert claim.total_with(counted(0, 0, 9.0)) == alone


def test_a_target_is_met_by_the_total_and_asks_for_flights_by_half_of_it():
    assert hours().met is None
    assert [hours(0, 0, target=x).met for x in (1.0, 0.1)] == [True, False]
    # a total that equals the target meets it
    reached = hours(target=hours(target=1.0).bound.total, later=[(0, 1.0)])
    assert (reached.met, reached.latest) == (True, ("aileron_stuck", 1.0))
    assert per_hour.healthy_flights_for(hours()) is None
    # none of n outside: (1 - epsilon)^n <= 1 - confidence of each count
    claim = hours(0, 40, target=0.02)
    epsilon = 0.5 * 0.02 * claim.bound.hours
    n = per_hour.healthy_flights_for(claim)
    spent = 1.0 - claim.bound.each
    assert (1.0 - epsilon) ** n <= spent < (1.0 - epsilon) ** (n - 1)
    # flights of three hours: an epsilon above one half needs as many as one half
    rare = hours(target=1.0)
    rare.rates["fault"][0]["per_hour"] = 1e-3
    claim = replace(
        rare, terms=(replace(rare.terms[0], end_s=(10_800.0,) * 300), counted(0, 0, 1.0)),
        plan={"nominal": {"flight": {"duration_s": 10_800.0}}},
    )  # fmt: skip
    n = per_hour.healthy_flights_for(claim)
    assert 0.5**n <= 1.0 - claim.bound.each < 0.5 ** (n - 1)


def test_the_healthy_flights_are_too_few_if_none_left_and_their_bound_exceeds_the_target():
    healthy = hours(target=0.5).bound.healthy

    assert hours(target=0.9 * healthy).too_few
    assert not hours(target=healthy).too_few
    assert not hours(1, target=0.9 * healthy).too_few
    assert not hours().too_few


@pytest.mark.parametrize(
    ("claim", "largest", "said"),
    [
        (hours(0, 200), 0, "1 s: 200 of 300 flights left, none was ended (`ended_s`)."),
        (hours(200, 0), None, "healthy flight: 200 of 300 flights left the volume."),
        (hours(0, 0), None, "none of 300 left the volume; more flights would lower it."),
        (few_with_a_fault(), 0, "0 of 3 flights left; more `flights` would lower its bound."),
        (two_faults(), 1, "290 of 300 flights left, none was ended"),
    ],
)
def test_what_matters_most_is_the_largest_term_of_a_fault_or_of_healthy_flight(
    claim, largest, said
):
    assert claim.largest == largest
    assert said in claim.answer().summary[-1]


def test_a_claim_says_yes_no_or_not_yet_with_its_terms_and_its_target():
    """The terms are those of `HourlyBound`, each to two digits rounded up."""

    def up(value, digits):
        step = 10.0 ** (math.floor(math.log10(value)) + 1 - digits)
        return math.ceil(value / step - 1e-9) * step

    claim = hours(0, 4, target=1.0)
    healthy = claim.bound.healthy
    first, shares = claim.answer().summary[:2]
    total = float(re.search(r"at most ([\d.]+) flights per flight hour", first)[1])
    assert first.startswith("Yes: at most")
    assert first.endswith("at a confidence of 0.9; the target is 1.")
    assert total == pytest.approx(up(claim.bound.total, 3))
    of = [float(x) for x in re.findall(r"\d[\d.e-]*\d", shares)]
    expected = [up(healthy, 3), up(claim.bound.faults[0], 2), up(claim.bound.several, 2)]
    assert of == pytest.approx(expected)
    assert "aileron stuck" in shares
    assert claim.answer().failure == ""
    assert hours(0, 4).answer().summary[0].startswith("At most")
    assert "target" not in hours(0, 4).answer().summary[0]
    few, no = hours(target=0.9 * hours(target=1.0).bound.healthy), hours(0, 200, target=0.5)
    assert few.answer().summary[0].startswith("Not shown yet: at most")
    assert no.answer().summary[0].startswith("No: at most")
    most = re.search(r"at most ([\d.]+) flights", no.answer().summary[0])[1]
    assert no.answer().failure == (
        f"exits per flight hour are at most {most}, and the target is 0.5"
    )


def test_a_table_of_a_claim_has_its_counts_and_those_of_other_times():
    claim = hours(2, 4, target=1.0, later=[(0, 1.0), (200, 2.0)])

    said = claim.answer()

    first, struck, two = said.tables[0].records
    assert [first[x] for x in ("outside", "flights", "ended")] == [2, 300, 0]
    assert (first["bound"], two["bound"]) == (claim.bound.healthy, claim.bound.several)
    assert [struck[x] for x in ("per_hour", "outside", "source")] == [1.0, 4, "a log"]
    # Clopper and Pearson at the confidence of each count
    shares = [stats.beta.ppf(claim.bound.each, k + 1, 300 - k) for k in (2, 4)]
    assert [first["share"], struck["share"]] == pytest.approx(shares)
    assert two["flights"] is None
    times = said.tables[1]
    assert times.title == "time of ending: aileron stuck"
    assert [(x["ended_s"], x["outside"]) for x in times.records] == [(1.0, 0), (2.0, 200)]
    assert times.records[0]["total"] < 1.0 < times.records[1]["total"]
    values = said.values["per_hour"]
    assert values["latest"] == {"fault": "aileron_stuck", "ended_s": 1.0}
    assert (values["bound"], values["target"]) == (claim.bound.total, 1.0)
    assert values["window_s"] == 100.0
    assert said.aside == said.notes[:-1]  # what is not in the claim stays at hand
    healthy, cut = claim.terms
    ended = replace(cut, ended_at_s=(5.0,) * 7 + (-1.0,) * 293)
    records = replace(claim, terms=(healthy, ended)).answer().tables[0].records
    assert [row["ended"] for row in records] == [0, 7, None]
    for place, kind in enumerate(("aileron stuck", "engine")):
        _, times = two_faults(later=(counted(0, place, 1.0),)).answer().tables
        assert times.title == f"time of ending: {kind}"
    assert len(hours(2, 4).answer().tables) == 1
    assert hours(2, 4).answer().values["per_hour"]["latest"] is None


@pytest.mark.parametrize(
    ("claim", "said"),
    [
        (
            hours(0, 0, target=1.0, later=[(200, 1.0)]),
            "The target does not hold even if a flight is ended 1 s after the fault.",
        ),
        (
            hours(0, 0, target=1.0, later=[(0, per_hour.LATER_S[-1])]),
            f"The target holds if a flight is ended within {per_hour.LATER_S[-1]:g} s of a stuck "
            "aileron, the latest time that was flown.",
        ),
        (
            hours(0, 0, target=1.0, later=[(0, per_hour.LATER_S[-2])]),
            f"The target holds if a flight is ended within {per_hour.LATER_S[-2]:g} s of a stuck "
            "aileron.",
        ),
        (hours(0, 0, target=1.0), None),
    ],
)
def test_the_latest_time_is_said_if_it_was_sought(claim, said):
    assert answers.latest(claim) == ([said] if said else [])


def test_what_matters_most_says_how_many_flights_were_ended_and_asks_for_more():
    claim = hours()
    (healthy, struck) = claim.terms
    ended = replace(
        struck, left_s=(5.0,) * 200 + (-1.0,) * 100, ended_at_s=(4.0,) * 120 + (-1.0,) * 180
    )
    assert answers.matters_most(replace(claim, terms=(healthy, ended))).endswith(
        "1 s: 200 of 300 flights left, 120 were ended."
    )
    half = hours(0, 0, target=0.9 * hours(target=1.0).bound.healthy)
    needed = per_hour.healthy_flights_for(half)
    assert answers.matters_most(half) == (
        "What matters most is the number of healthy flights: none of 300 left the volume; "
        f"{needed} flights (`flights`), none outside, would bring it to half of the target."
    )
    open_ = {**claim.rates, "ending": {"kind": "parachute", "opens_s": 1.5, "sink_mps": 4.0}}
    assert answers.endings(replace(claim, rates=open_, terms=(healthy, ended)))[1:] == [
        "The parachute opens after 1.5 s and sinks by 4 m/s, as declared."
    ]
    assert any("alarm" in x for x in answers.endings(
        replace(claim, alarms=Alarms(models=(), middle=(), half=()))
    ))  # fmt: skip


@pytest.mark.parametrize(
    ("terms", "later"),
    [
        ((counted(0), counted(0, 0, 2.0)), ()),  # ended at another time than stated
        ((counted(0), counted(0, 1, 1.0)), ()),  # another fault
        ((counted(0), replace(counted(0, 0, 1.0), left_s=(), end_s=(), ended_at_s=())), ()),
        ((counted(0, 0), counted(0, 0, 1.0)), ()),
        ((counted(0),), ()),
        ((counted(0), counted(0, 0, 1.0)), (counted(0), )),  # no fault
        ((counted(0), counted(0, 0, 1.0)),
         (counted(0, 0, 2.0), replace(counted(0, 0, 3.0), left_s=(), end_s=(), ended_at_s=()))),
    ],
)  # fmt: skip
def test_a_claim_has_the_flights_that_its_rates_state(terms, later):
    with pytest.raises(ft.InputError, match=r"`(terms|later)` must be"):
        replace(hours(), terms=terms, later=later)


@pytest.fixture
def again(monkeypatch):
    """Flights that are flown again: their stage, runs, plan, alarms, and whether JSBSim flies.

    Each run has times of its own.
    """
    seen = []

    def flown(flights, pool, runs, _doing):
        alarms, by_jsbsim = flights.leaving.alarms, code.BY_JSBSIM.get()
        seen.append((pool.progress.stage, [*runs], flights.plan.campaign, alarms, by_jsbsim))
        after = flights.leaving.after_s or 0.0
        return [
            Left(NEVER if run % 2 else after + 0.25 * run, 20.0 + 0.25 * run, after, 0.0)
            for run in runs
        ]

    monkeypatch.setattr(hourly_flights.TermFlights, "flown", flown)
    return seen


def counted_again():
    """A claim of 48 healthy flights, and six with a fault ended after 1 s and after 2 s."""
    stated = rates(ended_s=1.0).model_copy(update={"flights": 48})
    plan, fence = hourly_flights.hourly_plan(short_plan()), square(1e4)
    volume = per_hour.volume_of(plan, fence, None)
    ends = hourly_flights.Ends(plan=plan, rates=stated, volume=volume, alarms=None)

    def term(fault, ended_s, number):
        none = dict.fromkeys(("left_s", "end_s", "ended_at_s"), ())
        begun = hourly_flights.FlownTerm(fault=fault, ended_s=ended_s, **none)
        with WorkerPool(Fliers(workers=1)) as pool:
            flights = ends.term(fault, ended_s, 1.0)
            return begun.with_flights(flights.flown(pool, range(number), "counting"))

    return per_hour.PerHour(
        rates=stated.model_dump(mode="json", exclude_none=True), confidence=0.9,
        plan=plan.as_dict(), volume=volume, fence=fence, alarms=WATCHED,
        terms=(term(None, None, 48), term(0, 1.0, 6)), later=(term(0, 2.0, 6),),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("count", "flown", "missed"), [(3, (3, 3, 3), (0.12, 0.05)), (None, (48, 6, 6), (0, 0))]
)
def test_as_many_flights_of_each_term_as_asked_are_flown_again(again, count, flown, missed):
    """Half of the flights leave: no forgery doubles that, so the other half may be forged.

    Three flights avoid 24 of 48 by (24 23 22) / (48 47 46), and three of six by 1 / 20.
    """
    claim = counted_again()
    again.clear()

    verified = ft.verify(claim, count=count, workers=1).verification

    assert verified.valid
    assert [stage for stage, *_ in again] == [f"stage {i} of 3, " for i in (1, 2, 3)]
    assert tuple(len({*runs} & {*range(48)}) for _, runs, *_ in again) == flown
    assert all(runs == sorted(runs) for _, runs, *_ in again)
    assert all(tuple(by) == (WATCHED, True) for _, _, _, *by in again)
    # a fault comes within the longest healthy flight
    drawn = [{x.key: x for x in campaign.disperse} for _, _, campaign, *_ in again]
    assert [x["plant.airframe.fault.from_s"].upper for x in drawn[1:]] == [31.75, 31.75]
    *notes, last = verified.notes
    names = "Healthy flight", "Engine, cut after 1 s", "Engine, cut after 2 s"
    for note, name, number, of, forged, p in zip(
        notes, names, flown, (48, 6, 6), (24, 3, 3), (*missed, missed[1]), strict=True
    ):
        assert note.startswith(f"{name}: {number} of {of} flights")
        assert f"A forgery of {forged}, all that stayed inside," in note
        assert note.endswith(f"would be missed with probability {p:g}.")
    assert "rates are the applicant's" in last


@pytest.mark.parametrize(
    ("place", "times", "name"),
    [
        (0, "left_s", "healthy flight"),
        (0, "end_s", "healthy flight"),
        (1, "ended_at_s", "engine, cut after 1 s"),
        (2, "end_s", "engine, cut after 2 s"),
    ],
)
@pytest.mark.usefixtures("again")
def test_a_flight_with_another_time_than_it_has_again_is_named(place, times, name):
    claim = counted_again()
    terms = [*claim.terms, *claim.later]
    stated = [*getattr(terms[place], times)]
    stated[4] += 0.25
    terms[place] = replace(terms[place], **{times: tuple(stated)})
    forged = replace(claim, terms=tuple(terms[:2]), later=tuple(terms[2:]))

    verified = forged.verify(None, Fliers(workers=1))

    assert not verified.valid
    assert verified.reason.startswith(f"flight 4 of {name} must be as JSBSim")


@pytest.mark.usefixtures("again")
def test_flights_of_an_aircraft_with_other_files_are_not_flown_again():
    claim = counted_again()
    plan = {**claim.plan, "aircraft": dict.fromkeys(claim.plan["aircraft"], "0" * 64)}

    verified = replace(claim, plan=plan).verify(1, Fliers(workers=1))

    assert not verified.valid
    assert "files of the aircraft must be those that were flown" in verified.reason


@pytest.fixture
def counting_terms(monkeypatch):
    """The made-up flights of each term: kind, time of ending, window, budget, and seed."""
    seen = []

    def flown(flights, pool, runs, doing):
        # the engine lets a flight leave if it is ended over 2.5 s after its failure
        kind, after = doing.removeprefix("counting ").split(",")[0], flights.leaving.after_s
        drawn = {x.key: x for x in flights.plan.campaign.disperse}
        window_s = drawn[FROM_S].upper if FROM_S in drawn else None
        term = kind, after, window_s, pool.progress.budget, flights.plan.campaign.seed
        if not seen or seen[-1] != term:
            seen.append(term)
        left = 5.0 if kind == "engine" and after is not None and after > 2.5 else NEVER
        return [Left(left, 20.0 + 0.01 * (run % 300), NEVER, NEVER) for run in runs]

    monkeypatch.setattr(hourly_flights.TermFlights, "flown", flown)
    return seen


def count_of_two(target, ended_s=4.0, detected_s=1.5):
    """A count of healthy flights and those with two faults, the second with the larger term."""
    own = {} if ended_s is None else {"ended_s": ended_s, "detected_s": detected_s}
    faults = [
        {"kind": kind, "per_hour": rate, "source": "a log", "flights": 300, **more}
        for kind, rate, more in (("aileron_stuck", 0.5, {"ended_s": 1.0}), ("engine", 1.0, own))
    ]
    table = {"flights": 2000, "target_per_hour": target, "fault": faults}
    return per_hour.count_per_hour(
        short_plan(), rates_keys.RatesTable.model_validate(table), fence=square(1e4),
        alarms=WATCHED, confidence=0.9, fliers=Fliers(workers=1),
    )  # fmt: skip


def test_later_endings_of_the_largest_fault_are_flown_from_its_detection_to_the_first_failure(
    counting_terms,
):
    """A route of 300 m is flown 36 s at most, the longest flight takes 22.99 s."""
    claim = count_of_two(1.0)

    window_s, seed = pytest.approx(22.99), short_plan().campaign.seed
    assert (claim.exposure.window_s, claim.exposure.cap_s) == (window_s, 36.0)
    assert claim.alarms == WATCHED
    assert counting_terms == [
        ("healthy flight", None, None, 2600, seed + 1),
        ("aileron stuck", 1.0, window_s, 2600, seed + 2),
        ("engine", 4.0, window_s, 2600, seed + 3), ("engine", 1.5, window_s, 2900, seed + 3),
        ("engine", 2.0, window_s, 3200, seed + 3), ("engine", 3.0, window_s, 3500, seed + 3),
    ]  # fmt: skip
    assert [x.ended_s for x in claim.later] == [1.5, 2.0, 3.0]
    assert claim.latest == ("engine", 2.0)
    assert claim.bound.total > 1.0


@pytest.mark.parametrize(("target", "ended_s"), [(0.3, 4.0), (1.0, None), (None, 4.0)])
@pytest.mark.usefixtures("counting_terms")
def test_no_later_ending_is_flown_where_none_could_be_early_enough(target, ended_s):
    """The bound of healthy flights alone exceeds 0.3 an hour; a fault may have no ending."""
    claim = count_of_two(target, ended_s)

    assert claim.later == ()
    assert claim.bound.healthy > 0.3


@pytest.mark.usefixtures("counting_terms")
def test_faults_that_the_aircraft_cannot_have_are_refused_before_they_are_counted():
    plan = counting.drawn(ft.flights("circuit_in_wind", changes=SHORT).knowing("exact"))
    with pytest.raises(ft.InputError, match="receiver_jump with exact navigation"):
        per_hour.count_per_hour(
            plan, rates(kind="receiver_jump", jump_m=(1.0, 2.0)), fence=square(1e4),
            confidence=0.9, fliers=Fliers(workers=1),
        )  # fmt: skip
