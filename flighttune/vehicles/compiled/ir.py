# SPDX-License-Identifier: LGPL-2.1-or-later
"""The traced step as LLVM IR: a function that makes any number of steps in place."""

from collections.abc import Callable, Mapping, Sequence

from flighttune.vehicles.compiled.trace import (
    INSTRUCTIONS,
    LIBRARY,
    Graph,
    Number,
    Value,
    bits,
    needed,
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
define void @step(ptr noalias %s, ptr noalias %p, i64 %n, ptr noalias %u, ptr noalias %o, i64 %m) {{
entry:
  %sine = alloca double
  %cosine = alloca double
  %any = icmp sgt i64 %n, 0
  br i1 %any, label %loop, label %end
loop:
  %k = phi i64 [ 0, %entry ], [ %k1, %loop ]
  {body}
  %k1 = add i64 %k, 1
  %more = icmp slt i64 %k1, %n
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
    """IR of ``step(states, parameters, n, stream, shown, how_many)``, which makes n steps.

    `inputs` places each input in an array: s of states, p of parameters or u of the stream, which
    has a row of `streams` numbers for each step. `updates` are the new states. After the last step
    `signals` are written to ``shown`` if ``how_many`` is 1, `properties` behind them if it is 2.
    """
    emitter = _Emitter(graph, inputs, streams)
    # Old states, before the new ones are stored.
    shown = [value for value in (*signals, *properties) if isinstance(value, Value)]
    late = [place for place in needed(graph, shown) if graph.nodes[place].op == "input"]
    body = emitter.stores("s", updates, 0, late)
    first = emitter.stores("o", signals, 0)
    # Values of an earlier block are known in a later one: only what is missing is computed there.
    rest = emitter.stores("o", properties, len(signals))
    blocks = {
        name: "\n  ".join(lines)
        for name, lines in zip(("body", "signals", "properties"), (body, first, rest), strict=True)
    }
    return "\n".join((_DECLARATIONS, *emitter.constants(), _FUNCTION.format(**blocks)))


class _Emitter:
    """Writes operations down, each once; one block comes after the other."""

    def __init__(self, graph: Graph, inputs: Mapping[str, tuple[str, int]], streams: int) -> None:
        self.graph, self.inputs, self.streams = graph, inputs, streams
        self.lines: list[str] = []
        self.known: set[int] = set()
        self.tables: dict[tuple[float, ...], int] = {}
        self.pairs: dict[int, tuple[str, str]] = {}
        self.names: dict[int, str] = {}
        self.count = 0
        self.writers: dict[str, Callable[[Value, str], None]] = {
            "input": self._input,
            "segment": self._segment,
            "gather": self._gather,
            "flat": self._flat,
            "integer": self._integer,
            "select": self._select,
            "call": self._call,
        }

    def stores(
        self, array: str, values: Sequence[Number], first: int, further: Sequence[int] = ()
    ) -> list[str]:
        """Lines that compute values and write them into an array from its place `first` on."""
        self.lines = []
        symbols = [value for value in values if isinstance(value, Value)]
        for place in sorted({*needed(self.graph, symbols), *further} - self.known):
            self.known.add(place)
            self._write(self.graph.nodes[place])
        for slot, value in enumerate(values, first):
            text = self.ref(value.place) if isinstance(value, Value) else constant(value)
            pointer = self._pointer(array, str(slot))
            self.lines.append(f"store double {text}, ptr {pointer}, align 8")
        return self.lines

    def constants(self) -> list[str]:
        """Declarations of all tables."""
        return [
            f"@table{k} = private constant [{len(values)} x double] "
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

    def _write(self, node: Value) -> None:
        op, name = node.op, f"%v{node.place}"
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
        condition, a, b = map(self.ref, node.args)
        self.lines.append(f"{name} = select i1 {condition}, double {a}, double {b}")

    def _call(self, node: Value, name: str) -> None:
        function, arguments = node.op[5:], [f"double {self.ref(x)}" for x in node.args]
        if function in INSTRUCTIONS:
            self.lines.append(f"{name} = call double @llvm.{function}.f64({arguments[0]})")
        elif function in ("sin", "cos") and self._both(node.args[0]):
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
            f"{pointer} = getelementptr double, ptr @table{table}, i64 {place}",
            f"{name} = load double, ptr {pointer}, align 8",
        )


def constant(x: float) -> str:
    """A double as LLVM writes it, to the bit."""
    return f"0x{bits(float(x)):016X}"
