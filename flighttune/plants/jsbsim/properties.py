"""Properties by which the plant talks to the inner loop: names of our own, on any model."""

from flighttune.aircraft.aircraft import SURFACES

PHI_CMD, N_Z_CMD, V_A_CMD = "ft/phi-cmd-rad", "ft/n_z-cmd", "ft/V_a-cmd-mps"
ENGAGED = "ft/engaged"
SURFACE_TRIMS = tuple(f"ft/{name}-trim-rad" for name in SURFACES)
THROTTLE_TRIM = "ft/throttle-trim-norm"
TRIMS = (*SURFACE_TRIMS, THROTTLE_TRIM)
LAWS = tuple(name.replace("-trim-", "-law-") for name in TRIMS)
"""Outputs of the inner loop, each of which adds to its trim."""

POSITIONS = tuple(f"ft/{name}-rad" for name in SURFACES)
THROTTLE = "ft/throttle-norm"
GAINS = "ft/gains/"
"""Beginning of the names of gains."""

LIMITS = "ft/limits/"
