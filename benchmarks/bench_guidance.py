"""Published guidance flown against that of the package: the same routes, wind and aircraft.

Run it with ``python benchmarks/bench_guidance.py``; ``--time`` flies the package's with other
look-ahead times on three aircraft. Without it, exits with 1 where the package's guidance leaves a
route by more than `MAX_CROSS_TRACK` m. The laws and results: design/guidance.md.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import running

import flighttune as ft
from flighttune.flight.conditions import command_limits, reference_of, start_condition
from flighttune.flight.fly import plant_of
from flighttune.flight.loop.loop import simulate
from flighttune.flight.models import gain_sets, law_setup
from flighttune.routes.follow import RouteReference

MAX_CROSS_TRACK = 8.0
SHARE = 60.0 / 90.0  # course towards the path far from it, over 90 deg, in the vector field
ASIDE, NEAR = 50.0, 2.0  # beside the path at the start; from it where it is reached, m
LEGS = {"five": [(900, 0), (900, 90), (800, 164), (1100, 56), (700, 142)], "line": [(1500, 0)]}
if running.QUICK:
    LEGS = {"five": [(300, 0), (300, 90)], "line": [(400, 0)]}
SCALES = {"aerosonde": (25.0, 1.0), "c172p": (50.0, 4.0), "a4": (200.0, 24.0)}  # m/s, of LEGS
AIRFRAMES = [
    {"mass_factor": 1.06, "lift_factor": 0.9, "roll_moment_factor": 0.8},
    {"cg_aft_m": 0.01, "pitch_moment_factor": 0.8, "actuator_lag_factor": 1.5},
    {"mass_factor": 0.94, "roll_moment_factor": 1.2, "cg_aft_m": -0.01},
    {"yaw_moment_factor": 0.8, "thrust_factor": 0.85, "drag_factor": 1.2},
]
COLUMNS = "largest cross track, m | height, m | RMS, m | roll rate RMS, deg/s"


@dataclass(frozen=True, kw_only=True, eq=False)
class Guided(RouteReference):
    """A route and the guidance that follows it."""

    guidance: type["VectorField"] | None

    def follower(self, dt: float, h_0: float, lead: tuple[float, float] = (0.0, 0.0)) -> Any:
        inner = super().follower(dt, h_0, lead)
        return inner if self.guidance is None else self.guidance(self, inner, dt)


class VectorField:
    """Nelson, Barber, McLain, Beard 2007, with the slope of the package's law on the path."""

    def __init__(self, route, inner, dt):
        self.route, self.inner, self.dt, self.before, self.chi = route, inner, dt, None, None

    def __call__(self, m):
        sample, place = self.inner(m)
        position, self.before = self.before, m.position[:2]
        self.V_g = math.dist(position, self.before) / self.dt if position else self.route.V_a
        along, e_y, *_ = place
        return self.turned(m, sample, along, e_y, self.V_g * self.route.look_ahead), place

    def turned(self, m, sample, along, e_y, L):  # noqa: ARG002
        chi_p, (angle, slope) = sample.chi + math.atan(e_y / L), self.field(e_y, L)
        slope -= L / (L * L + e_y * e_y)
        rate = sample.chi_dot - slope * self.V_g * math.sin(m.chi - chi_p)
        return sample._replace(chi=chi_p - angle, chi_dot=rate)

    def field(self, e_y, L):
        """Angle towards the path, and its change per metre."""
        part = e_y / (SHARE * L)
        return SHARE * math.atan(part), 1.0 / (L * (1.0 + part * part))


class NPFG(VectorField):
    """The bearing of PX4's (Stastny, Siegwart 2019), with the same slope on the path."""

    def field(self, e_y, L):
        part = min(abs(e_y) / (math.pi * L), 1.0)
        return math.copysign(0.5 * math.pi * part * (2.0 - part), e_y), (1.0 - part) / L


class L1(VectorField):
    """Park, Deyst, How 2004: a course that turns at 2 V sin(eta) / L towards a point L away."""

    def turned(self, m, sample, along, e_y, L):  # noqa: ARG002
        path, self.chi = self.route.path, sample.chi if self.chi is None else self.chi
        ahead = slice(int(along), int(along + L) + 2)  # the points of a path are 1 m apart
        to = path.north[ahead] - m.position[0], path.east[ahead] - m.position[1]
        i = np.abs(np.hypot(*to) - L).argmin()
        rate = 2.0 * self.V_g / L * math.sin(math.atan2(to[1][i], to[0][i]) - self.chi)
        chi, self.chi = self.chi, self.chi + rate * self.dt
        planned = math.atan(self.V_g * rate / self.route.g), sample.planned[1]
        return sample._replace(chi=chi, chi_dot=rate, planned=planned)


GUIDANCE = {"look-ahead": None, "vector field": VectorField, "NPFG": NPFG, "L1": L1}


def flown(
    route, wind, airframe: Any, aircraft="aerosonde", law="paper", guidance=None, T=3.0, aside=0.0
):
    """Signals of a flight, which begins `aside` m to the right of the path."""
    (V_a, scale), tables = SCALES[aircraft], ft.load_scenario("circuit").as_dict()
    tables |= {"law": law, "gains": ["tuned_identified"], "expect": []}
    tables["tuning"] = {"identified": aircraft}
    tables["plant"] = [{"kind": "jsbsim", "aircraft": aircraft, "airframe": airframe}]
    tables["flight"] |= {"V_a_mps": V_a, "duration_s": 2000.0}
    if wind is not None:
        tables["wind"] = {"speed_mps": 8.0, "from_deg": wind}
    if airframe is not None:
        tables |= {"turbulence": {"intensity": "light"}, "seed": 10 + int(wind or 0.0)}
    if aircraft != "aerosonde":
        del tables["limits"]
    if route in LEGS:
        ends = np.cumsum([0.0, *(scale * d * np.exp(1j * math.radians(c)) for d, c in LEGS[route])])
        tables["route"]["waypoint"] = [{"north_m": p.real, "east_m": p.imag} for p in ends.tolist()]
    made = ft.scenario_from({k: v for k, v in tables.items() if k not in ("verifies", "source")})
    ((name, gains),) = gain_sets(made)[0].items()
    r, plant = reference_of(made), plant_of(made.plant[0], made)
    assert isinstance(r, RouteReference)
    assert gains is not None
    path = replace(r.path, east=r.path.east - aside)
    setup = law_setup(made, gains, command_limits(made).within(plant.limits))
    signals, stop = simulate(
        plant, made.law_of(name, gains)[0].controller(setup),
        Guided(path=path, V_a=r.V_a, g=r.g, look_ahead=T, guidance=guidance),
        condition=start_condition(made), duration=2000.0,
    )  # fmt: skip
    return signals if stop is None else signals * math.nan


def measures(flights):
    """Of some flights, in the order of `COLUMNS`."""
    errors = [s[["cross_track", "height_err"]].abs().to_numpy() for s in flights]
    e_y, e_h = np.concatenate(errors).T
    roll = np.concatenate([np.diff(s["phi"]) for s in flights])
    rms = math.sqrt(np.mean(e_y**2)), 50.0 * math.degrees(math.sqrt(np.mean(roll**2)))
    return [float(e_y.max()), float(e_h.max()), *rms]


def compared():
    """Rows of the guidance laws: law, weather and measures, and the distance to the path."""
    rough = list(zip((0.0, 90.0, 180.0, 270.0), AIRFRAMES, strict=True))[
        : 1 if running.QUICK else 4
    ]
    steady: list[tuple[Any, Any]] = [(None, None), *((wind, None) for wind, _ in rough)]
    for name, guidance in GUIDANCE.items():
        for law in ("paper", "exact"):
            s = flown("line", *steady[0], law=law, guidance=guidance, aside=ASIDE)
            away = float(s["along"][s["cross_track"].abs() > NEAR].max())
            for air, weather in (("steady", steady), ("turbulence", rough)):
                for route in ("five",) if running.QUICK else ("five", "circuit"):
                    flights = (flown(route, *w, law=law, guidance=guidance) for w in weather)
                    yield f"{name}; {law} law; {route}; {air}", [*measures([*flights]), away]


def look_ahead_times():
    """Rows of the package's guidance with other times."""
    for aircraft in SCALES:
        for T in (1.5, 2.0, 2.5, 3.0, 4.0, 5.0):
            for air, airframe in (("steady", None), ("turbulence", {})):
                yield (
                    f"{aircraft}; {T} s; {air}",
                    measures([flown("five", 90.0, airframe, aircraft, T=T)]),
                )


def main() -> int:
    parser = running.options(__doc__)
    parser.add_argument("--time", action="store_true", help="other look-ahead times")
    times, widest = parser.parse_args().time, 0.0
    print(COLUMNS + ("" if times else f" | m of the path from {ASIDE:g} m beside to {NEAR:g} m"))
    for name, values in look_ahead_times() if times else compared():
        print(f"{name:48}" + "".join(f"{value:9.2f}" for value in values), flush=True)
        widest = np.maximum(widest, values[0] if name.startswith("look-ahead;") else 0.0)
    return int(not widest <= MAX_CROSS_TRACK)


if __name__ == "__main__":
    running.end(main)
