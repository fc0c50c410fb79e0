"""Peak gains from the estimation error of each angle to the true tracking error of each angle.

The law acts on ``e - n``, where n is the estimation error: ``s' = A_K s + b n`` for
s = (x, integral of e), with ``b = [-B K_P; -I]``. The true tracking error is ``e = C x``.
"""

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, inner_feedback
from flighttune.control.theory.exact import Check, Rationals, exact, identity
from flighttune.control.theory.peak_gain import PeakGains, peak_gains

# Relative margin of a stated gain above the computed one: another machine rounds differently.
ROOM = 1e-8


def estimate_gains(
    loop: Rationals, model: LinearModel, gains: PIGains, Q: FloatArray, *, rate: float
) -> PeakGains:
    """Enclose the gains (p, p) from each estimation error (column) to each true error (row).

    `loop` is the A_K of `gains` on `model`; `Q` and `rate` (1/s) are proven for it. InputError if
    the loop is too slow.
    """
    p = len(model.errors)
    k = exact(inner_feedback(model, gains.feedback)[0])
    acted_on = (exact(model.B) * (1 + k)) @ exact(gains.K_P)
    rows = np.hstack([exact(model.C), exact(np.zeros((p, p)))])
    return peak_gains(loop, np.vstack([-acted_on, -identity(p)]), rows, Q, rate=rate)


def gains_checks(errors: tuple[str, ...], stated: FloatArray, computed: PeakGains) -> list[Check]:
    """Check that no stated gain is below its upper bound."""
    return [
        Check(
            name=f"peak gain from the estimation error of {seen} to the true error of {error}",
            margin=float(stated[i, j] - computed.upper[i, j]),
            exact=bool(stated[i, j] >= computed.upper[i, j]),
        )
        for i, error in enumerate(errors)
        for j, seen in enumerate(errors)
    ]
