"""Files of every kind that are not quite right: made of valid ones and the bounds of schemas."""

import copy
import json
import math
import os
import random
import resource
import signal
import traceback
import typing
import warnings
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import pytest
from annotated_types import Ge, Gt, Le, Lt
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

import flighttune as ft
from flighttune.campaigns.planning.schema import CampaignTable
from flighttune.vehicles.aircraft.aircraft import AircraftConfig


def slow(*cases):
    """Cases that take long where shorter ones beside them cover the module."""
    values = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*case, marks=pytest.mark.slow) for case in values]


def marked(cases, mark, *, but):
    """Cases by name with a mark, but for those that are cheap for what they see."""
    return [pytest.param(x, marks=[mark] * (x not in but)) for x in cases]


def first_or_all(cases):
    """Of cases that take long the first one; all others in `make counts`."""
    first, *others = cases
    values = [case if isinstance(case, tuple) else (case,) for case in others]
    return [first, *(pytest.param(*case, marks=pytest.mark.counts) for case in values)]


SCHEMAS = ft.Scenario, CampaignTable, AircraftConfig


def _parts(annotation, metadata=()):
    """Types inside a type, each with what is annotated to it."""
    if typing.get_origin(annotation) is typing.Annotated:
        inside, *more = typing.get_args(annotation)
        yield from _parts(inside, (*metadata, *more))
        return
    yield annotation, metadata
    for part in typing.get_args(annotation):
        yield from _parts(part)


def _fields(model, seen):
    if model in seen:
        return
    seen.add(model)
    for name, field in model.model_fields.items():
        for kind, metadata in _parts(field.annotation, tuple(field.metadata)):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                yield from _fields(kind, seen)
            flat = [one for item in metadata for one in getattr(item, "metadata", [item])]
            yield field.alias or name, flat


FIELDS = [one for schema in SCHEMAS for one in _fields(schema, set())]
KEYS = sorted({name for name, _ in FIELDS} | {"", "step", "a.b", "x" * 300, "größe", "{{x*1.0}}"})
"""Every key that a file can have, and some that none has."""

EDGES = sorted(
    {
        float(getattr(one, name))
        for _, metadata in FIELDS
        for one in metadata
        for kind, name in ((Ge, "ge"), (Gt, "gt"), (Le, "le"), (Lt, "lt"))
        if isinstance(one, kind)
    }
)
"""Every bound of a number."""

NUMBERS = [
    *EDGES,
    *(math.nextafter(edge, math.inf) for edge in EDGES),
    *(math.nextafter(edge, -math.inf) for edge in EDGES),
    *(0.0, -0.0, 1.5, 5e-324, 1e-300, 1e300, 1e308, -1e308, math.nan, math.inf, -math.inf),
    *(0, 1, -1, 2**31, 2**63, 10**400),
]
TEXTS = [
    "",
    "\0",
    "a" * 300 + "/b",
    "..",
    "../../x",
    "a" * 300,
    "größer",
    "\x1b[2J",
    "<script>",
    "nan",
    "1.0",
    "💥",
]

FACTORS = [0.0, 0.1, 0.5, 0.9, 1.1, 2.0, 10.0, 1e3, -1.0]
OPERATIONS = [*("value", "scale") * 3, "drop", "key", "other", "twice"]

VALUES = st.one_of(
    st.sampled_from(NUMBERS),
    st.sampled_from(NUMBERS),
    st.sampled_from(TEXTS),
    st.sampled_from(
        [True, False, None, [], {}, [[]], [{}], [1.0], [0.0, 1.0], [[1.0, 2.0], [3.0]]]
    ),
    st.floats(-1e3, 1e3),
    st.lists(st.floats(-100.0, 100.0), max_size=4),
    st.sampled_from([[0.0, 45.0], [-0.0, 45.0], [-1e-3, 45.0], [-0.1, 0.1], [5.0, 6.0], [1, -1]]),
)


def places_in(value, place=()):
    """Every place in nested tables and arrays."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, item in items:
        yield (*place, key)
        if isinstance(item, (dict, list)):
            yield from places_in(item, (*place, key))


def holder_of(tables, place):
    for key in place[:-1]:
        tables = tables[key]
    return tables


@st.composite
def mutated(draw, tables):
    """Tables with one to three mistakes, or values at the edge of one."""
    tables = copy.deepcopy(tables)
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        places = list(places_in(tables))
        if not places:
            break
        place = draw(st.sampled_from(places))
        holder, key = holder_of(tables, place), place[-1]
        match draw(st.sampled_from(OPERATIONS)):
            case "value":
                holder[key] = copy.deepcopy(draw(VALUES))
            case "scale" if isinstance(holder[key], float):
                holder[key] *= draw(st.sampled_from(FACTORS))
            case "drop":
                del holder[key]
            case "key" if isinstance(holder, dict):
                holder[draw(st.sampled_from(KEYS))] = copy.deepcopy(draw(VALUES))
            case "twice" if isinstance(holder, list):
                holder.append(copy.deepcopy(holder[key]))
            case _:
                other = draw(st.sampled_from(places))
                holder[key] = copy.deepcopy(holder_of(tables, other)[other[-1]])
    return tables


def to_toml(tables):
    """TOML of plain values, every table inline; what TOML has no word for is left out."""

    def value(item):
        if isinstance(item, dict):
            inside = (f"{json.dumps(key)} = {value(part)}" for key, part in item.items())
            return "{" + ", ".join(inside) + "}"
        if isinstance(item, list):
            return "[" + ", ".join(map(value, item)) + "]"
        if isinstance(item, bool):
            return str(item).lower()
        if item is None:
            return '""'
        return json.dumps(item) if isinstance(item, str) else repr(item)

    return "\n".join(f"{json.dumps(key)} = {value(item)}" for key, item in tables.items())


def to_json(tables):
    """JSON of plain values, with the words that Python adds to it."""
    return json.dumps(tables, indent=1)


JUNK = [
    *(b"\xff\xfe", b"\x00", b"[" * 2000, b'{"a":' * 2000, b"9" * 5000),
    *(b"w" * 40_000, b"# " + b"w" * 40_000, b"a." * 40_000),
]


@st.composite
def torn(draw, data):
    """Bytes that are damaged, or with junk put in."""
    junk = draw(st.sampled_from([None] * 4 * len(JUNK) + JUNK))
    if junk is None:
        return damaged(data, random.Random(draw(st.integers(0, 2**32))))[1]
    at = draw(st.integers(0, len(data)))
    return data[:at] + junk + data[at:]


def files(tables, to_text):
    """Bytes of files: mostly of other values, some of them not even tables."""
    if isinstance(tables, list):
        return st.one_of([files(one, to_text) for one in tables])
    valid = to_text(tables).encode()
    changed = mutated(tables).map(lambda found: to_text(found).encode("utf-8", "surrogatepass"))
    return st.one_of(changed, changed, changed, torn(valid))


@st.composite
def xml_files(draw, text):
    """Bytes of an XML file with a number, a name or an element changed, or torn."""
    if draw(st.integers(0, 3)) == 0:
        return draw(torn(text.encode()))
    root = ElementTree.fromstring(text)
    parents = [one for one in root.iter() if len(one)]
    parent = draw(st.sampled_from(parents))
    at = draw(st.integers(0, len(parent) - 1))
    match draw(st.sampled_from([*("text", "attribute") * 3, "drop", "twice", "move"])):
        case "text":
            words = (parent[at].text or "").split()
            value = str(draw(VALUES))
            parent[at].text = " ".join([value, *words[1:]]) if words else value
        case "attribute" if parent[at].attrib:
            name = draw(st.sampled_from(sorted(parent[at].attrib)))
            parent[at].set(name, str(draw(VALUES)))
        case "drop":
            parent.remove(parent[at])
        case "twice":
            parent.append(parent[at])
        case _:
            draw(st.sampled_from(parents)).append(ElementTree.Element(parent[at].tag))
    return ElementTree.tostring(root, "unicode").encode("utf-8", "surrogatepass")


@st.composite
def text_files(draw, text):
    """Bytes of a file of values between spaces with one of them changed, or torn."""
    if draw(st.integers(0, 3)) == 0:
        return draw(torn(text.encode()))
    lines = [line.split(" ") for line in text.splitlines()]
    line = draw(st.sampled_from(lines))
    line[draw(st.integers(0, len(line) - 1))] = str(draw(VALUES))
    return "\n".join(map(" ".join, lines)).encode("utf-8", "surrogatepass")


class TooLongError(BaseException):
    """Something took more processor time than it may."""


@contextmanager
def limited(seconds, room):
    """A block that may take so many seconds of processor time and bytes of memory more."""

    def stop(*_):
        raise TooLongError(f"it took over {seconds:g} s")

    now, most = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + room, most))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)
        resource.setrlimit(resource.RLIMIT_AS, (now, most))


def in_child(work, seconds, room):
    """Run a function in a fork of this process; what it raised or what ended it, or nothing."""
    read, write = os.pipe()
    with warnings.catch_warnings(action="ignore"):  # a fork beside threads: those of xdist wait
        child = os.fork()
    if child == 0:
        said = b""
        try:
            # A signal without a handler ends loops of other languages too.
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(
                resource.RLIMIT_CPU, (math.ceil(seconds) + 1, math.ceil(seconds) + 1)
            )
            with limited(seconds, room):
                work()
        except BaseException:
            said = traceback.format_exc().encode()
        finally:
            os.write(write, said[-4000:])
            os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        said = pipe.read().decode()
    _, status = os.waitpid(child, 0)
    ended = os.waitstatus_to_exitcode(status)
    return said if ended == 0 else f"{said}ended by {signal.Signals(-ended).name}"


def refused_apart(work):
    """What refuses a call in a fork of this process, and the bytes of memory that it took."""
    read, write = os.pipe()

    def measured():
        before, said = peak_bytes(), "accepted"
        try:
            work()
        except ft.FlightTuneError as error:
            said = str(error)
        os.write(write, json.dumps([said, peak_bytes() - before]).encode())

    ended = in_child(measured, 60.0, 8 << 30)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        assert not ended, ended
        return json.loads(pipe.read())


def peak_bytes():
    """The most memory that this process has had, which is its present one in a new fork."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


DIGITS = b"0123456789"
PIECE = 16
"""Bytes that are zeroed, swapped, repeated or lost at once."""


def digit_changed(data, draw):
    """Bytes with one digit replaced by another one; only the last of them have descriptions."""
    places = [k for k in range(max(0, len(data) - 100_000), len(data)) if data[k] in DIGITS]
    if not places:
        return data
    place = draw.choice(places)
    other = draw.choice([digit for digit in DIGITS if digit != data[place]])
    return data[:place] + bytes([other]) + data[place + 1 :]


def damaged(data, draw):
    """Bytes as a disk, a transfer or an editor might leave them, and the kind of the damage."""
    kind = draw.choice(["bit", "byte", "digit", "zeros", "end", "cut", "swap", "repeat"])
    at, other = (draw.randrange(len(data)) for _ in range(2))
    before, piece, after = data[:at], data[at : at + PIECE], data[at + PIECE :]
    match kind:
        case "bit":
            return kind, before + bytes([data[at] ^ (1 << draw.randrange(8))]) + data[at + 1 :]
        case "byte":
            return kind, before + draw.randbytes(1) + data[at + 1 :]
        case "digit":
            return kind, digit_changed(data, draw)
        case "zeros":
            return kind, before + bytes(len(piece)) + after
        case "end":
            return kind, before
        case "cut":
            return kind, before + after
        case "repeat":
            return kind, before + piece + piece + after
        case _:
            swapped = bytearray(data)
            swapped[at], swapped[other] = data[other], data[at]
            return kind, bytes(swapped)


def few_or_many(few, many):
    """A test with the number of its cases: a few with the others, and many in counts."""
    counts = pytest.param(few, marks=pytest.mark.slow), pytest.param(many, marks=pytest.mark.counts)
    return pytest.mark.parametrize("count", counts)


def check_cases(check, cases, count):
    """Check so many cases, with flights from a seed each, as hypothesis finds them."""
    settings(max_examples=count)(given(case=cases, seed=st.integers(0, 2**32 - 1))(check))()
