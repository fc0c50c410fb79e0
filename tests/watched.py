"""Level turns of the Aerosonde, healthy or with a fault, for monitors."""

import flighttune as ft
from flighttune.flight.entry import entry_of
from flighttune.flight.fly import fly_alone


def turn(seconds, chi_deg, gamma_deg=0.0, **plant):
    """The scenario of a turn of so many seconds from this start; `plant` is added to its table.

    Its reference begins where that of the shipped scenario does, as counted flights have it.
    """
    start = {"duration_s": seconds, "chi_deg": chi_deg, "gamma_deg": gamma_deg}
    changes = {f"flight.{key}": value for key, value in start.items()}
    changes |= {"reference.chi_from_deg": 0.0}
    tables = ft.load_scenario("level_turn", changes=changes).as_dict() | {"expect": []}
    tables["plant"] = [x | plant for x in tables["plant"] if x["kind"] == "jsbsim"]
    return ft.scenario_from(tables)


def stuck(from_s):
    """What adds an aileron that sticks from a time on to a plant."""
    return {"airframe": {"fault": {"from_s": from_s, "aileron_stuck_deg": 5.0}}}


def flown(scenario):
    """Its flight with the paper's gains."""
    return fly_alone(entry_of(scenario, "paper", ft.PAPER_GAINS))
