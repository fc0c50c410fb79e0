"""The figure of certified rates: what it shows, and that nothing lies on top of it."""

import numpy as np
import pytest

from flighttune.control.envelope import Envelope
from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.control.linear_model import closed_loop, kinematic_model
from flighttune.errors import InputError
from flighttune.theory.indicators import indicators
from flighttune.tuning.envelope import rate_chart, rate_curve

pytestmark = pytest.mark.slow

G = 9.81
SOLVER = 1e-5
TRIM = Envelope.at(V_a=25.0, gamma=np.pi / 12)
ENVELOPE = Envelope(V_a=(20.0, 30.0), gamma=(-0.35, 0.785), phi=(-0.52, 0.52), n_z=(0.7, 1.5))
TUNED = PIGains(K_P=np.diag([2.2209, 2.4797]), K_I=3.8753 * np.eye(2))


@pytest.fixture(scope="module")
def model():
    return kinematic_model(V_a=25.0, gamma=np.pi / 12.0, g=G)


@pytest.fixture(scope="module")
def curves():
    return {
        name: rate_curve(gains, ENVELOPE, TRIM, g=G, up_to=1.2)
        for name, gains in (("paper", PAPER_GAINS), ("tuned", TUNED))
    }


def test_a_curve_starts_at_the_trims_own_rate_and_falls(model, curves):
    for (_, rates), gains in zip(curves.values(), (PAPER_GAINS, TUNED), strict=True):
        own = indicators(closed_loop(model, gains)).R_K
        assert rates[0] == pytest.approx(own, rel=SOLVER)
        assert (np.diff(rates) < 0.0).all()


def test_the_papers_curve_ends_before_the_envelope_and_the_tuned_one_goes_on(curves):
    (paper_factors, paper_rates), (tuned_factors, tuned_rates) = curves.values()

    assert 0.8 < paper_factors[-1] < 0.85
    assert paper_rates[-1] == 0.0
    assert tuned_factors[-1] == 1.2
    assert tuned_rates[-1] > 0.0


def test_the_chart_has_units_names_and_the_envelope(curves):
    chart = rate_chart(curves, ENVELOPE)

    assert chart.x.endswith("[%]")
    assert chart.y.endswith("[1/s]")
    ranges, *names = (name for name, _, _ in chart.legend)
    assert ranges == str(ENVELOPE)
    assert names == ["paper", "tuned"]


def test_a_curve_goes_up_to_a_positive_factor():
    with pytest.raises(InputError, match=r"`up_to`.* 0"):
        rate_curve(TUNED, ENVELOPE, TRIM, g=G, up_to=0.0)
