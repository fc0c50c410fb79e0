"""A gust as JSBSim's step takes it, in JSBSim and compiled."""

from typing import Literal, NamedTuple, TypeAlias

BodyAxis: TypeAlias = Literal["ahead", "right", "down"]


class GustNumbers(NamedTuple):
    """A 1-cosine gust."""

    first: float  # step in which it begins
    rise: float  # s
    hold: float  # s
    fall: float  # s
    size: float  # ft/s
    # Direction in the body when it begins
    ahead: float
    right: float
    down: float
