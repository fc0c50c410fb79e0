"""Tables on a terminal where nobody watches, in a notebook and in Markdown."""

import xml.etree.ElementTree as ET

from flighttune.present.tables import Table


def test_a_name_or_a_column_of_numbers_is_never_cut(capsys):
    name, numbers = "x" * 70, "12.34 (11.22 to 13.44), 55.66 (44.33 to 66.77), 88 (77 to 99)"
    head = ("name", "numbers of some kind", "words")

    Table(title="wide", head=head, rows=[(name, numbers, "a few words")]).print()

    shown = capsys.readouterr().out
    assert name in shown
    assert numbers in shown
    assert "numbers of some kind" in shown
    assert "…" not in shown


def test_words_are_wrapped_to_the_width(capsys):
    Table(title="long", head=("name", "words"), rows=[("x", "word " * 60)]).print()

    assert max(map(len, capsys.readouterr().out.splitlines())) <= 132


def test_numbers_stand_to_the_right_also_where_one_is_missing(capsys):
    rows = [("a", "1.5"), ("b", "–"), ("c", "∞"), ("d", "−∞"), ("e", "-0.25"), ("f", "never")]
    Table(title="numbers", head=("name", "a wide heading"), rows=rows).print()

    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("│")]
    assert [line[:-2].rstrip()[-5:].split()[-1] for line in lines] == [cell for _, cell in rows]
    assert all(line[-3] != " " for line in lines)


def test_a_table_in_a_notebook_is_escaped_and_names_its_rows():
    text = Table(title="<b>", head=(), rows=[("a", "b & c")]).html()

    table = ET.fromstring(text)
    assert table.findtext("caption/b") == "<b>"
    assert (table.findtext("tbody/tr/th"), table.findtext("tbody/tr/td")) == ("a", "b & c")


def test_a_cell_does_not_break_a_table_in_markdown():
    text = Table(title="", head=("a", "b"), rows=[("x | y", "two\nlines")]).markdown()

    assert text.splitlines() == ["| a | b |", "| --- | ---: |", "| x \\| y | two lines |"]
