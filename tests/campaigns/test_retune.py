"""An autopilot's parameters searched by flights, and written only if they are better."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import flighttune
from dispersed import plan_of, tables_of, uniform
from log_files import straight_log
from scipy import stats

import flighttune as ft


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["circuit_in_wind", "--with", "plane.param", "--out", "x.json"], ".params or .param"),
        (["circuit_in_wind", "--with", "plane.param", "--out", "x.params"], ".param or .parm"),
        (["circuit_in_wind", "--with", "plane.param", "--out", "plane.param"], "another file than"),
        (["circuit_in_wind", "--with", "plane.param", "--success", "0.9"], "must be absent with"),
        (["circuit", "--flights", "5"], "`flights` must be absent without the parameters"),
        (["level_turn", "--with", "plane.param"], "must be a route"),
        (["circuit_in_wind", "--with", "plane.param", "--budget", "9"], "at least 300 flights"),
        (["circuit_in_wind", "--with", "other.param"], "must state one of NAVL1_PERIOD"),
        (
            ["circuit_in_wind", "--with", "plane.param", "--assume", "n_z=4"],
            "`assume` must be absent without the log of an aircraft",
        ),
    ],
)
def test_what_cannot_be_searched_is_refused_in_a_line(tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plane.param").write_text("NAVL1_PERIOD,14\nROLL_LIMIT_DEG,45\n")
    (tmp_path / "other.param").write_text("TECS_SPDWEIGHT,1\nROLL_LIMIT_DEG,45\n")
    assert words in " ".join(flighttune("meet", *options, status=2)[1].split())


BEND = (0.0, 0.0), (100.0, 0.0), (170.0, 40.0)
PX4 = "# Version: 1.14.0\n1\t1\tNPFG_PERIOD\t{}\t9\n1\t1\tNPFG_DAMPING\t0.7\t9\n"
LARGEST = {
    "cross track": ("flight.cross_track_m", 1.0),
    "height": ("flight.height_err_m", 1.0),
    "airspeed": ("flight.V_a_dev_mps", 1.0),
    "course": ("chi.peak_rad", 180.0 / math.pi),
    "path angle": ("gamma.peak_rad", 180.0 / math.pi),
}


def bend_in_wind():
    """Flights of 10 s on the lags of an aircraft in any wind of up to 3 m/s."""
    tables = tables_of(
        ({"kind": "point_mass_lag", "identified": "aerosonde"},),
        route={"waypoint": [{"north_m": n, "east_m": e} for n, e in BEND]},
        flight={"V_a_mps": 25.0, "duration_s": 10.0, "h_m": 500.0},
        controller={"rate_hz": 10.0, "feed_forward": True},
    )
    del tables["reference"]
    wind = uniform("wind.speed_mps", 0.0, 3.0), uniform("wind.from_deg", 0.0, 359.0)
    return ft.flights(plan_of(tables, *wind))


def file_of(folder, period):
    path = folder / f"plane-{period:g}.params"
    path.write_text(PX4.format(period))
    return path


@pytest.fixture(scope="module")
def bettered(tmp_path_factory):
    """A slow period, bettered on the lags of an aircraft in a bend, beside a log off the track."""
    folder = tmp_path_factory.mktemp("retuned")
    log = straight_log(folder / "log.bin", {}, cross_track=40.0, height_err=0.0)
    return ft.meet(
        bend_in_wind(), autopilot=file_of(folder, 80.0), flights=6, budget=126, workers=1, log=log
    )


@pytest.mark.slow
def test_what_betters_a_slow_period_is_counted_on_fresh_draws(bettered):
    now, then = bettered.start.law.parameters, bettered.best.law.parameters
    both = dict(iter(bettered.rows.groupby("gains")))

    assert then["NPFG_PERIOD"] < now["NPFG_PERIOD"] == 80.0
    assert bettered.changes == {x: v for x, v in then.items() if now[x] != v}
    assert {"NPFG_PERIOD", "NPFG_DAMPING"} >= {*bettered.changes}
    assert {"NPFG_PERIOD": "period", "NPFG_DAMPING": "damping"}.items() <= bettered.searched.items()
    assert all(v == float(f"{v:.3g}") for v in bettered.changes.values())
    assert bettered.better
    assert bettered.against == ()
    drawn = [both[name][[*bettered.plan.keys, "seed"]].to_numpy() for name in ("yours", "tuned")]
    assert (drawn[0] == drawn[1]).all()
    assert len({*map(tuple, drawn[0])}) == bettered.plan.draws == 6
    # the start and eight on 6 draws, the start and four finalists on 12, 6 draws of both
    assert (bettered.candidates, bettered.finalists) == (9, 4)
    assert bettered.flights <= 126
    # six of six draws: the lower end of 95 % is 0.025^(1/6) = 0.541; five of five have 0.478
    assert bettered.sure_from == 6
    lost = dict.fromkeys(("yours", "tuned"), 1.0 - 0.05 ** (1.0 / 6.0))  # one-sided, none of 6
    assert bettered.lost_at_most == pytest.approx(lost)


@pytest.mark.slow
def test_errors_and_costs_are_those_of_the_rows(bettered):
    both = dict(iter(bettered.rows.groupby("gains")))

    for name, candidate in (("yours", bettered.start), ("tuned", bettered.best)):
        kept = np.array([*both[name]["kept"]], dtype=float)
        assert (candidate.lost, candidate.missed) == (0, 0)
        # 1 cross track [m] + 1 height [m] + 1 airspeed [m/s], as root mean squares
        assert candidate.cost == pytest.approx(kept[:, :3].sum(axis=1).mean())
        assert candidate.errors[:4] == pytest.approx(kept[:, :4].mean(axis=0))
        largest = [both[name][x].max() * factor for x, factor in LARGEST.values()]
        assert candidate.errors[4:] == pytest.approx(largest)
        assert candidate.rates == pytest.approx(kept[:, 4:6].mean(axis=0))
    assert bettered.best.cost < bettered.start.cost
    assert (bettered.best.rates <= 2.0 * bettered.start.rates).all()
    with np.errstate(invalid="ignore"):
        growth = bettered.best.errors / bettered.start.errors
    assert np.nanmax(growth[:4]) <= 1.05
    assert np.nanmax(growth[4:]) <= 1.2
    for row in bettered.accuracy:
        column, factor = LARGEST[row["of"]]
        yours, tuned = (both[x].set_index("draw")[column] * factor for x in ("yours", "tuned"))
        assert (row["yours"], row["tuned"]) == pytest.approx((yours.max(), tuned.max()))
        better = int((tuned < yours).sum())
        interval = stats.binomtest(better, 6).proportion_ci(0.95, method="exact")
        assert (row["better"], row["flights"], row["share"]) == (better, 6, better / 6)
        assert (row["lo"], row["hi"]) == pytest.approx((interval.low, interval.high), abs=1e-9)
    larger = {x["of"] for x in bettered.accuracy if x["tuned"] > 1.05 * x["yours"]}
    assert {x.split(" ")[0] for x in bettered.larger} == {x.split(" ")[0] for x in larger}


@pytest.mark.slow
def test_margins_of_what_was_found_are_those_of_a_frequency_response(bettered):
    """L = G (a s + b) / s^2 with the identified roll behind half a sample of 10 Hz."""
    (lag, _), turn = ft.loop.load_identified("aerosonde").nearest(25.0, 0.0).lags, 2.0 * math.pi
    w = np.geomspace(1e-2, 60.0, 100_001)
    s = 1j * w
    second = s**2 / lag.natural_frequency**2 + 2.0 * lag.damping * s / lag.natural_frequency + 1.0
    G = np.exp(-s * (lag.delay + 0.05)) / ((1.0 + s * lag.lag) * second)
    for candidate in (bettered.start, bettered.best):
        roll, lift = candidate.margins
        period = candidate.law.parameters["NPFG_PERIOD"]
        damping = candidate.law.parameters["NPFG_DAMPING"]
        a, b = 2.0 * damping * turn / period, (turn / period) ** 2
        L = G * (a * s + b) / s**2
        crossing = np.flatnonzero((np.abs(L[:-1]) > 1.0) & (np.abs(L[1:]) <= 1.0))[-1]
        phase = np.degrees(np.unwrap(np.angle(L))[crossing]) % 360.0 - 180.0
        if candidate is bettered.best:
            assert np.degrees(roll.phase_margin) == pytest.approx(phase, rel=0.05)
        for cut in (roll, lift):
            assert np.degrees(cut.phase_margin) >= 35.0
            assert 20.0 * math.log10(cut.gain_increase) >= 6.0
        assert candidate.allowed
        assert all(used <= 1.0 for used in candidate.held.values())


@pytest.mark.slow
def test_the_answer_has_both_sides_of_every_number(bettered):
    said = bettered.answer()
    now, then = bettered.start.law.parameters, bettered.best.law.parameters

    assert (said.status, said.failure) == (0, "")
    assert said.summary[0].startswith("Lost 0 | 0 of 6 fresh draws, yours | tuned.")
    assert {x["name"]: (x["old"], x["new"]) for x in said.values["changes"]} == {
        x: (now[x], v) for x, v in bettered.changes.items()
    }
    assert said.values["better"] is True
    assert said.values["lost"] == {"yours": 0, "tuned": 0}
    assert said.values["cost"] == pytest.approx(
        {"yours": bettered.start.cost, "tuned": bettered.best.cost}
    )
    assert said.values["accuracy"] == bettered.accuracy
    assert [*map(str, bettered.held_by)] == said.values["held_by"]
    assert all(then[x.of] for x in bettered.held_by if x.kind == "range")
    (of_log, *_) = bettered.tracking
    assert of_log["log"] == pytest.approx(0.95 * 40.0, rel=0.01)
    assert of_log["low"] <= of_log["high"] < 40.0
    assert any("outside of" in note and "cross track" in note for note in bettered.notes)
    assert any("Not searched, as the file does not state them" in note for note in bettered.notes)


@pytest.mark.slow
def test_the_file_that_is_written_has_the_changes_alone_and_flies_them(bettered, tmp_path):
    out = bettered.save_parameters(tmp_path / "tuned.params")
    lines = [[*path.read_text().splitlines()] for path in (bettered.file, out)]
    old, new = ([x for x in text if not x.startswith("# ")] for text in lines)

    assert sum(a != b for a, b in zip(old, new, strict=True)) == len(bettered.changes)
    assert "emulation of guidance and height" in out.read_text()
    again = ft.compare(bend_in_wind(), autopilot=out, flights=2, workers=1)
    flown = {x["name"]: x["value"] for x in again.now.rows}
    assert {x: flown[x] for x in bettered.changes} == bettered.changes
    yours = again.rows[again.rows["gains"] == "yours"]["flight.cross_track_m"].to_numpy()
    tuned = bettered.rows[bettered.rows["gains"] == "tuned"].sort_values("draw")
    assert yours == pytest.approx(tuned["flight.cross_track_m"].to_numpy()[:2])
    of_log = replace(bettered, file=tmp_path / "flown.ULG")
    text = of_log.save_parameters(tmp_path / "new.params").read_text()
    assert {x.split("\t")[2] for x in text.splitlines() if x[0] != "#"} == {*bettered.changes}
    with pytest.raises(ft.InputError, match="must be better to be written: slower"):
        replace(bettered, against=("slower",)).save_parameters(out)


@pytest.mark.soak
def test_what_is_not_surely_better_is_not_written(tmp_path):
    """Of five draws none is enough: 0.5 is not below the interval of Clopper and Pearson."""
    found = ft.meet(
        bend_in_wind(), autopilot=file_of(tmp_path, 60.0), flights=5, budget=124, workers=1
    )

    assert found.sure_from == 6
    (why,) = found.against
    assert "not surely better" in why or "no candidate was better" in why
    assert not found.better
    assert found.answer().status == 1
    assert found.answer().values["better"] is False
    with pytest.raises(ft.InputError, match="must be better to be written"):
        found.save_parameters(tmp_path / "x.params")


@pytest.mark.soak
def test_a_stopped_search_goes_on_with_its_flights_to_the_same(bettered, tmp_path):
    options = {"autopilot": bettered.file, "flights": 6, "budget": 126, "workers": 1}
    kept, observer, heard = tmp_path / "kept.jsonl", ft.CampaignObserver(), []
    observer.see = lambda progress: setattr(observer, "stopped", progress.flown >= 60)
    with pytest.raises(ft.FlightTuneError) as stopped:
        ft.meet(bend_in_wind(), kept=kept, observer=observer, **options)
    (name,) = map(Path, stopped.value.kept)
    lines = name.read_text().splitlines()
    name.write_text("\n".join(lines) + '\n{"of": "half of a li')
    again = ft.CampaignObserver()
    again.hear = heard.append

    on = ft.meet(bend_in_wind(), kept=kept, observer=again, **options)

    assert len(lines) >= 60
    assert f"{len(lines)} flights are flown already" in heard[0]
    assert on.changes == bettered.changes
    assert on.answer().values["cost"] == bettered.answer().values["cost"]
    pd.testing.assert_frame_equal(
        on.rows.drop(columns="wall_s"), bettered.rows.drop(columns="wall_s"), check_exact=True
    )
    assert not name.exists()


@pytest.mark.slow
def test_bounds_without_flights_are_shares_of_6_dB_of_35_deg_and_of_the_roll(bettered):
    best = bettered.best
    roll, lift = (
        replace(cut, gain_decrease=less, gain_increase=more, phase_margin=math.radians(phase))
        for cut, less, more, phase in zip(
            best.margins, (0.4, 0.1), (4.0, 1.5), (70.0, 40.0), strict=True
        )
    )

    used = replace(best, margins=(roll, lift), way_back=0.3)

    by_6_dB = [6.0 / (20.0 * math.log10(x)) for x in (2.5, 1.5)]  # 0.4 is 1 / 2.5
    wanted = [by_6_dB[0], 35.0 / 70.0, by_6_dB[1], 35.0 / 40.0, 0.3]
    assert [*used.held.values()] == pytest.approx(wanted)
    assert [(x.kind, x.of) for x in used.held][:3:2] == [
        ("gain margin", x) for x in ("roll", "lift")
    ]
    assert not used.allowed
    assert not replace(best, margins=()).allowed
    for share, allowed in ((1.0, True), (1.01, False)):
        assert replace(best, margins=(roll, roll), way_back=share).allowed is allowed
    # Its way back to the track needs pi u cos(pi u^2 / 2) V_g / (damping * period) at most, of what
    # 42 deg of roll give; the ground speed is that in the fastest wind of six draws of a search.
    u = np.linspace(0.0, 1.0, 10_001)
    drawn = bettered.plan.with_seed(bettered.plan.campaign.seed + 1).parameters(0, 6)
    V_g, g = 25.0 + drawn["wind.speed_mps"].max(), bettered.plan.scenario.flight.g_mps2
    most = (math.pi * u * np.cos(0.5 * math.pi * u**2)).max() * V_g / (g * math.tan(0.7330383))
    for candidate in (bettered.start, best):
        x = candidate.law.parameters
        needed = most / (x["NPFG_PERIOD"] * x["NPFG_DAMPING"])
        assert candidate.way_back == pytest.approx(needed, rel=1e-4)


@pytest.mark.slow
def test_bounds_on_errors_and_on_lost_aircraft_are_those_of_as_many_draws(bettered):
    """Of 93 draws one may lie outside of the bound: P(Bin(93, 0.05) <= 1) is below 0.05."""
    n, name = 93, "flight.cross_track_m"
    both = {x: rows.iloc[[0] * n] for x, rows in bettered.rows.groupby("gains")}
    off = np.random.default_rng(1).permutation(n) + 1.0
    rows = pd.concat(
        [x.assign(**{name: off * (0.5 if of == "tuned" else 1.0), "draw": range(n)})
         for of, x in both.items()]
    )  # fmt: skip
    rows.loc[(rows["gains"] == "tuned") & (rows["draw"] < 30), name] = 93.5
    rows.loc[(rows["gains"] == "yours") & (rows["draw"] == 40), ["status", name]] = "lost", np.nan
    draws = bettered.plan.with_runs(n * len(bettered.plan.groups))
    many = replace(bettered, rows=rows, plan=draws, start=replace(bettered.start, lost=2))

    row = many.accuracy[0]

    lost = off[40]
    second = sorted([*off[off != lost], math.inf])[-2]
    assert (row["of"], row["yours"], row["tuned"]) == ("cross track", second, 93.5)
    better = int((off[30:] > 0.0).sum())  # half of each, and of the lost one
    interval = stats.binomtest(better, n).proportion_ci(0.95, method="exact")
    assert (row["better"], row["flights"], row["share"]) == (better, n, better / n)
    assert (row["lo"], row["hi"]) == pytest.approx((interval.low, interval.high))
    assert many.lost_at_most == pytest.approx(
        {"yours": stats.beta.ppf(0.95, 3, n - 2), "tuned": 1.0 - 0.05 ** (1.0 / n)}
    )
    least = next(
        k for k in range(n) if stats.binomtest(k, n).proportion_ci(0.95, method="exact").low > 0.5
    )
    assert many.sure_from == least
