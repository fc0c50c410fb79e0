"""``[sensors]``: errors of what the controller sees."""

from flighttune.plants.sensors import Sensors
from flighttune.scenario.table import Finite, NotNegative, Positive, Table
from flighttune.units import DEG


class SensorsTable(Table):
    """``[sensors]``: bias and noise of course, flight-path angle and airspeed."""

    chi_bias_deg: Finite = 0.0
    chi_noise_sd_deg: NotNegative = 0.0
    gamma_bias_deg: Finite = 0.0
    gamma_noise_sd_deg: NotNegative = 0.0
    V_a_bias_mps: Finite = 0.0
    V_a_noise_sd_mps: NotNegative = 0.0
    noise_time_constant_s: Positive | None = None

    def sensors(self, seed: int) -> Sensors:
        """The errors in rad and m/s, their noise drawn from the scenario's `seed`."""
        return Sensors(
            bias=(self.chi_bias_deg * DEG, self.gamma_bias_deg * DEG, self.V_a_bias_mps),
            noise_sd=(
                self.chi_noise_sd_deg * DEG,
                self.gamma_noise_sd_deg * DEG,
                self.V_a_noise_sd_mps,
            ),
            time_constant=self.noise_time_constant_s or 0.0,
            seed=seed,
        )
