"""Tables against tables: each result, measure, role, fault and format has its partner in others."""

import re
import tomllib
from importlib import import_module
from pathlib import Path
from typing import get_args

import pytest
from places import ROOT

import flighttune as ft
from flighttune.base.answering import FIGURES, SPEAKERS
from flighttune.campaigns.planning.schema import MEASURES
from flighttune.claims.rates_keys import KINDS, HowEnded
from flighttune.control.laws.autopilot import guidance
from flighttune.outputs.answers.early import OTHER_WAYS
from flighttune.outputs.answers.per_hour import ENDINGS, FAULTS
from flighttune.outputs.answers.retuned import SETS
from flighttune.outputs.pages.claim import CHARTS, PAGES

PACKAGE = Path(ft.__file__).parent
LABELS = tomllib.loads((PACKAGE / "outputs/answers/labels.toml").read_text(encoding="utf-8"))
CODE = {path: path.read_text(encoding="utf-8") for path in sorted(PACKAGE.rglob("*.py"))}
DOCS = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md")}


def classes_of(*bases):
    """Names of the classes of the package that are one of these, or derive from one."""
    parents = {
        name: {*re.findall(r"\b[A-Z]\w+", bases)}
        for text in CODE.values()
        for name, bases in re.findall(r"^class (\w+)(?:\(([^)]*)\))?:", text, re.MULTILINE)
    }
    found = {*bases}
    while more := {name for name, of in parents.items() if of & found} - found:
        found |= more
    return {name: parents[name] for name in found - {*bases}}


def test_each_kind_of_result_has_its_answer_and_each_answer_its_result():
    answering = classes_of("Answering", "Drawn")
    rows = {*SPEAKERS}

    missing = {
        name for name, parents in answering.items()
        if name not in rows and not parents & rows and not name.startswith("_")
        and not any(name in of for of in answering.values())  # a base of others
    }  # fmt: skip
    assert {x for x in missing if not (answering[x] & {*answering})} == set()
    assert rows <= {*answering} | {"Run"}  # which shows facts of itself
    assert {*FIGURES} <= {*classes_of("Drawn")} | {"Frontier"} | rows


@pytest.mark.parametrize("table", [SPEAKERS, FIGURES, PAGES, CHARTS], ids=lambda x: str(len(x)))
def test_each_row_of_a_table_of_functions_leads_to_one(table):
    for name, place in table.items():
        module, _, function = place.partition(":")
        assert callable(vars(import_module(module))[function]), name


def test_each_kind_of_claim_that_a_file_holds_has_its_answer_and_its_page():
    claims = {"Band", "Certificate", "LogMonitor", "PerHour", "RateBound", "Tube", "TurnBack"}

    assert claims <= {*PAGES}
    assert {*PAGES} - {"TurnBack", "SignalBounds"} <= {*SPEAKERS}
    assert {name for name in PAGES if f"class {name}(" in "\n".join(CODE.values())} == {*PAGES}


def test_each_searched_role_of_each_autopilot_has_the_word_of_what_it_sets():
    roles = {
        role
        for table in guidance().values()
        for name, _, role, *_ in table["parameters"]
        if name in table["searched"]
    }

    assert roles == {*SETS}


def test_each_kind_of_fault_and_ending_is_said_in_a_sentence_and_in_the_docs():
    assert {*KINDS} == {*FAULTS}
    assert {*ENDINGS} == {*get_args(HowEnded)}
    for name in (*KINDS, *ENDINGS):
        assert f"`{name}`" in DOCS["per_hour"] or f'"{name}"' in DOCS["per_hour"], name


def test_each_way_out_is_of_a_status_that_a_flight_can_have():
    statuses = set(re.findall(r'"([a-z_]+)"', "".join(CODE.values())))

    assert {*OTHER_WAYS} <= statuses
    assert set(re.findall(r"`flighttune (\w+)`", " ".join(OTHER_WAYS.values()))) <= {
        name for panel in tomllib.loads((PACKAGE / "cli/commands.toml").read_text("utf-8")).values()
        for name in panel
    }  # fmt: skip


def test_each_measure_has_its_label_and_its_place_in_the_docs(results):
    labelled = {*LABELS["metrics"], *LABELS["quantities"]}
    named = {name.rpartition(".")[2] for name in re.findall(r"`([\w.]+)`", DOCS["campaigns"])}
    for run in results.of("flown").runs:
        channels = ft.loop.channel_metrics(run)
        assert {*channels.columns, *ft.loop.flight_metrics(run)} <= labelled
    for name in MEASURES:
        last = name.rpartition(".")[2]
        si = last.replace("_deg", "_rad").replace("_dps", "_rad_s")
        assert si in labelled, name
        assert last in named, name
    for key, (name, unit, *_) in ((k, [*v, ""]) for k, v in LABELS["metrics"].items()):
        assert name
        wanted = {"rad": ("deg", "deg/s"), "s": ("s", "deg/s"), "m": ("m",), "mps": ("m/s",)}
        assert unit in wanted.get(key.rpartition("_")[2], (unit,)), key


def test_each_label_of_a_single_table_is_one_of_its_columns():
    used = {name: set() for name in LABELS["tables"]}
    for keys, name in re.findall(
        r'columns\w*\(\s*((?:"[^"]*"\s*)+),\s*of="(\w+)"', "".join(CODE.values())
    ):
        used[name] |= set(keys.replace('"', " ").split())

    for name, headings in LABELS["tables"].items():
        assert headings.keys() <= used[name], name


@pytest.mark.parametrize("form", ["jsbsim", "c"])
def test_each_form_of_an_export_has_its_docs_and_refuses_a_law_in_python(form, tmp_path):
    law = {"name": "mine", "kind": "python", "module": __file__, "class": "Path"}
    tables = ft.load_scenario("paper").as_dict() | {"law": [law], "expect": []}

    assert form in DOCS["export"].lower()
    with pytest.raises(ft.InputError, match="mine"):
        ft.export(ft.scenario_from(tables), "mine:paper", out=tmp_path / "x", form=form)
    assert not (tmp_path / "x").exists()


def test_each_text_of_the_pages_is_used_and_each_that_is_used_is_there():
    texts = tomllib.loads((PACKAGE / "outputs/pages/texts.toml").read_text(encoding="utf-8"))
    sources = "".join(CODE.values()) + "".join(
        path.read_text(encoding="utf-8") for path in (PACKAGE / "outputs").rglob("*.jinja")
    )

    plain = {key for key, value in texts.items() if isinstance(value, str)}
    pages = "".join(text for path, text in CODE.items() if "outputs/pages" in path.as_posix())
    asked = set(re.findall(r'TEXTS\["(\w+)"\]', pages))
    assert asked <= {*texts}
    for key in plain:
        assert re.search(rf'["\'.]{key}\b', sources), key
