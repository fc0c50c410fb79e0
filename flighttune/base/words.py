"""Numbers and names as text: for sentences, tables and refusals."""

import math
import numbers
import re
from collections.abc import Callable, Iterable, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from typing import Any

from flighttune.base.errors import printable

# Text in place of a missing number.
MISSING = "–"

MAX_SHOWN = 80  # characters of a text that a message repeats


def quoted(text: str) -> str:
    """A user's name or title in quotation marks, which the text itself cannot close."""
    return '"{}"'.format(" ".join(printable(text).split()).replace('"', "'"))


def number(value: float, form: str = ".4g") -> str:
    """A number in the given format; infinity as its sign, `MISSING` for NaN."""
    if math.isnan(value):
        return MISSING
    if math.isinf(value):
        return "∞" if value > 0.0 else "−∞"
    return f"{value:{form}}"


def told_apart(a: float, b: float) -> tuple[str, str]:
    """Two numbers with four digits, or with as many more as tell them apart."""
    texts = [(number(a, f".{digits}g"), number(b, f".{digits}g")) for digits in range(4, 18)]
    return next((pair for pair in texts if pair[0] != pair[1]), texts[0])


def at_most(bound: float, digits: int = 4) -> str:
    """An upper bound rounded upwards to this number of significant digits."""
    return _rounded(bound, digits, ROUND_CEILING)


def at_least(bound: float, digits: int = 4) -> str:
    """A lower bound rounded downwards to this number of significant digits."""
    return _rounded(bound, digits, ROUND_FLOOR)


def confidence_text(value: float) -> str:
    """A confidence rounded downwards, with two digits of its distance from 1."""
    left = round(1.0 - value, 12)  # what subtracting has rounded is no digit of the distance
    return f"{1.0 - float(at_most(left, 2)):.12g}"


def _rounded(bound: float, digits: int, rounding: str) -> str:
    if bound == 0.0 or not math.isfinite(bound):
        return number(bound, f".{digits}g")
    exact = Decimal(repr(float(bound)))
    place = Decimal(1).scaleb(exact.adjusted() - digits + 1)
    return number(float(exact.quantize(place, rounding)), f".{digits}g")


def figures(value: float) -> str:
    """A number with three significant figures, and without decimals from 1000 on."""
    return number(value, ".0f" if abs(value) >= 1000.0 else ".3g")


def interval(
    value: float, lo: float, hi: float, *, written: Callable[[float], str] = figures
) -> str:
    """``4.63 [4.25, 4.89]`` with three figures, ``4.63 [<= 4.89]`` with one bound."""
    if math.isnan(value):
        return MISSING
    if math.isinf(lo) != math.isinf(hi):
        bound = f"<= {written(hi)}" if math.isinf(lo) else f">= {written(lo)}"
        return f"{written(value)} [{bound}]"
    return f"{written(value)} [{written(lo)}, {written(hi)}]"


def percent(share: float) -> str:
    """A share in per cent, without the sign: one decimal, more near 0 and 100."""
    if not math.isfinite(share):
        return MISSING
    value = 100.0 * share
    edge = min(value, 100.0 - value)
    decimals = 0 if edge == 0.0 else 1 if edge >= 0.1 else 2 if edge >= 0.01 else 3
    return f"{value:.{decimals}f}"


def p_value(p: float) -> str:
    """A p-value as text; a very small one as an upper bound."""
    return f"{p:.2g}" if p >= 1e-4 else "< 0.0001"


# Smallest half-width that is written as a number, deg.
LEAST_WIDTH = 1e-4


def half_width(deg: float) -> str:
    """A proven half-width in deg as text; a very small one as an upper bound."""
    return "< 0.0001" if 0.0 < deg < LEAST_WIDTH else number(deg, "z.4g")


def matrix(values: Iterable[Iterable[float]]) -> str:
    """A matrix in one line, its rows separated by semicolons."""
    return "[" + "; ".join(", ".join(f"{value:z.4f}" for value in row) for row in values) + "]"


def listed(words: Sequence[str], joint: str = "and", most: int | None = None) -> str:
    """Words as read aloud: ``a``, ``a and b``, ``a, b and c``; at most the first `most`."""
    if most is not None and len(words) > most:
        words = [*words[:most], f"{len(words) - most} more"]
    return f" {joint} ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


# A first word that takes a capital: neither a symbol nor the name of a file, plant or run.
SYMBOLS = r"(?!(?:chi|gamma|phi|theta|psi|alpha|beta|north|east|down|lat|lon|[b-z])\b)"
WORD = re.compile(SYMBOLS + r"[a-z]+(?= (?!/))")

# A command at the end of a note; a full stop would look like part of it.
COMMAND = re.compile(r"(?<=: )flighttune \w+ \S+(?: --\S+(?: [^-\s]\S*)?)*$")


def sentence(note: str) -> str:
    """A note as a sentence: a capital, unless a symbol or a name begins it, and a full stop."""
    if not note or COMMAND.search(note):
        return note
    note = note.rstrip(". ")
    end = "" if note.endswith(("?", "!", ":")) else "."
    return f"{note[:1].upper() if WORD.match(note) else note[:1]}{note[1:]}{end}"


def distinct(names: Iterable[str]) -> list[str]:
    """Names in order; a name that repeats an earlier name ends in ``_2``, ``_3`` and so on."""
    used: dict[str, None] = {}
    for stem in names:
        name, again = stem, 2
        while name in used:
            name, again = f"{stem}_{again}", again + 1
        used[name] = None
    return list(used)


def rate(per_s: float) -> str:
    """A rate per second with three figures; whole from 100 on."""
    return f"{per_s:.0f}" if per_s >= 100.0 else f"{per_s:.3g}"


def duration(seconds: float) -> str:
    """A time in its usual unit: ``48 s``, ``12 min``, ``3.4 h``."""
    if seconds < 120.0:
        return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def pick(value: object, names: str) -> dict[str, Any]:
    """Attributes of `value` by name; `names` are separated by spaces."""
    return {name: getattr(value, name) for name in names.split()}


def got(value: Any) -> str:
    """A value as a message repeats it, or its kind if it is too long for a line."""
    if isinstance(value, numbers.Integral) and not isinstance(value, bool):
        whole = int(value)
        if abs(whole) >= 10**20:
            return f"a whole number of {int(math.log10(2) * whole.bit_length()) + 1} digits"
        return str(whole)
    if value is None or isinstance(value, bool | float | complex):
        return str(value)
    if isinstance(value, str | bytes):
        text = repr(value)
        return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN // 2]} ..."
    name = type(value).__name__.removeprefix("nd")  # an array spans several lines
    return f"{'an' if name[0].lower() in 'aeiou' else 'a'} {name}"
