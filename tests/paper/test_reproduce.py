"""What `reproduce` leaves in a folder."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from printed import LAST_DIGIT_I, LAST_DIGIT_R, TABLE_2

from flighttune.errors import InputError
from flighttune.paper.errata import errata_text
from flighttune.paper.items import ITEMS
from flighttune.paper.reproduce import reproduce

NINE_DIGITS = 1e-8
ROUNDING = 2e-3
"""Of a number in the text of the errata, relative: they are given to three digits or more."""

ORDER = [
    "fig3",
    "gains",
    "fig6",
    "fig5",
    "fig12",
    "table2",
    "fig8",
    "fig7",
    "fig13",
    "fig9",
    "fig11",
    "fig10",
]
ERRATA = Path(__file__).parents[2] / "docs" / "errata.md"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
PNG = b"\x89PNG\r\n\x1a\n"


def values(reproduction, name):
    return reproduction[0].as_dict()["items"][ORDER.index(name)]["values"]


def test_every_item_of_the_paper_is_listed_once():
    assert list(ITEMS) == ORDER


@pytest.mark.parametrize("name", ORDER)
def test_an_item_has_figures_a_table_and_a_text(reproduction, name):
    made, folder = reproduction
    item = next(one for one in made.items if one.item.name == name)

    assert {folder / f"{name}.{end}" for end in ("png", "svg", "csv", "md")} <= set(item.files)
    for path in item.files:
        assert path.stat().st_size > 0
        if path.suffix == ".png":
            assert path.read_bytes().startswith(PNG)
        if path.suffix == ".csv":
            assert len(pd.read_csv(path)) > 3 or name == "gains"
    text = (folder / f"{name}.md").read_text()
    assert "## Parameters" in text
    assert "## Assumed" in text


@pytest.mark.parametrize(
    "name", ["fig5_peak_time", "gains_constraints", "gains_indicators", "fig12_rate_limits"]
)
def test_what_is_not_reproduced_has_a_figure_of_its_own(reproduction, name):
    assert (reproduction[1] / f"{name}.png").is_file()


@pytest.mark.parametrize("name", TABLE_2)
def test_table_2_comes_out_as_printed(reproduction, name):
    row = values(reproduction, "table2")[name]

    _, R_K, I_K = TABLE_2[name]
    assert row["R_K"] == pytest.approx(R_K, abs=LAST_DIGIT_R)
    assert row["I_K"] == pytest.approx(I_K, abs=LAST_DIGIT_I)


@pytest.mark.parametrize(
    ("item", "names"),
    [
        ("fig8", ["K1", "K2", "K3", "K4", "K5", "K6", "K*"]),
        ("fig11", [f"d{k}" for k in range(1, 10)]),
    ],
)
def test_families_have_the_papers_measures_by_name_and_channel(reproduction, item, names):
    found = values(reproduction, item)

    assert set(found) == set(names)
    for name in names:
        for channel in ("chi", "gamma"):
            assert {"MO_rad", "PT_s", "ITAE", "MS_rad", "ST_rad"} <= found[name][channel].keys()


def test_the_table_of_a_figure_holds_what_was_flown(reproduction, study):
    table = pd.read_csv(reproduction[1] / "fig8.csv")

    assert table["t_s"].iloc[-1] == pytest.approx(20.0)
    for name in ("K1", "K*", "K6"):
        e_gamma = study.flights[name].channels["gamma"]
        assert np.max(np.abs(table[f"{name}_e_gamma_rad"] - e_gamma)) < NINE_DIGITS


def test_the_answer_is_one_plain_object(reproduction):
    answer = json.loads(json.dumps(reproduction[0].as_dict()))

    assert [item["name"] for item in answer["items"]] == ORDER
    assert all(item.keys() == {"name", "files", "values"} for item in answer["items"])
    keys = {"id", "text", "where", "verdict", "expected", "computed"}
    assert all(claim.keys() == keys for claim in answer["claims"])


def test_the_recording_holds_both_families(reproduction):
    from rerun.chunk import RrdReader

    path = reproduction[0].recording
    store = RrdReader(path).store()
    paths = {str(entry) for entry in store.schema().entity_paths()}

    for name in ["K1", "K6"]:
        assert any(path.endswith(f"/kinematic_{name}") for path in paths), sorted(paths)[:40]
    assert sum("/plots/chi_err/" in path for path in paths) == 15


def test_the_committed_errata_are_those_computed_now(study):
    now, committed = errata_text(study), ERRATA.read_text(encoding="utf-8")

    assert NUMBER.sub("#", now) == NUMBER.sub("#", committed)
    new, old = (np.array(NUMBER.findall(text), dtype=float) for text in (now, committed))
    assert new == pytest.approx(old, rel=ROUNDING, abs=1e-9)


def test_some_items_are_made_alone_and_without_recording(study, tmp_path):
    made = reproduce(["fig6"], tmp_path, study=study)

    assert [one.item.name for one in made.items] == ["fig6"]
    assert made.recording is None
    assert not list(tmp_path.glob("fig5*"))
    assert not list(tmp_path.glob(".*"))


def test_an_unknown_item_names_the_known_ones(tmp_path):
    with pytest.raises(InputError, match=r"must be one of fig3, gains, .* got fig99"):
        reproduce(["fig99"], tmp_path)


def test_progress_is_told_from_nothing_to_all(study, tmp_path):
    told = []

    reproduce(["fig6"], tmp_path, study=study, progress=lambda *step: told.append(step))

    assert told[0] == ("items", 0.0)
    assert ("claims", 1.0) in told
