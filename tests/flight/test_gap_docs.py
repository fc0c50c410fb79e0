"""The numbers of docs/gap.md are those of a flight, and its sentences are true of them."""

import re
from pathlib import Path

import pytest
from figures import gap as maker

DOCS = Path(__file__).parents[2] / "docs"
LATER_AIRCRAFT = 0.05
"""Part of the largest number of a column by which the page may lag behind the aircraft."""
NUMBER = re.compile(r"[-+]?\d+\.\d+")


@pytest.fixture(scope="module")
def section():
    text = (DOCS / "gap.md").read_text(encoding="utf-8")
    return text.split(maker.BEGIN)[1].split(maker.END)[0]


def cells(table):
    lines = [line for line in table.splitlines() if line.startswith("|")][2:]
    return [[float(x) if NUMBER.match(x := cell.strip()) else 0.0 for cell in line.split("|")[2:-1]]
            for line in lines]  # fmt: skip


def test_the_table_is_that_of_a_new_flight(section, paper_gap):
    shown, new = cells(section), cells(maker.table(paper_gap))

    assert len(shown) == len(new) == 5
    for column, expected in zip(zip(*shown, strict=True), zip(*new, strict=True), strict=True):
        room = LATER_AIRCRAFT * max(map(abs, expected))
        assert column == pytest.approx(expected, abs=room), "run docs/figures/gap.py"


def test_the_sentences_have_the_numbers_of_a_new_flight(section, paper_gap):
    new = maker.reading(paper_gap)

    shown = [float(x) for x in NUMBER.findall(section.rpartition("|")[2])]
    assert shown == pytest.approx([float(x) for x in NUMBER.findall(new)], rel=0.1, abs=0.2)


def test_the_last_step_moves_course_and_path_angle_least(paper_gap):
    _, lift, lag, rest, _ = (values for _, values in maker.rows(paper_gap))

    for i in (0, 1):
        assert rest[i] < min(lift[i], lag[i])
    assert lag[7] > 2.0 * abs(lift[7])


def test_making_the_page_again_changes_nothing_else(paper_gap):
    text = (DOCS / "gap.md").read_text(encoding="utf-8")

    again = maker.written(text, paper_gap)

    assert again.split(maker.BEGIN)[0] == text.split(maker.BEGIN)[0]
    assert again.split(maker.END)[1] == text.split(maker.END)[1]
    assert maker.written(again, paper_gap) == again
