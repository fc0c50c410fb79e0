"""Draws of the kinematic law, flown many at once."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import NamedTuple, cast

import numpy as np

from flighttune.control.exact_law import ExactLaw
from flighttune.control.gains import PIGains
from flighttune.control.law import Law
from flighttune.control.mimo_pi import MimoPI
from flighttune.flight.conditions import command_limits, reference_of, start_condition
from flighttune.flight.models import law_setup
from flighttune.metrics import CHANNELS, MEASURED, measures_of, required_names
from flighttune.plants.point_mass import rolled_over
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.simulate.batch import SIGNALS, BatchResult, fly_sampled
from flighttune.simulate.disturbance import Sinusoid

# `BatchResult.ends` of a flight that ended at 90 deg of roll
ROLLED = 1


# Signals of a batch that measures are taken of
MEASURED_HERE = tuple(name for name in SIGNALS if name in MEASURED)


class FlightResult(NamedTuple):
    """Status and measures of one flight."""

    status: str
    reason: str
    measured: Mapping[str, Mapping[str, float]]  # as `flighttune.metrics.measures`


def batchable(scenario: Scenario, table: PlantTable, law: Law) -> bool:
    """Whether law, plant, air, disturbance and reference are ones that the kernel flies."""
    acting = scenario.disturbance.sinusoid() if scenario.disturbance else Sinusoid()
    followed = scenario.reference or scenario.route
    parts = law, table.family, acting, followed
    return not scenario.windy and all(part is not None and part.batched for part in parts)


def alike(scenario: Scenario) -> Hashable:
    """Key of the scenarios that one call of the kernel can fly: controller, time axis, inputs."""
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
    """Fly one gain set on the kinematic plant in many `batchable` scenarios that are `alike`.

    The bits of each flight do not depend on the others. None stands for a flight that has to be
    flown alone to know why it ended.
    """
    controller, duration = scenarios[0].controller, scenarios[0].flight.duration_s
    dt = 1.0 / controller.rate_hz
    t = np.arange(round(duration / dt) + 1, dtype=np.float64) * dt
    instants = t if _moving(scenarios[0]) else np.zeros(1)
    references = [reference_of(scenario) for scenario in scenarios]
    conditions = [start_condition(scenario) for scenario in scenarios]
    ref = np.array([np.column_stack(reference.sampled(instants)) for reference in references])
    batch = fly_sampled(
        # the plant itself has no limits
        [
            cast("MimoPI | ExactLaw", law.make(law_setup(s, gains, command_limits(s))))
            for s in scenarios
        ],
        conditions,
        ref,
        duration=duration,
        ref_rates=np.array(
            [np.column_stack(reference.rates(instants)) for reference in references]
        ),
        disturbances=[s.disturbance.sinusoid() if s.disturbance else Sinusoid() for s in scenarios],
        sensors=[s.sensors.sensors(s.seed) for s in scenarios if s.sensors is not None],
        g=np.array([scenario.flight.g_mps2 for scenario in scenarios]),
    )
    from flighttune.simulate.kernel import error_measures

    required = required_names([table.model_dump() for table in scenarios[0].expect])
    for i in range(len(scenarios)):
        if batch.ends[i] > ROLLED:
            yield None
            continue
        n = batch.samples[i]
        columns = {name: batch.signal(name)[i, :n] for name in MEASURED_HERE}
        columns["V_a"] = np.full(n, conditions[i].V_a)  # what the law assumes
        columns["n_z"] = np.append(conditions[i].n_z_start, columns["n_z_cmd"][:-1])
        for channel, values in zip(CHANNELS, ref[i].T, strict=True):
            columns[f"{channel}_ref"] = np.array(np.broadcast_to(values[:n], n))
        measured = measures_of(t[:n], columns, required, error_measures) if n > 1 else {}
        yield FlightResult(*_status(batch, i), measured)


def _status(batch: BatchResult, i: int) -> tuple[str, str]:
    """Status and reason of a flight that was completed or rolled over."""
    if batch.ends[i] != ROLLED:
        return "completed", ""
    last = batch.samples[i] - 1
    phi, n_z = (float(batch.signal(name)[i, last]) for name in ("phi_cmd", "n_z_cmd"))
    return "diverged", rolled_over(phi, n_z, float(batch.t[last])).reason
