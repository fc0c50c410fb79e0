"""Figure 12: the commands with K*, and what the printed rate limits do to them."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from flighttune.paper import parameters as printed
from flighttune.paper import style
from flighttune.paper.flight import PaperFlight
from flighttune.paper.items.base import (
    MANOEUVRE,
    PRINTED_STAR,
    TABLE_1_DISTURBANCE,
    Item,
    Made,
)
from flighttune.paper.items.histories import columns_of
from flighttune.paper.parameters import DURATION, STAR, printed_limits
from flighttune.paper.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

READINGS = {
    "ranges only": style.INK,
    "ranges and rate limits": style.GAMMA,
    "with rate limits and anti-windup": style.GREEN,
}
COMMANDS = (("φ", "rad"), ("$n_z$", "1"))


def make(study: Study) -> Made:
    """Draw both panels, and the manoeuvre under each reading of the limits."""
    flight = study.flights[STAR]
    flown = {name: study.readings[name] for name in READINGS}
    rates = np.max(np.abs(flight.command_rates), axis=0)
    limits = printed_limits().rate_upper
    limited = flown["ranges and rate limits"]
    return Made(
        figures={
            "fig12": ("Panels (a) and (b) as in the paper; thin: wanted.", _commands(flight)),
            "fig12_rate_limits": (
                "The manoeuvre with the printed ranges alone, with the printed rate limits too, "
                "and with conditional anti-windup besides.",
                _readings(flown),
            ),
        },
        tables={
            "fig12": pd.DataFrame({"t_s": flight.t, **columns_of("", flight)}),
            "fig12_rate_limits": pd.DataFrame(
                {
                    "t_s": flight.t,
                    **{
                        key: column
                        for name, one in flown.items()
                        for key, column in columns_of(name.replace(" ", "_"), one).items()
                    },
                }
            ),
        },
        values={
            "largest_phi_rad": float(np.max(np.abs(flight.u[:, 0]))),
            "largest_n_z": float(np.max(np.abs(flight.u[:, 1]))),
            "largest_phi_rate_radps": float(rates[0]),
            "largest_n_z_rate_1_per_s": float(rates[1]),
            "readings": {name: _values(one) for name, one in study.readings.items()},
        },
        outcome=(
            "The ranges hold because the simulation cuts the commands off. The largest rates flown "
            f"are {rates[0]:.2f} rad/s of roll and {rates[1]:.2f} 1/s of load factor, where "
            f"{limits[0]:.2f} and {limits[1]:.2f} are allowed.",
            f"With the printed rate limits as well the loop "
            f"{'converges' if limited.converged else 'does not converge'}; with conditional "
            f"anti-windup it "
            f"{'does' if flown['with rate limits and anti-windup'].converged else 'does not'}, "
            f"with a course overshoot of "
            f"{flown['with rate limits and anti-windup'].peak('chi')[0]:.3f} rad.",
        ),
    )


def _values(flight: PaperFlight) -> dict[str, object]:
    (chi, chi_t), (gamma, gamma_t) = flight.peak("chi"), flight.peak("gamma")
    return {
        "status": flight.status,
        "converged": flight.converged,
        "chi": {"MO_rad": chi, "PT_s": chi_t},
        "gamma": {"MO_rad": gamma, "PT_s": gamma_t},
    }


def _commands(flight: PaperFlight) -> "Figure":
    figure, panels = style.grid(1, 2, size=(8.6, 3.2), titles=("φ(t)", "$n_z$(t)"))
    limits = printed_limits()
    for i, (panel, (symbol, unit)) in enumerate(zip(panels, COMMANDS, strict=True)):
        panel.plot(flight.t, flight.unlimited[:, i], color=style.GREY, lw=0.9, label="wanted")
        panel.plot(flight.t, flight.u[:, i], color=style.INK, label="flown")
        style.level(panel, float(limits.lower[i]), float(limits.upper[i]), label="printed range")
        style.over_time(panel, f"{symbol} [{unit}]", DURATION)
    style.legend_above(figure, panels[0], columns=3)
    return figure


def _readings(flown: dict[str, PaperFlight]) -> "Figure":
    figure, panels = style.grid(
        2, 2, size=(8.6, 5.6), titles=("$e_χ$", "$e_γ$", "φ flown", "$n_z$ flown")
    )
    limits = printed_limits()
    for name, flight in flown.items():
        line: dict[str, Any] = {"color": READINGS[name], "label": name}
        for i, channel in enumerate(("chi", "gamma")):
            panels[i].plot(flight.t, flight.channels[channel], **line)
            panels[2 + i].plot(flight.t, flight.u[:, i], **line)
    for i, (symbol, unit) in enumerate(COMMANDS):
        style.over_time(panels[i], f"{style.LABELS[('chi', 'gamma')[i]]} [rad]", DURATION)
        style.over_time(panels[2 + i], f"{symbol} [{unit}]", DURATION)
        style.level(panels[2 + i], float(limits.lower[i]), float(limits.upper[i]))
    style.legend_above(figure, panels[0], columns=3)
    return figure


ITEM = Item(
    name="fig12",
    title="commands with K*",
    printed="The fourth figure (label Fig:12)",
    make=make,
    parameters=(
        PRINTED_STAR,
        *MANOEUVRE,
        TABLE_1_DISTURBANCE,
        "Table 1: φ̇ within ±π/6 rad/s, ṅ_z within ±1 1/s, φ(0) = π/3, n_z(0) = 1: rate limits only",
    ),
    assumed=(printed.ONLY_RANGES,),
)
