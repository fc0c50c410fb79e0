"""Which runs of two sources are compared."""

from types import SimpleNamespace

import pytest
from made_up import made_up_run

import flighttune as ft
from flighttune.gaps import compare
from flighttune.gaps.compare import _paired, _source


def runs(*labels):
    """Runs of plants with gains, written ``plant/gains``."""
    places = (label.split("/") for label in labels)
    return [
        SimpleNamespace(provenance=SimpleNamespace(plant=plant, gains_name=gains, log=None))
        for plant, gains in places
    ]


@pytest.mark.parametrize(
    ("a", "b", "pairs"),
    [
        (("law/p", "air/p"), ("air/p", "law/p"), [(0, 1), (1, 0)]),
        # one gain set on each side: by plant
        (("law/p", "air/p"), ("air/q", "law/q"), [(0, 1), (1, 0)]),
        # one plant on each side: by gains
        (("law/p", "law/q"), ("air/q", "air/p"), [(0, 1), (1, 0)]),
        # two gain sets against another one: nothing says which of them is meant
        (("law/p", "law/q"), ("law/r",), []),
        (("law/p", "air/p"), ("sea/p",), []),
        (("law/p",), ("air/q",), [(0, 0)]),
    ],
)
def test_runs_are_paired_by_label_else_by_what_one_side_has_alone(a, b, pairs):
    a, b = runs(*a), runs(*b)

    assert [(a.index(x), b.index(y)) for x, y in _paired(a, b)] == pairs


@pytest.mark.slow
def test_sources_are_lettered_in_their_order():
    flown = ft.fly("paper", gains=["paper"])

    names = [_source(source, place, ()).name for place, source in enumerate([flown, *flown.runs])]

    assert [name[:3] for name in names] == ["A: ", "B: ", "C: "][: len(names)]


def test_runs_of_one_source_are_compared_with_its_first_if_two_have_flown():
    flown = [made_up_run({"phi": [0.0, 0.1]}, gains_name=name) for name in ("a", "b")]
    still = made_up_run({"phi": [0.0]}, gains_name="c", status="invalid", reason="No trim.")

    first, second = compare._each_run(compare.Source(name="runs", runs=(flown[0], still, flown[1])))

    assert (first.runs, second.runs) == ((flown[0],), (flown[1],))
    assert (len(first.missing), second.missing) == (1, ())
    assert first.missing[0].startswith("kinematic / c: ")
    for runs, got in (((), "none"), ((still,), "none"), ((flown[1], still), "kinematic / b")):
        with pytest.raises(ft.InputError, match=f"at least two runs must have flown, got {got}"):
            compare._each_run(compare.Source(name="runs", runs=runs))


def test_runs_of_another_plant_and_other_gains_are_not_compared():
    one, other = (
        compare.Source(
            name=name,
            runs=(made_up_run({"phi": [0.0, 0.1]}, plant=f"{name}1", gains_name=name),
                  made_up_run({"phi": [0.0, 0.1]}, plant=f"{name}2", gains_name=name)),
        )
        for name in ("a", "b")
    )  # fmt: skip

    said = compare._why_not(one, other, [])

    assert said.startswith("a and b: no run of one has the plant and gains of one of the other, ")
    assert "got a1 / a, a2 / a | b1 / b, b2 / b;" in said
