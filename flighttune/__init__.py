"""Tune a fixed-wing outer loop with a certificate, and see what the full aircraft makes of it.

Everything is imported on first use: ``import flighttune`` itself costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flighttune.certificates import (
        Certificate,
        certify,
        load_certificate,
        save_certificate,
        verify,
    )
    from flighttune.comparison import Comparison, compare
    from flighttune.control.closed_loop import closed_loop
    from flighttune.control.gains import PAPER_GAINS, PIGains
    from flighttune.control.limits import Limits
    from flighttune.control.linear_model import LinearModel, kinematic_model
    from flighttune.control.mimo_pi import MimoPI
    from flighttune.errors import FlightTuneError
    from flighttune.flight import FlownScenario, fly
    from flighttune.gap.explain import Gap, explain_gap
    from flighttune.metrics import channel_metrics, flight_metrics
    from flighttune.outer_loop import certify_scenario, tune_scenario, tuning_problem
    from flighttune.plants.base import FlightCondition
    from flighttune.plants.identification.file import load_identified, save_identified
    from flighttune.plants.jsbsim.identify import identify_aircraft
    from flighttune.plants.jsbsim.plant import JSBSimPlant
    from flighttune.plants.kinematic import KinematicPlant
    from flighttune.recording.load import Recording, load_recording
    from flighttune.recording.record import record
    from flighttune.report.page import Report, write_report
    from flighttune.scenario import Scenario, load_gains, load_scenario, scenario_from
    from flighttune.simulate.reference import Reference
    from flighttune.simulate.run import Run
    from flighttune.theory.indicators import Indicators, indicators, indicators_batch
    from flighttune.tuning.problem import TuningProblem
    from flighttune.tuning.result import TuningResult
    from flighttune.tuning.tune import tune

__version__ = "0.1.0"

_HOMES = {
    "certificates": ("Certificate", "certify", "load_certificate", "save_certificate", "verify"),
    "comparison": ("Comparison", "compare"),
    "control.closed_loop": ("closed_loop",),
    "control.gains": ("PAPER_GAINS", "PIGains"),
    "control.limits": ("Limits",),
    "control.linear_model": ("LinearModel", "kinematic_model"),
    "control.mimo_pi": ("MimoPI",),
    "errors": ("FlightTuneError",),
    "flight": ("FlownScenario", "fly"),
    "outer_loop": ("certify_scenario", "tune_scenario", "tuning_problem"),
    "gap.explain": ("Gap", "explain_gap"),
    "metrics": ("channel_metrics", "flight_metrics"),
    "plants.base": ("FlightCondition",),
    "plants.identification.file": ("load_identified", "save_identified"),
    "plants.jsbsim.identify": ("identify_aircraft",),
    "plants.jsbsim.plant": ("JSBSimPlant",),
    "plants.kinematic": ("KinematicPlant",),
    "recording.load": ("Recording", "load_recording"),
    "recording.record": ("record",),
    "report.page": ("Report", "write_report"),
    "scenario": ("Scenario", "load_gains", "load_scenario", "scenario_from"),
    "simulate.reference": ("Reference",),
    "simulate.run": ("Run",),
    "theory.indicators": ("Indicators", "indicators", "indicators_batch"),
    "tuning.problem": ("TuningProblem",),
    "tuning.result": ("TuningResult",),
    "tuning.tune": ("tune",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "PAPER_GAINS",
    "Certificate",
    "Comparison",
    "FlightCondition",
    "FlightTuneError",
    "FlownScenario",
    "Gap",
    "Indicators",
    "JSBSimPlant",
    "KinematicPlant",
    "Limits",
    "LinearModel",
    "MimoPI",
    "PIGains",
    "Recording",
    "Reference",
    "Report",
    "Run",
    "Scenario",
    "TuningProblem",
    "TuningResult",
    "certify",
    "certify_scenario",
    "channel_metrics",
    "closed_loop",
    "compare",
    "explain_gap",
    "flight_metrics",
    "fly",
    "identify_aircraft",
    "indicators",
    "indicators_batch",
    "kinematic_model",
    "load_certificate",
    "load_gains",
    "load_identified",
    "load_recording",
    "load_scenario",
    "record",
    "save_certificate",
    "save_identified",
    "scenario_from",
    "tune",
    "tune_scenario",
    "tuning_problem",
    "verify",
    "write_report",
]


def __getattr__(name: str) -> Any:
    home = _HOME_OF.get(name)
    if home is None:
        raise AttributeError(f"module 'flighttune' has no attribute {name!r}")
    return getattr(import_module(f"flighttune.{home}"), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
