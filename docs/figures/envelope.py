"""Draw docs/envelope.svg, how far gains are certified: python docs/figures/envelope.py."""

import math
from pathlib import Path

import numpy as np

from flighttune.base.units import DEG
from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.control.linear_model import Envelope, kinematic_model
from flighttune.control.tuning.envelope import rate_curve, tune_over_envelope
from flighttune.control.tuning.problem import TuningProblem
from flighttune.control.tuning.tune import tune_by_gradient
from flighttune.outputs.answers.tuning import rate_chart
from flighttune.outputs.drawing.chart import Sheet

G = 9.81
ENVELOPE = Envelope(
    V_a=(20.0, 30.0), gamma=(-20.0 * DEG, 45.0 * DEG), phi=(-30.0 * DEG, 30.0 * DEG), n_z=(0.7, 1.5)
)
TRIM = Envelope.at(V_a=25.0, gamma=math.pi / 12)
MODEL = kinematic_model(V_a=25.0, gamma=math.pi / 12, g=G)
LAG_AWARE = PIGains(K_P=np.diag([3.17, 2.90]), K_I=np.diag([1.13, 0.92]))


def gain_sets() -> dict[str, PIGains]:
    """Return the gains that are drawn, by name."""
    at_trim = tune_by_gradient(TuningProblem(model=MODEL, I_star=5.0)).gains
    for_envelope = TuningProblem(model=MODEL, I_star=10.0)
    over = tune_over_envelope(for_envelope, ENVELOPE, TRIM, g=G, starts=0).gains
    if at_trim is None or over is None:
        raise SystemExit("no gains were found")
    return {
        "K* as printed, I_K = 4.9 s²": PAPER_GAINS,
        "tuned for an inner loop with lag, I_K = 97 s²": LAG_AWARE,
        "tuned at the trim, I_K = 5 s²": at_trim,
        "tuned for the envelope, I_K = 10 s²": over,
    }


if __name__ == "__main__":
    curves = {
        name: rate_curve(gains, ENVELOPE, TRIM, g=G, up_to=2.2)
        for name, gains in gain_sets().items()
    }
    chart = rate_chart(curves, ENVELOPE)
    Sheet(charts=[chart], columns=1).save(Path(__file__).parents[1] / "envelope.svg")
