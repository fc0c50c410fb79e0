"""An answer as text of any width, as JSON and for a notebook: its tables, sentences and status."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flighttune as ft

NAN = float("nan")


@pytest.fixture(scope="module")
def kinds():
    """The kinds of an answer, its tables, their columns and its findings."""
    said = ft.loop.indicators([[-1.0, 0.0], [0.0, -2.0]]).answer()
    wild = ft.PIGains(K_P=-np.eye(2), K_I=-np.eye(2))
    (finding,) = ft.certify("paper", wild).answer().findings
    return type(said), type(said.tables[0]), type(said.tables[0].columns[0]), type(finding)


@pytest.fixture(scope="module")
def table(kinds):
    def made(columns, rows, title="", **more):
        """A table of columns as ``key|more`` and rows of their values."""
        made = [x if isinstance(x, kinds[2]) else kinds[2](x, x) for x in columns]
        keys = [x.key for x in made]
        return kinds[1](made, [dict(zip(keys, row, strict=True)) for row in rows], title, **more)

    return made


CELLS = [
    # settings of a column, value, text
    ({}, None, "–"),
    ({"missing": "none"}, None, "none"),
    ({}, NAN, "–"),
    ({}, True, "yes"),
    ({}, False, "no"),
    ({}, "a word", "a word"),
    ({}, ["a", 1], "a, 1"),
    ({}, ("a",), "a"),
    ({}, [], "–"),
    ({}, [[1.0, -0.00001], [0.5, 2.0]], "[1.0000, 0.0000; 0.5000, 2.0000]"),
    ({}, 1.23456, "1.235"),
    ({}, -1e-9 * 0.0, "0"),
    ({"factor": 100.0, "digits": ".1f"}, 0.1234, "12.3"),
    ({"factor": 2.0, "digits": lambda x: f"<{x}>"}, 3.0, "<6.0>"),
    ({"ends": ("low", "high"), "digits": ".2f", "factor": 10.0}, 1.0, "10.00 [5.00, 20.00]"),
    ({"ends": ("low", "none"), "digits": ".2f"}, 1.0, "1.00 [0.50, –]"),
]


@pytest.mark.parametrize(("settings", "value", "text"), CELLS, ids=lambda x: str(x)[:20])
def test_a_cell_is_written_as_its_column_says(kinds, settings, value, text):
    column = kinds[2]("x.y", **settings)

    assert column.text({"x": {"y": value}, "low": 0.5, "high": 2.0}) == text


def test_a_key_leads_into_values_and_may_have_dots_itself(kinds):
    record = {"a": {"b.c": {"d": 1.0}}, "l": [2.0, {"e": 3.0}], "x.y": 4.0, "n": None}
    wanted = {
        "a.b.c.d": "1",
        "l.0": "2",
        "l.1.e": "3",
        "x.y": "4",
        "l.2": "–",
        "n.m": "–",
        "z": "–",
    }

    assert {key: kinds[2](key).text(record) for key in wanted} == wanted


WORDS = "three short words"
LONG = "a sentence that is much longer than the others of its column"


def test_words_are_wrapped_and_numbers_are_not_until_all_have_room(kinds, table):
    of = [kinds[2]("name", "name"), kinds[2]("x", "time of it", "s"), kinds[2]("why", "why")]
    made = table(of, [["one", 1.25, LONG], ["two", 12345.0, WORDS]], "a\ntitle")

    assert made.text(100).splitlines() == [
        "a title",
        "name  time of it [s]  why",
        "────  ──────────────  " + "─" * 60,
        f"one             1.25  {LONG}",
        f"two        1.234e+04  {WORDS}",
    ]
    assert made.text(82) == made.text(100)
    assert made.text(81).splitlines()[1:5] == [
        "name  time of it [s]  why",
        "────  ──────────────  " + "─" * 59,
        f"one             1.25  {LONG[:-7]}",
        "                      column",
    ]
    narrow = made.text(43).splitlines()
    assert narrow[1] == "name  time of it [s]  why"
    assert narrow[2] == "────  ──────────────  " + "─" * 21
    assert " ".join(line[22:] for line in narrow[3:-1]) == LONG
    assert narrow[-1] == f"two        1.234e+04  {WORDS}"
    # where a name would not stay whole the table is cut, and each part begins with the first column
    assert made.text(24).splitlines() == [
        "a title",
        "name  time of it [s]",
        "────  ──────────────",
        "one             1.25",
        "two        1.234e+04",
        "name  why",
        "────  ──────────────────",
        "one   a sentence that is",
        *(f"      {part}" for part in ("much longer than", "the others of its", "column")),
        "two   three short words"[:23],
    ]


def test_a_table_that_is_too_wide_is_cut_and_each_part_begins_with_the_first_column(kinds, table):
    names = [f"column{i}" for i in range(5)]
    made = table(["name", *names], [["one", *(float(i) for i in range(5))]])

    # each needs 7 letters and two spaces
    assert made.text(4 + 5 * 9).splitlines() == [
        "name  " + "  ".join(names),
        "────  " + "  ".join(["─" * 7] * 5),
        "one   " + "  ".join(f"{i:>7}" for i in range(5)),
    ]
    for width, first in ((4 + 5 * 9 - 1, 4), (4 + 4 * 9, 4), (4 + 3 * 9, 3), (4 + 9, 1), (5, 1)):
        heads = [line for line in made.text(width).splitlines() if line.startswith("name")]
        assert len(heads) == -(-5 // first)
        assert heads[0] == "  ".join(["name", *names[:first]])
    alone = table(["name"], [["a" * 40], ["b c"]]).text(20).splitlines()
    assert max(map(len, alone)) == 32  # a name is broken above twice sixteen letters
    assert "".join(alone[2:4]) == "a" * 40
    assert alone[4] == "b c"


def test_short_names_come_before_columns_are_left_out(kinds, table):
    Column = kinds[2]
    of = [
        Column("a", "name"),
        Column("b", "a long heading", short="b"),
        Column("c", "c", spare=True),
    ]
    made = table(of, [["x", 1.0, 2.0], ["y", 1.0, 3.0]])

    assert made.text(23).splitlines()[0] == "name  a long heading  c"
    assert made.text(22).splitlines()[0] == "name  b  c"
    assert made.text(10).splitlines()[0] == "name  b  c"
    assert made.text(9).splitlines()[0] == "name  b"


def test_empty_columns_are_left_out_but_not_the_first(table):
    made = table(["a", "b", "c", "d"], [[None, "", 0.0, None], ["", None, None, False]])

    assert [column.key for column in made.filled.columns] == ["a", "c", "d"]
    assert made.text(50).splitlines() == ["a  c  d", "─  ─  ──", "–  0  –", "   –  no"]


def test_a_grouped_table_has_a_table_of_each_group_where_room_is_short(table):
    rows = [["one", "p", 1.0], ["one", "q", 2.0], ["two", "p", 3.0]]
    made = table(["group", "name", "value"], rows, "title", grouped=True)

    assert made.text(18).splitlines()[:2] == ["title", "group  name  value"]
    assert made.text(17) == "\n".join([
        "title", "",
        "one", "name  value", "────  ─────", "p         1", "q         2", "",
        "two", "name  value", "────  ─────", "p         3",
    ])  # fmt: skip
    assert "group" in replace(made, grouped=False).text(17)


def test_tables_without_names_are_facts_in_html_and_markdown(kinds, table):
    facts = kinds[1]([kinds[2]("what"), kinds[2]("n")], [{"what": "a|b\nc", "n": "<1>"}], "t & u")
    left = " style='text-align:left'"

    assert facts.text(40) == "t & u\na|b c  <1>"
    assert facts.html() == (
        f"<table><caption{left}><b>t &amp; u</b></caption><tbody>"
        f"<tr><th{left}>a|b\nc</th><td{left}>&lt;1&gt;</td></tr></tbody></table>"
    )
    headed = table(["a", "b"], [["x", 1.0]])
    assert headed.html() == (
        f"<table><caption{left}><b></b></caption><thead><tr><th{left}>a</th><th{left}>b</th></tr>"
        f"</thead><tbody><tr><td{left}>x</td><td{left}>1</td></tr></tbody></table>"
    )
    assert replace(headed, records=[{"a": "x|y\nz", "b": 1}]).markdown() == (
        "| a | b |\n| --- | ---: |\n| x\\|y z | 1 |"
    )
    assert table(["a", "b"], [["x", "w" * 41]]).ends_in_words
    assert not table(["a", "b"], [["x" * 41, "w" * 40]]).ends_in_words
    assert table(["a"], [["x"]], label="a").labels == ["x"]
    assert table(["a"], [["x"]]).labels == []
    assert table(["a", "b", "c"], [[1, True, "x"]]).left_aligned == [False, True, True]


def rows(n):
    return [[f"r{i}", float(i)] for i in range(n)]


SHOWN = [
    # numbers of rows, more of each table, whether all is shown, lines of each, what is left out
    ([3], {}, False, [5], ""),
    ([18], {}, False, [20], ""),
    ([19], {}, False, [20], "1 of 19 rows"),
    ([40], {}, False, [20], "22 of 40 rows"),
    ([40], {}, True, [42], ""),
    ([5, 7], {}, False, [7, 9], ""),
    ([5, 8], {}, False, [7], "b"),
    ([5, 30, 1], {}, False, [7, 3], "b"),
    ([5, 30], {}, True, [7, 32], ""),
    ([5, 3], {"aside": True}, False, [], "a and b"),
    ([0, 3], {}, False, [5], ""),
]


@pytest.mark.parametrize(("sizes", "more", "whole", "lines", "left"), SHOWN, ids=str)
def test_a_terminal_shows_twenty_lines_of_tables_and_names_the_others(
    kinds, table, sizes, more, whole, lines, left
):
    titles = "a, of things", "b", "c"
    of = [replace(table(["n", "x"], rows(n), **more), name="") for n in sizes]
    if len(sizes) > 1:
        of = [replace(x, title=title) for x, title in zip(of, titles, strict=False)]
    text = "\n".join(kinds[0](tables=of, whole=whole).text(80))

    shown = [part for part in text.split("\n\n") if not part.startswith("More")]
    titled = len(sizes) > 1
    assert [part.count("\n") + 1 - titled for part in shown] == lines
    told = re.findall(r"More with --json: (.*)\.", text)
    assert told == ([left.replace(" and ", ", ")] if left else [])


def test_an_answer_begins_with_what_is_found_and_ends_with_commands_and_files(kinds, table):
    files = {"recording": Path("a b/f.rrd"), "page": None, "my_proof": "p.npz", "proof": "q.npz"}
    said = kinds[0](
        lines=["the first line", "", "the second"], changed=["x is left out"],
        tables=[table(["n", "x"], rows(1))], notes=["a note", "another note"],
        aside=["another note"], verdict="it holds", command="flighttune x y", files=files,
    )  # fmt: skip

    assert "\n".join(said.text(60)).splitlines() == [
        "The first line.", "The second.", "", "X is left out.".replace("X", "x"), "",
        "n   x", "──  ─", "r0  0", "", "A note.", "It holds.", "More with --json: notes.",
        "flighttune x y", "recording: a b/f.rrd   (flighttune view 'a b/f.rrd')",
        "my proof: p.npz", "proof: q.npz   (flighttune verify q.npz)",
        "A page to send: flighttune report 'a b'",
    ]  # fmt: skip
    paged = "\n".join(replace(said, files=files | {"page": "p.html"}).text(60))
    assert "A page to send" not in paged
    no = kinds[3](found="not met", reason="so")
    assert "A page to send" not in "\n".join(replace(said, findings=[no]).text(60))
    only = kinds[0](verdict="it holds for every one of a hundred thousand of these")
    assert [*only.text(30)] == ["It holds for every one of a\nhundred thousand of these.", ""]
    twice = kinds[0](lines=["it holds, as said"], verdict="it holds", notes=["n"])
    assert "\n".join(twice.text(60)).count("olds") == 1


FOUND = [
    # what parts find, exit status, and sentences; the first says it for all
    (["met"], 0, ["Yes: s0"]),
    (["met", "reserve"], 0, ["Yes, but s1", "S0"]),
    (["met", "open", "reserve"], 2, ["Not known: s1", "S2", "S0"]),
    (["open", "not met", "not met"], 1, ["No: s1", "S2", "S0"]),
    ([], 0, []),
]


@pytest.mark.parametrize(("found", "status", "sentences"), FOUND, ids=str)
def test_the_worst_finding_decides(kinds, found, status, sentences):
    parts = [kinds[3](found=x, sentence=f"s{i}") for i, x in enumerate(found)]
    said = kinds[0](findings=parts, lines=["a line"])

    assert said.status == status
    assert said.summary == [*sentences, "a line"]
    worst = sentences[0].rpartition(" ")[2] if status else ""
    assert said.failure == worst
    assert said.found == (
        max(found, key=["met", "reserve", "open", "not met"].index) if found else None
    )
    values = json.loads(said.json())
    assert [x["sentence"] for x in values.get("findings", [])] == [x.sentence for x in parts]
    assert values["verdict"] == worst


def test_a_finding_may_have_a_reason_a_beginning_and_a_status_of_its_own(kinds):
    no = kinds[3](found="not met", sentence="s", reason="why", state=130)
    assert (kinds[0](findings=[no]).status, kinds[0](findings=[no]).failure) == (130, "why")
    later = kinds[3](found="open", sentence="s", begins="Not yet: ", state=1)
    assert kinds[0](findings=[later]).summary == ["Not yet: s"]
    silent = kinds[3](found="not met", reason="why")
    assert kinds[0](findings=[silent, kinds[3](found="met", sentence="s")]).summary == ["S"]
    assert kinds[0](findings=[silent]).summary == []


def test_json_has_values_named_tables_and_no_number_that_it_lacks(kinds, table):
    said = kinds[0](
        values={"x": np.array([1.0, NAN]), "y": np.float64("inf"), "z": 2},
        tables=[table(["n"], [["a"]], name="t"), table(["n"], [["b"]])],
        notes=["n"], changed=["c"], command="flighttune x", files={"out": Path("f")},
    )  # fmt: skip

    assert json.loads(said.json()) == {
        "t": [{"n": "a"}], "notes": ["c", "n"], "verdict": "", "command": "flighttune x",
        "x": [1.0, None], "y": None, "z": 2, "out": "f",
    }  # fmt: skip
    html = replace(said, lines=["a & b"]).html()
    assert html.startswith("<p>a &amp; b</p><p>c</p><table>")
    assert html.endswith("</table><p>n</p>")
    assert html.count("<table>") == 2
