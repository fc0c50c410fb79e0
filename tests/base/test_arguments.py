"""What fits an annotation, and what a call with arguments that do not is told."""

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, TypedDict, TypeVar, Unpack

import numpy as np
import numpy.typing as npt
import pytest

import flighttune as ft
from flighttune.base import arguments


class Named(Protocol):
    name: str

    def step(self, t: float) -> float: ...


class WithName:
    name = "x"

    def step(self, t):
        return t


class WithoutStep:
    name = "x"


class Keys(TypedDict):
    flights: int
    seed: int


RAGGED = [[1.0], [1.0, 2.0]]
T = TypeVar("T")


@pytest.mark.parametrize(
    ("annotation", "good", "bad"),
    [
        (Any, ["anything"], []),
        (object, ["anything"], []),
        (T, ["anything"], []),
        (None, [None], [0]),
        (bool, [True, np.bool_(False)], [1]),
        (int, [3, np.int64(3), -(2**31) + 1], [True, 3.0, 2**31, -(2**31)]),
        (float, [3, 3.5, np.float32(1.0)], [1j, "3"]),
        (str | None, ["x", None], [3]),
        (Literal["a", 3], ["a", 3], ["b", 3.5, 3.0, ["a"]]),
        (np.ndarray, [np.zeros(2)], [[1, 2]]),
        (npt.NDArray[np.float64], [np.zeros(2), [1, 2]], [RAGGED, ["x"]]),
        (npt.ArrayLike, [3.0, [[1, 2]]], [RAGGED, "x"]),
        (npt.ArrayLike | None, [None, [1.0, 2.0]], [RAGGED, "x"]),
        (tuple[int, str], [(3, "x"), [3, "x"]], [(3,), (3, "x", "x"), ("x", 3), (3, 3), "3x", 5]),
        (tuple[int, ...], [(), (1, 2, 3)], [(1, "x"), 1]),
        (Mapping[str, int], [{}, {"x": 3}], [{3: 3}, {"x": "x"}, [("x", 3)]]),
        (Callable[[int], int], [len], [3]),
        (Sequence[int], [[1], (1, 2), range(3)], ["12", b"12", ["1"], None, iter([1])]),
        (Iterable[int], [[1], iter([1]), {1, 2}], ["12", ["1"], 3]),
        (Annotated[float, "rad"], [3.0], ["3"]),
        (Path, [Path("x")], ["x"]),
        (Named, [WithName()], [WithoutStep(), 3]),
        ("a type that is imported later", [3], []),
    ],
)
def test_a_value_fits_its_annotation_or_does_not(annotation, good, bad):
    assert [x for x in good if not arguments.fits(x, annotation)] == []
    assert [x for x in bad if arguments.fits(x, annotation)] == []


@pytest.mark.parametrize(
    ("annotation", "words"),
    [
        (npt.ArrayLike | None, "numbers or None"),
        (npt.NDArray[np.float64], "numbers"),
        (Literal["a", "b"], "'a' or 'b'"),
        (dict[str, int], "a dictionary"),
        (Callable[[], None], "a function"),
        (tuple[float, float], "2 values, each a number"),
        (tuple[float, ...], "a list, each a number"),
        (list[str | Path], "a list, each text or a path"),
        (Annotated[float, "rad"], "a number"),
        (WithName, "a WithName"),
    ],
)
def test_an_annotation_has_words(annotation, words):
    assert arguments.words(annotation) == words


def flown(
    scenario: str,
    *others: int,
    changes: Mapping[str, int] | None = None,
    given: str = None,  # noqa: RUF013
    free=0,
    **by: Unpack[Keys],
) -> tuple[Any, ...]:
    return scenario, others, changes, given, free, by


CHECKED = arguments.checked(flown)


def test_a_call_that_fits_is_that_of_the_function_and_a_default_always_fits():
    assert CHECKED("x", 1, 2, changes={"a": 1}, free="any", flights=3) == (
        *("x", (1, 2), {"a": 1}, None, "any"),
        {"flights": 3},
    )
    assert CHECKED("x", given=None)[3] is None
    assert [*inspect.signature(CHECKED).parameters] == [
        *("scenario", "others", "changes", "given", "free", "flights", "seed")
    ]


@pytest.mark.parametrize(
    ("given", "options", "said"),
    [
        ((3,), {}, "`scenario` must be text, got 3."),
        (("x", 1, "2"), {}, "`others` must be a whole number, got '2'."),
        (("x",), {"changes": {3: 1}}, "each name in `changes` must be text, got 3."),
        (("x",), {"changes": {"a": "b"}}, "`changes` must have a whole number for a, got 'b'."),
        (("x",), {"changes": 3}, "`changes` must be a dictionary or None, got 3."),
        (("x",), {"seed": "x"}, "`seed` must be a whole number, got 'x'."),
        (("a\0b",), {}, "`scenario` must be a name or path"),
        (("x" * 256,), {}, "`scenario` must be a name or path"),
        (("x/" * 2048,), {}, "`scenario` must be a name or path"),
    ],
)
def test_the_first_argument_that_does_not_fit_is_refused(given, options, said):
    with pytest.raises(ft.InputError) as refused:
        CHECKED(*given, **options)
    assert str(refused.value).startswith(said)


def test_names_and_paths_may_be_as_long_as_those_of_files():
    longest = "x" * 255
    assert CHECKED(longest)[0] == longest
    assert CHECKED("x/" * 2047)[0] == "x/" * 2047


def test_another_name_or_number_of_arguments_is_a_type_error_of_the_call():
    with pytest.raises(TypeError, match=r"flown\(\) .*'unknown'"):
        CHECKED("x", unknown=3)


def test_a_class_says_what_does_not_fit_only_when_it_cannot_be_built():
    @arguments.checked_class
    class Halved:
        def __init__(self, size: float) -> None:
            if not size:
                raise ft.InputError("`size` must be another,\n got " + "0" * 2000)
            self.size = 0.5 * size

    assert Halved(3.0).size == 1.5
    with pytest.raises(ft.InputError, match=r"^`size` must be a number, got 'x'\.$"):
        Halved("x")
    with pytest.raises(ft.InputError, match=r"^`size` must be another, got 0+ \.\.\.$") as refused:
        Halved(0.0)
    assert len(str(refused.value)) == arguments.MAX_LINE + len(" ...")
