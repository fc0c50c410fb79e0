# SPDX-License-Identifier: LGPL-2.1-or-later
"""The wind of a step with a gust, and JSBSim's Dryden turbulence by its two kinds of filters."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from flighttune.base.gusts import BodyAxis, GustNumbers
from flighttune.compiled.properties import VELOCITY, Properties, named
from flighttune.compiled.tables import Table2
from flighttune.compiled.trace import (
    Number,
    cos,
    different,
    equal,
    negated,
    power,
    select,
    sqrt,
    tan,
)
from flighttune.compiled.vectors import ZERO, Vector, add, inverse, magnitude, sub, times

WIND = [f"atmosphere/wind-{axis}-fps" for axis in ("north", "east", "down")]
GUST = [f"atmosphere/gust-{axis}-fps" for axis in ("north", "east", "down")]
TOTAL_WIND = [f"atmosphere/total-wind-{axis}-fps" for axis in ("north", "east", "down")]

# A 1-cosine gust: its `GustNumbers`; steps flown, whether it blows and for how long so far (s);
# its direction to north, east and down, and the gust itself.
GUST_OF = {name: f"_gust-of-{name}" for name in GustNumbers._fields}
GUST_COUNT, GUST_BLOWS, GUST_TIME = named("_gust-{}", ("count", "on", "t"))
GUST_DIRECTION, COSINE_GUST = named("_gust-direction-{}"), named("_gust-{}")

# The four normal numbers of a step
NOISE = named("_noise-{}", "uvwp")
SEVERITY = "atmosphere/turbulence/milspec/severity"
WIND_20FT = "atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"

# Height (ft) and severity (from 1 on) of MIL-F-8785C, Fig. 7, with the intensity, ft/s
_HEIGHTS = (
    *(500.0, 1750.0, 3750.0, 7500.0, 15000.0, 25000.0, 35000.0, 45000.0),
    *(55000.0, 65000.0, 75000.0, 80000.0),
)
_INTENSITIES = (
    (3.2, 2.2, 1.5, 0, 0, 0, 0, 0, 0, 0, 0, 0),
    (4.2, 3.6, 3.3, 1.6, 0, 0, 0, 0, 0, 0, 0, 0),
    (6.6, 6.9, 7.4, 6.7, 4.6, 2.7, 0.4, 0, 0, 0, 0, 0),
    (8.6, 9.6, 10.6, 10.1, 8.0, 6.6, 5.0, 4.2, 2.7, 0, 0, 0),
    (11.8, 13.0, 16.0, 15.1, 11.6, 9.7, 8.1, 8.2, 7.9, 4.9, 3.2, 2.1),
    (15.6, 17.6, 23.0, 23.6, 22.1, 20.0, 16.0, 15.1, 12.1, 7.9, 6.2, 5.1),
    (18.7, 21.5, 28.4, 30.2, 30.7, 31.0, 25.2, 23.1, 17.5, 10.7, 8.4, 7.2),
)
_INTENSITY = Table2(
    tuple(float(row) for row in range(1, 8)),
    _HEIGHTS,
    tuple(float(x) for row in _INTENSITIES for x in row),
)

_MEMORY = (
    *("xi-u1", "xi-v1", "xi-v2", "xi-w1", "xi-w2", "xi-p1", "xi-q1", "xi-r1"),
    *("nu-u1", "nu-v1", "nu-v2", "nu-w1", "nu-w2", "nu-p1"),
)
# Filters and gust at rest
AT_REST = dict.fromkeys(
    (
        *(f"_{name}" for name in _MEMORY),
        *(GUST_COUNT, GUST_BLOWS, GUST_TIME, *GUST_DIRECTION, *COSINE_GUST),
    ),
    0.0,
)


def gust_numbers(gust: GustNumbers) -> dict[str, float]:
    """Numbers of a gust by their places in a step."""
    return {GUST_OF[name]: value for name, value in gust._asdict().items()}


def total_wind(now: Properties, model: Literal["", "milspec", "tustin"], *, gust: bool) -> None:
    """Wind, gusts and turbulence together, north, east and down."""
    # The turbulence sees the gust of the previous step.
    turbulence = _turbulence(now, model, gust=gust) if model else ZERO
    if gust:
        _cosine_gust(now)
    now.put(TOTAL_WIND, add(_steady(now, gust=gust), turbulence))


def _steady(now: Properties, *, gust: bool) -> Vector:
    wind = add(now.vector(WIND), now.vector(GUST))
    return add(wind, now.vector(COSINE_GUST)) if gust else wind


def _cosine_gust(now: Properties) -> None:
    count, t = now[GUST_COUNT] + 1.0, now[GUST_TIME]
    of = {name: now[place] for name, place in GUST_OF.items()}
    rise, hold, fall = of["rise"], of["hold"], of["fall"]
    blows = different(now[GUST_BLOWS], 0.0) | equal(count, of["first"])
    up = (1.0 - cos(math.pi * t / rise)) / 2.0
    down = (1 - cos(math.pi * (1 - (t - (rise + hold)) / fall))) / 2.0
    factor = select(t <= rise + hold + fall, down, 0.0)
    factor = select(t <= rise, up, select(t <= rise + hold, 1.0, factor))
    # The direction is fixed to the Earth when the gust begins.
    old = now.vector(GUST_DIRECTION)
    begins = equal(magnitude(old), 0.0)
    turned = times(inverse(now.local_to_body), [of[axis] for axis in get_args(BodyAxis)])
    direction = [select(begins, a, b) for a, b in zip(turned, old, strict=True)]
    gust = [factor * x * of["size"] for x in direction]
    over = t + now.dt > rise + hold + fall
    now[GUST_COUNT] = count
    now[GUST_BLOWS] = select(blows & negated(over), 1.0, 0.0)
    now[GUST_TIME] = select(blows, select(over, 0.0, t + now.dt), t)
    for names, values in ((GUST_DIRECTION, direction), (COSINE_GUST, gust)):
        for name, value in zip(names, values, strict=True):
            now[name] = select(blows, select(over, 0.0, value), now[name])


@dataclass(frozen=True)
class _Scales:
    """Time constants (s) and intensities of the turbulence at a height and airspeed."""

    L_u: Number
    L_w: Number
    sigma_u: Number
    sigma_w: Number
    sigma_p: Number
    tau_u: Number
    tau_w: Number
    tau_p: Number
    V: Number
    span: Number


def _scales(now: Properties, *, gust: bool) -> _Scales:
    air = sub(now.vector(VELOCITY), times(now.local_to_body, _steady(now, gust=gust)))
    V, h, span = magnitude(air), now["position/h-sl-ft"], now["metrics/bw-ft"]
    w_20 = now[WIND_20FT]
    h = select(h <= 10.0, 10.0, h)
    high = _INTENSITY.at(now[SEVERITY], h)
    low, middle = h <= 1000.0, h <= 2000.0
    length = 1000.0 + (h - 1000.0) / 1000.0 * 750.0
    strength = 0.1 * w_20 + (h - 1000.0) / 1000.0 * (high - 0.1 * w_20)
    upper_length = select(middle, length, 1750.0)
    upper = select(middle, strength, high)
    L_u = select(low, h / power(0.177 + 0.000823 * h, 1.2), upper_length)
    L_w = select(low, h, upper_length)
    sigma_w = select(low, 0.1 * w_20, upper)
    sigma_u = select(low, 0.1 * w_20 / power(0.177 + 0.000823 * h, 0.4), upper)
    sigma_p, L_p = 1.9 / sqrt(L_w * span) * sigma_w, sqrt(L_w * span) / 2.6
    return _Scales(L_u, L_w, sigma_u, sigma_w, sigma_p, L_u / V, L_w / V, L_p / V, V, span)


def _turbulence(now: Properties, model: str, *, gust: bool) -> Vector:
    """Velocity of the turbulent air; its angular rates go to `turbulent_rates`."""
    scales = _scales(now, gust=gust)
    noise = dict(zip("uvwp", now.vector(NOISE), strict=True))
    old = {name: now[f"_{name}"] for name in _MEMORY}
    filters = _tustin if model == "tustin" else _milspec
    xi = filters(scales, now.dt, noise, old)
    # The heading of the wind is zero: the axes are north and east.
    now.turbulent_rates = times(now.local_to_body, [xi["p"], xi["q"], xi["r"]])
    new = {f"xi-{axis}1": value for axis, value in xi.items()}
    new |= {f"nu-{axis}1": value for axis, value in noise.items()}
    new |= {f"{x}2": old[f"{x}1"] for x in ("xi-v", "xi-w", "nu-v", "nu-w")}
    for name, value in new.items():
        now[f"_{name}"] = value
    return [xi["u"], xi["v"], xi["w"]]


def _tustin(
    scales: _Scales, dt: float, noise: dict[str, Number], old: dict[str, Number]
) -> dict[str, Number]:
    """Filters of the standard, discretised by Tustin's rule."""
    V, span = scales.V, scales.span
    omega_w, omega_v = V / scales.L_w, V / scales.L_u

    def bilinear(tau: Number) -> Number:
        return 1 / tau / tan(dt / 2.0 / tau)

    C = bilinear(scales.tau_u)

    def first(C: Number, tau: Number, sigma: Number, axis: str) -> Number:
        return -(1 - C * tau) / (1 + C * tau) * old[f"xi-{axis}1"] + sigma * sqrt(2 * tau / dt) / (
            1 + C * tau
        ) * (noise[axis] + old[f"nu-{axis}1"])

    def second(omega: Number, sigma: Number, axis: str) -> Number:
        root, all_ = math.sqrt(3.0), (omega + C) * (omega + C)
        memory = -2.0 * (omega * omega - C * C) / all_ * old[f"xi-{axis}1"]
        memory = memory - (omega - C) * (omega - C) / all_ * old[f"xi-{axis}2"]
        new = (C + omega / root) * noise[axis] + 2 / root * omega * old[f"nu-{axis}1"]
        new = new + (omega / root - C) * old[f"nu-{axis}2"]
        return memory + sigma * sqrt(3.0 * omega / dt) / all_ * new

    def rate(width: float, axis: str, change: Number) -> Number:
        C_rate = bilinear(width * span / math.pi / V)
        k = width * span * C_rate / math.pi / V
        return -(1 - k) / (1 + k) * old[f"xi-{axis}1"] + C_rate / V / (1 + k) * change

    u, v = first(C, scales.tau_u, scales.sigma_u, "u"), second(omega_v, scales.sigma_u, "v")
    w = second(omega_w, scales.sigma_w, "w")
    p = first(bilinear(scales.tau_p), scales.tau_p, scales.sigma_p, "p")
    q, r = rate(4.0, "q", w - old["xi-w1"]), rate(3.0, "r", v - old["xi-v1"])
    return {"u": u, "v": v, "w": w, "p": p, "q": q, "r": r}


def _milspec(
    scales: _Scales, dt: float, noise: dict[str, Number], old: dict[str, Number]
) -> dict[str, Number]:
    """First-order filters."""
    span = scales.span
    tau_q, tau_r = 4.0 * span / math.pi / scales.V, 3.0 * span / math.pi / scales.V

    def lagged(tau: Number, sigma: Number, axis: str, order: float) -> Number:
        kept = 1 - dt / tau if order == 1.0 else 1 - order * dt / tau
        return kept * old[f"xi-{axis}1"] + sigma * sqrt(2.0 * order * dt / tau) * noise[axis]

    u = lagged(scales.tau_u, scales.sigma_u, "u", 1.0)
    v = lagged(scales.tau_u, scales.sigma_u, "v", 2.0)
    w = lagged(scales.tau_w, scales.sigma_w, "w", 2.0)
    p = lagged(scales.tau_p, scales.sigma_p, "p", 1.0)
    q = (1 - dt / tau_q) * old["xi-q1"] + math.pi / 4 / span * (w - old["xi-w1"])
    r = (1 - dt / tau_r) * old["xi-r1"] + math.pi / 3 / span * (v - old["xi-v1"])
    return {"u": u, "v": v, "w": w, "p": p, "q": q, "r": r}
