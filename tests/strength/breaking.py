"""What can be broken in a line: a comparison, a sign, a factor, a number, `and`, `not`, min."""

import ast
import random
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "flighttune"
COMPILED = "flight/loop/kernel.py"  # by Numba, which does not see a function that is exchanged
COMPARED = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
}
COMPUTED = {ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*")}
JOINED = {ast.And: ("and", "or"), ast.Or: ("or", "and")}
PAIRS = [("min", "max"), ("minimum", "maximum"), ("any", "all"), ("floor", "ceil")]
CALLED = {a: b for one, other in PAIRS for a, b in ((one, other), (other, one))}


@dataclass(frozen=True)
class Change:
    """Of one place in one line; columns count bytes, as those of `ast` do."""

    path: str
    line: int
    column: int
    old: str
    new: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.old} -> {self.new}"

    def within(self, source: str) -> str:
        lines = source.splitlines(keepends=True)
        raw = lines[self.line - 1].encode()
        after = raw[self.column + len(self.old.encode()) :]
        lines[self.line - 1] = (raw[: self.column] + self.new.encode() + after).decode()
        return "".join(lines)


class Finder(ast.NodeVisitor):
    """Of the places in functions; docstrings, annotations and what is raised are passed over."""

    def __init__(self, path: str, source: str):
        self.path, self.found, self._depth = path, [], 0
        self._text = [line.encode() for line in source.splitlines(keepends=True)]
        self.visit(ast.parse(source))

    def generic_visit(self, node):
        if self._depth:
            self._break(node)
        super().generic_visit(node)

    def visit_FunctionDef(self, node):
        self._depth += 1
        for child in node.body[ast.get_docstring(node) is not None :]:
            self.visit(child)
        self._depth -= 1

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_Raise(self, node):
        pass

    visit_JoinedStr = visit_Raise

    def visit_AnnAssign(self, node):
        if node.value is not None:
            self.visit(node.value)

    def visit_If(self, node):
        if "TYPE_CHECKING" not in ast.unparse(node.test):
            self.generic_visit(node)

    def _break(self, node):
        match node:
            case ast.Compare():
                for (a, b), op in zip(
                    pairwise([node.left, *node.comparators]), node.ops, strict=True
                ):
                    self._between(a, b, *COMPARED[type(op)])
            case ast.BinOp(op=op, left=a, right=b) if type(op) in COMPUTED:
                if not any(isinstance(x, ast.JoinedStr | ast.List) or text(x) for x in (a, b)):
                    self._between(a, b, *COMPUTED[type(op)])
            case ast.BoolOp(op=op, values=[a, b]):
                self._between(a, b, *JOINED[type(op)])
            case ast.UnaryOp(op=ast.Not()):
                self._at(node.lineno, node.col_offset, "not ", "")
            case ast.UnaryOp(op=ast.USub()):
                self._at(node.lineno, node.col_offset, "-", "")
            case ast.Constant(value=value) if node.lineno == node.end_lineno:
                old = self._text[node.lineno - 1][node.col_offset : node.end_col_offset].decode()
                new = other(value)
                if new:
                    self._at(node.lineno, node.col_offset, old, new)
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in CALLED:
                func = node.func
                self._at(func.end_lineno, func.end_col_offset - len(name), name, CALLED[name])

    def _at(self, line, column, old, new):
        if self._text[line - 1][column:].startswith(old.encode()):
            self.found.append(Change(self.path, line, column, old, new))

    def _between(self, a, b, old, new):
        if a.end_lineno != b.lineno:
            return
        part = self._text[b.lineno - 1][a.end_col_offset : b.col_offset].decode()
        word = rf"\b{old}\b" if old[0].isalpha() else re.escape(old)
        places = [*re.finditer(word, part)]
        if len(places) == 1:
            before = len(part[: places[0].start()].encode())
            self._at(b.lineno, a.end_col_offset + before, old, new)


def text(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def other(value):
    """Another constant for a constant, as text; None for what is not broken."""
    match value:
        case bool():
            return str(not value)
        case int():
            return str(value + 1)
        case float():
            return repr(1.1 * value if value else 1.0)
    return None


def compiles(source):
    try:
        compile(source, "broken", "exec", dont_inherit=True)
    except SyntaxError:
        return False
    return True


def draw(run, count, seed, rooms=()):
    """Changes of `count` lines of those that are run: the same for the same seed.

    `run` has the lines of each file, by its path in the package.
    """
    rng, lines = random.Random(seed), []
    for path in sorted(run):
        if path == COMPILED or not path.endswith(".py") or not path.startswith(tuple(rooms) or ""):
            continue
        source = (PACKAGE / path).read_text("utf-8")
        of_line = {}
        for change in Finder(path, source).found:
            if change.line in run[path]:
                of_line.setdefault(change.line, []).append(change)
        lines += [(source, of_line[line]) for line in sorted(of_line)]
    rng.shuffle(lines)
    drawn = []
    for source, some in lines:
        change = rng.choice(some)
        if compiles(change.within(source)):
            drawn.append(change)
        if len(drawn) == count:
            break
    return drawn, len(lines)
