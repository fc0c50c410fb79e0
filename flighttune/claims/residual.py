"""Counts of residual signals: bounds on the errors of an aircraft's identified model."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.campaigns.planning.plan import Plan
from flighttune.claims.about import About, Of
from flighttune.claims.counted import SignalBounds
from flighttune.claims.measured import Measured
from flighttune.claims.shape import MAX_RESIDUAL_WINDOWS
from flighttune.flight.conditions import start_condition
from flighttune.flight.loop.run import Run, given_way
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps.residual import RESIDUALS, ConformantModel, conformant_model, residuals_of

# Rounding of the times of samples, s.
SAME_TIME = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualSignals(Measured):
    """Residuals of a model in a flight."""

    model: ConformantModel

    max_windows: ClassVar[int] = MAX_RESIDUAL_WINDOWS

    @classmethod
    def chosen(cls, plan: Plan, signals: Iterable[str] | None) -> Self:
        """All residual signals, of the plant of a plan."""
        del signals
        return cls._of_plant(RESIDUALS, plan.scenario, plan.groups[0].plant)

    @classmethod
    def of(cls, about: About, scenario: Scenario, plant: str) -> Self:
        """Signals from a file, for the identified model of a plant."""
        return cls._of_plant(about.signals, scenario, plant)

    @classmethod
    def _of_plant(cls, units: Mapping[str, str], scenario: Scenario, plant: str) -> Self:
        scenario.check_over_time("a band of residual signals")
        return cls(units=units, model=conformant_model(scenario, plant))

    def values(self, run: Run, scenario: Scenario) -> FloatArray:
        """The residuals from each sample to the next, shape (samples - 1, signals)."""
        return residuals_of(self.model, run.signals, start_condition(scenario))

    def lost(self, run: Run, scenario: Scenario) -> bool:
        """Whether airspeed priority changed the path angle, which the model does not include."""
        del scenario
        return bool(given_way(run.signals).any())


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Residual(SignalBounds):
    """Bounds on the residuals of an aircraft's identified model, for `tube`.

    They bound the rates of course and path angle (rad/s), and roll and its change over a sample
    (rad), actual minus model.

    Attributes
    ----------
    about, flights, extremes, wind, navigation, endings, compiled, scores, scale : as in a `Band`

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7}
    >>> ft.residual("feasible", start_deg=2.0, **few).outside
    0
    """

    of: ClassVar[Of] = "residual"
    measures: ClassVar[type[Measured]] = ResidualSignals
    # They hold from one sample to the next, and only the window of that time applies.
    rounding: ClassVar[float] = SAME_TIME

    @property
    def model(self) -> ConformantModel:
        """The model of the residuals: a point mass behind a lag."""
        assert isinstance(self.measured, ResidualSignals)  # in a count of this kind
        return self.measured.model

    @property
    def _leaves(self) -> str:
        return "leaves the band of its residual signals"
