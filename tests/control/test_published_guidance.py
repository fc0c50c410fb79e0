"""NPFG, L1 and TECS's balance, state by state, against their sources computed in vectors.

The references follow the vectors and the order of the sources that `autopilot.py` cites; the
program computes with angles from the track and in fewer steps.
"""

import math
from typing import NamedTuple

import numpy as np

import flighttune as ft

STATES, DT, G = 1500, 0.02, 9.80665
EXACT = 1e-9
"""Largest difference, relative to the size of the value and at least absolute."""


def assert_equal(pairs):
    found, expected = np.array(pairs).T
    np.testing.assert_allclose(found, expected, rtol=EXACT, atol=EXACT)


def unit(angle):
    return np.array([math.cos(angle), math.sin(angle)])


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def within(x, low, high):
    return max(low, min(high, x))


def law(parameters):
    """An autopilot's law with these parameters, and no limit of its roll in the way."""
    free = {"NPFG_PERIOD": "FW_R_LIM", "FW_L1_PERIOD": "FW_R_LIM", "NAVL1_PERIOD": "ROLL_LIMIT_DEG"}
    slew = {"NPFG_PERIOD": "FW_PN_R_SLEW_MAX", "FW_L1_PERIOD": "FW_L1_R_SLEW_MAX"}
    period = next(name for name in free if name in parameters)
    parameters = {free[period]: 89.9999, **{slew[k]: 0.0 for k in slew if k == period}} | parameters
    tables = ft.load_scenario("paper_as_printed").as_dict() | {"gains": ["paper"], "expect": []}
    own = {"name": "now", "kind": "autopilot", "parameters": parameters}
    (made,) = ft.scenario_from(tables | {"law": [own]}).laws
    return made.make(ft.loop.LawSetup(dt=DT, limits=ft.loop.Limits.none(2), g=G)), roles(made)


def roles(made):
    return Roles(made.roles)


class Roles(dict):
    """Every parameter by its role."""

    __getattr__ = dict.__getitem__


class Motion(NamedTuple):
    chi: float
    V_g: float
    air: tuple[float, float]
    wind: tuple[float, float]


class Track(NamedTuple):
    course: float
    right: float
    curvature: float


def acceleration(flown, m, track, V_sp, *, anew=True):
    """Lateral acceleration that a sample of the law commands, m/s^2."""
    if anew:
        flown.start(ft.loop.FlightCondition(V_a=V_sp, chi=m.chi))
    velocity = (m.air[0] + m.wind[0], m.air[1] + m.wind[1], 0.0)
    motion = {"V_g": m.V_g, "velocity": velocity, "acceleration": 0.0, "theta": 0.0}
    place, wind = (0.0, 0.0, 0.0), (*m.wind, 0.0)
    here = ft.loop.Measured(m.chi, 0.0, math.hypot(*m.air), 0.0, 1.0, 100.0, place, wind, **motion)
    path = (track.course, track.right, 0.0, track.curvature, 0.0)
    return G * math.tan(flown.step(here, ft.loop.ReferenceSample(0.0, 0.0, path=path), 0.0)[0])


def states(seed):
    """Motion beside a track, in winds up to above the airspeed, also turned away from it."""
    rng = np.random.default_rng(seed)
    for k in range(STATES):
        V, heading, course = rng.uniform(8, 30), *rng.uniform(-math.pi, math.pi, 2)
        if k % 2:
            heading = course + rng.normal(0.0, 0.5)
        wind = rng.uniform(0, 1.2) * V * (k % 3 > 0) * unit(rng.uniform(-math.pi, math.pi))
        velocity = V * unit(heading) + wind
        right = rng.normal(0.0, 10.0 ** rng.uniform(0, 2.5))
        curvature = (k % 4 > 0) * rng.choice([-1, 1]) / 10.0 ** rng.uniform(1.5, 3)
        chi, V_g = math.atan2(velocity[1], velocity[0]), math.hypot(*velocity)
        air = tuple(float(x) for x in velocity - wind)
        motion = Motion(chi, V_g, air, tuple(map(float, wind)))
        yield motion, Track(course, right, curvature), rng.uniform(0.8, 1.2) * V


def velocity_of(m):
    return np.array(m.air) + np.array(m.wind)


def l1_of_ardupilot(x, m, track, integral):
    """AP_L1_Control: lateral acceleration, the angle to the leg, and which mode it was in."""
    v, t = velocity_of(m), unit(track.course)
    gain = 4.0 * x.damping**2
    place = track.right * np.array([-t[1], t[0]])
    if track.curvature == 0.0:
        speed = np.linalg.norm(v)
        length = 0.3183099 * x.damping * x.period * speed
        to_leg = math.asin(within(cross(place, t) / length, -0.7071, 0.7071))
        angle = to_leg + integral + math.atan2(cross(v, t), v @ t)
        return gain * speed**2 / length * math.sin(within(angle, -1.5708, 1.5708)), to_leg, "leg"
    side, radius = np.sign(track.curvature), 1.0 / abs(track.curvature)
    from_centre = place - side * radius * np.array([-t[1], t[0]])
    away = from_centre / np.linalg.norm(from_centre)
    speed, omega = max(np.linalg.norm(v), 1.0), 6.2832 / x.period
    length = 0.3183099 * x.damping * x.period * speed
    across, inward = cross(away, v), -(v @ away)
    angle = within(math.atan2(across, inward), -math.pi / 2, math.pi / 2)
    capture = gain * speed**2 / length * math.sin(angle)
    error, tangent = np.linalg.norm(from_centre) - radius, across * side
    back = error * omega**2 - inward * 2.0 * x.damping * omega
    if inward < 0.0 and tangent < 0.0:
        back = max(back, 0.0)
    circle = side * (back + tangent**2 / max(0.5 * radius, radius + error))
    if error > 0.0 and side * capture < side * circle:
        return capture, 0.0, "capture"
    return circle, 0.0, "circle"


def test_l1_of_ardupilot_accelerates_as_its_source():
    (flown, x), modes, pairs = law({"NAVL1_PERIOD": 17.0}), set(), []
    integral = 0.0  # it goes on from state to state
    for m, track, V_sp in states(1):
        # inside of the middle of a circle its source has no nearest point
        if track.curvature * track.right > 0.99:
            continue
        expected, to_leg, mode = l1_of_ardupilot(x, m, track, integral)
        if mode == "leg" and abs(to_leg) < math.radians(5.0):
            integral = within(integral + to_leg * x.distance_integral * DT, -0.1, 0.1)
            expected, _, _ = l1_of_ardupilot(x, m, track, integral)
            mode = "small angle"
        modes.add(mode)
        pairs.append((acceleration(flown, m, track, V_sp), expected))
    assert_equal(pairs)
    assert modes == {"leg", "small angle", "capture", "circle"}
    assert integral


def test_l1_of_px4_accelerates_as_its_source():
    (flown, x), modes, pairs, circling = law({"FW_L1_PERIOD": 17.0}), set(), [], False
    for m, track, V_sp in states(2):
        if track.curvature * track.right > 0.99:
            continue
        v, t = velocity_of(m), unit(track.course)
        speed, omega = max(np.linalg.norm(v), 0.1), 2.0 * math.pi / x.period
        length = x.damping * x.period / math.pi * speed
        gain = 4.0 * x.damping**2 * speed**2 / length
        place = track.right * np.array([-t[1], t[0]])
        if track.curvature == 0.0:
            to_leg = math.asin(within(cross(place, t) / length, -1.0, 1.0))
            angle = to_leg + math.atan2(cross(v, t), v @ t)
            expected, mode = gain * math.sin(within(angle, -math.pi / 2, math.pi / 2)), "leg"
        else:
            side, radius = np.sign(track.curvature), 1.0 / abs(track.curvature)
            from_centre = place - side * radius * np.array([-t[1], t[0]])
            away = from_centre / np.linalg.norm(from_centre)
            across, inward = cross(away, v), -(v @ away)
            angle = within(math.atan2(across, inward), -math.pi / 2, math.pi / 2)
            capture = gain * math.sin(angle)
            error, tangent = np.linalg.norm(from_centre) - radius, across * side
            back = error * omega**2 - inward * 2.0 * x.damping * omega
            mode = "circle"
            if tangent < -2.0 and circling:
                back, mode = max(back, 0.0), "backwards"
            expected = side * (back + tangent**2 / max(0.5 * radius, radius + error))
            if error > 0.0 and side * capture < side * expected:
                expected, mode = capture, "capture"
            circling = mode != "capture"
        modes.add(mode)
        pairs.append((acceleration(flown, m, track, V_sp), expected))
    assert_equal(pairs)
    assert modes == {"leg", "circle", "capture", "backwards"}


def feasibility(across, along, V, wind):
    across = wind if along < 0.0 else abs(across)
    return math.sin(math.pi / 2 * within((V - across) / 1.5, 0.0, 1.0)) ** 2


def ahead(right, speed, late):
    """Look-ahead angle, rad."""
    bound = speed * late if speed > 1.0 else 0.5 * late * (speed**2 + 1.0)
    return math.pi / 2 * (within(abs(right) / bound, 0.0, 1.0) - 1.0) ** 2


def period_of(x, V, V_g, wind, curvature, right, feasible):
    """DirectionalGuidance::adaptPeriod."""
    rate = abs(curvature * V)
    factor = 2.0 if wind > V else 2.0 * (1.0 - math.sqrt(1.0 - min(1.0, wind / V)))
    if not x.bounds_below:
        return x.period
    straight = math.pi * x.roll_tc / x.damping
    curved = straight
    if rate * factor >= 1e-6 and x.damping >= 0.5:
        curved = 4 * math.pi * x.roll_tc * x.damping * feasible + (1 - feasible) * straight
    near = math.sin(ahead(right, V_g, straight * x.safety * x.damping)) ** 2
    least = curved * x.safety * near + (1.0 - near) * straight * x.safety
    period = max(least, x.period)
    if x.bounds_above and rate * factor > 1e-6 and feasible > 0.0:
        most = 4.0 * math.pi * x.damping / (rate * factor * feasible)
        if period > most:
            period = max(least, most) * near + (1.0 - near) * period
    return period


def npfg(x, m, track, V_sp):
    """DirectionalGuidance, CourseToAirspeedRefMapper and AirspeedDirectionController."""
    air, wind, t = np.array(m.air), np.array(m.wind), unit(track.course)
    ground, V, W = air + wind, np.linalg.norm(air), np.linalg.norm(wind)
    V_g = np.linalg.norm(ground)
    on_track = feasibility(cross(wind, t), wind @ t, V, W)
    late = x.damping * period_of(x, V, V_g, W, track.curvature, track.right, on_track)
    look = ahead(track.right, V_g, late)
    normal = -(-1.0 if track.right < 0.0 else 1.0) * np.array([-t[1], t[0]])
    bearing = math.cos(look) * normal + math.sin(look) * t
    feasible = on_track * feasibility(cross(wind, bearing), wind @ bearing, V, W)
    across = cross(wind, bearing)
    if abs(across) < V_sp and (wind @ bearing > 0.0 or W < V_sp):
        along = math.sqrt(V_sp**2 - across**2)
        wanted = along * bearing + across * np.array([-bearing[1], bearing[0]])
    else:
        wanted = math.sqrt(max(W**2 - V_sp**2, 0.0)) * bearing - wind
    wanted = wanted / np.linalg.norm(wanted)
    part = cross(air, wanted)
    if air @ wanted < 0.0:
        part = -V if part < 0.0 else V
    spread = 1.0 - track.curvature * track.right
    bent = track.curvature / max(spread, abs(track.curvature) * 0.5, 1e-300)
    ratio = 1.0 + wind @ t / max(math.sqrt(max(V**2 - cross(wind, t) ** 2, 0.0)), 1e-6)
    turn = V * ratio * bent * max(ground @ t, 0.0)
    return 4 * math.pi * x.damping**2 / late * part + feasible * math.sin(look) ** 2 * turn


VARIANTS = [
    {},
    {"NPFG_LB_PERIOD": 0.0},
    {"NPFG_PERIOD": 2.0, "NPFG_UB_PERIOD": 0.0},
    {"NPFG_PERIOD": 60.0, "NPFG_DAMPING": 0.9},
    {"NPFG_PERIOD": 3.0, "NPFG_DAMPING": 0.4},
]


def test_npfg_accelerates_as_its_source():
    sets, pairs = [law({"NPFG_PERIOD": 10.0} | changed) for changed in VARIANTS], []
    for k, (m, track, V_sp) in enumerate(states(3)):
        flown, x = sets[k % len(sets)]
        pairs.append((acceleration(flown, m, track, V_sp), npfg(x, m, track, V_sp)))
    assert_equal(pairs)


class PitchOfArduPilot:
    """AP_TECS with its names of states, in its order, but for the throttle."""

    def __init__(self, x, height, V):
        self.x, self.TAS, self.TAS_dem, self.vdot_lpf = x, V, V, 0.0
        self.integ_TAS = self.integ_SEB = self.integ_KE = self.last = self.unc = 0.0
        self.recent, self.clip = [], 0
        self.dem_in_prev = self.rate_ltd = self.lpf = self.dem_prev = height
        self.climb_scaler = self.sink_scaler = 1.0

    def step(self, height, climb, V, V_dot, demand, low, high):
        x, tc = self.x, self.x.height_tc
        # _update_speed
        self.recent = [*self.recent, V_dot][-5:]
        vdot = np.mean(self.recent)
        alpha = DT / (DT + tc)
        self.vdot_lpf = self.vdot_lpf * (1.0 - alpha) + vdot * alpha
        error = V - self.TAS
        self.integ_TAS += error * x.speed_omega**2 * DT
        change = self.integ_TAS + vdot + error * x.speed_omega * 1.4142
        self.TAS = max(self.TAS + change * DT, 3.0)
        self.demand(demand, low, high)
        # _update_energies and _update_pitch
        SKE_weight, SPE_weight = min(x.weight, 1.0), min(2.0 - x.weight, 1.0)
        SKE_dem, SKE_est = 0.5 * self.TAS_dem**2, 0.5 * self.TAS**2
        SEB_error = (self.lpf * G * SPE_weight - SKE_dem * SKE_weight) - (
            height * G * SPE_weight - SKE_est * SKE_weight
        )
        dem = self.rate_dem * G * SPE_weight + SEB_error / tc
        self.clip = int(dem > x.climb * G) - int(dem < -x.sink * G)
        dem = within(dem, -x.sink * G, x.climb * G)
        SKEdot = self.TAS * (vdot - self.vdot_lpf)
        rate_error = dem - (climb * G * SPE_weight - SKEdot * SKE_weight)
        total, gain = dem + rate_error * x.damp, self.TAS * G
        least = gain * (low - math.radians(5.0)) - total
        most = gain * (high + math.radians(5.0)) - total
        tenth = 0.1 * (most - least)
        delta = within(rate_error * x.integral * DT, -tenth, tenth)
        self.unc = (total + self.integ_SEB + delta + self.integ_KE) / gain
        if (self.unc > high and delta > 0.0) or (self.unc < low and delta < 0.0):
            self.integ_SEB *= 1.0 - DT / (DT + tc)
            self.integ_KE *= 1.0 - DT / (DT + tc)
        else:
            self.integ_SEB += delta
            self.integ_KE += (SKE_est - SKE_dem) * SKE_weight * DT / tc
        self.integ_SEB = within(self.integ_SEB, least, most)
        quarter = 0.25 * (high - low) * gain
        self.integ_KE = within(self.integ_KE, -quarter, quarter)
        self.unc = (total + self.integ_SEB + self.integ_KE) / gain
        slew = DT * x.acceleration / self.TAS
        self.last = within(within(self.unc, low, high), self.last - slew, self.last + slew)
        return self.last

    def demand(self, demand, low, high):
        """update_pitch_throttle and _update_height_demand."""
        x = self.x
        rises, falls = demand > self.dem_in_prev, demand < self.dem_in_prev
        if (self.unc > high and rises) or (self.unc < low and falls):
            demand = self.dem_in_prev
        mean, self.dem_in_prev = 0.5 * (demand + self.dem_in_prev), demand
        up, down = x.climb * self.climb_scaler * DT, x.sink * self.sink_scaler * DT
        self.rate_ltd = within(mean, self.rate_ltd - down, self.rate_ltd + up)
        coef = DT / (DT + x.demand_tc)
        self.rate_dem = (self.rate_ltd - self.lpf) / x.demand_tc
        self.lpf = self.rate_ltd * coef + (1.0 - coef) * self.lpf
        if (self.unc > high or self.clip > 0) and self.lpf > self.dem_prev:
            self.climb_scaler *= 1.0 - coef
        elif (self.unc < low or self.clip < 0) and self.lpf < self.dem_prev:
            self.sink_scaler *= 1.0 - coef
        else:
            self.climb_scaler = self.climb_scaler * (1.0 - coef) + coef
            self.sink_scaler = self.sink_scaler * (1.0 - coef) + coef
        self.dem_prev = self.lpf


def test_the_balance_of_ardupilot_pitches_as_its_source_sample_by_sample():
    rng, pairs, met, ends = np.random.default_rng(4), [], set(), (-12.0, 30.0)
    for k in range(3 * STATES):
        if k % STATES == 0:
            weight = (1.0, 0.4, 1.7)[k // STATES]
            flown, x = law(
                {"NAVL1_PERIOD": 17.0, "TECS_SPDWEIGHT": weight, "TECS_PITCH_MIN": 0.0}
                | {"TECS_PITCH_MAX": 0.0, "PTCH_LIM_MIN_DEG": ends[0], "PTCH_LIM_MAX_DEG": ends[1]}
            )
            V, height, climb, asked = 20.0, 100.0, 0.0, 100.0
            source = PitchOfArduPilot(x, height, V)
            flown.start(ft.loop.FlightCondition(V_a=V))
        if k % 250 == 0:  # steps up and down, some of them beyond what the pitch can give
            asked += rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 60.0)
        V_dot = rng.normal(0.0, 0.8) * (k % STATES > 0)
        if k % STATES:
            climb += DT * rng.normal(0.0, 30.0) - 0.1 * DT * climb
            height, V = height + DT * climb, within(V + DT * V_dot, 14.0, 27.0)
        motion = {"V_g": V, "velocity": (V, 0.0, -climb), "acceleration": V_dot, "theta": 0.0}
        here = ft.loop.Measured(0.0, 0.0, V, 0.0, 1.0, height, (0.0, 0.0, 0.0), None, **motion)
        path = (0.0, 0.0, asked - height, 0.0, 0.0)
        found = flown.step(here, ft.loop.ReferenceSample(0.0, 0.0, path=path), 0.0)[2]
        low, high = map(math.radians, ends)
        pairs.append((found, source.step(height, climb, V, V_dot, asked, low, high)))
        met |= {int(source.unc > high) - int(source.unc < low), f"clip {source.clip}"}
    assert_equal(pairs)
    assert met == {-1, 0, 1, "clip -1", "clip 0", "clip 1"}
