"""What gains ask for at the first instant, and how that stands to the printed limits."""

import numpy as np

from flighttune.control.gains import PIGains
from flighttune.paper import parameters as printed


def command_use(gains: PIGains) -> dict[str, tuple[float, float, float]]:
    """Command and command rate at the first instant: value, lower and upper limit, by name.

    Notes
    -----
    ``u(t_0) = K (x_0; x_0 dt)`` and ``u'(t_0) = K (0; x_0)`` of section 4.4 with dt = 0.1 s.
    """
    x_0 = printed.E_0
    limits = printed.printed_limits()
    u = gains.K @ np.concatenate([x_0, x_0 * printed.OPTIMISATION_DT])
    u_dot = gains.K @ np.concatenate([np.zeros(2), x_0])
    rows = {}
    for i, name in enumerate(("phi", "n_z")):
        rows[name] = float(u[i]), float(limits.lower[i]), float(limits.upper[i])
        rows[f"{name} rate"] = (
            float(u_dot[i]),
            float(limits.rate_lower[i]),
            float(limits.rate_upper[i]),
        )
    return rows


def worst_use(gains: PIGains) -> float:
    """Largest of `command_use` as a part of its limit; at most one where all limits hold."""
    return max(
        value / (upper if value > 0.0 else lower)
        for value, lower, upper in command_use(gains).values()
    )
