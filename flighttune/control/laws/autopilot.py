"""The guidance of PX4 and of ArduPilot: NPFG or L1 for the course, TECS's balance for the height.

The equations come from published sources, cited at each equation: [N] is
``src/lib/npfg/DirectionalGuidance.cpp`` of PX4 1.17 (up to 1.16 ``npfg.cpp``), [E]
``src/lib/l1/ECL_L1_Pos_Controller.cpp`` of PX4 1.13, [T] ``src/lib/tecs/TECS.cpp`` of PX4 1.14,
[L] and [A] ``AP_L1_Control.cpp`` and ``AP_TECS.cpp`` of ArduPilot 4.5.
"""

import math
import tomllib
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

from flighttune.base.errors import InputError
from flighttune.base.files.shipped import nearest_name
from flighttune.base.units import DEG, wrap_angle
from flighttune.control.controller import FlightCondition, LawSetup, Measured, ReferenceSample
from flighttune.control.gains import RATES
from flighttune.control.law import Law

RIGHT_ANGLE = 0.5 * math.pi

# Largest roll and, for L1, largest pitch whose cosine divides the lift ([L] nav_roll_cd), rad.
STEEPEST, STEEPEST_PITCH = 1.2, 60.0 * DEG

# [N]: excess of airspeed over crosswind at which a bearing becomes feasible (m/s), smallest radius
# (m), and smallest number other than zero.
AIRSPEED_BUFFER, MIN_RADIUS, TINY = 1.5, 0.5, 1e-6

# [L] update_waypoint: largest angle for integration, and largest integral, rad.
SMALL_ANGLE, LARGEST_INTEGRAL = 5.0 * DEG, 0.1

# [E] navigate_loiter: speed against the sense of a circle from which it is not left, m/s.
BACKWARDS = 2.0

# [A] _vdot_filter: samples of the acceleration whose mean is used. _update_speed: twice the damping
# of its filter, as it is written. _update_pitch: largest share of its range by which the integral
# moves in a sample.
AVERAGED, TWICE_DAMPING, LARGEST_SHARE = 5, 1.4142, 0.1

# [N] lookAheadAngle: largest curvature of the way back to the track, times the bound of the track
# error: ``max of pi u cos(pi u^2 / 2)`` over u from 0 to 1.
WAY_BACK = 1.60884

# Endings of the roles of parameters that must be positive, because they divide.
POSITIVE = ("period", "damping", "tc", "std", "acceleration")


class Motion(NamedTuple):
    """Motion of an aircraft as an autopilot estimates it."""

    chi: float  # rad: course
    V_g: float  # m/s: level speed over ground
    air: tuple[float, float]  # m/s: level velocity through the air, north and east
    wind: tuple[float, float]  # m/s: level velocity of the air, north and east
    V_a: float  # m/s: airspeed
    V_dot: float  # m/s^2: acceleration along the path through the air
    climb: float  # m/s
    h: float  # m
    theta: float  # rad: pitch, nose up


class Track(NamedTuple):
    """The desired track at its point nearest to the aircraft."""

    course: float  # rad
    right: float  # m: distance of the aircraft to its right
    h: float | None  # m: height above sea level; None if only a rate of climb is commanded
    curvature: float  # 1/m: right positive
    slope: float  # height per distance


def limited(value: float, low: float, high: float) -> float:
    """The value within the limits."""
    return min(max(value, low), high)


class Npfg:
    """NPFG: a bearing from the distance to the track, a heading from bearing and wind."""

    def __init__(self, x: Any, _dt: float) -> None:
        self.x = x

    def acceleration(self, m: Motion, track: Track, V_sp: float) -> float:
        """Lateral acceleration, m/s^2: [N] guideToPath."""
        V = math.hypot(*m.air)
        along, across = _parts(m.wind, track.course)
        on_track = _feasibility(along, across, V, m.wind)
        late = self.x.damping * self.period(m, track, on_track)  # timeConst
        proximity, look_ahead = _proximity(track.right, m.V_g, late)
        bearing = track.course - math.copysign(RIGHT_ANGLE - look_ahead, track.right)
        feasible = on_track * _feasibility(*_parts(m.wind, bearing), V, m.wind)
        error = wrap_angle(_heading(bearing, m.wind, V_sp) - math.atan2(m.air[1], m.air[0]))
        # AirspeedDirectionController::controlHeading saturates it beyond a right angle.
        part = math.sin(error) if abs(error) < RIGHT_ANGLE else math.copysign(1.0, error)
        # lateralAccelFF
        spread = 1.0 - track.curvature * track.right
        turn = track.curvature / max(spread, abs(track.curvature) * MIN_RADIUS, TINY)
        turn *= max(m.V_g * math.cos(m.chi - track.course), 0.0)
        ratio = 1.0 + along / max(math.sqrt(max(V * V - across * across, 0.0)), TINY)
        return self.gain(late) * V * part + feasible * proximity * V * ratio * turn

    def gain(self, late: float) -> float:
        """Rate of the heading per error of it, 1/s: [N] pGain, 4 pi damping / period."""
        return 4.0 * math.pi * self.x.damping**2 / late

    def period(self, m: Motion, track: Track, feasible: float) -> float:
        """The period within its bounds, s: [N] adaptPeriod."""
        x, V, wind = self.x, math.hypot(*m.air), math.hypot(*m.wind)
        if not (x.bounds_below and x.roll_tc > TINY):
            return x.period
        factor = 2.0 if wind >= V else 2.0 * (1.0 - math.sqrt(1.0 - wind / V))  # windFactor
        turn = abs(track.curvature * V) * factor
        straight = lowest = math.pi * x.roll_tc / x.damping  # periodLowerBound
        if turn >= TINY and x.damping >= 0.5:
            lowest += feasible * (4.0 * math.pi * x.roll_tc * x.damping - straight)
        near, _ = _proximity(track.right, m.V_g, x.damping * straight * x.safety)
        lowest = x.safety * (straight + near * (lowest - straight))
        period = max(lowest, x.period)
        if x.bounds_above and turn * feasible >= TINY:  # periodUpperBound
            highest = max(4.0 * math.pi * x.damping / (turn * feasible), lowest)
            period += near * min(highest - period, 0.0)
        return period

    def way_back(self, V_g: float) -> float:
        """Largest acceleration that the way back to a straight track needs, m/s^2.

        `V_g`: speed over ground, m/s. If the roll cannot give it, the aircraft crosses the track on
        its way back, and the distance from it grows.
        """
        return WAY_BACK * V_g / (self.x.damping * self._least_period(V_g))

    def linear(self, V_a: float) -> tuple[float, float]:
        """Rate of the course per error of it (1/s) and per distance over the airspeed (1/s^2)."""
        late = self.x.damping * self._least_period(V_a)
        return self.gain(late), self.gain(late) * math.pi / late

    def _least_period(self, V_a: float) -> float:
        """The period on a straight track in still air, s."""
        m = Motion(0.0, V_a, (V_a, 0.0), (0.0, 0.0), V_a, 0.0, 0.0, 0.0, 0.0)
        return self.period(m, Track(0.0, 0.0, 0.0, 0.0, 0.0), 1.0)


def _parts(wind: tuple[float, float], bearing: float) -> tuple[float, float]:
    """The wind along a bearing, and its cross product with the bearing, m/s."""
    c, s = math.cos(bearing), math.sin(bearing)
    return wind[0] * c + wind[1] * s, wind[0] * s - wind[1] * c


def _feasibility(along: float, across: float, V: float, wind: tuple[float, float]) -> float:
    """Feasibility of a bearing, 0 to 1: [N] bearingFeasibility."""
    crosswind = math.hypot(*wind) if along < 0.0 else abs(across)
    return math.sin(RIGHT_ANGLE * limited((V - crosswind) / AIRSPEED_BUFFER, 0.0, 1.0)) ** 2


def _proximity(right: float, V_g: float, late: float) -> tuple[float, float]:
    """Nearness of the track, 0 to 1, and the look-ahead angle, rad."""
    bound = late * (V_g if V_g > 1.0 else 0.5 * (V_g * V_g + 1.0))  # [N] trackErrorBound
    look_ahead = RIGHT_ANGLE * (min(abs(right) / bound, 1.0) - 1.0) ** 2  # [N] lookAheadAngle
    return math.sin(look_ahead) ** 2, look_ahead  # [N] trackProximity


def _heading(bearing: float, wind: tuple[float, float], V: float) -> float:
    """Heading that flies a bearing: CourseToAirspeedRefMapper."""
    c, s = math.cos(bearing), math.sin(bearing)
    (along, across), speed = _parts(wind, bearing), math.hypot(*wind)
    if abs(across) < V and (along > 0.0 or speed < V):  # solveWindTriangle
        ahead = math.sqrt(V * V - across * across)
        return math.atan2(across * c + ahead * s, ahead * c - across * s)
    left = math.sqrt(max(speed * speed - V * V, 0.0))  # infeasibleAirVelRef
    return math.atan2(left * s - wind[1], left * c - wind[0])


class NumbersOfL1(NamedTuple):
    """Numbers of L1, with the digits that a source has."""

    per_pi: float
    capture: float  # largest sine of the angle to a leg
    tau: float
    right_angle: float
    slowest: float  # m/s: of the speed over ground on a circle


IN_ARDUPILOT = NumbersOfL1(0.3183099, 0.7071, 6.2832, 1.5708, 1.0)  # [L]
IN_PX4 = NumbersOfL1(1.0 / math.pi, 1.0, math.tau, RIGHT_ANGLE, 0.1)  # [E]


class L1:
    """L1 along a leg, and about a circle on a curved track, as in [L] update_path."""

    def __init__(self, x: Any, dt: float) -> None:
        self.x, self.dt, self.integral, self.circling = x, dt, 0.0, False
        self.ardupilot = hasattr(x, "distance_integral")  # [E] has no integral
        self.numbers = IN_ARDUPILOT if self.ardupilot else IN_PX4

    def acceleration(self, m: Motion, track: Track, _V_sp: float) -> float:
        """Lateral acceleration, m/s^2."""
        off = wrap_angle(m.chi - track.course)
        return self._circle(m, track, off) if track.curvature else self._leg(m, track, off)

    def _leg(self, m: Motion, track: Track, off: float) -> float:
        """[L] update_waypoint, [E] navigate_waypoints."""
        numbers, V_g = self.numbers, max(m.V_g, 0.1)
        distance = numbers.per_pi * self.x.damping * self.x.period * V_g
        sine = -track.right / max(distance, 0.1)
        angle = math.asin(limited(sine, -numbers.capture, numbers.capture))
        if self.ardupilot and abs(angle) < SMALL_ANGLE:
            more = self.integral + angle * self.x.distance_integral * self.dt
            self.integral = limited(more, -LARGEST_INTEGRAL, LARGEST_INTEGRAL)
        angle = limited(angle + self.integral - off, -numbers.right_angle, numbers.right_angle)
        return 4.0 * self.x.damping**2 * V_g * V_g / distance * math.sin(angle)

    def _circle(self, m: Motion, track: Track, off: float) -> float:
        """[L] update_loiter, [E] navigate_loiter."""
        x, numbers, V_g = self.x, self.numbers, max(m.V_g, self.numbers.slowest)
        omega, side = numbers.tau / x.period, math.copysign(1.0, track.curvature)
        radius, outside = 1.0 / abs(track.curvature), -side * track.right
        outward, tangent = -side * m.V_g * math.sin(off), m.V_g * math.cos(off)
        back = outside * omega**2 + outward * 2.0 * x.damping * omega
        wrong = outward > 0.0 > tangent if self.ardupilot else tangent < -BACKWARDS
        if wrong and (self.ardupilot or self.circling):
            back = max(back, 0.0)
        circle = back + tangent**2 / max(0.5 * radius, radius + outside)
        centre = limited(math.atan2(tangent, -outward), -RIGHT_ANGLE, RIGHT_ANGLE)
        distance = numbers.per_pi * x.damping * x.period * V_g
        capture = 4.0 * x.damping**2 * V_g * V_g / distance * math.sin(centre)
        self.circling = outside <= 0.0 or capture >= circle
        return side * (circle if self.circling else capture)

    def linear(self, _V_a: float) -> tuple[float, float]:
        """Rate of the course per error of it (1/s) and per distance over the airspeed (1/s^2)."""
        omega = math.tau / self.x.period
        return 2.0 * self.x.damping * omega, omega**2


class Tecs:
    """The balance of height and airspeed that both autopilots have."""

    def __init__(self, x: Any, dt: float, g: float) -> None:
        self.x, self.dt, self.g = x, dt, g
        # [T] _updateSpeedAltitudeWeights, [A] _update_pitch
        self.shares = limited(2.0 - x.weight, 0.0, 1.0), limited(x.weight, 0.0, 1.0)

    def start(self, m: Motion, V_sp: float) -> None:
        """Begin in steady flight."""
        self.V_sp, self.V, self.V_dot = V_sp, m.V_a, 0.0
        self.h, self.h_dot, self.integral = m.h, m.climb, 0.0
        self.angle = math.asin(limited(m.climb / m.V_a, -1.0, 1.0))

    def slewed(self, angle: float, lower: float, upper: float) -> float:
        """An angle within limits, no faster than the vertical acceleration allows."""
        step = self.dt * self.x.acceleration / self.V
        self.angle = limited(limited(angle, lower, upper), self.angle - step, self.angle + step)
        return self.angle


class TecsOfPx4(Tecs):
    """The balance of PX4's TECS."""

    def climb_angle(self, m: Motion, track: Track, lower: float, upper: float) -> float:
        """The pitch over its trim (rad), within limits: [T] TECSControl::update."""
        x, dt, g = self.x, self.dt, self.g
        self._filter(m)
        V = self.V
        if track.h is None:  # TECSReferenceModel::update with a rate
            wanted = track.slope * m.V_g
        else:
            self._smooth(track.h)
            wanted = (self.h - m.h) / x.height_tc + x.height_ahead * self.h_dot
        wanted = limited(wanted, -x.sink, x.climb)  # _calcAltitudeControlOutput
        most, least = (0.5 * g * rate / V for rate in (x.climb, -x.sink_idle))
        faster = limited((self.V_sp - V) / x.speed_tc, least, most)  # _calcAirspeedControlOutput
        height, kinetic = self.shares
        asked = g * wanted * height - V * faster * kinetic  # _calcPitchControlSebRate
        error = asked - (g * m.climb * height - V * self.V_dot * kinetic)
        more = error * x.integral / (V * g) * dt  # _calcPitchControlUpdate
        more = min(more, 0.0) if self.angle >= upper else more
        self.integral += max(more, 0.0) if self.angle <= lower else more
        angle = (error * x.damp + x.ahead * asked) / (V * g)  # _calcPitchControlOutput
        return self.slewed(angle + self.integral, lower, upper)

    def _filter(self, m: Motion) -> None:
        """Airspeed and its rate: the steady Kalman filter of TECSAirspeedFilter::update."""
        x, dt = self.x, self.dt
        speed, rate = 1.0 / x.speed_std, x.drift_std / x.rate_std**2
        both, root = speed + rate, math.sqrt(x.drift_std * (2.0 * speed + rate))
        off, rate_off = m.V_a - self.V - dt * self.V_dot, m.V_dot - self.V_dot
        change = self.V_dot + (speed * root * off + rate * rate_off) / both
        self.V = max(self.V + dt * change, 1.0)
        self.V_dot += dt * (speed**2 * x.drift_std * off + rate * root * rate_off) / both

    def _smooth(self, h: float) -> None:
        """Move the reference of the height: TECSReferenceModel::update without its jerk limit."""
        x, off = self.x, h - self.h
        rate = min(math.sqrt(2.0 * x.acceleration * abs(off)), abs(off) / self.dt)
        rate = math.copysign(rate, off)
        rate = limited(rate, -min(x.sink_asked, x.sink), min(x.climb_asked, x.climb))
        step = x.acceleration * self.dt
        self.h_dot = limited(rate, self.h_dot - step, self.h_dot + step)
        self.h += self.h_dot * self.dt


class TecsOfArduPilot(Tecs):
    """The balance of ArduPilot's TECS."""

    # The throttle of its other half does not limit the height that is asked for: the aircraft's own
    # autothrottle holds the airspeed.
    def start(self, m: Motion, V_sp: float) -> None:
        """Begin in steady flight."""
        super().start(m, V_sp)
        self.accelerations: deque[float] = deque(maxlen=AVERAGED)
        self.drift = self.of_speed = 0.0
        self.h_before = self.h_asked = self.h_slow = m.h
        # Angle without limits, and the sign of the limit that the rate of energy met
        self.unlimited, self.clipped = self.angle, 0.0
        self.climb_share = self.sink_share = 1.0

    def climb_angle(self, m: Motion, track: Track, lower: float, upper: float) -> float:
        """The pitch over its trim (rad), within limits: [A] _update_pitch."""
        x, dt, g, late = self.x, self.dt, self.g, self.x.height_tc
        V_dot, part = self._filter(m), dt / (dt + late)
        rate, V = self._demand(m, track, lower, upper), self.V
        height, kinetic = self.shares
        fast = 0.5 * (V * V - self.V_sp**2) * kinetic  # _SKE_est - _SKE_dem
        wanted = rate * g * height + ((self.h_slow - m.h) * g * height + fast) / late
        asked = limited(wanted, -x.sink * g, x.climb * g)
        self.clipped = wanted - asked
        error = asked - (m.climb * g * height - V * (V_dot - self.V_dot) * kinetic)
        total, scale = asked + error * x.damp, V * g
        ends = [scale * end - total for end in (lower - SMALL_ANGLE, upper + SMALL_ANGLE)]
        most = LARGEST_SHARE * (ends[1] - ends[0])
        more = limited(error * x.integral * dt, -most, most)
        free = (total + self.integral + more + self.of_speed) / scale
        if (free > upper and more > 0.0) or (free < lower and more < 0.0):
            self.integral *= 1.0 - part
            self.of_speed *= 1.0 - part
        else:
            self.integral += more
            self.of_speed += fast * dt / late
        self.integral = limited(self.integral, *ends)
        most = 0.25 * (upper - lower) * scale
        self.of_speed = limited(self.of_speed, -most, most)
        self.unlimited = (total + self.integral + self.of_speed) / scale
        return self.slewed(self.unlimited, lower, upper)

    def _filter(self, m: Motion) -> float:
        """Airspeed and its slow rate by a complementary filter; its rate: [A] _update_speed."""
        dt, omega = self.dt, self.x.speed_omega
        self.accelerations.append(m.V_dot)
        V_dot = sum(self.accelerations) / len(self.accelerations)
        self.V_dot += dt / (dt + self.x.height_tc) * (V_dot - self.V_dot)
        off = m.V_a - self.V
        self.drift += off * omega**2 * dt
        self.V = max(self.V + (self.drift + V_dot + off * omega * TWICE_DAMPING) * dt, 3.0)
        return V_dot

    def _demand(self, m: Motion, track: Track, lower: float, upper: float) -> float:
        """Move the height that is asked for, and return its rate: [A] _update_height_demand."""
        x, dt, high, low = self.x, self.dt, self.unlimited > upper, self.unlimited < lower
        # A commanded rate of climb moves the height.
        h = self.h = self.h + track.slope * m.V_g * dt if track.h is None else track.h
        if (high and h > self.h_before) or (low and h < self.h_before):  # update_pitch_throttle
            h = self.h_before
        step = 0.5 * (h + self.h_before) - self.h_asked
        step = limited(step, -x.sink * self.sink_share * dt, x.climb * self.climb_share * dt)
        self.h_before, self.h_asked = h, self.h_asked + step
        missing, part = self.h_asked - self.h_slow, dt / (dt + x.demand_tc)
        self.h_slow += part * missing
        # The rate that is allowed falls while the pitch cannot follow it.
        if (high or self.clipped > 0.0) and missing > 0.0:
            self.climb_share *= 1.0 - part
        elif (low or self.clipped < 0.0) and missing < 0.0:
            self.sink_share *= 1.0 - part
        else:
            self.climb_share += part * (1.0 - self.climb_share)
            self.sink_share += part * (1.0 - self.sink_share)
        return missing / x.demand_tc


class Guidance:
    """Course and height by the guidance of an autopilot, above the inner loop of the aircraft."""

    # On a route the guidance follows the path itself: its nearest point, tangent and curvature. A
    # reference over time becomes a track through the aircraft with the commanded course and turn.
    # The pitch command of TECS becomes a load factor by the rate ``(wanted - pitch) / time
    # constant``, and the pitch at the start counts as trimmed. The plant controls the throttle.
    def __init__(self, setup: LawSetup, of: "Autopilot") -> None:
        x = SimpleNamespace(**of.roles)
        self.dt, self.g, self.signals = setup.dt, setup.g, {"climb_angle": "rad"}
        self.roll_limit, self.roll_rate = x.roll_limit * DEG, getattr(x, "roll_rate", 0.0) * DEG
        self.pitch_tc, self.lower, self.upper = x.pitch_tc, x.pitch_min * DEG, x.pitch_max * DEG
        self.ardupilot = of.period == "NAVL1_PERIOD"
        if self.ardupilot:  # [A] update_pitch_throttle: limits of TECS if they are set
            low, high = x.tecs_pitch_min * DEG, x.tecs_pitch_max * DEG
            self.lower = max(low, self.lower) if low < 0.0 else self.lower
            self.upper = min(high, self.upper) if high else self.upper
            x.ahead = 1.0
        self.course = (Npfg if of.period == "NPFG_PERIOD" else L1)(x, setup.dt)
        self.height = (TecsOfArduPilot if self.ardupilot else TecsOfPx4)(x, setup.dt, setup.g)

    def start(self, condition: FlightCondition, /) -> None:
        """Prepare for a flight."""
        self.V_sp, self.phi = condition.V_a, condition.phi
        self.trim: float | None = None

    def step(self, m: Measured, r: ReferenceSample, _t: float, /) -> tuple[float, float, float]:
        """Roll and load factor, and TECS's command of the climb angle (rad)."""
        motion = self._motion(m)
        if r.path is None:
            track = Track(r.chi, 0.0, None, r.chi_dot / max(motion.V_g, 1.0), math.tan(r.gamma))
        else:
            course, right, below, curvature, slope = r.path
            track = Track(course, right, m.h + below, curvature, slope)
        if self.trim is None:
            self.height.start(motion, self.V_sp)
            self.trim = motion.theta - self.height.angle
        tangent = self.course.acceleration(motion, track, self.V_sp) / self.g
        if self.ardupilot:
            tangent /= math.cos(limited(motion.theta, -STEEPEST_PITCH, STEEPEST_PITCH))
        phi = limited(math.atan(tangent), -self.roll_limit, self.roll_limit)
        if step := self.roll_rate * self.dt:
            phi = limited(phi, self.phi - step, self.phi + step)
        self.phi = phi
        limits = self.lower - self.trim, self.upper - self.trim
        angle = self.height.climb_angle(motion, track, *limits)
        rate = (angle + self.trim - motion.theta) / self.pitch_tc
        lift = math.cos(m.gamma) + m.V_a * rate / self.g
        return phi, lift / math.cos(limited(m.phi, -STEEPEST, STEEPEST)), angle

    def _motion(self, m: Measured) -> Motion:
        """The motion that the estimator of an autopilot knows."""
        if m.V_g is None or m.velocity is None or m.acceleration is None:
            raise InputError("`velocity`, `V_g` and `acceleration` must be measured, got none.")
        north, east, down = m.velocity
        wind = (0.0, 0.0, 0.0) if m.wind is None else m.wind
        level, steady = (north - wind[0], east - wind[1]), (wind[0], wind[1])
        theta = m.gamma if m.theta is None else m.theta
        return Motion(m.chi, m.V_g, level, steady, m.V_a, m.acceleration, -down, m.h, theta)

    def way_back(self, V_g: float) -> float:
        """Share of the roll that the way back to a straight track needs, at V_g over ground, m/s.

        NPFG alone states this way; L1 flies to it at half a right angle at most, and needs less.
        """
        if not isinstance(self.course, Npfg):
            return 0.0
        return self.course.way_back(V_g) / (self.g * math.tan(self.roll_limit))

    def linear(self, V_a: float) -> tuple[list[float], list[float], list[float], list[float]]:
        """Gains of the linear loops about a straight level leg in still air, course and path angle.

        With e the error of a channel and ``y' = e``, the distance off the path over the airspeed
        `V_a` (m/s), the commanded rate is ``a e + b y + integral of (c e + d y)``. Returns a (1/s),
        b and c (1/s^2) and d (1/s^3). The slower integral of L1 is neglected.
        """
        x, (course, distance) = self.height.x, self.course.linear(V_a)
        share = self.height.shares[0] / self.pitch_tc
        a = 1.0 / self.pitch_tc + share * x.damp
        b, c = share * (x.ahead + x.damp) / x.height_tc, share * x.integral
        return [course, a], [distance, b], [0.0, c], [0.0, c / x.height_tc]


@cache
def guidance() -> Mapping[str, Mapping[str, Any]]:
    """The guidance of autopilots by the parameter of its period, from ``autopilot.toml``."""
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def period_among(parameters: Mapping[str, Any]) -> str:
    """The period parameter, which selects the guidance; empty if there is none."""
    names = [name for name in guidance() if name in parameters]
    # PX4 1.13 has both guidances and flies L1 unless FW_USE_NPFG is set.
    if "FW_L1_PERIOD" in names and not parameters.get("FW_USE_NPFG"):
        return "FW_L1_PERIOD"
    return names[0] if names else ""


@dataclass(frozen=True, kw_only=True)
class Autopilot(Law):
    """See `Guidance`; the names of the parameters select the autopilot."""

    # By the autopilot's names, including NPFG_PERIOD, FW_L1_PERIOD or NAVL1_PERIOD. Missing
    # parameters have the defaults of ``autopilot.toml``.
    parameters: Mapping[str, Any] = field(default_factory=dict)

    kind: ClassVar[str] = "autopilot"
    keys: ClassVar[frozenset[str]] = frozenset({"parameters"})
    required: ClassVar[tuple[str, ...]] = ("parameters",)
    named_alone: ClassVar[bool] = False
    inputs: ClassVar[tuple[str, str]] = RATES

    @property
    def period(self) -> str:
        """Name of the period parameter; InputError without it."""
        if not (period := period_among(self.parameters)):
            raise InputError(
                f"`parameters` must have one of {', '.join(guidance())}, got "
                f"{', '.join(self.parameters) or 'none'}."
            )
        return period

    @property
    def roles(self) -> dict[str, float]:
        """Every parameter by its role; InputError for an unknown or impossible parameter."""
        table = guidance()[self.period]
        roles = {name: role for name, _, role, *_ in table["parameters"]}
        for name, value in self.parameters.items():
            if name not in roles:
                near = nearest_name(name, roles)
                raise InputError(f"`parameters` must be of {table['law']}, got {name}{near}")
            divides = roles[name].endswith(POSITIVE)
            number = isinstance(value, int | float) and math.isfinite(value)
            if not number or (divides and value <= 0.0):
                wanted = "a positive number" if divides else "a number"
                raise InputError(f"`{name}` must be {wanted}, got {value!r}.")
        return {role: self.parameters.get(name, x) for name, x, role, *_ in table["parameters"]}

    def make(self, setup: LawSetup, /) -> Guidance:
        """Make the controller of a flight."""
        return Guidance(setup, self)

    def names_of(self, gains: Sequence[str]) -> tuple[str, ...]:
        """Name of its only flight, with the first gain set."""
        return super().names_of(gains[:1])

    @property
    def tuned_as(self) -> str:
        """The exact law."""
        return "exact"
