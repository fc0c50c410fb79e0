"""What can be exported: the paper's law, in still air."""

from flighttune.control.gains import PIGains
from flighttune.control.limits import Limits
from flighttune.control.mimo_pi import MimoPI
from flighttune.errors import InputError
from flighttune.flight.fly import controller_of
from flighttune.scenario.schema import Scenario


def exported_law(scenario: Scenario, name: str, gains: PIGains, limits: Limits) -> MimoPI:
    """The controller of a scenario that other programs can be given.

    Parameters
    ----------
    scenario : Scenario
    name : str
        Of the gain set, with its law.
    gains : PIGains
    limits : Limits
        Of the commands.

    Raises
    ------
    InputError
        If `name` or `gains` are of another law than the paper's; the message names it.
    """
    law = scenario.law_of(name)[0] if ":" in name else None
    controller = None
    if law is None or law.kind != "python":
        controller = controller_of(scenario, name, gains, limits)
    if isinstance(controller, MimoPI):
        return controller
    kind = "python" if law is not None and law.kind == "python" else "exact"
    raise InputError(
        f"`gains` must be flown by the paper's law to be exported, got {name!r} of the law "
        f"{law.name if law else kind!r} ({kind})."
    )
