"""Actions per second of the environments beside bare JSBSim and other environments of it.

All fly a Cessna 172P straight ahead at ten actions per second of flight, resets included. Ours and
bare JSBSim integrate at 200 Hz, with an inner loop that follows roll and load factor. The peers
(``pip install jsbgym gymnasium-jsbsim``) integrate at 60 Hz and write the actions to the surfaces,
so the ratios to them are those of integration steps per second.

Run it with ``python benchmarks/bench_gym.py``; ``--json`` prints one object. Exits with 1 where a
ratio is below its target. It is processor time of one core, best of several.
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

STEPS, REPEATS = (20, 1) if running.QUICK else (3000, 5)
RATE_HZ, PEER_HZ = 10, 60
FLIGHTS = 1, 8, 64, 256

BARE, ONE = "bare JSBSim", "FlightEnv"
PEERS = {
    "jsbgym": "C172-HeadingControlTask-Shaping.STANDARD-NoFG-v0",
    "gymnasium_jsbsim": "JSBSim-HeadingControlTask-Cessna172P-Shaping.STANDARD-NoFG-v0",
}


def many(n: int) -> str:
    """Name of the row of n flights at once."""
    return f"FlightVectorEnv, {n}"


# Least ratios of integration steps per second, of the first to the second.
TARGETS = {
    (ONE, BARE): 3.0,
    (many(8), BARE): 5.0,
    (many(256), BARE): 15.0,
    (many(256), "jsbgym"): 15.0,
    (many(256), "gymnasium_jsbsim"): 15.0,
}
# Processor time in which a flight of the vector begins, us.
LARGEST_RESET_US = 50.0

LEVEL = np.array([0.0, 1.0])


def cruise() -> ft.Scenario:
    """Cruise for longer than the peers' episodes last, on the aircraft alone."""
    tables = ft.load_scenario("c172_cruise_turn").as_dict()
    tables["plant"] = [{"kind": "jsbsim", "aircraft": "c172p"}]
    tables |= {"reference": {"chi_deg": 0.0, "gamma_deg": 0.0}, "expect": []}
    tables["flight"]["duration_s"] = 60.0
    return ft.scenario_from(tables)


def of_env(env: Any, action: np.ndarray) -> float:
    """Return the time of a step of an environment of one flight, s."""
    env.reset(seed=1)
    began = time.process_time()
    for _ in range(STEPS):
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()
    return (time.process_time() - began) / STEPS


def of_many(env: ft.gym.FlightVectorEnv) -> float:
    """Return the time of an action of one flight among several, s."""
    n = env.num_envs
    actions, steps = np.tile(LEVEL, (n, 1)), max(STEPS // n, 60 if n > 1 else 1)
    env.reset(seed=1)
    began = time.process_time()
    for _ in range(steps):
        env.step(actions)
    return (time.process_time() - began) / (steps * n)


def of_reset(env: ft.gym.FlightVectorEnv) -> float:
    """Return the time in which each flight of a vector begins anew, us."""
    env.reset(seed=1)
    began = time.process_time()
    for _ in range(10):
        env.reset()
    return (time.process_time() - began) / (10 * env.num_envs) * 1e6


def of_peer(name: str) -> float | None:
    """Return the time of a step of a peer, s; None where it is not installed."""
    if find_spec(name) is None:
        return None
    import gymnasium

    __import__(name)
    made = gymnasium.make(PEERS[name], agent_interaction_freq=RATE_HZ, disable_env_checker=True)
    return of_env(made.unwrapped, np.zeros(made.action_space.shape or ()))


def of_aircraft() -> float:
    """Return the time in which JSBSim flies a tenth of a second by itself, s."""
    plant = ft.loop.JSBSimPlant("c172p")
    plant.start(start_condition(cruise()))
    began = time.process_time()
    for _ in range(STEPS // 10):
        plant.advance(0.0, 1.0, 1.0 / RATE_HZ)
    return (time.process_time() - began) / (STEPS // 10)


def main() -> int:
    as_json = running.options(__doc__).parse_args().json
    os.environ["JSBSIM_DEBUG"] = "0"  # peers let JSBSim print

    one = ft.gym.FlightEnv(cruise(), rate_hz=RATE_HZ)
    vectors = {n: ft.gym.FlightVectorEnv(n, cruise(), scaled=False) for n in FLIGHTS}
    flown = {BARE: of_aircraft, ONE: lambda: of_env(one, LEVEL)}
    flown |= {many(n): (lambda env=env: of_many(env)) for n, env in vectors.items()}
    flown |= {name: (lambda name=name: of_peer(name)) for name in PEERS}
    times = [{name: took() for name, took in flown.items()} for _ in range(REPEATS)]
    best = {name: min(filter(None, (x[name] for x in times)), default=None) for name in flown}
    actions = {name: 1.0 / took for name, took in best.items() if took is not None}
    rate = ft.loop.JSBSimPlant("c172p").config.inner_loop_rate
    rates = dict.fromkeys(PEERS, PEER_HZ)
    steps = {name: n * rates.get(name, rate) / RATE_HZ for name, n in actions.items()}
    ratios = {pair: steps[pair[0]] / steps[pair[1]] for pair in TARGETS if pair[1] in steps}
    resets = {
        many(n): min(of_reset(env) for _ in range(REPEATS))
        for n, env in vectors.items()
        if n > 1  # a call takes longer than a flight
    }
    result = {
        "actions_per_s": actions,
        "integration_steps_per_s": steps,
        "reset_us": resets,
        "ratios": {f"{a} / {b}": ratio for (a, b), ratio in ratios.items()},
        "targets": {f"{a} / {b}": target for (a, b), target in TARGETS.items()},
        "not_installed": [name for name, took in best.items() if took is None],
    }
    if as_json:
        print(json.dumps(result))
    else:
        report(result)
    met = all(ratio >= TARGETS[pair] for pair, ratio in ratios.items())
    return 0 if met and max(resets.values()) <= LARGEST_RESET_US else 1


def report(result: dict[str, Any]) -> None:
    """Print a result as lines."""
    for name, per_s in result["actions_per_s"].items():
        steps = result["integration_steps_per_s"][name]
        print(f"{name:22s} {per_s:9.0f} actions/s {steps:10.0f} integration steps/s")
    for name, took in result["reset_us"].items():
        print(f"{name:22s} {took:9.1f} us to begin a flight (at most {LARGEST_RESET_US:g})")
    for name, ratio in result["ratios"].items():
        print(f"{name}: {ratio:.2f} (at least {result['targets'][name]:g})")
    for name in result["not_installed"]:
        print(f"{name}: not installed")


if __name__ == "__main__":
    running.end(main)
