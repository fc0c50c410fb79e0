"""Whatever flying a plan needs is loaded and compiled before the time of its runs is taken."""

from contextlib import suppress

from flighttune.campaign.flying.alone import fly_group, plant_table
from flighttune.campaign.flying.claim import claims
from flighttune.campaign.flying.kinematic_batch import batchable, fly_batch
from flighttune.campaign.planning.plan import Plan
from flighttune.errors import FlightTuneError

SAMPLES = 4


def warm_up(plan: Plan) -> None:
    """Fly the undispersed scenario of every group for a few samples, and make the claims.

    Parameters
    ----------
    plan : Plan
        What is refused here is so, with its reason, in every run.
    """
    scenario = plan.scenario
    short = scenario.flight.model_copy(update={"duration_s": SAMPLES / scenario.controller.rate_hz})
    scenario = scenario.model_copy(update={"flight": short})
    for group in plan.groups:
        gains = plan.gain_sets[group.gains]
        with suppress(FlightTuneError):
            if gains is not None and batchable(scenario, plant_table(scenario, group.plant)):
                fly_batch([scenario], gains, None)
            fly_group(plan, scenario, group)
    with suppress(FlightTuneError):
        claims(plan)
