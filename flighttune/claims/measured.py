"""Signals that a count keeps of each flight, in windows."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray, Floats
from flighttune.base.errors import InputError
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.planning.plan import Plan
from flighttune.claims.about import About
from flighttune.claims.shape import MAX_WINDOWS, MIN_LEARNED, window_edges
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps.watch import SignalModel

# Relative tolerance of repeated computations: other machines add up in another order.
SAME = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured(ABC):
    """Counted signals of a flight. Each kind of count has its own class."""

    units: Mapping[str, str]  # unit by signal
    models: tuple[SignalModel, ...] = ()  # models that flights teach and the file keeps

    min_learned: ClassVar[int] = MIN_LEARNED  # minimum number of learning flights
    max_windows: ClassVar[int] = MAX_WINDOWS

    @classmethod
    @abstractmethod
    def chosen(cls, plan: Plan, signals: Iterable[str] | None) -> Self:
        """Signals for a new count of the flights of a plan; `signals`: requested names."""

    @classmethod
    def of(cls, about: About, scenario: Scenario, plant: str) -> Self:
        """Signals from a file, for flights of a plant in a scenario."""
        del scenario, plant
        return cls(units=about.signals)

    @property
    def room(self) -> Floats:
        """Factors on the learned half-widths, one for each signal or for all."""
        return 1.0

    @abstractmethod
    def values(self, run: Run, scenario: Scenario) -> FloatArray:
        """The signals of a run of this scenario, shape (samples, signals)."""

    def lost(self, run: Run, scenario: Scenario) -> bool:
        """Whether the values are invalid for a completed run, which then counts as outside."""
        del run, scenario
        return False

    def windows(
        self, central: Scenario, samples: int, flights: int, per_unit: float
    ) -> npt.NDArray[np.integer]:
        """First samples of the windows of a flight, and the last sample of all.

        `per_unit` is the number of samples in a second or a metre.
        """
        del central, per_unit
        return window_edges(samples, flights, len(self.units), most=self.max_windows)

    def teaching(self, learned: int) -> int:
        """Number of learning flights that teach models before the others teach the shape."""
        del learned
        return 0

    def taught(self, pool: WorkerPool, plan: Plan, learned: int) -> Self:
        """The signals with models taught by the first flights of a plan."""
        del pool, plan, learned
        return self

    def check(self, pool: WorkerPool, plan: Plan, learned: int) -> None:
        """Refuse units and models that differ from the flights of a plan."""
        del pool, learned
        if [*self.chosen(plan, self.units).units.items()] != [*self.units.items()]:
            raise InputError("`signals` must have the units of the flights.")
