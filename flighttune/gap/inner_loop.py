"""The inner loop of the third rung: identified beforehand, or fitted to the flight itself."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flighttune.control.inner_loop import InnerLag
from flighttune.errors import ScenarioError
from flighttune.gap.lag_fit import FittedLag, fitted_lag, judged_lag
from flighttune.plants.identification.file import load_identified
from flighttune.plants.identification.model import IdentifiedAircraft
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run

LagSource = Literal["identified", "fitted"]


@dataclass(frozen=True, slots=True, kw_only=True)
class InnerLoop:
    """Lags of roll and load factor.

    Attributes
    ----------
    phi, n_z : FittedLag
        With the share of the flight's variance that each accounts for.
    source : "identified" or "fitted"
        From the aircraft's model file, or from this flight.
    """

    phi: FittedLag
    n_z: FittedLag
    source: LagSource

    @property
    def lags(self) -> tuple[InnerLag, InnerLag]:
        """Of roll and of load factor."""
        return self.phi.lag, self.n_z.lag


def inner_loop_of(
    aircraft: str, scenario: Scenario, run: Run, *, wanted: LagSource | None = None
) -> InnerLoop:
    """The inner loop of an aircraft that has flown.

    Parameters
    ----------
    aircraft : str
        Name or folder of the aircraft.
    scenario : Scenario
        The identified condition nearest to its airspeed and first climb is taken.
    run : Run
        The flight.
    wanted : {"identified", "fitted"}, optional
        By default identified, where the aircraft has a model file.

    Returns
    -------
    InnerLoop

    Raises
    ------
    ScenarioError
        If the model file cannot be used, or there is none and it is wanted.
    """
    t = run.signals.index.to_numpy(dtype=float)
    phi, n_z = (
        (run.signals[f"{name}_cmd"].to_numpy(), run.signals[name].to_numpy())
        for name in ("phi", "n_z")
    )
    model = None if wanted == "fitted" else _model(aircraft, required=wanted == "identified")
    if model is None:
        return InnerLoop(phi=fitted_lag(t, *phi), n_z=fitted_lag(t, *n_z), source="fitted")
    _, gamma = scenario.followed().sampled(np.zeros(1))
    roll, load = model.nearest(scenario.flight.V_a_mps, float(gamma[0])).lags
    return InnerLoop(
        phi=judged_lag(roll, t, *phi), n_z=judged_lag(load, t, *n_z), source="identified"
    )


def _model(aircraft: str, *, required: bool) -> IdentifiedAircraft | None:
    try:
        return load_identified(aircraft)
    except ScenarioError as error:
        if required or not isinstance(error.__cause__, FileNotFoundError):
            raise
        return None
