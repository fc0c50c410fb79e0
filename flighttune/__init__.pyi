"""The public names and their modules: read by type checkers, and by `flighttune` itself."""

from flighttune import compiled as compiled
from flighttune import gym as gym
from flighttune import loop as loop
from flighttune.base.errors import FlightTuneError as FlightTuneError
from flighttune.base.errors import InputError as InputError
from flighttune.base.errors import RecordingError as RecordingError
from flighttune.base.errors import ScenarioError as ScenarioError
from flighttune.base.files.code import in_jsbsim as in_jsbsim
from flighttune.campaigns.engine.engine import run_campaign as run_campaign
from flighttune.campaigns.engine.progress import CampaignObserver as CampaignObserver
from flighttune.campaigns.planning.plan import Plan as Plan
from flighttune.campaigns.planning.plan import plan_campaign as plan_campaign
from flighttune.campaigns.planning.schema import Campaign as Campaign
from flighttune.campaigns.planning.source import Flights as Flights
from flighttune.campaigns.planning.source import flights as flights
from flighttune.campaigns.planning.source import load_campaign as load_campaign
from flighttune.claims.band import Band as Band
from flighttune.claims.mission import mission as mission
from flighttune.claims.residual import Residual as Residual
from flighttune.claims.tubes.enclosure import Tube as Tube
from flighttune.claims.verbs import band as band
from flighttune.claims.verbs import monitor as monitor
from flighttune.claims.verbs import residual as residual
from flighttune.claims.verbs import tube as tube
from flighttune.claims.verify import Verified as Verified
from flighttune.claims.verify import load as load
from flighttune.claims.verify import verify as verify
from flighttune.control.certificates.bound import RateBound as RateBound
from flighttune.control.certificates.certificate import Certificate as Certificate
from flighttune.control.certificates.make import Certification as Certification
from flighttune.control.gains import PAPER_GAINS as PAPER_GAINS
from flighttune.control.gains import PIGains as PIGains
from flighttune.control.tuning.result import TuningResult as TuningResult
from flighttune.flight.flown import FlownScenario as FlownScenario
from flighttune.flight.fly import fly as fly
from flighttune.flight.gains import certify as certify
from flighttune.flight.gains import frontier as frontier
from flighttune.flight.gains import tune as tune
from flighttune.flight.gradient import Gradient as Gradient
from flighttune.flight.gradient import gradient as gradient
from flighttune.flight.load import load_scenario as load_scenario
from flighttune.flight.loop.run import Run as Run
from flighttune.flight.records.parquet import Recording as Recording
from flighttune.flight.records.refly import Reflown as Reflown
from flighttune.flight.route import PlannedRoute as PlannedRoute
from flighttune.flight.route import route as route
from flighttune.flight.scenario.load import load_gains as load_gains
from flighttune.flight.scenario.load import scenario_from as scenario_from
from flighttune.flight.scenario.schema import Scenario as Scenario
from flighttune.gaps.compare import Comparison as Comparison
from flighttune.gaps.gap import Gap as Gap
from flighttune.gaps.gap import gap as gap
from flighttune.logs.identify import identify as identify
from flighttune.logs.log import load_log as load_log
from flighttune.outputs.exports.export import export as export
from flighttune.outputs.live.open import open as open
from flighttune.outputs.pages.claim import plot as plot
from flighttune.outputs.pages.report import report as report
from flighttune.outputs.recording.record import record as record
from flighttune.outputs.recording.record import show as show
from flighttune.studies.adoption.adopt import adopt as adopt
from flighttune.studies.beside import compare as compare
from flighttune.studies.meet import meet as meet
from flighttune.studies.meeting import Meeting as Meeting
from flighttune.studies.refly import refly as refly
from flighttune.studies.worst import WorstFlight as WorstFlight
from flighttune.studies.worst import worst as worst
from flighttune.vehicles.identification.design import design as design
from flighttune.vehicles.trims import trim as trim

__version__: str

def modules_of(namespace: str) -> dict[str, str]: ...
def public_value(namespace: str, name: str) -> object: ...
