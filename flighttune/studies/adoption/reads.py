"""Properties in the files of a model: those that it reads, and those on the way of a command."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import combinations, product
from typing import NamedTuple
from xml.etree.ElementTree import Element

from flighttune.vehicles.aircraft.aircraft import PROPERTY_NAME, property_name

# Names of the model's properties; with a slash also of other simulators.
ANY_NAME = PROPERTY_NAME.replace("^", "^/?", 1)

# Elements below which functions and components read properties; elements there that read none;
# elements whose text is a name, also without a slash; and attributes that may be a name.
READING, SILENT = ("function", "channel"), ("output", "description", "documentation")
NAMING, ATTRIBUTES = ("property", "p", "input", "independentVar"), ("value", "execute")

# Functions and words that compare two values.
COMPARING = ("lt", "le", "gt", "ge", "eq", "nq")
_COMPARED = re.compile(r"(\S+)\s+(?:==|!=|<=|>=|<|>|(?i:eq|ne|le|ge|lt|gt))\s+(\S+)")

# Maximum number of properties that are tried together, and of trials.
MAX_TOGETHER, MAX_TRIALS = 8, 150


class Part(NamedTuple):
    """A component of flight control or a function."""

    element: Element
    reads: frozenset[str]
    writes: frozenset[str]


def parts(roots: Iterable[Element]) -> list[Part]:
    """Components and functions in the files of a model."""
    found = []
    for root in roots:
        components = [part for channel in root.iter("channel") for part in channel]
        inside = {id(below) for part in components for below in part.iter()}
        functions = [part for part in root.iter("function") if id(part) not in inside]
        for part in components + functions:
            outputs = (x.text or "" for x in part.iter("output"))
            named = (_shown_as(part), *(property_name(x.strip()) for x in outputs))
            writes = frozenset(plain(name) for name in named if name)
            found.append(Part(part, frozenset(map(plain, _read(part))), writes))
    return found


def read(roots: Iterable[Element]) -> set[str]:
    """Properties that the functions and components of a model read, also in other branches."""
    tops = (part for root in roots for tag in READING for part in root.iter(tag))
    return {name for top in tops for name in _read(top)}


def upstream(parts: Sequence[Part], commands: Iterable[str]) -> set[str]:
    """What is read on the way of commands through a model, directly or by a function of it."""
    reached = {plain(name) for name in commands}
    on_way = _closed(parts, reached, lambda part: part.reads, lambda part: part.writes)
    read = {name for part in on_way for name in part.reads}
    _closed(parts, read, lambda part: part.writes, lambda part: part.reads)
    return read


def _closed(
    parts: Sequence[Part],
    names: set[str],
    ends: Callable[[Part], frozenset[str]],
    begins: Callable[[Part], frozenset[str]],
) -> list[Part]:
    """Parts that are connected with names by their `ends`, whose `begins` are added to them."""
    connected, left = list[Part](), list(parts)
    while more := [part for part in left if ends(part) & names]:
        connected += more
        left = [part for part in left if not ends(part) & names]
        names.update(*map(begins, more))
    return connected


def trial_values(parts: Sequence[Part], name: str) -> list[float]:
    """Values that may switch on what a property switches off at 0, the most likely first."""
    # 1, or the ends of a table that depends on it; then -1, and what it is compared with.
    name = plain(name)
    ends, compared = list[float](), list[float]()
    for element, reads, _ in parts:
        if name not in reads:
            continue
        for table in element.iter("table"):
            ends += _ends(table, name)
        for test in element.iter("test"):
            for sides in _COMPARED.findall(test.text or ""):
                compared += _numbers(sides) if name in map(_named, sides) else []
        for tag in COMPARING:
            for part in element.iter(tag):
                texts = [x.text or "" for x in part]
                compared += _numbers(texts) if name in map(_named, texts) else []
    near = [x + by for x in compared for by in (0.0, 1.0, -1.0)]
    return [*dict.fromkeys(x for x in (*ends, 1.0, -1.0, *near) if x)]


def fewest(
    values: Mapping[str, Sequence[float]], works: Callable[[Mapping[str, float]], bool]
) -> dict[str, float]:
    """The fewest properties with one of their values each for which `works`; empty without any."""
    few = [*values][:MAX_TOGETHER]
    together = {name: values[name][0] for name in few}

    def trials() -> Iterator[dict[str, float]]:
        for several in (1, 2):
            for names in combinations(values if several == 1 else few, several):
                for each in product(*(values[name] for name in names)):
                    yield dict(zip(names, each, strict=True))
        if len(few) > 2:
            yield together
            yield from (_without(together, name) for name in few)

    for _, trial in zip(range(MAX_TRIALS), trials(), strict=False):
        if works(trial):
            for name in [*trial] if len(trial) > 2 else ():
                if works(fewer := _without(trial, name)):
                    trial = fewer
            return trial
    return {}


def _without(values: Mapping[str, float], left_out: str) -> dict[str, float]:
    return {name: value for name, value in values.items() if name != left_out}


def _read(part: Element) -> Iterator[str]:
    """Properties that an element reads, with those below it."""
    if part.tag in SILENT:
        return
    words = re.split(r"[\s()]+", (part.text or "").strip())  # a template: NAME(property)
    names = [word for word in words if "/" in word or (part.tag in NAMING and len(words) == 1)]
    names += [part.attrib[name].strip() for name in ATTRIBUTES if name in part.attrib]
    for name in names:
        if re.fullmatch(ANY_NAME, own := property_name(name.lstrip("-"))):
            yield own
    for below in part:
        yield from _read(below)


def _shown_as(part: Element) -> str:
    """The property in which JSBSim shows a component or function; empty without a name."""
    name = part.get("name", "").strip().replace(" ", "-")
    if not name or part.tag == "function" or "/" in name:
        return property_name(name)
    return f"fcs/{name.lower()}"


def plain(name: str) -> str:
    return re.sub(r"\[0+\]", "", name)


def _named(text: str) -> str:
    return plain(property_name(text.strip().lstrip("-")))


def _numbers(texts: Iterable[str]) -> list[float]:
    """Finite numbers among texts."""
    found = (re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", x.strip()) for x in texts)
    return [float(match[0]) for match in found if match]


def _ends(table: Element, name: str) -> list[float]:
    """The last and the first value of a property on which a table depends."""
    lookups = {_named(x.text or ""): x.get("lookup", "row") for x in table.iter("independentVar")}
    data = table.find("tableData")
    if data is None or name not in lookups or lookups[name] == "table":
        return []
    rows = [line.split() for line in (data.text or "").splitlines() if line.strip()]
    if len(lookups) > 1:
        rows = rows[:1] if lookups[name] == "column" else rows[1:]
    keys = rows[0] if len(lookups) > 1 and lookups[name] == "column" else [x[0] for x in rows]
    return _numbers([*keys[-1:], *keys[:1]])
