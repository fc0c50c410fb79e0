"""What the compiled step of an aircraft saves: a step, whole flights, rows of a campaign.

Each is flown by the compiled step and by JSBSim in one run. It is processor time, best of several,
so that other work on the machine does not count. A flight of 300 s has all of it: load, trim, fly,
table. "Begun before" are flights whose start the process has kept, as those of a search by gains.

"Lanes" are steps of many flights in vectors, beside the same compiled steps one flight after the
other.

Run it with ``python benchmarks/bench_compiled.py``; ``--json`` prints one object. Exits with 1
where a ratio is below its limit in `LEAST_RATIO`.
"""

import json
import math
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import running
from bench_campaign import AIRCRAFT, AIRFRAME, DEFAULT, START, dispersed, plan, plan_of
from bench_jsbsim import circuit

from flighttune import load_scenario, scenario_from
from flighttune.base.files.code import JSBSIM
from flighttune.campaigns.flying import rows
from flighttune.campaigns.planning.plan import Plan
from flighttune.compiled.aircraft import CompiledStep
from flighttune.compiled.face import in_lanes
from flighttune.flight.entry import entry_of
from flighttune.flight.fly import fly_alone
from flighttune.flight.loop import aircraft, loop
from flighttune.flight.models import gain_set
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.jsbsim import trim
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.jsbsim.steps import compiled, design_flight, start_of
from flighttune.vehicles.plants.jsbsim.trim import level
from flighttune.vehicles.plants.weather import Turbulence, TurbulenceModel, Weather
from flighttune.vehicles.simulated import started

REPEATS, STEPS = (1, 500) if running.QUICK else (7, 4000)
LANES: list[tuple[str, TurbulenceModel | None]] = [
    *(("aerosonde", None), ("aerosonde", "tustin"), ("c172p", None), ("c172p", "tustin"))
]
LEAST_RATIO = {"step": 18.0, "still air": 12.0, "turbulence": 10.0, "row": 5.0, "settling": 5.0}


def best(do: Callable[[], object]) -> float:
    """Least processor time of several, s."""
    least = math.inf
    for _ in range(REPEATS):
        began = time.process_time()
        do()
        least = min(least, time.process_time() - began)
    return least


def steps() -> tuple[float, float]:
    """Processor time of one step of JSBSim and of the compiled one, s."""
    plant = JSBSimPlant("aerosonde")
    condition = FlightCondition(V_a=25.0)
    step = compiled(plant.config)
    assert isinstance(step, CompiledStep), step
    plant.start(condition)
    start = start_of(step, plant)
    plant.start(condition)
    assert plant.fdm is not None
    run = plant.fdm.run

    def by_jsbsim() -> None:
        for _ in range(STEPS):
            run()

    shown = np.empty(len(step.names.signals))
    slow = best(by_jsbsim) / STEPS
    fast = best(lambda: step.fly(start.states, start.parameters, STEPS, None, shown)) / STEPS
    return slow, fast


def lanes(name: str, model: TurbulenceModel | None) -> tuple[float, float]:
    """Processor time of a step of a flight, alone and in its lane, s."""
    air = Weather(turbulence=Turbulence(severity=3, wind_20ft=7.7, model=model)) if model else None
    plant = JSBSimPlant(name, weather=air)
    step, start, _ = started(plant, level(plant.config, *design_flight(plant.config)))
    many, alone, flights = in_lanes(step, start), step.machine, 64
    states, parameters, random = (
        many.blocks(np.tile(x, (flights, 1)))
        for x in (start.states, start.parameters, start.random)
    )
    fly = many.flying(
        states, parameters, random, np.empty((len(states), len(step.names.signals), many.width))
    )
    row, own = np.empty(len(step.names.signals)), start.states.copy()

    def one() -> None:
        for _ in range(STEPS // 100):
            alone.fly(own, start.parameters, 100, alone.normals(start.random, 100), row)

    def together() -> None:
        for _ in range(max(1, STEPS // 1000)):
            fly(100)

    return best(one) / STEPS, best(together) / (max(1, STEPS // 1000) * 100 * flights)


def both(do: Callable[[], Any]) -> tuple[float, float]:
    """Processor time by JSBSim and by the compiled step, s."""
    os.environ[JSBSIM] = "1"
    do()
    slow = best(do)
    del os.environ[JSBSIM]
    do()
    return slow, best(do)


def settling() -> Plan:
    """Rows of 20 s on an aircraft whose engine settles before each flight."""
    tables = load_scenario("c172_cruise_turn").as_dict()
    tables["plant"] = [table for table in tables["plant"] if table["kind"] == "jsbsim"]
    tables["gains"] = ["tuned"]
    tables["expect"] = [{"at_most": {"gamma": {"ST_deg": 10.0}}}]
    tables["flight"]["duration_s"] = 20.0
    tables["reference"] = {"chi_deg": 40.0, "gamma_deg": 0.0}
    speeds = dispersed("flight.V_a_mps", 48.0, 52.0)
    return plan_of(tables, "c172_cruise_turn", [speeds, *AIRFRAME], runs=1000)


def begun_anew(do: Callable[[], Any]) -> Callable[[], Any]:
    """The same without the starts that are kept."""

    def flown() -> Any:
        aircraft._kept_start.cache_clear()
        trim._found.cache_clear()
        return do()

    return flown


def main() -> int:
    as_json = running.options(__doc__).parse_args().json
    loop.COMPILED_FROM = 0
    still = circuit()
    rough = scenario_from(still.as_dict() | {"turbulence": {"intensity": "moderate"}})
    unsure = scenario_from(still.as_dict() | {"navigation": {"grade": "standard"}})
    campaign, of_cessna = plan(AIRCRAFT, START + AIRFRAME, **DEFAULT), settling()
    name = still.gain_names[0]
    gains, label = gain_set(still, name), still.aircraft[0].label
    flown = {
        "still air": lambda: fly_alone(entry_of(still, name, gains, label)),
        "turbulence": lambda: fly_alone(entry_of(rough, name, gains, label)),
        "errors of navigation": lambda: fly_alone(entry_of(unsure, name, gains, label)),
        "row": lambda: rows.fly_runs(campaign, [1]),
        "settling": lambda: rows.fly_runs(of_cessna, [1]),
    }
    flown = {name: begun_anew(do) for name, do in flown.items()} | {
        f"{name}, begun before": do for name, do in flown.items()
    }
    of_lanes = {
        f"lanes, {name} in {f'turbulence ({model})' if model else 'still air'}": lanes(name, model)
        for name, model in LANES
    }
    times = {"step": steps()} | of_lanes | {name: both(do) for name, do in flown.items()}
    ratios = {name: slow / fast for name, (slow, fast) in times.items()}
    if as_json:
        print(json.dumps({"s": times, "ratios": ratios, "least_ratio": LEAST_RATIO}))
    else:
        for name, (slow, fast) in times.items():
            least = f" (at least {LEAST_RATIO[name]:g})" if name in LEAST_RATIO else ""
            ways = ("alone", "in lanes") if name in of_lanes else ("JSBSim", "compiled")
            print(
                f"{name}: {ways[0]} {slow * 1e3:.4g} ms, {ways[1]} {fast * 1e3:.4g} ms, "
                f"{ratios[name]:.1f} times{least}"
            )
    return 0 if all(ratios[name] >= least for name, least in LEAST_RATIO.items()) else 1


if __name__ == "__main__":
    running.end(main)
