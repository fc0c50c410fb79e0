"""How one limited command moves in continuous time: its modes, and when it changes between them."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from flighttune.control.mimo_pi import AntiWindup

FOLLOW, HOLD, UP, DOWN = 0, 1, 2, 3
INF = math.inf


class Mode(NamedTuple):
    """What a command does until one of its margins is used up.

    Attributes
    ----------
    motion : int
        FOLLOW (the command is what the controller wants), HOLD (it stands still), UP or DOWN (it
        moves at its rate limit).
    side : int
        Sign of wanted minus command; 0 where anti-windup keeps the two together at a limit.
    taking : bool
        False where conditional anti-windup stops the integrator.
    bound : float
        End of the range that a moving command meets next.
    """

    motion: int
    side: int = 0
    taking: bool = True
    bound: float = INF


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitedCommand:
    """One command u that follows v, what the controller wants, as its limits let it.

    With ``a`` the rate of the proportional part and ``b`` the rate at which the integral part z
    grows without limits, v' = a + z'. The command moves towards ``clip(v, lower, upper)`` at its
    rate limit where the two differ, and with it where they are equal and the rate is permitted.

    Attributes
    ----------
    lower, upper : float, input unit
        Range.
    rate_lower, rate_upper : float, input unit per second
        Range of the rate; where infinite the command is ``clip(v, lower, upper)`` itself.
    anti_windup : {"none", "conditional", "back_calculation"}
        See Notes.
    lead : float, 1/s
        Inverse of the tracking time; 0 unless `anti_windup` is back-calculation.

    Notes
    -----
    ``none`` has z' = b, ``back_calculation`` z' = b - lead (v - u). ``conditional`` stops the
    integrator where it would drive v further from u: z' = 0 if (v - u) b > 0, else z' = b. On
    v = u at a limit that right-hand side jumps, and the solution is Filippov's: where both sides
    drive v to u the two stay together and z' = u' - a lies between 0 and b. These are the limits of
    the three discrete rules of `MimoPI` as its sample time goes to zero.
    """

    lower: float
    upper: float
    rate_lower: float
    rate_upper: float
    anti_windup: AntiWindup
    lead: float

    def start(self, u: float, v: float) -> tuple[float, bool]:
        """Command in force after t = 0 if it was `u` before, and whether it equals `v`."""
        target = self.clip(v)
        if (target > u and self.rate_upper == INF) or (target < u and self.rate_lower == -INF):
            u = target
        return u, u == v

    def clip(self, v: float) -> float:
        """Return `v` moved into the range."""
        return min(max(v, self.lower), self.upper)

    def apart(self, u: float, v: float, b: float, side: int) -> Mode:
        """Mode in which command `u` and wanted `v` differ, v on the given `side` of u."""
        target = self.clip(v)
        motion = HOLD if u == target else UP if u < target else DOWN
        return Mode(motion, side, self._taken(side, b) == b, self._next_bound(motion, u))

    def together(self, u: float, a: float, b: float) -> Mode:
        """Mode that follows where command and wanted are equal, `a` and `b` the rates of v."""
        lowest, highest = self._permitted(u)
        v_dot = a + b
        if lowest <= v_dot <= highest and lowest != highest:
            return Mode(FOLLOW)
        rate = highest if v_dot > highest else lowest
        motion = HOLD if rate == 0.0 else UP if rate > 0.0 else DOWN
        if a + self._taken(1, b) > rate:
            side = 1
        elif a + self._taken(-1, b) < rate or self.anti_windup != "conditional":
            side = -1
        else:
            side = 0
        return Mode(motion, side, self._taken(side, b) == b, self._next_bound(motion, u))

    def rates(self, mode: Mode, excess: float, a: float, b: float) -> tuple[float, float]:
        """Rates of command and integral part; the command's is 0 where it is given by v."""
        if mode.motion == FOLLOW:
            return 0.0, b
        u_dot = self._rate(mode.motion)
        if mode.side == 0:
            return u_dot, u_dot - a
        return u_dot, b - self.lead * excess if mode.taking else 0.0

    def margins(self, mode: Mode, u: float, v: float, a: float, b: float) -> tuple[float, ...]:
        """Four numbers that are positive while `mode` lasts; the first is of v - u if side != 0."""
        motion, side, taking, _ = mode
        if motion == FOLLOW:
            v_dot = a + b
            return self.upper - v, v - self.lower, self.rate_upper - v_dot, v_dot - self.rate_lower
        if side == 0:
            z_dot = self._rate(motion) - a
            return z_dot - min(b, 0.0), max(b, 0.0) - z_dot, _to_bound(mode, u), INF
        corner = (-side * b if taking else side * b) if self.anti_windup == "conditional" else INF
        return side * (v - u), corner, _to_bound(mode, u), INF

    def _next_bound(self, motion: int, u: float) -> float:
        if motion == UP:
            return self.lower if u < self.lower else self.upper
        return self.upper if u > self.upper else self.lower

    def _rate(self, motion: int) -> float:
        return 0.0 if motion == HOLD else self.rate_upper if motion == UP else self.rate_lower

    def _taken(self, side: int, b: float) -> float:
        return 0.0 if self.anti_windup == "conditional" and side * b > 0.0 else b

    def _permitted(self, u: float) -> tuple[float, float]:
        if u > self.upper:
            return self.rate_lower, self.rate_lower
        if u < self.lower:
            return self.rate_upper, self.rate_upper
        return (
            self.rate_lower if u > self.lower else 0.0,
            self.rate_upper if u < self.upper else 0.0,
        )


def _to_bound(mode: Mode, u: float) -> float:
    return mode.bound - u if mode.motion == UP else u - mode.bound if mode.motion == DOWN else INF
