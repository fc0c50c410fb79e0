"""One adoption from beginning to end: what it writes, measures and records, and its attempts."""

import json
import math
import os
import shutil
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from places import SHIPPED_AIRCRAFT

import flighttune as ft
from flighttune.base.errors import PlantError, TrimError
from flighttune.studies.adoption import adopt, survey
from flighttune.vehicles.aircraft.aircraft import load_aircraft
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.jsbsim.bench import AirframeState, Bench
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.trim import level, trim

STORED = Path(__file__).parents[2] / "adopted"
DEG = math.pi / 180.0
FILES = "aircraft.toml", "gains.json", "identified.json", "turn.toml", "adoption.json"

WRITTEN = 1e-4
"""Files have five digits."""

AT_REST = 1e-5
"""m/s^2, rad/s^2 and 1; the gravity of JSBSim differs from the standard by less."""

# Angles that a sweep of the lift takes in steps and interpolates move the stall so much.
OF_STALL = 0.01


@pytest.fixture(scope="module")
def adopted(tmp_path_factory):
    """The Aerosonde, adopted as a model of one's own; what was said meanwhile."""
    models, said = tmp_path_factory.mktemp("models"), []
    sonde = shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", models / "sonde")
    found = adopt.adopt(str(sonde / "aerosonde.xml"), models / "mine", say=said.append)
    return found, said


@pytest.mark.slow
def test_an_adoption_says_its_steps_and_writes_its_files(adopted):
    found, said = adopted

    steps = list(dict.fromkeys(x.split(":")[0] for x in said))
    assert steps == [f"step {k} of 9" for k in range(1, 10)]
    assert "step 5 of 9: trimming at 25 m/s" in said
    assert (found.status, found.reason, found.name, found.engines) == ("adopted", "", "mine", 1)
    assert sorted(file.name for file in found.folder.iterdir()) == sorted(FILES)
    assert {name: (found.folder / name).read_text() for name in FILES} == found.texts
    assert 'model = "../sonde/aerosonde.xml"' in found.texts["aircraft.toml"]
    assert found.draft is None
    assert not any("drag may be missing" in note for note in found.notes)
    assert 1.0 < found.seconds < 600.0
    assert found.identified.folder == found.folder


@pytest.mark.slow
def test_the_record_of_an_adoption_has_its_answers(adopted):
    found, _ = adopted
    record = json.loads(found.texts["adoption.json"])

    for name in ("status", "reason", "glide_ratio", "fit_percent", "flown"):
        assert record[name] == getattr(found, name)
    assert record["V_a_mps"] == found.V_a
    assert (record["notes"], record["trims"]) == ([*found.notes], [*found.trims])
    assert {*record["versions"]} == {"flighttune", "jsbsim"}
    nominal = json.loads(found.texts["identified.json"])["conditions"][0]["channels"]
    assert {*nominal} == {"phi", "n_z"}
    for name, channel in nominal.items():
        assert found.fit_percent[name] == pytest.approx(channel["fit_percent"], rel=WRITTEN)
        assert 90.0 <= found.fit_percent[name] <= 100.0
    assert record["stall_mps"] == pytest.approx(found.V_a / 1.6, rel=1e-9)


@pytest.mark.slow
def test_the_stall_and_the_glide_are_those_of_the_forces_in_jsbsim(adopted):
    found, _ = adopted
    config = load_aircraft(found.folder)
    fdm, stall = Fdm(config), json.loads(found.texts["adoption.json"])["stall_mps"]
    bench = Bench(fdm, 1000.0)
    drag, lift, pounds = (
        fdm.reader(name)
        for name in ("forces/fwx-aero-lbs", "forces/fwz-aero-lbs", "inertia/weight-lbs")
    )

    # the lift at the largest angle of attack carries the weight at the stall
    alpha = config.envelope.alpha[1]
    bench.accelerations(AirframeState(V_a=stall, alpha=alpha, theta=alpha))
    assert lift() / pounds() == pytest.approx(1.0, abs=OF_STALL)
    bench.accelerations(trim(fdm, level(config, found.V_a, 1000.0)))
    assert found.glide_ratio == pytest.approx(lift() / drag(), rel=1e-6)
    (name, share) = found.largest_drag
    assert share == pytest.approx(abs(fdm.reader(name)()) / drag(), rel=1e-6)


@pytest.mark.slow
def test_trims_of_an_adoption_are_at_rest_in_jsbsim(adopted):
    """Four airspeeds about that chosen, at which it descends, keeps its height and climbs."""
    found, _ = adopted
    bench = Bench(Fdm(load_aircraft(found.folder)), 1000.0)

    flown = [(row["V_a_mps"] / found.V_a, row["gamma_deg"]) for row in found.trims]
    expected = [(share, gamma) for share in (0.85, 1.0, 1.15, 1.3) for gamma in (-3.0, 0.0, 3.0)]
    assert np.array(flown) == pytest.approx(np.array(expected))
    for row in found.trims:
        at = {name.removesuffix("_deg"): x * DEG for name, x in row["trim"].items()}
        at["throttle"] = row["trim"]["throttle"]
        rates = bench.accelerations(AirframeState(V_a=row["V_a_mps"], **at))
        carried = math.cos(row["gamma_deg"] * DEG)  # of the weight, across the path
        assert rates.pop("n_z") == pytest.approx(carried, abs=AT_REST)
        assert [*rates.values()] == pytest.approx([0.0] * len(rates), abs=AT_REST)


@pytest.mark.slow
def test_the_measures_of_the_turn_are_those_of_its_flights(adopted):
    found, _ = adopted
    turn = ft.load_scenario(found.folder / "turn.toml")
    names = {"tuned": "exact:tuned_fed_back", "paper": "exact:paper_scaled"}

    assert {*found.flown} == {*names}
    for name, flown in found.flown.items():
        run = found.turn[f"jsbsim:mine / {names[name]}"]
        assert (flown["gains"], flown["status"], flown["reason"]) == (names[name], "completed", "")
        late = run.t >= 30.0
        for channel in ("chi", "gamma"):
            error = (run.signals[f"{channel}_ref"] - run.signals[channel]).to_numpy()
            whole = np.trapezoid(run.t * np.abs(error), run.t)
            assert flown["ITAE"][channel] == pytest.approx(whole, rel=1e-9)
            assert flown["ST_deg"][channel] == pytest.approx(error[late].std() / DEG, rel=1e-6)
        assert flown["swinging"] == []
    assert all(found.flown["tuned"]["ITAE"][x] < y for x, y in found.flown["paper"]["ITAE"].items())
    assert (turn.flight.V_a_mps, turn.flight.h_m) == (pytest.approx(found.V_a, rel=WRITTEN), 1000.0)
    final = found.turn.runs[0].signals.iloc[-1]
    assert (final["chi_ref"], final["gamma_ref"]) == pytest.approx((20.0 * DEG, 3.0 * DEG))
    assert found.turn.runs[0].t[-1] == pytest.approx(40.0)
    assert found.turn_name == "course of 20 deg, climb of 3 deg"


@pytest.mark.slow
def test_the_steps_of_an_adopted_aircraft_meet_what_it_was_designed_for(adopted):
    found, _ = adopted
    goals = load_aircraft(found.folder).design

    sizes = [(step.channel, step.size) for step in found.steps]
    assert sizes == [("phi", pytest.approx(30.0 * DEG)), ("n_z", 0.5), ("n_z", -0.5)]
    for step in found.steps:
        assert step.V_a == pytest.approx(found.V_a, rel=WRITTEN)
        assert step.t90 <= getattr(goals, f"{'roll' if step.channel == 'phi' else 'n_z'}_t90")
        assert step.met


def turn_of(count, gamma):
    """The scenario of a turn from a path angle of `gamma`, by an aircraft of so many engines."""
    start = FlightCondition(V_a=50.0, h=800.0, gamma=gamma)
    limits = {"phi_deg": [-45.0, 45.0], "n_z": [-0.5, 2.0]}
    text = adopt.turn_text("mine", start, {"engines": {"count": count}, "limits": limits})
    return tomllib.loads(text)


def test_a_glider_turns_three_degrees_below_its_glide_without_priority_of_its_airspeed():
    glide, driven = turn_of(0, -5.0 * DEG), turn_of(2, 0.0)

    assert glide["flight"] == {"V_a_mps": 50.0, "h_m": 800.0, "duration_s": 40.0, "gamma_deg": -5.0}
    assert glide["reference"] == {"chi_deg": 20.0, "gamma_deg": -8.0}
    assert glide["controller"] == {"feed_forward": True}
    assert "gamma_deg" not in driven["flight"]
    assert driven["reference"] == {"chi_deg": 20.0, "gamma_deg": 3.0}
    assert driven["controller"] == {"feed_forward": True, "speed_priority": True}
    assert driven["tuning"] == {"model": "identified", "roll_rate": True, "lift_rate": True}
    assert driven["plant"] == [{"kind": "jsbsim", "aircraft": "../mine"}]
    # gains for the same loop grow with airspeed: twice those of the paper, at twice its 25 m/s
    tuned, paper = driven["gains"]
    assert tuned == "tuned_fed_back"
    for key in ("K_P", "K_I"):
        assert np.array(paper[key]) == pytest.approx(
            2.0 * getattr(ft.PAPER_GAINS, key), rel=WRITTEN
        )


class Attempts:
    """Attempts in the place of those flown: each fails, or has a worse fit of so many percent."""

    def __init__(self, *outcomes):
        self.outcomes, self.tried = [*outcomes], []

    def __call__(self, surveyed, folder, h, shares, say):
        self.tried.append((surveyed.V_a / 120.0, *shares))
        outcome = self.outcomes.pop(0)
        if outcome is None:
            raise PlantError(f"attempt {len(self.tried)} fails")
        status, fit = outcome
        (folder / "turn.toml").write_text(f"of attempt {len(self.tried)}")
        fits = {"phi": 99.0, "n_z": fit}
        return adopt.Adoption(name="T38", status=status, fit_percent=fits, V_a=surveyed.V_a)


@pytest.fixture
def best_of(tmp_path, monkeypatch):
    """The best of some attempts at a T-38, what they were, and what was said; its folder."""
    folder = shutil.copytree(STORED / "T38", tmp_path / "T38")
    lift = survey.Lift(*np.zeros((3, 2)), 0.3, -0.2, 15.0)
    surveyed = survey.Survey({}, lift, 120.0, 1.0, 10.0, ("", 0.0), ())
    monkeypatch.setattr(adopt.trim, "trim_table", lambda _, **asked: [asked])

    def best(*outcomes, used=0.0):
        attempts, said = Attempts(*outcomes), []
        monkeypatch.setattr(adopt, "_tried", attempts)
        began = time.process_time() - used
        return adopt._best(surveyed, folder, 900.0, said.append, began), attempts.tried, said

    return best, folder


EVERY = [(1.0, 1.0, 1.0), (1.0, 0.7, 1.0), (1.0, 0.5, 1.0), (1.25, 1.0, 1.0), (1.4, 1.0, 1.0)]
EVERY += [(1.4, 1.0, 0.4)]
"""Shares of airspeed, bandwidths and roll rate."""


def test_attempts_go_on_until_one_is_adopted_and_the_best_of_others_stays(best_of):
    best_of, folder = best_of
    flies = [("flies", fit) for fit in (80.0, 85.0, 84.0, 70.0, 82.0, 60.0)]

    best, tried, said = best_of(*flies)
    assert np.array(tried) == pytest.approx(np.array(EVERY))
    assert (best.fit_percent["n_z"], best.texts["turn.toml"]) == (85.0, "of attempt 2")
    assert (folder / "turn.toml").read_text() == "of attempt 2"
    assert "bandwidths" not in said[0]
    assert said[1].endswith("bandwidths times 0.7")
    # one that is adopted ends them, and is better than any that flies
    best, tried, _ = best_of(("flies", 99.0), None, ("adopted", 90.0), ("adopted", 99.0))
    assert len(tried) == 3
    assert (best.status, best.texts["turn.toml"]) == ("adopted", "of attempt 3")
    assert json.loads(best.texts["adoption.json"])["status"] == "adopted"


def test_attempts_end_after_their_time_but_not_without_a_flight(best_of):
    best_of, _ = best_of
    best, tried, _ = best_of(None, ("flies", 80.0), ("flies", 90.0), used=101.0)

    assert len(tried) == 2
    assert best.texts["turn.toml"] == "of attempt 2"
    with pytest.raises(PlantError, match="attempt 1 fails"):
        best_of(*[None] * 6)


def test_an_adoption_is_trimmed_about_its_airspeed_by_climbs_that_its_engines_allow(best_of):
    best_of, folder = best_of
    found, *_ = best_of(("adopted", 99.0))
    (asked,), V_a = found.trims, found.V_a

    assert asked["V_a"] == pytest.approx([0.85 * V_a, V_a, 1.15 * V_a, 1.3 * V_a])
    assert asked["gamma"] == pytest.approx([-3.0 * DEG, 0.0, 3.0 * DEG])
    assert asked["h"] == 900.0
    file = folder / "aircraft.toml"
    file.write_text(file.read_text().replace("count = 2", "count = 0"))
    assert best_of(("adopted", 99.0))[0].trims[0]["gamma"] is None  # of the glide at each airspeed


def adopted_by(monkeypatch, folder, asked_h, *, glide_ratio=2.5, fails=None):
    """What is adopted of a glider at 100 m/s, heights of its surveys and flights, what was said."""
    heights, said = [], []
    tables = {"title": "glider", "source": adopt.SOURCE, "model": "glider.xml", "surfaces": {}}
    lift = survey.Lift(*np.zeros((3, 2)), 0.3, -0.2, 60.0)

    def surveyed(tables, _, h, **choices):
        heights.append(h)
        assert not tables["engines"]  # as at the beginning, whatever a survey found before
        tables["engines"]["count"] = 0
        return survey.Survey(tables, lift, 100.0, 1.0, glide_ratio, ("drag", 0.5), ("odd",))

    def best(surveyed, folder, h, say, used):
        heights.append(h)
        if fails:
            raise fails
        return adopt.Adoption(name="glider", status="adopted", notes=surveyed.notes)

    monkeypatch.setattr(adopt, "survey", surveyed)
    monkeypatch.setattr(adopt, "_best", best)
    tables |= {"settings": {}, "declared": {}, "linked": {}, "engines": {}}
    choices = {"V_a": None, "say": said.append}
    found = adopt._adopted(tables, {**tables, "title": ""}, folder, asked_h, choices)
    return found, heights, said


def test_a_steep_glide_begins_at_the_next_kilometre_above_the_height_that_it_loses(
    tmp_path, monkeypatch
):
    """In 60 s, at 100 m/s and 3 deg below a glide of 1 in 2.5: 2.7 km."""
    found, heights, said = adopted_by(monkeypatch, tmp_path, None)

    assert heights == [1000.0, 3000.0, 3000.0]
    assert said == ["a steep glide, from 3000 m instead of 1000 m"]
    assert found.notes == ("odd", "its glide is steep: it flies from 3000 m")
    # a height that is asked for is kept, and one of 940 m is within the usual
    assert adopted_by(monkeypatch, tmp_path, 500.0)[1:] == ([500.0] * 2, [])
    assert adopted_by(monkeypatch, tmp_path, None, glide_ratio=9.6)[1:] == ([1000.0] * 2, [])


def test_a_flight_that_is_not_steady_asks_for_another_airspeed_and_keeps_what_was_found(
    tmp_path, monkeypatch
):
    place = f"{os.path.realpath(tmp_path / 'glider.xml')}: "
    (tmp_path / "aircraft.toml").write_text("tried = 1\n")
    untrimmed = TrimError("glider at 100 m/s: no steady flight.")
    fallen = PlantError(f"{place}it fell.")

    slow, _, _ = adopted_by(monkeypatch, tmp_path, 500.0, fails=untrimmed)
    (tmp_path / "aircraft.toml").unlink()
    other, _, _ = adopted_by(monkeypatch, tmp_path, 500.0, fails=fallen)

    assert slow.status == other.status == "refused"
    assert slow.reason == "no steady flight; another airspeed (`--V-a`) may do"
    assert slow.texts == {"aircraft.toml": f"# refused: {slow.reason}\ntried = 1\n"}
    assert other.reason == "it fell"
    assert "# refused: it fell" in other.texts["aircraft.toml"]
    assert (slow.V_a, slow.glide_ratio, slow.notes, slow.engines) == (100.0, 2.5, ("odd",), 0)
