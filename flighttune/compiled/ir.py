# SPDX-License-Identifier: LGPL-2.1-or-later
"""The traced step as LLVM IR: a function that makes any number of steps in place."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence

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

_FUNCTION = """
define void @{name}(ptr noalias %s, ptr noalias %p, i64 %n, ptr noalias %u, ptr noalias %o, i64 %m)
{{
entry:
  %sine = alloca double
  %cosine = alloca double
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


def step_ir(
    graph: Graph,
    inputs: Mapping[str, tuple[str, int]],
    updates: Sequence[Number],
    signals: Sequence[Number],
    properties: Sequence[Number],
    streams: int,
) -> str:
    """IR of the one function ``step``, as `function_ir` has it."""
    return module(function_ir("step", graph, inputs, updates, signals, properties, streams))


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
) -> str:
    """IR of ``step(states, parameters, n, stream, shown, how_many)``, which makes n steps.

    `inputs` places each input in an array: s of states, p of parameters or u of the stream, which
    has a row of `streams` numbers for each step. `updates` are the new states. After the last step
    `signals` are written to ``shown`` if ``how_many`` is 1, `properties` behind them if it is 2.
    The steps end with the first in which `until` holds.
    """
    emitter = _Emitter(graph, inputs, streams, name)
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
    text = _FUNCTION.format(name=name, goes_on=further, **lines)
    return "\n".join((*emitter.constants(), text))


class _Emitter:
    """Writes operations down, each once; one block comes after the other."""

    def __init__(
        self, graph: Graph, inputs: Mapping[str, tuple[str, int]], streams: int, name: str
    ) -> None:
        self.graph, self.inputs, self.streams, self.name = graph, inputs, streams, name
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
            self.lines.append(f"{value} = call double @{PREFIX}{function}(double {x}) #0")
            found.append((f"%v{place} = phi double [ {value}, %first ]", new))
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
            text = self.ref(value.place) if isinstance(value, Value) else constant(value)
            pointer = self._pointer(array, str(slot))
            self.lines.append(f"store double {text}, ptr {pointer}, align 8")
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
            return constant(of_bits(node.args[0]))
        return self.names.get(place, f"%v{place}")

    def _new(self) -> str:
        self.count += 1
        return f"%t{self.count}"

    def _pointer(self, array: str, index: str) -> str:
        pointer = self._new()
        self.lines.append(f"{pointer} = getelementptr double, ptr %{array}, i64 {index}")
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
            relation, parts = ("xor", f"{parts}, true") if op == "not" else (op, parts)
            self.lines.append(f"{name} = {relation} i1 {parts}")
        else:  # arithmetic, and comparisons
            self.lines.append(f"{name} = {op} double {parts}")

    def _input(self, node: Value, name: str) -> None:
        array, slot = self.inputs[node.args[0]]
        index = str(slot)
        if array == "u":
            row, index = self._new(), self._new()
            self.lines.append(f"{row} = mul i64 %k, {self.streams}")
            self.lines.append(f"{index} = add i64 {row}, {slot}")
        self.lines.append(f"{name} = load double, ptr {self._pointer(array, index)}, align 8")

    def _select(self, node: Value, name: str) -> None:
        condition, *values = node.args
        alone = [self.on_side.get((node.place, holds), []) for holds in (True, False)]
        if not any(alone):
            a, b = map(self.ref, values)
            self.lines.append(f"{name} = select i1 {self.ref(condition)}, double {a}, double {b}")
            return
        yes, no, end = (f"{self._new()[1:]}.{at}" for at in ("yes", "no", "end"))
        self.lines.append(f"br i1 {self.ref(condition)}, label %{yes}, label %{no}")
        ways = [self._side(*x, end) for x in zip((yes, no), alone, values, strict=True)]
        self.lines += (f"{end}:", f"{name} = phi double {', '.join(ways)}")
        self.block = end

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
        function, arguments = node.op[5:], [f"double {self.ref(x)}" for x in node.args]
        if function in INSTRUCTIONS:
            self.lines.append(f"{name} = call double @llvm.{function}.f64({arguments[0]})")
        elif function in ("sin", "cos") and self._both(node.args[0]) and name == f"%v{node.place}":
            # The C library gives the same bits, and JSBSim's compiler makes this call too.
            self.names[node.place] = self._pair(node.args[0])[function == "cos"]
        else:
            called = f"call double @{PREFIX}{function}({', '.join(arguments)}) #0"
            self.lines.append(f"{name} = {called}")

    def _both(self, angle: int) -> bool:
        return all((f"call {name}", angle) in self.graph.index for name in ("sin", "cos"))

    def _pair(self, angle: int) -> tuple[str, str]:
        """Sine and cosine of an angle, by one call."""
        if angle not in self.pairs:
            sine, cosine = self._new(), self._new()
            self.lines += (
                f"call void @{PREFIX}sincos(double {self.ref(angle)}, ptr %sine, ptr %cosine)",
                f"{sine} = load double, ptr %sine",
                f"{cosine} = load double, ptr %cosine",
            )
            self.pairs[angle] = sine, cosine
        return self.pairs[angle]

    def _integer(self, node: Value, name: str) -> None:
        self.lines.append(f"{name} = add i64 {node.args[0]}, 0")

    def _segment(self, node: Value, name: str) -> None:
        inner, key, relation = node.args
        total = "0"
        for breakpoint_ in inner:
            below, one, more = self._new(), self._new(), self._new()
            self.lines += (
                f"{below} = fcmp {relation} double {constant(breakpoint_)}, {self.ref(key)}",
                f"{one} = zext i1 {below} to i64",
                f"{more} = add i64 {total}, {one}",
            )
            total = more
        self.lines.append(f"{name} = add i64 {total}, 0")

    def _flat(self, node: Value, name: str) -> None:
        row, columns, column = node.args
        first = self._new()
        self.lines.append(f"{first} = mul i64 {self.ref(row)}, {columns}")
        self.lines.append(f"{name} = add i64 {first}, {self.ref(column)}")

    def _gather(self, node: Value, name: str) -> None:
        values, index, further = node.args
        table = self.tables.setdefault(values, len(self.tables))
        place, pointer = self._new(), self._new()
        self.lines += (
            f"{place} = add i64 {self.ref(index)}, {further}",
            f"{pointer} = getelementptr double, ptr @{self.name}.table{table}, i64 {place}",
            f"{name} = load double, ptr {pointer}, align 8",
        )


def constant(x: float) -> str:
    """A double as LLVM writes it, to the bit."""
    return f"0x{bits(float(x)):016X}"
