"""Charts of pages and sheets hold the numbers of what they are about, read back from the SVG."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from commands import answer, flighttune
from drawn import apart, box_of, drawn, faults, number

import flighttune as ft

DEG = 180.0 / np.pi
FACTORS = {"deg": DEG, "m": 1.0, "1": 1.0, "m/s": 1.0}
# Charts of runs by the beginning of their title, and the signal of their lines.
SIGNALS = {
    "Course; reference": "chi", "Path angle; reference": "gamma", "Course error": "chi_err",
    "Path-angle error": "gamma_err", "Roll command": "phi_cmd", "Load-factor command": "n_z_cmd",
    "Roll": "phi", "Load factor": "n_z",
}  # fmt: skip


def same(chart, curve, x, y):
    """Whether a curve lies on a polyline: each of its points has its value there."""
    (a, b), x, y = curve, np.asarray(x, float), np.asarray(y, float)
    there = np.isfinite(a)
    at = np.abs(np.subtract.outer(a[there], x)).argmin(axis=1)
    off = 2.0 * np.broadcast_to(chart.off(b[there], "y"), at.shape)
    assert np.abs(a[there] - x[at]).max() <= 2.0 * np.max(chart.off(a[there], "x")), chart.title
    assert (np.abs(b[there] - y[at]) <= off).all(), chart.title
    assert len(at) > 0.5 * min(len(x), 600)


def check_runs(charts, runs):
    """Each chart of a signal has a line of each run, which is that signal in its unit."""
    seen = set()
    for chart in charts:
        signal = next((s for begin, s in SIGNALS.items() if chart.title.startswith(begin)), None)
        if signal is None or chart.x != "t [s]":
            continue
        factor = FACTORS[re.search(r"\[(.*)\]", chart.y)[1]]
        seen.add(signal)
        for run in runs:
            values = run.signals[signal].to_numpy()
            values = np.unwrap(values) if signal == "chi" else values
            lines = [x for x in chart.lines(run.label) if len(x[0]) > 2]
            same(chart, lines[0], run.t, factor * values)
            if f"{signal}_ref" in run.signals:
                reference = next(x for x in chart.lines() if len(x[0]) > 2)
                same(chart, reference, run.t, factor * run.signals[f"{signal}_ref"].to_numpy())
    return seen


@cache
def commanded(folder, command, file):
    flighttune(*command.split(), cwd=folder)
    return drawn((folder / file).read_text(encoding="utf-8"))


def sound(charts):
    assert charts
    assert {chart.title: faults(chart) for chart in charts if faults(chart)} == {}
    return charts


def titled(charts, begin):
    return next(chart for chart in charts if chart.title.startswith(begin))


@pytest.fixture(scope="module")
def of_runs(results, tmp_path_factory):
    """The page of two gain sets on two plants, its report and its runs."""
    flown, path = results.of("flown"), tmp_path_factory.mktemp("page") / "page.html"
    report = ft.report(flown, path)
    return sound(drawn(path.read_text(encoding="utf-8"))), report, flown


@pytest.mark.slow
def test_a_page_of_runs_draws_their_signals_references_commands_and_paths(of_runs):
    charts, _, flown = of_runs

    wanted = {"chi", "gamma", "chi_err", "gamma_err", "phi_cmd", "n_z_cmd"}
    assert check_runs(charts, flown.runs) == wanted
    for begin, ends, name in (
        ("Roll command", (-45.0, 45.0), "phi"), ("Load-factor command", (-2.1, 2.1), "n_z")
    ):  # fmt: skip
        chart = titled(charts, begin)
        levels = [y[0] for x, y in chart.lines(run=None) if len(x) == 2 and x[0] == 0.0]
        for end in ends:
            assert min(abs(level - end) for level in levels) <= 2.0 * chart.off(end, "y")
        lanes = []
        for run in flown.runs:
            held = run.signals[f"{name}_limited"].to_numpy() != 0.0
            pieces = [one for one in chart.paths if one.get("data-run") == run.label]
            bars = [one for one in pieces if "H" in one.get("d")]
            assert len(bars) == held.any()
            for bar in bars:
                x, y = chart.curve(bar)
                begins, stops = np.nanmin(x), np.nanmax(x)
                assert begins == pytest.approx(run.t[held].min(), abs=0.02)
                assert stops == pytest.approx(run.t[held].max() + 0.02, abs=0.03)
                drawn_s = np.nansum(np.diff([*x.tolist(), np.nan])[::3])
                assert drawn_s == pytest.approx(0.02 * held.sum(), abs=0.06)
                lanes.append(float(y[0]))
        assert len({*lanes}) == len(lanes)
        assert max(lanes, default=-1e9) < ends[0]  # below all lines
    above, height = titled(charts, "From above"), titled(charts, "Height over")
    across, up = (name.split()[0] for name in (above.x, above.y))
    assert above.equal
    for run in flown.runs:
        same(above, above.lines(run.label)[0], run.signals[across], run.signals[up])
        same(height, height.lines(run.label)[0], run.t, -run.signals["down"])
    assert [float(v) for v in (above.points()[0][0][0], above.points()[0][1][0])] == pytest.approx(
        [0.0, 0.0], abs=0.2
    )


@pytest.mark.slow
def test_bars_of_a_gap_go_from_the_law_to_the_aircraft(of_runs):
    charts, _, flown = of_runs
    runs = {run.label: run for run in flown.runs}
    for gains in ("paper", "K1"):
        for channel, words in (("chi", "course"), ("gamma", "path angle")):
            chart = titled(charts, f"{gains}: {words}, ITAE")
            middle, low, high = chart.bars()
            ends = [
                ft.loop.channel_metrics(runs[f"{plant} / {gains}"]).at[channel, "ITAE"]
                for plant in ("kinematic", "jsbsim:aerosonde")
            ]
            off = 8.0 * chart.off(high.max(), "y")
            assert middle == pytest.approx(np.arange(5.0), abs=0.01)
            assert (low[0], low[-1]) == pytest.approx((0.0, 0.0), abs=off)
            assert (high[0], high[-1]) == pytest.approx(ends, abs=off)
            least, most = min(0.0, 1.1 * low.min()), 1.12 * high.max()
            assert chart.y_ends == pytest.approx([least, most], abs=0.02 * most)
            sums = np.array([ends[0], *(high - low)[1:-1]])
            joints = chart.lines()
            assert [x.tolist() for x, _ in joints] == [
                pytest.approx([i - 0.32, i + 1.32], abs=0.02) for i in range(len(sums))
            ]
            assert {x.get("stroke-width") for x in chart.paths} == {"0.8"}
            assert joints[-1][1] == pytest.approx(ends[1], abs=off)
            assert joints[0][1] == pytest.approx(ends[0], abs=off)
            told = [number(text.replace("+", "")) for text in chart.texts()]
            assert (told[0], told[-1]) == pytest.approx(ends, abs=0.0051)
            assert np.abs(told[1:-1]) == pytest.approx((high - low)[1:-1], abs=0.0051 + off)
            assert sum(told[:-1]) == pytest.approx(told[-1], abs=0.03)
            added = titled(charts[charts.index(chart) :], f"{gains}: {words}, what each")
            pieces = [x for x in added.lines() if len(x[0]) > 2]
            total = sum(np.interp(runs[f"kinematic / {gains}"].t, *piece) for piece in pieces[:-1])
            whole = np.interp(runs[f"kinematic / {gains}"].t, *pieces[-1])
            assert total == pytest.approx(whole, abs=6.0 * added.off(1.0, "y"))
            law, craft = (
                runs[f"{p} / {gains}"].signals[channel].to_numpy()
                for p in ("kinematic", "jsbsim:aerosonde")
            )
            assert whole == pytest.approx(DEG * (craft - law), abs=0.02)


@pytest.mark.slow
def test_the_norm_of_a_run_stays_below_its_bound_and_begins_with_it(of_runs):
    charts, report, _ = of_runs
    for gains in ("paper", "K1"):
        chart = titled(charts, f"{gains}: ‖s‖")
        size, bound = chart.lines()
        assert chart.log == "y"
        assert (size[1] <= 1.001 * np.interp(size[0], *bound)).all()
        rates = {x["gains"]: x["rate"] for t in report.tables for x in t.records if "rate" in x}
        decay = np.polyfit(bound[0], np.log(bound[1]), 1)[0]
        if gains in rates:
            assert -decay == pytest.approx(0.5 * rates[gains], rel=0.35)


@pytest.mark.slow
def test_tables_of_a_page_have_the_numbers_of_their_runs(of_runs):
    _, report, flown = of_runs
    tables = {table.name: table for table in report.tables}
    runs = {run.label: run for run in flown.runs}
    for row in tables["convergence"].records:
        run = runs[row["run"]]
        late = run.t >= 0.75 * run.t[-1]
        for channel in ("chi", "gamma"):
            errors = np.abs(run.signals[f"{channel}_err"].to_numpy())
            assert row["residual"][channel] == pytest.approx(errors[late].max())
            wanted = max(0.05 * errors.max(), 0.5 / DEG)
            assert row["allowed"][channel] == pytest.approx(wanted)
        inside = all(row["residual"][x] <= row["allowed"][x] for x in ("chi", "gamma"))
        assert row["converges"] == inside
        assert row["requirements"].startswith("1 of 1 met")
    for row in tables["aircraft"].records:
        paths = [
            runs[f"{row[end]} / {row['gains']}"].signals[["north", "east", "down"]].to_numpy()
            for end in ("from", "to")
        ]
        apart_m = np.linalg.norm(paths[1] - paths[0], axis=1)
        assert row["max_distance_m"] == pytest.approx(apart_m.max(), abs=0.05)
        assert row["max_distance_at_s"] == pytest.approx(0.02 * apart_m.argmax())
    assert {row["gains"] for row in tables["aircraft"].records} == {"paper", "K1"}
    assert [row["run"] for row in tables["runs"].records] == [*runs]
    for row in tables["gains"].records:
        loop = ft.loop.closed_loop(
            ft.loop.kinematic_model(V_a=25.0, gamma=0.0, g=9.81), ft.load_gains(row["gains"])
            if row["gains"].endswith(".json") else ft.PIGains(K_P=row["K_P"], K_I=row["K_I"]),
        )  # fmt: skip
        assert row["R_K"] == pytest.approx(ft.loop.indicators(loop).R_K, rel=1e-3)


@pytest.fixture(scope="module")
def around(results, tmp_path_factory):
    """A page of a run with a tube and a band around it, and both."""
    folder = tmp_path_factory.mktemp("around")
    scenario = results.of("band").flights.scenario
    flown = ft.fly(scenario)
    ft.record(flown, folder / "run")
    tube, band = results.of("tube"), results.of("band")
    tube.save(folder / "t.npz")
    band.save(folder / "b.npz")
    files = [folder / "t.npz", folder / "b.npz"]
    ft.report(folder / "run", folder / "page.html", claims=files)
    return (
        sound(drawn((folder / "page.html").read_text(encoding="utf-8"))),
        tube,
        band,
        flown.runs[0],
    )


@pytest.mark.soak
def test_bounds_of_claims_are_drawn_around_errors_in_degrees(around, results):
    charts, tube, band, run = around
    for claim, place in ((tube, 0), (band, 1)):
        bounds = claim.on(run).bounds
        for title, signal in (("Course error", "chi_err"), ("Path-angle error", "gamma_err")):
            chart = titled(charts, title)
            x, low, high = chart.bands()[place]
            i = bounds.names.index(signal)
            for found, wanted in ((low, bounds.low), (high, bounds.high)):
                same(chart, (x, found), bounds.t, DEG * wanted[:, i])
        (proven, counted) = [x for x in chart.paths if x.get("class") == "band"]
        assert "var(--neutral)" in counted.get("style")
        assert "var(--neutral)" not in proven.get("style")
        edges = [x for x in chart.paths if x.get("stroke-dasharray") == "1.5 2.5"]
        assert [x.get("stroke-width") for x in edges] == ["1.2", "1.2"]
    own = sound(drawn(ft.plot(tube).svg()))
    assert own[0].x_ends == pytest.approx([0.0, tube.bounds.t[-1]])
    zero, lower, upper = [x for x in own[0].paths if x.get("class") != "band"]
    assert own[0].curve(zero)[1] == pytest.approx([0.0, 0.0], abs=10.0 * own[0].off(0.0, "y"))
    assert [x.get("stroke-width") for x in (lower, upper)] == ["1.2", "1.2"]
    for line, wanted in ((lower, tube.bounds.low), (upper, tube.bounds.high)):
        same(own[0], own[0].curve(line), tube.bounds.t, DEG * wanted[:, 0])
    x, low, high = own[0].bands()[0]
    i = tube.bounds.names.index("chi_err")
    same(own[0], (x, high), tube.bounds.t, DEG * tube.bounds.high[:, i])


def test_a_sheet_of_flights_has_a_line_of_each_run_and_its_limits(results):
    flown = results.of("missed")

    charts = sound(drawn(ft.plot(flown).svg()))

    assert check_runs(charts, flown.runs) == {"chi_err", "gamma_err", "phi", "n_z"}
    assert {y[0].round(1) for x, y in titled(charts, "Roll").lines() if len(x) == 2} == {
        -45.0,
        45.0,
    }
    only = [replace(run, signals=run.signals[:1]) for run in flown.runs]
    with pytest.raises(ft.InputError, match="must have a run that flew"):
        ft.plot(only)
    longer = replace(only[0], signals=flown.runs[0].signals[:11])
    (course, *_) = drawn(ft.plot([longer, flown.runs[1]]).svg())
    assert course.x_ends == [0.0, 9.0]
    assert np.nanmax(course.lines(longer.label)[0][0]) == pytest.approx(0.2, abs=0.02)


@pytest.mark.slow
def test_the_curves_of_a_loop_are_those_of_the_closed_form(tmp_path):
    """A decoupled loop is two integrators and a zero, times g/V."""
    K_P, K_I = (1.7, 2.1), (0.6, 0.9)
    gains, b = ft.PIGains(K_P=np.diag(K_P), K_I=np.diag(K_I)), 9.81 / 25.0

    gains.save(tmp_path / "g.json")
    command = (
        "certify",
        "level_turn",
        "--gains",
        tmp_path / "g.json",
        "--figure",
        tmp_path / "c.svg",
    )
    flighttune(*command)
    sheet = (tmp_path / "c.svg").read_text(encoding="utf-8")
    magnitude, phase, nyquist, plane = sound(drawn(sheet))[:4]

    (level,), (lag,) = ([x for x in c.lines() if len(x[0]) == 2 and x[0][0] <= c.x_ends[0]]
                        for c in (magnitude, phase))  # fmt: skip
    assert (level[1][0], lag[1][0]) == (pytest.approx(0.0, abs=0.1), pytest.approx(-180.0, abs=0.2))
    circle = nyquist.lines()[0]
    assert np.hypot(*circle) == pytest.approx(1.0, abs=0.02)
    assert nyquist.points()[0][0][0] == pytest.approx(-1.0, abs=0.01)
    assert nyquist.dots[0][0].get("d").endswith("l12,-12")
    (disk,) = [x for x in nyquist.paths if (x.get("data-part") or "").startswith("disk margin")]
    x, _ = nyquist.curve(disk)
    said = answer("certify", "level_turn", "--gains", tmp_path / "g.json")["margins"][-1]
    assert np.nanmin(x) == pytest.approx(-said["gain_increase"], rel=0.02)
    assert np.nanmax(x) == pytest.approx(-said["gain_decrease"], rel=0.02)
    assert float(disk.get("data-part").split()[-1]) == pytest.approx(said["disk_margin"], abs=0.006)
    poles = np.concatenate([np.roots([1.0, b * p, b * i]) for p, i in zip(K_P, K_I, strict=True)])
    for k, (p, i) in enumerate(zip(K_P, K_I, strict=True)):
        size, angle = ([x for x in c.lines() if len(x[0]) > 300][k] for c in (magnitude, phase))
        s = 1j * size[0]
        wanted = 20.0 * np.log10(np.abs(b * (p * s + i) / s**2))
        assert size[1] == pytest.approx(wanted, abs=0.3)
        assert size[0][0] < 0.1 * np.abs(poles).min()
        assert size[0][-1] > 10.0 * np.abs(poles).max()
        lag = np.degrees(np.arctan(p * angle[0] / i)) - 180.0
        assert angle[1] == pytest.approx(lag, abs=0.5)
        real, imaginary = [x for x in nyquist.lines() if len(x[0]) > 300][2 * k]
        again, mirrored = [x for x in nyquist.lines() if len(x[0]) > 300][2 * k + 1]
        assert (again, mirrored) == (pytest.approx(real), pytest.approx(-imaginary, abs=0.05))
        # |L| = 1: w^4 = (g/V)^2 (P^2 w^2 + I^2), and the phase is atan(P w / I) - 180 deg
        w = np.sqrt(((b * p) ** 2 + np.sqrt((b * p) ** 4 + 4.0 * (b * i) ** 2)) / 2.0)
        margin = np.degrees(np.arctan(p * w / i))
        x, y, (tip,) = phase.points()[k]
        assert (x[0], y[0]) == (pytest.approx(w, rel=0.02), pytest.approx(margin - 180.0, abs=0.5))
        told = [float(v) for v in re.findall(r"[\d.]+", tip.split(":")[1])]
        assert told == pytest.approx([margin, w], abs=0.06)
    x, y, _ = plane.points()[0]
    for pole in poles:
        assert np.abs(x + 1j * y - pole).min() < 0.01
    assert nyquist.x_ends[0] < -1.0 < nyquist.x_ends[1]
    low, high = plane.x_ends
    assert low < min(poles.real) < 0.0 < high
    # 15 % beyond the fastest, and as much to the right of the axis
    assert (low + high) / 2.0 == pytest.approx(0.5 * poles.real.min(), rel=1e-3)
    decades = np.abs(poles).min() * 10.0**-1.5, np.abs(poles).max() * 10.0**1.5
    assert phase.x_ends == pytest.approx([decades[0] / 1.05, decades[1] * 1.05], rel=1e-3)


@pytest.mark.soak
def test_a_rate_over_an_envelope_falls_with_its_size_to_what_is_certified_over_all(tmp_path):
    command = "certify", "paper", "--gains", "paper", "--envelope", "--out", tmp_path / "c.json"
    flighttune(*command, "--figure", tmp_path / "c.svg")
    chart = sound(drawn((tmp_path / "c.svg").read_text(encoding="utf-8")))[-1]

    (x, y), *_ = [line for line in chart.lines() if len(line[0]) > 2]
    rate = ft.load(tmp_path / "c.json").claim.rate
    assert (x[0], chart.x_ends[0]) == (0.0, 0.0)
    assert (np.diff(y) <= 1e-9).all()
    assert np.interp(100.0, x, y) == pytest.approx(rate, rel=0.1)


@pytest.mark.slow
def test_marks_of_gains_stand_at_their_indicators_below_the_frontier(results):
    made = results.of("frontier")
    rows = made.table.to_dict(orient="records")
    along = [row for row in rows if row["name"] == "frontier"]
    for chart, key in zip(sound(drawn(made.sheet.svg())), ("I_K", "E_K"), strict=True):
        line = next(x for x in chart.lines() if len(x[0]) == len(along))
        order = sorted(along, key=lambda row: row[key])
        for found, name in ((line[0], key), (line[1], "R_K")):
            wanted = [row[name] for row in order]
            assert np.sort(found) == pytest.approx(np.sort(wanted), rel=0.01)
        tips = [
            (x, y, tip) for group in chart.points() for x, y, tip in zip(*group, strict=True) if tip
        ]
        assert len(tips) >= 5
        for x, y, tip in tips:
            told = [float(v) for v in re.findall(r"[A-Z]_K ([\d.]+)", tip)]
            assert told == pytest.approx([float(y), float(x)], rel=0.01)
        names = [box_of(one) for one in chart.plot.iter("text")]
        assert apart(names)
        shown = [row for row in rows if row["name"] == "frontier" or row["R_K"] > 0.0]
        sizes, rates = ([row[name] for row in shown] for name in (key, "R_K"))
        low, high = min(rates), max(rates)
        room = 0.05 * (high - low) + 0.08 * 1.1 * (high - low)
        assert chart.y_ends == pytest.approx([low - room, high + room], rel=1e-4)
        wide = max(sizes) > 10.0 * min(sizes)
        assert chart.log == "x" * wide
        ends = np.array([min(sizes), max(sizes)])
        if wide:
            ends = ends * [1.0 / 1.05, 1.05]
            ends = ends * (ends[1] / ends[0]) ** np.array([-0.08, 0.08])
        else:
            ends = ends + 0.08 * np.ptp(ends) * np.array([-1.0, 1.0])
        assert chart.x_ends == pytest.approx(ends, rel=1e-4)
        hollow = {tip.partition(":")[0] for _, _, tip in tips if "beyond" in tip}
        assert hollow == {
            row["name"] for row in rows if row["R_K"] > 0.0 and not row["within_limits"]
        }
        fills = [group[0].get("fill") for group in chart.dots]
        assert fills.count("var(--paper)") == len(hollow)


@pytest.mark.slow
def test_the_page_of_a_campaign_has_the_shares_steps_and_dots_of_its_rows(results):
    results.of("campaign")
    charts = sound(commanded(results.folder, "report flown --out campaign.html", "campaign.html"))

    rows = pd.read_parquet(results.folder / "flown/runs")
    shares, steps = titled(charts, "Flights that succeed"), titled(charts, "Flights by")
    groups = rows.groupby("gains", sort=False)
    told, ends = shares.texts(), []
    assert len(told) == 2
    for name, own in groups:
        (text,) = [x for x in told if f"/ {name}:" in x]
        share, low, high = (float(x) for x in re.findall(r"[\d.]+", text.split(":")[-1]))
        n, k, z = len(own), int(own["success"].sum()), 1.959964
        middle = (k + z * z / 2.0) / (n + z * z)
        half = z / (n + z * z) * np.sqrt(k * (n - k) / n + z * z / 4.0)
        wanted = 100.0 * np.array([k / n, middle - half, middle + half])
        assert [share, low, high] == pytest.approx(wanted, abs=0.06)
        label = f"kinematic / {name}"
        x, y = shares.lines(label)[0]
        assert x == pytest.approx(wanted[1:], abs=2.0 * shares.off(100.0, "x"))
        assert y[0] == pytest.approx(y[1])
        x, y = steps.lines(label)[0]
        values = np.sort(own["chi.peak_rad"].to_numpy() * DEG)
        for value in (values[:-1] + values[1:])[:: max(1, n // 4)] / 2.0:
            below = 100.0 * (values <= value).mean()
            assert y[np.searchsorted(x, value, side="right") - 1] == pytest.approx(below, abs=0.6)
        assert any(x == pytest.approx(wanted[:1], abs=0.1) for x, _, _ in shares.points())
        ends.append(wanted)
    ends = np.array(ends)
    room = 6.0 * max((ends[:, 2].max() - ends[:, 1].min()) / 100.0, 0.01)
    wanted = [max(-2.0, ends[:, 1].min() - room), min(102.0, ends[:, 2].max() + 2.5 * room)]
    assert shares.x_ends == pytest.approx(wanted, rel=1e-3)
    assert sorted(shares.y_ends) == [0.0, 2.0]
    ups = sorted(
        {float(y[0]) for label in groups.groups for _, y in shares.lines(f"kinematic / {label}")}
    )
    assert ups == pytest.approx([0.5 + 9.0 / 96.0, 1.5 + 9.0 / 96.0], abs=0.002)
    values = DEG * rows["chi.peak_rad"]
    inner = np.concatenate([
        np.sort(DEG * own["chi.peak_rad"].to_numpy()) for _, own in groups
    ])  # fmt: skip
    low, high = np.quantile(inner, [0.005, 0.995])
    low, high = min(low, 7.0), max(high, 7.0)
    assert steps.x_ends == pytest.approx(
        [low - 0.04 * (high - low), high + 0.04 * (high - low)], rel=1e-3
    )
    assert steps.y_ends == pytest.approx([0.0, 102.0])
    assert values.max() >= high
    of_n = titled(charts, "Success rate")
    assert of_n.log == "x"
    for name, own in groups:
        x, y = of_n.lines(f"kinematic / {name}")[0]
        met = own.sort_values("run")["success"].to_numpy()
        for n, share in zip(np.rint(x).astype(int), y, strict=True):
            assert share == pytest.approx(100.0 * met[:n].mean(), abs=1.0)
    (bound,) = [x[0] for x, y in steps.lines() if len(x) == 2 and x[0] == x[1]]
    assert bound == pytest.approx(7.0, abs=2.0 * steps.off(bound, "x"))
    dots = titled(charts, "ITAE of course over")
    for (x, y, tips), (_, own) in zip(dots.points()[::2], groups, strict=False):
        assert len(x) == len(own) == len({*tips})
        assert np.sort(y) == pytest.approx(np.sort(own["chi.ITAE"]), abs=12.0 * dots.off(0.01, "y"))
        assert np.sort(x) == pytest.approx(
            np.sort(DEG * np.radians(own["flight.chi_deg"])), abs=4.0 * dots.off(9.0, "x")
        )


@pytest.mark.soak
def test_the_page_of_a_corridor_has_its_map_and_its_flights_inside(results):
    band = results.of("corridor")
    command = "report corridor.npz --out corridor.html"
    charts = sound(commanded(results.folder, command, "corridor.html"))

    above = titled(charts, "Map")
    x, y = above.lines(part="planned path")[0]
    corner = [(0.0, 0.0), (0.0, 300.0), (250.0, 300.0)]
    assert (x[0], y[0]) == pytest.approx(corner[0], abs=0.6)
    assert (x[-1], y[-1]) == pytest.approx(corner[-1], abs=8.0)
    marks = np.array(above.points()[0][:2]).T
    assert marks == pytest.approx(np.array(corner), abs=0.6)
    assert {"1", "2", "3"} <= {*above.texts()}
    for row, begin in zip(band.answer().tables[0].records, ("To the right", "Below"), strict=True):
        chart = titled(charts, begin)
        _, low, high = chart.bands()[0]
        ends = np.nanmin(low), np.nanmax(high)
        off = 2.0 * chart.off(1.0, "y")
        assert ends == pytest.approx((row["low"], row["high"]), abs=off)
        lines = np.concatenate([y for x, y in chart.lines() if len(x) > 2])
        flown = np.nanmin(lines), np.nanmax(lines)  # those outside are drawn until they leave
        assert min(abs(a - b) for a, b in zip(flown, ends, strict=True)) < 0.05


@pytest.mark.slow
def test_the_page_of_a_log_and_of_a_comparison_draw_their_runs(results, tmp_path):
    results.of("of_log")
    page = ft.report(results.folder / "log.csv", tmp_path / "log.html").path
    (run,) = (ft.load(results.folder / "log.csv"),)
    assert check_runs(sound(drawn(page.read_text(encoding="utf-8"))), [run]) >= {"phi", "n_z"}
    for gains in ("paper", "K1"):
        flown = ft.fly(results.of("missed").scenario, gains)
        ft.record(flown, tmp_path / gains)
    flighttune("compare", "paper", "K1", "--out", "both.html", cwd=tmp_path)
    charts = sound(drawn((tmp_path / "both.html").read_text(encoding="utf-8")))
    runs = [ft.load(tmp_path / gains).runs[0] for gains in ("paper", "K1")]
    assert {"chi_err", "gamma_err"} <= check_runs(charts, runs)


@pytest.mark.soak
def test_sheets_of_aircraft_have_the_fits_and_steps_of_their_tables(results):
    designed = results.of("designed")
    steps = sound(drawn(designed.sheet().svg()))
    bank = titled(steps, "Load factor on the way")
    (level,) = [y[0] for x, y in bank.lines() if len(x) == 2]
    assert level == pytest.approx(np.sqrt(2.0), abs=bank.off(1.0, "y") * 2.0)
    first = designed.steps[0].V_a
    for chart, channel, unit, start in (
        (titled(steps, "Roll"), "phi", 1.0 / DEG, 0.0),
        (titled(steps, "Load factor, "), "n_z", 1.0, 1.0),
    ):  # fmt: skip
        own = [step for step in designed.steps if step.channel == channel]
        curves = [chart.curve(x) for x in chart.paths]
        responses = [
            c for c, x in zip(curves, chart.paths, strict=True) if not x.get("stroke-dasharray")
        ]
        for step, curve in zip(sorted(own, key=lambda x: x.V_a), responses, strict=True):
            same(chart, curve, step.signals["t"], step.signals[channel] / unit)
        commands = [
            c for c, x in zip(curves, chart.paths, strict=True) if x.get("stroke-dasharray")
        ]
        at_first = [step for step in own if step.V_a == first]
        assert len(commands) == len(at_first)
        rate = {"phi": designed.config.limits.phi_rate, "n_z": designed.config.limits.n_z_rate}[
            channel
        ]
        for step, (x, y) in zip(at_first, commands, strict=True):
            ramp = np.sign(step.size) * np.minimum(abs(step.size), rate * x)
            assert y == pytest.approx((start + ramp) / unit, abs=0.02 / unit)
    assert titled(steps, "Roll").y.endswith("[deg]")
    for chart, size in ((titled(steps, "Roll"), 30.0), (titled(steps, "Load factor"), 1.5)):
        ends = [y[-1] for x, y in chart.lines() if len(x) > 20]
        assert max(ends) == pytest.approx(size, rel=0.06)
    found = results.of("identified")
    fits = sound(drawn(found.sheet().svg()))
    for name, channel in (("Roll", "phi"), ("Load factor", "n_z")):
        lag = found.conditions[0].channels[channel].candidates[0].lag
        size, angle = (titled(fits, f"{name}: {of}") for of in ("command to", "its phase"))
        (level,) = [y[0] for x, y in size.lines() if len(x) == 2]
        assert level == pytest.approx(-3.01, abs=0.05)
        at = [float(x[0]) for x, _, _ in size.points() if len(x) == 1]
        assert at == [pytest.approx(lag.bandwidth, rel=0.01)]
        for chart, of in ((size, lambda x: 20.0 * np.log10(np.abs(x))),
                          (angle, lambda x: np.degrees(np.unwrap(np.angle(x))))):  # fmt: skip
            x, y = chart.lines(part=f"fit, order {lag.order}")[0]
            assert y == pytest.approx(of(lag.response(x)), abs=0.02 * np.ptp(y))
            measured = found.conditions[0].channels[channel].frequency
            flown = next(p for p in chart.points() if len(p[0]) > 5)
            assert flown[0] == pytest.approx(measured.omega, rel=0.01)
            assert flown[1] == pytest.approx(of(measured.own), abs=0.02 * np.ptp(flown[1]))
    held = [x for x in fits if x.title.startswith("Not used")]
    for chart, channel, unit in zip(held, ("phi", "n_z"), (1.0 / DEG, 1.0), strict=True):
        of = found.conditions[0].channels[channel]
        for name in ("commanded", "flown", "fit"):
            values = getattr(of, name) / unit
            same(
                chart,
                chart.lines(part=name)[0],
                np.arange(len(values)) * chart.x_ends[1] / (len(values) - 1),
                values,
            )
    assert len(fits) >= 4
    for chart in fits:
        pairs = [line for line in chart.lines() if len(line[0]) > 20]
        if "x" in chart.log and len(pairs) >= 2:
            spread = np.ptp(pairs[0][1])
            low = pairs[1][0] < 5.0
            apart_by = np.abs(np.interp(pairs[1][0], *pairs[0]) - pairs[1][1])[low]
            assert np.median(apart_by) < 0.2 * spread
