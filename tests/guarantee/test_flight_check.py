"""Guarantees held against flights whose answer is known on paper."""

from dataclasses import replace

import numpy as np
from recording.conftest import SCENARIO, fly

from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.guarantee.flight_check import flight_check


def test_a_loop_slower_than_its_gains_breaks_it():
    lame = PIGains(K_P=0.12 * PAPER_GAINS.K_P, K_I=0.02 * PAPER_GAINS.K_I)
    slow = fly("kinematic", "lame", lame, seconds=20.0)
    pretended = replace(slow, provenance=replace(slow.provenance, gains=PAPER_GAINS))

    found = flight_check(pretended)

    assert found.t_broken is not None
    assert found.broken.any()
    assert np.all(found.size[found.broken] > found.bound[found.broken])


def test_a_flight_without_gains_or_numbers_of_its_law_has_no_guarantee():
    run = fly("kinematic", "paper", PAPER_GAINS, seconds=2.0)
    bare = {key: value for key, value in SCENARIO.items() if key != "flight"}
    unstable = PIGains(K_P=-PAPER_GAINS.K_P, K_I=PAPER_GAINS.K_I)

    assert flight_check(replace(run, provenance=replace(run.provenance, gains=None))) is None
    assert flight_check(replace(run, signals=run.signals.iloc[:3])) is None
    assert flight_check(replace(run, provenance=replace(run.provenance, scenario=bare))) is None
    assert flight_check(replace(run, provenance=replace(run.provenance, gains=unstable))) is None
