"""scenarios/README.md: its table of keys is the schema's, and feed-forward does what it says."""

import json
import re
import types
from pathlib import Path

import pytest
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

import flighttune as ft
from flighttune.flight.new import new_scenario

PAGE = (Path(__file__).parents[2] / "scenarios" / "README.md").read_text(encoding="utf-8")
ROWS = dict(re.findall(r"^\| (\(top\)|`\[.*\]`) \| (.*) \|$", PAGE, re.MULTILINE))


def row_of(table):
    (found,) = (row for names, row in ROWS.items() if f"[{table}]" in names or names == table)
    return found


def leaves(annotation):
    """What a field may hold, out of whatever unions and lists it stands in."""
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        return [annotation]
    parts = getattr(annotation, "__args__", ())
    return [leaf for part in parts for leaf in leaves(part)] if parts else [annotation]


def is_table(leaf):
    return isinstance(leaf, type) and issubclass(leaf, BaseModel)


def keys_of(model, table):
    for key, field in model.model_fields.items():
        held = leaves(field.annotation)
        if not all(is_table(leaf) or leaf is types.NoneType for leaf in held):
            yield table, field.alias or key, field
        for part in filter(is_table, held):
            yield from keys_of(part, key if table == "(top)" else f"{table}.{key}")


KEYS = list(keys_of(ft.Scenario, "(top)"))


@pytest.mark.parametrize(("table", "key", "field"), KEYS, ids=[f"{t}-{k}" for t, k, _ in KEYS])
def test_every_key_stands_in_the_row_of_its_table_with_its_default(table, key, field):
    default = field.get_default(call_default_factory=True, validated_data={})
    if default is PydanticUndefined:
        shown = f"**`{key}`**"
    else:
        shown = f"`{key}`" if default is None else f"`{key}={json.dumps(default)}`"

    assert shown in row_of(table)


def test_the_keys_are_those_of_every_table():
    assert len({table for table, _, _ in KEYS}) == len(ROWS) + 1  # two channels share a row


@pytest.fixture
def example(tmp_path):
    return new_scenario(str(tmp_path / "example"))


@pytest.mark.slow
def test_without_feed_forward_the_aircraft_sinks_first(example):
    level = example.read_text().replace("gamma_deg = 3", "gamma_deg = 0")
    level = level.replace('"exact"', '"paper"').replace("tuned_fed_back", "tuned_identified")
    lowest = {}
    for setting in ("true", "false"):
        example.write_text(level.replace("feed_forward = true ", f"feed_forward = {setting}"))
        (_, run) = ft.fly(ft.load_scenario(example)).runs
        lowest[setting] = run.signals["h"].iloc[0] - run.signals["h"].min()

    assert lowest["false"] > 3.0 * lowest["true"]
