"""Verdicts come from numbers: known findings, the rule, and what a changed gain does."""

import numpy as np
import pytest

import flighttune as ft
from flighttune.paper.claims import CLAIMS, VERDICTS, judge
from flighttune.paper.study import Study

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found(study):
    """Findings by name of the claim."""
    return {name: judge(name, study) for name in CLAIMS}


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


def test_the_largest_r_k_is_no_enhancement_behind_an_identified_lag(found):
    claim = found["overall-enhancement"]

    assert claim.verdict == "not reproduced"
    # eigenvalues and E_K of the table in docs/exact_law.md, printed with two decimals
    printed = 0.69 / 1.34, 0.90 / 2.14
    assert [check.computed for check in claim.checks] == pytest.approx(printed, rel=0.01)


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
