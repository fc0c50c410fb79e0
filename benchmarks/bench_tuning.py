"""What tuning costs: gradients against differential evolution, over ten seeds.

Run it with ``python benchmarks/bench_tuning.py``; ``--json`` prints one object.
"""

import json
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import running
from evolution import tune_by_evolution

from flighttune import tune
from flighttune.control.gains import PAPER_GAINS
from flighttune.control.inner_loop import with_input_lag
from flighttune.control.limits import Limits
from flighttune.control.linear_model import kinematic_model
from flighttune.control.margins import loop_margins
from flighttune.control.tuning.problem import TuningProblem
from flighttune.control.tuning.result import TuningResult
from flighttune.control.tuning.tune import diagnosis, frontier, relaxed, tune_problem

SEEDS = range(1 if running.QUICK else 10)
METHODS = {"gradient": tune_problem, "genetic": tune_by_evolution}
POINTS = 3 if running.QUICK else 25
FEASIBLE_FACTOR = 7.0
IDENTIFIED = {"tuning.model": "identified"}
ALL_LIMITS = ("phi", "n_z", "phi_rate", "n_z_rate")


def problems() -> dict[str, TuningProblem]:
    """The paper's problem without input limits, and with seven times the printed ones."""
    model = kinematic_model(V_a=25.0, gamma=np.pi / 12.0, g=9.81)
    limits = Limits(
        lower=np.array([-np.pi / 4.0, -2.1]),
        upper=np.array([np.pi / 4.0, 2.1]),
        rate_lower=np.array([-np.pi / 6.0, -1.0]),
        rate_upper=np.array([np.pi / 6.0, 1.0]),
    )
    x_0 = np.array([-np.pi / 3.0, -np.pi / 6.0])
    printed = TuningProblem(model=model, I_star=5.0, limits=limits, x_0=x_0)
    return {
        "I* = 5": TuningProblem(model=model, I_star=5.0),
        "I* = 5, 7 x the printed limits": relaxed(printed, ALL_LIMITS, FEASIBLE_FACTOR),
        "I* = 5, printed limits": printed,
    }


def spread_of_R_K(results: list[TuningResult]) -> dict[str, float | None]:
    """The worst and best R_K of those that are feasible; None if none is."""
    feasible = [one.R_K for one in results if one.status == "optimal"]
    return {
        "R_K_worst": min(feasible, default=None),
        "R_K_best": max(feasible, default=None),
        "feasible": len(feasible),
    }


def over_seeds(problem: TuningProblem) -> dict[str, dict[str, float | str | None]]:
    """Median time and spread of R_K over the seeds; the methods take turns."""
    found = {method: [] for method in METHODS}
    for seed in SEEDS:
        for method, search in METHODS.items():
            found[method].append(search(replace(problem, seed=seed)))
    return {
        method: {
            "status": "/".join(sorted({one.status for one in results})),
            "median_s": float(np.median([one.wall_s for one in results])),
            **spread_of_R_K(results),
        }
        for method, results in found.items()
    }


def seconds(run: Callable[[], object], repeats: int = 1 if running.QUICK else 3) -> float:
    """Median time of a call."""
    took = []
    for _ in range(repeats):
        began = time.perf_counter()
        run()
        took.append(time.perf_counter() - began)
    return float(np.median(took))


def measured() -> dict[str, dict]:
    """Everything, in one process."""
    cases = problems()
    free, printed = cases["I* = 5"], cases["I* = 5, printed limits"]
    lagged = with_input_lag(free.model, (4.0, 8.0))
    for search in () if running.QUICK else METHODS.values():
        search(replace(free, I_star=6.0))
    judged = ["I* = 5"] if running.QUICK else [*cases]
    methods = {name: over_seeds(cases[name]) for name in judged}
    others = {
        "tune with lag, 6 states": seconds(lambda: tune_problem(TuningProblem(model=lagged))),
        "diagnosis, printed limits": seconds(lambda: diagnosis(printed)),
        **{
            f"tune by {objective} on the identified loop": seconds(
                lambda objective=objective: tune(
                    "mission", changes=IDENTIFIED | {"tuning.objective": objective}
                )
            )
            for objective in (("decay",) if running.QUICK else ("E_K", "decay"))
        },
        f"frontier, {POINTS} points": seconds(lambda: frontier(free, points=POINTS)),
        "margins": seconds(lambda: loop_margins(free.model, PAPER_GAINS)),
    }
    return {"methods": methods, "seconds": others}


def main() -> int:
    """Measure, and print a table or JSON."""
    parser = running.options(__doc__)
    found = measured()
    if parser.parse_args().json:
        print(json.dumps(found))
        return 0
    print(f"{'median of ten seeds':34}{'s':>8}{'x gradient':>12}{'R_K worst':>12}{'best':>10}")
    for problem, methods in found["methods"].items():
        print(problem)
        for method, row in methods.items():
            ratio = row["median_s"] / methods["gradient"]["median_s"]
            spread = (
                f"{row['R_K_worst']:12.6f}{row['R_K_best']:10.6f}"
                if row["feasible"]
                else f"{'no feasible gains':>22}"
            )
            print(
                f"  {method + ', ' + row['status']:32}{row['median_s']:8.3f}{ratio:12.1f}{spread}"
            )
    for name, took in found["seconds"].items():
        print(f"{name:36}{took:8.3f}")
    return 0


if __name__ == "__main__":
    running.end(main)
