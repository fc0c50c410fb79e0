"""Tests take less and less from inside the package; CONTRIBUTING says which kinds stay."""

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
# Counts of all tests. One that rises fails; whoever makes one fall writes the new count here.
KEPT = {
    "names imported from inside": 197,
    "private names": 0,
    "patches": 14,
    "made-up objects": 0,
}  # fmt: skip
PATCHES = ("setattr", "setitem", "delattr")  # of monkeypatch; the environment and folders are free
OF_OTHERS = ("_exit", "_replace", "_repr_svg_")  # of os, of named tuples, of IPython
MADE_UP = ("SimpleNamespace", "Mock", "MagicMock")


def counts(source):
    """How often a file takes something from inside the package, by kind."""
    found = Counter()
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.ImportFrom(module=str(module), names=names) if within(module):
                found["names imported from inside"] += len(names)
                found["private names"] += sum(private(alias.name) for alias in names)
            case ast.Import(names=names):
                found["names imported from inside"] += sum(within(x.name) for x in names)
            case ast.Attribute(value=of, attr=name) if private(name):
                own = isinstance(of, ast.Name) and of.id in ("self", "cls")
                found["private names"] += not own
            case ast.Call(func=ast.Attribute(value=ast.Name(id="monkeypatch"), attr=name)):
                found["patches"] += name in PATCHES
            case ast.Call(func=ast.Name(id=name)):
                found["made-up objects"] += name in MADE_UP
    return found


def within(module):
    return module.startswith("flighttune.")


def private(name):
    return name.startswith("_") and not name.startswith("__") and name not in OF_OTHERS


@cache
def every():
    return {path: counts(path.read_text("utf-8")) for path in sorted(TESTS.rglob("*.py"))}


@pytest.mark.parametrize("kind", KEPT)
def test_what_is_taken_from_inside_becomes_less(kind):
    now = {path.relative_to(TESTS).as_posix(): found[kind] for path, found in every().items()}
    most = sorted(now, key=now.__getitem__)[-5:]
    total = sum(now.values())

    assert total <= KEPT[kind], f"{kind}: {total}; most are in {', '.join(most)}"
    assert total == KEPT[kind], f"{kind}: {total} are left; write this into KEPT"


def test_each_kind_is_counted():
    source = (
        "import flighttune.a\nfrom flighttune.a import b, _c\nfrom flighttune import fly\n"
        "x._y\nself._y\nx.__y__\nmonkeypatch.setattr(x, 'y', 1)\nmonkeypatch.chdir(x)\n"
        "SimpleNamespace(a=1)\n"
    )
    wanted = (3, 2, 1, 1)

    assert tuple(counts(source)[kind] for kind in KEPT) == wanted


def test_every_test_that_a_page_names_is_there():
    root = TESTS.parent
    pages = [*root.glob("*.md"), *root.glob("docs/*.md"), *root.glob("design/*.md")]
    named = {
        (page.name, test)
        for page in pages
        if page.name != "CHANGELOG.md"  # of earlier versions
        for test in re.findall(r"\btests/[\w/]+[.]py", page.read_text("utf-8"))
    }

    assert len(named) > 20
    assert not [(page, test) for page, test in named if not (root / test).exists()]
