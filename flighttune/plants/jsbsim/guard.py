"""Watches a flight of JSBSim: finite, above the ground, inside the envelope."""

import math
from collections.abc import Callable

from flighttune.errors import PlantError
from flighttune.plants.base import Stop
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.units import DEG, FT


class Guard:
    """Checks after every integration step, and says why when one fails.

    Parameters
    ----------
    fdm : Fdm
        The aircraft; its configuration holds the envelope.

    Attributes
    ----------
    inside : callable returning bool
        Whether the flight may go on; False for anything that is not a number.
    """

    def __init__(self, fdm: Fdm) -> None:
        self._fdm = fdm
        self._alpha = fdm.reader("aero/alpha-rad")
        self._theta = fdm.reader("attitude/theta-rad")
        self._V_a_fps = fdm.reader("velocities/vt-fps")
        self._n_z = fdm.reader(fdm.config.channels.n_z)
        self._agl_ft = fdm.reader("position/h-agl-ft")
        self._time = fdm.reader("simulation/sim-time-sec")
        self.inside = self._check()

    def _check(self) -> Callable[[], bool]:
        alpha, theta, V_a_fps, n_z = self._alpha, self._theta, self._V_a_fps, self._n_z
        agl_ft = self._agl_ft
        envelope = self._fdm.config.envelope
        alpha_low, alpha_high = envelope.alpha
        theta_low, theta_high = envelope.theta
        V_low, V_high = (speed / FT for speed in envelope.V_a)
        n_low, n_high = envelope.n_z

        def inside() -> bool:
            return (
                alpha_low < alpha() < alpha_high
                and V_low < V_a_fps() < V_high
                and n_low < n_z() < n_high
                and theta_low < theta() < theta_high
                and agl_ft() > 0.0
            )

        return inside

    def bad_command(self, phi_cmd: float, n_z_cmd: float) -> Stop:
        """Return the stop of a flight whose command is not finite."""
        return Stop(
            "diverged",
            f"t = {self._time():.3f} s: commands must be finite, "
            f"got phi_cmd {phi_cmd:g} rad, n_z_cmd {n_z_cmd:g}.",
        )

    def diagnosis(self) -> Stop:
        """Return why the flight may not go on.

        Raises
        ------
        PlantError
            If nothing is wrong with the state: JSBSim ended the run by itself.
        """
        at = f"t = {self._time():.3f} s"
        V_a, agl = self._V_a_fps() * FT, self._agl_ft() * FT
        state = {
            "alpha": self._alpha(), "theta": self._theta(), "V_a": V_a, "n_z": self._n_z(), "h": agl,
        }  # fmt: skip
        lost = [name for name, value in state.items() if not math.isfinite(value)]
        if lost:
            return Stop("diverged", f"{at}: {', '.join(lost)} must be finite, got no number.")
        if agl <= 0.0:
            return Stop("ground_contact", f"{at}: touched the ground at {V_a:.1f} m/s.")
        envelope = self._fdm.config.envelope
        watched = (
            ("alpha", envelope.alpha, DEG, "deg"),
            ("V_a", envelope.V_a, 1.0, "m/s"),
            ("n_z", envelope.n_z, 1.0, ""),
            ("theta", envelope.theta, DEG, "deg"),
        )
        for name, (low, high), unit, unit_name in watched:
            if not low < state[name] < high:
                return Stop(
                    "left_envelope",
                    f"{at}: {name} must stay in {low / unit:g} to {high / unit:g} {unit_name}, "
                    f"got {state[name] / unit:.2f}.".replace("  ", " ").replace(" ,", ","),
                )
        raise PlantError(f"{at}: JSBSim ended the run by itself, with a state inside the envelope.")
