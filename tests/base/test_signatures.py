"""Signatures that `help` shows: types by their own names, and no longer than a person can read."""

import inspect
import pydoc
import re
from collections.abc import Mapping
from functools import cache
from operator import attrgetter
from pathlib import Path
from types import FunctionType, MethodType
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
import pytest
from site_reference import public_names

import flighttune as ft
from flighttune.base.arrays import FloatArray
from flighttune.base.signatures import short_signature, short_type

# Characters: of a call or a value with few parameters, and of each parameter where there are more.
LONGEST, PER_PARAMETER = 300, 27
ARRAY = np.zeros(3)
INTERNALS = "numpy", "pydantic", "typing", "flighttune.", "Annotated", "Validator", "0x", "factory"


@cache
def signatures():
    """Signature of each public function, class and method of a class, by its name."""
    found = {}
    for name in public_names():
        value = attrgetter(name)(ft)
        if not callable(value) or (inspect.isclass(value) and issubclass(value, Exception)):
            continue
        found[name] = inspect.signature(value)
        for member in dir(value) if inspect.isclass(value) else ():
            method = getattr(value, member)
            ours = (getattr(method, "__module__", None) or "").startswith("flighttune")
            if member[0] != "_" and ours and isinstance(method, FunctionType | MethodType):
                found[f"{name}.{member}"] = inspect.signature(method)
    return found


def test_public_signatures_are_short_and_show_no_internals():
    assert len(signatures()) > 150
    for name, signature in signatures().items():
        text = str(signature)
        assert not [word for word in INTERNALS if word in text], f"{name}{text}"
        assert len(text) <= max(LONGEST, PER_PARAMETER * len(signature.parameters)), f"{name}{text}"


def test_help_shows_the_short_signature():
    def shown(value):
        """The help in one line, because a later Python breaks signatures into lines."""
        return " ".join(pydoc.render_doc(value, renderer=pydoc.plaintext).replace("|", " ").split())

    assert re.search(
        r" fly\( ?scenario: Scenario str Path, gains=\(\), \*, changes: Mapping = None, .*"
        r"\) -> FlownScenario ",
        shown(ft.fly),
    )
    assert re.search(r" LinearModel\( ?\*, A: ndarray, B: ndarray, ", shown(ft.loop.LinearModel))


@pytest.mark.parametrize(
    ("annotation", "shown"),
    [
        (FloatArray, "ndarray"),
        (FloatArray | None, "ndarray | None"),
        (npt.ArrayLike, "array_like"),
        (npt.ArrayLike | None, "array_like | None"),
        (npt.NDArray[np.complex128], "ndarray"),
        (Annotated[float, "rad"], "float"),
        (Literal["exact", "rtk"] | float, "str | float"),
        (Mapping[str, Any], "Mapping"),
        (tuple[float, ...], "tuple[float, ...]"),
        (None | str | Path, "str | Path | None"),
        (list[str | ft.PIGains], "list[str | PIGains]"),
        ("Scenario | None", "Scenario | None"),
    ],
)
def test_a_type_is_shown_by_its_own_name(annotation, shown):
    assert short_type(annotation) == shown


def test_a_default_stands_for_its_type_and_a_long_one_for_nothing():
    def call(a: float, b: int = 3, c: str | None = None, d: Any = ARRAY) -> None: ...

    assert str(short_signature(inspect.signature(call))) == (
        "(a: float, b=3, c: str = None, d=...) -> None"
    )


def test_a_subclass_has_the_signature_of_its_own_constructor():
    class Doubled(ft.loop.MimoPI):
        def __init__(self, twice: float) -> None: ...

    assert str(inspect.signature(Doubled)) == "(twice: float) -> None"
