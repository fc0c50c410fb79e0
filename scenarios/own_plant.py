"""A plant of one's own: a glider that loses speed in a turn, flown by the exact law and by K*."""

import math
import sys

import flighttune as ft

G = 9.81


class Glider:
    """A glider of constant lift-to-drag ratio: what it turns or climbs by it pays for in speed."""

    kind = "glider"
    signals = ("chi", "gamma", "phi", "n_z", "V_a", "north", "east", "down", "h")
    limits = ft.loop.Limits.none(2)

    def __init__(self, glide_ratio=25.0, thrust=0.05):
        self.glide_ratio, self.thrust = glide_ratio, thrust

    def start(self, condition):
        """Begin at the condition; the position is where it starts."""
        self.chi, self.gamma, self.V_a = condition.chi, condition.gamma, condition.V_a
        self.phi, self.n_z, self.h_0 = condition.phi, condition.n_z_start, condition.h
        self.north = self.east = self.down = 0.0

    def observe(self):
        """Return the signals, SI and radians."""
        where = self.north, self.east, self.down, self.h_0 - self.down
        return self.chi, self.gamma, self.phi, self.n_z, self.V_a, *where

    def advance(self, phi_cmd, n_z_cmd, duration):
        """Fly `duration` seconds in steps of a millisecond; stop below 12 m/s."""
        for _ in range(steps := max(1, round(duration / 0.001))):
            dt = duration / steps
            self.phi += (phi_cmd - self.phi) * dt / 0.2
            self.n_z += (n_z_cmd - self.n_z) * dt / 0.1
            level, speed = math.cos(self.gamma), self.V_a * dt
            drag = abs(self.n_z) / self.glide_ratio - self.thrust
            self.chi += G * self.n_z * math.sin(self.phi) / (self.V_a * level) * dt
            self.gamma += G / self.V_a * (self.n_z * math.cos(self.phi) - level) * dt
            self.V_a -= G * (drag + math.sin(self.gamma)) * dt
            self.north += speed * level * math.cos(self.chi)
            self.east += speed * level * math.sin(self.chi)
            self.down -= speed * math.sin(self.gamma)
        if self.V_a < 12.0:
            return ft.loop.Stop("left_envelope", f"{self.V_a:.1f} m/s: stalled")
        return None


if __name__ == "__main__":
    changes = {"law": ["paper", "exact"], "gains": ["paper"], "plant": [{"kind": "point_mass"}]}
    tables = ft.load_scenario("level_turn").as_dict() | changes
    flown = ft.fly(ft.scenario_from(tables), plants={"glider": Glider})
    print(flown.metrics[["ITAE", "MO_rad", "settling_s"]])
    print(ft.record(flown, sys.argv[1] if len(sys.argv) > 1 else "runs/own_plant"))
