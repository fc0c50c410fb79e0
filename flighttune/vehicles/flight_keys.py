"""``[flight]`` of a scenario: the start and duration of a flight."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from flighttune.base import quantities as q
from flighttune.base.units import G_PAPER
from flighttune.vehicles.plants.jsbsim.plant import DEEPEST_GROUND, HIGHEST_GROUND

Ground: TypeAlias = Annotated[float, Field(ge=-DEEPEST_GROUND, le=HIGHEST_GROUND)]


class FlightTable(q.Table):
    """``[flight]``: start and length of the manoeuvre, and gravity of the kinematic law.

    In steady wind the flight starts along its course and path angle over ground; with
    ``start = "heading"`` it starts along them through the air.
    """

    V_a_mps: q.Airspeed
    h_m: q.Height = 1000.0  # above sea level
    chi_deg: q.Course = 0.0
    gamma_deg: q.Inclination = 0.0
    phi_deg: q.Inclination = 0.0
    n_z: q.LoadFactor | None = None  # command at the start; steady flight if left out
    # Angles over ground or, with heading, through the air
    start: Literal["course", "heading"] = "course"
    duration_s: q.Duration = 20.0
    ground_m: Ground = 0.0  # height of the ground above sea level
    g_mps2: q.Gravity = G_PAPER  # gravity of the kinematic law
