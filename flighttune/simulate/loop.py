"""One closed loop in time: plant, controller and reference to a table of signals."""

import math
import struct
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import pandas as pd

from flighttune.control.mimo_pi import MimoPI
from flighttune.errors import InputError
from flighttune.plants.base import COMMON_SIGNALS, FlightCondition, Plant, Stop
from flighttune.plants.sensors import SensedPlant, Sensors
from flighttune.simulate.reference import Reference
from flighttune.units import wrap_angle

LOOP_SIGNALS = (
    "chi_ref",
    "gamma_ref",
    "chi_err",
    "gamma_err",
    "phi_cmd",
    "n_z_cmd",
    "phi_unlimited",
    "n_z_unlimited",
    "phi_integral",
    "n_z_integral",
    "phi_limited",
    "n_z_limited",
)
"""What the loop adds to the signals of the plant, one row a sample of the controller."""

PROGRESS_EVERY = 50


def simulate(
    plant: Plant,
    controller: MimoPI,
    reference: Reference,
    *,
    condition: FlightCondition,
    duration: float,
    feed_forward: bool = False,
    sensors: Sensors | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[pd.DataFrame, Stop | None]:
    """Fly `plant` under `controller` along `reference` from `condition`.

    Parameters
    ----------
    plant : Plant
        A plant that was not flown before.
    controller : MimoPI
        From (chi, gamma) to (phi, n_z); its sample time is the step of the loop. It is started
        from the roll and load factor of `condition`.
    reference : Reference
        Course and flight-path angle to follow.
    condition : FlightCondition
        Start of the flight.
    duration : float, s
        Time to fly, positive; rounded to whole samples.
    feed_forward : bool
        Add ``cos(gamma_ref)/cos(phi)`` to the load-factor command: what steady flight on the
        reference needs at the bank flown. It depends on the reference and not on the error, so the
        linear loop about wings-level flight is the same with it and without.
    sensors : Sensors, optional
        What the controller sees course, climb and airspeed through; by default it sees what is
        flown. With them the signals hold `MEASURED` as well, and the errors stay the true ones.
    progress : callable, optional
        Called with the time flown in s, about once a second of flight.

    Returns
    -------
    signals : DataFrame, indexed by `t` in s
        One row a sample: signals of the plant, then `LOOP_SIGNALS`; SI and radians; read-only. It
        ends with the last sample before the stop where the flight ended early.
    stop : Stop or None
        Why the flight ended early; None where it lasted as long as asked.

    Raises
    ------
    InputError
        If `duration` is shorter than one sample.
    TrimError
        If the plant finds no steady flight at `condition`.
    """
    dt = controller.dt
    if not (math.isfinite(duration) and duration >= dt):
        raise InputError(f"`duration` must be at least one sample ({dt} s), got {duration} s.")
    count = round(duration / dt)
    t = np.arange(count + 1, dtype=np.float64) * dt
    chi_ref, gamma_ref = reference.sampled(t)
    angles, speed = slice(0, 2), COMMON_SIGNALS.index("V_a")
    if sensors is not None:
        angles, speed = slice(len(plant.signals), len(plant.signals) + 2), len(plant.signals) + 2
        plant = SensedPlant(plant, sensors.errors(count + 1, dt))
    rows, row = bytearray(), struct.Struct(f"{len(plant.signals) + len(LOOP_SIGNALS)}d")
    plant.start(condition)
    controller.start((condition.phi, condition.n_z_start))
    samples = zip(chi_ref.tolist(), gamma_ref.tolist(), np.cos(gamma_ref).tolist(), strict=True)
    level = (0.0, 0.0)
    stop = None
    observe, advance, step, pack = plant.observe, plant.advance, controller.step, row.pack
    state = controller.state
    error, u_unsat, integral, limited = state.error, state.u_unsat, state.integral, state.limited
    for k, (chi_wanted, gamma_wanted, steady) in enumerate(samples):
        seen = observe()
        u_ff = (0.0, steady / math.cos(seen[2])) if feed_forward else level
        ref = (chi_wanted, gamma_wanted)
        u = step(ref, seen[angles], u_ff, seen[speed])
        rows += pack(*seen, *ref, *error, *u, *u_unsat, *integral, *limited)
        if k == count:
            break
        stop = advance(u[0], u[1], dt)
        if stop is not None:
            break
        if progress is not None and k % PROGRESS_EVERY == 0:
            progress(k * dt)
    wrapped = None if sensors is None else controller.wrapped
    return _table(rows, plant.signals, t, wrapped), stop


def _table(
    rows: bytearray,
    plant_signals: tuple[str, ...],
    t: np.ndarray,
    sensed: tuple[bool, ...] | None,
) -> pd.DataFrame:
    if plant_signals[: len(COMMON_SIGNALS)] != COMMON_SIGNALS:
        raise InputError(f"`plant.signals` must begin with {COMMON_SIGNALS}, got {plant_signals}.")
    columns = (*plant_signals, *LOOP_SIGNALS)
    values = np.frombuffer(rows, dtype=np.float64).reshape(-1, len(columns))
    if sensed is not None:
        _put_true_errors(values, columns, sensed)
    index = pd.Index(t[: len(values)], name="t")
    values.flags.writeable = False
    return pd.DataFrame(values, columns=_named(columns), index=index, copy=False)


@cache
def _named(columns: tuple[str, ...]) -> pd.Index:
    """Names of columns, made once: it takes longer than all else in a table."""
    return pd.Index(columns)


def _put_true_errors(values: np.ndarray, columns: tuple[str, ...], wrapped: Sequence[bool]) -> None:
    """Replace the errors that the controller saw through sensors."""
    for channel, turns in zip(("chi", "gamma"), wrapped, strict=True):
        true, ref, err = (columns.index(f"{channel}{kind}") for kind in ("", "_ref", "_err"))
        errors = (values[:, ref] - values[:, true]).tolist()
        values[:, err] = [wrap_angle(error) for error in errors] if turns else errors
