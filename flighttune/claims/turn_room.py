"""Room to turn back: how far flights go beyond their flight geography, and the volume with it."""

from dataclasses import dataclass

from flighttune.references.maps import Volume

# Signals of flights that turn back, m, each the largest since they detected that they must: the
# horizontal distance from the route, in any direction, and that of height from where they detected.
ROOM = {"from_route": "m", "height": "m"}


@dataclass(frozen=True, slots=True)
class TurnRoom:
    """Room that a flight needs which turns back, m: no width and no height of a volume."""

    from_route: float  # in any horizontal direction
    height: float  # above and below

    def around(self, geography: Volume, claim: str) -> Volume:
        """The volume with this room around a flight geography, down to the ground at most."""
        width, high = geography.width + self.from_route, geography.high + self.height
        return Volume(width, max(geography.low - self.height, 0.0), high, claim)
