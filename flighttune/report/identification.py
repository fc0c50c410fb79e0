"""A figure of an identified inner loop: Bode of fit against flight, and the manoeuvre held out."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flighttune.identify.experiment import DT
from flighttune.identify.identify import Identification
from flighttune.present.palette import HUES, NEUTRAL
from flighttune.units import DEG
from flighttune.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAMES = "Roll", "Load factor"
FLOWN, FIT, CROSS = HUES[0][0][0], HUES[1][0][0], HUES[3][0][0]
LABELS = ("phi in deg", "n_z")
CROSS_LABELS = ("to n_z, in 1/rad", "to phi, in rad")
UNITS = DEG, 1.0


def identification_figure(found: Identification, title: str) -> "Figure":
    """Bode diagrams and the held-out manoeuvre of one condition.

    Parameters
    ----------
    found : Identification
    title : str
        Aircraft and condition.

    Returns
    -------
    Figure
        One column a channel; not saved.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 9.0), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    rows = figure.subplots(3, 2, height_ratios=(1.0, 1.0, 1.1), squeeze=False)
    for i in range(2):
        _bode(rows[0][i], rows[1][i], found, i)
        _held_out(rows[2][i], found, i)
    return figure


def save_figure(figure: "Figure", path: Path, *, dpi: int = 110) -> None:
    """Write a figure as an image, whole or not at all.

    Raises
    ------
    RecordingError
        If the folder or the file cannot be written.
    """
    with whole_file(path) as part:
        figure.savefig(part, dpi=dpi)


def _bode(magnitude: "Axes", phase: "Axes", found: Identification, i: int) -> None:
    flown = found.frequency[i]
    lag = found.candidates[i][0].lag
    omega = np.geomspace(flown.omega[0], flown.omega[-1], 300)
    fit = lag.response(omega)
    for axes, shown in ((magnitude, _decibel), (phase, _phase)):
        axes.semilogx(omega, shown(fit), color=FIT, lw=1.8, label=f"fit, order {lag.order}")
        axes.semilogx(flown.omega, shown(flown.own), "o", color=FLOWN, ms=5, label="flown")
        _dress(axes)
    magnitude.semilogx(
        flown.omega, _decibel(flown.other), "x", color=CROSS, ms=5, label=CROSS_LABELS[i]
    )
    magnitude.set_title(f"{NAMES[i]}: command to response", loc="left", fontsize=10, pad=20)
    magnitude.set_ylabel("magnitude in dB")
    phase.set_ylabel("phase in deg")
    phase.set_xlabel("frequency in rad/s")
    magnitude.axhline(-3.01, color=NEUTRAL, lw=0.8, ls="--")
    magnitude.axvline(lag.bandwidth, color=NEUTRAL, lw=0.8, ls="--")
    _legend(magnitude)


def _held_out(axes: "Axes", found: Identification, i: int) -> None:
    t = DT * np.arange(len(found.check.measured))
    channel = (found.condition.phi, found.condition.n_z)[i]
    unit = UNITS[i]
    axes.plot(
        t, found.check.commanded[:, i] / unit, color=NEUTRAL, lw=1.0, ls="--", label="commanded"
    )
    axes.plot(t, found.check.measured[:, i] / unit, color=FLOWN, lw=2.4, label="flown")
    axes.plot(t, found.check_model[:, i] / unit, color=FIT, lw=1.2, label="fit")
    axes.set_title(
        f"Not used for the fit: {channel.fit_percent:.1f} % of the variance explained",
        loc="left",
        fontsize=10,
        pad=20,
    )
    axes.set_ylabel(LABELS[i])
    axes.set_xlabel("t in s")
    _dress(axes)
    _legend(axes)


def _dress(axes: "Axes") -> None:
    axes.grid(alpha=0.3, which="both")
    axes.spines[["top", "right"]].set_visible(False)


def _legend(axes: "Axes") -> None:
    """Between title and axes, where no curve can run."""
    spacing: dict[str, Any] = {"borderaxespad": 0.2, "columnspacing": 1.2, "handlelength": 1.6}
    above = (0.0, 1.0)
    axes.legend(
        loc="lower left", bbox_to_anchor=above, ncols=3, fontsize=8, frameon=False, **spacing
    )


def _decibel(response: npt.NDArray[np.complex128]) -> npt.NDArray[np.float64]:
    return 20.0 * np.log10(np.maximum(np.abs(response), 1e-6))


def _phase(response: npt.NDArray[np.complex128]) -> npt.NDArray[np.float64]:
    return np.rad2deg(np.unwrap(np.angle(response)))
