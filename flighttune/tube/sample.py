r"""One sample of the loop for a whole set of flights: the controller as it flies, then the plant.

With x the unlimited command minus the command u in force, what a limit holds back above is
``max(Y, 0)`` with ``Y = x - r + max(u + r - hi, 0)`` for the range up to `hi` and the step r that
the rate allows, and likewise below. So `pi_step` is

    u+ = u + x - max(Y, 0) + max(Z, 0)
    I+ = I + J - (max(Y, 0) - S) + ...  with  S = max(Y - max(J, 0), 0)

with J the trapezoid's increment: the second line is conditional anti-windup. It is affine where all
flights are on one side of every kink. Elsewhere a kink becomes a line and a symbol for its error.
The two lines share the symbol of ``max(Y, 0)``, so that it cancels in the next x, which is
``K_P`` times the change of the errors, plus the next J, plus S. The values of S are known better
than its form says: pieces remember them.

The load-factor command is kept as v, what it has beyond the feed-forward
``cos(gamma_ref)/cos(phi)``: in x the feed-forward cancels, and ``n_z cos(phi)`` is
``v cos(phi) + cos(gamma_ref)``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import NamedTuple, Protocol

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.mimo_pi import ChannelLaw
from flighttune.tube.forms import UP, Flags, Form, Indices, Pieces, combined, transformed
from flighttune.tube.functions import (
    cosine_of,
    positive_part,
    product,
    secant,
    secant_change,
    tangent,
)
from flighttune.tube.interval import LARGEST_ANGLE, Interval, cosine, sine
from flighttune.tube.lag import SampledLag
from flighttune.tube.point_mass import Moved, point_mass_sample

CHI, GAMMA, PHI, EXTRA_LIFT, PHI_INTEGRAL, N_Z_INTEGRAL, CHI_ERR, GAMMA_ERR = range(8)
"""Rows of the state; the errors are those of the sample before. `EXTRA_LIFT` is the load-factor
command beyond its feed-forward, or, of the exact law, times the cosine of the roll command."""

STATES = 8

N_Z, ROLL_BEYOND = STATES, STATES + 1
"""Kinds of the symbols of a load-factor command that passes a lag, and of the difference of the
roll seen from that behind the lag."""

ROLL_KEPT = 0.875
"""Part of that difference that is kept from sample to sample; 1 less it is exact."""

KINDS = PHI, EXTRA_LIFT
"""Kinds of the symbols of the two commands."""

SPLITS = 4
"""Number of splits that a piece remembers."""

CONSTRAINTS = SPLITS + 2
"""Rows of constraints: the splits, then for each command the part that limits hold back."""

NARROWEST = 1e-9
"""Half width of a range, rad and 1, below which it is not remembered: it excludes nothing."""

FRESH_SYMBOLS = 20
"""Most symbols that a sample adds: of the paper's law 12 for the kinks of four limits, 2 commands,
2 integrals, course, path angle, and behind lags a load factor and a roll seen. The exact law adds
7, and one more for every time that pieces are split after its roll command."""

REDUCE_EVERY = 25
"""Every so many samples accumulated errors become symbols, so that feedback can reduce them."""

COMPUTED = 1e-11
"""Bound, rad and 1, on the error of a computed flight in a sample: that of the classical
Runge-Kutta rule over 0.02 s, and some rounding."""


RATE, RANGE = "rate limit", "range"

COMMANDS = ("roll", "the load factor")

SIDES = (("to the right", "to the left"), ("upwards", "downwards"))
"""Names of the limits above and below the two commands."""

CLIMB = "the flight-path angle"

STEEPEST = math.radians(85.0)
"""Largest flight-path angle of the exact point mass, which has no course at 90 deg."""

ROLL_UNBOUNDED = f"roll cannot be kept inside {math.degrees(LARGEST_ANGLE):.1f} deg"


class Unbounded(Exception):
    """The set can no longer be enclosed; the message says why."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledLoop:
    """The loop that all flights of a set share."""

    channels: tuple[ChannelLaw, ...]  # length 2: the numbers of the controller itself
    conditional: bool  # whether anti-windup is conditional; it is none otherwise
    feed_forward: bool  # whether ``cos(gamma_ref)/cos(phi)`` is added to the load-factor command
    # shape (k, 2), rad and 1: further feed-forward of both commands at every sample: that of a
    # feasible reference, or zeros.
    planned: FloatArray
    dt: float  # s
    g_over_v: float  # 1/s
    # `chi_ref` and `gamma_ref` (shape (k,), rad): reference at every sample
    chi_ref: FloatArray
    gamma_ref: FloatArray
    # `d_low` and `d_high` (shape (k, 2), rad/s): bounds on the disturbance of the two rates from a
    # sample to the next.
    d_low: FloatArray
    d_high: FloatArray
    # length 4: course, flight-path angle, roll and load factor in the middle of the starts; without
    # a load factor it is that of steady flight at the path angle of each start.
    start: tuple[float, float, float, float | None]
    exact: bool = False  # whether the point mass turns by its lift, instead of by the paper's law
    # Length 0 or 2: lags of roll and load factor; the exact point mass alone has them
    lags: tuple[SampledLag, ...] = ()
    inversion: "Inversion | None" = None  # None for the paper's law
    # shape (k, 4), rad: roll seen by the feed-forward minus that behind the lag: lowest and highest
    # at every sample, and lowest and highest change to the next. None where they are the same.
    roll: FloatArray | None = None

    @property
    def rows(self) -> int:
        """Rows of the state: `STATES`, then the lags, then the commands still to take effect."""
        rows = STATES + sum(lag.order + lag.older + 1 for lag in self.lags)
        return rows + (self.roll is not None)

    @property
    def layout(self) -> "Layout":
        """Rows of the lags and of the commands on their way."""
        counts = [lag.order for lag in self.lags] + [lag.older + 1 for lag in self.lags]
        ends = list(accumulate(counts, initial=STATES))
        rows = [slice(*ends) for ends in pairwise(ends)]
        return Layout(rows[: len(self.lags)], rows[len(self.lags) :])

    @property
    def seen(self) -> int:
        """Row of the roll that the controller sees, without what `roll` adds."""
        return STATES if self.lags else PHI

    def lift(self, k: int) -> float:
        """``cos(gamma_ref)`` of the feed-forward at sample k; 0 without one."""
        return math.cos(self.gamma_ref[max(k, 0)]) if self.feed_forward else 0.0


class Layout(NamedTuple):
    """Rows of the state behind the first `STATES`; the last row of all is that of `roll`."""

    lags: list[slice]  # states of each lag
    queues: list[slice]  # commands of each channel that have yet to take effect, the newest first


class Inversion(NamedTuple):
    """Numbers with which the exact law turns rates into commands."""

    rates: FloatArray  # shape (k, 2), rad/s: rates of the reference at every sample
    speed: float  # s: airspeed over the acceleration of gravity
    lift_floor: float  # in weights
    brake: float  # 1/s: see `RateLaw`


class Excess(NamedTuple):
    """Excess of a command over one of its limits: the form Y and its values.

    `limit` says which limits these can be, in words.
    """

    form: Form
    values: Interval
    limit: str


class Channel(NamedTuple):
    """One command before its limits: x, the increment with its values, and the two excesses.

    `above` and `below` are None where there is no limit.
    """

    x: Form
    increment: Form
    by: Interval
    above: Excess | None
    below: Excess | None


class Cut(NamedTuple):
    """A split of the pieces `which` by an excess, at its values `at`, into constraint row `row`."""

    excess: Excess
    which: Flags
    at: FloatArray
    row: Indices


class Plan(Protocol):
    """The free choices of an enclosure: all of them give one that holds."""

    def multipliers(self, pieces: Pieces, form: Form) -> FloatArray:
        """Multipliers of the rows constrained, for the range of a form, shape (P, c)."""
        ...

    def slope(self, values: Interval) -> FloatArray:
        """Slope of the line that encloses ``max(F, 0)``, shape (P,)."""
        ...

    def cut(self, pieces: Pieces, channels: Sequence[Channel]) -> Cut | None:
        """Next split before the sample is taken; None to go on."""
        ...

    def pairs(self, pieces: Pieces) -> Indices:
        """Symbols to give up, as `Pieces.reduce` takes them."""
        ...


def start_set(
    loop: SampledLoop, within_start: float, pieces: int, constraints: int, capacity: int
) -> Pieces:
    """All starts within `within_start` (rad) of course and flight-path angle, `pieces` squared."""
    chi, gamma, phi, n_z = loop.start
    edges = np.linspace(-within_start, within_start, pieces + 1)
    # Midpoints and half width of the pieces along one axis.
    middles, radius = 0.5 * (edges[1:] + edges[:-1]), within_start / pieces * UP
    centres = np.zeros((pieces * pieces, loop.rows))
    centres[:, CHI] = chi + np.repeat(middles, pieces)
    centres[:, GAMMA] = gamma + np.tile(middles, pieces)
    centres[:, PHI] = phi
    made = Pieces(centres, constraints, capacity)
    state = made.forms()
    # Two symbols span the starts of a piece; everything else follows from them.
    for row in (CHI, GAMMA):
        state[row] = made.fresh(state[row].widened(radius + COMPUTED), row)
    at = Interval.point(np.full(len(centres), phi))
    if n_z is None:
        steady = Interval.point(np.ones(len(centres))) / cosine(at)
        level = cosine_of(state[GAMMA], made.plain_range(state[GAMMA]))
        load = combined((steady.middle, level)).widened(steady.radius + COMPUTED)
    else:
        load = combined((0.0, state[GAMMA]), shift=n_z).widened(COMPUTED)
    feed_forward = Interval.point(np.full(len(centres), loop.lift(0))) / cosine(at)
    state[EXTRA_LIFT] = combined((1.0, load), shift=-feed_forward.middle).widened(
        feed_forward.radius
    )
    # The row of the exact law is the load factor times the cosine of roll.
    if loop.inversion:
        level = cosine(at)
        state[EXTRA_LIFT] = combined((level.middle, load)).widened(
            level.radius * load.size + COMPUTED
        )
    at_rest, layout = (state[PHI], load), loop.layout
    for rows, lag, value in zip(layout.lags, loop.lags, at_rest, strict=False):
        state[rows] = [combined((share, value)).widened(COMPUTED) for share in lag.rest]
    for rows, value in zip(layout.queues, at_rest, strict=False):
        state[rows] = [value] * (rows.stop - rows.start)
    if loop.roll is not None:
        box = _interval(*loop.roll[0, :2])
        beyond = combined((0.0, state[PHI]), shift=box.middle).widened(box.radius)
        state[-1] = made.fresh(beyond, ROLL_BEYOND)
    made.put(state)
    return made


class Enclosure:
    """A set of flights taken from sample to sample.

    Parameters
    ----------
    pieces : Pieces
        The starts; changed by every sample.

    Attributes
    ----------
    overlap : float
        Overlap of the halves of a piece.
    limits : dict of str to (str, int)
        By command and side, which of its limits could act in the last sample, and the sample since
        which some did without a break.
    """

    overlap = 0.0

    def __init__(self, loop: SampledLoop, pieces: Pieces, plan: Plan) -> None:
        self.loop, self.pieces, self.plan = loop, pieces, plan
        self.limits: dict[str, tuple[str, int]] = {}
        self._margin = np.zeros(2)

    def sample(self, k: int) -> tuple[FloatArray, Flags]:
        """Take the set through sample k and on to the next; return what is proven of it.

        Returns
        -------
        ranges : ndarray, shape (4, 2)
            Lower and upper bound of course error, flight-path-angle error, roll and load-factor
            command. The errors have a margin, with which they also hold between the samples: on
            the straight line from the bounds of one to those of the next.
        limited : ndarray of bool, shape (2,)
            Whether a limit can hold the command.

        Raises
        ------
        Unbounded
            If an angle leaves the range in which the functions are enclosed.
        """
        pieces, loop = self.pieces, self.loop
        if pieces.used + FRESH_SYMBOLS > pieces.capacity or k % REDUCE_EVERY == REDUCE_EVERY - 1:
            pieces.reduce(self.plan.pairs(pieces))
        pieces.make_room(FRESH_SYMBOLS)
        at = self._controlled(k)
        # Ranges of the errors of this sample, before its rows are overwritten by the next one's.
        error_ranges = [*map(self._range, at.errors)]
        flown = (self._point_mass if loop.exact else self._paper_law)(k, at)
        pieces.put(
            [flown.chi, flown.gamma, at.phi, flown.extra, *at.integrals, *at.errors, *flown.lags]
        )
        ranges = [*map(ordered, (*error_ranges, *flown.commands))]
        bounds = np.array([(values.low.min(), values.high.max()) for values in ranges])
        # Between samples a flight leaves the straight line by at most a quarter of the sample time
        # times how far apart its rate can be. The line between the bounds needs that at both of its
        # ends, so a sample takes the larger margin of the interval before it and of the one after.
        after = 0.25 * loop.dt * flown.spread * UP
        margin, self._margin = np.maximum(self._margin, after), after
        bounds[:2, 0] -= margin
        bounds[:2, 1] += margin
        return bounds, np.array(at.limited)

    def _controlled(self, k: int) -> "Controlled":
        """The commands of sample k, in as many pieces as that takes."""
        pieces = self.pieces
        # A split changes the pieces and their constraints, so every form is made anew after it. No
        # symbol is added before the last pass: constraints may only speak of symbols that stay.
        while True:
            state = pieces.forms()
            errors = self._errors(k, state)
            roll = self._angle(self._seen(state), "roll")
            extra = self._extra_lift(k, state, roll)
            channels = self._channels(k, state, errors, roll, extra)
            if not self._fewer_or_more(channels):
                break
        moves, integrals, limited = zip(
            *(self._limited(i, c, state[PHI_INTEGRAL + i]) for i, c in enumerate(channels)),
            strict=True,
        )
        self._note_limits(k, channels)
        phi = combined((1.0, state[PHI]), (1.0, moves[0])).widened(COMPUTED)
        phi = pieces.fresh(phi, PHI)
        extra = combined((1.0, extra), (1.0, moves[1])).widened(COMPUTED)
        lift = self.loop.lift(k)
        return Controlled(state, errors, roll, phi, extra, lift, self._kept(integrals), limited)

    def _note_limits(self, k: int, channels: Sequence[Channel]) -> None:
        """Write down which limits can act, so that a set that is lost has a cause."""
        sides = {
            f"{command} {side}": excess
            for command, sides, channel in zip(COMMANDS, SIDES, channels, strict=True)
            for side, excess in zip(sides, (channel.above, channel.below), strict=True)
        }
        self.limits = {
            side: (excess.limit, self.limits[side][1] if side in self.limits else k)
            for side, excess in sides.items()
            if excess is not None and (excess.values.high > 0.0).any()
        }

    def _kept(self, integrals: Sequence[Form]) -> list[Form]:
        """Integrals with a symbol each for their errors."""
        return [
            self.pieces.fresh(form.widened(COMPUTED), PHI_INTEGRAL + i)
            for i, form in enumerate(integrals)
        ]

    def _fewer_or_more(self, channels: Sequence[Channel]) -> bool:
        """Drop pieces without flights, or split; whether there are other pieces now."""
        empty = self._empty(channels)
        if empty.any():
            self._keep(~empty)
            return True
        cut = self.plan.cut(self.pieces, channels)
        if cut is not None:
            self._split(cut)
        return cut is not None

    def _range(self, form: Form) -> Interval:
        values, pieces = self.pieces.plain_range(form), self.pieces
        if pieces.constrained.any():
            other = pieces.constrained_range(form, self.plan.multipliers(pieces, form))
            values = Interval(
                np.maximum(values.low, other.low), np.minimum(values.high, other.high)
            )
        return values

    def _angle(self, form: Form, name: str) -> Interval:
        values = ordered(self._range(form))
        if not (values.largest < LARGEST_ANGLE).all():
            raise Unbounded(f"{name} cannot be kept inside {math.degrees(LARGEST_ANGLE):.1f} deg")
        return values

    def _errors(self, k: int, state: Sequence[Form]) -> list[Form]:
        # The controller wraps the course error; all flights of a piece must wrap alike.
        chi_err = combined((-1.0, state[CHI]), shift=self.loop.chi_ref[k])
        turns = np.round(chi_err.coefficients[:, 0] / math.tau)
        chi_err = combined((1.0, chi_err), shift=-turns * math.tau)
        if not (self._range(chi_err).largest < math.pi).all():
            raise Unbounded("the course error can pass half a turn")
        return [chi_err, combined((-1.0, state[GAMMA]), shift=self.loop.gamma_ref[k])]

    def _seen(self, state: Sequence[Form]) -> Form:
        """The roll that the controller sees."""
        seen = state[self.loop.seen]
        return seen if self.loop.roll is None else combined((1.0, seen), (1.0, state[-1]))

    def _extra_lift(self, k: int, state: Sequence[Form], roll: Interval) -> Form:
        """The load-factor command beyond the feed-forward of this sample's reference."""
        # The row was kept relative to the reference of the sample before.
        moved = self.loop.lift(k) - self.loop.lift(k - 1)
        if moved == 0.0:
            return state[EXTRA_LIFT]
        return combined((1.0, state[EXTRA_LIFT]), (-moved, secant(self._seen(state), roll)))

    def _channels(
        self,
        k: int,
        state: Sequence[Form],
        errors: Sequence[Form],
        roll: Interval,
        extra: Form,
    ) -> list[Channel]:
        made = []
        before = state[CHI_ERR], state[GAMMA_ERR]
        for i, law in enumerate(self.loop.channels):
            sums = (
                []
                if k == 0
                else [*zip((*law.K_I_half, *law.K_I_half), (*errors, *before), strict=True)]
            )
            # The controller's trapezoid begins with the second sample: there is no time before the
            # first.
            increment = combined(*sums) if sums else combined((0.0, errors[0]))
            force = extra if i else state[PHI]
            x = combined(
                *zip(law.K_P, errors, strict=True),
                (1.0, state[PHI_INTEGRAL + i]),
                (1.0, increment),
                (-1.0, force),
                shift=self.loop.planned[k, i],
            )
            lift = self.loop.lift(k) if i else 0.0
            command, values = self._command(force, lift, self._seen(state), roll)
            above = self._excess(x, command, values, 1.0, law.upper, law.step_up)
            below = self._excess(x, command, values, -1.0, -law.lower, -law.step_down)
            made.append(Channel(x, increment, self._range(increment), above, below))
        return made

    def _command(
        self, force: Form, lift: float, seen: Form, roll: Interval
    ) -> tuple[Form, Interval]:
        """The command in force and its values."""
        if lift == 0.0:
            return force, self._range(force)
        unity = Interval.point(np.ones_like(roll.low))
        values = self._range(force) + unity / cosine(roll) * lift
        return combined((1.0, force), (lift, secant(seen, roll))), values

    def _excess(
        self, x: Form, command: Form, values: Interval, side: float, limit: float, step: float
    ) -> Excess | None:
        if math.isinf(limit) and math.isinf(step):
            return None
        if math.isinf(step):
            form = combined((side, x), (side, command), shift=-limit)
            return Excess(form, self._range(form), RANGE)
        terms, name = [(side, x)], RATE
        if not math.isinf(limit):
            # What the range leaves of the step: all of it, unless the command is near its end.
            near = values * side + (step - limit)
            if (near.high > 0.0).any():
                name = RANGE if (near.low >= 0.0).all() else f"{RATE} or the {RANGE}"
                close = combined((side, command), shift=step - limit)
                # A command is never beyond its range.
                near = ordered(Interval(near.low, np.minimum(near.high, step)))
                terms.append((1.0, positive_part(close, near, self.plan.slope(near))))
        form = combined(*terms, shift=-step)
        return Excess(form, self._range(form), name)

    def _empty(self, channels: Sequence[Channel]) -> Flags:
        empty = np.zeros(len(self.pieces), dtype=bool)
        for channel in channels:
            for excess in (channel.above, channel.below):
                if excess is not None:
                    empty |= excess.values.low > excess.values.high
            empty |= channel.by.low > channel.by.high
        return empty

    def _keep(self, which: Flags) -> None:
        """Drop all pieces but these."""
        self.pieces.keep(which)

    def _split(self, cut: Cut) -> None:
        """Below and above `cut.at`: a flight is in one of the two."""
        # The lower halves stay in place, the upper ones are appended.
        which, pieces = np.flatnonzero(cut.which), self.pieces
        form, values, _ = cut.excess
        count = len(pieces)
        pieces.split(which)
        both = [
            np.concatenate([array, array[which]])
            for array in (form.coefficients, form.err, form.size)
        ]
        at = np.where(cut.which, cut.at, values.high)
        to = Interval(
            np.concatenate([values.low, at[which] - self.overlap]),
            np.concatenate([at + self.overlap, values.high[which]]),
        )
        parts = np.concatenate([which, count + np.arange(len(which))])
        rows = np.concatenate([cut.row, cut.row[which]])
        pieces.constrain(parts, rows[parts], Form(*both), to)

    def _limited(self, i: int, channel: Channel, integral: Form) -> tuple[Form, Form, bool]:
        """How the command moves, its integral after the sample, and whether a limit can hold it."""
        moves, kept = [(1.0, channel.x)], [(1.0, integral), (1.0, channel.increment)]
        left, between = [], Interval.point(np.zeros(len(self.pieces)))
        for side, excess in ((1.0, channel.above), (-1.0, channel.below)):
            if excess is None or not (excess.values.high > 0.0).any():
                continue
            excess_part = self._positive_part(excess.form, excess.values, KINDS[i])
            rest, values, by = excess_part, excess.values, ordered(channel.by * side)
            if self.loop.conditional and (by.high > 0.0).any():
                outwards = combined((side, channel.increment))
                refused = self._positive_part(outwards, by, PHI_INTEGRAL + i)
                beyond = combined((1.0, excess.form), (-1.0, refused))
                values = self._range(beyond)
                # The increment refused is not negative.
                values = Interval(values.low, np.minimum(values.high, excess.values.high))
                rest = self._positive_part(beyond, ordered(values), PHI_INTEGRAL + i)
                kept += [(-side, excess_part), (side, rest)]
            moves.append((-side, excess_part))
            left.append((side, rest))
            low, high = (np.maximum(end, 0.0) for end in (values.low, values.high))
            between = between + ordered(Interval(low, high)) * side
        if left:
            self._remember(i, channel, combined(*left), between)
        return combined(*moves), combined(*kept), bool(left)

    def _positive_part(self, form: Form, values: Interval, kind: int) -> Form:
        """``max(F, 0)``, with a symbol for its error where there is one."""
        part = positive_part(form, ordered(values), self.plan.slope(values))
        # Where all flights are on one side of the kink, the line is exact and needs no symbol.
        kinked = (values.low < 0.0) & (values.high > 0.0)
        return self.pieces.fresh(part, kind) if kinked.any() else part

    def _remember(self, i: int, channel: Channel, left: Form, between: Interval) -> None:
        """Constrain the part of the command that limits hold back beyond the increment refused."""
        sides = [excess.values for excess in (channel.above, channel.below) if excess is not None]
        kinked = np.any([(values.low < 0.0) & (values.high > 0.0) for values in sides], axis=0)
        which = np.flatnonzero(kinked & (between.radius > NARROWEST))
        if len(which) and len(self.pieces.constrained):
            self.pieces.constrain(which, np.full(len(which), SPLITS + i), left, between)

    def _relative(self, at: "Controlled", seen: Form, after: Form) -> Form:
        """The load-factor command beyond the feed-forward of the roll seen next, `after`."""
        extra = at.extra
        if at.lift:
            change = combined((1.0, after), (-1.0, seen))
            by = self._range(change)
            # Without a lag the roll seen next is the command, which its rate limit holds.
            if not self.loop.lags:
                law = self.loop.channels[0]
                by = Interval(
                    np.maximum(by.low, law.step_down - COMPUTED),
                    np.minimum(by.high, law.step_up + COMPUTED),
                )
            by = ordered(by)
            if not ((at.roll + by).largest < LARGEST_ANGLE).all():
                raise Unbounded(ROLL_UNBOUNDED)
            extra = combined((1.0, extra), (at.lift, secant_change(seen, at.roll, change, by)))
        return self.pieces.fresh(extra, EXTRA_LIFT)

    def _load(self, at: "Controlled") -> Form:
        """The load-factor command."""
        if at.lift == 0.0:
            return at.extra
        return combined((1.0, at.extra), (at.lift, secant(self._seen(at.state), at.roll)))

    def _lift_and_load(self, at: "Controlled") -> tuple[Form, Interval]:
        """The row `EXTRA_LIFT` times the cosine of roll, and the values of the command."""
        values, cos_phi = ordered(self._range(at.extra)), cosine(at.roll)
        lifted = product(at.extra, values, cosine_of(at.phi, at.roll), cos_phi)
        return lifted, values + Interval.point(np.full_like(at.roll.low, at.lift)) / cos_phi

    def _paper_law(self, k: int, at: "Controlled") -> "Flown":
        r"""The paper's law over a sample; docs/tube.md derives the remainder.

        With y = gamma(t) - gamma and ``f = (g/V)(n_z cos(phi) - cos(gamma)) + d``, d the middle of
        the disturbance, ``y(h) = h f + (h^2/2)(g/V) sin(gamma) f + R`` where ``|R|`` is at most
        ``(g/V)(h^2/2)((g/V)Y + (g/V)Y^2/2 + D) + (g/V)h Y^2/2 + h D`` for ``|y| <= Y``.
        """
        pieces, loop, h, rate = self.pieces, self.loop, self.loop.dt, self.loop.g_over_v
        state, phi = at.state, at.phi
        extra = self._relative(at, state[PHI], phi)
        roll, climb = self._angle(phi, "roll"), self._angle(state[GAMMA], CLIMB)
        d = Interval(loop.d_low[k], loop.d_high[k])
        d_middle, d_radius = d.middle, d.radius
        chi = combined(
            (1.0, state[CHI]), (h * rate, tangent(phi, roll)), shift=h * d_middle[0]
        ).widened(h * d_radius[0] * UP + COMPUTED)
        lifted, load = self._lift_and_load(at._replace(extra=extra, roll=roll))
        f = combined(
            (rate, lifted),
            (-rate, cosine_of(state[GAMMA], climb)),
            shift=rate * at.lift + d_middle[1],
        )
        f_range = ordered(self._range(f))
        fastest = f_range.largest + d_radius[1]
        # Gronwall: f grows with y by at most g/V.
        farthest = h * fastest * math.exp(rate * h) * UP
        # d(cos gamma) = -sin(gamma) d gamma: the slope of f in gamma, taken at its middle.
        slope = sine(climb)
        bend = 0.5 * h * h * rate
        rest = (
            bend * (rate * farthest * (1.0 + 0.5 * farthest) + d_radius[1])
            + 0.5 * rate * h * farthest * farthest
            + h * d_radius[1]
            + bend * slope.radius * f_range.largest
        )
        gamma = combined((1.0, state[GAMMA]), (h + bend * slope.middle, f)).widened(
            rest * UP + COMPUTED
        )
        spread = 2.0 * np.array([d_radius[0], d_radius[1] + rate * float(farthest.max())])
        return Flown(
            chi=pieces.fresh(chi, CHI),
            gamma=pieces.fresh(gamma, GAMMA),
            extra=extra,
            lags=[],
            commands=[roll, load],
            spread=spread,
        )

    def _point_mass(self, k: int, at: "Controlled") -> "Flown":
        """The exact point mass, behind lags if there are any."""
        pieces, loop, state, phi = self.pieces, self.loop, at.state, at.phi
        n_z = self._load(at)
        # A symbol of its own: behind a lag the same error comes back in later samples.
        n_z = pieces.fresh(n_z.widened(COMPUTED), N_Z)
        commands = [ordered(self._range(command)) for command in (phi, n_z)]
        rolled, loaded = (Moved(*pair) for pair in zip((phi, n_z), commands, strict=True))
        lags: list[Form] = []
        if loop.lags:
            (rolled, loaded), lags = self._behind_lags(state, (phi, n_z))
        if not (rolled.values.largest < LARGEST_ANGLE).all():
            raise Unbounded(ROLL_UNBOUNDED)
        climb = self._angle(state[GAMMA], CLIMB)
        if not (climb.largest < STEEPEST).all():
            raise Unbounded(f"{CLIMB} cannot be kept inside {math.degrees(STEEPEST):.0f} deg")
        d = Interval(loop.d_low[k], loop.d_high[k])
        chi, gamma, spread = point_mass_sample(
            state[CHI], state[GAMMA], climb, (rolled, loaded), d, h=loop.dt, g_over_v=loop.g_over_v
        )
        after = lags[0] if lags else phi
        if loop.roll is not None:
            lags.append(self._roll_beyond(k, state[-1]))
            after = combined((1.0, after), (1.0, lags[-1]))
        return Flown(
            chi=pieces.fresh(chi.widened(COMPUTED), CHI),
            gamma=pieces.fresh(gamma.widened(COMPUTED), GAMMA),
            extra=self._relative(at, self._seen(state), after),
            lags=lags,
            commands=commands,
            spread=spread,
        )

    def _roll_beyond(self, k: int, now: Form) -> Form:
        """Difference of the roll seen from that behind the lag, a sample later.

        It is a e + w of the e now, w in ``(1 - a)`` times the box of e plus that of its change: so
        the changes stay small, and the sum of all w does not grow with time.
        """
        assert self.loop.roll is not None
        low, high, slowest, fastest = self.loop.roll[k]
        w = _interval(low, high) * (1.0 - ROLL_KEPT) + _interval(slowest, fastest)
        later = combined((ROLL_KEPT, now), shift=w.middle).widened(w.radius)
        return self.pieces.fresh(later, ROLL_BEYOND)

    def _behind_lags(
        self, state: Sequence[Form], commands: Sequence[Form]
    ) -> tuple[list[Moved], list[Form]]:
        """Roll and load factor flown, and the rows of the lags and of the commands under way."""
        flown, after, under_way = [], [], []
        for lag, own, queue, command in zip(
            self.loop.lags, *self.loop.layout, commands, strict=True
        ):
            newest_first = [command, *state[queue]]
            # An older and a newer command are in force: the delay is no whole number of samples.
            inputs = [*state[own], newest_first[lag.older + 1], newest_first[lag.older]]
            rows_after = np.vstack([lag.transition, lag.mean])
            *moved, mean = (form.widened(COMPUTED) for form in transformed(rows_after, inputs))
            ranges = [ordered(self._range(form)) for form in (*inputs, moved[0])]
            # Within the sample either of the two commands may be in force.
            in_force = ranges[lag.order].hull(ranges[lag.order + 1])
            values = lag.values_within(ranges[: lag.order], ranges[-1], in_force, self.loop.dt)
            if values is None:
                raise Unbounded("a lag moves too far in a sample to be enclosed")
            flown.append(Moved(mean, values))
            after += moved
            under_way += newest_first[:-1]
        return flown, [*after, *under_way]


class Controlled(NamedTuple):
    """The controller's part of a sample."""

    state: list[Form]  # rows before the sample
    errors: list[Form]
    roll: Interval  # rad: values of the roll that the controller sees
    phi: Form  # rad: roll command
    extra: Form  # load-factor command, as in the row `EXTRA_LIFT`
    lift: float  # ``cos(gamma_ref)`` of the feed-forward; 0 without one
    integrals: list[Form]
    limited: Sequence[bool]  # whether a limit can hold the command


class Flown(NamedTuple):
    """A set one sample later, and the values of the two commands in between.

    `spread` is how far apart the rates of a flight can be within the sample, rad/s.
    """

    chi: Form
    gamma: Form
    extra: Form
    lags: list[Form]
    commands: list[Interval]
    spread: FloatArray


def _interval(low: float, high: float) -> Interval:
    return Interval(np.array([low]), np.array([high]))


def ordered(values: Interval) -> Interval:
    """`values` where they are a range; of a piece without flights any range will do."""
    return Interval(np.minimum(values.low, values.high), np.maximum(values.low, values.high))
