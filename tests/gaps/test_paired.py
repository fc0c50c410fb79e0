"""Which runs of two sources are compared."""

from types import SimpleNamespace

import pytest

import flighttune as ft
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
