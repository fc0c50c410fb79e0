"""Which tests take something from inside the package."""

import ast
from functools import cache
from pathlib import Path

from test_kinds import counts, within

TESTS = Path(__file__).parents[1]


def takes_nothing_from_inside(test):
    """Whether a test, with what it uses of its own file, takes public names alone."""
    path, _, name = test.partition("::")
    return name.partition("[")[0].partition("::")[0] not in of_file(path)


@cache
def of_file(path):
    """The names of a file that stand for something from inside, or use such a name."""
    tree = ast.parse((TESTS.parent / path).read_text("utf-8"))
    uses, found = {}, set()
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and within(node.module or ""):
            found |= {alias.asname or alias.name for alias in node.names}
        for name in defined(node):
            uses[name] = {x.id for x in ast.walk(node) if isinstance(x, ast.Name)}
            uses[name] |= {x.arg for x in ast.walk(node) if isinstance(x, ast.arg)}
            if any(counts(ast.unparse(node)).values()):
                found.add(name)
    while more := {name for name, used in uses.items() if used & found} - found:
        found |= more
    return found


def defined(node):
    match node:
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            return [name]
        case ast.Assign(targets=targets):
            return [x.id for x in targets if isinstance(x, ast.Name)]
    return []
