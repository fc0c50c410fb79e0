"""Steps per second of `FlightEnv` beside jsbgym and gymnasium-jsbsim, on JSBSim's Cessna 172P.

Each environment is asked for ten actions per second of flight and flies straight ahead, resets
included. The peers integrate at 60 Hz and write the actions to the surfaces. `FlightEnv` integrates
at 200 Hz with an inner loop that follows roll and load factor. The ratios are therefore those of
JSBSim's integration steps per second: to the peers, where they are installed (``pip install jsbgym
gymnasium-jsbsim``), and to the same aircraft flown without an environment.

Run it with ``python benchmarks/bench_gym.py``; ``--json`` prints one object. Exits with 1 where a
ratio is below its target. It is processor time, best of several.
"""

import json
import os
import time
from importlib.util import find_spec
from typing import Any

import numpy as np
import running

import flighttune as ft
from flighttune.flight.conditions import start_condition

STEPS, REPEATS = (100, 1) if running.QUICK else (6000, 3)
RATE_HZ, PEER_HZ = 10, 60

ALONE = "aircraft alone"
PEERS = {
    "jsbgym": "C172-HeadingControlTask-Shaping.STANDARD-NoFG-v0",
    "gymnasium_jsbsim": "JSBSim-HeadingControlTask-Cessna172P-Shaping.STANDARD-NoFG-v0",
}
# Least ratios of integration steps per second: ours have an inner loop, and each flight of a minute
# begins with a fresh aircraft, trimmed with its engine at rest.
TARGETS = {ALONE: 0.5, "jsbgym": 0.5, "gymnasium_jsbsim": 0.5}

LEVEL = np.array([0.0, 1.0])


def cruise() -> ft.Scenario:
    """Cruise for longer than the peers' episodes last, on the aircraft alone."""
    tables = ft.load_scenario("c172_cruise_turn").as_dict()
    tables["plant"] = [{"kind": "jsbsim", "aircraft": "c172p"}]
    tables |= {"reference": {"chi_deg": 0.0, "gamma_deg": 0.0}, "expect": []}
    tables["flight"]["duration_s"] = 60.0
    return ft.scenario_from(tables)


def of_env(env: Any, action: np.ndarray) -> float:
    """Return the time of a step of an environment, s."""
    env.reset(seed=1)
    began = time.process_time()
    for _ in range(STEPS):
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()
    return (time.process_time() - began) / STEPS


def of_peer(name: str) -> float | None:
    """Return the time of a step of a peer, s; None where it is not installed."""
    if find_spec(name) is None:
        return None
    import gymnasium

    __import__(name)
    made = gymnasium.make(PEERS[name], agent_interaction_freq=RATE_HZ, disable_env_checker=True)
    return of_env(made.unwrapped, np.zeros(made.action_space.shape or ()))


def of_aircraft() -> float:
    """Return the time in which the aircraft flies a tenth of a second by itself, s."""
    plant = ft.loop.JSBSimPlant("c172p")
    plant.start(start_condition(cruise()))
    began = time.process_time()
    for _ in range(STEPS // 10):
        plant.advance(0.0, 1.0, 1.0 / RATE_HZ)
    return (time.process_time() - began) / (STEPS // 10)


def main() -> int:
    parser = running.options(__doc__)
    as_json = parser.parse_args().json
    os.environ["JSBSIM_DEBUG"] = "0"  # peers let JSBSim print

    ours = ft.gym.FlightEnv(cruise(), rate_hz=RATE_HZ)
    rate = ft.loop.JSBSimPlant("c172p").config.inner_loop_rate
    flown = {"FlightEnv": lambda: of_env(ours, LEVEL), ALONE: of_aircraft}
    flown |= {name: (lambda name=name: of_peer(name)) for name in PEERS}
    times = {name: [took() for _ in range(REPEATS)] for name, took in flown.items()}
    best = {name: min(filter(None, each), default=None) for name, each in times.items()}
    steps = {name: 1.0 / took for name, took in best.items() if took is not None}
    rates = dict.fromkeys(PEERS, PEER_HZ)
    integrated = {name: n * rates.get(name, rate) / RATE_HZ for name, n in steps.items()}
    ratios = {name: integrated["FlightEnv"] / integrated[name] for name in TARGETS if name in steps}
    result = {
        "steps_per_s": steps,
        "integration_steps_per_s": integrated,
        "ratios": ratios,
        "targets": TARGETS,
        "not_installed": [name for name, took in best.items() if took is None],
    }
    if as_json:
        print(json.dumps(result))
    else:
        for name, per_s in steps.items():
            print(f"{name}: {per_s:.0f} actions/s, {integrated[name]:.0f} steps of JSBSim/s")
        for name, ratio in ratios.items():
            print(f"FlightEnv over {name}: {ratio:.2f} (at least {TARGETS[name]})")
        for name in result["not_installed"]:
            print(f"{name}: not installed")
    return 0 if all(ratio >= TARGETS[name] for name, ratio in ratios.items()) else 1


if __name__ == "__main__":
    running.end(main)
