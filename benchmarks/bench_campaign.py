"""What a row of a campaign costs: JSBSim runs against bare integration steps, and kinematic draws.

The aircraft flies the default law, kinematic draws fly that of the paper.

Run it with ``python benchmarks/bench_campaign.py``; ``--json`` prints one object.

A row is all of it: the scenario of the draw, the aircraft built, loaded and trimmed, 20 s of flight
with the loop closed at 50 Hz, measures, expectations, the table. It is held
against the bare ``fdm.run()`` loop of the same 20 s at 200 Hz in still air. It is processor time,
the best of several of each draw, so that other work on the machine does not count.

Kinematic draws are those of a whole campaign, as `campaign` flies it. They are timed by the
clock, and by the processor time over the cores, which is what the clock shows on a machine that
does nothing else. A row of them is also held against its flight in the compiled kernel alone, by
processor time in one process, the best block of each.

Exits with 1 where a ratio is above its limit in `HIGHEST_RATIO`, or kinematic flights at 50 Hz take
more processor time than is in `SECONDS`.
"""

import json
import math
import os
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

import running
from bench_jsbsim import bare

from flighttune import load_scenario, run_campaign, scenario_from
from flighttune.base.files.code import JSBSIM
from flighttune.base.processors import cores
from flighttune.campaigns.flying import rows
from flighttune.campaigns.planning.plan import Plan, plan_campaign
from flighttune.campaigns.planning.schema import Campaign, CampaignTable
from flighttune.flight.conditions import start_condition
from flighttune.flight.loop import kernel

STEPS, BARE_SECONDS = 4000, 60.0
BLOCK, REPEATS = (1, 1) if running.QUICK else (25, 8)
KINEMATIC_BLOCKS = 2 if running.QUICK else 120
HIGHEST_RATIO = {"still air": 2.4, "airframe dispersed": 2.4, "kinematic, 100 Hz": 3.3}
MANY, SECONDS = 100 if running.QUICK else 100_000, 160.0


def dispersed(key: str, lower: float, upper: float) -> dict[str, object]:
    return {"key": key, "distribution": "uniform", "lower": lower, "upper": upper}


START = [dispersed("flight.V_a_mps", 24.0, 26.0), dispersed("flight.gamma_deg", 30.0, 45.0)]
AIRFRAME = [
    dispersed("plant.airframe.mass_factor", 0.95, 1.05),
    dispersed("plant.airframe.lift_factor", 0.95, 1.05),
    dispersed("plant.airframe.actuator_lag_factor", 0.8, 1.5),
]
WEATHER: dict[str, Any] = {
    "wind": {"speed_mps": 5.0, "from_deg": 250.0},
    "turbulence": {"intensity": "light"},
}
DEFAULT: dict[str, Any] = {"law": ["exact"], "gains": ["tuned_fed_back"]}
AIRCRAFT = {"kind": "jsbsim", "aircraft": "aerosonde"}
LAW = {"kind": "kinematic"}


def plan(
    plant: dict[str, str], disperse: list[dict[str, object]], *, rate_hz: float = 50.0,
    runs: int = 10_000, **changes: object,
) -> Plan:  # fmt: skip
    """The paper's manoeuvre of 20 s, dispersed, by one gain set on one plant."""
    tables = {**load_scenario("paper").as_dict(), "gains": ["paper"], "plant": [plant], **changes}
    tables["controller"]["rate_hz"] = rate_hz
    tables["expect"] = [{"at_most": {"chi": {"settling_s": 15.0}, "gamma": {"ST_deg": 1.0}}}]
    return plan_of(tables, "paper", disperse, runs=runs)


def plan_of(
    tables: dict[str, Any], scenario: str, disperse: list[dict[str, object]], *, runs: int
) -> Plan:
    """A campaign on the tables of a changed scenario."""
    nominal = scenario_from(tables)
    table = CampaignTable.model_validate(
        {"title": "bench", "scenario": scenario, "seed": 1, "runs": runs, "disperse": disperse}
    )
    return plan_campaign(Campaign.of(table, nominal=nominal, central=nominal))


def jsbsim_rows() -> dict[str, float]:
    """Processor time of a row over that of the bare steps, and of the bare steps of one flight."""
    plans = {
        "still air": plan(AIRCRAFT, START, **DEFAULT),
        "airframe dispersed": plan(AIRCRAFT, START + AIRFRAME, **DEFAULT),
        "wind and turbulence": plan(AIRCRAFT, START, **DEFAULT, **WEATHER),
    }
    condition = start_condition(plans["still air"].scenario)
    bare_s, best = math.inf, {name: [math.inf] * BLOCK for name in plans}
    for made in plans.values():
        rows.fly_runs(made, range(2))
    for _ in range(REPEATS):
        bare_s = min(bare_s, bare(condition) * STEPS)
        for name, made in plans.items():
            for draw in range(BLOCK):
                began = time.process_time()
                rows.fly_runs(made, [draw])
                best[name][draw] = min(best[name][draw], time.process_time() - began)
    ratios = {name: sum(took) / BLOCK / bare_s for name, took in best.items()}
    return {"bare_ms": bare_s * 1e3} | ratios


def kinematic_plan(rate_hz: float, runs: int) -> Plan:
    """A campaign of kinematic flights of 20 s."""
    keys = [*START, dispersed("flight.chi_deg", -60.0, 60.0), dispersed("limits.n_z[1]", 1.5, 2.1)]
    return plan(LAW, keys, rate_hz=rate_hz, runs=runs)


def over_kernel(rate_hz: float) -> float:
    """Processor time of a kinematic row over that of its flight in the compiled kernel."""
    blocks = range(KINEMATIC_BLOCKS)
    sweep, flown = kinematic_plan(rate_hz, rows.BLOCK * len(blocks)), []
    fly_block = kernel.fly_block

    def timed(*args: Any) -> None:
        began = time.process_time()
        fly_block(*args)
        flown.append(time.process_time() - began)

    kernel.fly_block, took = timed, []
    try:
        for block in blocks:
            began = time.process_time()
            rows.fly_runs(sweep, range(block * rows.BLOCK, (block + 1) * rows.BLOCK))
            took.append(time.process_time() - began)
    finally:
        kernel.fly_block = fly_block
    return min(took[1:]) / min(flown[1:])


def kinematic_rows(rate_hz: float, runs: int) -> tuple[float, float]:
    """Times of a campaign of kinematic flights: clock, processor time over cores, s."""
    sweep = kinematic_plan(rate_hz, runs)
    with tempfile.TemporaryDirectory() as folder:
        began, busy = time.perf_counter(), _processor_s()
        flown = run_campaign(sweep, Path(folder) / "rows").flown
        took = time.perf_counter() - began, (_processor_s() - busy) / cores()
    if flown != runs:
        raise RuntimeError(f"{flown} of {runs} rows are there")
    return took


def _processor_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + used.ru_utime + used.ru_stime


def main() -> int:
    os.environ[JSBSIM] = "1"  # bench_compiled.py has compiled flights
    parser = running.options(__doc__)
    parser.add_argument("--flights", type=int, default=MANY, help="kinematic flights")
    asked = parser.parse_args()

    ratios = jsbsim_rows() | {f"kinematic, {rate} Hz": over_kernel(rate) for rate in (50, 100)}
    kinematic = {f"{rate:g} Hz": kinematic_rows(rate, asked.flights) for rate in (50.0, 100.0)}
    many = {
        name: tuple(took * MANY / asked.flights for took in both)
        for name, both in kinematic.items()
    }
    kept = all(ratios[name] <= limit for name, limit in HIGHEST_RATIO.items())
    kept = kept and many["50 Hz"][1] <= SECONDS
    bare_ms = ratios.pop("bare_ms")
    if asked.json:
        result = {
            "bare_ms": bare_ms, "ratios": ratios, "highest_ratio": HIGHEST_RATIO,
            "kinematic_flights": asked.flights,
            "kinematic_s": {name: both[0] for name, both in kinematic.items()},
            "kinematic_processor_s_over_cores": {n: both[1] for n, both in kinematic.items()},
            "most_s_of_100000": SECONDS, "kept": kept,
        }  # fmt: skip
        print(json.dumps(result))
        return 0 if kept else 1
    print(f"bare run() of 20 s at 200 Hz: {bare_ms:.2f} ms; a row of a campaign, all in:")
    for name, ratio in ratios.items():
        limit = f" (at most {HIGHEST_RATIO[name]})" if name in HIGHEST_RATIO else ""
        peer = "its flight in the kernel" if "Hz" in name else "bare steps"
        print(f"  {name}: {ratio:.2f} times {peer}{limit}")
    print(f"{asked.flights} kinematic flights of 20 s on {os.cpu_count()} cores, to Parquet:")
    for name, (wall, busy) in kinematic.items():
        print(
            f"  {name}: {wall:.1f} s by the clock, {busy:.1f} s of processor over cores; ", end=""
        )
        print(f"{MANY}: {many[name][0]:.1f} s, {many[name][1]:.1f} s", end="")
        print(f" (at most {SECONDS:g} s)" if name == "50 Hz" else "")
    return 0 if kept else 1


if __name__ == "__main__":
    running.end(main)
