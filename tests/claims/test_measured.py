"""A kind of count is a class of what is measured, a class of what is claimed, and a row."""

from dataclasses import dataclass
from typing import ClassVar
from unittest import mock

import numpy as np
import pytest
from counted_turns import ALONE, forged, small_plan
from dispersed import AEROSONDE
from flown_campaigns import flown_here
from made_up import made_up_run, made_up_scenario

import flighttune as ft
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.flying import rows as flying
from flighttune.claims import about, counting
from flighttune.claims.counted import Counted
from flighttune.claims.counted_flights import plan_of, turning_back
from flighttune.claims.ending import Fixed
from flighttune.claims.measured import Measured
from flighttune.claims.turn_back import ROOM, RoomSignals

SINGLE = 1e-6  # relative rounding of single precision


@dataclass(frozen=True, slots=True, kw_only=True)
class RollSpeeds(Measured):
    """How fast a flight rolls, to either side."""

    @classmethod
    def chosen(cls, plan, signals):
        del plan, signals
        return cls(units={"roll speed": "rad/s"})

    @property
    def room(self):
        return 2.0

    def values(self, run, scenario):
        del scenario
        return np.abs(np.gradient(run.signals["phi"].to_numpy(), run.t))[:, None]

    def windows(self, central, samples, flights, per_unit):
        del central, flights, per_unit
        return np.array([0, samples - 1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RollSpeed(Counted):
    """A count of how fast flights roll."""

    of: ClassVar = "roll_speed"
    measures: ClassVar = RollSpeeds

    @property
    def _leaves(self):
        return "rolls faster"

    def sizes(self):
        return [{"high": self._ends(np.zeros((1, 0)))[1].max()}]


@pytest.fixture
def kinds():
    """The kinds of counts with one more."""
    row = {"roll_speed": f"{__name__}:RollSpeed"}
    with mock.patch.dict(about.KINDS, row):
        yield


def test_a_new_kind_of_count_is_flown_saved_read_and_verified(kinds, tmp_path):
    ending = Fixed.enough(ALONE, 0.3, 0.9)
    with flown_here():
        made = counting.counted_on(
            RollSpeed, small_plan(), ending, place="t", learn=10, fliers=Fliers()
        )
    made.save(tmp_path / "x.npz")
    counted = ft.load(tmp_path / "x.npz")

    plan = plan_of(counted)
    draws = counted.draws.tolist()
    flown = [flying.fly_group(plan, plan.scenario_of(draw), plan.groups[0]) for draw in draws]
    largest = [np.abs(np.gradient(x.signals["phi"].to_numpy(), x.t)).max() for x in flown]
    assert isinstance(counted, RollSpeed)
    assert counted.extremes[:, 0, 0, 1] == pytest.approx(largest, rel=SINGLE)
    assert "a new flight rolls faster with probability at most 0.3" in counted.sentence
    (row,) = counted.answer().tables[0].records
    assert (row["signal"], row["unit"]) == ("roll speed", "deg/s")
    with flown_here():
        assert ft.verify(counted).valid
        with mock.patch.object(RollSpeeds, "room", 1.0):
            again = ft.verify(counted)
    assert (again.valid, again.reason[:6]) == (False, "`half`")


@dataclass(frozen=True, slots=True, kw_only=True)
class Nowhere(RollSpeeds):
    """Rolls of flights that are all elsewhere."""

    def lost(self, run, scenario):
        return True


def test_a_flight_whose_values_do_not_hold_is_outside_unless_it_only_teaches():
    run = made_up_run({"phi": [0.0, 0.1, 0.1]}, [0.0, 0.1, 0.2])
    measured, edges = Nowhere(units={"roll speed": "rad/s"}), np.array([0.0, 0.2])

    counted, learned = (
        counting.Kept(measured=measured, edges=edges, windy=False, anywhere=anywhere)(
            run, made_up_scenario()
        )
        for anywhere in (False, True)
    )

    assert counted == [-np.inf, np.inf]
    assert learned == pytest.approx([0.0, 1.0], abs=1e-6)  # 0.1 rad in 0.1 s


@pytest.mark.slow
def test_half_of_the_flights_that_a_monitor_learns_from_teach_weights_and_half_limits():
    parts = []

    def rows(plan, runs, probes=(), **more):
        parts.append((*probes, list(runs)))
        return flying.rows_flown(plan, runs, probes=probes or {}, **more)

    plan = small_plan(plants=[AEROSONDE])
    with flown_here(rows):
        made = ft.monitor(plan, epsilon=0.3, confidence=0.9, learn=20, flights=ALONE)

    moments, limits, counts, *_ = parts  # those that decide may be flown again
    assert moments == ("moments", [*range(10)])
    assert limits == ("extremes", [*range(10, 20)])
    assert counts == ("extremes", [*range(20, 20 + ALONE)])
    assert made.measured.models == made.about.models
    assert all(len(model.weights) == len(model.terms) for model in made.about.models)


def test_room_to_turn_back_is_measured_from_the_detection_on():
    plan = turning_back(ft.flights("circuit").plan(plant="kinematic", gains="paper"), 30)
    central = plan.campaign.central

    windows = RoomSignals(units=ROOM).windows(central, 1001, 7, 50.0)

    assert windows.tolist() == [500, 1000]  # detected after 10 s


def test_models_are_those_of_a_monitor_alone(counted, tmp_path):
    model = {"name": "roll", "target": "p", "terms": ["1"], "weights": [0.0]}

    file = forged(counted, tmp_path / "x.npz", about={"models": [model]})
    with pytest.raises(ft.InputError, match=r"x\.npz: `models` must be those of the `signals` of"):
        ft.load(file)


def test_a_kind_of_count_that_is_not_known_is_refused_with_those_that_are(counted, tmp_path):
    file = forged(counted, tmp_path / "x.npz", about={"of": "roll_speed"})
    with pytest.raises(
        ft.InputError, match=r"x\.npz: `of` must be .*residual, turn_back, monitor.*'roll_speed'"
    ):
        ft.load(file)
