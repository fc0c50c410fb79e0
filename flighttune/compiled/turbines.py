# SPDX-License-Identifier: LGPL-2.1-or-later
"""Jet engines: FGTurbine while it runs, or while it stands still."""

from flighttune.compiled.engine_files import EngineFile, factor_of, functions_of, text_of, value_of
from flighttune.compiled.functions import number
from flighttune.compiled.properties import Properties
from flighttune.compiled.trace import Number, Truth, different, least, select

# Functions that JSBSim knows by these names.
_KNOWN = ("IdleThrust", "MilThrust", "AugThrust", "Injection")

# Spools, with their shares of the time that engines without functions of their own take.
_SPOOLS = {"N2SpoolUp": 1.0, "N2SpoolDown": 3.0, "N1SpoolUp": 1.0, "N1SpoolDown": 2.4}

_NUMBERS = {
    "idlen1": 30.0,
    "idlen2": 60.0,
    "maxn1": 100.0,
    "maxn2": 100.0,
    **dict.fromkeys(("n1spindown", "n2spindown"), 2.0),
    **dict.fromkeys(("bypassratio", "bleed", "augmented", "augmethod", "injected"), 0.0),
}

# Lever and speed (%) from which an afterburner without a lever of its own burns.
_LIT, _FAST = 0.99, 97.0


def seek(value: Number, target: Number, up: Number, down: Number, dt: Number) -> Number:
    """A value on its way to a target, at most so fast up and down."""
    lower, higher = value - dt * down, value + dt * up
    rising = select(value < target, select(higher > target, target, higher), value)
    return select(value > target, select(lower < target, target, lower), rising)


def turbine(now: Properties, engine: EngineFile) -> Number:
    """Thrust, lbf; one that does not run only windmills."""
    x = {name: value_of(engine.motor, name, default) for name, default in _NUMBERS.items()}
    value = functions_of(now, engine, (*_KNOWN, *_SPOOLS))
    norm, sigma = now[f"_n2-norm{engine.number}"], now["atmosphere/sigma"]
    for name, share in _SPOOLS.items():
        value.setdefault(name, _spool_rate(norm, sigma, share * 90.0 / (x["bypassratio"] + 3.0)))
    runs = different(now[f"{engine.at}/set-running"], 0.0)
    throttle = now[engine.throttle]
    lever = select(throttle > 1.0, throttle - (throttle - 1.0), throttle)
    if now.trimming:
        # Its shafts turn as fast as the lever says, but what is shown of them stays.
        now[f"_first{engine.number}"] = 1.0
        n_2 = x["idlen2"] + lever * (x["maxn2"] - x["idlen2"])
        return _thrust(now, engine, x, value, throttle, lever, n_2)
    _spool(now, engine, x, value, lever, runs)
    thrust = _thrust(now, engine, x, value, throttle, lever, now[f"{engine.at}/n2"])
    return select(runs, thrust, 0.0)


def _spool(
    now: Properties,
    engine: EngineFile,
    x: dict[str, float],
    value: dict[str, Number],
    lever: Number,
    runs: Truth,
) -> None:
    """Move the speeds of both shafts on."""
    # The first step of a flight leaves the phase of the trim.
    first = different(now[f"_first{engine.number}"], 0.0)
    now[f"_first{engine.number}"] = 0.0
    qbar = now["aero/qbar-psf"]
    for k, share in ((2, 15.0), (1, 10.0)):
        name = f"{engine.at}/n{k}"
        target = x[f"idlen{k}"] + lever * (x[f"maxn{k}"] - x[f"idlen{k}"])
        speed = select(first, target, now[name])
        running = seek(speed, target, value[f"N{k}SpoolUp"], value[f"N{k}SpoolDown"], now.elapsed)
        n = now[name]
        turned = seek(n, qbar / share, n / 2.0 + 0.1, n / x[f"n{k}spindown"], now.elapsed)
        now[name] = select(runs, running, turned)
    n_2 = now[f"{engine.at}/n2"]
    norm = f"_n2-norm{engine.number}"
    now[norm] = select(runs, (n_2 - x["idlen2"]) / (x["maxn2"] - x["idlen2"]), now[norm])


def _thrust(
    now: Properties,
    engine: EngineFile,
    x: dict[str, float],
    value: dict[str, Number],
    throttle: Number,
    lever: Number,
    n_2: Number,
) -> Number:
    motor = engine.motor
    dry = number(now, text_of(motor, "milthrust", 10000.0)) * factor_of(motor, "milthrust", "LBS")
    full = number(now, text_of(motor, "maxthrust", 10000.0)) * factor_of(motor, "maxthrust", "LBS")
    norm = (n_2 - x["idlen2"]) / (x["maxn2"] - x["idlen2"])
    idle = dry * value["IdleThrust"]
    thrust = idle + (((dry - idle) * value["MilThrust"]) * norm * norm)
    bled = thrust * (1.0 - x["bleed"])
    if x["augmethod"] not in (1, 2) or (x["augmethod"] == 1 and x["augmented"] != 1):
        return bled  # nothing lights it
    burns = f"_augmented{engine.number}"
    before = bled if now.trimming else select(different(now[burns], 0.0), thrust, bled)
    if x["augmethod"] == 1:
        lit = (lever > _LIT) & (n_2 > _FAST)
        burning = value["AugThrust"] * full
    else:
        augmentation = select(throttle > 1.0, throttle - 1.0, 0.0)
        lit = augmentation > 0.0
        burning = before + (full * value["AugThrust"] - before) * least(augmentation, 1.0)
    if not (now.trimming and x["augmethod"] == 2):
        now[burns] = select(lit, 1.0, 0.0)
    return select(lit, burning, before)


def _spool_rate(norm: Number, sigma: Number, delay: float) -> Number:
    n = least(1.0, norm + 0.1)
    return delay / (1.0 + 3.0 * (1.0 - n) * (1.0 - n) * (1.0 - n) + (1.0 - sigma))
