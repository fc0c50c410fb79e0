r"""One sample of the loop for a whole set of flights: the flown controller, then the plant.

Let x be the unlimited command minus the command u in force. An upper limit reduces the command by
``max(Y, 0)`` with ``Y = x - r + max(u + r - hi, 0)`` for the range up to `hi` and the step r of the
rate limit, and likewise below. So `pi_step` is

    u+ = u + x - max(Y, 0) + max(Z, 0)
    I+ = I + J - (max(Y, 0) - S) + ...  with  S = max(Y - max(J, 0), 0)

with J the trapezoid's increment: the second line is conditional anti-windup. It is affine if all
flights are on one side of every kink. Otherwise a kink becomes a line and a symbol for its error.
The two lines share the symbol of ``max(Y, 0)``, so that it cancels in the next x, which is ``K_P``
times the change of the errors, plus the next J, plus S. Pieces store the values of S, which are
narrower than its form.

The load-factor command is kept as v, its excess over the feed-forward
``cos(gamma_ref)/cos(phi)``. In x the feed-forward cancels, and ``n_z cos(phi)`` is
``v cos(phi) + cos(gamma_ref)``.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.claims.tubes.dynamics import SampledLag, point_mass_sample
from flighttune.claims.tubes.forms import (
    UP,
    Flags,
    Form,
    Forms,
    Indices,
    Pieces,
    Quantity,
    combined,
    cosine_of,
    positive_part,
    product,
    secant,
    secant_change,
    tangent,
    transformed,
)
from flighttune.claims.tubes.interval import (
    Interval,
    Unbounded,
    check_inside,
    cosine,
    sine_and_cosine,
)
from flighttune.control.law import SampledController
from flighttune.control.mimo_pi import ChannelLaw

# Rows of the state, with the errors of the previous sample. `EXTRA_LIFT` is the load-factor command
# beyond its feed-forward. For the exact law it is the command times the cosine of the roll command,
# or with feedback the command alone.
CHI, GAMMA, PHI, EXTRA_LIFT, PHI_INTEGRAL, N_Z_INTEGRAL, CHI_ERR, GAMMA_ERR = range(8)

STATES = 8

# Kinds of the symbols of a load-factor command through a lag, and of the seen roll minus the lag's
# roll.
N_Z, ROLL_BEYOND = STATES, STATES + 1

# Share of this difference that is kept from sample to sample; 1 minus the share is exact
ROLL_KEPT = 0.875

# Kinds of the symbols of the two commands
KINDS = PHI, EXTRA_LIFT

# Number of splits that a piece remembers
SPLITS = 4

# Rows of constraints: the splits, then the part of each command that limits remove
CONSTRAINTS = SPLITS + 2

# A range with a smaller half width, rad and 1, is not stored, because it excludes nothing
NARROWEST = 1e-9

# Maximum number of symbols that a sample adds. The paper's law adds 12 for the kinks of four
# limits, 2 commands, 2 integrals, course, path angle, and with lags a load factor and a seen roll.
# The exact law adds 7, and one for every split after its roll command.
FRESH_SYMBOLS = 20

# Number of samples after which accumulated errors become symbols, so that feedback can reduce them
REDUCE_EVERY = 25

# Bound, rad and 1, on the error of a computed flight in a sample, from the classical Runge-Kutta
# rule over 0.02 s and rounding.
COMPUTED = 1e-11

# Columns of the reference of a loop: angles, planned commands, rates, and the vertical lift of the
# feed-forward
REFERENCE, PLANNED, RATES, LIFT = slice(0, 2), slice(2, 4), slice(4, 6), 6

# Rows of the boxes of a loop: disturbances of the two rates, seen roll minus the lag's roll, and
# its change to the next sample.
D, ROLL, ROLL_CHANGE = slice(0, 2), 2, 3

CLIMB = "the flight-path angle"

# Maximum flight-path angle of the exact point mass, whose course is undefined at 90 deg
STEEPEST = math.radians(85.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledLoop:
    """The loop that all flights of a set share."""

    law: SampledController  # the controller's numbers
    # shape (k, 7), rad, rad, rad, 1, rad/s, rad/s, weights, in the columns `REFERENCE`, `PLANNED`,
    # `RATES` and `LIFT`; zeros if a law does not use a plan, rates or feed-forward.
    reference: FloatArray
    # shape (k, 2 or 4, 2), rad/s and rad: lowest and highest values from a sample to the next, in
    # the rows `D`, and `ROLL` and `ROLL_CHANGE` if the controller sees more than the lag's roll.
    boxes: FloatArray
    dt: float  # s
    V_a: float  # m/s
    g: float  # m/s^2
    # length 4: course, flight-path angle, roll and load factor in the middle of the starts; a
    # missing load factor means steady flight at the path angle of each start.
    start: tuple[float, float, float, float | None]
    exact: bool  # whether the point mass turns by its actual lift, instead of the paper's law
    lags: tuple[SampledLag, ...]  # lags of roll and load factor; only the exact point mass has them

    @property
    def g_over_v(self) -> float:
        """Gravity over airspeed, 1/s."""
        return self.g / self.V_a

    @property
    def sees_roll(self) -> bool:
        """Whether the controller sees more than the lag's roll."""
        return self.boxes.shape[1] > ROLL

    @property
    def rows(self) -> int:
        """Number of rows: `STATES`, lags, delayed commands, additional roll, expected commands."""
        lagged = sum(lag.order + lag.older + 1 for lag in self.lags)
        return STATES + lagged + self.sees_roll + 2 * self.law.feeds_back

    @property
    def layout(self) -> tuple[list[slice], list[slice]]:
        """Rows of each lag, and of its delayed commands, newest first."""
        counts = [lag.order for lag in self.lags] + [lag.older + 1 for lag in self.lags]
        rows = [slice(*ends) for ends in pairwise(accumulate(counts, initial=STATES))]
        return rows[: len(self.lags)], rows[len(self.lags) :]

    @property
    def steady(self) -> FloatArray:
        """State of steady flight on the last reference."""
        state = np.zeros(self.rows)
        chi, gamma, phi, planned = self.reference[-1, :4]
        n_z = planned or np.cos(gamma)
        extra = n_z - self.reference[-1, LIFT]
        state[[CHI, GAMMA, PHI, EXTRA_LIFT]] = chi, gamma, phi, extra
        state[N_Z_INTEGRAL] = 0.0 if self.law.inverts else extra - planned
        for rows, queue, lag, value in zip(*self.layout, self.lags, (phi, n_z), strict=False):
            state[rows], state[queue] = lag.rest * value, value
        if self.sees_roll:
            state[-1] = self.boxes[-1, ROLL].mean()
        if self.law.feeds_back:
            state[-2:] = phi, n_z
        return state


class Channel(NamedTuple):
    """One command before its limits: x, the increment with its values, and the excesses Y."""

    x: Form
    increment: Form
    by: Interval
    excesses: Mapping[float, Quantity]  # excesses over existing limits: 1 above and -1 below


# A split by the excess of a channel on a side: pieces, value of the excess, and constraint row.
Cut: TypeAlias = tuple[int, float, Flags, FloatArray, Indices]


class Plan(Protocol):
    """The free choices of an enclosure, which is valid for any choice."""

    def multipliers(self, pieces: Pieces, form: Form) -> FloatArray:
        """Multipliers of the constrained rows, for the range of a form, shape (P, c)."""
        ...

    def slope(self, values: Interval) -> FloatArray:
        """Slope of the line that encloses ``max(F, 0)``, shape (P,)."""
        ...

    def cut(self, pieces: Pieces, channels: Sequence[Channel]) -> Cut | None:
        """Next split before the sample is computed; None to continue."""
        ...

    def pairs(self, pieces: Pieces) -> Indices:
        """Symbols to remove, for `Pieces.reduce`."""
        ...


class Controlled(NamedTuple):
    """The controller's part of a sample."""

    state: list[Form]  # rows before the sample
    errors: list[Form]
    roll: Quantity  # rad: roll that the controller sees
    phi: Form  # rad: roll command
    extra: Form  # load-factor command, as in the row `EXTRA_LIFT`
    lift: float  # vertical lift of the feed-forward, in weights; 0 without one
    integrals: list[Form]
    limited: Sequence[bool]  # whether a limit can hold the command
    expected: Forms = ()  # with feedback both expected commands


# Course, flight-path angle, the row `EXTRA_LIFT` and the rows of the lags one sample later; the
# values of the two commands in between; and the width of the range of a flight's rates within the
# sample, shape (2,), rad/s.
Flown: TypeAlias = tuple[list[Form], list[Interval], FloatArray]


def start_set(loop: SampledLoop, within_start: float, sides: int, symbols: int) -> Pieces:
    """All starts within `within_start` (rad) of both angles, in `sides` squared pieces."""
    chi, gamma, phi, n_z = loop.start
    edges = np.linspace(-within_start, within_start, sides + 1)
    # Midpoints and half width of the pieces along one axis.
    middles, radius = 0.5 * (edges[1:] + edges[:-1]), within_start / sides * UP
    centres = np.zeros((sides * sides, loop.rows))
    centres[:, CHI] = chi + np.repeat(middles, sides)
    centres[:, GAMMA] = gamma + np.tile(middles, sides)
    centres[:, PHI] = phi
    pieces = Pieces(centres, CONSTRAINTS, symbols)
    state = pieces.forms()
    # Two symbols span the starts of a piece and determine everything else.
    for row in (CHI, GAMMA):
        state[row] = pieces.fresh(state[row].widened(radius + COMPUTED), row)
    level = cosine(Interval.point(np.full(len(centres), phi)))
    if n_z is None:
        steady = 1.0 / level
        climb = Quantity(state[GAMMA], pieces.plain_range(state[GAMMA]))
        load = combined((steady.middle, cosine_of(climb).form))
        load = load.widened(steady.radius + COMPUTED)
    else:
        load = combined((0.0, state[GAMMA]), shift=n_z).widened(COMPUTED)
    if loop.law.feeds_back:
        state[EXTRA_LIFT], state[-2:] = load, [state[PHI], load]
    elif loop.law.inverts:
        doubt = level.radius * load.size + COMPUTED
        state[EXTRA_LIFT] = combined((level.middle, load)).widened(doubt)
    else:
        state[EXTRA_LIFT] = combined((1.0, load), shift=-(loop.reference[0, LIFT] / level))
    for rows, queue, lag, value in zip(*loop.layout, loop.lags, (state[PHI], load), strict=False):
        state[rows] = [combined((share, value)).widened(COMPUTED) for share in lag.rest]
        state[queue] = [value] * (queue.stop - queue.start)
    if loop.sees_roll:
        beyond = combined((0.0, state[PHI]), shift=Interval(*loop.boxes[0, ROLL, :, np.newaxis]))
        state[-1] = pieces.fresh(beyond, ROLL_BEYOND)
    pieces.put(state)
    return pieces


class Enclosure:
    """A set of flights, initially the starts, propagated from sample to sample."""

    overlap = 0.0

    def __init__(self, loop: SampledLoop, pieces: Pieces, plan: Plan) -> None:
        self.loop, self.pieces, self.plan = loop, pieces, plan
        self._margin = np.zeros(2)

    def sample(self, k: int) -> tuple[FloatArray, Flags]:
        """Propagate the set through sample k to the next; return its proven bounds.

        Bounds of course error, flight-path-angle error, roll and load-factor command, shape (4, 2),
        and whether a limit can hold each command. A margin on the errors makes the straight lines
        between the bounds of consecutive samples valid too. Raises Unbounded if an angle leaves the
        range in which the functions are enclosed.
        """
        pieces, loop = self.pieces, self.loop
        if pieces.used + FRESH_SYMBOLS > pieces.capacity or k % REDUCE_EVERY == REDUCE_EVERY - 1:
            pieces.reduce(self.plan.pairs(pieces))
        pieces.make_room(FRESH_SYMBOLS)
        stage = self._controlled(k)
        # Ranges of the errors of this sample, before the next sample overwrites its rows.
        errors = [*map(self._range, stage.errors)]
        fly = self._point_mass if loop.exact else self._paper_law
        (chi, gamma, extra, *lags), commands, spread = fly(k, stage)
        rows = [chi, gamma, stage.phi, extra, *stage.integrals, *stage.errors]
        pieces.put([*rows, *lags, *stage.expected])
        ranges = [values.ordered for values in (*errors, *commands)]
        bounds = np.array([(values.low.min(), values.high.max()) for values in ranges])
        # Between samples a flight leaves the straight line by at most a quarter of the sample time
        # times the width of its rate's range. The line between the bounds needs this margin at both
        # ends, so a sample takes the larger margin of the intervals before and after it.
        after = 0.25 * loop.dt * spread * UP
        margin, self._margin = np.maximum(self._margin, after), after
        bounds[:2, 0] -= margin
        bounds[:2, 1] += margin
        return bounds, np.array(stage.limited)

    def _controlled(self, k: int) -> Controlled:
        """The commands of sample k, after the necessary splits."""
        pieces, lift = self.pieces, self.loop.reference[k, LIFT]
        # A split changes the pieces and their constraints, so every form is computed again after
        # it. No symbol is added before the last pass, because constraints may only use symbols that
        # stay.
        while True:
            state = pieces.forms()
            errors = self._errors(k, state)
            roll = self._seen(state)
            # The row is relative to the reference of the previous sample.
            extra, moved = state[EXTRA_LIFT], lift - self.loop.reference[max(k - 1, 0), LIFT]
            if moved != 0.0:
                extra = combined((1.0, extra), (-moved, secant(roll).form))
            channels = self._channels(k, state, errors, roll, extra)
            if not self._fewer_or_more(channels):
                break
        moves, integrals, limited = zip(
            *(self._limited(i, c, state[PHI_INTEGRAL + i]) for i, c in enumerate(channels)),
            strict=True,
        )
        phi = pieces.fresh(combined((1.0, state[PHI]), (1.0, moves[0])).widened(COMPUTED), PHI)
        extra = combined((1.0, extra), (1.0, moves[1])).widened(COMPUTED)
        return Controlled(state, errors, roll, phi, extra, lift, self._kept(integrals), limited)

    def _kept(self, integrals: Forms) -> list[Form]:
        """Integrals, with a symbol for each error."""
        return [
            self.pieces.fresh(form.widened(COMPUTED), PHI_INTEGRAL + i)
            for i, form in enumerate(integrals)
        ]

    def _fewer_or_more(self, channels: Sequence[Channel]) -> bool:
        """Drop pieces without flights, or split; return whether the pieces changed."""
        ranges = [channel.by for channel in channels]
        ranges += [over.values for channel in channels for over in channel.excesses.values()]
        empty = np.any([values.low > values.high for values in ranges], axis=0)
        if empty.any():
            self._keep(~empty)
            return True
        if (cut := self.plan.cut(self.pieces, channels)) is not None:
            self._split(cut, channels)
        return cut is not None

    def _range(self, form: Form) -> Interval:
        """The values of a form; low is above high in a piece without flights."""
        values, pieces = self.pieces.plain_range(form), self.pieces
        if pieces.constrained.any():
            constrained = pieces.constrained_range(form, self.plan.multipliers(pieces, form))
            values = Interval(
                np.maximum(values.low, constrained.low), np.minimum(values.high, constrained.high)
            )
        return values

    def _ranged(self, form: Form) -> Quantity:
        return Quantity(form, self._range(form).ordered)

    def _angle(self, form: Form, name: str) -> Quantity:
        angle = self._ranged(form)
        check_inside(angle.values, name)
        return angle

    def _errors(self, k: int, state: Forms) -> list[Form]:
        chi_ref, gamma_ref = self.loop.reference[k, REFERENCE]
        # The controller wraps the course error, so all flights of a piece must wrap equally.
        chi_err = combined((-1.0, state[CHI]), shift=chi_ref)
        turns = np.round(chi_err.coefficients[:, 0] / math.tau)
        chi_err = combined((1.0, chi_err), shift=-turns * math.tau)
        if not (self._range(chi_err).largest < math.pi).all():
            raise Unbounded("the course error can pass half a turn")
        return [chi_err, combined((-1.0, state[GAMMA]), shift=gamma_ref)]

    def _seen(self, state: Forms) -> Quantity:
        """The roll that the controller sees."""
        roll = state[STATES if self.loop.lags else PHI]
        if self.loop.sees_roll:
            roll = combined((1.0, roll), (1.0, state[-1]))
        return self._angle(roll, "roll")

    def _channels(
        self, k: int, state: Forms, errors: Forms, roll: Quantity, extra: Form
    ) -> list[Channel]:
        channels, lift = [], self.loop.reference[k, LIFT]
        for i, law in enumerate(self.loop.law.channels):
            # The trapezoid begins with the second sample, since no time precedes the first.
            increment = combined((0.0, errors[0]))
            if k > 0:
                errors_now = *errors, state[CHI_ERR], state[GAMMA_ERR]
                increment = combined(*zip((*law.K_I_half, *law.K_I_half), errors_now, strict=True))
            force = extra if i else state[PHI]
            x = combined(
                *zip(law.K_P, errors, strict=True),
                (1.0, state[PHI_INTEGRAL + i]),
                (1.0, increment),
                (-1.0, force),
                shift=self.loop.reference[k, PLANNED][i],
            )
            command = Quantity(force, self._range(force))
            if i and lift:
                steep = secant(roll)
                whole = combined((1.0, force), (lift, steep.form))
                command = Quantity(whole, command.values + steep.values * lift)
            excesses = self._excesses(x, command, law)
            channels.append(Channel(x, increment, self._range(increment), excesses))
        return channels

    def _excesses(self, x: Form, command: Quantity, law: ChannelLaw) -> dict[float, Quantity]:
        """Excesses over the limits above and below, with the command in force."""
        excesses, sides = {}, ((1.0, law.upper, law.step_up), (-1.0, -law.lower, -law.step_down))
        for side, limit, step in sides:
            if min(limit, step) == math.inf:
                continue
            terms, shift = [(side, x)], -step
            if math.isinf(step):
                terms, shift = [*terms, (side, command.form)], -limit
            elif not math.isinf(limit):
                # The step that the range allows: the whole step, unless the command is near its
                # end.
                near = command.values * side + (step - limit)
                if (near.high > 0.0).any():
                    close = combined((side, command.form), shift=step - limit)
                    # A command is never beyond its range.
                    near = Interval(near.low, np.minimum(near.high, step)).ordered
                    terms.append((1.0, positive_part(Quantity(close, near), self.plan.slope(near))))
            form = combined(*terms, shift=shift)
            excesses[side] = Quantity(form, self._range(form))
        return excesses

    def _keep(self, flags: Flags) -> None:
        """Drop all pieces but these."""
        self.pieces.keep(flags)

    def _split(self, cut: Cut, channels: Sequence[Channel]) -> None:
        """Split below and above a value of an excess; each flight is in one of the two."""
        # The lower halves stay in place, the upper ones are appended.
        i, side, chosen, splits, row = cut
        form, values = channels[i].excesses[side]
        indices, pieces = np.flatnonzero(chosen), self.pieces
        part, splits, row = form.part(indices), splits[indices], row[indices]
        lower = Interval(values.low[indices], splits + self.overlap)
        upper = Interval(splits - self.overlap, values.high[indices])
        appended = len(pieces) + np.arange(len(indices))
        pieces.split(indices)
        pieces.constrain(indices, row, part, lower)
        pieces.constrain(appended, row, part, upper)

    def _limited(self, i: int, channel: Channel, integral: Form) -> tuple[Form, Form, bool]:
        """Move of a command, its integral after the sample, and whether a limit can hold it."""
        moves, integral_terms = [(1.0, channel.x)], [(1.0, integral), (1.0, channel.increment)]
        remainders, between = [], Interval.point(np.zeros(len(self.pieces)))
        for side, excess in channel.excesses.items():
            if not (excess.values.high > 0.0).any():
                continue
            excess_part = self._positive_part(excess, KINDS[i])
            remainder, values, by = excess_part, excess.values, (channel.by * side).ordered
            if self.loop.law.conditional and (by.high > 0.0).any():
                outwards = combined((side, channel.increment))
                refused = self._positive_part(Quantity(outwards, by), PHI_INTEGRAL + i)
                beyond = combined((1.0, excess.form), (-1.0, refused))
                values = self._range(beyond)
                # The increment refused is not negative.
                values = Interval(values.low, np.minimum(values.high, excess.values.high))
                remainder = self._positive_part(Quantity(beyond, values.ordered), PHI_INTEGRAL + i)
                integral_terms += [(-side, excess_part), (side, remainder)]
            moves.append((-side, excess_part))
            remainders.append((side, remainder))
            low, high = (np.maximum(end, 0.0) for end in (values.low, values.high))
            between = between + Interval(low, high).ordered * side
        if remainders:
            self._remember(i, channel, combined(*remainders), between)
        return combined(*moves), combined(*integral_terms), bool(remainders)

    def _positive_part(self, quantity: Quantity, kind: int) -> Form:
        """``max(F, 0)``, with a symbol for its error where there is one."""
        form, values = quantity
        part = positive_part(Quantity(form, values.ordered), self.plan.slope(values))
        # If all flights are on one side of the kink, the line is exact and needs no symbol.
        kinked = (values.low < 0.0) & (values.high > 0.0)
        return self.pieces.fresh(part, kind) if kinked.any() else part

    def _remember(self, i: int, channel: Channel, remainder: Form, between: Interval) -> None:
        """Constrain the part of the command that limits remove beyond the refused increment."""
        sides = [excess.values for excess in channel.excesses.values()]
        kinked = np.any([(values.low < 0.0) & (values.high > 0.0) for values in sides], axis=0)
        indices = np.flatnonzero(kinked & (between.radius > NARROWEST))
        if len(indices) and len(self.pieces.constrained):
            to = Interval(between.low[indices], between.high[indices])
            self.pieces.constrain(
                indices, np.full(len(indices), SPLITS + i), remainder.part(indices), to
            )

    def _relative(self, stage: Controlled, after: Form) -> Form:
        """The load-factor command beyond the feed-forward at the next seen roll, `after`."""
        extra = stage.extra
        if stage.lift:
            change = combined((1.0, after), (-1.0, stage.roll.form))
            by = self._range(change)
            # Without a lag the next seen roll is the command, which is inside its rate limit.
            if not self.loop.lags:
                law = self.loop.law.channels[0]
                by = Interval(
                    np.maximum(by.low, law.step_down - COMPUTED),
                    np.minimum(by.high, law.step_up + COMPUTED),
                )
            less_steep = secant_change(stage.roll, Quantity(change, by.ordered))
            extra = combined((1.0, extra), (stage.lift, less_steep))
        return self.pieces.fresh(extra, EXTRA_LIFT)

    def _load(self, stage: Controlled) -> Form:
        """The load-factor command."""
        if stage.lift == 0.0:
            return stage.extra
        return combined((1.0, stage.extra), (stage.lift, secant(stage.roll).form))

    def _lift_and_load(self, stage: Controlled) -> tuple[Form, Interval]:
        """The row `EXTRA_LIFT` times the cosine of roll, and the values of the command."""
        extra, level = self._ranged(stage.extra), cosine_of(stage.roll)
        return product(extra, level), extra.values + stage.lift / level.values

    def _paper_law(self, k: int, stage: Controlled) -> Flown:
        r"""The paper's law over a sample, with constant commands.

        With y = gamma(t) - gamma and ``f = (g/V)(n_z cos(phi) - cos(gamma)) + d``, d the middle of
        the disturbance, ``y(h) = h f + (h^2/2)(g/V) sin(gamma) f + R`` where ``|R|`` is at most
        ``(g/V)(h^2/2)((g/V)Y + (g/V)Y^2/2 + D) + (g/V)h Y^2/2 + h D`` for ``|y| <= Y``, which is
        ``h (|f| + D) exp(h g/V)``. The result follows from ``cos(gamma) - cos(gamma + y) = y
        sin(gamma) + y^2 cos(zeta)/2``, inserted twice into the integral of the rate.
        """
        pieces, loop, h, rate = self.pieces, self.loop, self.loop.dt, self.loop.g_over_v
        state = stage.state
        extra = self._relative(stage, stage.phi)
        roll, climb = self._angle(stage.phi, "roll"), self._angle(state[GAMMA], CLIMB)
        d = Interval(*loop.boxes[k, D].T)
        d_middle, d_radius = d.middle, d.radius
        chi = combined((1.0, state[CHI]), (h * rate, tangent(roll)), shift=h * d_middle[0])
        chi = chi.widened(h * d_radius[0] * UP + COMPUTED)
        lifted, load = self._lift_and_load(stage._replace(extra=extra, roll=roll))
        f = combined(
            (rate, lifted), (-rate, cosine_of(climb).form), shift=rate * stage.lift + d_middle[1]
        )
        f_range = self._range(f).ordered
        fastest = f_range.largest + d_radius[1]
        # Gronwall: f grows with y by at most g/V.
        farthest = h * fastest * math.exp(rate * h) * UP
        # d(cos gamma) = -sin(gamma) d gamma: the slope of f in gamma, taken at its middle.
        slope = sine_and_cosine(climb.values)[0]
        bend = 0.5 * h * h * rate
        remainder = (
            bend * (rate * farthest * (1.0 + 0.5 * farthest) + d_radius[1])
            + 0.5 * rate * h * farthest * farthest
            + h * d_radius[1]
            + bend * slope.radius * f_range.largest
        )
        gamma = combined((1.0, state[GAMMA]), (h + bend * slope.middle, f))
        gamma = gamma.widened(remainder * UP + COMPUTED)
        spread = 2.0 * np.array([d_radius[0], d_radius[1] + rate * float(farthest.max())])
        rows = [pieces.fresh(chi, CHI), pieces.fresh(gamma, GAMMA), extra]
        return rows, [roll.values, load], spread

    def _point_mass(self, k: int, stage: Controlled) -> Flown:
        """The exact point mass, behind lags if there are any."""
        pieces, loop, state = self.pieces, self.loop, stage.state
        # A separate symbol, because behind a lag the same error returns in later samples.
        n_z = pieces.fresh(self._load(stage).widened(COMPUTED), N_Z)
        commands = [self._ranged(command) for command in (stage.phi, n_z)]
        (rolled, loaded), lags = commands, []
        if loop.lags:
            (rolled, loaded), lags = self._behind_lags(state, (stage.phi, n_z))
        check_inside(rolled.values, "roll")
        climb = self._angle(state[GAMMA], CLIMB)
        check_inside(climb.values, CLIMB, STEEPEST)
        d = Interval(*loop.boxes[k, D].T)
        chi, gamma, spread = point_mass_sample(
            state[CHI], climb, rolled, loaded, d, h=loop.dt, g_over_v=loop.g_over_v
        )
        after = lags[0] if lags else stage.phi
        if loop.sees_roll:
            # The difference e between the seen roll and the lag's roll becomes a e + w, with w in
            # ``(1 - a)`` times the box of e plus the box of its change. So the changes stay small,
            # and the sum of all w does not grow with time.
            e, change = (
                Interval(*loop.boxes[k, row, :, np.newaxis]) for row in (ROLL, ROLL_CHANGE)
            )
            w = e * (1.0 - ROLL_KEPT) + change
            lags.append(pieces.fresh(combined((ROLL_KEPT, state[-1]), shift=w), ROLL_BEYOND))
            after = combined((1.0, after), (1.0, lags[-1]))
        chi, gamma = (
            pieces.fresh(form.widened(COMPUTED), row) for form, row in ((chi, CHI), (gamma, GAMMA))
        )
        rows = [chi, gamma, self._relative(stage, after), *lags]
        return rows, [command.values for command in commands], spread

    def _behind_lags(self, state: Forms, commands: Forms) -> tuple[list[Quantity], list[Form]]:
        """Flown roll and load factor, and the rows of the lags and of the delayed commands."""
        reached, after, under_way = [], [], []
        for lag, rows, queue, command in zip(
            self.loop.lags, *self.loop.layout, commands, strict=True
        ):
            newest_first = [command, *state[queue]]
            # An older and a newer command act, because the delay is not a whole number of samples.
            inputs = [*state[rows], newest_first[lag.older + 1], newest_first[lag.older]]
            rows_after = np.vstack([lag.transition, lag.mean])
            *moved, mean = (form.widened(COMPUTED) for form in transformed(rows_after, inputs))
            ranges = [self._range(form).ordered for form in (*inputs, moved[0])]
            # Within the sample either of the two commands may act.
            in_force = ranges[lag.order].hull(ranges[lag.order + 1])
            values = lag.values_within(ranges[: lag.order], ranges[-1], in_force, self.loop.dt)
            reached.append(Quantity(mean, values))
            after += moved
            under_way += newest_first[:-1]
        return reached, [*after, *under_way]
