"""Tune a fixed-wing outer loop with a certificate, and see what the full aircraft makes of it.

Everything is imported on first use: ``import flighttune`` itself costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flighttune.campaign.engine.engine import run_campaign
    from flighttune.campaign.planning.load import load_campaign
    from flighttune.campaign.planning.plan import Plan, plan_campaign
    from flighttune.campaign.planning.schema import Campaign
    from flighttune.certificates import (
        Certificate,
        certify,
        load_certificate,
        save_certificate,
        verify,
    )
    from flighttune.comparison import Comparison, compare
    from flighttune.control.controller import (
        Controller,
        FlightCondition,
        LawSetup,
        Measured,
        ReferenceSample,
    )
    from flighttune.control.exact_law import ExactLaw, command_gains, rate_gains
    from flighttune.control.gains import PAPER_GAINS, PIGains
    from flighttune.control.inner_loop import InnerLag
    from flighttune.control.limits import CommandLimiter, Limits
    from flighttune.control.linear_model import LinearModel, closed_loop, kinematic_model
    from flighttune.control.mimo_pi import MimoPI
    from flighttune.errors import FlightTuneError
    from flighttune.flight.fly import FlownScenario, fly
    from flighttune.flight.gap import Gap, explain_gap
    from flighttune.flight.outer_loop import certify_scenario, tune_scenario, tuning_problem
    from flighttune.flight.refly import refly
    from flighttune.identify.file import load_identified, save_identified
    from flighttune.identify.identify import identify_aircraft
    from flighttune.metrics import channel_metrics, flight_metrics
    from flighttune.plants.base import COMMON_SIGNALS, Plant, Stop
    from flighttune.plants.jsbsim.plant import JSBSimPlant
    from flighttune.plants.lagged import LaggedPlant
    from flighttune.plants.point_mass import PointMassPlant
    from flighttune.plants.sensors import Sensors
    from flighttune.recording.load import Recording, load_recording
    from flighttune.recording.notebook import plot, show
    from flighttune.recording.record import record
    from flighttune.report.page import Report, write_report
    from flighttune.scenario import Scenario, load_gains, load_scenario, scenario_from
    from flighttune.simulate.reference import Reference
    from flighttune.simulate.run import Provenance, Run
    from flighttune.theory.indicators import Indicators, indicators, indicators_batch
    from flighttune.tuning.problem import TuningProblem
    from flighttune.tuning.result import TuningResult
    from flighttune.tuning.tune import tune

__version__ = "0.1.0"

_HOMES = {
    "campaign.engine.engine": "run_campaign",
    "campaign.planning.load": "load_campaign",
    "campaign.planning.plan": "Plan plan_campaign",
    "campaign.planning.schema": "Campaign",
    "certificates": "Certificate certify load_certificate save_certificate verify",
    "comparison": "Comparison compare",
    "control.controller": "Controller FlightCondition LawSetup Measured ReferenceSample",
    "control.exact_law": "ExactLaw command_gains rate_gains",
    "control.gains": "PAPER_GAINS PIGains",
    "control.inner_loop": "InnerLag",
    "control.limits": "CommandLimiter Limits",
    "control.linear_model": "LinearModel closed_loop kinematic_model",
    "control.mimo_pi": "MimoPI",
    "errors": "FlightTuneError",
    "flight.fly": "FlownScenario fly",
    "flight.gap": "Gap explain_gap",
    "flight.outer_loop": "certify_scenario tune_scenario tuning_problem",
    "flight.refly": "refly",
    "identify.file": "load_identified save_identified",
    "identify.identify": "identify_aircraft",
    "metrics": "channel_metrics flight_metrics",
    "plants.base": "COMMON_SIGNALS Plant Stop",
    "plants.jsbsim.plant": "JSBSimPlant",
    "plants.lagged": "LaggedPlant",
    "plants.point_mass": "PointMassPlant",
    "plants.sensors": "Sensors",
    "recording.load": "Recording load_recording",
    "recording.notebook": "plot show",
    "recording.record": "record",
    "report.page": "Report write_report",
    "scenario": "Scenario load_gains load_scenario scenario_from",
    "simulate.reference": "Reference",
    "simulate.run": "Provenance Run",
    "theory.indicators": "Indicators indicators indicators_batch",
    "tuning.problem": "TuningProblem",
    "tuning.result": "TuningResult",
    "tuning.tune": "tune",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "COMMON_SIGNALS",
    "Campaign",
    "Certificate",
    "CommandLimiter",
    "Comparison",
    "Controller",
    "ExactLaw",
    "FlightCondition",
    "FlightTuneError",
    "FlownScenario",
    "Gap",
    "Indicators",
    "InnerLag",
    "JSBSimPlant",
    "LaggedPlant",
    "LawSetup",
    "Limits",
    "LinearModel",
    "Measured",
    "MimoPI",
    "PAPER_GAINS",
    "PIGains",
    "Plan",
    "Plant",
    "PointMassPlant",
    "Provenance",
    "Recording",
    "Reference",
    "ReferenceSample",
    "Report",
    "Run",
    "Scenario",
    "Sensors",
    "Stop",
    "TuningProblem",
    "TuningResult",
    "certify",
    "certify_scenario",
    "channel_metrics",
    "closed_loop",
    "command_gains",
    "compare",
    "explain_gap",
    "flight_metrics",
    "fly",
    "identify_aircraft",
    "indicators",
    "indicators_batch",
    "kinematic_model",
    "load_campaign",
    "load_certificate",
    "load_gains",
    "load_identified",
    "load_recording",
    "load_scenario",
    "plan_campaign",
    "plot",
    "rate_gains",
    "record",
    "refly",
    "run_campaign",
    "save_certificate",
    "save_identified",
    "scenario_from",
    "show",
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
