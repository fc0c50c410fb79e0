"""``[route.ending]``: a flight that leaves its route at one place to turn back, circle or glide."""

import math
from dataclasses import replace
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from flighttune.base import quantities as q
from flighttune.routes import turns
from flighttune.routes.follow import RouteReference
from flighttune.routes.path import BEYOND_S, PULL_UP_N_Z, PULL_UP_S, STEP, Ability, Path, laid_from

Manoeuvre: TypeAlias = Literal["turn_back", "circle", "straight"]

# Circles after which a flight that circles has ended.
CIRCLES = 2.0

# Distance per height over ground of the path of a glide: no powered aircraft glides further.
GLIDE = 30.0


class RouteEndingTable(q.Table):
    """``[route.ending]``: a level path from one place of the route on, until the flight ends."""

    # turn_back: to the start of the route, or two circles if a turn is wider than the way there;
    # circle: two circles; as tight as the route's turns
    kind: Manoeuvre
    at_m: Annotated[q.Finite, Field(ge=0.0)] | None = None  # along the route; nowhere if left out
    side: Literal[-1, 1] = 1  # right positive

    def followed(
        self, reference: RouteReference, ability: Ability, height: float
    ) -> RouteReference:
        """The reference of a flight that leaves the route; `height`: of its start over ground."""
        if self.at_m is None:
            return reference
        path = reference.path
        i = min(math.ceil(self.at_m / STEP), len(path.north) - 2)
        ended = self._path(path, i, ability, height + float(path.up[i]))
        V = reference.airspeeds
        if V is not None:
            V = np.append(V[:i], np.full(len(ended.north) - i, V[i]))
        return replace(reference, path=ended, airspeeds=V)

    def _path(self, path: Path, i: int, ability: Ability, height: float) -> Path:
        """The path up to its point `i`, and then the manoeuvre."""
        pose = turns.Pose(float(path.north[i]), float(path.east[i]), float(path.course[i]))
        home = float(path.north[0]), float(path.east[0])
        pieces = self._pieces(pose, float(path.curvature[i]), home, ability, height)
        north, east, course, curvature = laid_from(pose, pieces)
        # The climb ends like the changes of climb of a route.
        first = float(path.slope[i])
        bend = abs(math.atan(first)) / (ability.g * PULL_UP_N_Z)
        over = ability.V_a * max(PULL_UP_S, ability.V_a * bend)
        s = STEP * np.arange(len(north))
        slope = first * np.clip(1.0 - s / over, 0.0, 1.0)
        rise = first * np.where(s < over, s - 0.5 * s * s / over, 0.5 * over)
        columns = {
            "north": north,
            "east": east,
            "course": course,
            "curvature": curvature,
            "up": path.up[i] + rise,
            "slope": slope,
        }
        joined = {name: np.append(getattr(path, name)[:i], x) for name, x in columns.items()}
        length = STEP * i + sum(piece.length for piece in pieces[:-1])
        begun = tuple(x for x in path.stretches if x.start <= STEP * i)
        return Path(length=length, stretches=begun, **joined)

    def _pieces(
        self,
        pose: turns.Pose,
        before: float,
        home: tuple[float, float],
        ability: Ability,
        height: float,
    ) -> turns.Pieces:
        """The manoeuvre from a pose and curvature of the path, and a piece beyond its end."""
        beyond = BEYOND_S * ability.speed
        if self.kind == "straight":
            rolling = abs(ability.rolling(before))
            glide = turns.Piece(GLIDE * height, 0.0, 0.0)
            return turns.Piece(rolling, before, 0.0), glide, turns.Piece(beyond, 0.0, 0.0)
        k = self.side * ability.curvature
        into = turns.Piece(abs(ability.rolling(k) - ability.rolling(before)), before, k)
        if self.kind == "turn_back":
            x, y, turned = turns.curved([into])
            rolled = turns.Pose(*pose.beside(x, y), pose.course + turned)
            if back := turns.back_to(home, rolled, k, ability.rolling(abs(k))):
                return into, *back, turns.Piece(beyond, 0.0, 0.0)
        circles = turns.Piece(CIRCLES * math.tau / abs(k), k, k)
        return into, circles, turns.Piece(beyond, k, k)
