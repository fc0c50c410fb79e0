"""Pages of flights and of a mission: charts, tables and words have the numbers of what flew."""

import hashlib
import re
from dataclasses import replace
from html import unescape
from itertools import pairwise

import numpy as np
import pytest
from commands import flighttune
from drawn import drawn
from made_up import made_up_scenario, scenario_file

import flighttune as ft

DEG = 180.0 / np.pi
RAMPS = {"shape": "ramp", "start_s": 0.5, "duration_s": 1.0, "rate_dps": 6.0}


def titled(charts, begin):
    return next(chart for chart in charts if chart.title.startswith(begin))


def facts_of(page):
    """Rows of two cells of the tables of a page, as words."""
    rows = re.findall(r"<tr>(.*?)</tr>", page, re.DOTALL)
    cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.DOTALL) for row in rows]
    plain = [[" ".join(unescape(re.sub("<[^>]*>", "", x)).split()) for x in row] for row in cells]
    return [row for row in plain if len(row) > 1]


@pytest.fixture(scope="module")
def four(tmp_path_factory):
    """A page of four runs of the law: whole, whole, ended early and never flown."""
    limits = {"phi_deg": [-45.0, 45.0], "n_z": [0.0, 2.0]}
    expect = [
        {"at_most": {"chi": {"MO_deg": 3.0, "PT_s": 3.0}}},
        {"at_least": {"chi": {"MO_deg": 1.0}}},
    ]
    reference = {"chi_deg": 10.0, "gamma_deg": 2.0}
    tables = {"flight": {"duration_s": 4.0}, "reference": reference, "limits": limits}
    flown = ft.fly(made_up_scenario(gains=["paper", "K1"], expect=expect, **tables))
    first, second = flown.runs

    def named(run, name, **more):
        return replace(run, provenance=replace(run.provenance, gains_name=name), **more)

    never = named(first, "c", signals=first.signals[:0], status="no_gains", reason="none")
    cut = named(second, "d", signals=second.signals[:101], status="diverged", reason="far off")
    flown = replace(flown, runs=(first, never, second, cut))
    path = tmp_path_factory.mktemp("four") / "page.html"
    report = ft.report(flown, path)
    return report, path.read_text(encoding="utf-8"), flown.runs


def test_bars_of_limited_commands_stand_in_lanes_below_the_lines(four):
    _, page, runs = four
    flew = [run for run in runs if len(run.signals) > 1]
    for begin, name, ends in (("Roll c", "phi", (-45.0, 45.0)), ("Load-f", "n_z", (0.0, 2.0))):
        chart = titled(drawn(page), begin)
        factor = DEG if name == "phi" else 1.0
        values = np.concatenate([factor * run.signals[f"{name}_cmd"] for run in flew])
        low, high = min(values.min(), ends[0]), max(values.max(), ends[1])
        low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
        room = 0.035 * (len(flew) + 1)  # below the lines, a share of the whole
        assert chart.y_ends[1] == pytest.approx(high, rel=1e-5)
        assert (low - chart.y_ends[0]) / (high - chart.y_ends[0]) == pytest.approx(room, rel=1e-4)
        for place, run in enumerate(flew):
            held = run.signals[f"{name}_limited"].to_numpy() != 0.0
            bars = [x for x in chart.paths if x.get("data-run") == run.label and "H" in x.get("d")]
            assert len(bars) == held.any()
            for bar in bars:
                assert bar.get("stroke-width") == "4"
                (up,) = {float(y) for y in re.findall(r"M[\d.]+,([\d.]+)H", bar.get("d"))}
                assert up == pytest.approx(192.0 * (1.0 - 0.035 * (place + 0.8)), abs=0.051)


def test_charts_over_time_end_with_the_longest_flight_and_share_its_reference(four):
    _, page, runs = four
    charts = drawn(page)
    for chart in charts:
        if chart.x == "t [s]":
            assert chart.x_ends == [0.0, 2.0 if chart.title.startswith("d:") else 4.0]
            assert chart.tree.get("data-linked") == ""
    course = titled(charts, "Course;")
    reference = [x for x in course.paths if not x.get("data-run") and "H" not in x.get("d")]
    assert [x.get("stroke-width") for x in reference] == ["2.2"]
    errors = titled(charts, "Course error")
    zero = [x for x in errors.paths if "H" in x.get("d")]
    assert [x.get("stroke-dasharray") for x in zero] == [None]
    above, height = titled(charts, "From above"), titled(charts, "Height over")
    assert (above.x, above.y, above.equal) == ("north [m]", "east [m]", True)
    assert above.y_ends[0] > above.y_ends[1]  # with north to the right, east points down
    (start,) = [x for x in above.dots if len(x) and x[0].tag == "path"]
    assert "h12" in start[0].get("d")
    (labels,) = [{x.get("data-run") for x in height.paths}]
    assert labels == {run.label for run in runs if len(run.signals) > 1}


def test_a_page_first_says_how_many_flights_meet_follow_and_converge(four):
    report, page, runs = four
    tables = {table.name: table for table in report.tables}
    _, converged = report.summary[:2]
    assert re.findall(r"\d+", converged) == [
        str(sum(row["converges"] for row in tables["convergence"].records)), "4",
    ]  # fmt: skip
    rows = {row["run"]: row for row in tables["convergence"].records}
    for run in runs:
        row = rows[run.label]
        if len(run.signals) < 2:
            assert row["flight"] == "no gains"
            assert row["requirements"] == "not flown"
            assert "residual" not in row
            continue
        late = run.t >= 0.75 * run.t[-1]
        for channel in ("chi", "gamma"):
            errors = np.abs(run.signals[f"{channel}_err"].to_numpy())
            assert row["residual"][channel] == pytest.approx(errors[late].max())
            wanted = max(0.05 * errors.max(), np.radians(0.5))
            assert row["allowed"][channel] == pytest.approx(wanted)
        inside = all(row["residual"][x] <= row["allowed"][x] for x in ("chi", "gamma"))
        assert row["converges"] == (inside and run.status == "completed")
        if run.status == "completed":
            assert row["flight"] == ("converges" if inside else "does not converge")
            measures = ft.loop.channel_metrics(run).loc["chi"]
            met = [measures["MO_rad"] <= np.radians(3.0), measures["PT_s"] <= 3.0]
            met.append(measures["MO_rad"] >= np.radians(1.0))
            assert row["requirements"].startswith(f"{sum(met)} of 3 met")
        else:
            assert row["flight"] == "diverged at 2.0 s"
    assert [row["run"] for row in tables["runs"].records] == [
        runs[i].label for i in (0, 2, 3, 1)  # what did not fly comes last
    ]  # fmt: skip
    assert [row["flown_s"] for row in tables["runs"].records] == [4.0, 4.0, pytest.approx(2.0), 0.0]
    assert {row["gains"] for row in tables["gains"].records} == {"paper", "K1", "d"}
    facts = {row[0]: row[1] for row in facts_of(page) if len(row) == 2}
    assert float(facts["time to fly"].split()[0]) == pytest.approx(
        sum(run.provenance.wall_s for run in runs if len(run.signals) > 1), abs=0.006
    )
    assert facts["source of the scenario"] == "–"
    assert "far off" in page
    assert facts["seed"] == str(runs[0].provenance.seed)
    assert "5 % of the largest error, and at least 0.5°" in unescape(page)


MOVES = [
    # reference of the course and of the path angle, and its words
    ([RAMPS], 0.0, "the course goes from 0° to 6° and the path angle stays at 0°"),
    (
        [RAMPS, RAMPS | {"start_s": 2.0, "rate_dps": -6.0}], -1.0,
        "the course goes from 0° to 6° and back and the path angle from 0° to -1°",
    ),
    (
        [RAMPS, RAMPS | {"start_s": 2.0, "rate_dps": -9.0}],
        [RAMPS | {"rate_dps": -6.0}, RAMPS | {"start_s": 2.0}],
        "the course moves between -3° and 6° and the path angle goes from 0° to -6° and back",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("chi", "gamma", "words"), MOVES)
def test_the_words_of_a_page_say_how_its_reference_moves(chi, gamma, words, tmp_path):
    reference = {"chi_deg": chi, "gamma_deg": gamma}
    flown = ft.fly(made_up_scenario(flight={"duration_s": 3.5}, reference=reference))

    page = ft.report(flown, tmp_path / "page.html").path.read_text(encoding="utf-8")

    assert f"at 25 m/s in calm air, {words}." in unescape(page).replace("−", "-")


def test_a_page_of_many_runs_has_fewer_points_of_each_line(four):
    run, n = four[2][0], 1801
    t = np.linspace(0.0, 36.0, n)
    signals = {name: np.linspace(0.0, 1.0, n) for name in run.signals}
    long = replace(run, signals=run.signals.iloc[:0].reindex(t).assign(**signals))
    for count, points in ((1, 600), (4, 600), (8, 300)):
        runs = [
            replace(long, provenance=replace(run.provenance, gains_name=f"g{k}"))
            for k in range(count)
        ]
        (chart, *_) = drawn(ft.plot(runs).svg())
        assert [len(chart.lines(x.label)[0][0]) for x in runs] == [points] * count


def test_a_plot_of_a_band_has_its_flights_inside_outside_and_nearest(results):
    band = results.of("band")
    inside = np.isfinite(band.scores) & (band.scores <= band.scale)
    edges = band.flights.edges
    for i, (chart, made) in enumerate(
        zip(drawn(ft.plot(band).svg()), ft.plot(band).charts, strict=True)
    ):
        names = [entry[0] for entry in made.legend]
        assert names[1:3] == [f"{inside.sum()} inside", f"{(~inside).sum()} outside"]
        assert str(band.nearest) in names[3]
        assert chart.x_ends == pytest.approx([edges[0], edges[-1]])
        ((_, low, high),) = chart.bands()
        off = 2.0 * chart.off(1.0, "y")
        assert (high - low) / 2.0 == pytest.approx(
            DEG * np.repeat(band.half_widths[:, i], 2), abs=off
        )
        dotted = [chart.curve(p) for p in chart.paths if p.get("stroke-dasharray")]
        for (_, y), edge in zip(dotted, (low, high), strict=True):
            assert y == pytest.approx(edge, abs=off)
        shown = {p.get("data-part"): chart.curve(p) for p in chart.paths if p.get("data-part")}
        width = {p.get("data-part"): p.get("stroke-width") for p in chart.paths}
        assert [width[name] for name in names[1:]] == ["0.5", "0.9", "1.6"]
        flights = DEG * band.extremes[..., i, :].reshape(len(band.scores), -1)
        for name, which in zip(names[1:3], (inside, ~inside), strict=True):
            y = shown[name][1]
            pieces = np.split(y, np.flatnonzero(np.isnan(y)))
            assert len(pieces) == which.sum()
            for piece, wanted in zip(pieces, flights[which], strict=True):
                assert piece[~np.isnan(piece)] == pytest.approx(wanted, abs=off)
        (at,) = np.flatnonzero(band.draws == band.nearest)
        assert shown[names[3]][1] == pytest.approx(flights[at], abs=off)


@pytest.fixture(scope="module")
def mission(results):
    """The page of a mission in a fence, and its band."""
    results.of("corridor")
    fences = ["--fence", "wide.geojson", "--fence", "narrow.geojson"]
    command = ["mission", "corridor.npz", *fences[:2], "--page", "m.html", "--out", "kept.npz"]
    flighttune(*command, "--workers", "1", cwd=results.folder)
    return ft.load(results.folder / "kept.npz"), (results.folder / "m.html").read_text("utf-8")


@pytest.mark.soak
def test_the_page_of_a_mission_has_its_conditions_its_gains_and_its_file(mission, results):
    band, page = mission
    facts = {row[0]: row[1:] for row in reversed(facts_of(page))}

    assert facts["aircraft"][0] == "kinematic, at 25 m/s"
    assert (facts["air"], facts["drawn at random"]) == (["calm"], ["no more"])
    assert "standard receiver" in facts["navigation"][0]
    gains = ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0)
    told = facts["law"][0].partition(": ")[2].split("; ")
    assert len(told) == 2
    for line, K_P, K_I in zip(told, gains.K_P, gains.K_I, strict=True):
        numbers = [float(x) for x in re.findall(r"(-?\d+\.\d{4}) (?:int )?e_", line)]
        assert numbers == pytest.approx([*K_P, *K_I], abs=5.1e-5)
    counted = [int(x) for x in re.findall(r"\d+", facts["flights"][0])]
    assert counted[:2] == [len(band.scores), band.about.learned]
    assert {"corridor", "fence", "not in it", "ground"} <= {*facts}
    assert "per flight hour" not in facts
    assert page.count("Terrain was not looked at") == 2  # in the conditions and in the notes
    assert "room to turn back" not in facts
    assert facts["not in it"][0].startswith("Failures of engine")
    digest = hashlib.sha256((results.folder / "kept.npz").read_bytes()).hexdigest()
    assert facts["kept.npz"] == ["flighttune verify kept.npz", digest]
    assert facts["its SHA-256"][0] == digest
    (title,) = re.findall(r"How to check it \(with ([^)]*)\)", page)
    assert [x.split()[0] for x in title.split(", ")] == ["flighttune", "jsbsim", "numpy", "python"]
    assert "@font-face" in page
    assert len(re.findall(r"font-weight: (?:400|700)", page)) >= 2


@pytest.mark.slow
def test_the_map_of_a_mission_has_its_corridor_fence_and_nearest_place(mission):
    band, page = mission
    above, height = (titled(drawn(page), begin) for begin in ("Map", "Height"))
    (nearest, *_) = sorted(
        band.inside(band.about.fences[-1]).nearest, key=lambda row: row["margin_m"]
    )
    names = re.findall(r"nearest to it: (\d+) m", page)
    assert {float(x) for x in names} == {round(nearest["margin_m"])}
    (place,) = [
        (float(x[0]), float(y[0])) for x, y, _ in above.points()
        if len(x) == 1 and above.dots[0] is not None
    ][-1:]  # fmt: skip
    fence = next(x for x in above.paths if x.get("data-part") == "fence")
    assert fence.get("stroke-dasharray") is None
    x, y = above.curve(fence)
    edges = np.column_stack([x, y])
    pairs = [(a, b) for a, b in pairwise(edges) if np.isfinite([a, b]).all()]

    def off(a, b, p):
        along = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        return np.linalg.norm(a + along * (b - a) - p)

    # flights fly up to a corridor's width beside the path
    from_path = min(off(a, b, np.array(place)) for a, b in pairs)
    assert from_path == pytest.approx(nearest["margin_m"], abs=4.5)
    corridor = next(p for p in above.paths if p.get("data-part", "").startswith("corridor"))
    assert corridor.get("data-part") == "corridor"  # 4 m of 300 need no factor of 2
    assert corridor.get("d").endswith("Z")
    ((x, low, high),) = height.bands()
    row = next(x for x in band.answer().tables[0].records if x["signal"] == "height_err")
    assert (-np.nanmax(high), -np.nanmin(low)) == pytest.approx((row["low"], row["high"]), abs=0.01)
    assert height.x_ends == pytest.approx([0.0, x.max()], abs=1e-3)
    (planned,) = height.lines(part="planned")
    assert planned[1] == pytest.approx(np.zeros(len(planned[1])), abs=0.05)


def axis_of(values, row):
    """From the best candidate to a little beyond bound, start and result, with a twentieth."""
    marked = [row[key] for key in ("bound", "start", "value") if np.isfinite(row[key])]
    finite = [*marked, *(x for x in values if np.isfinite(x))]
    wide = max(marked) - min(marked) or abs(row["bound"])
    low, high = max(min(finite), min(marked) - wide), min(max(finite), max(marked) + wide)
    room = 0.05 * (high - low) or wide
    return [low - room, high + room]


@pytest.mark.soak
def test_the_page_of_a_search_has_its_candidates_between_bounds_start_and_result(results):
    meeting = results.of("meeting")
    turn = results.folder / "meet.toml"
    scenario_file(turn, meeting.scenario)
    command = ["meet", turn.name, "--budget", "12", "--page", "met.html", "--workers", "1"]
    flighttune(*command, cwd=results.folder)

    page = (results.folder / "met.html").read_text(encoding="utf-8")
    charts = [x for x in drawn(page) if " against " in x.title]
    itae, gain, phase = meeting.requirements
    every = [[trial.checks[0][i].value for trial in meeting.trials] for i in range(3)]
    places = {id(row): values for row, values in zip((itae, gain, phase), every, strict=True)}
    for chart, (across, up) in zip(
        charts, ((phase, itae), (phase, gain), (itae, gain)), strict=True
    ):  # those with the least to spare come first
        x, y = places[id(across)], places[id(up)]
        assert chart.x_ends == pytest.approx(axis_of(x, across), rel=1e-4)
        assert chart.y_ends == pytest.approx(axis_of(y, up), rel=1e-4)
        upright = next(p for p in chart.paths if "V" in p.get("d"))
        level = next(p for p in chart.paths if "H" in p.get("d"))
        off = [2.0 * chart.off(1.0, axis) for axis in ("x", "y")]
        assert chart.curve(upright)[0][0] == pytest.approx(across["bound"], abs=off[0])
        assert chart.curve(level)[1][0] == pytest.approx(up["bound"], abs=12.0 * off[1])
        candidates, start, result = chart.points()
        ends = np.array([chart.x_ends, chart.y_ends])
        far = ends[:, :1] - 10.0 * np.ptp(ends, axis=1)[:, None]
        near = ends[:, :1] + 11.0 * np.ptp(ends, axis=1)[:, None]
        places_of = np.clip([x, y], far, near)  # what is further out is drawn there
        there = ~np.isnan(np.array(x) + np.array(y))
        for found, wanted, axis in zip(candidates[:2], places_of, ends, strict=True):
            assert found == pytest.approx(wanted[there], abs=0.05 * np.ptp(axis))
        for (a, b, _), key in ((start, "start"), (result, "value")):
            if np.isfinite([across[key], up[key]]).all():
                at = across[key], up[key]
                assert (float(a[0]), float(b[0])) == pytest.approx(at, rel=0.01)
        # a candidate that misses another requirement is hollow
        (third,) = {0, 1, 2} - {[itae, gain, phase].index(r) for r in (across, up)}
        met = np.array([trial.excess[0][third] <= 0.0 for trial in meeting.trials])[there]
        hollow = [one.get("fill") == "var(--paper)" for one in chart.dots[0]]
        assert hollow == (~met).tolist()
        sizes = [float(group[0].get("r") or 5.0) for group in chart.dots]
        assert sizes == [2.5, 5.0, 5.0]
    assert "paper" in page
    assert {"kinematic / found", "kinematic / paper"} <= {*re.findall(r'data-run="([^"]*)"', page)}
    flighttune("tune", turn.name, "--page", "tuned.html", cwd=results.folder)
    tuned = (results.folder / "tuned.html").read_text(encoding="utf-8")
    row = next(x for x in facts_of(tuned) if x[0] == "kinematic" and len(x) > 4)
    own = ft.fly(meeting.scenario, "tuned").runs[0]
    with_paper = ft.fly(meeting.scenario, "paper").runs[0]
    told = [float(row[i]) for i in (3, 4)]
    wanted = [ft.loop.channel_metrics(run).at["chi", "ITAE"] for run in (own, with_paper)]
    assert told == pytest.approx(wanted, rel=2e-3)
    assert "Requirements met: kinematic 1/1." in tuned
