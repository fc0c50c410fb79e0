"""What a batch flies and what comes of it, as arrays over the flights."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.limits import Limits
from flighttune.errors import InputError, ShapeError
from flighttune.plants.base import FlightCondition
from flighttune.simulate.disturbance import Sinusoid

T = TypeVar("T")

SIGNALS = (
    "chi",
    "gamma",
    "chi_err",
    "gamma_err",
    "chi_err_rate",
    "gamma_err_rate",
    "phi_cmd",
    "n_z_cmd",
    "phi_unlimited",
    "n_z_unlimited",
    "phi_integral",
    "n_z_integral",
    "phi_limited",
    "n_z_limited",
)
"""Columns of a trajectory: as in a run, and the rates of the errors by the law, rad/s."""

MEASURES = (
    "ITAE",
    "ITAE_mean",
    "PT_s",
    "MO_rad",
    "MS_rad",
    "ST_rad",
    "rise_s",
    "settling_s",
    "effort_rms",
    "saturation_s",
)
"""Columns of the metrics: those of `flighttune.metrics`, in its order."""

REASONS = (
    "",
    "roll command {phi_deg:.4g} deg and load-factor command {n_z:.4g} at t = {t:.2f} s: "
    "the law has no value from 90 deg of roll.",
    "an angle beyond 1000 rad after t = {t:.2f} s.",
    "the law has no bounded rate after t = {t:.2f} s.",
)
"""Why a flight ended, by its code in `FlownBatch.ends`; 0 is a flight that was completed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flights:
    """N flights of the kinematic loop.

    Attributes
    ----------
    K : ndarray, shape (N, 2, 4)
        Stacked gains (K_P, K_I), rows phi and n_z, columns e_chi and e_gamma.
    start : ndarray, shape (N, 5), rad, rad, rad, 1, m/s
        Course, flight-path angle, roll, load factor and airspeed at t = 0.
    ref : ndarray, shape (N or 1, k or 1, 2), rad
        Course and flight-path angle to follow: one pair, or one a sample.
    bounds : ndarray, shape (N, 4, 2), input units
        Rows lower, upper, rate_lower, rate_upper; infinite where there is none.
    waves : ndarray, shape (N, 4), rad/s
        Disturbance: chi_amplitude, chi_omega, gamma_amplitude, gamma_omega.

    Raises
    ------
    ShapeError
        If the shapes do not fit together.
    InputError
        If a value cannot be used.

    Notes
    -----
    Values are copied and checked; ``dataclasses.replace`` makes a changed set of flights.
    """

    K: FloatArray
    start: FloatArray
    ref: FloatArray
    bounds: FloatArray
    waves: FloatArray

    def __post_init__(self) -> None:
        flights = len(np.asarray(self.K))
        shapes = {
            "K": (flights, 2, 4),
            "start": (flights, 5),
            "bounds": (flights, 4, 2),
            "waves": (flights, 4),
        }
        for name in self.__slots__:
            array = np.array(getattr(self, name), dtype=float, order="C")
            array.flags.writeable = False
            wanted = shapes.get(name)
            if wanted is not None and array.shape != wanted:
                raise ShapeError(f"`{name}` must have shape {wanted}, got {array.shape}.")
            if name != "bounds" and not np.isfinite(array).all():
                raise InputError(f"`{name}` must be finite.")
            object.__setattr__(self, name, array)
        r = self.ref.shape
        if not (len(r) == 3 and r[0] in (1, flights) and r[1] >= 1 and r[2] == 2):
            raise ShapeError(f"`ref` must have shape ({flights} or 1, k or 1, 2), got {r}.")
        if not np.all(self.start[:, 4] > 0.0):
            raise InputError(f"`V_a` must be positive, got {self.start[:, 4].min():g} m/s.")
        if not np.all(np.abs(self.start[:, 1:3]) < math.pi / 2):
            raise InputError("`gamma` and `phi` must lie inside +-pi/2.")
        low, high = self.bounds[:, (0, 2)], self.bounds[:, (1, 3)]
        if not (np.all(low < high) and np.all(low[:, 1] <= 0.0) and np.all(high[:, 1] >= 0.0)):
            raise InputError("`bounds` must be ranges, and those of the rates must hold zero.")

    def __len__(self) -> int:
        return len(self.K)

    @classmethod
    def of(
        cls,
        gains: PIGains | Iterable[PIGains],
        *,
        condition: FlightCondition | Iterable[FlightCondition],
        ref: npt.ArrayLike,
        limits: Limits | Iterable[Limits] | None = None,
        disturbance: Sinusoid | Iterable[Sinusoid] | None = None,
    ) -> "Flights":
        """Flights from one or many of each: whatever is single serves all of them.

        Parameters
        ----------
        gains, condition, limits, disturbance
            One, or N of them; no limits and no disturbance by default.
        ref : array_like, shape (2,), (k, 2) or (N, k or 1, 2), rad
            Constant course and flight-path angle, or one a sample, for all or for each.

        Raises
        ------
        ShapeError
            If the numbers of things differ, or gains are not of two commands and two errors.
        """
        calm = Sinusoid(chi_amplitude=0.0, chi_omega=0.0, gamma_amplitude=0.0, gamma_omega=0.0)
        rows = {
            "K": [g.K for g in _many(PIGains, gains)],
            "start": [
                (c.chi, c.gamma, c.phi, c.n_z_start, c.V_a)
                for c in _many(FlightCondition, condition)
            ],
            "bounds": [
                (one.lower, one.upper, one.rate_lower, one.rate_upper)
                for one in _many(Limits, Limits.none(2) if limits is None else limits)
            ],
            "waves": [
                (d.chi_amplitude, d.chi_omega, d.gamma_amplitude, d.gamma_omega)
                for d in _many(Sinusoid, calm if disturbance is None else disturbance)
            ],
        }
        followed = np.asarray(ref, dtype=float)
        if followed.ndim < 3:
            followed = followed.reshape(1, -1, 2)
        flights = max(len(followed), *map(len, rows.values()))
        arrays = {name: _repeated(name, values, flights) for name, values in rows.items()}
        return cls(ref=followed, **arrays)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlownBatch:
    """What N flights did.

    Attributes
    ----------
    t : ndarray, shape (k,), s
        Times of the samples.
    metrics : ndarray, shape (N, 2, 10)
        `MEASURES` of the course (0) and of the flight-path angle (1), equal to those of
        `flighttune.metrics`; NaN where a measure has no value or fewer than two samples were flown.
    samples : ndarray of int, shape (N,)
        Samples flown, k unless the flight ended before its time.
    ends : ndarray of int, shape (N,)
        Index into `REASONS`; 0 where the flight was completed.
    last : ndarray, shape (N, 14)
        `SIGNALS` at the last sample flown.
    trajectories : ndarray, shape (N, k, 14), or None
        `SIGNALS` over time, NaN after the end; None where only metrics were asked for.
    """

    t: FloatArray
    metrics: FloatArray
    samples: npt.NDArray[np.int64]
    ends: npt.NDArray[np.int64]
    last: FloatArray
    trajectories: FloatArray | None

    def metric(self, name: str) -> FloatArray:
        """One of `MEASURES`, shape (N, 2): course, flight-path angle."""
        return self.metrics[..., _index(MEASURES, name)]

    def signal(self, name: str) -> FloatArray:
        """One of `SIGNALS` over time, shape (N, k)."""
        if self.trajectories is None:
            raise InputError("`trajectories` must be asked for to look at a signal.")
        return self.trajectories[..., _index(SIGNALS, name)]

    def status(self, flight: int) -> tuple[str, str]:
        """``completed`` or ``diverged`` of one flight, and the reason where it diverged."""
        end = int(self.ends[flight])
        phi, n_z = self.last[flight, 6:8]
        t = float(self.t[max(0, int(self.samples[flight]) - 1)])
        reason = REASONS[end].format(phi_deg=math.degrees(phi), n_z=n_z, t=t)
        return ("diverged" if end else "completed"), reason


def _many(kind: type[T], given: T | Iterable[T]) -> list[T]:
    return [given] if isinstance(given, kind) else list(given)  # type: ignore[arg-type]


def _repeated(name: str, values: list[Any], flights: int) -> FloatArray:
    array = np.array(values, dtype=float)
    if len(array) not in (1, flights):
        raise ShapeError(f"`{name}` must be given once or {flights} times, got {len(array)}.")
    return np.broadcast_to(array, (flights, *array.shape[1:]))


def _index(names: tuple[str, ...], name: str) -> int:
    if name not in names:
        raise InputError(f"`name` must be one of {', '.join(names)}, got {name!r}.")
    return names.index(name)
