r"""One sample of the exact law for a whole set of flights.

The commanded rates are affine in errors and integrals; roll ``atan(a/b)`` and load factor
``b / cos(phi)`` follow from their lifts a and b, and the point mass turns them back into the
commanded rates, so that the enclosure errors of these functions cancel to second order. While a
command is limited, the integrator of its channel stops. This is a discontinuity: a piece with
flights on both sides is split, and each half records its side.

With feedback of roll and load factor each command passes two limits: first as the expected command,
then with the tracking error added. The second command is affine in the first and in the
measurements, which are states of the plant's lag model.
"""

import itertools
import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from flighttune.claims.tubes import sample
from flighttune.claims.tubes.forms import (
    UP,
    Flags,
    Form,
    Forms,
    Pieces,
    Quantity,
    arctangent,
    combined,
    cosine_of,
    positive_part,
    product,
    secant,
    secant_change,
)
from flighttune.claims.tubes.interval import Interval, Unbounded, cosine

# Overlap of the halves of a piece, rad and 1: by rounding, a computed flight may lie on the other
# side of a limit than the exact flight.
OVERLAP = 1e-9

# Number of symbols that a sample adds after the symbols of the roll command: two integrals, load
# factor, lift, course and path angle; with feedback a second roll and two more load factors.
SYMBOLS_AFTER_ROLL, MORE_WITH_FEEDBACK = 6, 3

# Rows of the expected commands, which are last, with feedback, and the kinds of their symbols
EXPECTED_PHI, EXPECTED_N_Z = -2, -1
EXPECTED_KINDS = sample.STATES + 2, sample.STATES + 3

# Largest tangent of a roll command before limits: 86 deg
STEEPEST_ROLL = 14.0

# Whether no flight of a piece is beyond a limit, all are, or this is unknown
FREE, LIMITED, OPEN = -1, 1, 0

# The channels of a pass, the commands of roll and load factor, and with feedback both expected
# commands
Commands: TypeAlias = tuple[list[sample.Channel], Form, Form, tuple[Form, ...]]


def enclosure_of(loop: sample.SampledLoop, pieces: Pieces, plan: sample.Plan) -> sample.Enclosure:
    """The enclosure of a loop, by its law."""
    if loop.law.inverts is None:
        return sample.Enclosure(loop, pieces, plan)
    kind = FedBackEnclosure if loop.law.feeds_back else ExactEnclosure
    return kind(loop, pieces, plan)


class ExactEnclosure(sample.Enclosure):
    """An `Enclosure` of the exact law."""

    overlap = OVERLAP
    commands_each = 1  # channels in sequence, each with its limits

    def __init__(self, loop: sample.SampledLoop, pieces: Pieces, plan: sample.Plan) -> None:
        super().__init__(loop, pieces, plan)
        assert loop.law.inverts is not None
        self._law, self._speed = loop.law.inverts, loop.V_a * loop.law.inverts.per_g  # V/g, s

    def _controlled(self, k: int) -> sample.Controlled:
        pieces, n = self.pieces, self.commands_each
        # Side of each limit on which all flights of a piece are, by channel and by above or below.
        limits = itertools.product(range(2 * n), (1.0, -1.0))
        self._sides = {limit: np.full(len(pieces), OPEN) for limit in limits}
        # A pass begins only if enough room is left for the later symbols of the sample.
        last = pieces.used + sample.FRESH_SYMBOLS - SYMBOLS_AFTER_ROLL
        if n > 1:
            last -= MORE_WITH_FEEDBACK
        while True:
            # A pass that splits by the load factor leaves a constraint on the symbol of its roll
            # command, and the next pass linearises roll again. So this symbol stays reserved
            # although no state row has it: if it were reused, the constraint would refer to another
            # error.
            if pieces.used >= last:
                raise Unbounded("pieces are split too often in one sample")
            state = pieces.forms()
            errors = self._errors(k, state)
            a, b = self._lifts(k, state, errors)
            self._check_plain(errors, a.values, b.values)
            if (commands := self._commands(state, errors, a, b)) is not None:
                break
        channels, phi, extra, expected = commands
        integrals, limited = zip(
            *(self._integrated(i, channels, state[sample.PHI_INTEGRAL + i]) for i in (0, 1)),
            strict=True,
        )
        kept = self._kept(integrals)
        return sample.Controlled(
            state, errors, self._seen(state), phi, extra, 0.0, kept, limited, expected
        )

    def _commands(self, state: Forms, errors: Forms, a: Quantity, b: Quantity) -> Commands | None:
        """The commands for the desired lifts; None if the pieces were split or dropped."""
        # Roll comes before load factor: the law inverts exactly with the commanded roll, so the
        # load factor uses roll after its limits.
        turning = self._towards(
            0, arctangent(a, b).widened(sample.COMPUTED), state[sample.PHI], errors
        )
        if self._fewer_or_more([turning]):
            return None
        # Lift and load factor share one symbol for the error of roll, so that it cancels when the
        # point mass turns them back into rates.
        phi = self.pieces.fresh(self._moved(0, turning, state[sample.PHI]), sample.PHI)
        lifting = self._lifting(state, errors, phi, b.form)
        if self._fewer_or_more([turning, lifting]):
            return None
        extra = b.form
        if (less := self._held_back(1, lifting)) is not None:
            # Limits act on n_z; they reduce the vertical lift by this amount times cos(phi).
            level = cosine_of(self._angle(phi, "roll"))
            extra = combined((1.0, extra), (-1.0, product(self._ranged(less), level)))
        return [turning, lifting], phi, extra.widened(sample.COMPUTED), ()

    def _lifts(self, k: int, state: Forms, errors: Forms) -> tuple[Quantity, Quantity]:
        """Horizontal and vertical lift for the commanded rates, in weights."""
        turn, climb = (
            combined(
                *zip(law.K_P, errors, strict=True),
                (1.0, state[sample.PHI_INTEGRAL + i]),
                shift=self.loop.reference[k, sample.RATES][i],
            )
            for i, law in enumerate(self.loop.law.channels)
        )
        # The exact law needs ``a = V/g cos(gamma) chi_dot`` and ``b = V/g gamma_dot + cos(gamma)``.
        level = cosine_of(self._angle(state[sample.GAMMA], sample.CLIMB))
        across = combined((self._speed, product(level, self._ranged(turn))))
        lifts = across, combined((self._speed, climb), (1.0, level.form))
        a, b = (form.widened(sample.COMPUTED) for form in lifts)
        return Quantity(a, self._range(a)), Quantity(b, self._range(b))

    def _check_plain(self, errors: Forms, a: Interval, b: Interval) -> None:
        """Stop if the law may do more than invert, which is not enclosed."""
        turning, law = self.loop.law.channels
        if not (b.low > self._law.lift_floor).all():
            raise Unbounded("the vertical lift wanted can be at its floor")
        # The largest load factor is enough for both lifts, or for b at the largest roll.
        stop = max(abs(turning.lower), turning.upper)
        together = (a.largest**2 + b.high**2) * UP
        steep = b.high * UP < law.upper * math.cos(min(stop, math.pi / 2))
        if not (steep | (together < law.upper**2)).all():
            raise Unbounded("the lift wanted can be more than the largest load factor")
        if not (a.largest < STEEPEST_ROLL * b.low).all():
            raise Unbounded("the roll wanted can be next to 90 deg")
        self._check_unbraked(1, "the path-angle error", self._law.brake, errors)
        if self._law.turn_brake < math.inf:
            self._check_unbraked(0, "the course error", self._law.turn_brake, errors)

    def _check_unbraked(self, i: int, error: str, brake: float, errors: Forms) -> None:
        """Stop if a rate wanted may be so large that the law brakes."""
        law = self.loop.law.channels[i]
        rate = self._range(combined(*zip(law.K_P, errors, strict=True))).largest
        if not (rate * self._speed * law.K_P[i] * UP < brake).all():
            raise Unbounded(f"{error} can be so large that the law brakes")

    def _towards(self, i: int, wanted: Form, before: Form, errors: Forms) -> sample.Channel:
        """A desired command, from the previous command."""
        x = combined((1.0, wanted), (-1.0, before))
        return self._channel(i, x, Quantity(before, self._range(before)), errors)

    def _channel(self, i: int, x: Form, command: Quantity, errors: Forms) -> sample.Channel:
        law = self.loop.law.channels[i // self.commands_each]
        increment = combined(*zip(law.K_I_half, errors, strict=True))
        # Splits are at the limits themselves, where the integrator stops for any increment.
        # The halves of a split overlap: a flight on a known side exceeds it by at most OVERLAP.
        # Without this bound the enclosure would contain flights that do not exist.
        excesses = {
            side: excess._replace(values=self._on_its_side(i, side, excess, OVERLAP))
            for side, excess in self._excesses(x, command, law).items()
        }
        return sample.Channel(x, increment, Interval.point(np.zeros(len(self.pieces))), excesses)

    def _on_its_side(self, i: int, side: float, excess: Quantity, beyond: float) -> Interval:
        """Values of an excess, at most `beyond` the limit if the side of flights is known."""
        sides, values = self._sides[i, side], excess.values
        return Interval(
            np.where(sides == LIMITED, np.maximum(values.low, -beyond), values.low),
            np.where(sides == FREE, np.minimum(values.high, beyond), values.high),
        )

    def _lifting(self, state: Forms, errors: Forms, phi: Form, b: Form) -> sample.Channel:
        """The load factor ``b / cos(phi)`` before its limits."""
        # The load factor in force is v / cos(phi) with the previous roll: the difference is ``(b -
        # v) / cos(phi)`` plus v times the change of 1 / cos(phi). Enclosed separately, the two load
        # factors would seem to reach the rate limit.
        before, roll = (self._angle(angle, "roll") for angle in (state[sample.PHI], phi))
        more = combined((1.0, b), (-1.0, state[sample.EXTRA_LIFT]))
        v = self._ranged(state[sample.EXTRA_LIFT])
        change = self._ranged(combined((1.0, phi), (-1.0, state[sample.PHI])))
        x = combined(
            (1.0, product(self._ranged(more), secant(roll))),
            (-1.0, product(v, self._ranged(secant_change(before, change)))),
        )
        # The load factor in force, n_z = v / cos(phi): the rate limit acts on n_z, not on v.
        steep = secant(before)
        command = Quantity(product(v, steep), v.values * steep.values)
        return self._channel(1, x.widened(sample.COMPUTED), command, errors)

    def _load(self, stage: sample.Controlled) -> Form:
        return product(self._ranged(stage.extra), secant(self._angle(stage.phi, "roll")))

    def _lift_and_load(self, stage: sample.Controlled) -> tuple[Form, Interval]:
        # The row of the exact law is the vertical lift itself.
        return stage.extra, self._ranged(stage.extra).values * (1.0 / cosine(stage.roll.values))

    def _moved(self, i: int, channel: sample.Channel, before: Form) -> Form:
        """A command after its limits."""
        move, less = channel.x, self._held_back(i, channel)
        if less is not None:
            move = combined((1.0, move), (-1.0, less))
        return combined((1.0, before), (1.0, move)).widened(sample.COMPUTED)

    def _held_back(self, i: int, channel: sample.Channel) -> Form | None:
        """Amount by which limits reduce the desired command; None if they never act."""
        moves, doubt = [], np.zeros(len(self.pieces))
        # If the side of a limit is known, the values end at the limit, and max(Y, 0) is Y or 0. But
        # a flight may exceed the side by OVERLAP; there a line of slope s misses the values by |s|
        # or |1 - s| times the overlap. A proof may contain any s.
        for side, excess in channel.excesses.items():
            if not (excess.values.high > 0.0).any():
                continue
            values = self._on_its_side(i, side, excess, 0.0).ordered
            slope = self.plan.slope(values)
            moves.append((side, positive_part(Quantity(excess.form, values), slope)))
            decided = self._sides[i, side] != OPEN
            doubt += np.where(decided, OVERLAP * (1.0 + np.abs(slope)) * UP, 0.0)
        return combined(*moves).widened(doubt) if moves else None

    def _integrated(
        self, i: int, channels: Sequence[sample.Channel], integral: Form
    ) -> tuple[Form, bool]:
        """The integral after the sample, and whether a limit can hold one of its commands."""
        # An excess below OVERLAP counts as open, unless a split has fixed the side.
        n, own = len(self.pieces), range(i * self.commands_each, (i + 1) * self.commands_each)
        free, limited = np.ones(n, dtype=bool), np.zeros(n, dtype=bool)
        excesses = [(j, *over) for j in own for over in channels[j].excesses.items()]
        for j, side, excess in excesses:
            sides = self._sides[j, side]
            free &= (sides == FREE) | ((sides == OPEN) & (excess.values.high < -OVERLAP))
            limited |= (sides == LIMITED) | ((sides == OPEN) & (excess.values.low > OVERLAP))
        can_limit, increment = bool((~free).any()), channels[own.start].increment
        if not self.loop.law.conditional:  # without anti-windup the integrator never stops
            return combined((1.0, integral), (1.0, increment)), can_limit
        # The integral is held while a limit holds the command. If the side is open, it takes half
        # the increment, with the other half as an error, which covers both sides.
        share = np.where(free, 1.0, np.where(limited, 0.0, 0.5))
        half = 0.5 * self._range(increment).ordered.largest * UP
        doubt = np.where(free | limited, 0.0, half)
        return combined((1.0, integral), (share, increment)).widened(doubt), can_limit

    def _keep(self, flags: Flags) -> None:
        super()._keep(flags)
        self._sides = {limit: sides[flags] for limit, sides in self._sides.items()}

    def _split(self, cut: sample.Cut, channels: Sequence[sample.Channel]) -> None:
        super()._split(cut, channels)
        # The upper halves are appended behind the pieces, in the order of `indices`.
        i, side, chosen, splits, _ = cut
        indices = np.flatnonzero(chosen)
        for limit, sides in self._sides.items():
            upper = sides[indices]
            # Only a split at the limit itself fixes the side of a flight. This concerns the
            # flight's command and not a symbol, so later passes may use it.
            if limit == (i, side):
                at_limit = splits[indices] == 0.0
                sides[indices[at_limit]] = FREE
                upper[at_limit] = LIMITED
            self._sides[limit] = np.concatenate([sides, upper])


class FedBackEnclosure(ExactEnclosure):
    """An `Enclosure` of the exact law with feedback of roll and load factor."""

    # The row `EXTRA_LIFT` is the load-factor command itself.
    commands_each = 2

    def _commands(self, state: Forms, errors: Forms, a: Quantity, b: Quantity) -> Commands | None:
        pieces, (k_phi, k_n_z) = self.pieces, self._law.feedback
        # In this order, each after the limits of the previous command, as in `exact_step`
        roll = arctangent(a, b).widened(sample.COMPUTED)
        turning = self._towards(0, roll, state[EXPECTED_PHI], errors)
        if self._fewer_or_more([turning]):
            return None
        phi_0 = pieces.fresh(self._moved(0, turning, state[EXPECTED_PHI]), EXPECTED_KINDS[0])
        roll = self._with_lack(k_phi, phi_0, self._seen(state).form)
        rolling = self._towards(1, roll, state[sample.PHI], errors)
        load = product(self._ranged(b.form), secant(self._angle(phi_0, "roll")))
        lifting = self._towards(2, load.widened(sample.COMPUTED), state[EXPECTED_N_Z], errors)
        if self._fewer_or_more([turning, rolling, lifting]):
            return None
        n_0 = pieces.fresh(self._moved(2, lifting, state[EXPECTED_N_Z]), EXPECTED_KINDS[1])
        # The controller sees the load factor behind its lag, or the command in force.
        lift_seen = state[self.loop.layout[0][1].start if self.loop.lags else sample.EXTRA_LIFT]
        load = self._with_lack(k_n_z, n_0, lift_seen)
        loading = self._towards(3, load, state[sample.EXTRA_LIFT], errors)
        channels = [turning, rolling, lifting, loading]
        if self._fewer_or_more(channels):
            return None
        phi = pieces.fresh(self._moved(1, rolling, state[sample.PHI]), sample.PHI)
        return channels, phi, self._moved(3, loading, state[sample.EXTRA_LIFT]), (phi_0, n_0)

    def _with_lack(self, k: float, expected: Form, measured: Form) -> Form:
        return combined((1.0 + k, expected), (-k, measured)).widened(sample.COMPUTED)

    def _load(self, stage: sample.Controlled) -> Form:
        return stage.extra

    def _lift_and_load(self, stage: sample.Controlled) -> tuple[Form, Interval]:
        load = self._ranged(stage.extra)
        return product(load, cosine_of(stage.roll)), load.values
