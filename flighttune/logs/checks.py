"""Columns of a log checked against the laws of motion, with corrections for wrong columns."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
import scipy

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, RecordingError
from flighttune.base.units import DEG, DEG_PER_RAD, FT, G_0, KNOT
from flighttune.base.words import listed
from flighttune.flight.loop.run import Run
from flighttune.logs.read import Stream
from flighttune.logs.relations import (
    KIND,
    KINDS,
    RELATIONS,
    SLOWEST,
    TRAILING,
    Motion,
    Relation,
    completed,
    copied,
)

# Vehicles without wings: PX4's type of vehicle, ArduPilot's name, types of MAVLink.
ROTARY = ("type 1 of PX4", "ArduCopter", *(f"type {kind}" for kind in (2, 3, 4, 13, 14, 15)))

# Units that are mistaken for each other, by kind of column, and the factor that corrects them.
_SPEEDS = {"kn read as m/s": KNOT, "km/h read as m/s": 1.0 / 3.6, "ft/s read as m/s": FT}
_SPEEDS |= {"cm/s read as m/s": 0.01, "mph read as m/s": 0.44704}
_LENGTHS = {"ft read as m": FT, "cm read as m": 0.01, "mm read as m": 0.001, "km read as m": 1000.0}
MISTAKEN = {
    "angle": {"deg read as rad": DEG},
    "rate": {"deg read as rad": DEG},
    "speed": _SPEEDS,
    "wind": _SPEEDS,
    "length": _LENGTHS,
    "load": {"m/s2 read as g": 1.0 / G_0, "ft/s2 read as g": FT / G_0},
    "force": {"g read as m/s2": G_0, "ft/s2 read as m/s2": FT},
}
NEAR = 0.15  # tolerance on the logarithm of the factor of a known mistake
ALIKE = 0.7  # correlation from which on two columns show the same motion
SURE = 0.85  # correlation from which a difference means a wrong unit or time
UNLIKE = {"motion": 0.8, "flight": 0.4, "loop": 0.4}  # below this they differ, by `rests_on`
FARTHEST_S = 5.0  # largest time shift of a column that is tried
# Ratio of unexplained variances from which another time shift is right, by `rests_on`. Small for a
# loop, whose response never precedes its command.
LATER = {"motion": 2.0, "flight": 2.0, "loop": 1.25}
COARSE_S = 0.1  # sample time at which columns are compared
MAX_SAMPLES = 20_000
ENOUGH_S = 10.0
WINDOW_S = 5.0  # time over which a column is compared with its value from others
AGREEING = 0.75  # share of such windows that outweighs the others
NEAR_IT = 0.4  # rms difference in a window, relative to the value from others: below that of knots
MAX_CURES = 6
OTHERS = 0.3  # cost of a change of columns other than the judged column
ONE_CLOCK = 0.03  # share by which ratios of one clock may differ

# Columns that share a unit or an axis.
TOGETHER = (
    *(("v_north", "v_east"), ("v_north", "v_east", "v_down"), ("v_north", "v_east", "V_a")),
    *(("v_north", "v_east", "v_down", "V_a"), ("V_g", "V_a"), ("V_g", "V_a", "v_down")),
    *(("north", "east"), ("wind_north", "wind_east"), ("p", "q", "r")),
)
# Columns of one instrument, which share their delay.
AT_ONE_TIME = (
    ("v_north", "v_east", "v_down", "north", "east", "h"),
    *(("v_north", "v_east", "v_down"), ("V_g", "chi", "v_down"), ("p", "q", "r")),
)

Status: TypeAlias = Literal["agrees", "contradicts", "unlike", "cannot tell"]
Given: TypeAlias = Mapping[str, FloatArray]


def refuse_wrong(*runs: Run) -> None:
    """Refuse logs whose columns contradict each other, before a model is fitted to them."""
    for run in runs:
        for sentence in (run.provenance.log or {}).get("wrong", ()):
            raise InputError(
                f"{run.label}: the columns of the log must agree: {sentence}. Where the column is "
                "right, --column trusted=NAME,NAME passes what is said of a signal."
            )


def degrees_as_radians(raw: Mapping[str, Stream]) -> dict[str, str]:
    """Sentences, by column, on angles whose values look like degrees."""
    limits = dict.fromkeys(("phi", "phi_cmd"), math.pi)
    limits |= dict.fromkeys(("theta", "gamma", "lat"), 0.5 * math.pi)
    limits |= dict.fromkeys(("lon", "chi", "psi", "chi_ref"), math.tau)
    sentences = {}
    for name, limit in limits.items():
        values = raw[name][1] if name in raw else np.zeros(0)
        values = values[np.isfinite(values)]
        most = float(np.percentile(np.abs(values), 99.0)) if len(values) > 1 else 0.0
        # A course may count many turns; in degrees it also jumps, or rests far from zero.
        running = np.abs(np.diff(values)).max(initial=0.0) < 30.0 * math.tau and most < 60.0
        if most > 1.01 * limit and not (limit == math.tau and running):
            factor = f"a factor of {DEG:.4g} would do (deg read as rad)"
            sentences[name] = f"{name} goes up to {most:.3g} rad: {factor}"
    return sentences


class Match(NamedTuple):
    """How a column compares with its value from others."""

    status: Status
    used: frozenset[str] = frozenset()  # given columns that were used
    ratio: float = math.nan  # column divided by its value from others, with the sign
    lag: float = math.nan  # delay of the column, s
    alike: float = math.nan  # correlation at this delay
    at_once: float = 0.0  # correlation without a delay
    turned: float = 0.0  # angle by which a vector is turned clockwise, rad
    why: str = ""  # why it cannot be judged
    most: float = 1.0  # share of the time in which it agrees


def _match(relation: Relation, motion: Motion) -> Match:
    """A relation judged in a motion."""
    name, made = relation.name, motion.sources(relation.name)
    own = {name} & motion.given.keys() or made
    lacks = [need for need in relation.needs if need not in motion]
    if not own or name not in motion:
        return Match("cannot tell")
    if lacks:
        return Match("cannot tell", why=f"the log has no {listed(lacks)}")
    if own & {source for need in relation.needs for source in motion.sources(need)}:
        return Match("cannot tell")  # both derive from the same column
    motion.used = set()
    sides = relation.sides(motion)
    used = frozenset(motion.used)
    if isinstance(sides, str):
        return Match("cannot tell", used, why=sides)
    column, other = (motion.smooth(side.reshape(len(side), -1)) for side in sides)
    found = _judged(relation, column, other, motion.dt)
    if found.status == "unlike":
        share = _agreeing(column, other, relation.still, motion.dt)
        if share >= AGREEING:
            found = found._replace(status="agrees", most=share)
    return found._replace(used=used)


def _agreeing(column: FloatArray, other: FloatArray, still: float, dt: float) -> float:
    """Share of the windows in which a column is near its value from others; 0 with too few.

    A correlation is that of the largest motions: a few seconds of them spoil it where the rest of a
    flight hardly varies. Windows in which the value from others is below `still` tell nothing.
    """
    size = max(1, round(WINDOW_S / dt))
    sides = [side[: len(side) // size * size] for side in (column - other, other)]
    off, level = (
        np.sqrt(np.mean(np.sum(side.reshape(-1, size, side.shape[1]) ** 2, axis=2), axis=1))
        for side in sides
    )
    telling = np.isfinite(off) & (level > still)
    if np.count_nonzero(telling) * WINDOW_S < ENOUGH_S:
        return 0.0
    return float(np.mean(off[telling] < NEAR_IT * level[telling]))


def _judged(relation: Relation, column: FloatArray, other: FloatArray, dt: float) -> Match:
    """Compare a column with its value from others: likeness, time and ratio, shape (n, axes)."""
    there = np.isfinite(column).all(axis=1) & np.isfinite(other).all(axis=1)
    if np.count_nonzero(there) * dt < ENOUGH_S:
        return Match("cannot tell", why=f"it and {relation.others} last less than {ENOUGH_S:g} s")
    x, y = column[there], other[there]
    if relation.about == "changes":
        x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    size, base = (math.sqrt(float(np.mean(np.sum(side**2, axis=1)))) for side in (x, y))
    if base < relation.still:
        return Match("cannot tell", why=f"the flight shows too little of {relation.others}")
    if size < 1e-6 * base:
        return Match("unlike", ratio=0.0, alike=0.0)
    lags, alike, ratios = _over_lags(column, other, dt, centred=relation.about == "changes")
    first, last = relation.lag
    inside = (lags >= first) & (lags <= last)
    score = np.nan_to_num(np.abs(alike))
    # For a periodic motion the smallest delay is taken.
    best = int(np.argmax(score - 0.01 * np.abs(lags)))
    near = int(np.argmax(np.where(inside, score - 0.01 * np.abs(lags), -1.0)))
    at_once = float(score[np.argmin(np.abs(lags))])
    peak = float(lags[best]) + dt * _beyond(score, best)
    better = 1.0 - score[near] ** 2 > LATER[relation.rests_on] * (1.0 - score[best] ** 2)
    late = better and not first <= peak <= last
    k = best if late else near
    lag = float(lags[k]) + dt * _beyond(score, k)
    found = Match("agrees", frozenset(), float(ratios[k]), lag, float(alike[k]), at_once)
    whole = 0.0
    if x.shape[1] == 2:
        product = np.mean((x @ [1, 1j]) * (y @ [1, -1j]))
        found = found._replace(turned=float(np.angle(product)))
        whole = abs(product) / max(size * base, 1e-30)
    level = relation.about == "values"  # a signal with a level agrees or has another unit
    if level and abs(found.turned) > relation.turned and whole > SURE:
        return found._replace(status="contradicts")
    if score[k] < (ALIKE if level else UNLIKE[relation.rests_on]) and base >= 2.0 * relation.still:
        return found._replace(status="unlike")
    if score[k] < ALIKE:
        return found._replace(
            status="cannot tell",
            why=f"only in part like {relation.others} (correlation {alike[k]:.2f})",
        )
    low, high = relation.within
    if low < found.ratio < high and not late:
        return found
    if found.ratio > 0.0 and score[k] < SURE and not level:
        why = f"only in part like {relation.others} (correlation {alike[k]:.2f})"
        return found._replace(status="cannot tell", why=why)
    return found._replace(status="contradicts")


def _beyond(score: FloatArray, k: int) -> float:
    """Samples from a maximum to the vertex of the parabola through its neighbours."""
    if not 0 < k < len(score) - 1:
        return 0.0
    before, top, after = score[k - 1 : k + 2]
    bend = before - 2.0 * top + after
    return float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0


def _over_lags(
    column: FloatArray, other: FloatArray, dt: float, *, centred: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Possible delays of a column, s, with its correlation and ratio at each."""
    most = min(round(FARTHEST_S / dt), len(column) // 3)
    length = scipy.fft.next_fast_len(len(column) + most, real=True)
    places = np.arange(-most, most + 1)

    def along(a: FloatArray, b: FloatArray) -> FloatArray:
        """Sum of a(t + lag) b(t) at each lag."""
        spectrum = scipy.fft.rfft(a, length, axis=0) * np.conj(scipy.fft.rfft(b, length, axis=0))
        return np.sum(scipy.fft.irfft(spectrum, length, axis=0), axis=1)[places]

    (a, on_a), (b, on_b) = (_filled(side, centred=centred) for side in (column, other))
    count = np.maximum(along(on_a, on_b), 1.0)
    ab = along(a, b)
    aa = along(np.sum(a * a, axis=1, keepdims=True), on_b)
    bb = along(on_a, np.sum(b * b, axis=1, keepdims=True))
    for i in range(a.shape[1] if centred else 0):
        sum_a, sum_b = along(a[:, i : i + 1], on_b), along(on_a, b[:, i : i + 1])
        ab, aa, bb = ab - sum_a * sum_b / count, aa - sum_a**2 / count, bb - sum_b**2 / count
    aa, bb = np.maximum(aa, 1e-30), np.maximum(bb, 1e-30)
    alike = np.clip(ab / np.sqrt(aa * bb), -1.0, 1.0)
    alike[count * dt < ENOUGH_S] = 0.0
    # Values are compared by their level; changes by their rms, since noise reduces the slope.
    ratios = np.sign(alike) * np.sqrt(aa / bb) if centred else ab / bb
    return (places * dt).astype(float), alike, ratios.astype(float)


def _filled(side: FloatArray, *, centred: bool) -> tuple[FloatArray, FloatArray]:
    """One side with 0 in its gaps, without its mean if `centred`, and its mask of samples."""
    there = np.asarray(np.isfinite(side).all(axis=1, keepdims=True))
    off = side - (side[there.ravel()].mean(axis=0) if centred else 0.0)
    return np.where(there, off, 0.0), there.astype(float)


class Cure(NamedTuple):
    """A change of columns that may correct a log."""

    columns: tuple[str, ...]
    words: str
    apply: Callable[[Given], Given]
    cost: float  # higher for a less likely change


def _scaled(names: Sequence[str], factor: float) -> Callable[[Given], Given]:
    return lambda given: {**given, **{name: factor * given[name] for name in names}}


def _exchanged(a: str, b: str) -> Callable[[Given], Given]:
    return lambda given: {**given, a: given[b], b: given[a]}


def _moved(names: Sequence[str], by: int) -> Callable[[Given], Given]:
    """Columns delayed by a number of samples."""

    def moved(column: FloatArray) -> FloatArray:
        late = np.full(len(column), np.nan)
        late[max(by, 0) : len(column) + min(by, 0)] = column[max(-by, 0) : len(column) - max(by, 0)]
        return late

    return lambda given: {**given, **{name: moved(given[name]) for name in names}}


def _rotated(by: float) -> Callable[[Given], Given]:
    c, s = math.cos(by), math.sin(by)
    return lambda given: {
        **given,
        "v_north": c * given["v_north"] - s * given["v_east"],
        "v_east": s * given["v_north"] + c * given["v_east"],
    }


def _turned(name: str, by: float) -> Callable[[Given], Given]:
    return lambda given: {**given, name: np.angle(np.exp(1j * (given[name] + by)))}


def _with_gravity(name: str, *, along: bool) -> Callable[[Given], Given]:
    """A load factor plus 1 g, or plus gravity along the body's axis."""

    def apply(given: Given) -> Given:
        up = np.cos(given["phi"]) * np.cos(given.get("theta", 0.0)) if along else 1.0
        return {**given, name: given[name] + up * (-G_0 if name == "f_z" else 1.0)}

    return apply


def _without(name: str) -> Callable[[Given], Given]:
    """Columns without one column; roll is emptied instead, because every log needs it."""

    def apply(given: Given) -> Given:
        empty = {name: np.full_like(given[name], np.nan)} if name == "phi" else {}
        return {key: column for key, column in given.items() if key != name} | empty

    return apply


def _factor(kind: str, ratio: float) -> tuple[float, str]:
    """Factor of a known mistake that brings a ratio to 1, with its words; else the ratio's own."""
    known = MISTAKEN.get(kind, {})
    swapped = {" read as ".join(reversed(x.split(" read as "))): 1 / f for x, f in known.items()}
    off = {words: abs(math.log(abs(ratio) * f)) for words, f in {**known, **swapped}.items()}
    words = min(off, key=lambda words: off[words], default="")
    if words and off[words] <= NEAR:
        return {**known, **swapped}[words], words
    return 1.0 / abs(ratio), ""


def _cures(motion: Motion, relation: Relation, match: Match) -> Iterator[Cure]:
    """Changes that may correct a relation that does not hold."""
    given, own = motion.given, {relation.name} | motion.sources(relation.name)
    for name in sorted(match.used):
        kind, stated = KIND.get(name, ""), name in own
        yield Cure((name,), "", _without(name), 1.0 if stated else 1.2)
        groups = [(name,), *(g for g in TOGETHER if name in g and given.keys() >= set(g))]
        for group in groups:
            to = "" if group == (relation.name,) else f" to {listed(group)}"
            if match.ratio < 0.0 or match.status == "unlike":
                turned = f"a factor of -1 would do (its sign is turned){to}"
                yield Cure(group, turned, _scaled(group, -1.0), 0.1 + 0.05 * len(group))
            if match.alike and abs(match.ratio) > 1e-3 and kind:
                ratio = match.ratio if stated else 1.0 / match.ratio
                factor, words = _factor(kind, ratio)
                factor = math.copysign(factor, ratio)
                if abs(abs(factor) - 1.0) > 0.2 and (words or stated):
                    words += " and its sign turned" * (factor < 0.0)
                    said = f"a factor of {factor:.4g} would do{f' ({words})' * bool(words)}{to}"
                    cost = (0.2 if words else 0.5) + 0.05 * len(group)
                    yield Cure(group, said, _scaled(group, factor), cost)
        for other in (x for x in KINDS.get(kind, ()) if x in given and x != name):
            pair = tuple(sorted((name, other)))
            yield Cure(pair, f"{pair[0]} and {pair[1]} exchanged would do", _exchanged(*pair), 0.3)
        if math.isfinite(match.lag) and match.status == "contradicts" and match.lag:
            by = (-1 if stated else 1) * round(match.lag / motion.dt)
            for group in ((name,), *(g for g in AT_ONE_TIME if name in g)):
                group = tuple(x for x in group if x in given)
                to = "" if group == (relation.name,) else f" of {listed(group)}"
                said = f"a shift by {by * motion.dt:+.1f} s{to} would do"
                yield Cure(group, said, _moved(group, by), 0.4 + 0.05 * len(group))
        yield from _changed(name, match, stated=stated)
        if name == "v_east" and "v_north" in given and abs(match.turned) > relation.turned:
            # The relation of v_north measures the turn of the velocity; all others measure that of
            # what is compared with the velocity, which turns the other way.
            by = -match.turned if relation.name == "v_north" else match.turned
            said = f"a turn of the velocity by {by * DEG_PER_RAD:+.1f} deg would do"
            yield Cure(("v_north", "v_east"), said, _rotated(by), 0.4)


def _changed(name: str, match: Match, *, stated: bool) -> Iterator[Cure]:
    """Constant offsets that a column may lack."""
    if name in ("n_z", "n_z_cmd", "f_z"):
        said = "a change by +1 would do (gravity is left out)"
        yield Cure((name,), said, _with_gravity(name, along=False), 0.2)
        said = "a change by +1 would do in level flight, cos(theta) cos(phi) (gravity is left out)"
        yield Cure((name,), said, _with_gravity(name, along=True), 0.25)
    if name in ("chi", "psi") and abs(match.turned) > TRAILING:
        by = -match.turned if stated else match.turned
        said = (
            f"magnetic, or axes that are turned; a change by {by * DEG_PER_RAD:+.1f} deg would do"
        )
        yield Cure((name,), said, _turned(name, by), 0.4)


class _Judgement:
    """Relations in the columns of a log, and after a cure of them."""

    def __init__(self, given: Given, dt: float, before: "_Judgement | None" = None) -> None:
        self.motion = Motion(given, dt)
        changed = set()
        if before is not None:
            old = before.motion.given
            changed = {x for x in {*old, *given} if old.get(x) is not given.get(x)}
        self.matches = [
            before.matches[k]
            if before is not None
            and before.matches[k].used
            and not changed & before.matches[k].used
            else _match(relation, self.motion)
            for k, relation in enumerate(RELATIONS)
        ]

    @property
    def broken(self) -> list[int]:
        """Indices of relations that do not hold."""
        return [k for k, x in enumerate(self.matches) if x.status in ("contradicts", "unlike")]

    @property
    def rank(self) -> tuple[int, int]:
        """Number of relations that do not hold, and minus the number that hold."""
        return len(self.broken), -sum(match.status == "agrees" for match in self.matches)

    @property
    def confirmed(self) -> set[str]:
        """Columns that agree with others."""
        pairs = zip(RELATIONS, self.matches, strict=True)
        agree = [relation for relation, match in pairs if match.status == "agrees"]
        return {name for relation in agree for name in (relation.name, *relation.also)}

    @property
    def likeness(self) -> float:
        """Sum of correlations: of commands at their delay, of others without a delay."""
        return sum(
            abs(match.alike) if relation.rests_on == "loop" else match.at_once
            for relation, match in zip(RELATIONS, self.matches, strict=True)
            if match.status == "agrees"
        )


class Verdicts(NamedTuple):
    """The verdicts on the columns of a log."""

    wrong: list[str]
    notes: list[str]
    columns: set[str]  # columns with a verdict


def judged(given: Given, dt: float) -> Verdicts:
    """Sentences on columns that contradict others, differ from them, or cannot be judged."""
    said = Verdicts([], [], set())
    # Telemetry has zeros where an autopilot sends no rates.
    silent = [x for x in given if KIND.get(x) == "rate" and not np.nan_to_num(given[x]).any()]
    for name in silent:
        said.notes.append(f"{name} is 0 throughout: it is taken as not measured")
        said.columns.add(name)
    given = {name: column for name, column in given.items() if name not in silent}
    now = _Judgement(given, dt)
    _say_clock(said, now)
    for _ in range(MAX_CURES):
        if not now.broken:
            break
        cure, after = _best(now)
        of = [k for k in now.broken if after.matches[k].status not in ("contradicts", "unlike")]
        own = [k for k in of if cure and RELATIONS[k].name in cure.columns]
        for k in (own or of)[:1] if cure else now.broken:
            _say(said, now, after, k, cure)
        now = after
        if cure is None:
            break
    _say_rest(said, now, given)
    return said


def _best(now: _Judgement) -> tuple[Cure | None, _Judgement]:
    """The change of columns after which the most relations hold, and the judgement after it."""
    tried: list[tuple[tuple[float, ...], Cure, _Judgement]] = []
    seen: set[tuple[tuple[str, ...], str]] = set()
    for k in now.broken:
        for cure in _cures(now.motion, RELATIONS[k], now.matches[k]):
            key = cure.columns, cure.words.partition(" would do")[0]
            if key in seen:
                continue
            seen.add(key)
            after = _Judgement(cure.apply(now.motion.given), now.motion.dt, now)
            # A cure makes a relation hold; dropping a column only makes it impossible to judge.
            holds = not cure.words or any(after.matches[x].status == "agrees" for x in now.broken)
            if "exchanged" in cure.words:
                holds &= {*cure.columns} <= after.confirmed
            if len(after.broken) < len(now.broken) and holds:
                broken, agree = after.rank
                far = OTHERS * (RELATIONS[k].name not in cure.columns)
                rank = not cure.words, broken, agree, cure.cost + far - 5.0 * after.likeness
                tried.append((rank, cure, after))
    if not tried:
        return None, now
    rank, cure, after = min(tried, key=lambda x: x[0])
    if not cure.words:  # another column may be wrong if dropping it helps as much
        alike = [x for x in tried if x[0][1] == rank[1] and x[0][2] <= rank[2] + 1]
        alike.sort(key=lambda x: x[0])
        cure = cure._replace(columns=tuple(x[1].columns[0] for x in alike))
    return cure, after


def _say_clock(said: Verdicts, now: _Judgement) -> None:
    """Report a clock by which all rates and speeds are wrong by the same factor."""
    ratios = [
        1.0 / match.ratio if relation.name in ("h", "down") else match.ratio
        for relation, match in zip(RELATIONS, now.matches, strict=True)
        if relation.rests_on == "motion"
        and match.status == "agrees"
        and match.alike > SURE
        and relation.name not in ("chi", "V_g")
        and relation.others != "down"
    ]
    if len(ratios) < 3:
        return
    middle = float(np.median(ratios))
    near = np.abs(np.log(np.array(ratios) / middle)) < ONE_CLOCK
    if np.mean(near) >= 0.75 and abs(math.log(middle)) > 2.0 * ONE_CLOCK:
        said.wrong.append(
            f"t: rates and speeds are all {middle:.3g} times the changes by this clock: a factor "
            f"of {1.0 / middle:.3g} would do to the time"
        )
        said.columns.add("t")


def _say_rest(said: Verdicts, now: _Judgement, given: Given) -> None:
    """Report which other columns agree, and why the rest cannot be judged."""
    agree, why = dict[str, list[str]](), dict[str, list[str]]()
    for name in (name for name in given if name not in said.columns):
        about = [
            (relation, match)
            for relation, match in zip(RELATIONS, now.matches, strict=True)
            if name in (relation.name, *relation.also)
            or (relation.name not in given and name in now.motion.sources(relation.name))
        ]
        holds = [(relation, match) for relation, match in about if match.status == "agrees"]
        if name == "V_a" and holds and copied(now.motion):
            why["it is the ground speed, in still air or by mistake"] = [name]
            continue
        for relation, match in holds[:1]:
            off = relation.about == "values" and abs(math.log(match.ratio)) > 0.05
            ratio = f" ({match.ratio:.2f} times it)" if off else ""
            if match.most < 1.0:
                ratio = f" (in {100.0 * match.most:.0f} % of the time)"
            agree.setdefault(relation.others, []).append(name + ratio)
        if not holds:
            reasons = [match.why for _, match in about if match.why]
            reason = reasons[0] if reasons else "the log has no related column"
            why.setdefault(reason, []).append(name)
    if agree:
        pairs = (f"{listed(names)} with {others}" for others, names in agree.items())
        said.notes.append(f"These agree: {'; '.join(pairs)}.")
    said.notes.extend(
        f"{listed(names)} cannot be checked: {reason}." for reason, names in why.items()
    )


def _say(said: Verdicts, now: _Judgement, after: _Judgement, k: int, cure: Cure | None) -> None:
    relation, match = RELATIONS[k], now.matches[k]
    gravity = cure is not None and "gravity" in cure.words
    label = relation.name if gravity else relation.label or relation.name
    if match.status == "unlike" and (relation.about == "changes" or abs(match.turned) > TRAILING):
        rests = "does not change with" if match.ratio == 0.0 else "is unlike"
        text = f"{label} {rests} {relation.others} (correlation {match.alike:.2f})"
    elif not relation.lag[0] - 0.05 < match.lag < relation.lag[1] + 0.05:
        side = "after" if match.lag > 0.0 else "before"
        text = f"{label} comes {abs(match.lag):.1f} s {side} {relation.others}"
    elif abs(match.turned) > relation.turned:
        name = "chi" if relation.name == "v_north" else relation.name
        off = match.turned * DEG_PER_RAD
        text = f"{name} is {off:+.1f} deg off that of {relation.others} all along"
    else:
        text = f"{label} is {match.ratio:.3g} times the value from {relation.others}"
    said.columns.update(cure.columns if cure else (relation.name,))
    if cure is not None and cure.words:
        # An error in another unit still shows when it is large.
        other_unit = relation.name.endswith("_err") and match.ratio > 0.0
        (said.notes if other_unit else said.wrong).append(f"{text}: {cure.words}")
        return
    columns = cure.columns if cure else (relation.name,)
    text += f": {' or '.join(columns)} is something else, and no factor, shift or exchange mends it"
    # An identity of motion that holds with the column and cannot be judged without it.
    vouched = any(
        relation.rests_on == "motion" and match.status == "agrees" != without.status
        for relation, match, without in zip(RELATIONS, now.matches, after.matches, strict=True)
    )
    sure = match.status == "unlike" and (relation.rests_on == "flight" and not vouched)
    (said.wrong if sure or relation.rests_on == "motion" else said.notes).append(text)


def coarse(given: Given, dt: float) -> tuple[Given, float]:
    """Columns averaged to about `COARSE_S`, with angles unwrapped first."""
    step = max(1, round(COARSE_S / dt), math.ceil(len(given["phi"]) / MAX_SAMPLES))
    if step == 1:
        return given, dt

    def means(name: str) -> FloatArray:
        rows = given[name][: len(given[name]) // step * step].reshape(-1, step)
        if KIND.get(name) == "angle":
            return np.angle(np.exp(1j * rows).mean(axis=1))
        return rows.mean(axis=1)

    return {name: means(name) for name in given}, step * dt


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def verdicts(raw: Given, t: FloatArray, said: Mapping[str, str]) -> tuple[list[str], list[str]]:
    """Contradictions of the columns of a log on one time base, and notes; `said` by column."""
    if t[-1] - t[0] < ENOUGH_S:
        short = f"No column can be checked: the log lasts less than {ENOUGH_S:g} s."
        return [*said.values()], [short]
    if "phi" in said:
        return [*said.values()], []
    columns = {name: column for name, column in raw.items() if name not in said}
    found = judged(*coarse(columns, float(t[1] - t[0])))
    return [*said.values(), *found.wrong], found.notes


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def signals_of(raw: Given, t: FloatArray) -> tuple[dict[str, FloatArray], list[str]]:
    """Signals of a run from raw signals on one time base, and notes on those that were made."""
    values, notes = completed(raw, float(t[1] - t[0]))
    for place in ("north", "east", "down"):
        if place in values:
            there = values[place][np.isfinite(values[place])]
            values[place] = values[place] - (there[0] if len(there) else 0.0)
    for name in ("chi", "gamma"):
        if {name, f"{name}_ref"} <= values.keys():
            values[f"{name}_err"] = np.angle(np.exp(1j * (values[f"{name}_ref"] - values[name])))
    return values, notes


def check_flight(place: str, signals: Mapping[str, FloatArray], vehicle: str) -> None:
    """Refuse the log of a multicopter, and of a vehicle that did not fly."""
    speed = signals.get("V_g", signals.get("V_a"))
    fastest = math.inf if speed is None else float(np.nanmax(np.append(speed, 0.0)))
    if fastest < SLOWEST:
        raise RecordingError(
            f"{place}: must be the log of a flight, got a speed of at most {fastest:.2g} m/s."
        )
    lacking = {"V_a": "no airspeed", "phi_cmd": "no roll commands", "V_g": "no ground speed"}
    got = [words for name, words in lacking.items() if name not in signals]
    rotary = vehicle in ROTARY
    if rotary or len(got) == len(lacking):
        got = [f"a vehicle without wings ({vehicle})", *got] if rotary else got
        raise RecordingError(f"{place}: must be the log of an aeroplane, got {', '.join(got)}.")
