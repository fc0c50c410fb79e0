"""Tables on a terminal of any width, on a page, in a notebook and in Markdown."""

import json
import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

from flighttune.outputs.answers.answer import TABLE_LINES, Answer, Column, Table, facts_table
from flighttune.outputs.answers.finding import unmet

WIDTHS = 120, 80, 48
NUMBERS = ("ITAE χ", "ITAE γ", "MO χ", "MO γ", "settle χ", "settle γ")
VALUES = [
    ("kinematic", "paper", 5.57, 4.86, 8.35, 14.98, 6.12, 10.38),
    ("kinematic", "tuned", 4.55, 2.51, 7.16, 10.30, 5.74, "never"),
    ("jsbsim:aerosonde", "exact:tuned_identified", 6.97, 0.74, 3.65, 1.81, None, 3.04),
]
NAMES = ("plant", "gains", *NUMBERS)
RUNS = Table(
    title="Runs",
    columns=(
        Column("plant", "plant"),
        Column("gains", "gains"),
        *(Column(name, name, digits=".2f", missing="-") for name in NUMBERS),
    ),
    records=[dict(zip(NAMES, row, strict=True)) for row in VALUES],
    grouped=True,
)


def no_wider(text, width):
    return max(map(len, text.splitlines())) <= width


@pytest.mark.parametrize("width", WIDTHS)
def test_a_table_fits_and_no_number_is_cut(width):
    text = RUNS.text(width)

    assert no_wider(text, width)
    words = text.split()
    for row in RUNS.rows:
        assert all(words.count(cell) >= 1 for cell in row[2:] if cell != "-")


def test_where_room_is_short_each_plant_has_its_table():
    tables = RUNS.text(70).split("\n\n")

    assert [table.splitlines()[0] for table in tables] == ["Runs", "kinematic", "jsbsim:aerosonde"]
    assert tables[2].splitlines()[-1].split()[0] == "exact:tuned_identified"


@pytest.mark.parametrize("width", WIDTHS)
def test_words_are_wrapped_to_the_width(width):
    columns = Column("name", "name"), Column("words", "words")
    text = Table(columns=columns, records=[{"name": "x", "words": "word " * 60}]).text(width)

    assert no_wider(text, width)
    assert text.split().count("word") == 60


def test_numbers_stand_to_the_right_also_where_one_is_missing():
    values = {"a": 1.5, "b": math.nan, "c": math.inf, "d": -math.inf, "e": -0.25, "f": "never"}
    columns = Column("name", "name"), Column("value", "a heading", digits="g")
    records = [{"name": name, "value": value} for name, value in values.items()]
    lines = Table(columns=columns, records=records).text(80).splitlines()[2:]

    assert [line.split()[-1] for line in lines] == ["1.5", "–", "∞", "−∞", "-0.25", "never"]
    assert len({len(line) for line in lines}) == 1


@pytest.mark.parametrize(
    ("column", "shown"),
    [
        (Column("angle", unit="deg", digits=".1f", factor=180.0 / math.pi), "30.0"),
        (Column("metrics.chi.ITAE", digits=".2f"), "5.57"),
        (Column("metrics.chi.ITAE", digits=".1f", ends=("pair.0", "pair.1")), "5.6 [5.0, 6.0]"),
        (Column("met"), "no"),
        (Column("names"), "a, b"),
        (Column("absent", digits=".2f", missing="-"), "-"),
    ],
)
def test_a_column_finds_its_value_by_its_key_and_writes_it_in_its_unit(column, shown):
    record = {
        "angle": math.pi / 6.0,
        "metrics": {"chi": {"ITAE": 5.57}},
        "pair": [5.0, 6.0],
        "met": False,
        "names": ["a", "b"],
    }

    assert column.text(record) == shown


def test_a_column_without_any_value_is_left_out():
    columns = Column("name", "name"), Column("reason", "reason"), Column("n", "n", digits=".0f")
    text = Table(columns=columns, records=[{"name": "x", "reason": "", "n": 3}]).text(80)

    assert text.splitlines()[0].split() == ["name", "n"]


PLANT, GAINS = "jsbsim:aerosonde", "exact:tuned_identified"


@pytest.mark.parametrize("width", [48, 80, 100, 120])
def test_no_name_and_no_unit_is_broken(width):
    columns = (
        Column("plant", "plant"),
        Column("gains", "gains"),
        Column("leg", "to or at"),
        Column("why", "why"),
        *(Column(x, f"integral of {x}", "rad\u2009s²") for x in "abcd"),
    )
    row = {"plant": PLANT, "gains": GAINS, "leg": "waypoint 2", "why": "word " * 20}
    text = Table(columns=columns, records=[row | dict.fromkeys("abcd", 1.5)]).text(width)

    assert all(name in text for name in (PLANT, GAINS, "waypoint 2"))
    assert text.count("[rad\u2009s²]") == 4


def test_short_names_and_then_fewer_columns_make_a_table_one_line_wide():
    columns = (
        Column("plant", "plant"),
        Column("settling", "time until it is settled", "s", short="settling"),
        Column("ITAE", "ITAE", spare=True),
    )
    table = Table(columns=columns, records=[{"plant": PLANT, "settling": 1.5, "ITAE": 2.5}])

    heads = [table.text(width).splitlines()[0].split() for width in (60, 36, 30)]

    assert heads == [
        ["plant", "time", "until", "it", "is", "settled", "[s]", "ITAE"],
        ["plant", "settling", "[s]", "ITAE"],
        ["plant", "settling", "[s]"],
    ]


def test_an_answer_begins_with_its_sentence_and_has_few_lines_of_tables():
    def rows(n, **how):
        return Table([Column("n", "n")], [{"n": i} for i in range(n)], **how)

    tables = [rows(30, title="long"), rows(2, title="later, much"), rows(1, title="x", aside=True)]
    answer = Answer(tables=tables, verdict="It is so.", changed=["Not covered: y."], notes=["z"])

    lines = "\n".join(answer.text(80)).splitlines()

    assert lines[:4] == ["It is so.", "", "Not covered: y.", ""]
    assert lines.index("z.") - 1 - 4 == TABLE_LINES
    assert lines[-1] == "More with --json: 13 of 30 rows, later, x."
    assert lines.count("It is so.") == 1
    assert "29" in "\n".join(replace(answer, whole=True).text(80)).split()
    aside = replace(answer, notes=["z", "much more"], aside=["much more"])
    lines = "\n".join(aside.text(80)).splitlines()
    assert lines[-2:] == ["z.", "More with --json: 13 of 30 rows, later, x, notes."]
    assert json.loads(aside.json())["notes"] == ["Not covered: y.", "z", "much more"]


@pytest.mark.parametrize("grouped", [False, True])
def test_a_title_is_one_line_of_the_text(grouped):
    """A title of a file with a line break would print a line that looks like the command's."""
    table = Table(
        [Column("x"), Column("y")], [{"x": "a", "y": 1.0}], "s\nclaim: met", grouped=grouped
    )

    for width in (4, 80):
        assert table.text(width).splitlines()[0] == "s claim: met"


def test_a_table_in_a_notebook_is_escaped_and_names_its_rows():
    table = ET.fromstring(facts_table("<b>", {"a": "b & c"}).html())

    assert table.findtext("caption/b") == "<b>"
    assert (table.findtext("tbody/tr/th"), table.findtext("tbody/tr/td")) == ("a", "b & c")


def test_a_cell_does_not_break_a_table_in_markdown():
    columns = Column("a", "a"), Column("b", "|b|")
    text = Table(columns, [{"a": "x | y", "b": "two\nlines"}]).markdown()

    assert text.splitlines() == ["| a | \\|b\\| |", "| --- | --- |", "| x \\| y | two lines |"]


def test_an_answer_has_the_same_records_in_text_and_json(tmp_path):
    columns = Column("name", "name"), Column("value", "value", digits=".2f")
    records = [{"name": "x", "value": 1.234567}]
    answer = Answer(
        values={"status": "fine", "largest": math.inf},
        tables=[Table(name="rows", columns=columns, records=records)],
        notes=["a note"],
        files={"page": tmp_path, "figure": None},
    )

    text = "\n".join(answer.text(80))

    assert json.loads(answer.json()) == {
        "status": "fine",
        "largest": None,
        "rows": records,
        "notes": ["a note"],
        "verdict": "",
        "page": str(tmp_path),
        "figure": None,
    }
    assert "1.23" in text
    assert f"page: {tmp_path}" in text
    assert "figure" not in text


@pytest.mark.parametrize(
    ("column", "record", "text"),
    [
        (Column("x"), {"x": 2.0}, "2"),
        (Column("x"), {"x": 1234.56}, "1235"),
        (Column("x"), {}, "–"),
        (Column("x"), {"x": None}, "–"),
        (Column("x"), {"x": math.nan}, "–"),
        (Column("x", missing="-"), {"x": math.nan}, "-"),
        (Column("x", factor=100.0, digits=".1f"), {"x": 0.125}, "12.5"),
        (Column("x", digits=lambda value: f"<{value:g}>"), {"x": 3.0}, "<3>"),
        (Column("x"), {"x": True}, "yes"),
        (Column("x"), {"x": False}, "no"),
        (Column("x"), {"x": ["a", 1]}, "a, 1"),
        (Column("x"), {"x": []}, "–"),
        (Column("x"), {"x": [[1.0, 0.5]]}, "[1.0000, 0.5000]"),
        (Column("a.b.c"), {"a": {"b.c": 7}}, "7"),
        (Column("a.1"), {"a": [5.0, 6.0]}, "6"),
        (Column("a.b"), {"a": 5.0}, "–"),
        (Column("x", ends=("lo", "hi")), {"x": 5.0, "lo": 4.0, "hi": 6.0}, "5 [4, 6]"),
        (Column("x", ends=("a", "b"), factor=10.0), {"x": 5.0, "a": 4.0, "b": 6.0}, "50 [40, 60]"),
        (Column("x", ends=("lo", "hi")), {"x": 5.0, "lo": -math.inf, "hi": 6.0}, "5 [<= 6]"),
    ],
)  # fmt: skip
def test_a_cell_is_its_value_in_the_unit_and_digits_of_its_column(column, record, text):
    assert column.text(record) == text


def test_a_table_leaves_out_empty_columns_but_for_the_first():
    table = Table(
        (Column("a", "A"), Column("b", "B", "m"), Column("c", "C")),
        [{"a": None, "b": 1.0, "c": ""}, {"a": None, "b": 2.0}],
    )

    assert [column.key for column in table.filled.columns] == ["a", "b"]
    assert (table.head, table.left_aligned) == (["A", "B [m]", "C"], [True, False, True])
    assert (table.rows, table.labels) == ([["–", "1", ""], ["–", "2", "–"]], [])
    assert replace(table, label="b").labels == ["1.0", "2.0"]
    assert not table.ends_in_words
    for letters, wraps in ((40, False), (41, True)):
        assert Table((Column("a"),), [{"a": "x" * letters}]).ends_in_words == wraps
    assert facts_table("t", {"a": "b"}).rows == [["a", "b"]]


def test_an_answer_in_json_has_its_sentences_values_and_files(tmp_path):
    table = Table((Column("a"),), [{"a": math.inf}], name="rows")
    answer = Answer(
        lines=["Yes."], changed=["One change."], values={"x": math.nan, "y": 2.0},
        tables=[table, replace(table, name="")], notes=["A note."], command="flighttune x",
        files={"page": tmp_path / "p.html"}, findings=unmet("It failed."),
    )  # fmt: skip

    found = json.loads(answer.json())

    assert found == {
        "rows": [{"a": None}], "notes": ["One change.", "A note."], "verdict": "It failed.",
        "summary": ["Yes."], "command": "flighttune x", "x": None, "y": 2.0,
        "page": str(tmp_path / "p.html"),
    }  # fmt: skip
    assert json.loads(replace(answer, verdict="Verdict.").json())["verdict"] == "Verdict."
    assert answer.status == 1
