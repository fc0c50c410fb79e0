"""Docstrings say what a caller needs, and modules and functions stay of a size that reads."""

import ast
import dataclasses
import inspect
import re
from pathlib import Path

import pytest

import flighttune

PACKAGE = Path(flighttune.__file__).parent
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if "_shipped" not in path.parts)
PUBLIC = [getattr(flighttune, name) for name in flighttune.__all__]
LONGEST_MODULE = 300
LONGEST_BODY = 60


def identify(path):
    return path.relative_to(PACKAGE).as_posix()


@pytest.mark.parametrize("path", MODULES, ids=identify)
def test_modules_classes_and_functions_are_documented(path):
    tree = ast.parse(path.read_text())
    assert ast.get_docstring(tree), f"{path.name} has no docstring"
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    members = [member for node in classes for member in node.body]
    for node in [*tree.body, *members]:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            assert ast.get_docstring(node), f"`{node.name}` has no docstring"


@pytest.mark.parametrize("path", MODULES, ids=identify)
def test_modules_and_functions_stay_readable(path):
    text = path.read_text()
    assert len(text.splitlines()) <= LONGEST_MODULE
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            first = node.body[1] if ast.get_docstring(node) and node.body[1:] else node.body[0]
            length = (node.end_lineno or 0) - first.lineno + 1
            assert length <= LONGEST_BODY, f"`{node.name}` has {length} lines"


@pytest.mark.parametrize(
    "function", [f for f in PUBLIC if inspect.isfunction(f)], ids=lambda f: f.__name__
)
def test_public_functions_explain_every_argument(function):
    text = inspect.getdoc(function)
    for name in inspect.signature(function).parameters:
        assert re.search(rf"^.*\b{name}\b.* :", text, re.MULTILINE) or (
            f"`{name}`" in text or len(inspect.signature(function).parameters) == 1
        ), f"`{function.__name__}` does not explain `{name}`"


@pytest.mark.parametrize(
    "value",
    [c for c in PUBLIC if inspect.isclass(c) and dataclasses.is_dataclass(c)],
    ids=lambda c: c.__name__,
)
def test_public_values_explain_every_attribute(value):
    text = inspect.getdoc(value)
    for field in dataclasses.fields(value):
        assert re.search(rf"\b{field.name}\b.* :", text), (
            f"`{value.__name__}` does not explain `{field.name}`"
        )
