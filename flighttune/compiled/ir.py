# SPDX-License-Identifier: LGPL-2.1-or-later
"""The traced step as LLVM IR: a function that makes any number of steps in place.

A step may be one of several aircraft, each in its lane of a vector: every operation is then one of
vectors, which gives each lane the bits that it has alone.
"""

from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

from flighttune.compiled.branches import Side, sides
from flighttune.compiled.trace import (
    INSTRUCTIONS,
    LIBRARY,
    Condition,
    Graph,
    Number,
    Truth,
    Value,
    bits,
    needed,
    negated,
    of_bits,
)

# Beginning of the names by which compiled code knows functions of the C library.
PREFIX = "flighttune_"

_DECLARATIONS = "\n".join(
    [
        *(
            f"declare double @{PREFIX}{name}({', '.join(['double'] * count)}) #0"
            for name, count in LIBRARY.items()
        ),
        *(f"declare double @llvm.{name}.f64(double)" for name in INSTRUCTIONS),
        f"declare void @{PREFIX}sincos(double, ptr, ptr) #1",
        "attributes #0 = { nounwind willreturn memory(none) }",
        "attributes #1 = { nounwind willreturn memory(argmem: write) }",
    ]
)


class Lanes(NamedTuple):
    """Aircraft of a vector, and the functions of the C library over vectors that there are."""

    width: int = 1
    lifted: Collection[str] = ()  # each is ``v_`` and its name


ALONE = Lanes()

_FUNCTION = """
define void @{name}(ptr noalias %s, ptr noalias %p, i64 %n, ptr noalias %u, ptr noalias %o, i64 %m)
{{
entry:
  %sine = alloca {real}, align 8
  %cosine = alloca {real}, align 8
  %any = icmp sgt i64 %n, 0
  br i1 %any, label %first, label %end
first:
  {first}
  br label %loop
loop:
  %k = phi i64 [ 0, %first ], [ %k1, %next ]
  {body}
  br label %next
next:
  %k1 = add i64 %k, 1
  %left = icmp slt i64 %k1, %n
  %more = and i1 %left, {goes_on}
  br i1 %more, label %loop, label %last
last:
  %shown = icmp sgt i64 %m, 0
  br i1 %shown, label %signals, label %end
signals:
  {signals}
  %all = icmp sgt i64 %m, 1
  br i1 %all, label %properties, label %end
properties:
  {properties}
  br label %end
end:
  ret void
}}
"""


def module(*functions: str) -> str:
    """IR of several functions."""
    return "\n".join((_DECLARATIONS, *functions))


def function_ir(
    name: str,
    graph: Graph,
    inputs: Mapping[str, tuple[str, int]],
    updates: Sequence[Number],
    signals: Sequence[Number] = (),
    properties: Sequence[Number] = (),
    streams: int = 0,
    *,
    until: Truth = False,
    lanes: Lanes = ALONE,
) -> str:
    """IR of ``step(states, parameters, n, stream, shown, how_many)``, which makes n steps.

    `inputs` places each input in an array: s of states, p of parameters or u of the stream, which
    has a row of `streams` numbers for each step. `updates` are the new states. After the last step
    `signals` are written to ``shown`` if ``how_many`` is 1, `properties` behind them if it is 2.
    The steps end with the first in which `until` holds. Of several `lanes` each place of an array
    has a number for every one of them, side by side.
    """
    emitter = _Emitter(graph, inputs, streams, name, lanes)
    first, again = emitter.carried(updates)
    # Old states, before the new ones are stored.
    shown = [value for value in (*signals, *properties) if isinstance(value, Value)]
    late = [place for place in needed(graph, shown) if graph.nodes[place].op == "input"]
    goes_on = negated(until)
    late += needed(graph, [goes_on]) if isinstance(goes_on, Condition) else []
    body = emitter.stores("s", updates, 0, late)
    # Values of an earlier block are known in a later one: only what is missing is computed there.
    blocks = {
        "first": first,
        "body": [*(f"{known}, [ {emitter.ref(new)}, %next ]" for known, new in again), *body],
        "signals": emitter.stores("o", signals, 0),
        "properties": emitter.stores("o", properties, len(signals)),
    }
    further = emitter.ref(goes_on.place) if isinstance(goes_on, Condition) else "true"
    lines = {label: "\n  ".join(block) for label, block in blocks.items()}
    text = _FUNCTION.format(name=name, goes_on=further, real=emitter.real, **lines)
    return "\n".join((*emitter.constants(), text))


class _Emitter:
    """Writes operations down, each once; one block comes after the other."""

    def __init__(
        self,
        graph: Graph,
        inputs: Mapping[str, tuple[str, int]],
        streams: int,
        name: str,
        lanes: Lanes,
    ) -> None:
        self.graph, self.inputs, self.streams, self.name = graph, inputs, streams, name
        self.width, self.lifted = lanes
        self.real, self.whole, self.truth = map(self._of_lanes, ("double", "i64", "i1"))
        self.lines: list[str] = []
        self.known: set[int] = set()
        self.tables: dict[tuple[float, ...], int] = {}
        self.pairs: dict[int, tuple[str, str]] = {}
        self.names: dict[int, str] = {}
        self.count = 0
        self.on_side: dict[Side, list[int]] = {}  # what is computed on a side of a select alone
        self.block = ""  # label of the block that is written inside a branch
        self.writers: dict[str, Callable[[Value, str], None]] = {
            "input": self._input,
            "segment": self._segment,
            "gather": self._gather,
            "flat": self._flat,
            "integer": self._integer,
            "select": self._select,
            "call": self._call,
        }

    def carried(self, updates: Sequence[Number]) -> tuple[list[str], list[tuple[str, int]]]:
        """Calls on an old state that a step makes on the new one too: the next step knows them.

        Returns the lines for those of the first step and, of each call, the beginning of the line
        that chooses its value, and the place of the call on the new state.
        """
        self.lines, found = [], []
        places = self._missing(updates)
        always = {*places} - {*sides(self.graph, places, self._places(updates))}
        for place in places:
            node = self.graph.nodes[place]
            if (new := self._on_new_state(node, updates)) not in always:
                continue
            x, value, function = self._new(), self._new(), node.op.removeprefix("call ")
            self._input(self.graph.nodes[node.args[0]], x)
            self._library(function, value, [x])
            found.append((f"%v{place} = phi {self.real} [ {value}, %first ]", new))
            self.known.add(place)
        return self.lines, found

    def _on_new_state(self, node: Value, updates: Sequence[Number]) -> int | None:
        """Place of the same call of the C library on the new value of its state."""
        if node.op.removeprefix("call ") in LIBRARY and len(node.args) == 1:
            x = self.graph.nodes[node.args[0]]
            array, slot = self.inputs[x.args[0]] if x.op == "input" else ("", 0)
            if array == "s" and isinstance(new := updates[slot], Value):
                again = self.graph.index.get((node.op, new.place))
                return again and again.place
        return None

    def _missing(self, values: Sequence[Number], further: Sequence[int] = ()) -> list[int]:
        """Places in order of what is computed for some values and is not known yet."""
        symbols = [value for value in values if isinstance(value, Value)]
        return sorted({*needed(self.graph, symbols, self.known), *further} - self.known)

    @staticmethod
    def _places(values: Sequence[Number]) -> set[int]:
        return {value.place for value in values if isinstance(value, Value)}

    def stores(
        self, array: str, values: Sequence[Number], first: int, further: Sequence[int] = ()
    ) -> list[str]:
        """Lines that compute values and write them into an array from its place `first` on."""
        self.lines, self.on_side = [], defaultdict(list)
        places = self._missing(values, further)
        alone = sides(self.graph, places, {*self._places(values), *further})
        for place in places:
            if place in alone:
                self.on_side[alone[place]].append(place)
        for place in places:
            if place not in alone:
                self._write(self.graph.nodes[place], f"%v{place}")
                self.known.add(place)
        for slot, value in enumerate(values, first):
            if self._is_input(value, array, slot):
                continue  # it is there
            text = self.ref(value.place) if isinstance(value, Value) else self._number(value)
            pointer = self._pointer(array, str(slot))
            self.lines.append(f"store {self.real} {text}, ptr {pointer}, align 8")
        return self.lines

    def _is_input(self, value: Number, array: str, slot: int) -> bool:
        known = isinstance(value, Value) and value.op == "input"
        return known and self.inputs[value.args[0]] == (array, slot)

    def constants(self) -> list[str]:
        """Declarations of all tables."""
        return [
            f"@{self.name}.table{k} = private constant [{len(values)} x double] "
            f"[{', '.join(f'double {constant(x)}' for x in values)}]"
            for values, k in self.tables.items()
        ]

    def ref(self, place: int) -> str:
        """The name of a value, or its number."""
        node = self.graph.nodes[place]
        if node.op == "const":
            return self._number(of_bits(node.args[0]))
        return self.names.get(place, f"%v{place}")

    def _new(self) -> str:
        self.count += 1
        return f"%t{self.count}"

    def _of_lanes(self, kind: str) -> str:
        """The type of a value of each lane."""
        return kind if self.width == 1 else f"<{self.width} x {kind}>"

    def _every(self, kind: str, text: str) -> str:
        """A constant in every lane."""
        return text if self.width == 1 else f"<{', '.join([f'{kind} {text}'] * self.width)}>"

    def _number(self, x: float) -> str:
        return self._every("double", constant(x))

    def _pointer(self, array: str, index: str) -> str:
        pointer = self._new()
        self.lines.append(f"{pointer} = getelementptr {self.real}, ptr %{array}, i64 {index}")
        return pointer

    def _write(self, node: Value, name: str) -> None:
        op = node.op
        kind = op.partition(" ")[0]
        if op == "const":
            return
        if writer := self.writers.get(kind):
            writer(node, name)
            return
        parts = ", ".join(map(self.ref, node.args))
        if op in ("and", "or", "not"):
            every = self._every("i1", "true")
            relation, parts = ("xor", f"{parts}, {every}") if op == "not" else (op, parts)
            self.lines.append(f"{name} = {relation} {self.truth} {parts}")
        else:  # arithmetic, and comparisons
            self.lines.append(f"{name} = {op} {self.real} {parts}")

    def _input(self, node: Value, name: str) -> None:
        array, slot = self.inputs[node.args[0]]
        index = str(slot)
        if array == "u":
            row, index = self._new(), self._new()
            self.lines.append(f"{row} = mul i64 %k, {self.streams}")
            self.lines.append(f"{index} = add i64 {row}, {slot}")
        pointer = self._pointer(array, index)
        self.lines.append(f"{name} = load {self.real}, ptr {pointer}, align 8")

    def _select(self, node: Value, name: str) -> None:
        condition, *values = node.args
        alone = [self.on_side.get((node.place, holds), []) for holds in (True, False)]
        if self.width > 1 or not any(alone):
            ways = [
                self._if_any(condition, holds, places, value) if places else self.ref(value)
                for holds, places, value in zip((True, False), alone, values, strict=True)
            ]
            chosen = ", ".join(f"{self.real} {way}" for way in ways)
            self.lines.append(f"{name} = select {self.truth} {self.ref(condition)}, {chosen}")
            return
        yes, no, end = (f"{self._new()[1:]}.{at}" for at in ("yes", "no", "end"))
        self.lines.append(f"br i1 {self.ref(condition)}, label %{yes}, label %{no}")
        ways = [self._side(*x, end) for x in zip((yes, no), alone, values, strict=True)]
        self.lines += (f"{end}:", f"{name} = phi double {', '.join(ways)}")
        self.block = end

    def _if_any(self, condition: int, holds: bool, places: Sequence[int], value: int) -> str:
        """A branch that is left out if no lane needs it; what its value is called after it."""
        here, some, end = (f"{self._new()[1:]}.{at}" for at in ("here", "some", "end"))
        needed_by, any_ = self.ref(condition), self._new()
        if not holds:
            needed_by, every = self._new(), self._every("i1", "true")
            text = f"{needed_by} = xor {self.truth} {self.ref(condition)}, {every}"
            self.lines.append(text)
        reduced = f"@llvm.vector.reduce.or.v{self.width}i1({self.truth} {needed_by})"
        self.lines += (
            f"{any_} = call i1 {reduced}",
            f"br label %{here}",
            f"{here}:",
            f"br i1 {any_}, label %{some}, label %{end}",
        )
        way, after = self._side(some, places, value, end), self._new()
        nothing = f"[ zeroinitializer, %{here} ]"
        self.lines += (f"{end}:", f"{after} = phi {self.real} {way}, {nothing}")
        self.block = end
        return after

    def _side(self, label: str, places: Sequence[int], value: int, end: str) -> str:
        """Write a branch; what its value is called after it."""
        self.lines.append(f"{label}:")
        self.block = label
        for place in places:
            self.names[place] = self._new()
            self._write(self.graph.nodes[place], self.names[place])
        way = f"[ {self.ref(value)}, %{self.block} ]"
        self.lines.append(f"br label %{end}")
        for place in places:
            del self.names[place]
        return way

    def _call(self, node: Value, name: str) -> None:
        function, arguments = node.op[5:], [self.ref(x) for x in node.args]
        if function in INSTRUCTIONS:
            kind = "f64" if self.width == 1 else f"v{self.width}f64"
            called = f"call {self.real} @llvm.{function}.{kind}({self.real} {arguments[0]})"
            self.lines.append(f"{name} = {called}")
        elif self._paired(function, node) and name == f"%v{node.place}":
            # The C library gives the same bits, and JSBSim's compiler makes this call too.
            self.names[node.place] = self._pair(node.args[0])[function == "cos"]
        else:
            self._library(function, name, arguments)

    def _library(self, function: str, name: str, arguments: Sequence[str]) -> None:
        """Call a function of the C library: one over vectors, or the C library's own by lane."""
        if function in self.lifted:
            given = ", ".join(f"{self.real} {x}" for x in arguments)
            self.lines.append(f"{name} = call {self.real} @v_{function}({given})")
            return
        before = "poison"
        for lane in range(self.width):
            given = ", ".join(f"double {self._lane(x, lane)}" for x in arguments)
            if self.width == 1:
                self.lines.append(f"{name} = call double @{PREFIX}{function}({given}) #0")
                return
            value, after = self._new(), name if lane == self.width - 1 else self._new()
            self.lines += (
                f"{value} = call double @{PREFIX}{function}({given}) #0",
                f"{after} = insertelement {self.real} {before}, double {value}, i32 {lane}",
            )
            before = after

    def _lane(self, vector: str, lane: int) -> str:
        if self.width == 1:
            return vector
        value = self._new()
        self.lines.append(f"{value} = extractelement {self.real} {vector}, i32 {lane}")
        return value

    def _paired(self, function: str, node: Value) -> bool:
        return (
            function in ("sin", "cos") and function not in self.lifted and self._both(node.args[0])
        )

    def _both(self, angle: int) -> bool:
        return all((f"call {name}", angle) in self.graph.index for name in ("sin", "cos"))

    def _pair(self, angle: int) -> tuple[str, str]:
        """Sine and cosine of an angle, by one call."""
        if angle not in self.pairs:
            of, sine, cosine = self.ref(angle), self._new(), self._new()
            for lane in range(self.width):
                places = [self._place(x, lane) for x in ("%sine", "%cosine")]
                given = f"double {self._lane(of, lane)}, ptr {', ptr '.join(places)}"
                self.lines.append(f"call void @{PREFIX}sincos({given})")
            self.lines += (
                f"{sine} = load {self.real}, ptr %sine, align 8",
                f"{cosine} = load {self.real}, ptr %cosine, align 8",
            )
            self.pairs[angle] = sine, cosine
        return self.pairs[angle]

    def _place(self, of: str, lane: int) -> str:
        if self.width == 1:
            return of
        pointer = self._new()
        self.lines.append(f"{pointer} = getelementptr double, ptr {of}, i64 {lane}")
        return pointer

    def _integer(self, node: Value, name: str) -> None:
        zero, given = (self._every("i64", str(x)) for x in (0, node.args[0]))
        self.lines.append(f"{name} = add {self.whole} {given}, {zero}")

    def _segment(self, node: Value, name: str) -> None:
        inner, key, relation = node.args
        zero = total = self._every("i64", "0")
        for breakpoint_ in inner:
            below, one, more = self._new(), self._new(), self._new()
            compared = f"{self.real} {self._number(breakpoint_)}, {self.ref(key)}"
            self.lines += (
                f"{below} = fcmp {relation} {compared}",
                f"{one} = zext {self.truth} {below} to {self.whole}",
                f"{more} = add {self.whole} {total}, {one}",
            )
            total = more
        self.lines.append(f"{name} = add {self.whole} {total}, {zero}")

    def _flat(self, node: Value, name: str) -> None:
        row, columns, column = node.args
        first, by = self._new(), self._every("i64", columns)
        self.lines.append(f"{first} = mul {self.whole} {self.ref(row)}, {by}")
        self.lines.append(f"{name} = add {self.whole} {first}, {self.ref(column)}")

    def _gather(self, node: Value, name: str) -> None:
        values, index, further = node.args
        table = self.tables.setdefault(values, len(self.tables))
        place, pointer = self._new(), self._new()
        by, at = self._every("i64", further), f"ptr @{self.name}.table{table}"
        self.lines += (
            f"{place} = add {self.whole} {self.ref(index)}, {by}",
            f"{pointer} = getelementptr double, {at}, {self.whole} {place}",
        )
        if self.width == 1:
            self.lines.append(f"{name} = load double, ptr {pointer}, align 8")
            return
        kind = f"v{self.width}f64.v{self.width}p0"
        given = (
            f"<{self.width} x ptr> {pointer}, i32 8, {self.truth} {self._every('i1', 'true')}, "
            f"{self.real} poison"
        )
        self.lines.append(f"{name} = call {self.real} @llvm.masked.gather.{kind}({given})")


def constant(x: float) -> str:
    """A double as LLVM writes it, to the bit."""
    return f"0x{bits(float(x)):016X}"
