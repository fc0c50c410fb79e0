"""Signals of the plant, and properties by which it talks to the inner loop, on any model."""

from flighttune.vehicles.aircraft.aircraft import SURFACES
from flighttune.vehicles.plants import base, weather
from flighttune.vehicles.plants.inertial import GYROS, INERTIAL

SIGNALS = (
    *base.COMMON_SIGNALS,
    *("alpha", "beta", "theta", "psi", "p", "q", "r", "h", "V_g", "n_y"),
    *("aileron", "elevator", "rudder", "throttle", "thrust"),
    *weather.WIND,
)

# Behind them a compiled step shows airspeed (ft/s), lift (lbf), height above the ground (ft) and
# the load factor that the inner loop sees.
GUARDED = ("vt-fps", "lift-lbs", "h-sl-ft", "n_z-followed")

PHI_CMD, N_Z_CMD, V_A_CMD = "ft/phi-cmd-rad", "ft/n_z-cmd", "ft/V_a-cmd-mps"
N_X_CMD, N_X_FOLLOWED, N_X_SHOWN = "ft/n_x-cmd", "ft/n_x-followed", "ft/n_x-shown"

# Load factors along the path and across it, as the accelerometers show them to the inner loop.
N_X, N_Z = "ft/n_x", "ft/n_z"
ENGAGED = "ft/engaged"

# Errors of gyros and accelerometers that the inner loop adds, in the order of `INERTIAL`.
ERRORS = tuple(
    f"ft/error/{name}-rad_sec" if name in GYROS else f"ft/error/{name}" for name in INERTIAL
)
SURFACE_TRIMS = tuple(f"ft/{name}-trim-rad" for name in SURFACES)
THROTTLE_TRIM = "ft/throttle-trim-norm"
TRIMS = (*SURFACE_TRIMS, THROTTLE_TRIM)

# Outputs of the inner loop, each of which adds to its trim.
LAWS = tuple(name.replace("-trim-", "-law-") for name in TRIMS)

THROTTLE = "ft/throttle-norm"

# Beginning of the names of gains.
GAINS = "ft/gains/"

# Gains against the gyroscopic moment of a propeller, which only aircraft with a strong one have:
# of the elevator by the yaw rate, of the rudder by the pitch rate.
GYROSCOPIC = ("pitch/k_r", "yaw/k_q")

# Throttle that adds a longitudinal load factor of one.
THROTTLE_PER_N_X = f"{GAINS}speed/k_gamma"

LIMITS = "ft/limits/"

THROTTLE_MAX = f"{LIMITS}throttle-max"
