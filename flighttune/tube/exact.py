r"""One sample of the exact law for a whole set of flights.

The commanded rates are affine in errors and integrals; roll ``atan(a/b)`` and load factor
``b / cos(phi)`` follow from the lifts a and b that they need, and the point mass turns them back
into the commanded rates, so that the errors of enclosing these functions cancel to second order.
While a command is limited, the integrator of its channel is stopped. That is a discontinuity: a
piece with flights on both sides is split, and each half records its side.
"""

import math
from collections.abc import Sequence

import numpy as np

from flighttune.tube.forms import UP, Flags, Form, Pieces, combined
from flighttune.tube.functions import (
    arctangent,
    cosine_of,
    positive_part,
    product,
    secant,
    secant_change,
)
from flighttune.tube.interval import LARGEST_ANGLE, Interval, cosine
from flighttune.tube.sample import (
    CLIMB,
    COMPUTED,
    EXTRA_LIFT,
    FRESH_SYMBOLS,
    GAMMA,
    PHI,
    PHI_INTEGRAL,
    ROLL_UNBOUNDED,
    Channel,
    Controlled,
    Cut,
    Enclosure,
    Inversion,
    Plan,
    SampledLoop,
    Unbounded,
    ordered,
)

OVERLAP = 1e-9
"""Overlap of the halves of a piece, rad and 1: by rounding, a computed flight may be on the other
side of a limit than the exact one."""

SYMBOLS_AFTER_ROLL = 6
"""Number of symbols that a sample adds after those of the roll command: two integrals, load factor,
lift, course and path angle."""

STEEPEST_ROLL = 14.0
"""Largest tangent of a roll command before limits: 86 deg."""

FREE, LIMITED, OPEN = -1, 1, 0
"""Whether no flight of a piece is beyond a limit, all are, or it is not known."""


def enclosure_of(loop: SampledLoop, pieces: Pieces, plan: Plan) -> Enclosure:
    """The enclosure of a loop, by its law."""
    kind = Enclosure if loop.inversion is None else ExactEnclosure
    return kind(loop, pieces, plan)


class ExactEnclosure(Enclosure):
    """An `Enclosure` of the exact law."""

    overlap = OVERLAP

    def _controlled(self, k: int) -> Controlled:
        pieces, inversion = self.pieces, self.loop.inversion
        assert inversion is not None
        # Side of each limit on which all flights of a piece are, by channel and by above or below.
        self._sides = np.full((len(pieces), 2, 2), OPEN)
        # A pass begins only if it leaves room for the symbols behind the loop.
        last = pieces.used + FRESH_SYMBOLS - SYMBOLS_AFTER_ROLL
        while True:
            # A pass that splits by the load factor leaves a constraint on the symbol of its roll
            # command, and the next pass linearises roll anew. So that symbol is kept although no
            # row of the state has it: used again, the constraint would speak of another error.
            if pieces.used >= last:
                raise Unbounded("pieces are split too often in one sample")
            self._excesses = []
            state = pieces.forms()
            errors = self._errors(k, state)
            a, b = self._lifts(k, state, errors, inversion)
            across, up = self._range(a), self._range(b)
            self._check_plain(errors, across, up, inversion)
            # Roll and load factor come one after the other: the law inverts exactly with the roll
            # that is commanded, so that the load factor must see roll after its limits.
            wanted = arctangent(a, across, b, up).widened(COMPUTED)
            x = combined((1.0, wanted), (-1.0, state[PHI]))
            turning = self._channel(0, x, state[PHI], self._range(state[PHI]), errors)
            if self._fewer_or_more([turning]):
                continue
            # One symbol for the error of roll: lift and load factor share it, so that it cancels
            # where the point mass turns them back into rates.
            phi = pieces.fresh(
                combined((1.0, state[PHI]), (1.0, self._move(0, turning))).widened(COMPUTED), PHI
            )
            lifting = self._lifting(state, errors, phi, b)
            if not self._fewer_or_more([turning, lifting]):
                break
        self._note_limits(k, [turning, lifting])
        extra = self._vertical(lifting, phi, b)
        limited = [self._held(i, channel) for i, channel in enumerate((turning, lifting))]
        integrals = self._kept(
            [
                self._integrated(channel, state[PHI_INTEGRAL + i], *limited[i])
                for i, channel in enumerate((turning, lifting))
            ]
        )
        seen = self._angle(state[self.loop.seen], "roll")
        can_limit = [bool((~free).any()) for free, _ in limited]
        return Controlled(state, errors, seen, phi, extra, 0.0, integrals, can_limit)

    def _lifts(
        self, k: int, state: Sequence[Form], errors: Sequence[Form], inversion: Inversion
    ) -> tuple[Form, Form]:
        """Horizontal and vertical lift that the commanded rates need, in weights."""
        turn, climb = (
            combined(
                *zip(law.K_P, errors, strict=True),
                (1.0, state[PHI_INTEGRAL + i]),
                shift=inversion.rates[k, i],
            )
            for i, law in enumerate(self.loop.channels)
        )
        # The exact law needs ``a = V/g cos(gamma) chi_dot`` and ``b = V/g gamma_dot + cos(gamma)``.
        path = self._angle(state[GAMMA], CLIMB)
        level, speed = cosine_of(state[GAMMA], path), inversion.speed
        across = product(level, cosine(path), turn, self._range(turn))
        a = combined((speed, across)).widened(COMPUTED)
        return a, combined((speed, climb), (1.0, level)).widened(COMPUTED)

    def _check_plain(
        self, errors: Sequence[Form], a: Interval, b: Interval, inversion: Inversion
    ) -> None:
        """Stop where the law may do other than invert: that is not enclosed."""
        law = self.loop.channels[1]
        if not (b.low > inversion.lift_floor).all():
            raise Unbounded("the vertical lift wanted can be at its floor")
        # The largest load factor is enough for both lifts, or for b at the largest roll.
        stop = max(abs(self.loop.channels[0].lower), self.loop.channels[0].upper)
        together = (a.largest**2 + b.high**2) * UP
        steep = b.high * UP < law.upper * math.cos(min(stop, math.pi / 2))
        if not (steep | (together < law.upper**2)).all():
            raise Unbounded("the lift wanted can be more than the largest load factor")
        if not (a.largest < STEEPEST_ROLL * b.low).all():
            raise Unbounded("the roll wanted can be next to 90 deg")
        climb = self._range(combined(*zip(law.K_P, errors, strict=True))).largest
        if not (climb * inversion.speed * law.K_P[1] * UP < inversion.brake).all():
            raise Unbounded("the path-angle error can be so large that the law brakes")

    def _channel(
        self, i: int, x: Form, force: Form, values: Interval, errors: Sequence[Form]
    ) -> Channel:
        law = self.loop.channels[i]
        increment = combined(*zip(law.K_I_half, errors, strict=True))
        # Splits are at the limits themselves: the integrator stops there, whatever the increment.
        at = Interval.point(np.zeros(len(self.pieces)))
        sides = [
            self._excess(x, force, values, 1.0, law.upper, law.step_up),
            self._excess(x, force, values, -1.0, -law.lower, -law.step_down),
        ]
        for side, excess in enumerate(sides):
            if excess is not None:
                known_sides = self._sides[:, i, side]
                low, high = excess.values.low, excess.values.high
                # The halves of a split overlap: a flight on a known side is beyond it by OVERLAP at
                # most. Without this bound the enclosure would hold flights that are not there.
                low = np.where(known_sides == LIMITED, np.maximum(low, -OVERLAP), low)
                high = np.where(known_sides == FREE, np.minimum(high, OVERLAP), high)
                sides[side] = excess._replace(values=Interval(low, high))
                self._excesses.append((sides[side], i, side))
        return Channel(x, increment, at, *sides)

    def _lifting(
        self, state: Sequence[Form], errors: Sequence[Form], phi: Form, b: Form
    ) -> Channel:
        """The load factor ``b / cos(phi)`` before its limits.

        The load factor in force is v / cos(phi) of the roll before: the difference is
        ``(b - v) / cos(phi)`` plus v times what one over the cosine changes. Each load factor
        enclosed by itself would seem to meet its rate limit.
        """
        before, roll = (self._angle(angle, "roll") for angle in (state[PHI], phi))
        v = state[EXTRA_LIFT]
        more, change = combined((1.0, b), (-1.0, v)), combined((1.0, phi), (-1.0, state[PHI]))
        values, by = self._range(v), ordered(self._range(change))
        if not ((before + by).largest < LARGEST_ANGLE).all():
            raise Unbounded(ROLL_UNBOUNDED)
        # 1/cos(phi+) - 1/cos(phi), from the change of roll: the difference of two secants that are
        # enclosed one by one would be as wide as both.
        less_steep = secant_change(state[PHI], before, change, by)
        x = combined(
            (1.0, product(more, self._range(more), secant(phi, roll), _one_over(cosine(roll)))),
            (-1.0, product(v, values, less_steep, ordered(self._range(less_steep)))),
        )
        steep = _one_over(cosine(before))
        # The load factor in force, n_z = v / cos(phi): the rate limit acts on n_z, not on v.
        force = product(v, values, secant(state[PHI], before), steep)
        return self._channel(1, x.widened(COMPUTED), force, values * steep, errors)

    def _vertical(self, lifting: Channel, phi: Form, b: Form) -> Form:
        """The load-factor command after its limits times the cosine of the roll command."""
        less = self._held_back(1, lifting)
        if less is None:
            return b.widened(COMPUTED)
        roll = self._angle(phi, "roll")
        # Limits act on n_z; in terms of the vertical lift they take off as much times cos(phi).
        part = product(less, ordered(self._range(less)), cosine_of(phi, roll), cosine(roll))
        return combined((1.0, b), (-1.0, part)).widened(COMPUTED)

    def _load(self, at: Controlled) -> Form:
        roll = self._angle(at.phi, "roll")
        values = ordered(self._range(at.extra))
        return product(at.extra, values, secant(at.phi, roll), _one_over(cosine(roll)))

    def _lift_and_load(self, at: Controlled) -> tuple[Form, Interval]:
        # The row of the exact law is the vertical lift itself.
        values = ordered(self._range(at.extra))
        return at.extra, values * _one_over(cosine(at.roll))

    def _move(self, i: int, channel: Channel) -> Form:
        """Change of the command in the sample."""
        less = self._held_back(i, channel)
        return channel.x if less is None else combined((1.0, channel.x), (-1.0, less))

    def _held_back(self, i: int, channel: Channel) -> Form | None:
        """Amount that limits take off the command wanted; None if they never act."""
        moves, doubt = [], np.zeros(len(self.pieces))
        # Where the side of a limit is known, the values end at the limit, and max(Y, 0) is Y or 0.
        # But a flight may be beyond by OVERLAP: there Y, or none of it, is taken for the other, and
        # a line of slope s leaves the values by |s| or |1 - s| times that. A proof may hold any s.
        for side, excess in enumerate((channel.above, channel.below)):
            if excess is None or not (excess.values.high > 0.0).any():
                continue
            sides = self._sides[:, i, side]
            values = Interval(
                np.where(sides == LIMITED, np.maximum(excess.values.low, 0.0), excess.values.low),
                np.where(sides == FREE, np.minimum(excess.values.high, 0.0), excess.values.high),
            )
            values = ordered(values)
            slope = self.plan.slope(values)
            part = positive_part(excess.form, values, slope)
            moves.append((1.0 if side == 0 else -1.0, part))
            doubt += np.where(sides == OPEN, 0.0, OVERLAP * (1.0 + np.abs(slope)) * UP)
        return combined(*moves).widened(doubt) if moves else None

    def _held(self, i: int, channel: Channel) -> tuple[Flags, Flags]:
        """Pieces in which no limit holds the command, and those in which one does."""
        # Beyond a limit by less than OVERLAP counts as open, unless a split has said which side.
        free, limited = np.ones((2, len(self.pieces)), dtype=bool)
        limited = ~limited
        for side, excess in enumerate((channel.above, channel.below)):
            if excess is not None:
                sides = self._sides[:, i, side]
                free &= (sides == FREE) | ((sides == OPEN) & (excess.values.high < -OVERLAP))
                limited |= (sides == LIMITED) | ((sides == OPEN) & (excess.values.low > OVERLAP))
        return free, limited

    def _integrated(self, channel: Channel, integral: Form, free: Flags, limited: Flags) -> Form:
        """The integral after the sample: it stands where a limit holds the command."""
        if not self.loop.conditional:  # without anti-windup the integrator never stops
            return combined((1.0, integral), (1.0, channel.increment))
        # Where the side is open, the integral takes half the increment, and an error of the other
        # half: that covers both sides.
        share = np.where(free, 1.0, np.where(limited, 0.0, 0.5))
        size = 0.5 * ordered(self._range(channel.increment)).largest * UP
        doubt = np.where(free | limited, 0.0, size)
        return combined((1.0, integral), (share, channel.increment)).widened(doubt)

    def _keep(self, which: Flags) -> None:
        super()._keep(which)
        self._sides = self._sides[which]

    def _split(self, cut: Cut) -> None:
        super()._split(cut)
        # The upper halves are appended behind the pieces, in the order of `which`.
        which = np.flatnonzero(cut.which)
        count = len(self._sides)
        self._sides = np.concatenate([self._sides, self._sides[which]])
        for excess, i, side in self._excesses:
            # Only a split at the limit itself says on which side of it a flight is. That is about
            # the command of the flight, not about a symbol, so later passes may use it.
            if excess is cut.excess:
                sure = which[cut.at[which] == 0.0]
                self._sides[sure, i, side] = FREE
                above = count + np.flatnonzero(cut.at[which] == 0.0)
                self._sides[above, i, side] = LIMITED


def _one_over(values: Interval) -> Interval:
    return Interval.point(np.ones_like(values.low)) / values
