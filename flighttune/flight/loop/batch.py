"""Thousands of kinematic flights at once: the sampled controller on the paper's law."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.units import G_PAPER
from flighttune.control.exact_law import LAW_NUMBERS, ExactLaw, RateLaw
from flighttune.control.mimo_pi import MimoPI, PILaw
from flighttune.flight.loop.disturbance import Sinusoid
from flighttune.vehicles.plants import base, point_mass
from flighttune.vehicles.plants.jsbsim import properties
from flighttune.vehicles.plants.sensors import SENSED, Sensors
from flighttune.vehicles.plants.weather import WindNumbers

# Columns of a trajectory: as in a run, and the rates of the errors by the law, rad/s.
SIGNALS = (
    *("chi", "gamma", "chi_err", "gamma_err", "chi_err_rate", "gamma_err_rate"),
    *("phi_cmd", "n_z_cmd", "phi_unlimited", "n_z_unlimited"),
    *("phi_integral", "n_z_integral", "phi_limited", "n_z_limited"),
)

# State of a flight: all samples flown, arrived, outside its envelope, or where only JSBSim knows
# the forces, such as near the ground.
GOES_ON, ARRIVED, OUTSIDE, BEYOND = 0, 1, 2, 3

# Places of signals of an aircraft, then places of the further values that its compiled step shows
CHI, GAMMA, PHI, N_Z, V_A, NORTH, EAST, ALPHA, THETA, PSI = map(
    properties.SIGNALS.index,
    ("chi", "gamma", "phi", "n_z", "V_a", "north", "east", "alpha", "theta", "psi"),
)
V_FPS, LIFT, HEIGHT, N_Z_SEEN = range(BESIDE := len(properties.GUARDED))

# Flights whose sensor errors are in memory at the same time
SENSED_AT_ONCE = 256


class Flights(NamedTuple):
    """N flights as the kernel takes them."""

    laws: FloatArray  # (N, 26): numbers of `PILaw` or `RateLaw` in their order, the rest zero
    # (N, 5), rad, rad, rad, 1, m/s: course, flight-path angle, roll, load factor and airspeed at
    # t = 0
    start: FloatArray
    # (N or 1, k or 1, 2), rad: course and flight-path angle to follow, constant or one per sample
    ref: FloatArray
    ref_rates: FloatArray  # as `ref`, rad/s: rates of the reference, which the exact law follows
    # (N, 4), rad/s: disturbance: chi_amplitude, chi_omega, gamma_amplitude, gamma_omega
    waves: FloatArray
    g: FloatArray  # (N,), m/s^2
    exact: bool  # True if `laws` are exact laws
    wrapped: bool  # True if the course error is taken the short way round
    feed_forward: bool
    dt: float  # s: sample time of the controllers
    steps: int  # integration steps in a sample


# Length of the memory that `law_sample` keeps over a flight.
MEMORY = 21


class SampledLaw(NamedTuple):
    """A law and its reference, an argument of `law_sample`."""

    numbers: FloatArray  # of a `RateLaw`, or the fewer ones of a `PILaw`
    # Places of the seen course, path angle, airspeed, roll, load factor, north, east and height, of
    # the true height, of wind and speed over ground, and the number of signals. -1: the law sees
    # no wind; the speed is the difference of positions.
    places: tuple[int, ...]
    dt: float  # s: sample time
    settings: tuple[float, ...]  # of `guidance`
    # Numbers of an `AirspeedPriority` and the place of the largest n_x, or -1
    priority: tuple[float, ...]
    refs: FloatArray  # (samples, 4), or (0, 4) on a route
    path: FloatArray  # rows of `guidance`, empty without a route
    # (samples, 2), or (0, 2): roll and load factor that a `PILaw` adds; a roll of NaN says that the
    # load factor is the vertical lift
    ahead: FloatArray
    # (`MEMORY`,): state of the law, the distance along the route (m), the speed over ground (m/s),
    # the position (m) at the sample before, the estimate of the wind (m/s), whether the first
    # sample is over, and the true distance along the route (m)
    memory: FloatArray


class Motion(NamedTuple):
    """An aircraft in flight: arrays that its step reads and writes, and changes on the way."""

    states: FloatArray
    parameters: FloatArray
    # Signals after a step, then airspeed (ft/s), lift (lbf), height (ft) and the load factor that
    # the inner loop follows
    shown: FloatArray
    signals: int  # number of signals
    further: int  # number of further signals, which stand behind those four values
    commands: tuple[int, ...]  # places of roll, load factor and n_x among the parameters
    steps: int  # integration steps in a sample
    between: int  # most steps between two checks of the envelope
    # Bounds of angle of attack, airspeed (ft/s), lift (lbf) and pitch attitude
    low: FloatArray
    high: FloatArray
    weight: float  # lbf, at the start
    floor: float  # ft: only JSBSim flies below this height
    ceiling: float  # ft: only JSBSim flies above this height
    # Turbulence: four normal numbers per step, and the state of the generator; no columns without
    # turbulence
    stream: FloatArray
    random: npt.NDArray[np.int64]
    # Errors of the inner loop's sensors, a row for each integration step or none, and their places
    # among the parameters
    errors: FloatArray
    error_places: tuple[int, ...]
    # Changes of parameters, or of states, whose places count down from -1: steps flown before each
    # change, places, values, and the number of changes made
    change_at: npt.NDArray[np.int64]
    change_place: npt.NDArray[np.int64]
    change_to: FloatArray
    changed: npt.NDArray[np.int64]
    # Wind that changes, or no rows; its places among the parameters; wind, its change in a step
    # (ft/s) and the height before (ft)
    air: WindNumbers
    wind_places: tuple[int, ...]
    wind: FloatArray
    ground: float  # m
    rate: float  # integration steps a second


class BatchResult(NamedTuple):
    """Results of N flights as arrays."""

    t: FloatArray  # (k,), s: times of the samples
    # (N,): samples of each flight, k unless it ended early
    samples: npt.NDArray[np.int64]
    # (N,): 0 where the flight was completed, 1 where it ended at 90 deg of roll, 2 where an angle
    # went beyond 1000 rad
    ends: npt.NDArray[np.int64]
    trajectories: FloatArray  # (N, 14, k): `SIGNALS` over time, NaN after the end

    def signal(self, name: str) -> FloatArray:
        """One of `SIGNALS` over time, shape (N, k)."""
        return self.trajectories[:, SIGNALS.index(name)]


def fly_sampled(
    controllers: Sequence[MimoPI | ExactLaw],
    conditions: Sequence[base.FlightCondition],
    ref: FloatArray,
    *,
    duration: float,
    disturbances: Sequence[Sinusoid],
    ref_rates: FloatArray | None = None,
    sensors: Sequence[Sensors] = (),
    g: npt.ArrayLike = G_PAPER,
) -> BatchResult:
    """Fly N discrete controllers on the kinematic plant, every flight as `simulate` would.

    Controllers are alike but for gains, limits and speed of the schedule; they are read, not flown.
    Each flight has its condition, disturbance (without switching times) and, where its values are
    not the true ones, sensors. `ref` (rad) and `ref_rates` (rad/s), which the exact law follows,
    have the shape (N or 1, k or 1, 2): course and flight-path angle, constant or one a sample.
    `duration` (s) is rounded to whole samples; `g` (m/s^2) is one number or N.

    Trajectories, of 112 bytes a sample, are those of the single run but for rounding (1e-12).
    Integrals of the exact law (rad/s) stand in ``phi_integral`` and ``n_z_integral``.
    """
    # The controller is `pi_step` or `exact_step`, the function of the law itself, compiled. The
    # first call in a new installation compiles for some seconds; the result is kept on disk.
    first, N = controllers[0], len(controllers)
    dt = first.dt
    t = np.arange(round(duration / dt) + 1, dtype=np.float64) * dt
    laws = np.zeros((N, LAW_NUMBERS))
    for row, controller in zip(laws, controllers, strict=True):
        numbers = numbers_of(controller.law)
        row[: len(numbers)] = numbers
    starts = [(c.chi, c.gamma, c.phi, c.n_z_start, c.V_a) for c in conditions]
    waves = [(d.chi_amplitude, d.chi_omega, d.gamma_amplitude, d.gamma_omega) for d in disturbances]
    flights = Flights(
        laws=laws,
        start=np.array(starts, dtype=float),
        ref=ref,
        ref_rates=np.zeros_like(ref) if ref_rates is None else ref_rates,
        waves=np.array(waves, dtype=float),
        g=np.full(N, g, dtype=float),
        exact=isinstance(first, ExactLaw),
        wrapped=isinstance(first, ExactLaw) or first.wrapped[0],
        feed_forward=isinstance(first, MimoPI) and first.feed_forward,
        dt=dt,
        steps=math.ceil(dt / point_mass.LONGEST_STEP - 1e-9),
    )
    result = BatchResult(
        t=t,
        samples=np.zeros(N, dtype=np.int64),
        ends=np.zeros(N, dtype=np.int64),
        trajectories=np.empty((N, len(SIGNALS), len(t))),
    )
    from flighttune.flight.loop.kernel import fly_block

    # One thread: campaigns share their draws out among processes.
    at_once = SENSED_AT_ONCE if sensors else N
    for begin in range(0, N, at_once):
        sensed = [sensor.errors(len(t), dt) for sensor in sensors[begin : begin + at_once]]
        errors = np.array(sensed).reshape(-1, len(t), len(SENSED))
        fly_block(begin, min(begin + at_once, N), errors, flights, result)
    return result


def numbers_of(law: PILaw | RateLaw) -> list[float]:
    """Numbers of a law in order; a truth value is 0 or 1."""
    channels, *others = law
    numbers = [number for row in channels for number in (*row.K_P, *row.K_I_half, *row[2:])]
    for value in others:
        numbers += value if isinstance(value, tuple) else (value,)
    return numbers
