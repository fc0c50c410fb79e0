"""Draws of the kinematic law, flown many at once."""

from collections.abc import Collection, Hashable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.law import Law
from flighttune.flight.outer_loop import law_setup
from flighttune.metrics import METRICS
from flighttune.plants.base import FlightCondition
from flighttune.plants.point_mass import rolled_over
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.simulate.batch import SIGNALS, BatchResult, fly_sampled
from flighttune.simulate.disturbance import Sinusoid

# `BatchResult.ends` of a flight that ended at 90 deg of roll
ROLLED = 1

# Keys of a scenario that the kernel does not fly: with one of them a flight is flown alone.
#
# `tests/campaign/test_kinematic_batch.py` flies every key of a scenario both ways and fails for a
# key it has not tried, so that a new key is either flown by the kernel or named here.
NOT_IN_BATCH = (
    *("wind", "gust", "turbulence", "reference.shape", "route"),
    *("disturbance.wave", "disturbance.chi_phase_deg", "disturbance.gamma_phase_deg"),
    *("disturbance.chi_switch_s", "disturbance.gamma_switch_s"),
)


class FlightResult(NamedTuple):
    """Status and measures of one flight."""

    status: str
    reason: str
    measured: Mapping[str, Mapping[str, float]]  # as `flighttune.metrics.measures`


def batchable(
    scenario: Scenario,
    table: PlantTable,
    law: Law,
    dispersed: Collection[str] = (),
) -> bool:
    """Whether the kernel knows the law, the plant, and everything in the scenario.

    Keys decide and their values do not, so that the answer is the same for all draws that give
    values to the `dispersed` keys.
    """
    if not (law.batched and table.family.batched):
        return False
    return not any(
        _has(scenario, key) or any(f"{other}.".startswith(f"{key}.") for other in dispersed)
        for key in NOT_IN_BATCH
    )


def _has(scenario: Scenario, key: str) -> bool:
    value: Any = scenario
    for name in key.split("."):
        value = getattr(value, name, None)
    return value is not None


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
    at = t if _moving(scenarios[0]) else np.zeros(1)
    references = [scenario.followed() for scenario in scenarios]
    conditions = [scenario.condition for scenario in scenarios]
    ref = np.array([np.column_stack(reference.sampled(at)) for reference in references])
    batch = fly_sampled(
        # the plant itself has no limits
        [law.make(law_setup(s, gains, s.command_limits)) for s in scenarios],
        conditions,
        ref,
        duration=duration,
        ref_rates=np.array([np.column_stack(reference.rates(at)) for reference in references]),
        disturbances=[s.disturbance.sinusoid() if s.disturbance else Sinusoid() for s in scenarios],
        sensors=[s.sensors.sensors(s.seed) for s in scenarios if s.sensors is not None],
        trajectories=True,
        g=np.array([scenario.flight.g_mps2 for scenario in scenarios]),
        threads=1,
    )
    measures = _measured(conditions, batch)
    for i in range(len(scenarios)):
        if batch.ends[i] > ROLLED:
            yield None
            continue
        measured = {
            subject: {name: float(values[i]) for name, values in columns.items()}
            for subject, columns in (measures.items() if batch.samples[i] > 1 else ())
        }
        yield FlightResult(*_status(batch, i), measured)


def _measured(
    conditions: Sequence[FlightCondition], batch: BatchResult
) -> dict[str, dict[str, FloatArray]]:
    """Measures of each flight, shape (N,) each, as `flighttune.metrics.measures` names them."""
    N = len(conditions)
    n_z_cmd = batch.signal("n_z_cmd").copy()
    n_z_cmd[np.arange(N), batch.samples - 1] = np.nan  # not flown any more
    n_z = np.column_stack([[condition.n_z_start for condition in conditions], n_z_cmd])
    both = {name: batch.measure(name) for name in METRICS}
    both["peak_rad"] = np.column_stack(
        [np.fmax.reduce(np.abs(batch.signal(name)), axis=1) for name in ("chi_err", "gamma_err")]
    )
    flight = {
        "V_a_dev_mps": np.zeros(N),
        "n_z_min": np.fmin.reduce(n_z, axis=1),
        "n_z_max": np.fmax.reduce(n_z, axis=1),
    }
    channels = {
        channel: {name: values[:, i] for name, values in both.items()}
        for i, channel in enumerate(("chi", "gamma"))
    }
    return {**channels, "flight": flight}


def _status(batch: BatchResult, i: int) -> tuple[str, str]:
    """Status and reason of a flight that was completed or rolled over."""
    if batch.ends[i] != ROLLED:
        return "completed", ""
    phi, n_z = (float(batch.last[i, SIGNALS.index(name)]) for name in ("phi_cmd", "n_z_cmd"))
    return "diverged", rolled_over(phi, n_z, float(batch.t[batch.samples[i] - 1])).reason
