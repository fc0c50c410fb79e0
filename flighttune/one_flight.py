"""One gain set on one plant: a scenario's law, limits and manoeuvre to a run."""

import platform
import time
from collections.abc import Callable
from functools import cache
from importlib.metadata import version

import pandas as pd

from flighttune.control.gains import PIGains
from flighttune.control.limits import Limits
from flighttune.control.mimo_pi import MimoPI
from flighttune.errors import TrimError
from flighttune.plants.base import Plant
from flighttune.scenario.schema import Scenario
from flighttune.simulate.loop import LOOP_SIGNALS, simulate
from flighttune.simulate.run import Provenance, Run, RunStatus

VERSIONED = ("flighttune", "numpy", "scipy", "pandas", "jsbsim")

Progress = Callable[[str, float], None]
"""Called with the label of a run and the part of it flown, 0 to 1."""


def fly_once(
    scenario: Scenario,
    plant: Plant,
    gains: PIGains | None,
    *,
    plant_label: str,
    gains_name: str,
    limits: Limits | None = None,
    progress: Progress | None = None,
) -> Run:
    """Fly the manoeuvre of a scenario once.

    Parameters
    ----------
    scenario : Scenario
        What to fly, and the settings of the controller.
    plant : Plant
        A plant that was not flown before.
    gains : PIGains or None
        None where tuning found none: the run then says so.
    plant_label, gains_name : str
        Names in the run's label.
    limits : Limits, optional
        Of the commands; by default those of the scenario and of the plant.
    progress : callable, optional
        Told how far the run is.

    Returns
    -------
    Run
        One that diverged, left the envelope, hit the ground or could not start says so in its
        status and reason.

    Raises
    ------
    PlantError
        If an aircraft cannot be built.
    """
    started = time.perf_counter()
    if gains is None:
        reason = "tuning found no gains that meet the constraints"
        signals, status = _no_signals(), "no_gains"
    else:
        told = progress and (lambda part: progress(f"{plant_label} / {gains_name}", part))
        limits = scenario.limits.limits().within(plant.limits) if limits is None else limits
        signals, status, reason = _time_history(scenario, plant, gains, limits, told)
    made_by = _provenance(scenario, plant_label, gains_name, gains, time.perf_counter() - started)
    return Run(signals=signals, status=status, reason=reason, provenance=made_by)


def unflown(
    scenario: Scenario,
    gains: PIGains,
    status: RunStatus,
    reason: str,
    *,
    plant_label: str,
    gains_name: str,
) -> Run:
    """The run of a flight that could not begin, for a status and reason known before it.

    Parameters
    ----------
    scenario : Scenario
        What was to be flown.
    gains : PIGains
        Gains that were to be flown.
    status, reason : str
        Why it was not.
    plant_label, gains_name : str
        Names in the run's label.
    """
    made_by = _provenance(scenario, plant_label, gains_name, gains, 0.0)
    return Run(signals=_no_signals(), status=status, reason=reason, provenance=made_by)


def _provenance(
    scenario: Scenario, plant_label: str, gains_name: str, gains: PIGains | None, wall: float
) -> Provenance:
    return Provenance(
        scenario=scenario.as_dict(),
        plant=plant_label,
        gains_name=gains_name,
        gains=gains,
        seed=scenario.seed,
        versions=library_versions(),
        wall_s=wall,
    )


def _time_history(
    scenario: Scenario,
    plant: Plant,
    gains: PIGains,
    limits: Limits,
    progress: Callable[[float], None] | None,
) -> tuple[pd.DataFrame, RunStatus, str]:
    settings, duration = scenario.controller, scenario.flight.duration_s
    controller = MimoPI(
        gains,
        limits,
        dt=1.0 / settings.rate_hz,
        anti_windup=settings.anti_windup,
        tracking_time=settings.tracking_time_s,
        schedule_speed=scenario.flight.V_a_mps if settings.schedule else None,
    )
    try:
        history = simulate(
            plant,
            controller,
            scenario.followed(),
            condition=scenario.condition,
            duration=duration,
            feed_forward=settings.feed_forward,
            sensors=scenario.sensors and scenario.sensors.sensors(scenario.seed),
            progress=None if progress is None else lambda t: progress(t / duration),
        )
    except TrimError as error:
        return _no_signals(), "no_trim", str(error)
    if progress is not None:
        progress(1.0)
    if history.stop is not None:
        return history.signals, history.stop.status, history.stop.reason
    return history.signals, "completed", ""


def _no_signals() -> pd.DataFrame:
    return pd.DataFrame(columns=pd.Index(LOOP_SIGNALS), index=pd.Index([], name="t"), dtype=float)


def library_versions() -> dict[str, str]:
    """Version of every library that shapes the numbers of a flight."""
    return dict(_installed())


@cache
def _installed() -> tuple[tuple[str, str], ...]:
    """Names and versions, looked up once: it takes as long as a tenth of a flight."""
    python = ("python", platform.python_version())
    return (python, *((name, version(name)) for name in VERSIONED))
