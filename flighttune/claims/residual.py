"""Counts of residual signals: bounds on what the identified model of an aircraft misses."""

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
    """What a model misses of a flight."""

    model: ConformantModel

    max_windows: ClassVar[int] = MAX_RESIDUAL_WINDOWS

    @classmethod
    def chosen(cls, plan: Plan, signals: Iterable[str] | None) -> Self:
        """All residual signals, of the plant of a plan."""
        del signals
        return cls._of_plant(RESIDUALS, plan.scenario, plan.groups[0].plant)

    @classmethod
    def of(cls, about: About, scenario: Scenario, plant: str) -> Self:
        """Signals that a file states, of the model identified of a plant."""
        return cls._of_plant(about.signals, scenario, plant)

    @classmethod
    def _of_plant(cls, units: Mapping[str, str], scenario: Scenario, plant: str) -> Self:
        scenario.check_over_time("a band of residual signals")
        return cls(units=units, model=conformant_model(scenario, plant))

    def values(self, run: Run, scenario: Scenario) -> FloatArray:
        """The residuals from each sample to the next, shape (samples - 1, signals)."""
        return residuals_of(self.model, run, start_condition(scenario))

    def lost(self, run: Run, scenario: Scenario) -> bool:
        """Whether the path angle gave way to the airspeed, which the model does not know."""
        del scenario
        return bool(given_way(run).any())


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Residual(SignalBounds):
    """Bounds on what the identified model of an aircraft misses: what `tube` takes.

    They are of the rates of course and path angle (rad/s), and of roll and its change over a sample
    (rad), actual minus model.

    Attributes
    ----------
    about, flights, extremes, wind, endings, compiled, scores, scale : as of a `Band`

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7}
    >>> ft.residual("feasible", start_deg=2.0, **few).outside
    0
    """

    of: ClassVar[Of] = "residual"
    measures: ClassVar[type[Measured]] = ResidualSignals
    # They last from a sample to the next, and have no window but that of its time.
    rounding: ClassVar[float] = SAME_TIME

    @property
    def model(self) -> ConformantModel:
        """The point mass behind a lag whose residuals they are."""
        assert isinstance(self.measured, ResidualSignals)  # of a count of this kind
        return self.measured.model

    @property
    def _leaves(self) -> str:
        return "leaves the band of its residual signals"
