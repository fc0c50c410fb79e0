"""Scenarios that fly more than the paper's law: names, gains, files, and what is held of them."""

from typing import ClassVar

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft
from flighttune.claims.linear_loop import linear_bound
from flighttune.control.law import Law, law_kinds
from flighttune.flight import models

ENVELOPE = {
    "V_a_mps": [20.0, 30.0],
    "gamma_deg": [-20.0, 45.0],
    "phi_deg": [-45.0, 45.0],
    "n_z": [0.5, 2.1],
}
TRIAL = {"name": "trial", "K_P": [[1.41, 0.0], [0.0, 1.22]], "K_I": [[0.73, 0.0], [0.0, 0.77]]}


def scenario(**tables):
    turn = {"shape": "ramp", "start_s": 0.5, "duration_s": 1.0, "rate_dps": 8.0}
    made = {
        "law": ["paper", "exact"],
        "flight": {"duration_s": 3.0},
        "reference": {"chi_deg": [turn], "gamma_deg": 4.0},
        "plant": [{"kind": "kinematic"}, {"kind": "point_mass"}],
    }
    return made_up_scenario(**made | tables)


def test_a_scenario_of_the_papers_law_alone_has_the_same_hash_as_ever():
    tables = scenario().as_dict()
    without = {key: value for key, value in tables.items() if key != "law"}

    assert "law" not in ft.scenario_from(without).as_dict()


@pytest.mark.soak
def test_gains_of_the_papers_law_are_mapped_and_tuned_ones_are_those_of_the_law():
    mapped = models.gain_set(scenario(), "exact:paper")
    own = scenario(law="exact", gains=["tuned"])
    tuned = ft.tune(own)

    assert mapped == ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0)
    assert models.gain_set(own, "exact:tuned") == tuned.gains
    assert tuned.gains.law == "exact"
    assert tuned.I_K <= 5.0 + 1e-6


def test_numbers_are_in_the_units_of_the_law_that_flies_or_that_the_table_names():
    alone = models.gain_set(scenario(law="exact", gains=[TRIAL]), "exact:trial")
    beside = models.gain_set(scenario(gains=[TRIAL]), "exact:trial")
    named = scenario(gains=[{**TRIAL, "law": "exact"}])

    assert alone.K_P[0, 0] == 1.41
    assert beside.K_P[0, 0] == pytest.approx(1.41 * 9.81 / 25.0)
    assert models.gain_set(named, "exact:trial").K_P[0, 0] == 1.41
    assert models.gain_set(named, "trial").K_P[0, 0] == pytest.approx(1.41 * 25.0 / 9.81)


def test_a_run_of_the_exact_law_is_read_and_flown_again_to_the_bit(tmp_path):
    tables = [{"name": "slow", "kind": "exact", "lift_floor": 0.3, "priority": "chi"}]
    flown = ft.fly(scenario(law=tables))
    again = ft.load(ft.record(flown, tmp_path).recording).runs

    assert again[0].label == "kinematic / slow:paper"
    assert again[0].provenance.gains == flown.runs[0].provenance.gains
    assert ft.refly(again[:1]).equal


def test_the_exact_law_on_the_point_mass_is_its_linear_loop():
    run = ft.fly(scenario(gains=[{**TRIAL, "law": "exact"}])).runs[-1]
    drawn = linear_bound(run)

    assert run.label == "point_mass / exact:trial"
    assert drawn is not None
    assert np.isfinite(drawn.bound).any()
    assert not (drawn.size > 1.000001 * drawn.bound + 1e-12).any()


@pytest.mark.soak
def test_its_rate_is_the_same_over_any_envelope_and_kstar_has_none_there():
    both = scenario(envelope=ENVELOPE)
    exact, paper = (models.gain_set(both, name) for name in ("exact:paper", "paper"))

    everywhere = ft.certify(both, exact, envelope=True)
    at_trim = ft.certify(both, exact)

    assert everywhere.status == "certified"
    assert everywhere.certificate.claim.rate == at_trim.certificate.claim.rate
    assert ft.certify(both, paper, envelope=True).status != "certified"

    exact_law = both.law_of("exact:paper")[0]
    tuned = [ft.tune(both, law=exact_law, envelope=over).gains for over in (True, False)]
    assert tuned[0] is not None
    assert tuned[0] == tuned[1]


def test_a_law_whose_class_says_nothing_has_no_guarantee_and_says_why():
    """Without integral action A_K has two eigenvalues of 0, whatever K_I its gains have."""

    class Proportional(Law):
        kind: ClassVar[str] = "proportional"

        def make(self, setup, /):
            raise NotImplementedError

    law = Proportional(name="proportional")
    assert not law.by_gains
    made = scenario(law=["paper"], plant=[{"kind": "kinematic"}])
    loop = law.loop(models.linear_model(made), ft.PAPER_GAINS, None)
    assert loop is None
    with pytest.raises(ft.InputError, match="must state the linear model"):
        models.tune_scenario(made, law)
    stating = {kind for kind, made_law in law_kinds().items() if made_law.by_gains}
    assert stating == {"paper", "exact"}
