"""What matters, against scipy, against closed forms, and on data whose truth is known."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from flighttune.campaigns.statistics import findings

pytestmark = pytest.mark.slow

ROUNDING = 1e-9


@pytest.fixture(scope="module")
def flown():
    """A measure of two numbers, a category, and one parameter that does nothing."""
    rng = np.random.default_rng(7)
    table = pd.DataFrame(
        {
            "speed": rng.normal(25.0, 1.0, 800),
            "bias": rng.normal(0.0, 1.0, 800),
            "kind": rng.choice(["calm", "gusty", "rough"], 800),
            "nothing": rng.uniform(size=800),
        }
    )
    bump = table["kind"].map({"calm": 0.0, "gusty": 0.5, "rough": 1.5})
    measure = table["speed"] + 3.0 * table["bias"] ** 2 + bump + rng.normal(0.0, 0.1, 800)
    return table, measure.to_numpy()


def of(found, name):
    return next(rank for rank in found if rank["parameter"] == name)


def test_rank_correlations_are_those_of_scipy(flown):
    table, measure = flown

    found = findings.influences(table, measure)

    tests = 2 * 4 - 1
    for name in ("speed", "nothing"):
        expected = stats.spearmanr(table[name], measure)
        assert of(found, name)["rho"] == pytest.approx(expected.statistic, abs=ROUNDING)
        assert of(found, name)["p_rho"] <= min(1.0, tests * expected.pvalue) + ROUNDING
        assert of(found, name)["p_rho"] >= expected.pvalue
    assert math.isnan(of(found, "kind")["rho"])


def test_the_share_is_epsilon_squared_of_kruskal_and_wallis(flown):
    table, measure = flown

    share = of(findings.influences(table, measure), "kind")["share"]

    samples = [measure[table["kind"] == kind] for kind in ("calm", "gusty", "rough")]
    H = stats.kruskal(*samples).statistic
    assert share == pytest.approx((H - 2) / (800 - 3), abs=ROUNDING)


def correlation_of_residuals(values, others, measure):
    """Correlation of what a regression of ranks on others leaves of values and measure."""
    ranks = stats.rankdata(values), stats.rankdata(measure)
    left = [y - others @ np.linalg.lstsq(others, y)[0] for y in ranks]
    return pytest.approx(stats.pearsonr(*left).statistic, abs=1e-7)


def test_partial_correlations_are_those_of_the_residuals(flown):
    table, measure = flown
    numbers = table[["speed", "bias", "nothing"]]

    found = findings.influences(numbers, measure)

    for name in numbers:
        others = np.column_stack([np.ones(800), numbers.rank().drop(columns=name)])
        expected = correlation_of_residuals(numbers[name], others, measure)
        assert of(found, name)["partial"] == expected


def test_parameters_drawn_together_stay_in_their_order():
    """Six starts, course and roll drawn at once: the same classes of flights, so the same share."""
    rng = np.random.default_rng(8)
    starts, tied = np.tile(np.arange(6), 36), 0
    for _ in range(20):
        chi, phi = rng.normal(size=(2, 6))
        table = pd.DataFrame({"chi": chi[starts], "phi": phi[starts]})
        bent = (rng.permutation(6) % 3)[starts] + rng.normal(0.0, 0.5, len(starts))

        found = findings.influences(table, bent)

        if all(one["share"] > one["rho"] ** 2 for one in found):
            tied += 1
            assert [one["parameter"] for one in found] == ["chi", "phi"]
    assert tied > 10


def test_what_bends_is_found_by_its_share_and_not_by_its_correlation(flown):
    found = findings.influences(*flown)

    assert found[0]["parameter"] == "bias"
    assert abs(found[0]["rho"]) < 0.1 < 0.5 < found[0]["share"]
    assert found[0]["apart"]
    assert of(found, "speed")["apart"]
    assert of(found, "kind")["apart"]
    assert not of(found, "nothing")["apart"]


@pytest.mark.soak
def test_the_interval_of_a_rank_correlation_covers():
    pearson = 0.6
    truth = 6.0 / np.pi * np.arcsin(pearson / 2.0)  # of two jointly normal numbers
    rng = np.random.default_rng(5)
    hits = 0
    for _ in range(300):
        x, noise = rng.normal(size=(2, 150))
        y = pearson * x + math.sqrt(1.0 - pearson**2) * noise
        (one,) = findings.influences(pd.DataFrame({"x": x}), y)
        hits += one["lo"] <= truth <= one["hi"]

    assert hits / 300 == pytest.approx(0.95, abs=0.03)


def test_nothing_is_said_of_what_does_not_vary(flown):
    table, measure = flown

    found = findings.influences(table.assign(speed=25.0), measure)

    assert "speed" not in [one["parameter"] for one in found]
    assert findings.influences(table, np.ones(800)) == []
    assert findings.influences(table[:5], measure[:5]) == []
    assert findings.influences(table[[]], measure) == []


def test_holm_corrects_as_in_his_paper():
    """Worked by hand: the smallest times 4, then 3, 2, 1, never falling."""
    assert findings.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert findings.holm([math.nan, 0.3]) == pytest.approx([1.0, 0.3])


@pytest.mark.parametrize(
    ("share", "rho"), [(0.1, -0.5), (0.1, 0.5), (0.25, -0.1), (0.25, math.nan), (math.nan, 0.5)]
)
def test_an_influence_is_as_strong_as_the_larger_share_that_it_explains(share, rho):
    """A rank correlation explains its square, falling or rising."""
    assert findings.strength({"share": share, "rho": rho}) == 0.25


@pytest.mark.parametrize("n", [9, 10])
@pytest.mark.parametrize("alike", ["measure", "parameter", "neither"])
def test_few_flights_equal_values_and_parameters_tell_nothing(n, alike):
    rng = np.random.default_rng(4)
    x, y = rng.normal(size=(2, n))
    measure = np.ones(n) if alike == "measure" else y
    parameters = pd.DataFrame({"a": np.ones(n) if alike == "parameter" else x, "same": 3.0})

    found = findings.influences(parameters, measure)

    assert [row["parameter"] for row in found] == (["a"] if n == 10 and alike == "neither" else [])


def test_flights_without_a_value_of_measure_or_parameter_are_left_out():
    x = np.arange(30.0)
    measure, other = x**3, np.cos(x)
    measure[[2, 5]], other[[5, 7, 9]] = np.nan, np.nan

    drawn = pd.DataFrame({"x": x, "other": other})

    found = {row["parameter"]: row for row in findings.influences(drawn, measure)}

    assert {row["n"] for row in found.values()} == {30 - 4}
    assert found["x"]["rho"] == pytest.approx(1.0)
    kept = ~(np.isnan(measure) | np.isnan(other))
    expected = stats.spearmanr(other[kept], measure[kept]).statistic
    assert found["other"]["rho"] == pytest.approx(expected)


def test_few_values_are_classes_of_their_own_and_many_are_split_into_equal_ones():
    few = pd.Series([1.0] * 56 + [3.0] * 2 + [2.0] * 2)
    many = pd.Series(np.arange(100.0)[::-1])

    assert findings.classes_of(few).tolist() == [0] * 56 + [2] * 2 + [1] * 2
    assert findings.classes_of(many, 4).tolist() == sorted([0, 1, 2, 3] * 25, reverse=True)


@pytest.mark.parametrize(
    ("values", "sizes"),
    [
        # at most ten values, of which each has five flights on average
        (
            np.repeat(np.arange(10.0), [1, 2, 3, 4, 5, 5, 6, 7, 8, 9]),
            [1, 2, 3, 4, 5, 5, 6, 7, 8, 9],
        ),
        (np.arange(110.0), [11] * 10),
        # at least five flights in a class, but two classes
        (np.arange(45.0), [5] * 9),
        (np.arange(27.0), [5, 6, 5, 6, 5]),
        (np.arange(8.0), [4, 4]),
        (np.arange(4.0), [2, 2]),
        # eleven values are more than ten, equal ones stay together
        (np.repeat(np.arange(11.0), 10), [10] * 5 + [20] + [10] * 4),
    ],
)
def test_classes_have_five_flights_and_are_ten_at_most(values, sizes):
    classes = findings.classes_of(pd.Series(np.random.default_rng(2).permutation(values)))

    assert np.bincount(classes).tolist() == sizes
    assert len(set(findings.classes_of(pd.Series(values.astype(str))))) == len(set(values))


@pytest.mark.parametrize(("confidence", "z"), [(0.95, 1.959964), (0.9, 1.644854)])
def test_the_interval_of_a_rank_correlation_is_that_of_bonett_and_wright(flown, confidence, z):
    table, measure = flown

    found = of(findings.influences(table, measure, confidence=confidence), "speed")

    half = z * math.sqrt((1.0 + found["rho"] ** 2 / 2.0) / (800 - 3))
    ends = math.tanh(math.atanh(found["rho"]) - half), math.tanh(math.atanh(found["rho"]) + half)
    assert (found["lo"], found["hi"]) == pytest.approx(ends, abs=1e-6)
    (line,) = findings.influences(pd.DataFrame({"x": np.arange(20.0)}), np.arange(20.0))
    assert (line["lo"], line["hi"]) == (1.0, 1.0)


def test_partial_correlations_are_with_categories_fixed_and_of_no_collinear_numbers(flown):
    table, measure = flown
    some = table[["kind", "speed", "bias"]]

    found = of(findings.influences(some, measure), "speed")

    kinds = np.column_stack([table["kind"] == x for x in ("calm", "gusty", "rough")])
    others = np.column_stack([kinds, table["bias"].rank()]).astype(float)
    assert found["partial"] == correlation_of_residuals(table["speed"], others, measure)
    assert math.isnan(of(findings.influences(some, measure), "kind")["partial"])
    twice = findings.influences(some.assign(double=2.0 * some["speed"]), measure)
    assert math.isnan(of(twice, "bias")["partial"])


@pytest.mark.parametrize(("numbers", "known"), [(7, True), (8, False)])
def test_partial_correlations_need_two_flights_more_than_numbers(numbers, known):
    rng = np.random.default_rng(3)
    table = pd.DataFrame(rng.normal(size=(10, numbers)), columns=[*map(str, range(numbers))])

    found = findings.influences(table, rng.normal(size=10))

    assert {math.isnan(row["partial"]) for row in found} == {not known}


def test_the_p_values_of_both_tests_are_corrected_together(flown):
    table, measure = flown
    some = table[["nothing", "kind"]]

    found = findings.influences(some, measure)

    groups = [measure[table["kind"] == kind] for kind in ("calm", "gusty", "rough")]
    tenths = np.array_split(measure[np.argsort(table["nothing"].to_numpy())], 10)
    p = [
        stats.spearmanr(table["nothing"], measure).pvalue,
        stats.kruskal(*tenths).pvalue,
        stats.kruskal(*groups).pvalue,
    ]
    by_size = sorted(zip(p, ("rho", "share", "kind"), strict=True))
    largest, expected = 0.0, {}
    for factor, (value, name) in zip((3, 2, 1), by_size, strict=True):
        largest = expected[name] = max(largest, min(1.0, factor * value))
    nothing, kind = of(found, "nothing"), of(found, "kind")
    assert nothing["p_rho"] == pytest.approx(expected["rho"])
    assert nothing["p_share"] == pytest.approx(expected["share"])
    assert (kind["p_share"], kind["p_rho"]) == pytest.approx((expected["kind"], 1.0))
    assert (kind["apart"], nothing["apart"]) == (True, False)


@pytest.mark.parametrize("column", [["calm"] * 4, ["a", "b", "c", "d"]])
def test_a_category_with_one_value_or_as_many_as_rows_has_no_share(column):
    assert np.isnan(findings._share(pd.Series(column), np.arange(4.0))).all()
