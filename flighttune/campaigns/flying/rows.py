"""Fly runs of a plan into rows, one per run, with the same bits on any worker.

The compiled kernel flies many kinematic flights at a time; all others are flown one by one, draw by
draw.
"""

import signal
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from flighttune.base.errors import OF_A_FLIGHT, FlightTuneError, InputError, ending_of
from flighttune.base.files import code
from flighttune.base.processors import cores
from flighttune.campaigns.flying.columns import NOT_REPRODUCIBLE, Row, table_of
from flighttune.campaigns.flying.compiled import COMPILED, CompiledFlights
from flighttune.campaigns.planning.plan import Group, Plan
from flighttune.campaigns.planning.schema import MEASURES
from flighttune.control.gains import PIGains
from flighttune.control.gains_keys import GainsTable
from flighttune.control.law import Law
from flighttune.control.linear_model import loops_of
from flighttune.control.theory.indicators import indicators_batch
from flighttune.control.theory.reachable import largest_errors
from flighttune.flight.conditions import command_limits, reference_of, start_condition
from flighttune.flight.entry import Entry
from flighttune.flight.flown import FlownScenario, bounded_loop, missed
from flighttune.flight.fly import EVERY, Progress, check_compiled, decides, fly, fly_alone
from flighttune.flight.loop.batch import SIGNALS, fly_sampled
from flighttune.flight.loop.disturbance import Sinusoid
from flighttune.flight.loop.loop import COMPILED_FROM, compile_at_once
from flighttune.flight.loop.run import Run
from flighttune.flight.metrics import CHANNELS, measures, measures_of, required_names
from flighttune.flight.models import law_setup, linear_model
from flighttune.flight.own import ask_to_fly
from flighttune.flight.records.refly import Difference
from flighttune.flight.route import planned_route
from flighttune.flight.scenario.load import scenario_from
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.plants.point_mass import rolled_over

# Number of draws whose kinematic flights are flown together: their signals fit the processor's
# cache, and the process does not block for long.
BLOCK = 64

# `BatchResult.ends` of a flight that ended at 90 deg of roll
ROLLED = 1

# Status, reason and `flighttune.flight.metrics.measures` of one flight
FlightResult = tuple[str, str, Mapping[str, Mapping[str, float]]]

# R_K, I_K and E_K
Indicators = tuple[float | None, float | None, float | None]
UNKNOWN: Indicators = (None, None, None)

# Values of a draw, as `Plan.values_of` returns them
Drawn = Mapping[str, Any]

# Additional columns: numbers of each completed flight. With probes all flights are flown one by
# one.
Probes = Mapping[str, Callable[[Run, Scenario], Sequence[float]]]


class Draw(NamedTuple):
    """Some runs of one draw with its drawn values, or runs of several draws without values."""

    runs: tuple[int, ...]
    drawn: Drawn | None


def fly_group(plan: Plan, scenario: Scenario, group: Group) -> Run:
    """One flight by JSBSim: a group of a plan in a scenario, after that whose wind it replays."""
    with code.in_jsbsim():
        return fly_in_wind(plan.entry(group, scenario))


def fly_in_wind(entry: Entry, wind_runs: dict[str, Run] | None = None) -> Run:
    """One flight; `wind_runs` have, by label, the wind that other flights replay."""
    wind_runs = {} if wind_runs is None else wind_runs
    source, wind_run = entry.wind_from, None
    if source is not None:
        wind_run = wind_runs.get(source.label) or fly_in_wind(source, wind_runs)
    run = fly_alone(entry, wind_run=wind_run)
    if entry.scenario.windy and source is None:
        wind_runs[entry.label] = run
    return run


def scenario_of_run(plan: Plan, run: int, drawn: Mapping[str, Any] | None = None) -> Scenario:
    """The scenario of one run of a plan, with numbers as gains: `fly` gives the same bits."""
    if not 0 <= run < plan.runs:
        raise InputError(f"`run` must be 0 to {plan.runs - 1}, got {run}.")
    group, draw = plan.group_of(run), plan.draw_of(run)
    scenario = plan.dispersed(plan.values_of(draw) if drawn is None else drawn, draw)
    entry = plan.entry(group, scenario)
    tables, gains, name = scenario.as_dict(), entry.found_gains, entry.listed
    labels = [table.label for table in scenario.plant]
    flying = (entry.wind_from, entry)
    tables["plant"] = [tables["plant"][labels.index(x.plant.label)] for x in flying if x]
    if scenario.law is not None:
        tables["law"] = [scenario.law_table(group.gains).model_dump(exclude_none=True)]
    tuned_for = {x.name: x.tuned_for for x in scenario.gains if isinstance(x, GainsTable)}
    tables["gains"] = [{"name": name, **gains.as_lists(), "tuned_for": tuned_for.get(name)}]
    tables["title"] = f"{scenario.title}, run {run}"
    tables.pop("verifies", None)  # a claim about the undispersed flight
    tables["expect"] = scenario.expected(group.plant, group.gains)
    return scenario_from(tables)


def fly_again(plan: Plan, run: int, *, progress: Progress | None = None) -> FlownScenario:
    """Fly one run of a plan again, with the aircraft whose wind it replays."""
    return fly(scenario_of_run(plan, run), progress=progress)


def fly_runs(plan: Plan, runs: Sequence[int]) -> pa.Table:
    """Fly runs of a plan in this process, and return their rows in order of `run`."""
    return table_of(plan, rows_flown(plan, sorted(runs)))


def rows_flown(
    plan: Plan,
    runs: Iterable[int],
    *,
    probes: Probes | None = None,
    draws: Sequence[Drawn] | None = None,
    again: bool = False,
) -> Iterator[Row]:
    """Fly runs of a plan, in rising order, in this process; their rows, draw by draw.

    `again`: JSBSim repeats each compiled flight.
    """
    # All columns but ``wall_s`` depend, to the bit, only on the plan and the run. Draws that
    # replace the design's draws may set keys that the campaign does not disperse.
    ask_to_fly(plan.scenario, plan.flown)
    work = Work(plan, probes or {}, draws)
    for together, alone in work.blocks(runs):
        yield from fly_together(plan, together)
        for draw in alone:
            yield from fly_draw(plan, draw, work.probes, again=again)


def row_differences(plan: Plan, run: int, row: Mapping[str, Any]) -> tuple[Difference, ...]:
    """Every column in which a repeated run differs from its row; zeros of either sign are equal."""
    # flown like rows, because a kinematic flight in a batch and alone differ by rounding
    return tuple(
        Difference(name, None, row[name], value)
        for name, value in fly_runs(plan, [run]).to_pylist()[0].items()
        # a compiled flight may have a zero of the other sign; NaN equals itself
        if name not in NOT_REPRODUCIBLE and row[name] != value and repr(row[name]) != repr(value)
    )


class Work(NamedTuple):
    """The work of a plan: its flights, the numbers kept of each, and draws that replace its own."""

    plan: Plan
    probes: Probes
    draws: Sequence[Drawn] | None = None  # replace the draws of the design

    def blocks(self, runs: Iterable[int]) -> Iterator[tuple[list[Draw], list[Draw]]]:
        """The draws for `fly_together`, and the draws for `fly_draw`, block by block."""
        plan, in_batch = self.plan, self.batched
        for _, block in groupby(runs, key=lambda run: plan.draw_of(run) // BLOCK):
            together: list[Draw] = []
            alone: list[Draw] = []
            for number, of_draw in groupby(block, key=plan.draw_of):
                drawn = plan.values_of(number) if self.draws is None else self.draws[number]
                # Workers share the gain sets of a draw, too: a search flies many in one draw.
                by_gains: dict[str | None, list[int]] = {}
                for run in of_draw:
                    group = plan.group_of(run)
                    by_gains.setdefault(None if group in in_batch else group.gains, []).append(run)
                for gains, some in by_gains.items():
                    (together if gains is None else alone).append(Draw(tuple(some), drawn))
            yield together, alone

    @property
    def batched(self) -> frozenset[Group]:
        """The groups whose flights the compiled kernel flies, judged by the first draw."""
        plan, scenario = self.plan, self.plan.scenario
        with suppress(*OF_A_FLIGHT):
            scenario = plan.dispersed(self.draws[0], 0) if self.draws else scenario
        flown = plan.groups if not self.probes else ()
        tuned = [x for x in flown if plan.gain_sets[x.gains] is not None]
        return frozenset(x for x in tuned if batchable(scenario, plan.entry(x)))


def batchable(scenario: Scenario, entry: Entry) -> bool:
    """Whether the kernel can fly an entry's law, plant, air, disturbance and reference."""
    parts = entry.law, entry.plant.family, _acting(scenario), scenario.reference or scenario.route
    exact = not (scenario.windy or scenario.navigation)
    return exact and all(part is not None and part.batched for part in parts)


def _acting(scenario: Scenario) -> Sinusoid:
    """The disturbance of a scenario."""
    return scenario.disturbance.sinusoid() if scenario.disturbance else Sinusoid()


def alike(scenario: Scenario) -> Hashable:
    """Key of scenarios that share one call of the kernel: controller, time axis, inputs."""
    sensed = scenario.sensors is not None
    return scenario.controller, scenario.flight.duration_s, _moving(scenario), sensed


def _moving(scenario: Scenario) -> bool:
    """Whether the reference changes during the flight."""
    reference = scenario.reference
    assert reference is not None  # see `batchable`
    return isinstance(reference.chi_deg, list) or isinstance(reference.gamma_deg, list)


def fly_batch(
    scenarios: Sequence[Scenario], law: Law, gains: PIGains
) -> Iterator[FlightResult | None]:
    """Fly one gain set on the kinematic plant in many `batchable` scenarios that are `alike`."""
    controller, duration = scenarios[0].controller, scenarios[0].flight.duration_s
    dt = 1.0 / controller.rate_hz
    t = np.arange(round(duration / dt) + 1, dtype=np.float64) * dt
    references = [reference_of(scenario) for scenario in scenarios]
    conditions = [start_condition(scenario) for scenario in scenarios]
    # the plant itself has no limits
    laws: list[Any] = [
        law.make(law_setup(s, gains, command_limits(s), at_once=True)) for s in scenarios
    ]
    if _moving(scenarios[0]):
        ref = np.array([np.column_stack(reference.sampled(t)) for reference in references])
        rates = np.array([np.column_stack(reference.rates(t)) for reference in references])
    else:
        ref, rates = np.array([[reference.initial] for reference in references]), None
    # The bits of each flight do not depend on the others. A flight without a result is flown alone
    # to find the reason of its end.
    batch = fly_sampled(
        laws,
        conditions,
        ref,
        duration=duration,
        ref_rates=rates,
        disturbances=[_acting(scenario) for scenario in scenarios],
        sensors=[s.sensors.sensors(s.seed) for s in scenarios if s.sensors is not None],
        g=np.array([scenario.flight.g_mps2 for scenario in scenarios]),
    )
    from flighttune.flight.loop.kernel import error_measures

    required = required_names([table.model_dump() for table in scenarios[0].expect])
    for i in range(len(scenarios)):
        if batch.ends[i] > ROLLED:
            yield None
            continue
        n = batch.samples[i]
        columns = dict(zip(SIGNALS, batch.trajectories[i, :, :n], strict=True))
        # Constants have one sample: the airspeed, which the law assumes, and a constant reference.
        columns["V_a"] = np.array([conditions[i].V_a])
        columns["n_z"] = np.append(conditions[i].n_z_start, columns["n_z_cmd"][:-1])
        for channel, values in zip(CHANNELS, ref[i].T, strict=True):
            columns[f"{channel}_ref"] = np.ascontiguousarray(values[:n])
        measured = measures_of(t[:n], columns, required, error_measures) if n > 1 else {}
        status, reason = "completed", ""
        if batch.ends[i] == ROLLED:
            phi, n_z = (float(columns[name][-1]) for name in ("phi_cmd", "n_z_cmd"))
            status, reason = "diverged", rolled_over(phi, n_z, float(batch.t[n - 1])).reason
        yield status, reason, measured


def fly_together(plan: Plan, draws: Sequence[Draw]) -> list[Row]:
    """Rows of kinematic flights, one batch for each group."""
    rows: list[Row] = []
    batches: dict[tuple[Group, Law, Hashable], list[tuple[int, Drawn, Scenario]]] = {}
    for draw in draws:
        alone = [*draw.runs]  # runs that the kernel cannot fly, or that the scenario refuses
        drawn = draw.drawn
        assert drawn is not None  # runs of several draws are not flown together
        with suppress(*OF_A_FLIGHT):
            scenario = plan.dispersed(drawn, plan.draw_of(draw.runs[0]))
            for run in draw.runs:
                group = plan.group_of(run)
                own_law = any(key.startswith("law") for key in drawn)
                entry = plan.entry(group, scenario if own_law else None)
                if batchable(scenario, entry):
                    key = group, entry.law, alike(scenario)
                    batches.setdefault(key, []).append((run, drawn, scenario))
                    alone.remove(run)
        if alone:
            rows += fly_draw(plan, Draw(tuple(alone), drawn), {})
    for (group, law, _), flights in batches.items():
        scenarios = [scenario for _, _, scenario in flights]
        began = time.perf_counter()
        results = list(fly_batch(scenarios, law, plan.entry(group).found_gains))
        each_s = (time.perf_counter() - began) / len(flights)
        indicators = _indicators(plan, group, scenarios)
        for (run, drawn, scenario), result, both in zip(flights, results, indicators, strict=True):
            outcome = (
                _fly_alone(plan, scenario, run, {}, {})
                if result is None
                else _outcome(plan, scenario, group, each_s, result)
            )
            rows.append(_row(plan, run, drawn, outcome, both))
    return rows


def fly_draw(plan: Plan, draw: Draw, probes: Probes, *, again: bool = False) -> Iterator[Row]:
    """Rows of the runs of one draw, each as soon as it is flown; of several draws in order."""
    (runs, drawn), began = draw, time.perf_counter()
    if drawn is None:
        yield from sorted(rows_flown(plan, runs, again=again), key=lambda row: row["run"])
        return
    try:
        scenario = plan.dispersed(drawn, plan.draw_of(runs[0]))
    except OF_A_FLIGHT as error:
        yield from (_row(plan, run, drawn, _invalid(error, began)) for run in runs)
        return
    wind_runs: dict[str, Run] = {}
    for run in runs:
        group = plan.group_of(run)
        outcome = _fly_alone(plan, scenario, run, wind_runs, probes, again=again)
        yield _row(plan, run, drawn, outcome, *_indicators(plan, group, [scenario]))


def lost_row(plan: Plan, run: int, drawn: Drawn | None, ending: int | str) -> Row:
    """Row of a run that crashed its process, with this exit code or error."""
    status, reason = "crashed", str(ending)
    drawn = plan.values_of(plan.draw_of(run)) if drawn is None else drawn
    if ending == -signal.SIGALRM:
        limit = plan.campaign.time_limit_s
        status, reason = "timed_out", f"the flight must end within {limit:g} s of wall time"
    elif isinstance(ending, int):
        reason = f"the flight ended the process that flew it: {ending_of(ending)}"
    indicators = UNKNOWN
    with suppress(*OF_A_FLIGHT):
        scenario = plan.dispersed(drawn, plan.draw_of(run))
        (indicators,) = _indicators(plan, plan.group_of(run), [scenario])
    return _row(plan, run, drawn, _unflown(status, reason), indicators)


def warm_up(plan: Plan) -> None:
    """Load the code for the flights of a plan before its runs are timed."""
    flight, rate = plan.scenario.flight, plan.scenario.controller.rate_hz
    if plan.runs * flight.duration_s * rate > COMPILED_FROM * cores():
        compile_at_once()  # not in a run
    listed = map(plan.entry, plan.groups)
    once = {(entry.plant.label, entry.law.name): entry for entry in listed}
    for entry in once.values():  # one of each plant and law
        with suppress(*OF_A_FLIGHT):
            fly_alone(entry, progress=_end)


def _end(_label: str, _part: float) -> None:
    """End a flight at its first sample, because a shorter flight of a route would be refused."""
    raise InputError("A flight of `warm_up` ends here.")


def _fly_alone(
    plan: Plan,
    scenario: Scenario,
    number: int,
    wind_runs: dict[str, Run],
    probes: Probes,
    *,
    again: bool = False,
) -> Row:
    """Outcome of one flight by its number; `wind_runs` as for `fly_in_wind`."""
    began, group = time.perf_counter(), plan.group_of(number)
    entry = plan.entry(group, scenario)
    try:
        run = fly_in_wind(entry, wind_runs)
        measured = measures(run)
        wall_s = time.perf_counter() - began
        columns = _outcome(plan, scenario, group, wall_s, (run.status, run.reason, measured))
        # Requirements decide nothing in a count, which has probes.
        again |= number % EVERY == 0
        again |= not probes and decides(entry, measured, success=columns["success"])
        if entry.plant.aircraft is not None:
            columns[COMPILED] = CompiledFlights.of(run, again=again and run.compiled)
        if again:
            source = entry.wind_from or entry
            flown = wind_runs.get(source.label, run)
            if flown.compiled:
                # Others of the draw need not repeat it: their wind is that of JSBSim.
                wind_runs[source.label] = check_compiled(source, flown, of=f"run {number}, ")
    except OF_A_FLIGHT as error:
        return _invalid(error, began)
    if run.status == "completed" or any(getattr(x, "any_end", False) for x in probes.values()):
        columns |= {name: probe(run, scenario) for name, probe in probes.items()}
    elif probes and "along" in run.signals and len(run.signals):  # rows of campaigns stay unchanged
        along = float(run.signals["along"].iloc[-1])
        stretch = planned_route(scenario).reference.path.stretch_at(along).words
        columns["reason"] += f" It was on the {stretch}, {along:.0f} m along."
    return columns


def _outcome(
    plan: Plan, scenario: Scenario, group: Group, wall_s: float, result: FlightResult
) -> Row:
    """Columns of a flight from ``status`` on, except R_K, I_K and E_K."""
    status, reason, measured = result
    tables = scenario.expected(group.plant, group.gains)
    measures_of_row = {**measured, **_of_loop(plan, group)}
    misses = missed(tables, status, reason, measures_of_row, calm=scenario.calm)
    columns: Row = {"status": status, "reason": reason, "success": not misses}
    columns |= {"missed": "; ".join(misses), **dict.fromkeys(MEASURES)}
    for subject, values in measured.items():
        columns |= {f"{subject}.{name}": _number(value) for name, value in values.items()}
    return columns | {"wall_s": wall_s}


@lru_cache(maxsize=32)  # equal for all draws, and slower than a flight of the kernel
def _of_loop(plan: Plan, group: Group) -> Mapping[str, Mapping[str, float]]:
    """Measures of the undispersed loop of a group that its requirements bound."""
    return bounded_loop(plan.scenario.expected(group.plant, group.gains), plan.entry(group))


def _unflown(status: str, reason: str) -> Row:
    return {"status": status, "reason": reason, "success": False, "missed": f"{status}: {reason}"}


def _invalid(error: FlightTuneError, began: float) -> Row:
    reason = " ".join(str(error).split())
    return {**_unflown("invalid", reason), "wall_s": time.perf_counter() - began}


def _row(plan: Plan, run: int, drawn: Drawn, outcome: Row, indicators: Indicators = UNKNOWN) -> Row:
    group, (R_K, I_K, E_K) = plan.group_of(run), indicators
    names = {"run": run, "draw": plan.draw_of(run), "plant": group.plant, "gains": group.gains}
    return {**names, **drawn, **outcome, "R_K": R_K, "I_K": I_K, "E_K": E_K}


def _number(value: float | None) -> float | None:
    """The number, or None for NaN."""
    return value if value == value else None


def _indicators(plan: Plan, group: Group, scenarios: Sequence[Scenario]) -> list[Indicators]:
    """R_K, I_K and E_K of a group's linear loop in each scenario; None without gains or a loop."""
    law, gains = plan.entry(group).law, plan.gain_sets[group.gains]
    if gains is None or not law.by_gains:
        return [UNKNOWN] * len(scenarios)
    # key of a draw's loop: often it is not dispersed, and all draws share a loop
    keys = [
        (s.flight.V_a_mps, s.flight.g_mps2, reference_of(s).initial[1], s.controller)
        for s in scenarios
    ]
    cached = _indicators_known(plan, group)
    values: dict[Hashable, Indicators] = {key: cached[key] for key in keys if key in cached}
    if new := {key: s for key, s in zip(keys, scenarios, strict=True) if key not in values}:
        loops = loops_of([linear_model(scenario, law) for scenario in new.values()], gains)
        both = indicators_batch(loops)
        E_K = largest_errors(loops, errors=len(gains.errors)).max(axis=1)
        columns = (map(_number, each.tolist()) for each in (both.R_K, both.I_K, E_K))
        values |= zip(new, zip(*columns, strict=True), strict=True)
        cached.clear()
        cached.update(values)
    return [values[key] for key in keys]


@lru_cache(maxsize=32)
def _indicators_known(_plan: Plan, _group: Group) -> dict[Hashable, Indicators]:
    """Cached indicators of the last loops of a group, for draws that do not disperse its loop."""
    return {}
