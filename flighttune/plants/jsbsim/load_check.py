"""Check of an aircraft before its first flight: engines push, surfaces move what they should."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import chain

from flighttune.aircraft.aircraft import AircraftConfig
from flighttune.errors import PlantError
from flighttune.plants.jsbsim.bench import AirframeState, Bench
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.plants.jsbsim.model_files import Unchanged
from flighttune.units import DEG

# Acceleration that a surface is for, and the sign of it by a positive position.
EFFECTS = {"aileron": ("p_dot", 1.0), "elevator": ("q_dot", -1.0), "rudder": ("r_dot", -1.0)}

# Properties in which a model may show the position of a surface.
POSITIONS = {
    "aileron": ("fcs/left-aileron-pos-rad", "fcs/right-aileron-pos-rad", "fcs/aileron-pos-rad"),
    "elevator": ("fcs/elevator-pos-rad",),
    "rudder": ("fcs/rudder-pos-rad",),
}

# Share by which the travel of a model may differ from its file.
TRAVEL_TOLERANCE = 0.02

# Share of the effect of half the travel that the other half must have at least.
MIN_SECOND_HALF = 0.1

# Position (rad) and acceleration (rad/s^2) that count as none.
NEGLIGIBLE = 1e-6

# Flight in which an aircraft is checked: angle of attack, height and throttle.
ALPHA, HEIGHT, FULL = 3.0 * DEG, 1000.0, 0.95


def check_moves(config: AircraftConfig) -> None:
    """Refuse an aircraft that does not do what its file says.

    A check that passed or failed is remembered in this process while the files stay the same.

    The gains of `config` must have been made for its files as they are. Raises PlantError if an
    engine does not run or push, a surface does not move what it should or has no effect over the
    last half of its travel, or its travel differs from the file.
    """
    nominal = config.with_off_nominal(None)
    fault = _fault(Unchanged(nominal, config.gains.made_for if config.gains else None))
    if fault:
        raise PlantError(f"{config.file}: {fault}.")


@lru_cache(maxsize=256)
def _fault(checked: Unchanged) -> str:
    config = checked.config
    fdm = Fdm(config)
    low, high = config.envelope.V_a
    V_a = config.design.V_a if config.design else 0.5 * (low + high)
    bench = Bench(fdm, config.design.h if config.design else HEIGHT)
    throttle = FULL * config.engines.throttle[1]
    level = AirframeState(V_a=V_a, alpha=ALPHA, theta=ALPHA, throttle=throttle)
    faults = chain(_engine_faults(fdm, bench, level), surface_faults(bench, level))
    return next(faults, "")


def _engine_faults(fdm: Fdm, bench: Bench, level: AirframeState) -> Iterator[str]:
    count = fdm.config.engines.count
    # Without any it glides, whatever the model has.
    if count and fdm.has(f"propulsion/engine[{count}]/set-running"):
        yield f"[engines] `count` must be that of the model, which has more, got {count}"
    bench.accelerations(level)
    for i, thrust in enumerate(fdm.thrusts):
        if not thrust() > 0.0:
            runs = fdm.reader(f"propulsion/engine[{i}]/set-running")()
            how = "runs and does not" if runs else "does not start"
            yield f"[engines] engine {i + 1} of {count} must push at full throttle, it {how}"


def surface_faults(bench: Bench, level: AirframeState) -> Iterator[str]:
    """Sentences about surfaces that do not do what the file of the aircraft says."""
    fdm = bench.fdm
    for name, surface in fdm.config.surfaces.named():
        rate, sign = EFFECTS[name]
        readers = [fdm.reader(position) for position in POSITIONS[name] if fdm.has(position)]
        neutral = bench.accelerations(level)[rate]
        before = [read() for read in readers]
        for stop in surface.travel:
            halfway = bench.accelerations(replace(level, **{name: 0.5 * stop}))[rate] - neutral
            whole = bench.accelerations(replace(level, **{name: stop}))[rate] - neutral
            moved = max(
                (abs(read() - was) for read, was in zip(readers, before, strict=True)), default=0
            )
            if not math.isfinite(whole):
                return  # forces that are not finite are reported by the trim
            key = f"[surfaces] `{name}`"
            if not sign * stop * whole > NEGLIGIBLE * abs(stop):
                yield (
                    f"{key} must {'raise' if sign * stop > 0.0 else 'lower'} {rate} at "
                    f"{stop / DEG:.3g} deg, got {whole:.2g} rad/s2"
                )
            # A model that limits its surface below `travel_deg` shows no more effect from there on.
            if abs(whole) < (1.0 + MIN_SECOND_HALF) * abs(halfway):
                yield (
                    f"{key} must have an effect up to {stop / DEG:.3g} deg, it is saturated at half"
                )
            # Where the position is replaced, the model's own property does not follow it.
            if (
                not surface.replaces
                and moved > NEGLIGIBLE
                and abs(moved / abs(stop) - 1.0) > TRAVEL_TOLERANCE
            ):
                yield (
                    f"{key} must move to {abs(stop) / DEG:.3g} deg as `travel_deg` says, the model "
                    f"moves it by {moved / DEG:.3g} deg"
                )
