# SPDX-License-Identifier: LGPL-2.1-or-later
"""The C library's functions over the lanes of a vector, with its own bits.

The machine code of the installed library is read when it is first needed (`x86`), and written down
as operations of vectors: one way through a function after the other, each for the lanes that go it,
and at last the function itself, lane by lane. So the bits are those of whatever library there is. A
function that differs in one of a million values is left to the library.
"""

import ctypes
from collections import Counter
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np

from flighttune.compiled import machine
from flighttune.compiled.cache import Kept, kept_or_made
from flighttune.compiled.dynamics import Doubles
from flighttune.compiled.ir import PREFIX, module
from flighttune.compiled.machine import Loaded
from flighttune.compiled.step import Names
from flighttune.compiled.trace import LIBRARY
from flighttune.compiled.x86 import UnknownCodeError, Vector, Walk, known

# Arguments whose ways through a function are looked for, most ways, and the least share of the
# arguments that one must have.
_TRIED, _WAYS, _SHARE = 240, 12, 0.004

# The platform whose machine code is read.
_KNOWN = "linux x86_64 glibc"

# Values on which a function is compared with the library's, for each kind of range.
_COMPARED = 1 << 18

_SPECIAL = [0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, -1e-310, 1e308, -1e300, 1.0, -1.0, 0.5, 2.0]

# A generator is imported on its first use.
Draw: TypeAlias = "Callable[[np.random.Generator, int], Doubles]"


def _uniform(low: float, high: float) -> Draw:
    return lambda generator, n: generator.uniform(low, high, n)


def _normal(size: float) -> Draw:
    return lambda generator, n: generator.normal(0.0, size, n)


def _one_of(*values: float) -> Draw:
    return lambda generator, n: generator.choice(values, n)


_TURN, _WIDE = (_normal(0.1),), (_uniform(-3.2, 3.2),)
_POWERS = _one_of(2.0, 3.5, 5.2559, 0.4, 1.2, 7.0)
_BELOW_ONE = _uniform(1e-9, 1.0)
# Arguments in flight and beyond it, by function; lanes of `acos` take longer than calls.
RANGES: dict[str, list[tuple[Draw, ...]]] = {
    "sin": [_TURN, _WIDE],
    "cos": [_TURN, _WIDE],
    "tan": [(_uniform(1e-4, 0.01),), (_uniform(-0.6, 0.6),)],
    "asin": [(_normal(0.05),), (_uniform(-0.95, 0.95),)],
    "atan": [(_normal(0.1),), (_normal(2.0),)],
    "exp": [(_uniform(-0.3, -0.1),), (_uniform(-30.0, 3.0),)],
    "log": [(_BELOW_ONE,), (_uniform(0.1, 2e5),)],
    "log10": [(_BELOW_ONE,), (_uniform(0.1, 2e5),)],
    "atan2": [(_normal(0.08), _uniform(0.9, 1.0)), (_normal(1.0), _normal(1.0))],
    "pow": [(_uniform(0.8, 1.2), _one_of(5.2559)), (_uniform(0.2, 3.0), _POWERS)],
}


class Lifted(NamedTuple):
    """IR of functions over vectors, each ``v_`` and its name, and their names."""

    text: str = ""
    names: tuple[str, ...] = ()


@lru_cache(maxsize=4)
def lifted(width: int, key: Callable[[str], str]) -> Lifted:
    """The functions that can be vectors of so many lanes here; none where nothing is known.

    `key` makes a key of the cache of all that the machine decides.
    """
    if machine.this_platform() != _KNOWN:
        return Lifted()
    try:
        import capstone  # noqa: F401
    except ImportError:
        return Lifted()
    kept = kept_or_made(key(f"functions of {width} lanes"), lambda: _made(width))
    return Lifted(kept.code.decode(), kept.names.signals)


def _made(width: int) -> Kept:
    """Those of the functions that are equal to the library's."""
    written = {name: text for name in RANGES if (text := _function(name, width))}
    equal = tuple(name for name, text in written.items() if _is_equal(name, text, width))
    text = "\n".join([_LIBRARY, *(written[name] for name in equal)])
    return Kept(names=Names((), (), (), equal, ()), code=text.encode())


def _function(name: str, width: int) -> str:
    """IR of a function over lanes; empty if no way through it is known."""
    arguments = [Vector(f"%a{i}", real=True) for i in range(LIBRARY[name])]
    of = [f"<{width} x double>" for _ in arguments]
    head = ", ".join(f"{kind} {x.name}" for kind, x in zip(of, arguments, strict=True))
    lines: list[str] = []
    ways = 0
    value, good = "zeroinitializer", ""
    for decisions in _ways(name):
        walk = Walk(width, machine.library_region(), f"w{ways}.", decisions)
        try:
            found = walk.real(walk.result(machine.library_address(name), arguments))
        except (UnknownCodeError, KeyError, AttributeError, ValueError):
            continue
        lines += walk.lines
        guard = walk.guard or walk.every("i1", "true")
        if ways:
            chosen = f"<{width} x i1> {good}, {of[0]} {value}, {of[0]} {found}"
            lines += [
                f"%v{ways} = select {chosen}",
                f"%g{ways} = or <{width} x i1> {good}, {guard}",
            ]
            found, guard = f"%v{ways}", f"%g{ways}"
        value, good = found, guard
        lines += [
            f"%all{ways} = call i1 @llvm.vector.reduce.and.v{width}i1(<{width} x i1> {good})",
            f"br i1 %all{ways}, label %done{ways}, label %more{ways}",
            f"done{ways}:",
            f"ret {of[0]} {value}",
            f"more{ways}:",
        ]
        ways += 1
    if not ways:
        return ""
    lines += _rest(name, width, value, good, f"more{ways - 1}")
    body = "\n".join(f"  {line}" for line in lines)
    return f"define private {of[0]} @v_{name}({head}) noinline {{\nentry:\n{body}\n}}"


def _rest(name: str, width: int, value: str, good: str, before: str) -> list[str]:
    """Lines that ask the library in the lanes that went no known way, and return all."""
    kind, lines = f"<{width} x double>", []
    for lane in range(width):
        given = []
        asked = [
            f"%has{lane} = extractelement <{width} x i1> {good}, i32 {lane}",
            f"br i1 %has{lane}, label %next{lane}, label %ask{lane}",
            f"ask{lane}:",
        ]
        for i in range(LIBRARY[name]):
            asked.append(f"%x{lane}.{i} = extractelement {kind} %a{i}, i32 {lane}")
            given.append(f"double %x{lane}.{i}")
        lines += [
            *asked,
            f"%y{lane} = call double @{PREFIX}{name}({', '.join(given)})",
            f"%z{lane} = insertelement {kind} {value}, double %y{lane}, i32 {lane}",
            f"br label %next{lane}",
            f"next{lane}:",
            f"%u{lane} = phi {kind} [ {value}, %{before} ], [ %z{lane}, %ask{lane} ]",
        ]
        value, before = f"%u{lane}", f"next{lane}"
    return [*lines, f"ret {kind} {value}"]


def _ways(name: str) -> list[tuple[bool, ...]]:
    """How the jumps of a function go for its arguments, the most frequent ways first."""
    generator, found = np.random.default_rng(1), Counter[tuple[bool, ...]]()
    address = machine.library_address(name)
    for draws in RANGES[name]:
        columns = [draw(generator, _TRIED) for draw in draws]
        for numbers in zip(*(x.tolist() for x in columns), strict=True):
            walk = Walk(1, machine.library_region())
            try:
                walk.result(address, [known(x) for x in numbers])
            except (UnknownCodeError, KeyError, AttributeError, ValueError):
                continue
            found[tuple(walk.taken)] += 1
    least = _SHARE * _TRIED * len(RANGES[name])
    return [way for way, times in found.most_common(_WAYS) if times >= least]


_LIBRARY = """
@flighttune_library = internal global i64 0
define void @place_library(i64 %start) {
  store i64 %start, ptr @flighttune_library
  ret void
}
"""

_COMPARING = """
define void @{loop}(ptr %x, ptr %y, ptr %o, i64 %n) {{
entry:
  br label %loop
loop:
  %i = phi i64 [ 0, %entry ], [ %i1, %loop ]
  %px = getelementptr double, ptr %x, i64 %i
  %py = getelementptr double, ptr %y, i64 %i
  %po = getelementptr double, ptr %o, i64 %i
  %vx = load {kind}, ptr %px, align 8
  %vy = load {kind}, ptr %py, align 8
  %r = call {kind} @{name}({given})
  store {kind} %r, ptr %po, align 8
  %i1 = add i64 %i, {width}
  %more = icmp slt i64 %i1, %n
  br i1 %more, label %loop, label %end
end:
  ret void
}}
"""


def _comparing(loop: str, name: str, count: int, kind: str, width: int) -> str:
    """IR of a loop that calls a function for all of its arguments."""
    given = ", ".join(f"{kind} %v{x}" for x in "xy"[:count])
    return _COMPARING.format(loop=loop, kind=kind, name=name, given=given, width=width)


def loops(name: str, text: str, width: int) -> tuple[Loaded, list[Callable[..., None]]]:
    """A function over vectors, and the library's, for arrays of arguments whose length fits."""
    count, pointer = LIBRARY[name], ctypes.c_void_p
    of_lanes = _comparing("vectors", f"v_{name}", count, f"<{width} x double>", width)
    alone = _comparing("alone", f"{PREFIX}{name}", count, "double", 1)
    loaded = Loaded(machine.object_code(module(text, of_lanes, alone)))
    loaded.place_library()
    kind = ctypes.CFUNCTYPE(None, pointer, pointer, pointer, ctypes.c_int64)
    return loaded, [kind(loaded.address(loop)) for loop in ("vectors", "alone")]


def _is_equal(name: str, text: str, width: int) -> bool:
    """Whether a function gives the library's bits, in lanes that go all ways."""
    _loaded, functions = loops(name, f"{_LIBRARY}{text}", width)
    for x, y in _arguments(name):
        results = np.empty((2, len(x)))
        for function, row in zip(functions, results, strict=True):
            function(x.ctypes.data, y.ctypes.data, row.ctypes.data, len(x))
        own, theirs = results
        same = (own.view(np.int64) == theirs.view(np.int64)) | (np.isnan(own) & np.isnan(theirs))
        if not same.all():
            return False
    return True


def _arguments(name: str) -> Sequence[tuple[Doubles, Doubles]]:
    """Arguments in flight and beyond, any bits at all, and special ones, of each several lanes."""
    generator = np.random.default_rng(2)
    pairs = []
    for draws in RANGES[name]:
        columns = [draw(generator, _COMPARED) for draw in draws]
        pairs.append((columns[0], columns[-1]))
    sizes = 10.0 ** generator.uniform(-12.0, 12.0, (2, _COMPARED))
    pairs.append(tuple(generator.choice([-1.0, 1.0], (2, _COMPARED)) * sizes))
    bits = generator.integers(-(2**63), 2**63, (2, _COMPARED))
    pairs.append(tuple(bits.view(float)))
    x, y = np.meshgrid(_SPECIAL, _SPECIAL)
    flat = [np.resize(z.ravel(), 8 * x.size) for z in (x, y)]
    pairs.append((flat[0], flat[1]))
    return [(np.ascontiguousarray(a), np.ascontiguousarray(b)) for a, b in pairs]
