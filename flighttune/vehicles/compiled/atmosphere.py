# SPDX-License-Identifier: LGPL-2.1-or-later
"""The standard atmosphere of 1976, dry, in JSBSim's units and order of operations."""

import math
from itertools import pairwise

from flighttune.vehicles.compiled.properties import Properties
from flighttune.vehicles.compiled.tables import table_of
from flighttune.vehicles.compiled.trace import Number, exp, power, select, sqrt

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
_TEMPERATURE = table_of(_LAYERS)
_LAPSE_RATES = tuple((t_1 - t_0) / (h_1 - h_0) for (h_0, t_0), (h_1, t_1) in pairwise(_LAYERS))


def _pressure(base: Number, T: Number, rate: float, dh: Number) -> Number:
    """Pressure a height above the border of a layer, from that and the temperature there."""
    if rate:
        return base * power(T / (T + rate * dh), G_0 / (R_DRY * rate))
    return base * exp(-G_0 * dh / (R_DRY * T))


def atmosphere(now: Properties) -> None:
    """Temperature, pressure, density and what follows from them at the height of the step."""
    h = now["position/h-sl-ft"]
    geopotential = (h * _EARTH) / (_EARTH + h)
    bias, p, rho_0 = (now[f"atmosphere/{x}"] for x in ("delta-T", "P-sl-psf", "rho-sl-slugs_ft3"))
    below = _LAYERS[0][1] + geopotential * _LAPSE_RATES[0]
    T = select(geopotential >= 0.0, _TEMPERATURE.at(geopotential), below) + bias
    base_h, base_T = _LAYERS[0]
    P = _pressure(p, base_T + bias, _LAPSE_RATES[0], geopotential - base_h)
    rho = P / (R_DRY * T)
    now["atmosphere/T-R"], now["atmosphere/P-psf"] = T, P
    now["atmosphere/rho-slugs_ft3"] = rho
    now["atmosphere/a-fps"] = sqrt(HEAT_RATIO * R_DRY * T)
    now.viscosity = 2.269690e-08 * power(T, 1.5) / (198.72 + T) / rho
    now["atmosphere/sigma"], now["atmosphere/delta"] = rho / rho_0, P / p
    _equivalent_heights(now, P, rho)


def _equivalent_heights(now: Properties, P: Number, rho: Number) -> None:
    """Heights of the standard atmosphere with this density, and with this pressure."""
    (base, T), rate = _LAYERS[0], _LAPSE_RATES[0]
    exponent = -1.0 / (1.0 + G_0 / (R_DRY * rate))
    by_density = base + (T / rate) * (power(rho / SEA_LEVEL_RHO, exponent) - 1.0)
    by_pressure = base + (T / rate) * (power(P / SEA_LEVEL_P, -R_DRY * rate / G_0) - 1.0)
    for name, h in (("density", by_density), ("pressure", by_pressure)):
        now[f"atmosphere/{name}-altitude"] = (h * _EARTH) / (_EARTH - h)


def stagnation_pressure(mach: Number, P: Number) -> Number:
    """Pressure where the air is brought to rest, behind a shock above Mach 1, psf."""
    a, b, d = (HEAT_RATIO - 1.0) / 2.0, HEAT_RATIO / (HEAT_RATIO - 1.0), 1.0 / (HEAT_RATIO - 1.0)
    c = 2.0 * b
    behind = math.pow(0.5 * (HEAT_RATIO + 1.0), b)
    behind *= math.pow((HEAT_RATIO + 1.0) / (HEAT_RATIO - 1.0), d)
    subsonic = P * power(1.0 + a * mach * mach, b)
    supersonic = P * behind * power(mach, c) / power(c * mach * mach - 1.0, d)
    return select(mach < 1.0, subsonic, supersonic)
