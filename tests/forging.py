"""A forger of claims: it opens the file of any kind, changes one place of it, and writes it again.

It takes the SHA-256 that the file had, or one that it has made anew as anybody can.
"""

import copy
import hashlib
import json
import math
import re
import zipfile
from typing import Any, NamedTuple

import numpy as np
from fuzzing import TEXTS, holder_of, places_in

FACTORS = 0.0, -1.0, 0.5, 0.9, 1.01, 2.0, 10.0
TYPES = None, True, [], {}, "forged", 0, 1.5, [1.0], 10**400, math.nan, math.inf
SEAL = re.compile(rb"SHA-256=[0-9a-f]{64}")


def sealed(data):
    """The bytes of a file with the SHA-256 of all its other bytes in the last place for one."""
    *_, place = SEAL.finditer(data)
    before, after = data[: place.start()], data[place.end() :]
    return before + b"SHA-256=" + hashlib.sha256(before + after).hexdigest().encode() + after


class Opened(NamedTuple):
    """What a file of a claim has: a JSON object, and the arrays beside it in an archive."""

    tables: dict[str, Any]
    arrays: dict[str, Any]
    member: str  # name of the object in an archive; empty for a file that it is alone
    comment: bytes  # of the archive

    @classmethod
    def of(cls, path):
        if path.suffix == ".json":
            return cls(json.loads(path.read_text()), {}, "", b"")
        with np.load(path) as file:
            arrays = dict(file)
        texts = [name for name, array in arrays.items() if array.dtype.kind == "U"]
        member = next(name for name in ("claim", "band", "monitor") if name in texts)
        tables = json.loads(str(arrays.pop(member)))
        return cls(tables, arrays, member, zipfile.ZipFile(path).comment)

    def replace_comment(self, comment):
        """The same with another comment of the archive."""
        return Opened(self.tables, self.arrays, self.member, comment)

    def write(self, path, *, anew=True):
        """Write it, with its old SHA-256 or with one that is made `anew`; return its path."""
        blank = f"SHA-256={'0' * 64}"
        if not self.member:
            tables = {**self.tables, "sha256": blank} if anew else self.tables
            data = f"{json.dumps(tables, indent=2)}\n".encode()
            path.write_bytes(sealed(data) if anew else data)
            return path
        with path.open("wb") as file:
            text = np.array(json.dumps(self.tables))
            np.savez_compressed(file, **{self.member: text}, **self.arrays)
        with zipfile.ZipFile(path, "a") as archive:
            archive.comment = blank.encode() if anew else self.comment
        if anew:
            path.write_bytes(sealed(path.read_bytes()))
        return path


def changed(file, path, change=None, **arrays):
    """A copy of a claim's file with other tables and arrays (None: without it), sealed anew."""
    opened = Opened.of(file)
    opened.arrays.update(arrays)
    for name in [name for name, array in arrays.items() if array is None]:
        del opened.arrays[name]
    if callable(change):
        change(opened.tables)
    else:
        opened.tables.update(change or {})
    return opened.write(path)


def forged(whole, other, draw):
    """A file with one place changed, by drawing, and the place; `other` is of the same kind."""
    opened = copy.deepcopy(whole)
    if opened.arrays and draw.random() < 0.3:
        name = draw.choice([*opened.arrays])
        opened.arrays[name] = changed_array(opened.arrays, name, other.arrays, draw)
        if opened.arrays[name] is None:
            del opened.arrays[name]
        return opened, (name,)
    place = draw.choice([*places_in(opened.tables)])
    holder, key = holder_of(opened.tables, place), place[-1]
    match draw.choice(["number", "number", "type", "text", "drop", "shuffle", "fewer", "swap"]):
        case "number" if type(holder[key]) in (int, float):
            holder[key] = draw.choice([holder[key] * x for x in FACTORS] + [holder[key] + 1])
        case "text":
            holder[key] = draw.choice(TEXTS)
        case "drop":
            del holder[key]
        case "shuffle" if isinstance(holder[key], list):
            draw.shuffle(holder[key])
        case "fewer" if isinstance(holder[key], list | dict) and holder[key]:
            inside = holder[key]
            del inside[draw.choice(range(len(inside)) if isinstance(inside, list) else [*inside])]
        case "swap":
            try:
                holder[key] = copy.deepcopy(holder_of(other.tables, place)[key])
            except (LookupError, TypeError):  # the other file has no such place
                holder[key] = copy.deepcopy(draw.choice(TYPES))
        case _:
            holder[key] = copy.deepcopy(draw.choice(TYPES))
    return opened, place


def changed_array(arrays, name, others, draw):
    """The array with a number changed, fewer or shuffled rows, that of another file, or none."""
    array = arrays[name].copy()
    kind = draw.choice(["number", "fewer", "shuffle", "swap", "drop"])
    if kind == "drop":
        return None
    if kind == "swap" and name in others:
        return others[name]
    if kind == "shuffle" and array.ndim and len(array) > 1:
        return array[draw.sample(range(len(array)), len(array))]
    if kind == "number" and array.size and array.dtype.kind in "fb":
        at = draw.randrange(array.size)
        old = array.flat[at]
        array.flat[at] = not old if array.dtype == bool else draw.choice([np.nan, 1.5 * old + 0.1])
        return array
    return array[:-1] if array.ndim and len(array) else np.zeros(3, array.dtype)


def same(one, two):
    """Whether two files say the same, to the bit."""
    texts = [json.dumps(x.tables, sort_keys=True) for x in (one, two)]

    def bits(x):
        return {name: (array.shape, array.tobytes()) for name, array in x.arrays.items()}

    return texts[0] == texts[1] and bits(one) == bits(two)
