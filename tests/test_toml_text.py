"""Scenarios written as TOML and read by Python's own reader."""

import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from places import SCENARIO_NAMES

import flighttune as ft
from flighttune.base.files.table import toml_text

TEXT = st.text(st.characters(exclude_categories=("Cs",)), max_size=12)
SCALARS = st.one_of(
    st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), TEXT
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(TEXT, inner, max_size=3)),
    max_leaves=8,
)


@settings(max_examples=60)
@given(st.dictionaries(TEXT, VALUES, max_size=4))
@pytest.mark.slow
def test_every_table_of_plain_values_comes_back_from_its_text(tables):
    assert tomllib.loads(toml_text(tables)) == tables


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIO_NAMES)
def test_every_shipped_scenario_comes_back_with_its_hash(name):
    scenario = ft.load_scenario(name)

    again = ft.scenario_from(tomllib.loads(toml_text(scenario.as_dict())))

    assert again.sha256 == scenario.sha256
    assert scenario.title
    assert scenario.verifies
    assert scenario.source


def test_what_is_none_is_left_out():
    assert toml_text({"a": None, "b": {"c": 1, "d": None}}) == "[b]\nc = 1\n"
