"""The public docstrings are there, and name every argument and every attribute."""

import dataclasses
import inspect
import re

import flighttune

PUBLIC = [getattr(flighttune, name) for name in flighttune.__all__]


def test_public_functions_explain_every_argument():
    for function in filter(inspect.isfunction, PUBLIC):
        text, names = inspect.getdoc(function), inspect.signature(function).parameters
        for name in names:
            explained = re.search(rf"^.*\b{name}\b.* :", text, re.MULTILINE) or f"`{name}`" in text
            assert explained or len(names) == 1, f"`{function.__name__}`: `{name}`"


def test_public_values_explain_every_attribute():
    for value in filter(dataclasses.is_dataclass, PUBLIC):
        for field in dataclasses.fields(value):
            found = re.search(rf"\b{field.name}\b.* :", inspect.getdoc(value))
            assert found, f"`{value.__name__}`: `{field.name}`"
