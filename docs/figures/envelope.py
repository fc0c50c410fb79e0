"""Draw docs/envelope.png, how far gains are certified: python docs/figures/envelope.py."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from flighttune.arrays import FloatArray, read_only_vector
from flighttune.control.envelope import Envelope, Hull
from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.control.linear_model import kinematic_model
from flighttune.errors import InputError
from flighttune.present.palette import HUES
from flighttune.tuning.envelope import envelope_rate, largest_envelope, tune_over_envelope
from flighttune.tuning.gradient import tune_by_gradient
from flighttune.tuning.problem import TuningProblem
from flighttune.units import DEG

G = 9.81
ENVELOPE = Envelope(
    V_a=(20.0, 30.0),
    gamma=(-20.0 * DEG, 45.0 * DEG),
    phi=(-30.0 * DEG, 30.0 * DEG),
    n_z=(0.7, 1.5),
)
TRIM = Envelope.at(V_a=25.0, gamma=math.pi / 12)
MODEL = kinematic_model(V_a=25.0, gamma=math.pi / 12, g=G)
LAG_AWARE = PIGains(K_P=np.diag([3.17, 2.90]), K_I=np.diag([1.13, 0.92]))


SAMPLES = 41
END_SHOWN = 0.995
"""Of the largest factor: closer to it the rate is lost in the solver's accuracy."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RateCurve:
    """The certified rate of one set of gains over an envelope scaled about the trim.

    Attributes
    ----------
    name : str
    factors : ndarray, shape (k,)
        Scaling of the envelope; ends where no common Q is found any more.
    rates : ndarray, shape (k,), 1/s
    ends : bool
        Whether the last point is such an end, and not just where sampling stopped.
    """

    name: str
    factors: FloatArray
    rates: FloatArray
    ends: bool

    def __post_init__(self) -> None:
        for name in ("factors", "rates"):
            object.__setattr__(self, name, read_only_vector(name, getattr(self, name)))
        if self.factors.shape != self.rates.shape:
            raise InputError(
                f"`factors` and `rates` must have one length, "
                f"got {len(self.factors)} and {len(self.rates)}."
            )


def rate_curve(
    name: str,
    gains: PIGains,
    envelope: Envelope,
    trim: Envelope,
    *,
    g: float,
    up_to: float = 2.0,
    hull: Hull = "speed",
) -> RateCurve:
    """The certified rate from the trim alone up to a multiple of an envelope.

    Parameters
    ----------
    name : str
        For the legend.
    gains : PIGains
    envelope, trim : Envelope
        The envelope at factor one, and the condition it is scaled about.
    g : float, m/s^2
    up_to : float
        Largest factor sampled, positive.
    hull : "entries" or "speed"
        See `jacobian_hull`.

    Returns
    -------
    RateCurve

    Raises
    ------
    InputError
        If the trim is not inside the envelope or `up_to` is not positive.
    """
    if not up_to > 0.0:
        raise InputError(f"`up_to` must be positive, got {up_to}.")
    largest = largest_envelope(gains, envelope, trim, g=g, hull=hull).factor
    ends = largest < up_to
    factors = np.linspace(0.0, END_SHOWN * largest if ends else up_to, SAMPLES)
    rates = [
        envelope_rate(gains, envelope.scaled(trim, factor), g=g, hull=hull).R for factor in factors
    ]
    if ends:
        factors, rates = np.append(factors, largest), [*rates, 0.0]
    return RateCurve(name=name, factors=factors, rates=np.array(rates), ends=ends)


def envelope_figure(curves: Sequence[RateCurve], envelope: Envelope) -> Figure:
    """Draw certified rates against the size of the envelope.

    Parameters
    ----------
    curves : sequence of RateCurve
    envelope : Envelope
        At factor one; its ranges are written below the axis.

    Returns
    -------
    matplotlib.figure.Figure
        With a cross where a set of gains has no common Q any more.
    """
    figure = Figure(figsize=(7.2, 4.8), layout="constrained")
    axes = figure.add_subplot()
    for curve, ((colour, _), _) in zip(curves, itertools.cycle(HUES), strict=False):
        axes.plot(100.0 * curve.factors, curve.rates, color=colour, lw=1.8, label=curve.name)
        if curve.ends:
            axes.plot(100.0 * curve.factors[-1], 0.0, "x", color=colour, ms=8, mew=2, clip_on=False)
    axes.axvline(100.0, color="0.6", lw=0.8, ls="--")
    axes.set_xlabel(f"size of the envelope about the trim in %\n{_ranges(envelope)}")
    axes.set_ylabel("certified rate R over the envelope in 1/s")
    axes.set_xlim(0.0, 100.0 * max(curve.factors[-1] for curve in curves))
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper left", ncols=2, frameon=False, fontsize=9)
    return figure


def _ranges(envelope: Envelope) -> str:
    def degrees(ends: tuple[float, float]) -> str:
        return f"{ends[0] / DEG:.0f} to {ends[1] / DEG:.0f} deg"

    return (
        f"(100 %: V {envelope.V_a[0]:g} to {envelope.V_a[1]:g} m/s, "
        f"gamma {degrees(envelope.gamma)}, phi {degrees(envelope.phi)}, "
        f"n_z {envelope.n_z[0]:g} to {envelope.n_z[1]:g})"
    )


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
    curves = [
        rate_curve(name, gains, ENVELOPE, TRIM, g=G, up_to=2.2)
        for name, gains in gain_sets().items()
    ]
    envelope_figure(curves, ENVELOPE).savefig(Path(__file__).parents[1] / "envelope.png", dpi=150)
