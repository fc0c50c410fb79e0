"""The public names and their modules: read by type checkers, and by `flighttune` itself."""

from flighttune import gym as gym
from flighttune import loop as loop
from flighttune.adoption.adopt import adopt as adopt
from flighttune.campaign.band import band as band
from flighttune.campaign.band import monitor as monitor
from flighttune.campaign.band import residual as residual
from flighttune.campaign.band import tube as tube
from flighttune.campaign.beside import compare as compare
from flighttune.campaign.claims import Verified as Verified
from flighttune.campaign.claims import load as load
from flighttune.campaign.claims import verify as verify
from flighttune.campaign.engine.engine import run_campaign as run_campaign
from flighttune.campaign.engine.progress import CampaignObserver as CampaignObserver
from flighttune.campaign.meet import meet as meet
from flighttune.campaign.meeting import Meeting as Meeting
from flighttune.campaign.mission import mission as mission
from flighttune.campaign.refly import refly as refly
from flighttune.campaign.worst import WorstFlight as WorstFlight
from flighttune.campaign.worst import worst as worst
from flighttune.certificates.bound import RateBound as RateBound
from flighttune.certificates.certificate import Certificate as Certificate
from flighttune.certificates.make import Certification as Certification
from flighttune.claims.band import Band as Band
from flighttune.claims.band import Residual as Residual
from flighttune.control.gains import PAPER_GAINS as PAPER_GAINS
from flighttune.control.gains import PIGains as PIGains
from flighttune.errors import FlightTuneError as FlightTuneError
from flighttune.errors import InputError as InputError
from flighttune.errors import RecordingError as RecordingError
from flighttune.errors import ScenarioError as ScenarioError
from flighttune.exports.export import export as export
from flighttune.flight.flown import FlownScenario as FlownScenario
from flighttune.flight.fly import fly as fly
from flighttune.flight.gains import certify as certify
from flighttune.flight.gains import frontier as frontier
from flighttune.flight.gains import tune as tune
from flighttune.flight.load import load_scenario as load_scenario
from flighttune.flight.route import PlannedRoute as PlannedRoute
from flighttune.flight.route import route as route
from flighttune.gaps.gap import Gap as Gap
from flighttune.gaps.gap import gap as gap
from flighttune.identification.design import design as design
from flighttune.logs.identify import identify as identify
from flighttune.logs.log import load_log as load_log
from flighttune.planning.plan import Plan as Plan
from flighttune.planning.plan import plan_campaign as plan_campaign
from flighttune.planning.schema import Campaign as Campaign
from flighttune.planning.source import Flights as Flights
from flighttune.planning.source import flights as flights
from flighttune.planning.source import load_campaign as load_campaign
from flighttune.plants.jsbsim.trims import trim as trim
from flighttune.recording.record import record as record
from flighttune.recording.record import show as show
from flighttune.records.compare import Comparison as Comparison
from flighttune.records.parquet import Recording as Recording
from flighttune.records.refly import Reflown as Reflown
from flighttune.reports.claim import plot as plot
from flighttune.reports.report import report as report
from flighttune.scenario.load import load_gains as load_gains
from flighttune.scenario.load import scenario_from as scenario_from
from flighttune.scenario.schema import Scenario as Scenario
from flighttune.simulate.run import Run as Run
from flighttune.tubes.enclosure import Tube as Tube
from flighttune.tuning.result import TuningResult as TuningResult

__version__: str

def modules_of(namespace: str) -> dict[str, str]: ...
def public_value(namespace: str, name: str) -> object: ...
