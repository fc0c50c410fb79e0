"""scenarios/README.md names every table, and what it says of feed-forward holds."""

import re
import types
from pathlib import Path

import pytest
from commands import answer
from pydantic import BaseModel
from site_reference import keys, meanings

import flighttune as ft

PAGE = (Path(__file__).parents[3] / "scenarios" / "README.md").read_text(encoding="utf-8")


def leaves(annotation):
    """What a field may hold, out of whatever unions and lists it stands in."""
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        return [annotation]
    parts = getattr(annotation, "__args__", ())
    return [leaf for part in parts for leaf in leaves(part)] if parts else [annotation]


def tables_in(model, place=""):
    """Places of the tables of a file, as they are written there, and their models."""
    for key, field in model.model_fields.items():
        path = f"{place}.{field.alias or key}".removeprefix(".")
        listed = "list" in str(field.annotation)
        for leaf in leaves(field.annotation):
            if isinstance(leaf, type) and issubclass(leaf, BaseModel):
                yield f"[[{path}]]" if listed else f"[{path}]", leaf
                yield from tables_in(leaf, path)


TABLES = dict(tables_in(ft.Scenario))


@pytest.mark.parametrize("place", TABLES)
def test_the_page_names_every_table(place):
    assert place in PAGE


@pytest.mark.soak
def test_the_list_of_keys_gives_range_default_and_the_comment_beside_the_key():
    rows = [row for row in keys() if row.startswith(("| `sensitivity_max`", "| `roll_in_s`"))]

    assert rows == [
        "| `roll_in_s` | number, >= 0, <= 1e+06 | `0.0` | "
        "time over which the rate rises, and falls: the ramp is planned |",
        "| `sensitivity_max` | number, > 1 |  | "
        "bound for each channel, with decay, E_K and rms; 1.4 if left out, at most 1.66 |",
    ]


# Keys of which the key before them, or the docstring of their table, says the meaning.
TOLD_ABOVE = (
    "n_z elevator_stuck_deg rudder_stuck_deg chi_phase_deg gamma_phase_deg speed_mps level "
    "intensity wave east_m lat_deg lon_deg"
)


@pytest.mark.parametrize("place", TABLES)
def test_a_key_without_a_default_says_what_holds_without_it(place):
    said = meanings(TABLES[place])
    for name, field in TABLES[place].model_fields.items():
        key = field.alias or name
        number = not any(hasattr(leaf, "model_fields") for leaf in leaves(field.annotation))
        if field.default is None and number and key not in TOLD_ABOVE.split():
            assert said[key], key


@pytest.fixture
def example(tmp_path):
    answer("new", "example", cwd=tmp_path)
    return tmp_path / "example.toml"


@pytest.mark.soak
def test_without_feed_forward_the_aircraft_sinks_first(example):
    level = example.read_text().replace("gamma_deg = 3", "gamma_deg = 0")
    level = level.replace('"exact"', '"paper"').replace("tuned_fed_back", "tuned_identified")
    lowest = {}
    for setting in ("true", "false"):
        example.write_text(re.sub(r"feed_forward( *)= true", rf"feed_forward\1= {setting}", level))
        (_, run) = ft.fly(ft.load_scenario(example)).runs
        lowest[setting] = run.signals["h"].iloc[0] - run.signals["h"].min()

    assert lowest["false"] > 3.0 * lowest["true"]
