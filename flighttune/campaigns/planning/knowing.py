"""What the autopilots of flights know of their motion, where a verb is asked for it."""

from typing import Literal, TypeAlias, TypeVar

from flighttune.base.errors import InputError
from flighttune.campaigns.planning.schema import Campaign
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.navigation_keys import NavigationTable

# A grade of [navigation], or none of it.
Knowledge: TypeAlias = Literal["exact", "rtk", "standard", "poor"]

S = TypeVar("S", Scenario, Campaign)


def knowing(stated: S, navigation: Knowledge | None) -> S:
    """A scenario or campaign whose autopilots know their motion by a grade, or exactly.

    With None they know what is stated, and along a route, where nothing is, what a standard
    receiver and inertial unit give.
    """
    if isinstance(stated, Scenario):
        return _scenario(stated, navigation)
    drawn = [x.key for x in stated.disperse if x.key.startswith("navigation.")]
    if drawn and navigation == "exact":
        raise InputError(f"`navigation` must be a grade where `{drawn[0]}` is drawn, got exact.")
    both = {key: _scenario(getattr(stated, key), navigation) for key in ("nominal", "central")}
    return stated if both["nominal"] is stated.nominal else stated.model_copy(update=both)


def _scenario(scenario: Scenario, navigation: Knowledge | None) -> Scenario:
    table = scenario.navigation
    if navigation is None:
        if table is not None or scenario.route is None:
            return scenario
        table = NavigationTable()
    elif navigation == "exact":
        table = None
    else:
        table = (table or NavigationTable()).model_copy(update={"grade": navigation})
    if table == scenario.navigation:
        return scenario
    disturbance = scenario.disturbance
    if table is not None and disturbance is not None and disturbance.path == "air":
        raise InputError(
            '`navigation` must be exact with path = "air" of [disturbance], got '
            f"{navigation or 'standard'}."
        )
    return scenario.model_copy(update={"navigation": table})
