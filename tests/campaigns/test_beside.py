"""Gains beside the guidance that a user flies now, on the same draws."""

import math
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import flighttune
from flown_campaigns import flown_here
from log_files import sampled, straight_log, write_dataflash
from made_up import made_up_run, scenario_tables
from scipy.stats import binomtest

import flighttune as ft
from flighttune.campaigns.flying.rows import scenario_of_run
from flighttune.claims import counting
from flighttune.control.controller import LawSetup
from flighttune.control.limits import Limits
from flighttune.logs.parameters import flown_now
from flighttune.outputs.drawing.palette import LineStyle
from flighttune.outputs.pages import beside as page
from flighttune.studies import beside

CORNERS = (0.0, 0.0), (100.0, 0.0), (150.0, 50.0)
SHORT = {"route.waypoint": [{"north_m": n, "east_m": e} for n, e in CORNERS]}
FEW = {"flights": 2, "workers": 1, "changes": SHORT}
LONG = {"route.waypoint": [{"north_m": n, "east_m": e} for n, e in ((0, 0), (500, 0), (700, 300))]}
LEG = [{"north_m": n, "east_m": 0.0} for n in (0.0, 120.0)]
PAPER = {"gains": ["paper"], "law": ["paper"]}  # which need no search
FOUR = {"flights": 4, "workers": 1, "changes": {"route.waypoint": LEG, **PAPER}}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("now") / "plane.parm"
    of_guidance = "NAVL1_PERIOD 14\nNAVL1_DAMPING 0.8\nTECS_THR_DAMP 0.5\nROLL_LIMIT_DEG 45\n"
    path.write_text(of_guidance + "RC1_MIN 1000\n")
    return path


@pytest.fixture(scope="module")
def comparison(file):
    with flown_here():
        return ft.compare("circuit_in_wind", autopilot=file, **FEW)


# Killed by itself once so many flights are there.
KILLED = f"""
import os, signal, sys
import flighttune as ft
class Killed(ft.CampaignObserver):
    def see(self, progress):
        if progress.flown >= 2:
            os.kill(os.getpid(), signal.SIGKILL)
more = {FOUR!r}
ft.compare("circuit_in_wind", autopilot=sys.argv[1], kept=sys.argv[2], observer=Killed(), **more)
"""


@pytest.mark.counts
def test_a_killed_comparison_goes_on_and_is_the_same_to_the_bit(file, tmp_path):
    kept = tmp_path / "runs" / "kept.jsonl"
    done = subprocess.run([sys.executable, "-c", KILLED, file, kept], check=False)
    assert done.returncode == -signal.SIGKILL
    (file_of_it,) = kept.parent.glob("kept-*.jsonl")
    flown = file_of_it.read_text().splitlines()
    assert len(flown) >= 2
    # half of the next line, and a flight of another comparison
    file_of_it.write_text(
        "\n".join([flown[0].replace('"of": "', '"of": "0'), *flown, flown[1][:50]])
    )

    said = []
    observer = ft.CampaignObserver()
    observer.hear = said.append
    on = ft.compare("circuit_in_wind", autopilot=file, kept=kept, observer=observer, **FOUR)
    whole = ft.compare("circuit_in_wind", autopilot=file, **FOUR)

    assert said[0] == f"{file_of_it}: {len(flown)} flights are flown already."
    assert not file_of_it.exists()
    rows = [x.rows.drop(columns="wall_s") for x in (on, whole)]
    pd.testing.assert_frame_equal(*rows, check_exact=True)


@pytest.mark.soak
def test_a_stopped_comparison_names_the_file_with_which_it_goes_on(file, tmp_path):
    kept, observer = tmp_path / "kept.jsonl", ft.CampaignObserver()
    observer.see = lambda progress: setattr(observer, "stopped", progress.flown >= 1)

    with pytest.raises(ft.FlightTuneError) as stopped:
        ft.compare("circuit_in_wind", autopilot=file, kept=kept, observer=observer, **FEW)

    (name,) = stopped.value.kept
    assert name.startswith(str(kept.with_suffix("")))
    assert 1 <= len(Path(name).read_text().splitlines()) < 2 * FEW["flights"]


@pytest.mark.slow
def test_both_fly_the_same_draws_and_the_answer_has_both(comparison, file):
    keys = [*comparison.plan.keys, "seed", "draw"]
    yours, ours = (
        comparison.rows.loc[comparison.rows["gains"] == x, keys] for x in ("yours", "ours")
    )
    assert yours.to_dict("records") == ours.to_dict("records")
    assert len(yours) == 2
    answer = comparison.answer()
    assert "jsbsim:aerosonde at 25 m/s" in answer.summary[1]
    assert [row["of"] for row in answer.values["accuracy"]] == [
        *("cross track", "height", "airspeed", "course", "path angle")
    ]
    assert "not the firmware; not checked against a log" in answer.summary[-1]
    assert answer.values["unused"] == ["TECS_THR_DAMP"]
    assert answer.values["rest"] == 1
    sources = {row["from"] for row in answer.values["parameters"]}
    assert sources == {file.name, "default of ArduPilot 4.5"}
    gains = comparison.plan.gain_sets[comparison.plan.groups[-1].gains]
    period = 4.0 * math.pi * 0.8 / gains.K_P[0, 0]
    said = f"{gains.K_P[0, 0]:.2f} 1/s, corresponds to NAVL1_PERIOD = {period:.1f} s (yours 14 s)"
    assert said in answer.summary[3]


@pytest.mark.slow
def test_ours_are_the_flights_that_a_campaign_has(comparison):
    standard = {"navigation": {"grade": "standard"}}
    alone = ft.flights("circuit_in_wind", changes=SHORT | standard).plan()
    row = comparison.rows[
        (comparison.rows["gains"] == "ours") & (comparison.rows["draw"] == 1)
    ].iloc[0]
    group = next(
        i for i, x in enumerate(alone.groups) if x.gains == comparison.plan.groups[-1].gains
    )
    number = len(alone.groups) + group
    enough = alone.with_runs(max(alone.runs, number + 1))
    run = ft.fly(scenario_of_run(enough, number)).runs[-1]
    flown = ft.loop.flight_metrics(run)
    for name in ("cross_track_m", "height_err_m", "V_a_dev_mps"):
        assert row[f"flight.{name}"] == pytest.approx(flown[name], rel=1e-9)


@pytest.mark.slow
def test_margins_are_those_of_a_frequency_response(comparison):
    # L = G (a s + b) / s^2 with the identified roll behind half a sample
    (lag, _), omega = ft.loop.load_identified("aerosonde").nearest(25.0, 0.0).lags, 2.0 * math.pi
    a, b = 4.0 * math.pi * 0.8 / 14.0, (omega / 14.0) ** 2
    w = np.geomspace(1e-2, 60.0, 200_001)
    s = 1j * w
    second = s**2 / lag.natural_frequency**2 + 2.0 * lag.damping * s / lag.natural_frequency + 1.0
    G = np.exp(-s * (lag.delay + 0.01)) / ((1.0 + s * lag.lag) * second)
    L = G * (a * s + b) / s**2
    phase = np.unwrap(np.angle(L))
    crossing = np.flatnonzero((np.abs(L[:-1]) > 1.0) & (np.abs(L[1:]) <= 1.0))[-1]
    turn = np.flatnonzero((phase[:-1] > -np.pi) & (phase[1:] <= -np.pi))[-1]
    roll = comparison.margins["yours"][0]
    assert np.degrees(roll.phase_margin) == pytest.approx(
        np.degrees(phase[crossing]) + 180.0, abs=0.5
    )
    assert roll.gain_increase == pytest.approx(1.0 / np.abs(L[turn]), rel=0.03)


S = 1j * np.geomspace(1e-2, 60.0, 200_001)


def phase_margin(loop, rates):
    """Phase margin (deg) of the inner loop, cut at roll (0) or lift (1), and a law behind it."""
    lag = ft.loop.load_identified("aerosonde").nearest(25.0, 0.0).lags[loop]
    second = S**2 / lag.natural_frequency**2 + 2.0 * lag.damping * S / lag.natural_frequency + 1.0
    L = np.exp(-S * (lag.delay + 0.01)) / ((1.0 + S * lag.lag) * second) * rates / S
    crossing = np.flatnonzero((np.abs(L[:-1]) > 1.0) & (np.abs(L[1:]) <= 1.0))[-1]
    return np.degrees(np.unwrap(np.angle(L))[crossing]) % 360.0 - 180.0


@pytest.mark.parametrize("k", [(0.0, 0.0), (0.2, 0.1)])
def test_margins_of_gains_on_a_route_are_those_with_its_look_ahead(file, k):
    """``L = G ((1 + k) (K_P s + K_I) (s + 1/T) / s^3 + k)``: the course wanted turns to it in T."""
    own = {"name": "own", "K_P": [[1.2, 0.0], [0.0, 0.9]], "K_I": [[0.9, 0.0], [0.0, 0.4]]}
    own["feedback"] = [*k]
    stated = ft.flights("circuit_in_wind", changes={**SHORT, "gains": [own]})
    now = flown_now(file, None)
    plan = beside._with_guidance(counting.drawn(stated, gains="own"), now)
    T = plan.scenario.route.look_ahead_s

    ours = beside.loops(plan, now)["ours"]

    for loop, (K_P, K_I) in enumerate(((1.2, 0.9), (0.9, 0.4))):
        rates = (1.0 + k[loop]) * (K_P + K_I / S) * (1.0 + 1.0 / (T * S)) + k[loop] * S
        wanted = phase_margin(loop, rates)
        assert np.degrees(ours[loop].phase_margin) == pytest.approx(wanted, abs=0.5)


@pytest.mark.parametrize("on_route", [True, False])
def test_without_a_route_the_loops_over_the_distances_are_open(file, on_route):
    law = flown_now(file, None).law
    scenario = ft.load_scenario("circuit" if on_route else "level_turn")
    made = law.make(LawSetup(dt=0.02, limits=Limits.none(2), g=9.80665))
    a, b, c, d = made.linear(25.0)

    found = beside.guidance_margins(scenario, beside.inner_loop_of(scenario), law)

    assert a[0] == pytest.approx(4.0 * math.pi * 0.8 / 14.0)
    for loop, margins in enumerate(found):
        of_distance = (b[loop] + d[loop] / S) / S if on_route else 0.0
        wanted = phase_margin(loop, a[loop] + c[loop] / S + of_distance)
        assert np.degrees(margins.phase_margin) == pytest.approx(wanted, abs=0.5)


def test_of_few_flights_the_largest_error_is_the_bound():
    errors = np.random.default_rng(3).uniform(size=(93, 2))
    assert (beside.kept_error(errors[:9]) == errors[:9].max(axis=0)).all()
    assert (beside.kept_error(errors) == np.sort(errors, axis=0)[-2]).all()


@pytest.mark.parametrize("lost", ["yours", "ours"])
def test_counts_and_bounds_are_those_of_scipy_and_order_statistics(file, lost):
    random, n = np.random.default_rng(7), 93
    stated = ft.flights("circuit_in_wind", changes={**SHORT, "gains": ["paper"]})
    now = flown_now(file, None)
    plan = beside._with_guidance(counting.drawn(stated, gains="paper"), now).with_runs(2 * n)
    errors = {
        "flight.cross_track_m": (5.0, 4.5), "flight.height_err_m": (1.0, 2.0),
        "flight.V_a_dev_mps": (0.3, 0.2), "chi.peak_rad": (0.03, 0.01),
        "gamma.peak_rad": (0.02, 0.1),
    }  # fmt: skip
    rows = pd.DataFrame({"draw": np.repeat(np.arange(n), 2), "gains": ["yours", "ours"] * n})
    rows["plant"], rows["status"], rows["run"] = "aerosonde", "completed", np.arange(2 * n)
    rows["success"], rows["reason"] = True, ""
    for name, means in errors.items():
        rows[name] = (np.array(means) * random.uniform(0.8, 1.2, (n, 2))).ravel()
    rows.loc[rows["gains"].eq(lost) & rows["draw"].eq(3), "status"] = "left_envelope"

    many = beside.Beside(now=now, plan=plan, rows=rows, tracking=[])

    ends = rows["status"].eq("left_envelope")
    for row, (name, factor) in zip(many.accuracy, (
        ("flight.cross_track_m", 1.0), ("flight.height_err_m", 1.0), ("flight.V_a_dev_mps", 1.0),
        ("chi.peak_rad", 180.0 / math.pi), ("gamma.peak_rad", 180.0 / math.pi),
    ), strict=True):  # fmt: skip
        yours, ours = rows[name].mask(ends, np.inf).to_numpy().reshape(n, 2).T
        better = int(np.sum(ours < yours))
        interval = binomtest(better, n).proportion_ci(0.95, method="exact")
        assert (row["better"], row["flights"]) == (better, n)
        assert row["share"] == pytest.approx(better / n)
        assert (row["lo"], row["hi"]) == pytest.approx((interval.low, interval.high), abs=1e-9)
        # one of 93 may be outside at 5 % and 0.95 (S. S. Wilks): the second largest
        assert row["ours"] == pytest.approx(np.sort(ours)[-2] * factor)
        assert row["yours"] == pytest.approx(np.sort(yours)[-2] * factor)
    counted = {"yours": "0", "ours": "0", lost: "1 (left envelope)"}
    assert (
        many.answer()
        .summary[0]
        .endswith(
            f"Aircraft lost in {n} flights: your parameters {counted['yours']}, "
            f"our law {counted['ours']}."
        )
    )


@pytest.fixture(scope="module")
def made_up(file):
    """Seven draws, of which one with the user's parameters is lost; ours errs by half."""
    leg = {"route.waypoint": LEG, "gains": ["paper"]}
    stated, now = ft.flights("circuit_in_wind", changes=leg), flown_now(file, None)
    n, track = 7, np.array([4.0, 1.0, 6.0, 2.0, 5.0, 3.0, np.nan])
    plan = beside._with_guidance(counting.drawn(stated, gains="paper"), now).with_runs(2 * n)
    rows = pd.DataFrame({"draw": np.repeat(np.arange(n), 2), "gains": ["yours", "ours"] * n})
    rows["plant"], rows["status"], rows["run"] = "aerosonde", "completed", np.arange(2 * n)
    rows["success"], rows["reason"] = True, ""
    ours = np.where(np.isnan(track), 7.0, track) / 2.0
    rows["flight.cross_track_m"] = np.column_stack([track, ours]).ravel()
    rows["chi.peak_rad"] = np.radians(rows["flight.cross_track_m"])
    for name in ("flight.height_err_m", "flight.V_a_dev_mps", "gamma.peak_rad"):
        rows[name] = np.nan
    rows.loc[12, "status"] = "diverged"
    return beside.Beside(now=now, plan=plan, rows=rows, tracking=[])


def test_shares_of_flights_below_an_error_rise_by_one_flight_at_each(made_up):
    looks = {name: LineStyle("#1F78B4", "blue", 2.0, False) for name in ("yours", "ours")}

    track, course = page.error_charts(made_up, looks)

    assert track.title == "Largest error of cross track"
    assert track.x == "cross track [m]"
    (x, y), (x_ours, y_ours) = track._seen
    # the lost flight counts among the seven, and is below no error
    assert x.tolist() == np.repeat([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2).tolist()
    assert y == pytest.approx(100.0 * np.repeat(np.arange(7), 2)[1:-1] / 7.0)
    assert x_ours[-1] == 3.5
    assert y_ours[-1] == pytest.approx(100.0)
    # what no flight has is no row
    assert [row["of"] for row in made_up.accuracy] == ["cross track", "course"]
    assert [row["ours"] for row in made_up.accuracy] == [3.5, pytest.approx(3.5)]
    assert [row["better"] for row in made_up.accuracy] == [7, 7]
    assert course.x == "course [deg]"
    assert course._seen[0][0] == pytest.approx(x)


def test_the_answer_has_both_errors_the_better_draws_and_the_lost_aircraft(made_up):
    """Seven of seven have a share of at least 0.025^(1/7), which is 59 %."""
    errors, _, better, terms, basis = made_up.answer().summary

    assert re.findall(r"[\d.]+ (?:m|deg)\b", errors) == ["3.5 m", "3.5 deg"]
    assert "your parameters 1 (diverged), our law 0" in errors
    assert better == (
        "Draw by draw, our law has the smaller error in 7 for the cross track (59.0 to 100 %) "
        "and 7 for the course (59.0 to 100 %) of 7."
    )
    assert "Margins" in terms
    assert basis.startswith("What flies for you are the equations of ")
    said = replace(made_up, rows=made_up.rows.assign(reason="it falls.")).answer()
    assert said.values["lost"] == {"yours": 1, "ours": 0}
    assert [x.title for x in said.tables[1:3]] == ["lost of yours", "lost of ours"]
    assert [len(x.records) for x in said.tables[1:3]] == [1, 0]
    assert said.tables[1].records[0]["run"] == 6  # the draw


@pytest.mark.slow
def test_the_page_shows_the_draw_with_the_median_error_of_the_user(made_up, tmp_path):
    """Of seven errors, one of which is infinite, the fourth is 4 m in draw 0."""
    written = page.write_beside_page(made_up, tmp_path / "page.html", "flighttune compare")

    shown = written.path.read_text(encoding="utf-8")
    assert written.summary == tuple(made_up.answer().summary)
    assert "One flight with both, draw 0" in shown
    assert shown.count("Commands of draw 0") == 1
    assert {*re.findall('data-run="([^"]*)"', shown)} >= {
        f"jsbsim:aerosonde / {x}" for x in ("yours", "ours")
    }
    assert "RC1_MIN" not in shown
    assert "NAVL1_PERIOD" in shown


def test_a_log_lies_between_the_flights_that_were_completed():
    flights = [[1.0, 2.0, 10.0], [3.0, 1.0, 12.0], [9.0, 9.0, 99.0], [0.0, 0.0, 0.0]]
    rows = pd.DataFrame(
        {
            "gains": ["yours", "yours", "yours", "ours"],
            "status": ["completed", "completed", "diverged", "completed"],
            beside.KEPT: flights,
        }
    )

    cross, roll = beside.tracking_of([2.0, math.nan, 12.5], rows)

    assert cross == {"of": "cross track", "log": 2.0, "low": 1.0, "high": 3.0, "unit": "m"}
    assert (roll["of"], roll["low"], roll["high"]) == ("commanded roll", 10.0, 12.0)
    (said,) = beside.within_flights([cross, roll])
    yours = "the flights with your guidance"
    assert f"lies among {yours} in cross track and outside of them in commanded roll, by" in said
    assert "the 95th percentile" in said
    (said,) = beside.within_flights([roll])
    assert f"lies outside of {yours} in commanded roll, by" in said
    assert beside.within_flights([]) == beside.tracking_of([], rows) == []


def test_a_signal_is_kept_below_what_it_exceeds_in_a_twentieth_of_the_time():
    t = np.linspace(0.0, 1.0, 101)
    run = made_up_run({"cross_track": -4.0 * t, "phi_cmd": np.radians(30.0) * t}, t)

    cross, height, roll = beside.kept_signals(run, None)

    assert (cross, roll) == pytest.approx((0.95 * 4.0, 0.95 * 30.0))
    assert math.isnan(height)


@pytest.mark.soak
def test_a_log_lies_among_the_flights_or_not(file, tmp_path):
    tables = ft.load_scenario("circuit", changes=LONG).as_dict()
    law = {"name": "l1", "kind": "autopilot", "parameters": {"NAVL1_PERIOD": 14.0}}
    flown = ft.fly(ft.scenario_from(tables | {"law": [law], "gains": ["paper"], "expect": []}))
    run = next(run for run in flown.runs if run.status == "completed")
    t, signals = sampled(run, noise=False, dropouts=False, late=False)
    near = write_dataflash(tmp_path / "near.bin", t, signals)
    off = {"cross_track": 0.0 * t + 50.0, "phi_cmd": 2.0 * signals["phi_cmd"]}
    far = write_dataflash(tmp_path / "far.bin", t, signals | off)
    for log, among in ((near, None), (far, "outside of")):
        of_log = {**FEW, "changes": LONG, "log": str(log)}
        answer = ft.compare("circuit_in_wind", autopilot=file, **of_log).answer()
        cross, height, roll = answer.values["tracking"]
        assert "not checked" not in answer.summary[3]
        if among is None:
            kept = np.quantile(np.abs(run.signals["height_err"]), 0.95)
            assert height["log"] == pytest.approx(kept, abs=0.05)
            kept = np.degrees(np.quantile(np.abs(run.signals["phi_cmd"]), 0.95))
            assert roll["log"] == pytest.approx(kept, abs=0.5)
            assert roll["low"] <= roll["log"] <= roll["high"]
        else:
            assert cross["log"] == pytest.approx(50.0)
            assert roll["log"] > roll["high"]
            (said,) = [note for note in answer.notes if among in note]
            assert re.search(r"outside of [a-z ]+ in cross track", said)
            assert "commanded roll, by the 95th percentile of the size" in said


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--with", "copter.param"], "parameters of an aeroplane"),
        (["--with", "missing.param"], "no such file"),
        (["--flights", "5"], "`flights` must be absent without the parameters of an autopilot"),
        (["paper@K1", "--with", "plane.param"], "one source of flights"),
        (["--with", "plane.param", "--out", "x.rrd"], ".html"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_line(tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "copter.param").write_text("ATC_RAT_RLL_P,0.1\n")
    (tmp_path / "plane.param").write_text("NAVL1_PERIOD,14\nROLL_LIMIT_DEG,45\n")
    _, failure = flighttune("compare", "paper@paper", *options, status=2)
    assert words in failure


@pytest.mark.soak
def test_a_scenario_without_draws_is_flown_once_and_written_as_a_page(tmp_path, file):
    page = tmp_path / "page.html"
    out, _ = flighttune(
        "compare", "level_turn", "--with", file, "--out", page, "--workers", "1", status=0
    )
    assert "The largest errors of 1 flight; 59 are needed for a bound" in " ".join(out.split())
    shown = page.read_text()
    parts = re.findall(r'<(section|details) id="(\w+)"( open)?', shown)
    assert parts[:4] == [
        ("section", "accuracy", ""),
        ("details", "responses", " open"),
        ("details", "margins", ""),
        ("details", "flown", ""),
    ]
    assert "not the firmware" in shown
    assert "--workers 1" in shown


@pytest.mark.slow
def test_a_comparison_of_flights_that_end_early_says_that_alone(file, tmp_path):
    """The aircraft stalls at once on a turn that it is asked to fly at its lowest airspeed."""
    slow = {"flight.V_a_mps": 15.2, "route.wind_mps": 0.0}
    with flown_here():
        several = ft.compare("circuit_in_wind", autopilot=file, **{**FEW, "changes": SHORT | slow})

    said = several.answer()

    assert said.status == 2
    assert said.found == "open"
    only, condition = said.summary
    assert "at 15.2 m/s" in condition
    assert re.search(r"\d of 2 flights with (your|our)", only)
    assert re.search(r"(alpha|V_a) left its range of \S+ to \d+", only)
    assert "fly faster" in only
    assert not re.search(r"\b(inf|nan)\b|∞", " ".join([*said.summary, *said.notes]))
    page.write_beside_page(several, tmp_path / "c.html", "flighttune compare")
    text = (tmp_path / "c.html").read_text()
    assert "Errors of all flights" not in text
    assert 'class="verdict yes"' not in text


@pytest.mark.slow
def test_a_scenario_without_draws_is_flown_once_by_both(file):
    with flown_here():
        alone = ft.compare("level_turn@paper", autopilot=file, workers=1, seed=7)

    assert [*alone.rows["gains"]] == ["yours", "ours"]
    assert alone.plan.groups[-1].gains == "paper"
    assert alone.plan.campaign.seed == 7


def test_without_an_identified_aircraft_there_are_no_margins(file):
    stated = ft.flights(ft.scenario_from(scenario_tables()))
    now = flown_now(file, None)
    plan = beside._with_guidance(counting.drawn(stated, gains="paper"), now)

    assert beside.Beside(now=now, plan=plan, rows=pd.DataFrame(), tracking=[]).margins == {}


SPEEDS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.395\t8.55\t430\t1
1\t0\t3\t22\t15\t0\t0\t0\t47.3952\t8.5501\t60\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.398\t8.55\t60\t1
3\t0\t3\t178\t0\t20\t-1\t0\t0\t0\t0\t1
4\t0\t3\t16\t0\t0\t0\t0\t47.398\t8.553\t60\t1
5\t0\t0\t177\t2\t-1\t0\t0\t0\t0\t0\t1
"""


@pytest.mark.slow
def test_changes_of_airspeed_are_refused_with_the_key_that_leaves_them_out(tmp_path):
    mission = tmp_path / "speeds.waypoints"
    mission.write_text("\n".join(x for x in SPEEDS.splitlines() if "\t177\t" not in x))
    route, ramp = ft.flights(mission).plan().scenario, ft.load_scenario("speed_change_in_turn")

    for place, scenario, cure in (
        (str(mission), route, r"`--set flight\.V_a_mps=25` flies .* by item 3"),
        ("speeds.toml", route, r"`--set route\.holds_airspeed=false` flies"),
        ("speeds.toml", ramp, r"25 to 30 m/s: leave `V_mps` of \[reference\] out"),
    ):
        with pytest.raises(ft.InputError, match=f"must be flown at one airspeed.* {cure}"):
            beside.check_one_airspeed(place, scenario)
    beside.check_one_airspeed("level_turn", ft.load_scenario("level_turn"))


def test_signals_of_a_log_are_kept_with_the_parameters_that_differ_from_those_flown_now(
    file, tmp_path
):
    now = flown_now(file, None)
    ends = {"cross_track": 4.0, "height_err": -2.0, "phi_cmd": np.radians(20.0)}
    same = {"NAVL1_PERIOD": 14.0, "NAVL1_DAMPING": 0.8, "ROLL_LIMIT_DEG": 45.0}

    logs = (
        straight_log(tmp_path / f"{period}.bin", same | {"NAVL1_PERIOD": period}, **ends)
        for period in (14.0, 20.0)
    )
    (signals, nothing), (_, said) = (beside.logged_signals(x, (), now, None) for x in logs)

    assert signals == pytest.approx([0.95 * 4.0, 0.95 * 2.0, 0.95 * 20.0], rel=0.01)
    assert nothing == []
    assert said == ["The log was flown with other parameters: NAVL1_PERIOD."]
    # a log needs one of the signals
    level = {"t_s": np.linspace(0.0, 2.0, 101), "phi_deg": 5.0, "n_z": 1.0, "V_a_mps": 20.0}
    rolls, none = tmp_path / "rolls.csv", tmp_path / "none.csv"
    pd.DataFrame(level | {"phi_cmd_deg": 30.0}).to_csv(rolls, index=False)
    pd.DataFrame(level).to_csv(none, index=False)
    kept, _ = beside.logged_signals(str(rolls), (), now, None)
    assert kept == pytest.approx([math.nan, math.nan, 30.0], nan_ok=True)
    with pytest.raises(ft.InputError, match="must have one of the signals cross_track, height_err"):
        beside.logged_signals(str(none), (), now, None)


@pytest.mark.soak
def test_what_is_not_emulated_of_a_mission_is_named_with_the_keys_that_fly_it(file, tmp_path):
    mission = tmp_path / "m.waypoints"
    mission.write_text(SPEEDS)
    asked = ["compare", mission, "--with", file, "--flights", 1, "--workers", 1]

    said = flighttune(*asked, status=2)[1]
    assert "item 5 (DO_JUMP 177) must repeat at most 10 times" in said
    asked += re.search("--set route.skip=true", said)[0].split()
    said = flighttune(*asked, status=2)[1]
    assert "must be flown at one airspeed" in said
    assert "an airspeed of 20 m/s by item 3" in said
    asked += re.search(r"--set flight.V_a_mps=25", said)[0].split()
    assert "Neither lost an aircraft in 1 flight." in " ".join(flighttune(*asked)[0].split())
