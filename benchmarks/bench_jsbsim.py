"""What closing the loop, weather and a route cost against bare integration steps.

The loop and weather are those of the paper's manoeuvre, without building and trimming the aircraft;
the route is that of `circuit`, and its time has all of it, from the scenario to the metrics.

Run it with ``python benchmarks/bench_jsbsim.py``; ``--json`` prints one object. Exits with 1 where
a ratio is above its limit in `HIGHEST_RATIO`. It is processor time, best of several, so that other
work on the machine does not count.
"""

import json
import math
import time

import running

from flighttune import load_scenario, scenario_from
from flighttune.aircraft.aircraft import load_aircraft
from flighttune.control.gains import PAPER_GAINS
from flighttune.control.mimo_pi import MimoPI
from flighttune.files.shipped import scenario_files
from flighttune.flight.conditions import reference_of, start_condition
from flighttune.flight.fly import aircraft_table, fly_alone
from flighttune.flight.models import gain_sets
from flighttune.metrics import measures
from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.plants.jsbsim.plant import JSBSimPlant
from flighttune.plants.jsbsim.trim import trim
from flighttune.plants.weather import Gust, OscillatingWind, Turbulence, Weather, WindProfile
from flighttune.simulate.loop import simulate

SECONDS, ROUTE_SECONDS = (5.0, 18.0) if running.QUICK else (60.0, 300.0)
REPEATS = 1 if running.QUICK else 7
ROUTE = "route, all in"
# A tenth above an interpreter without profile-guided optimisation: half of the loop is Python.
HIGHEST_RATIO = {"still air": 1.9, "gust and turbulence": 2.0, "all weather": 2.5, ROUTE: 1.8}
"""Wind that changes with height and oscillates is two more sources to add up at every step."""


WEATHER = {
    "still air": None,
    "gust and turbulence": Weather(
        gust=Gust(axis="right", peak=3.0, start=5.0, rise=2.0),
        turbulence=Turbulence(severity=3, wind_20ft=7.7),
    ),
    "all weather": Weather(
        wind=WindProfile(((0.0, (3.0, 2.0, 0.0)), (2000.0, (5.0, 4.0, 0.0)))),
        gust=Gust(axis="right", peak=3.0, start=5.0, rise=2.0),
        turbulence=Turbulence(severity=3, wind_20ft=7.7),
        oscillation=OscillatingWind(
            cosine=(0.0, 2.0, 0.0), cosine_omega=0.5, sine=(0.0, 0.0, 1.0), sine_omega=0.5
        ),
    ),
}


class TimedPlant(JSBSimPlant):
    """Notes when its flight begins: building and trimming are not part of the loop."""

    def start(self, condition: FlightCondition) -> None:
        super().start(condition)
        self.began = time.process_time()


def bare(condition: FlightCondition) -> float:
    """Return the time of one integration step in still air without anything around it, s."""
    fdm = Fdm(load_aircraft("aerosonde"))
    trim(fdm, condition)
    run, steps = fdm.run, round(SECONDS * fdm.rate)
    began = time.process_time()
    for _ in range(steps):
        run()
    return (time.process_time() - began) / steps


def closed_loop(weather: Weather | None) -> tuple[float, int]:
    """Return the time of one integration step in the closed loop, s, and the signals recorded."""
    scenario = load_scenario(scenario_files()["paper"])
    controller = MimoPI(
        PAPER_GAINS,
        scenario.limits.limits(),
        dt=1.0 / scenario.controller.rate_hz,
        anti_windup=scenario.controller.anti_windup,
        feed_forward=scenario.controller.feed_forward,
    )
    plant = TimedPlant(weather=weather, seed=1)
    signals, stop = simulate(
        plant, controller, reference_of(scenario), condition=start_condition(scenario),
        duration=SECONDS,
    )  # fmt: skip
    took = time.process_time() - plant.began
    if stop is not None:
        raise RuntimeError(f"the flight ended early: {stop.reason}")
    return took / (SECONDS * plant.config.inner_loop_rate), signals.shape[1]


def along_a_route() -> float:
    """Return the time of one integration step of a flight of `circuit`, s."""
    tables = load_scenario(scenario_files()["circuit"]).as_dict()
    tables["flight"]["duration_s"] = ROUTE_SECONDS
    del tables["route"]["waypoint"][
        2 if running.QUICK else 11 :
    ]  # the rest cannot be reached in this time
    scenario = scenario_from(tables)
    ((name, gains),) = gain_sets(scenario)[0].items()
    table = aircraft_table(scenario)
    began = time.process_time()
    run = fly_alone(scenario, table, gains, name)
    measures(run)
    took = time.process_time() - began
    if run.duration != ROUTE_SECONDS:
        raise RuntimeError(f"the flight ended early: {run.reason}")
    return took / (ROUTE_SECONDS * load_aircraft("aerosonde").inner_loop_rate)


def main() -> int:
    parser = running.options(__doc__)
    as_json = parser.parse_args().json

    condition = start_condition(load_scenario(scenario_files()["paper"]))
    bare_s, signals = math.inf, 0
    loop_s = dict.fromkeys(HIGHEST_RATIO, math.inf)
    for _ in range(REPEATS):
        bare_s = min(bare_s, bare(condition))
        for name, weather in WEATHER.items():
            took, signals = closed_loop(weather)
            loop_s[name] = min(loop_s[name], took)
        loop_s[ROUTE] = min(loop_s[ROUTE], along_a_route())
    ratios = {name: took / bare_s for name, took in loop_s.items()}
    result = {
        "bare_us_a_step": bare_s * 1e6,
        "closed_loop_us_a_step": {name: took * 1e6 for name, took in loop_s.items()},
        "ratio": max(ratios.values()),
        "ratios": ratios,
        "highest_ratio": HIGHEST_RATIO,
        "signals": signals,
    }
    if as_json:
        print(json.dumps(result))
    else:
        print(
            f"bare run() {bare_s * 1e6:.2f} us a step; closed loop with {signals} signals at 50 Hz:"
        )
        for name, took in loop_s.items():
            print(
                f"  {name}: {took * 1e6:.2f} us, ratio {ratios[name]:.2f} "
                f"(at most {HIGHEST_RATIO[name]})"
            )
    return 0 if all(ratio <= HIGHEST_RATIO[name] for name, ratio in ratios.items()) else 1


if __name__ == "__main__":
    running.end(main)
