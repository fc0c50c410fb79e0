# SPDX-License-Identifier: LGPL-2.1-or-later
"""What is asked of JSBSim: an aircraft that it has loaded, in flight."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

Doubles: TypeAlias = npt.NDArray[np.float64]


class FlightDynamics(Protocol):
    """An aircraft in JSBSim; numbers are in JSBSim's units."""

    @property
    def steps(self) -> int:
        """Integration steps in a sample of the inner loop."""
        ...

    @property
    def rate(self) -> float:
        """Integration steps a second."""
        ...

    @property
    def engine_settles(self) -> float:
        """Time that an engine takes to a steady state, s; 0 where JSBSim knows it at once."""
        ...

    @property
    def attitude(self) -> tuple[Sequence[float], Sequence[float]]:
        """Roll, pitch and heading (rad) of ``ic/`` before the last ones were written, and those."""
        ...

    @property
    def run(self) -> Callable[[], bool]:
        """A function that flies one integration step."""
        ...

    def evaluate_again(self) -> None:
        """Evaluate flight control, forces and accelerations in flight; no time passes."""

    def earth_to_body(self) -> Doubles:
        """Rotation from the axes of the Earth to those of the body."""
        ...

    def reader(self, name: str) -> Callable[[], float]:
        """Return a function that reads a property."""
        ...

    def writer(self, name: str) -> Callable[[float], bool]:
        """Return a function that writes a property."""
        ...

    def has(self, name: str) -> bool:
        """Whether there is a property of that name that can be written."""
        ...

    def shows(self, name: str) -> bool:
        """Whether there is a property of that name."""
        ...

    def value(self, name: str, default: float) -> float:
        """The value of a property; a default where there is none of that name."""
        ...
