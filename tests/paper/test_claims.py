"""Verdicts come from numbers: known findings, the rule, and what a changed gain does."""

import numpy as np
import pytest

import flighttune as ft
from flighttune.paper.claims import CLAIMS, VERDICTS, Check, Finding, judge
from flighttune.paper.study import Study

pytestmark = pytest.mark.slow

ERRORS = ("chi", "gamma", "chi_dot", "gamma_dot")


@pytest.fixture(scope="module")
def found(study):
    """Findings by name of the claim."""
    return {name: judge(name, study) for name in CLAIMS}


@pytest.mark.parametrize(
    ("claim", "verdict", "t"),
    [("peak-time", "not reproduced", 5.24), ("peak-time-gamma", "reproduced", 2.69)],
)
def test_the_peak_time_is_reproduced_for_the_path_angle_alone(found, claim, verdict, t):
    (check,) = found[claim].checks

    assert found[claim].verdict == verdict
    assert check.computed == pytest.approx(t, abs=0.005)


def test_a_mean_below_zero_does_not_count_as_the_lower_one(study, found):
    signed = study.of_gains("chi", "MS_rad")
    by_channel = dict(zip((*ERRORS, "s_chi", "s_gamma"), found["lower-MS"].checks, strict=True))

    highest, lowest = signed.iloc[0], signed.iloc[-1]
    assert lowest < 0.0 < highest < abs(lowest)
    assert found["lower-MS"].verdict == "partly"
    assert {name: check.computed for name, check in by_channel.items()} == {
        "chi": "4 of 6 steps",
        "gamma": "6 of 6 steps",
        "chi_dot": "5 of 6 steps",
        "gamma_dot": "5 of 6 steps",
        "s_chi": "5 of 6 steps",
        "s_gamma": "6 of 6 steps",
    }


def test_ITAE_falls_with_the_frequency_except_in_course_under_the_strongest_disturbance(
    study, found
):
    changes = [check.computed for check in found["decreasing-ITAE"].checks]
    ends = [
        (row.iloc[-1] - row.iloc[0]) / row.iloc[0]
        for L_d in (0.1, 0.3)
        for row in (study.of_disturbances(c, "ITAE").loc[L_d] for c in ("chi", "gamma"))
    ]

    assert found["decreasing-ITAE"].verdict == "partly"
    assert changes == pytest.approx(ends)  # of three equally spaced points: the outer two
    assert [change < 0.0 for change in changes] == [True, True, False, True]


def test_every_verdict_is_one_of_four_and_each_kind_occurs(found):
    assert {finding.verdict for finding in found.values()} == set(VERDICTS)
    for name in ("overshoot-chi", "overshoot-gamma", "table-2", "eigenvalues"):
        assert found[name].verdict == "reproduced"
    for name in ("converges-with-all-limits", "commands-in-rate", "star-feasible"):
        assert found[name].verdict == "not reproduced"
    assert len(found["table-2"].checks) == 12


def test_the_theory_is_judged_by_what_it_says(found):
    computed = {name: [check.computed for check in found[name].checks] for name in found}

    for name in ("lemma-2", "lemma-3", "lemma-4", "lemma-5", "theorem-1", "eigenvalue-problem"):
        assert found[name].verdict == "reproduced"
    assert computed["lemma-1"] == [200, pytest.approx(1.0)]
    assert computed["lemma-5-rate"] == [pytest.approx(0.5, abs=1e-6)]
    assert [check.holds for check in found["theorem-1-sufficient"].checks] == [True, False]
    # 1.6714 s^2 can be reached; 2 * 0.1016 1/s * 4.916 s^2 is the ball of the open loop
    assert [check.holds for check in found["theorem-2"].checks] == [True, True, False]
    assert computed["theorem-2"][2] == pytest.approx(1.6714 / (2.0 * 0.10156 * 4.916), rel=1e-3)
    assert found["larger-attractor"].verdict == "not reproduced"


@pytest.mark.parametrize(
    ("held", "verdict"),
    [
        ([True, True], "reproduced"),
        ([True, False], "partly"),
        ([False], "not reproduced"),
        ([], "not checkable"),
    ],
)
def test_the_verdict_follows_from_the_comparisons_alone(held, verdict):
    checks = tuple(Check(f"{k}", "", "", holds) for k, holds in enumerate(held))

    assert Finding(id="x", text="x", where="x", checks=checks).verdict == verdict


def test_the_true_optimum_in_the_place_of_the_printed_gains_changes_verdicts(study, found):
    better = Study(star=study.optimum.gains)

    assert found["optimal-controller"].verdict == "not reproduced"
    assert judge("optimal-controller", better).verdict == "reproduced"
    for name in ("table-2", "three-factors"):
        assert judge(name, better).verdict == "not reproduced"


def test_a_gain_of_the_wrong_sign_changes_verdicts(study, found):
    sign = np.array([[-1.0, 1.0], [1.0, 1.0]])
    wrong = Study(star=ft.PIGains(K_P=study.star.K_P, K_I=study.star.K_I * sign))

    for name in ("eigenvalues", "small-region", "table-2", "three-factors"):
        assert found[name].verdict == "reproduced"
        assert judge(name, wrong).verdict == "not reproduced"
