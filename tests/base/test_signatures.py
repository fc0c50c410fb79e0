"""Signatures that `help` shows: types by their own names, and no longer than a person can read."""

import inspect
import pydoc
import re
from functools import cache
from operator import attrgetter
from types import FunctionType, MethodType

import pytest
from site_reference import public_names

import flighttune as ft

# Characters: of a call or a value with few parameters, and of each parameter where there are more.
LONGEST, PER_PARAMETER = 300, 27
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
    ("call", "words"),
    [
        (ft.loop.indicators, "A_K: array_like"),
        (ft.PIGains, "K_P: ndarray"),
        (ft.certify, "gains: PIGains | str = None"),
        (ft.trim, "V_a: "),
        (ft.load_scenario, "path: str | Path"),
        (ft.fly, "gains=()"),
        (ft.tune, "changes: Mapping = None"),
    ],
)
def test_a_type_is_shown_by_its_own_name_and_a_default_by_its_value(call, words):
    text = str(inspect.signature(call))

    assert words in text
    assert text.count("(") == text.count(")")


def test_a_subclass_has_the_signature_of_its_own_constructor():
    class Doubled(ft.loop.MimoPI):
        def __init__(self, twice: float) -> None: ...

    assert str(inspect.signature(Doubled)) == "(twice: float) -> None"
