"""Laws that can be exported: the paper's and the exact one, but none written in Python."""

from flighttune.control.exact_law import ExactLaw
from flighttune.control.gains import PIGains
from flighttune.control.limits import Limits
from flighttune.control.mimo_pi import MimoPI
from flighttune.errors import InputError
from flighttune.flight.fly import controller_of
from flighttune.scenario.schema import Scenario


def exported_law(
    scenario: Scenario, name: str, gains: PIGains, limits: Limits
) -> MimoPI | ExactLaw:
    """The controller of a scenario, if it can be exported.

    `name` is that of the gain set with its law. Raises InputError if `name` belongs to a law in
    Python; the message names it.
    """
    if scenario.is_own_law(name):
        raise refusal(name, scenario.law_of(name)[0].name, "paper or exact")
    return controller_of(scenario, name, gains, limits)


def refusal(name: str, law: str, allowed: str) -> InputError:
    """Why the gains of a law cannot be exported."""
    return InputError(
        f"`gains` must be flown by the law {allowed} to be exported, "
        f"got {name!r} of the law {law!r}."
    )
