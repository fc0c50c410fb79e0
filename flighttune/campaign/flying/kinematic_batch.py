"""Draws of the kinematic law, flown many at once with the bits of flights alone."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.campaign.flying.claim import FEWEST_SAMPLES, Claim
from flighttune.campaign.planning.schema import MEASURES
from flighttune.control.gains import PIGains
from flighttune.plants.sensors import Sensors
from flighttune.scenario.plant_table import PlantTable
from flighttune.scenario.reference_table import ReferenceTable
from flighttune.scenario.schema import ControllerTable, FlightTable, LimitsTable, Scenario
from flighttune.scenario.sensors_table import SensorsTable
from flighttune.scenario.weather_table import DisturbanceTable
from flighttune.simulate.batch import Flights, FlownBatch, fly_sampled
from flighttune.simulate.batch.flights import MEASURES as MEASURED
from flighttune.simulate.batch.flights import REASONS, SIGNALS

FLOWN_TOGETHER = 64
"""Flights whose signals are held in memory at once: as many as stay in the processor's cache."""

ROLLED = 1
"""Index into REASONS of a flight that ended at 90 deg of roll."""

KNOWN: Mapping[type, tuple[str, ...]] = {
    Scenario: (
        "title", "verifies", "source", "seed", "gains", "flight", "reference", "limits",
        "controller", "tuning", "disturbance", "sensors", "envelope", "expect", "plant",
    ),
    FlightTable: (
        "V_a_mps", "h_m", "chi_deg", "gamma_deg", "phi_deg", "n_z", "duration_s", "ground_m",
        "g_mps2",
    ),
    ReferenceTable: ("chi_deg", "gamma_deg"),
    LimitsTable: ("phi_deg", "phi_rate_dps", "n_z", "n_z_rate_per_s"),
    ControllerTable: ("rate_hz", "anti_windup", "tracking_time_s", "feed_forward", "schedule"),
    DisturbanceTable: (
        "chi_amplitude", "chi_omega_rad_s", "gamma_amplitude", "gamma_omega_rad_s", "as_wind",
        "path",
    ),
    SensorsTable: (
        "chi_bias_deg", "chi_noise_sd_deg", "gamma_bias_deg", "gamma_noise_sd_deg",
        "V_a_bias_mps", "V_a_noise_sd_mps", "noise_time_constant_s",
    ),
    PlantTable: ("kind",),
}  # fmt: skip
"""Keys of the tables that shape a kinematic flight, all of which the batch flies.

Heights, and how an aircraft meets the disturbance (``as_wind``, ``path``), are known to make no
difference. Whatever else a scenario says, its flight is not for the batch.
"""


class Settings(NamedTuple):
    """What all flights of one call share."""

    rate_hz: float
    duration_s: float
    anti_windup: Any
    tracking_time_s: float | None
    feed_forward: bool
    schedule: bool
    moving: bool
    sensed: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlownKinematic:
    """What came of one flight of a batch.

    Attributes
    ----------
    status, reason : str
        As the run alone has them; both empty where it has to be flown alone to know.
    measured : ndarray, length of `MEASURES`
    certified : str or None
    """

    status: str
    reason: str
    measured: FloatArray
    certified: str | None


def batchable(scenario: Scenario, table: PlantTable) -> bool:
    """Whether the flight of a plant in a scenario can be flown in a batch.

    It is one of the paper's law, and nothing in the scenario is unknown to the batch.

    Parameters
    ----------
    scenario : Scenario
        Of a draw.
    table : PlantTable
        The plant.
    """
    if table.kind != "kinematic" or not _knows(table):
        return False
    parts = (
        scenario, scenario.flight, scenario.reference, scenario.limits, scenario.controller,
        scenario.disturbance, scenario.sensors,
    )  # fmt: skip
    return all(part is None or _knows(part) for part in parts)


def _knows(table: Any) -> bool:
    known = KNOWN.get(type(table), ())
    return all(value is None or name in known for name, value in vars(table).items())


def fly_batch(
    scenarios: Sequence[Scenario], gains: PIGains, claim: Claim | None
) -> list[FlownKinematic]:
    """Fly one gain set of the kinematic law in many scenarios.

    Parameters
    ----------
    scenarios : sequence of Scenario
        `batchable` ones.
    gains : PIGains
    claim : Claim or None
        Looked at in each flight.

    Returns
    -------
    list of FlownKinematic
        In order of `scenarios`, with the bits of flights alone.
    """
    found: dict[int, FlownKinematic] = {}
    for settings, members in _alike(scenarios).items():
        for start in range(0, len(members), FLOWN_TOGETHER):
            together = members[start : start + FLOWN_TOGETHER]
            flown = _flown([scenarios[i] for i in together], gains, claim, settings)
            found.update(zip(together, flown, strict=True))
    return [found[i] for i in range(len(scenarios))]


def _alike(scenarios: Sequence[Scenario]) -> dict[Settings, list[int]]:
    alike: dict[Settings, list[int]] = {}
    for i, scenario in enumerate(scenarios):
        c, r = scenario.controller, scenario.reference
        settings = Settings(
            c.rate_hz, scenario.flight.duration_s, c.anti_windup, c.tracking_time_s,
            c.feed_forward, c.schedule,
            isinstance(r.chi_deg, list) or isinstance(r.gamma_deg, list),
            scenario.sensors is not None,
        )  # fmt: skip
        alike.setdefault(settings, []).append(i)
    return alike


def _flown(
    scenarios: Sequence[Scenario], gains: PIGains, claim: Claim | None, settings: Settings
) -> Iterator[FlownKinematic]:
    dt = 1.0 / settings.rate_hz
    t = np.arange(round(settings.duration_s / dt) + 1, dtype=np.float64) * dt
    at = t if settings.moving else np.zeros(1)
    conditions = [scenario.condition for scenario in scenarios]
    flights = Flights(
        K=np.repeat(gains.K[None], len(scenarios), axis=0),
        start=np.array([(c.chi, c.gamma, c.phi, c.n_z_start, c.V_a) for c in conditions]),
        ref=np.array([np.column_stack(scenario.followed().sampled(at)) for scenario in scenarios]),
        bounds=np.array([_bounds(scenario) for scenario in scenarios]),
        waves=np.array([_wave(scenario) for scenario in scenarios]),
    )
    batch = fly_sampled(
        flights,
        dt=dt,
        duration=settings.duration_s,
        anti_windup=settings.anti_windup,
        tracking_time=settings.tracking_time_s,
        schedule_speed=flights.start[:, 4] if settings.schedule else None,
        feed_forward=settings.feed_forward,
        sensors=_sensors(scenarios),
        trajectories=True,
        g=np.array([scenario.flight.g_mps2 for scenario in scenarios]),
        threads=1,
    )
    measured, certified = _measured(flights, batch), _certified(flights, batch, claim)
    clock = np.add.accumulate(np.concatenate([[0.0], np.full(len(t) - 1, dt)]))
    for i in range(len(scenarios)):
        status, reason = _ended(batch, i, float(clock[batch.samples[i] - 1]))
        yield FlownKinematic(
            status=status, reason=reason, measured=measured[i], certified=certified[i]
        )


def _bounds(scenario: Scenario) -> tuple[FloatArray, ...]:
    limits = scenario.limits.limits()  # the plant itself has none
    return limits.lower, limits.upper, limits.rate_lower, limits.rate_upper


def _wave(scenario: Scenario) -> tuple[float, float, float, float]:
    if scenario.disturbance is None:
        return 0.0, 0.0, 0.0, 0.0
    wave = scenario.disturbance.sinusoid()
    return wave.chi_amplitude, wave.chi_omega, wave.gamma_amplitude, wave.gamma_omega


def _sensors(scenarios: Sequence[Scenario]) -> list[Sensors]:
    """One a flight, none where there are none."""
    return [one.sensors.sensors(one.seed) for one in scenarios if one.sensors is not None]


def _signals(batch: FlownBatch, names: Iterable[str]) -> list[FloatArray]:
    return [np.ascontiguousarray(batch.signal(name)) for name in names]


def _measured(flights: Flights, batch: FlownBatch) -> FloatArray:
    """`MEASURES` of each flight, shape (N, measures); NaN for flights of one sample."""
    chi_err, gamma_err, n_z = _signals(batch, ("chi_err", "gamma_err", "n_z_cmd"))
    N = len(flights)
    n_z[np.arange(N), batch.samples - 1] = np.nan  # not flown any more
    start, flown = flights.start[:, 3], n_z
    columns = {
        **{f"chi.{name}": batch.metric(name)[:, 0] for name in MEASURED},
        **{f"gamma.{name}": batch.metric(name)[:, 1] for name in MEASURED},
        "chi.peak_rad": np.fmax.reduce(np.abs(chi_err), axis=1),
        "gamma.peak_rad": np.fmax.reduce(np.abs(gamma_err), axis=1),
        "flight.V_a_dev_mps": np.zeros(N),
        "flight.n_z_min": np.fmin(start, np.fmin.reduce(flown, axis=1)),
        "flight.n_z_max": np.fmax(start, np.fmax.reduce(flown, axis=1)),
    }
    none = np.full(N, np.nan)
    table = np.column_stack([columns.get(name, none) for name in MEASURES])
    table[batch.samples < 2] = np.nan
    return table


def _certified(flights: Flights, batch: FlownBatch, claim: Claim | None) -> list[str | None]:
    verdicts: list[str | None] = [None] * len(flights)
    whole = np.flatnonzero(batch.ends == 0)
    if claim is None or not len(whole) or len(batch.t) < FEWEST_SAMPLES:
        return verdicts
    chi, gamma, chi_err, gamma_err = (
        signal[whole] for signal in _signals(batch, ("chi", "gamma", "chi_err", "gamma_err"))
    )
    ref = np.broadcast_to(flights.ref, (len(flights), len(batch.t), 2))[whole]
    found = claim.of(
        batch.t,
        errors=(chi_err, gamma_err),
        references=(np.ascontiguousarray(ref[..., 0]), np.ascontiguousarray(ref[..., 1])),
        flown=(chi, gamma),
    )
    for i, verdict in zip(whole.tolist(), found.tolist(), strict=True):
        verdicts[i] = verdict
    return verdicts


def _ended(batch: FlownBatch, i: int, t: float) -> tuple[str, str]:
    """Status and reason at the time `t` of the plant's clock; empty where the batch cannot say."""
    end = int(batch.ends[i])
    if end == 0:
        return "completed", ""
    if end != ROLLED:
        return "", ""
    phi, n_z = (float(batch.last[i, SIGNALS.index(name)]) for name in ("phi_cmd", "n_z_cmd"))
    return "diverged", REASONS[ROLLED].format(phi_deg=math.degrees(phi), n_z=n_z, t=t)
