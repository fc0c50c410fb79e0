"""Tables on a terminal of any width, in a notebook and in Markdown."""

import xml.etree.ElementTree as ET

import pytest

from flighttune.present.tables import Bad, Table

WIDTHS = 120, 80, 48
RUNS = Table(
    title="Runs",
    head=("plant", "gains", "ITAE χ", "ITAE γ", "MO χ", "MO γ", "settle χ", "settle γ"),
    rows=[
        ("kinematic", "paper", "5.57", "4.86", "8.35", "14.98", "6.12", "10.38"),
        ("kinematic", "tuned", "4.55", "2.51", "7.16", "10.30", "5.74", Bad("never")),
        ("jsbsim:aerosonde", "exact:tuned_identified", "6.97", "0.74", "3.65", "1.81", "-", "3.04"),
    ],
    grouped=True,
    lowest=("ITAE χ", "settle γ"),
)


def no_wider(text, width):
    return max(map(len, text.splitlines())) <= width


@pytest.mark.parametrize("width", WIDTHS)
def test_a_table_fits_and_no_number_is_cut(width):
    text = RUNS.text(width)

    assert no_wider(text, width)
    words = text.split()
    for row in RUNS.rows:
        assert all(words.count(cell) >= 1 for cell in row[2:])


def test_where_there_is_room_for_one_line_there_is_one_table():
    lines = RUNS.text(120).splitlines()

    assert len(lines) == 1 + 2 + len(RUNS.rows)
    assert lines[3].split() == list(RUNS.rows[0])


def test_in_80_columns_each_plant_has_its_table():
    tables = RUNS.text(80).split("\n\n")

    assert [table.splitlines()[0] for table in tables] == ["Runs", "kinematic", "jsbsim:aerosonde"]
    assert tables[2].splitlines()[-1].split() == list(RUNS.rows[2][1:])


def test_the_best_of_a_column_is_bold_and_a_failure_red_on_a_terminal_alone():
    assert "\x1b" not in RUNS.text(80)
    styled = RUNS.text(80, styled=True)

    assert "\x1b[1m4.55\x1b[0m" in styled
    assert "\x1b[31mnever\x1b[0m" in styled
    # a single number is not the best of any: "settle γ" of both plants, and the aircraft's ITAE
    assert styled.count("\x1b[1m") == 1


@pytest.mark.parametrize("width", WIDTHS)
def test_words_are_wrapped_to_the_width(width):
    text = Table(title="long", head=("name", "words"), rows=[("x", "word " * 60)]).text(width)

    assert no_wider(text, width)
    assert text.split().count("word") == 60


@pytest.mark.parametrize("width", WIDTHS)
def test_a_name_that_is_too_long_is_continued(width):
    name = "x" * 130
    text = Table(title="long", head=("name", "number"), rows=[(name, "1.5")]).text(width)

    assert no_wider(text, width)
    assert text.count("x") == 130
    assert "1.5" in text


def test_numbers_stand_to_the_right_also_where_one_is_missing():
    rows = [("a", "1.5"), ("b", "–"), ("c", "∞"), ("d", "−∞"), ("e", "-0.25"), ("f", "never")]
    lines = Table(title="numbers", head=("name", "a heading"), rows=rows).text(80).splitlines()[3:]

    assert [line.split()[-1] for line in lines] == [cell for _, cell in rows]
    assert len({len(line) for line in lines}) == 1


def test_a_table_in_a_notebook_is_escaped_and_names_its_rows():
    text = Table(title="<b>", head=(), rows=[("a", "b & c")]).html()

    table = ET.fromstring(text)
    assert table.findtext("caption/b") == "<b>"
    assert (table.findtext("tbody/tr/th"), table.findtext("tbody/tr/td")) == ("a", "b & c")


def test_a_cell_does_not_break_a_table_in_markdown():
    text = Table(title="", head=("a", "b"), rows=[("x | y", "two\nlines")]).markdown()

    assert text.splitlines() == ["| a | b |", "| --- | ---: |", "| x \\| y | two lines |"]
