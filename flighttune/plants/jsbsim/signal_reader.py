"""Signals of a JSBSim aircraft: bound property nodes, turned into SI and radians."""

from collections.abc import Callable
from math import cos, remainder, sin, tau

from flighttune.plants.jsbsim import properties
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.units import FT, G_0, LBF

_G_0_FPS2 = G_0 / FT


def thrust_reader(fdm: Fdm) -> Callable[[], float]:
    """Return a function that reads the thrust of all engines together, lbf."""
    engines = range(fdm.config.engines.count)
    first, *others = (fdm.reader(f"propulsion/engine[{i}]/thrust-lbs") for i in engines)
    if not others:
        return first
    return lambda: first() + sum(read() for read in others)


def signal_reader(fdm: Fdm, chi_0: float, psi_0: float) -> Callable[[], tuple[float, ...]]:
    """Return a function that reads the signals of `JSBSimPlant` from `fdm`, in their order.

    `fdm`: the aircraft, already at the start of its flight: its position becomes the origin.
    `chi_0`, `psi_0` (rad): course and heading near which the continuous angles begin. Raises
    PlantError if the aircraft lacks a property.
    """
    read = fdm.reader
    chi, psi = read("flight-path/psi-gt-rad"), read("attitude/psi-rad")
    gamma, phi = read("flight-path/gamma-rad"), read("attitude/phi-rad")
    theta = read("attitude/theta-rad")
    alpha, beta = read("aero/alpha-rad"), read("aero/beta-rad")
    # Not accelerations/N*: JSBSim computes those from the forces of the step before.
    F_x, F_y, F_z = (read(f"forces/fb{axis}-total-lbs") for axis in "xyz")
    mass_slug = read("inertia/mass-slugs")
    V_a_fps, V_g_fps = read("velocities/vt-fps"), read("velocities/vg-fps")
    p, q, r = (read(f"velocities/{rate}-rad_sec") for rate in "pqr")
    north_ft, east_ft = read("position/from-start-neu-n-ft"), read("position/from-start-neu-e-ft")
    h_ft = read("position/h-sl-ft")
    aileron, elevator, rudder = (read(name) for name in properties.POSITIONS)
    throttle = read(properties.THROTTLE)
    thrust_lbf = thrust_reader(fdm)
    wind_north, wind_east, wind_down = (
        read(f"atmosphere/total-wind-{axis}-fps") for axis in ("north", "east", "down")
    )
    ground, h_0 = fdm.ground, h_ft() * FT
    last_chi, last_psi = chi_0, psi_0

    def observe() -> tuple[float, ...]:
        nonlocal last_chi, last_psi
        # JSBSim's angles jump at a whole turn; the nearest continuation does not.
        last_chi += remainder(chi() - last_chi, tau)
        last_psi += remainder(psi() - last_psi, tau)
        alpha_now, h = alpha(), h_ft() * FT
        weight = mass_slug() * _G_0_FPS2
        return (
            last_chi, gamma(), phi(), (F_x() * sin(alpha_now) - F_z() * cos(alpha_now)) / weight,
            V_a_fps() * FT, north_ft() * FT, east_ft() * FT, h_0 - h,
            alpha_now, beta(), theta(), last_psi, p(), q(), r(), h + ground, V_g_fps() * FT,
            F_y() / weight, aileron(), elevator(), rudder(), throttle(), thrust_lbf() * LBF,
            wind_north() * FT, wind_east() * FT, wind_down() * FT,
        )  # fmt: skip

    return observe
