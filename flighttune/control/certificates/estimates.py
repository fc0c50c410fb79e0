"""Peak gains from an error of what the autopilot knows of each angle to the true error of each.

The law acts on ``e - n``, n the error of the estimate: ``s' = A_K s + b n`` for
s = (x, integral of e), with ``b = [-B K_P; -I]``. The true error is ``C x``.
"""

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, inner_feedback
from flighttune.control.theory.exact import Check, Rationals, exact, identity
from flighttune.control.theory.peak_gain import PeakGains, peak_gains

# A stated gain is larger than the computed one by this part: another machine rounds differently.
ROOM = 1e-8


def estimate_gains(
    loop: Rationals, model: LinearModel, gains: PIGains, Q: FloatArray, *, rate: float
) -> PeakGains:
    """Enclose the peak gains from each estimated error (columns) to each true one (rows), (p, p).

    `loop` is the A_K that `gains` close on `model`; `Q` and `rate` (1/s) are proven of it. An
    InputError says that the loop is too slow to be followed.
    """
    p = len(model.errors)
    k = exact(inner_feedback(model, gains.feedback)[0])
    acted_on = (exact(model.B) * (1 + k)) @ exact(gains.K_P)
    rows = np.hstack([exact(model.C), exact(np.zeros((p, p)))])
    return peak_gains(loop, np.vstack([-acted_on, -identity(p)]), rows, Q, rate=rate)


def gains_checks(errors: tuple[str, ...], stated: FloatArray, computed: PeakGains) -> list[Check]:
    """Check that no stated gain is below its enclosure."""
    return [
        Check(
            name=f"peak gain of {error} by an error of the estimate of {seen}",
            margin=float(stated[i, j] - computed.upper[i, j]),
            exact=bool(stated[i, j] >= computed.upper[i, j]),
        )
        for i, error in enumerate(errors)
        for j, seen in enumerate(errors)
    ]
