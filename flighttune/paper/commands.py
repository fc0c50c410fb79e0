"""Commands that gains demand at the first instant, against the limits of Table 1."""

from typing import NamedTuple

import numpy as np

from flighttune.control.gains import PIGains
from flighttune.paper import parameters as printed


class LimitUse(NamedTuple):
    """A command, or its rate, and the range printed for it."""

    value: float
    lower: float
    upper: float

    @property
    def share(self) -> float:
        """Value as a share of the limit on its side; above one it breaks that limit."""
        return self.value / (self.upper if self.value > 0.0 else self.lower)


def initial_commands(gains: PIGains) -> dict[str, LimitUse]:
    """Both commands and their rates at the first instant, by name (``phi``, ``phi rate``, ...).

    Notes
    -----
    ``u(t_0) = K (x_0; x_0 dt)`` and ``u'(t_0) = K (0; x_0)`` of section 4.4 with dt = 0.1 s.
    """
    x_0, limits = printed.E_0, printed.printed_limits()
    u = gains.K @ np.concatenate([x_0, x_0 * printed.OPTIMISATION_DT])
    u_dot = gains.K @ np.concatenate([np.zeros(2), x_0])
    uses = {}
    for i, name in enumerate(("phi", "n_z")):
        ranges = u[i], limits.lower[i], limits.upper[i]
        rates = u_dot[i], limits.rate_lower[i], limits.rate_upper[i]
        uses[name] = LimitUse(*map(float, ranges))
        uses[f"{name} rate"] = LimitUse(*map(float, rates))
    return uses


def largest_share(gains: PIGains) -> float:
    """Largest share of a limit among `initial_commands`; at most one where all limits hold."""
    return max(use.share for use in initial_commands(gains).values())
