"""Workers and observer: one value below the verbs, whose keywords are the same in each of them."""

import inspect

import pytest

import flighttune as ft
from flighttune.campaigns.engine.fliers import Fliers, FlownBy

VERBS = (
    *("band", "compare", "meet", "mission", "monitor", "refly", "residual"),
    *("run_campaign", "verify", "worst"),
)


@pytest.mark.parametrize(
    ("by", "words"),
    [
        ({"workers": 0}, "`workers` must be at least 1, got 0"),
        (
            {"workers": 2, "scheduler": "tcp://127.0.0.1:1"},
            "`workers` must not be given with `scheduler`",
        ),
        ({"workers": 100_000}, r"`workers` must be at most \d+, 16 for each core, got 100000"),
        ({"scheduler": ""}, "`scheduler` must be tcp://HOST:PORT, got ''"),
        ({"scheduler": "127.0.0.1"}, "`scheduler` must be tcp://HOST:PORT, got '127.0.0.1'"),
    ],
)
def test_who_cannot_fly_is_refused_before_anything_is_planned(by, words):
    with pytest.raises(ft.InputError, match=words):
        Fliers(**by)
    with pytest.raises(ft.InputError, match=words):
        ft.worst("no_such_campaign", **by)


def test_the_verbs_that_fly_many_runs_are_those_with_the_keywords_of_all():
    signatures = {
        x: inspect.signature(getattr(ft, x)) for x in dir(ft) if inspect.isfunction(getattr(ft, x))
    }
    keywords = {"workers", "scheduler", "observer"}

    assert {*FlownBy.__annotations__} == keywords
    assert {x for x, of in signatures.items() if keywords <= {*of.parameters}} == {*VERBS}


@pytest.mark.parametrize("name", VERBS)
def test_a_verb_has_the_keywords_of_all_and_refuses_others_by_its_name(name):
    verb = getattr(ft, name)
    parameters = inspect.signature(verb).parameters

    for key in FlownBy.__annotations__:
        assert parameters[key].kind is inspect.Parameter.KEYWORD_ONLY
        assert parameters[key].default is None
    assert not any(x.kind is inspect.Parameter.VAR_KEYWORD for x in parameters.values())
    source = ["nowhere"] * (2 if name == "run_campaign" else 1)
    with pytest.raises(TypeError, match=rf"{name}\(\) got an unexpected keyword argument 'wrkers'"):
        verb(*source, wrkers=2)
    with pytest.raises(ft.InputError, match="`workers` must be a whole number or None, got 'two'"):
        verb(*source, workers="two")
