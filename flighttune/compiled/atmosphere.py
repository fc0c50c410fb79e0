# SPDX-License-Identifier: LGPL-2.1-or-later
"""The standard atmosphere of 1976, dry, in JSBSim's units and order of operations."""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

from flighttune.compiled.properties import Properties
from flighttune.compiled.tables import table_of
from flighttune.compiled.trace import Number, call, equal, exp, lookup, power, segment, select, sqrt

FT_TO_M = 0.3048
_KG_TO_SLUG = 0.06852168

# Universal gas constant and molar mass of air; gravity; radius of the Earth of the standard, ft
_R_STAR = 8.31432 * _KG_TO_SLUG / (FT_TO_M * FT_TO_M * 1.8)
_M_AIR = 28.9645 * _KG_TO_SLUG / 1000.0
G_0 = 9.80665 / FT_TO_M
R_DRY = _R_STAR / _M_AIR
_EARTH = 6356766.0 / FT_TO_M

HEAT_RATIO = 1.4

# At sea level: temperature (Rankine), pressure (psf) and density (slug/ft^3)
SEA_LEVEL_T, SEA_LEVEL_P = 518.67, 2116.228
SEA_LEVEL_RHO = SEA_LEVEL_P / (R_DRY * SEA_LEVEL_T)

# Geopotential height (ft) and temperature (Rankine) at the borders of its layers
_LAYERS = (
    *((0.0, 518.67), (36089.2388, 389.97), (65616.7979, 389.97), (104986.8766, 411.57)),
    *((154199.4751, 487.17), (167322.8346, 487.17), (232939.6325, 386.37)),
    *((278385.8268, 336.5028), (298556.4304, 336.5028)),
)
_HEIGHTS, _TEMPERATURES = zip(*_LAYERS, strict=True)
_TEMPERATURE = table_of(_LAYERS)
_LAPSE_RATES = tuple((t_1 - t_0) / (h_1 - h_0) for (h_0, t_0), (h_1, t_1) in pairwise(_LAYERS))

# Exponent of pressure in each layer, 1 where temperature is constant.
_EXPONENTS = tuple(G_0 / (R_DRY * rate) if rate else 1.0 for rate in _LAPSE_RATES)

# Pressures (psf) at the borders of the layers, by the pressure at sea level and the bias of
# temperature of a flight
PRESSURES = tuple(f"_pressure-{k}" for k in range(len(_LAPSE_RATES)))


def _geopotential(h: Number) -> Number:
    return (h * _EARTH) / (_EARTH + h)


def _geometric(h: Number) -> Number:
    return (h * _EARTH) / (_EARTH - h)


# Temperatures at the borders of the layers, as they come out behind two conversions of heights.
_BORDERS = tuple(float(_TEMPERATURE.at(_geopotential(_geometric(h)))) for h in _HEIGHTS[:-1])


def pressures(sea_level: float, bias: float) -> dict[str, float]:
    """Pressures at the borders of the layers."""
    found = [sea_level]
    for (h_0, T), (h_1, _), rate in zip(_LAYERS[:-2], _LAYERS[1:-1], _LAPSE_RATES, strict=False):
        found.append(_pressure(found[-1], T + bias, rate, h_1 - h_0))
    return dict(zip(PRESSURES, found, strict=True))


def _pressure(base: float, T: float, rate: float, dh: float) -> float:
    """Pressure a height above the border of a layer, from that and the temperature there."""
    if rate:
        return base * math.pow(T / (T + rate * dh), G_0 / (R_DRY * rate))
    return base * math.exp(-G_0 * dh / (R_DRY * T))


def _pressure_at(now: Properties, geopotential: Number, bias: Number) -> Number:
    """The same, in the layer of a height."""
    layer = segment(_HEIGHTS, geopotential, at_or_below=True)
    T, rate = lookup(_BORDERS, layer) + bias, lookup(_LAPSE_RATES, layer)
    dh = geopotential - lookup(_HEIGHTS, layer)
    base = now[PRESSURES[0]]
    for height, name in zip(_HEIGHTS[1:-1], PRESSURES[1:], strict=True):
        base = select(geopotential < height, base, now[name])
    falling = base * power(T / (T + rate * dh), lookup(_EXPONENTS, layer))
    return select(equal(rate, 0.0), base * exp(-G_0 * dh / (R_DRY * T)), falling)


def atmosphere(now: Properties) -> None:
    """Temperature, pressure, density and what follows from them at the height of the step."""
    geopotential = _geopotential(now["position/h-sl-ft"])
    bias, p, rho_0 = (now[f"atmosphere/{x}"] for x in ("delta-T", "P-sl-psf", "rho-sl-slugs_ft3"))
    below = _LAYERS[0][1] + geopotential * _LAPSE_RATES[0]
    T = select(geopotential >= 0.0, _TEMPERATURE.at(geopotential), below) + bias
    P = _pressure_at(now, geopotential, bias)
    rho = P / (R_DRY * T)
    now["atmosphere/T-R"], now["atmosphere/P-psf"] = T, P
    now["atmosphere/rho-slugs_ft3"] = rho
    now["atmosphere/a-fps"] = sqrt(HEAT_RATIO * R_DRY * T)
    now.viscosity = 2.269690e-08 * power(T, 1.5) / (198.72 + T) / rho
    now["atmosphere/sigma"], now["atmosphere/delta"] = rho / rho_0, P / p
    standard = tuple(pressures(SEA_LEVEL_P, 0.0).values())
    densities = [x / (R_DRY * T) for x, T in zip(standard, _TEMPERATURES, strict=False)]
    for name, x, of_layers, exponent in (
        ("density", rho, densities, lambda rate: -1.0 / (1.0 + G_0 / (R_DRY * rate))),
        ("pressure", P, standard, lambda rate: -R_DRY * rate / G_0),
    ):
        now[f"atmosphere/{name}-altitude"] = _height_of(x, of_layers, exponent)


def _height_of(x: Number, of_layers: Sequence[float], exponent: Callable[[float], float]) -> Number:
    """Height of the standard atmosphere with a density or pressure."""
    # Both fall with height: the layer is found by their negatives.
    layer = segment((*(-value for value in of_layers), math.inf), -x)
    base, T = lookup(of_layers, layer), lookup(_TEMPERATURES, layer)
    rate, h = lookup(_LAPSE_RATES, layer), lookup(_HEIGHTS, layer)
    exponents = [exponent(rate) if rate else 1.0 for rate in _LAPSE_RATES]
    divisor = select(equal(rate, 0.0), 1.0, rate)
    falling = h + (T / divisor) * (power(x / base, lookup(exponents, layer)) - 1)
    constant = h + (-R_DRY * T / G_0) * call("log", x / base)
    return _geometric(select(equal(rate, 0.0), constant, falling))


def stagnation_pressure(mach: Number, P: Number) -> Number:
    """Pressure where the air is brought to rest, behind a shock above Mach 1, psf."""
    a, b, d = (HEAT_RATIO - 1.0) / 2.0, HEAT_RATIO / (HEAT_RATIO - 1.0), 1.0 / (HEAT_RATIO - 1.0)
    c = 2.0 * b
    behind = math.pow(0.5 * (HEAT_RATIO + 1.0), b)
    behind *= math.pow((HEAT_RATIO + 1.0) / (HEAT_RATIO - 1.0), d)
    subsonic = P * power(1.0 + a * mach * mach, b)
    supersonic = P * behind * power(mach, c) / power(c * mach * mach - 1.0, d)
    return select(mach < 1.0, subsonic, supersonic)
