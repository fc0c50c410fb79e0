"""What is read of a JSBSim flight: its signals in SI and radians, and whether it may go on."""

from collections.abc import Callable, Mapping
from math import cos, isfinite, remainder, sin, tau

from flighttune.base.units import DEG, FT, G_0, LBF
from flighttune.vehicles.aircraft.aircraft import SURFACES, AircraftConfig
from flighttune.vehicles.plants.base import StopStatus
from flighttune.vehicles.plants.jsbsim import properties
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.weather import WIND

_G_0_FPS2 = G_0 / FT

# Properties that show a signal up to a factor.
_PLACES = (
    *(f"attitude/{name}-rad" for name in ("phi", "theta", "psi")),
    *("flight-path/psi-gt-rad", "flight-path/gamma-rad", "aero/alpha-rad", "aero/beta-rad"),
    *(f"velocities/{name}-rad_sec" for name in "pqr"),
    *("velocities/vt-fps", "velocities/vg-fps", "position/h-sl-ft"),
    *("position/from-start-neu-n-ft", "position/from-start-neu-e-ft"),
    *(f"atmosphere/total-{name.replace('_', '-')}-fps" for name in WIND),
    *(f"ft/{name}-rad" for name in SURFACES),
    properties.THROTTLE,
)


def signal_reader(
    fdm: Fdm, chi_0: float, psi_0: float, *, n_x: bool = False
) -> Callable[[], tuple[float, ...]]:
    """Return a function that reads the signals of `JSBSimPlant` from `fdm`.

    `chi_0`, `psi_0` (rad): course and heading near which the continuous angles begin. `n_x`: show
    the longitudinal load factor and its range too. The place of `fdm` now becomes the origin.
    """
    read = fdm.reader
    phi, theta, psi, chi, gamma, alpha, beta, p, q, r, *motion = map(read, _PLACES)
    V_a, V_g, h_ft, north, east, w_n, w_e, w_d, aileron, elevator, rudder, throttle = motion
    # Not accelerations/N*: JSBSim computes those from the forces of the step before.
    F_x, F_y, F_z = (read(f"forces/fb{axis}-total-lbs") for axis in "xyz")
    mass_slug = read("inertia/mass-slugs")
    thrusts = fdm.thrusts
    # The only engine is asked by itself: a sum takes as long as six readings.
    thrust_lbf = thrusts[0] if len(thrusts) == 1 else lambda: sum([each() for each in thrusts])
    ground, h_0 = fdm.ground, h_ft() * FT
    chi_now, psi_now = chi_0, psi_0

    def observe() -> tuple[float, ...]:
        nonlocal chi_now, psi_now
        # JSBSim's angles jump at a whole turn; the nearest continuation does not.
        chi_now += remainder(chi() - chi_now, tau)
        psi_now += remainder(psi() - psi_now, tau)
        h, a, weight = h_ft() * FT, alpha(), mass_slug() * _G_0_FPS2
        n_z = (F_x() * sin(a) - F_z() * cos(a)) / weight
        thrust = (0.0 + thrust_lbf()) * LBF  # not -0.0, as a sum is
        # In the order of `SIGNALS`, each written out: a loop over them takes twice as long.
        return (
            *(chi_now, gamma(), phi(), n_z, V_a() * FT, north() * FT, east() * FT, h_0 - h),
            *(a, beta(), theta(), psi_now, p(), q(), r(), h + ground, V_g() * FT, F_y() / weight),
            *(aileron(), elevator(), rudder(), throttle(), thrust),
            *(w_n() * FT, w_e() * FT, w_d() * FT),
        )

    if not n_x:
        return observe
    slope, closed = read(properties.THROTTLE_PER_N_X), fdm.config.engines.throttle[0]
    full, seen = read(properties.THROTTLE_MAX), read(properties.N_X)

    def with_n_x() -> tuple[float, ...]:
        a, b, weight, lever = alpha(), beta(), mass_slug() * _G_0_FPS2, throttle()
        force = (F_x() * cos(a) + F_z() * sin(a)) * cos(b) + F_y() * sin(b)
        # The range is that about what the inner loop sees, which an exported law sees as well: it
        # runs before the forces of its step.
        now, per = seen(), 1.0 / slope()
        return (*observe(), force / weight, *(now + per * (x - lever) for x in (closed, full())))

    return with_n_x


def guard(fdm: Fdm) -> tuple[Callable[[], bool], Callable[[], tuple[StopStatus, str] | None]]:
    """Return functions that say whether a flight may go on, and why not."""
    # The first function is false for anything that is not a number. The second returns None if
    # nothing is wrong with the state: JSBSim ended the run by itself.
    # Local names and JSBSim's units: the check runs every few steps of every flight.
    read, envelope = fdm.reader, fdm.config.envelope
    alpha, theta = read("aero/alpha-rad"), read("attitude/theta-rad")
    V_a_fps, h_ft = read("velocities/vt-fps"), read("position/h-sl-ft")
    F_x, F_z = read("forces/fbx-total-lbs"), read("forces/fbz-total-lbs")
    throttle, weight_lbf = read(properties.THROTTLE), read("inertia/mass-slugs")() * _G_0_FPS2
    alpha_low, alpha_high = envelope.alpha
    theta_low, theta_high = envelope.theta
    V_low, V_high = (speed / FT for speed in envelope.V_a)
    lift_low, lift_high = (n_z * weight_lbf for n_z in envelope.n_z)

    def inside() -> bool:
        a = alpha()
        # Two-sided comparisons are false for NaN, which therefore ends the flight.
        return (
            alpha_low < a < alpha_high
            and V_low < V_a_fps() < V_high
            and lift_low < F_x() * sin(a) - F_z() * cos(a) < lift_high
            and theta_low < theta() < theta_high
            and h_ft() > 0.0
        )

    def diagnosis() -> tuple[StopStatus, str] | None:
        a, V_a, h = alpha(), V_a_fps() * FT, h_ft() * FT
        n_z = (F_x() * sin(a) - F_z() * cos(a)) / weight_lbf
        state = {"alpha": a, "V_a": V_a, "n_z": n_z, "theta": theta(), "h": h}
        if lost := [name for name, value in state.items() if not isfinite(value)]:
            return "diverged", f"state must be finite, got nan for {', '.join(lost)}."
        # Gear and hull reach below the centre of mass, and their forces end a flight first.
        parts = (name for kind in ("gear/", "contact/") for name in fdm.names(kind))
        if h <= 0.0 or any(fdm.reader(name)() for name in parts if name.endswith("/WOW")):
            return "ground_contact", f"hit the ground at V_a = {V_a:.1f} m/s."
        return left_envelope(fdm.config, state, throttle())

    return inside, diagnosis


def left_envelope(
    config: AircraftConfig, state: Mapping[str, float], throttle: float
) -> tuple[StopStatus, str] | None:
    """Which bound of the envelope a state (alpha, V_a, n_z, theta) is beyond; None if none."""
    degrees, speed, ratio = (DEG, " deg"), (1.0, " m/s"), (1.0, "")
    units = {"alpha": degrees, "V_a": speed, "n_z": ratio, "theta": degrees}
    for name, (unit, symbol) in units.items():
        low, high = getattr(config.envelope, name)
        if not low < state[name] < high:
            engines = config.engines
            at_stop = _throttle_at_stop(throttle, *engines.throttle) if engines.count else ""
            return "left_envelope", (
                f"{name} must stay inside {low / unit:g} to {high / unit:g}{symbol}, "
                f"got {state[name] / unit:.2f}{symbol}{at_stop}."
            )
    return None


def _throttle_at_stop(throttle: float, closed: float, full: float) -> str:
    margin = 0.01 * (full - closed)
    if throttle >= full - margin:
        return ", at full throttle"
    return ", with the throttle closed" if throttle <= closed + margin else ""
