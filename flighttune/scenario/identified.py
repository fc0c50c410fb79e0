"""The identified models a scenario is tuned on."""

from flighttune.plants.identification.file import load_identified
from flighttune.plants.identification.model import FlownModel, flown_model


def nearest_model(
    source: str, *, V_a: float, gamma: float, g: float, hold: float
) -> tuple[FlownModel]:
    """The chi/gamma law at one condition, behind the inner loop identified nearest to it.

    Parameters
    ----------
    source : str
        A model file, or an aircraft that has one.
    V_a, gamma : float, m/s and rad
        Airspeed and flight-path angle.
    g : float, m/s^2
    hold : float, s
        Delay of the controller: half its sample time.

    Returns
    -------
    tuple of one FlownModel

    Raises
    ------
    InputError, ScenarioError
        If there is no such aircraft, or no model file.
    """
    condition = load_identified(source).nearest(V_a, gamma)
    return (flown_model(condition, g=g, V_a=V_a, gamma=gamma, hold=hold),)


def all_models(
    source: str, *, schedule_speed: float | None, g: float, hold: float
) -> tuple[FlownModel, ...]:
    """The chi/gamma law at every condition identified, each behind its own inner loop.

    Parameters
    ----------
    source : str
        A model file, or an aircraft that has one.
    schedule_speed : float, m/s, or None
        Airspeed for which the gains are given, where they grow with airspeed.
    g : float, m/s^2
    hold : float, s
        Delay of the controller: half its sample time.

    Returns
    -------
    tuple of FlownModel
        In the order of the file.

    Raises
    ------
    InputError, ScenarioError
        If there is no such aircraft, or no model file.
    """
    return tuple(
        flown_model(condition, g=g, hold=hold, schedule_speed=schedule_speed)
        for condition in load_identified(source).conditions
    )
