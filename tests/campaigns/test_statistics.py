"""What is said of a campaign's rows, beside SciPy, pandas and rows whose truth is known.

The rows are those of a flown campaign in which measures, statuses and successes are replaced in its
files, as any program that writes Parquet can.
"""

import hashlib
import io
import math
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from dispersed import KINEMATIC, one_of, plan_of, tables_of, uniform
from drawn import drawn
from scipy import integrate, optimize, stats

import flighttune as ft

pytestmark = pytest.mark.slow

DRAWS = 200
OTHER = "kinematic:other"
PLANTS = KINEMATIC, {**KINEMATIC, "name": "other"}
SPEED, ROLL = uniform("flight.V_a_mps", 23.0, 27.0), uniform("flight.phi_deg", -10.0, 10.0)
RATE = one_of("limits.n_z_rate_per_s[1]", 0.8, 1.0, 1.2)
WINDUP = one_of("controller.anti_windup", "none", "conditional")
BOUNDS = (
    {"at_most": {"chi": {"ITAE": 4.0, "settling_s": 5.0}}, "at_least": {"loop": {"R_K": 0.35}}},
    {"at_most": {"gamma": {"ITAE": 0.25}}, "plant": OTHER},
    {"at_least": {"gamma": {"ITAE": 0.5}}, "gains": "soft"},
)


def short(**tables):
    made = tables_of(PLANTS, **tables)
    made["flight"]["duration_s"] = 0.5
    return made


def replaced(source, folder, change, kept=None):
    """A copy of a campaign whose rows are changed, and of which these alone are there."""
    shutil.copytree(source, folder)
    table = ft.load(source).rows()
    rows = change(table.to_pandas())
    made = pa.Table.from_pandas(rows, table.schema, preserve_index=False)
    for part in (folder / "runs").iterdir():
        part.unlink()
    runs = [*range(len(rows))] if kept is None else sorted(kept)
    for span in np.split(runs, np.flatnonzero(np.diff(runs) > 1) + 1):
        first, stop, file = int(span[0]), int(span[-1]) + 1, io.BytesIO()
        pq.write_table(made.slice(first, stop - first), file)
        digest = hashlib.sha256(file.getvalue()).hexdigest()[:16]
        name = f"part-{first:010d}-{stop:010d}-{digest}.parquet"
        (folder / "runs" / name).write_bytes(file.getvalue())
    return folder


def truth(rows):
    """ITAE of course is 1 + (V - 23)^2 / 4 and a ripple with `paper`, half of it with `soft`.

    Above 26.9 m/s `paper` diverges on the other plant.
    """
    V, paper = rows["flight.V_a_mps"], rows["gains"] == "paper"
    ripple = 0.2 * np.cos(7.0 * rows["flight.phi_deg"])
    itae = (1.0 + (V - 23.0) ** 2 / 4.0 + ripple) * np.where(paper, 1.0, 0.5)
    itae = itae * np.where(rows["plant"] == OTHER, 1.5, 1.0)
    lost = (rows["plant"] == OTHER) & paper & (V > 26.9)
    rows["status"] = np.where(lost, "diverged", "completed")
    said = [
        f"the course error passed 180 deg at t = {v:.2f} s" if x else ""
        for v, x in zip(V, lost, strict=True)
    ]
    rows["reason"] = said
    rows["success"] = ~lost & (itae <= 4.0)
    miss = [f"chi.ITAE must be at most 4, got {x:.4g} (missed by {x - 4:.3g})" for x in itae]
    rows["missed"] = np.where(rows["success"], "", np.where(lost, "diverged: far", miss))
    rows["chi.ITAE"] = np.where(lost, 0.1, itae)
    rows["gamma.ITAE"] = np.where(lost, np.nan, 0.2 + 0.01 * rows["flight.phi_deg"].abs())
    rows["chi.settling_s"] = np.where(lost | (V > 26.0), np.nan, 3.0)
    return rows


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    out = tmp_path_factory.mktemp("flown") / "out"
    plan = plan_of(short(), SPEED, ROLL, RATE, WINDUP, runs=4 * DRAWS, success=[*BOUNDS])
    ft.run_campaign(plan, out)
    return out


@pytest.fixture(scope="module")
def known(flown, tmp_path_factory):
    return replaced(flown, tmp_path_factory.mktemp("known") / "out", truth)


@pytest.fixture(scope="module")
def rows(known):
    return ft.load(known).rows().to_pandas()


@pytest.fixture(scope="module")
def page(known):
    return ft.report(known)


@pytest.fixture(scope="module")
def told(page):
    return page.answer().values


def values_of(folder, tmp_path, change, **options):
    """What a report tells of changed rows of a campaign."""
    made = replaced(folder, tmp_path / "changed", change, options.pop("kept", None))
    return ft.report(made, **options).answer().values


def own(rows, group):
    return rows[(rows["plant"] == group["plant"]) & (rows["gains"] == group["gains"])]


def wilson(k, n, confidence=0.95):
    """Ends at which (p - x)^2 = z^2 x (1 - x) / n; `k` and `n` may be no whole numbers."""
    z2, p = stats.norm.ppf(0.5 + confidence / 2.0) ** 2, k / n

    def beyond(x):
        return (p - x) ** 2 - z2 * x * (1.0 - x) / n

    low = optimize.brentq(beyond, 0.0, p) if k else 0.0
    return low, optimize.brentq(beyond, max(p, 1e-9), 1.0) if k < n else 1.0


def of_scipy(k, n):
    interval = stats.binomtest(int(k), int(n)).proportion_ci(method="wilson")
    return interval.low, interval.high


def order_interval(values, q, confidence=0.95, m=None):
    """Order statistics around a quantile: the number below it is binomial."""
    x, tail = np.sort(values), 0.5 - confidence / 2.0
    n = len(x)
    m = n if m is None else math.floor(m)
    below = math.floor(sum(stats.binom.cdf(k, m, q) <= tail for k in range(m)) * n / m)
    above = math.ceil((sum(stats.binom.cdf(k, m, q) < 1.0 - tail for k in range(m)) + 1) * n / m)
    return [x[below - 1] if below else -np.inf, x[above - 1] if above <= n else np.inf]


def test_each_group_has_its_shares_and_endings_beside_pandas_and_scipy(told, rows, page):
    assert (told["runs"], told["planned"], told["interval"]) == (4 * DRAWS, 4 * DRAWS, "wilson")
    assert len(told["groups"]) == 4
    for group in told["groups"]:
        mine = own(rows, group)
        assert (group["n"], group["successes"]) == (DRAWS, mine["success"].sum())
        assert group["success"] == mine["success"].mean()
        assert (group["lo"], group["hi"]) == pytest.approx(of_scipy(mine["success"].sum(), DRAWS))
        assert group["statuses"] == mine["status"].value_counts().to_dict()
        lost = (mine["status"] == "diverged").sum()
        assert sum(x["count"] for x in group["reasons"]) == lost
        assert sum(x["count"] for x in group["missed"]) == DRAWS - group["successes"] - lost
    shares = [f"{x['group']} {x['successes']}/{DRAWS}" for x in told["groups"]]
    assert all(share in page.summary[0] for share in shares)
    (why,) = next(x["reasons"] for x in told["groups"] if x["reasons"])
    assert why["count"] > 1
    assert "passed 180 deg at t = 26.9" in why["reason"]
    assert " to 2" in why["reason"]


def test_measures_are_those_of_completed_flights_with_intervals_by_order_statistics(told, rows):
    for group in told["groups"]:
        done = own(rows, group)
        done = done[done["status"] == "completed"]
        for name in ("chi.ITAE", "gamma.ITAE", "chi.settling_s", "flight.n_z_max"):
            spread, x = group["metrics"][name], done[name].dropna().to_numpy()
            assert (spread["n"], spread["mean"]) == (len(x), pytest.approx(x.mean()))
            for q in (0.05, 0.5, 0.95):
                key = f"p{round(100 * q):02d}"
                assert spread[key] == pytest.approx(np.quantile(x, q))
                assert spread[f"{key}_interval"] == pytest.approx(order_interval(x, q))
        worst = done.sort_values(["chi.ITAE", "run"], ascending=[False, True]).head(5)
        assert [x["run"] for x in group["worst"]] == worst["run"].tolist()
        assert [x["chi.ITAE"] for x in group["worst"]] == worst["chi.ITAE"].tolist()
        keys = ["flight.V_a_mps", "flight.phi_deg", RATE["key"], WINDUP["key"]]
        assert [*group["worst"][0]["parameters"]] == keys
        assert group["worst"][0]["parameters"]["flight.phi_deg"] == worst["flight.phi_deg"].iloc[0]


def test_requirements_are_counted_over_completed_flights_the_most_missed_first(told, rows):
    done = rows[rows["status"] == "completed"]
    certified = {
        name: ft.certify(ft.scenario_from(short()), name).certificate for name in ("paper", "soft")
    }
    stated = {x["measure"]: x for x in told["requirements"] if x["measure"] != "gamma.ITAE"}
    most, least = sorted(
        (x for x in told["requirements"] if x["measure"] == "gamma.ITAE"),
        key=lambda x: x["sense"],
        reverse=True,
    )
    soft, law = done[done["gains"] == "soft"], done[done["plant"] == OTHER]

    assert [x["missed"] for x in told["requirements"]] == sorted(
        (x["missed"] for x in told["requirements"]), reverse=True
    )
    settling, itae, loop = stated["chi.settling_s"], stated["chi.ITAE"], stated["loop.R_K"]
    assert settling["missed"] == done["chi.settling_s"].isna().sum()  # it never settled
    assert settling["near"] is None  # more than 5 % never did
    assert (itae["missed"], itae["n"], itae["bound"]) == (
        (done["chi.ITAE"] > 4).sum(),
        len(done),
        4.0,
    )
    nearest = np.sort(done["chi.ITAE"])[math.ceil(0.95 * len(done)) - 1]
    assert itae["near"] == pytest.approx((nearest - 4.0) / 4.0)
    by_gains = {name: (done["gains"] == name).sum() for name in certified}
    assert loop["missed"] == sum(
        n for name, n in by_gains.items() if rows[rows["gains"] == name]["R_K"].iloc[0] < 0.35
    )
    assert (least["sense"], least["gains"], least["n"]) == ("at_least", "soft", len(soft))
    assert least["missed"] == (soft["gamma.ITAE"] < 0.5).sum() == len(soft)
    assert (most["sense"], most["plant"], most["n"]) == ("at_most", OTHER, len(law))
    assert most["missed"] == (law["gamma.ITAE"] > 0.25).sum()


def test_gain_sets_are_compared_draw_by_draw(told, rows):
    """With `paper` every ITAE is twice that with `soft`, and flights that diverged are lost."""
    assert len(told["paired"]) == 2
    for pair in told["paired"]:
        mine = rows[rows["plant"] == pair["plant"]]
        lost = mine["status"] != "completed"
        score = mine.assign(x=mine["chi.ITAE"].mask(lost, np.inf)).pivot(
            index="draw", columns="gains", values=["x", "success"]
        )
        a, b = (score["x", pair[x]].to_numpy(float) for x in "ab")
        ok_a, ok_b = (score["success", pair[x]].to_numpy(bool) for x in "ab")
        assert (pair["n"], pair["wins_a"], pair["wins_b"]) == (DRAWS, (a < b).sum(), (b < a).sum())
        assert pair["win_rate"] == pair["wins_a"] / DRAWS == 0.0
        assert (pair["lo"], pair["hi"]) == pytest.approx(wilson(0, DRAWS))
        apart = a - b
        assert pair["median"] == np.sort(apart)[99]
        assert [pair["median_lo"], pair["median_hi"]] == order_interval(apart, 0.5)
        only = (ok_a & ~ok_b).sum(), (ok_b & ~ok_a).sum()
        assert (pair["only_a"], pair["only_b"]) == only
        assert pair["p_success"] == pytest.approx(
            stats.binomtest(int(only[1]), int(sum(only))).pvalue
        )


def classes(column):
    """Values, or ten equal classes by rank where there are more than ten."""
    if column.nunique() <= 10:
        return column
    return np.floor((stats.rankdata(column) - 0.5) / len(column) * 10)


def test_influences_are_those_of_scipy_corrected_together_by_holm(told, rows):
    (group,) = (x for x in told["groups"] if x["group"] == "kinematic / paper")
    mine = own(rows, group)
    drawn = mine[["flight.V_a_mps", "flight.phi_deg", RATE["key"], WINDUP["key"]]]
    found = {x["parameter"]: x for x in group["sensitivity"]["chi.ITAE"]["ranks"]}
    ranks, p = stats.rankdata(mine["chi.ITAE"]), {}
    numbers = drawn.drop(columns=WINDUP["key"]).rank()
    word = (drawn[WINDUP["key"]] == "none").astype(float).rank()

    for name, column in drawn.items():
        one, labels = found[name], classes(column)
        H = stats.kruskal(*(ranks[labels == x] for x in np.unique(labels)))
        k = len(np.unique(labels))
        assert one["n"] == DRAWS
        assert one["share"] == pytest.approx((H.statistic - k + 1) / (DRAWS - k), abs=1e-9)
        p[name, "p_share"] = H.pvalue
        if name == WINDUP["key"]:
            assert math.isnan(one["rho"])
            assert math.isnan(one["partial"])
            continue
        rho = stats.spearmanr(column, ranks)
        p[name, "p_rho"] = rho.pvalue
        assert one["rho"] == pytest.approx(rho.statistic, abs=1e-12)
        # D. G. Bonett and T. A. Wright (2000)
        half = 1.959964 * math.sqrt((1.0 + one["rho"] ** 2 / 2.0) / (DRAWS - 3))
        middle = math.atanh(min(one["rho"], 1.0 - 1e-16))
        if one["rho"] < 0.999:
            ends = math.tanh(middle - half), math.tanh(middle + half)
            assert (one["lo"], one["hi"]) == pytest.approx(ends, abs=1e-6)
        others = np.column_stack([np.ones(DRAWS), numbers.drop(columns=name), word])
        left = [y - others @ np.linalg.lstsq(others, y)[0] for y in (numbers[name], ranks)]
        assert one["partial"] == pytest.approx(stats.pearsonr(*left).statistic, abs=1e-6)
    largest = 0.0
    for factor, (place, value) in zip(
        range(len(p), 0, -1), sorted(p.items(), key=lambda x: x[1]), strict=True
    ):
        largest = max(largest, min(1.0, factor * value))
        assert found[place[0]][place[1]] == pytest.approx(largest)
    assert next(iter(found)) == "flight.V_a_mps"
    assert {name: x["apart"] for name, x in found.items()} == {
        name: name == "flight.V_a_mps" for name in found
    }
    strengths = [
        max(x["share"], 0.0 if math.isnan(x["rho"]) else x["rho"] ** 2) for x in found.values()
    ]
    assert strengths == sorted(strengths, reverse=True)


def test_what_bends_is_found_by_its_share_and_success_is_split_by_its_classes(flown, tmp_path):
    def bent(rows):
        rows["chi.ITAE"] = 1.0 + rows["flight.phi_deg"] ** 2
        rows.loc[rows["draw"] % 9 == 0, "chi.ITAE"] = np.nan
        other = rows["plant"] == OTHER
        rows.loc[~other, RATE["key"]] = 1.0
        rows["status"], rows["success"] = "completed", rows[WINDUP["key"]] == "none"
        rows.loc[other, "success"] = rows[RATE["key"]] == 1.2
        rows["flight.V_a_mps"] = rows["flight.phi_deg"] * 2.0  # collinear
        return rows

    page = ft.report(replaced(flown, tmp_path / "changed", bent))
    for group in page.answer().values["groups"]:
        assert next(iter(group["sensitivity"]["success"]["ranks"]))["parameter"] == (
            RATE["key"] if group["plant"] == OTHER else WINDUP["key"]
        )
        ranks = group["sensitivity"]["chi.ITAE"]["ranks"]
        # drawn together they have the same share, and keep the order of the campaign
        names = [x["parameter"] for x in ranks]
        assert names[:2] == ["flight.V_a_mps", "flight.phi_deg"]
        # what does not vary is left out
        assert {*names[2:]} == {WINDUP["key"], *[RATE["key"]] * (group["plant"] == OTHER)}
        assert abs(ranks[1]["rho"]) < 0.3 < 0.7 < ranks[1]["share"]
        assert ranks[1]["n"] == DRAWS - 23
        assert [x["apart"] for x in ranks] == [True, True, *[False] * (len(ranks) - 2)]
        assert math.isnan(ranks[0]["partial"])
    of_word, of_rate = (
        x for x in drawn(page.path.read_text()) if x.title.startswith("Success over")
    )
    assert [label for label, _ in of_word.ticks()["x"]] == ["conditional", "none"]
    for chart, plant, centres in (
        (of_word, "kinematic", [0.0, 1.0]),
        (of_rate, OTHER, [0.8, 1.0, 1.2]),
    ):
        for gains in ("paper", "soft"):
            _, (x, rate) = chart.lines(run=f"{plant} / {gains}")
            assert x == pytest.approx(centres, abs=chart.off(1.0, "x"))
            assert rate == pytest.approx([*[0.0] * (len(x) - 1), 100.0], abs=chart.off(100.0, "y"))


def test_curves_are_of_the_first_flights_and_splits_of_five_classes_of_as_many(page, rows):
    label = rows["plant"] + " / " + rows["gains"]
    n = np.unique(np.geomspace(10, DRAWS, 25).round().astype(int))
    charts = {x.title: x for x in drawn(page.path.read_text())}
    (rate,), (p95,), (split,) = (
        [x for name, x in charts.items() if name.startswith(title)]
        for title in ("Success rate", "95th percentile", "Success over")
    )
    bands = iter(rate.bands())
    for group in label.unique():
        mine = rows[label == group]
        k = mine["success"].cumsum().to_numpy()[n - 1]
        (x, share), (_, low, high) = rate.lines(run=group)[0], next(bands)
        assert x == pytest.approx(n, rel=0.01)
        assert share == pytest.approx(100.0 * k / n, abs=rate.off(100.0, "y"))
        ends = 100.0 * np.array([of_scipy(*x) for x in zip(k, n, strict=True)])
        assert np.column_stack([low, high]) == pytest.approx(ends, abs=rate.off(100.0, "y"))
        (x, above), itae = p95.lines(run=group)[0], mine["chi.ITAE"]
        itae = itae.where(mine["status"] == "completed")
        assert x == pytest.approx(n, rel=0.01)
        assert above == pytest.approx(
            [itae.head(m).quantile(0.95) for m in n], abs=p95.off(above, "y").max()
        )
        if not split.lines(run=group):
            assert k[-1] == DRAWS  # nothing matters where all succeed
            continue
        by_speed = mine.sort_values("flight.V_a_mps")
        classes = [by_speed.iloc[i : i + 40] for i in range(0, DRAWS, 40)]
        (across, up), (x, share) = split.lines(run=group)
        assert x == pytest.approx(
            [c["flight.V_a_mps"].median() for c in classes], abs=split.off(27.0, "x")
        )
        k = np.array([c["success"].sum() for c in classes])
        assert share == pytest.approx(100.0 * k / 40, abs=split.off(100.0, "y"))
        ends = 100.0 * np.array([of_scipy(x, 40) for x in k])
        assert across[~np.isnan(across)] == pytest.approx(np.repeat(x, 2))
        assert up[~np.isnan(up)] == pytest.approx(ends.ravel(), abs=split.off(100.0, "y"))


def test_nine_flights_tell_no_influence_and_other_intervals_can_be_chosen(flown, tmp_path):
    chosen = {"interval": "clopper-pearson", "confidence": 0.9}
    told = values_of(flown, tmp_path, truth, kept=range(38), **chosen)
    rows = ft.load(tmp_path / "changed").rows().to_pandas()

    assert (told["interval"], told["confidence"], told["runs"]) == ("clopper-pearson", 0.9, 38)
    for group, n in zip(told["groups"], (10, 10, 9, 9), strict=True):
        ranks = group["sensitivity"]["chi.ITAE"]["ranks"]
        assert len(ranks) == 4 * (n == 10)
        assert all(x["n"] == 10 for x in ranks)
        expected = stats.binomtest(group["successes"], n).proportion_ci(0.9, method="exact")
        assert (group["lo"], group["hi"]) == pytest.approx((expected.low, expected.high))
        x = own(rows, group)
        x = x[x["status"] == "completed"]["chi.ITAE"]
        assert group["metrics"]["chi.ITAE"]["p50_interval"] == pytest.approx(
            order_interval(x, 0.5, 0.9)
        )
    for pair, n in zip(told["paired"], (10, 9), strict=True):
        assert (pair["lo"], pair["hi"]) == pytest.approx(wilson(0, n, 0.9))


def evidence(failures, n, q):
    """Mixtures of likelihood ratios against a probability q of failure, by quadrature."""

    def ratio(x):
        return math.exp(stats.binom.logpmf(failures, n, x) - stats.binom.logpmf(failures, n, q))

    top = min(1.0, 20.0 * q)
    below = (
        0.5 * (ratio(0.0) if failures == 0 else 0.0) + 0.5 * integrate.quad(ratio, 0.0, q)[0] / q
    )
    return below, integrate.quad(ratio, q, top)[0] / (top - q)


@pytest.mark.soak
def test_an_interval_at_any_time_is_of_the_first_flights_and_of_what_evidence_leaves(
    flown, tmp_path
):
    """A stop leaves rows after unfinished runs; both ends are where the evidence is 2 / 0.05."""
    kept = [run for run in range(4 * DRAWS) if run < 160 or run % 7 == 0]

    told = values_of(flown, tmp_path, truth, kept=kept, interval="any-time")

    assert {x["n"] for x in told["groups"]} == {40}
    for group in told["groups"]:
        failures = 40 - group["successes"]
        if group["hi"] < 1.0:
            assert evidence(failures, 40, 1.0 - group["hi"])[1] == pytest.approx(40.0, rel=1e-4)
        assert evidence(failures, 40, 1.0 - group["lo"])[0] == pytest.approx(40.0, rel=1e-4)
    with pytest.raises(ft.InputError, match="any-time must be with run 0"):
        ft.report(replaced(flown, tmp_path / "late", truth, range(1, 99)), interval="any-time")


@pytest.mark.parametrize("design", ["sobol", "latin_hypercube", "grid"])
def test_draws_that_are_not_independent_have_no_interval_at_any_time(design, tmp_path):
    cells = {"key": "flight.h_m", "distribution": "grid", "values": [400.0, 500.0]}
    plan = plan_of(short(), SPEED, *([cells] * (design == "grid")), design=design, runs=16)
    ft.run_campaign(plan, tmp_path / "out")

    with pytest.raises(ft.InputError, match=f"any-time must be with independent.*got {design}"):
        ft.report(tmp_path / "out", interval="any-time")


def test_flights_of_a_grid_count_as_their_effective_number(tmp_path):
    """Cells of a draw succeed together: variance of a ratio of totals, by L. Kish."""
    cells = {"key": "flight.h_m", "distribution": "grid", "values": [400.0, 450.0, 500.0, 550.0]}
    plan = plan_of(short(), ROLL, cells, runs=4 * 80)
    ft.run_campaign(plan, tmp_path / "out")

    def together(rows):
        point, cell = rows["draw"] // 4, rows["draw"] % 4
        rows["success"] = (point % 3 > 0) ^ ((point == 7) & (cell == 2))
        rows["chi.ITAE"], rows["status"] = 1.0 + point + 0.01 * cell, "completed"
        rows["gamma.ITAE"] = (1.0 + point) ** 2 * (1.0 + 1e-13 * (cell - 1.5))
        return rows

    told = values_of(tmp_path / "out", tmp_path, together)
    rows = ft.load(tmp_path / "changed").rows().to_pandas()
    for group in told["groups"]:
        mine = own(rows, group)
        flags, point = mine["success"].to_numpy(float), (mine["draw"] // 4).to_numpy()

        def size(x, point=point):
            totals = np.bincount(point, x - x.mean())
            return x.var() / (20 / 19 * (totals**2).sum() / 80**2)

        n = size(flags)
        assert group["n"] == 80
        assert 15.0 < n < 25.0
        assert (group["lo"], group["hi"]) == pytest.approx(wilson(flags.mean() * n, n))
        x, spread = mine["chi.ITAE"].to_numpy(), group["metrics"]["chi.ITAE"]
        below = (x <= np.quantile(x, 0.5)).astype(float)
        assert spread["p50_interval"] == order_interval(x, 0.5, m=size(below))
        # The last bits of equal values do not decide how wide an interval is.
        equal = (1.0 + point) ** 2
        below = (equal <= np.quantile(equal, 0.5)).astype(float)
        interval = group["metrics"]["gamma.ITAE"]["p50_interval"]
        assert interval == pytest.approx(order_interval(equal, 0.5, m=size(below)))


def test_rows_without_any_measure_still_tell_who_failed(flown, tmp_path):
    def none(rows):
        rows.iloc[:, rows.columns.get_loc("missed") + 1 :] = np.nan
        rows["status"], rows["success"] = "invalid", False
        rows["reason"] = "`flight.V_a_mps` must be finite"
        return rows

    told = values_of(flown, tmp_path, none)

    assert all((x["successes"], x["metrics"]) == (0, {}) for x in told["groups"])
    assert (told["worst_by"], told["paired"]) == (None, [])
    assert {x["near"] for x in told["requirements"]} == {None}
    assert {x["n"] for x in told["requirements"]} == {0}


def test_a_flight_that_misses_two_bounds_counts_for_both_and_numbers_are_ranges(flown, tmp_path):
    both = (
        "chi.MO_deg must be at most 5, got 7 (missed by 2); "
        "gamma.ITAE must be at most 1, got 2 (missed by 1)"
    )
    said = {0: both, 1: "chi.MO_deg must be at most 5, got 9 (missed by 4)", 2: ""}

    def missed(rows):
        rows["missed"] = (rows["draw"] % 3).map(said)
        rows["status"], rows["success"] = "completed", rows["draw"] % 3 == 2
        return rows

    (group, *_) = values_of(flown, tmp_path, missed, kept=range(16))["groups"]

    assert [(x["reason"], x["count"]) for x in group["missed"]] == [
        ("chi.MO_deg must be at most 5, got 7 to 9 (missed by 2 to 4)", 3),
        ("gamma.ITAE must be at most 1, got 2 (missed by 1)", 2),
    ]


def test_a_campaign_of_which_no_row_is_there_has_no_report(flown, tmp_path):
    shutil.copytree(flown, tmp_path / "out")
    for part in (tmp_path / "out/runs").iterdir():
        part.unlink()

    with pytest.raises(ft.RecordingError, match="no run has been flown yet"):
        ft.report(tmp_path / "out")
