"""An aircraft at its start, evaluated by machine code in place of JSBSim, to the bit."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NoReturn

from flighttune.base.errors import PlantError
from flighttune.compiled.evaluated import Evaluation, Loaded, Memory
from flighttune.compiled.properties import Unsupported
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.model_files import Unchanged
from flighttune.vehicles.plants.jsbsim.source import source_of


class LoadedFdm(Fdm):
    """An aircraft whose properties are read before and after its first evaluation."""

    loaded: Loaded | None = None

    def evaluate(self) -> None:
        """Evaluate, as `Fdm` does."""
        if self.loaded is not None:
            super().evaluate()
            return
        before = self.shown()
        super().evaluate()
        writable = tuple(filter(self.has, before))
        self.loaded = Loaded(before=before, after=self.shown(), writable=writable)

    def shown(self) -> dict[str, float]:
        """All properties."""
        return {name: self.value(name, 0.0) for name in sorted(self.names("")) if self.shows(name)}

    @property
    def known(self) -> Loaded:
        """What was read."""
        if self.loaded is None:
            raise PlantError(f"{self.config.file}: JSBSim must have evaluated the aircraft.")
        return self.loaded


@dataclass(frozen=True)
class Evaluator:
    """Makes aircraft before their flights, whatever their numbers, as `load` does.

    `other` makes those of another source.
    """

    evaluation: Evaluation
    other: Callable[[Unchanged, int, float], Fdm]

    def __call__(self, files: Unchanged, steps: int, ground: float) -> Fdm:
        """An aircraft with the numbers of its own, also one that has none."""
        source = source_of(files.config, steps, files)
        if source != self.evaluation.source:
            return self.other(files, steps, ground)
        return EvaluatedFdm(self, files, source.numbers, steps=steps, ground=ground)


class EvaluatedFdm(Memory, Fdm):
    """An aircraft before its flight, whose evaluations and settling are machine code."""

    def __init__(
        self,
        another: Evaluator,
        files: Unchanged,
        numbers: Mapping[str, float],
        *,
        steps: int,
        ground: float,
    ) -> None:
        self.files, self.config, self.steps, self.ground = files, files.config, steps, ground
        self._describe()
        self.another, self.run = another, self._refuse
        Memory.__init__(self, another.evaluation, numbers)
        self._read_engines()
        self._lift_off()
        self.evaluate()

    def start_engines(self) -> None:
        """Start those that do not run by their starters; JSBSim starts those that have none."""
        super().start_engines()
        if not (self.electric or all(read() for read in self._running)):
            raise Unsupported("an engine that stands in a trim")

    def _refuse(self) -> NoReturn:
        raise PlantError(f"{self._model}: an aircraft of machine code has no steps here.")

    def abandon(self) -> None:
        """Nothing: there is no instance of JSBSim."""
