"""The claim of a campaign's runs is that of a flight's check, with the campaign's bound."""

from dataclasses import replace

import numpy as np
import pytest
from dispersed import AEROSONDE, KINEMATIC, SOFT, WIND, plan_of, tables_of, uniform

from flighttune.campaign.flying.alone import fly_group
from flighttune.campaign.flying.claim import claim_of
from flighttune.campaign.flying.rows import fly_runs
from flighttune.guarantee.flight_check import flight_check

START = uniform("flight.chi_deg", 10.0, 30.0)
UNSTABLE = {"name": "away", "K_P": [[-1.0, 0.0], [0.0, -1.0]], "K_I": [[0.0, 0.0], [0.0, 0.0]]}
ROUNDING = 1e-12
WAVE = {"chi_amplitude": 0.05, "chi_omega_rad_s": 2.0}


def plan(plants=(AEROSONDE,), certificate=None, gains=("paper", SOFT), **tables):
    keys = {} if certificate is None else {"certificate": certificate}
    return plan_of(tables_of(plants, gains=list(gains), **tables), START, runs=12, **keys)


def claims(made):
    """The claim of each group."""
    return {group: claim_of(made, group) for group in made.groups}


@pytest.mark.parametrize("t_from", [0.0, 0.5, 1.5, 2.5])
def test_bound_set_and_verdict_of_the_undispersed_flight_are_those_of_its_check(t_from):
    made = plan((KINEMATIC,), {"from_s": t_from}, disturbance=WAVE)

    for group, claim in claims(made).items():
        run = fly_group(made, made.scenario, group)
        said, outcome = flight_check(run).claim(t_from)
        assert claim.L_d == said.L_d
        assert claim.tube == said.tube
        assert claim.commanded == pytest.approx(said.commanded, abs=ROUNDING)
        assert claim.vacuous == said.vacuous
        assert claim.outcome(run) == outcome


def test_the_claim_is_looked_at_from_half_the_flight_on_where_no_time_is_given():
    (claim,) = {found.t_from for found in claims(plan((KINEMATIC,), disturbance=WAVE)).values()}
    assert claim == 1.5


def test_a_bound_that_is_given_is_the_bound():
    made = plan(certificate={"L_d_rad_s2": 0.2})
    assert [claim.L_d for claim in claims(made).values()] == [0.2, 0.2]


def test_what_has_no_certificate_has_no_claim():
    made = plan((AEROSONDE, KINEMATIC), gains=["paper", UNSTABLE], wind=WIND)

    found = {(group.plant, group.gains): claim for group, claim in claims(made).items()}

    assert found["jsbsim:aerosonde", "paper"] is None  # an aircraft has a tube
    assert found["kinematic", "away"] is None  # unstable
    assert found["kinematic", "paper"] is not None
    assert set(claims(plan((KINEMATIC,))).values()) == {None}  # no mismatch but rounding
    rows = fly_runs(made, range(4)).to_pylist()
    for row in rows:
        assert (row["certified"] is None) == (found[row["plant"], row["gains"]] is None)


def test_an_undispersed_flight_that_is_not_completed_measures_no_bound():
    tables = {"flight": {"V_a_mps": 25.0, "h_m": 2.0, "gamma_deg": -10.0, "duration_s": 3.0}}
    crashed = plan(**tables)
    assert set(claims(crashed).values()) == {None}
    given = plan(certificate={"L_d_rad_s2": 0.2}, **tables)
    assert None not in claims(given).values()


@pytest.mark.slow
def test_a_tighter_bound_is_held_by_fewer_flights():
    counts = []
    for L_d in (1e-3, 0.1, 10.0):
        rows = fly_runs(plan(certificate={"from_s": 1.0, "L_d_rad_s2": L_d}), range(12))
        counts.append(rows["certified"].to_pylist().count("held"))
    assert counts[0] == 0
    assert counts[-1] == 12
    assert counts == sorted(counts)


def test_a_kick_out_of_the_set_breaks_it_unless_the_reference_moved_then():
    made = plan(certificate={"from_s": 0.0, "L_d_rad_s2": 5.0})
    group = made.groups[0]
    claim, run = claim_of(made, group), fly_group(made, made.scenario, group)
    assert claim.outcome(run) == "held"
    late = np.arange(len(run.signals)) >= 100

    kicked = run.signals.assign(chi_err=run.signals["chi_err"] + late * 100.0)
    moved = run.signals.assign(chi_ref=run.signals["chi_ref"] + late * 100.0)

    assert claim.outcome(replace(run, signals=kicked)) == "broken"
    assert claim.outcome(replace(run, signals=moved)) == "held"
    assert claim.outcome(replace(run, status="diverged")) is None
    assert claim.outcome(replace(run, signals=run.signals.iloc[:3])) is None
