"""Watches a flight of JSBSim: finite, above the ground, inside the envelope."""

from collections.abc import Callable
from math import cos, isfinite, sin

from flighttune.errors import PlantError
from flighttune.plants.base import Stop
from flighttune.plants.jsbsim import properties
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.plants.jsbsim.log import one_line
from flighttune.units import DEG, FT, G_0


class Guard:
    """Checks a flight while it runs, and says why when a check fails.

    The envelope is that of the aircraft's configuration; the ground lies at JSBSim's sea level.
    `inside` returns whether the flight may go on: False for anything that is not a number.
    """

    def __init__(self, fdm: Fdm) -> None:
        self._fdm = fdm
        self._alpha = fdm.reader("aero/alpha-rad")
        self._theta = fdm.reader("attitude/theta-rad")
        self._V_a_fps = fdm.reader("velocities/vt-fps")
        self._F_x, self._F_z = (
            fdm.reader("forces/fbx-total-lbs"),
            fdm.reader("forces/fbz-total-lbs"),
        )
        self._weight_lbf = fdm.reader("inertia/mass-slugs")() * G_0 / FT
        self._throttle = fdm.reader(properties.THROTTLE)
        self._h_ft = fdm.reader("position/h-sl-ft")
        self._time = fdm.reader("simulation/sim-time-sec")
        self.inside = self._check()

    def _check(self) -> Callable[[], bool]:
        # Local names and JSBSim's units: the check runs every few steps of every flight.
        alpha, theta, V_a_fps, h_ft = self._alpha, self._theta, self._V_a_fps, self._h_ft
        F_x, F_z = self._F_x, self._F_z
        envelope = self._fdm.config.envelope
        alpha_low, alpha_high = envelope.alpha
        theta_low, theta_high = envelope.theta
        V_low, V_high = (speed / FT for speed in envelope.V_a)
        lift_low, lift_high = (n_z * self._weight_lbf for n_z in envelope.n_z)

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

        return inside

    def gave_up(self, error: RuntimeError) -> Stop:
        """Return the stop of a flight in which JSBSim itself raised `error`."""
        self._fdm.abandon()
        return Stop("diverged", f"t = {self._time():.3f} s: JSBSim gave up: {one_line(str(error))}")

    def bad_command(self, phi_cmd: float, n_z_cmd: float) -> Stop:
        """Return the stop of a flight whose command is not finite."""
        return Stop(
            "diverged",
            f"t = {self._time():.3f} s: commands must be finite, "
            f"got phi_cmd {phi_cmd:g} rad, n_z_cmd {n_z_cmd:g}.",
        )

    def _engine_at_stop(self) -> str:
        low, high = self._fdm.config.engines.throttle
        margin, throttle = 0.01 * (high - low), self._throttle()
        if throttle >= high - margin:
            return ", at full throttle"
        return ", with the throttle closed" if throttle <= low + margin else ""

    def diagnosis(self) -> Stop:
        """Return why the flight may not go on.

        Raises PlantError if nothing is wrong with the state: JSBSim ended the run by itself.
        """
        at = f"t = {self._time():.3f} s"
        alpha, h = self._alpha(), self._h_ft() * FT
        state = {
            "alpha": alpha,
            "V_a": self._V_a_fps() * FT,
            "n_z": (self._F_x() * sin(alpha) - self._F_z() * cos(alpha)) / self._weight_lbf,
            "theta": self._theta(),
            "h": h,
        }
        lost = [name for name, value in state.items() if not isfinite(value)]
        if lost:
            return Stop("diverged", f"{at}: state must be finite, got nan for {', '.join(lost)}.")
        if h <= 0.0:
            return Stop("ground_contact", f"{at}: hit the ground at V_a = {state['V_a']:.1f} m/s.")
        envelope = self._fdm.config.envelope
        watched = (
            ("alpha", envelope.alpha, DEG, " deg"),
            ("V_a", envelope.V_a, 1.0, " m/s"),
            ("n_z", envelope.n_z, 1.0, ""),
            ("theta", envelope.theta, DEG, " deg"),
        )
        for name, (low, high), unit, symbol in watched:
            if not low < state[name] < high:
                return Stop(
                    "left_envelope",
                    f"{at}: {name} must stay inside {low / unit:g} to {high / unit:g}{symbol}, "
                    f"got {state[name] / unit:.2f}{symbol}{self._engine_at_stop()}.",
                )
        raise PlantError(f"{at}: JSBSim ended the run by itself, its state inside the envelope.")
