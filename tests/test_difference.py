"""A compiled step that is wrong by a rounding ends every command that flies compiled."""

from functools import cache

import pytest
from broken_step import BROKEN, DECIDING_ALONE, ROWS, broken_copy, run_in
from commands import COMMANDS

pytest.importorskip("numba")

# Commands that fly nothing, or let JSBSim itself fly.
NEVER_COMPILED = {
    *("list", "new", "view", "trim"),
    *("tune", "certify", "design"),  # gains from matrices
    *("reproduce", "export"),  # the paper's law, and flights that another JSBSim repeats
    *("gap", "report", "verify", "adopt", "identify"),
}

# Rows whose flights are right for their numbers: JSBSim must repeat those that decide.
DECIDE = {"fly", "meet", "worst", "band", "monitor", "compare", "hours"}


@pytest.fixture(scope="module")
def left_by(tmp_path_factory):
    """What rows of the table leave, by the names of them and the changes of the package."""

    @cache
    def run(names, *, alone=False):
        folder = tmp_path_factory.mktemp("broken")
        copy = broken_copy(folder / "copy", BROKEN | (DECIDING_ALONE if alone else {}))
        mine = folder / "place" / "out" / "mine.txt"
        mine.parent.mkdir(parents=True)
        mine.write_text("mine")
        rows = run_in(copy, folder / "place", names)
        assert mine.read_text() == "mine"
        return rows

    return run


def ended(row):
    """Whether a row ended by the difference, with its reason in a line, and without a file."""
    *_, reason = row["said"].strip().splitlines()
    assert row["status"] == 2, row
    assert "compiled flight must be that of JSBSim" in reason, row
    assert "differ" in reason, row
    assert row["left"] == [], row


@pytest.mark.soak
def test_a_difference_ends_a_campaign_of_workers_and_a_page(left_by):
    for row in left_by(("campaign", "open")).values():
        ended(row)


@pytest.mark.soak
@pytest.mark.parametrize("name", sorted({*ROWS} - {"campaign", "open"}))
def test_a_difference_ends_every_command(left_by, name):
    alone = name in DECIDE
    names = tuple(sorted(x for x in ROWS if (x in DECIDE) is alone))
    ended(left_by(names, alone=alone)[name])


@pytest.mark.soak
def test_flights_of_an_earlier_command_are_not_taken_up_again_after_a_difference(tmp_path):
    silent = broken_copy(tmp_path / "silent", BROKEN | DECIDING_ALONE)
    copy, place = broken_copy(tmp_path / "copy", BROKEN), tmp_path / "place"
    before = run_in(silent, place, ["earlier"])["earlier"]
    (place / "out" / "mine.txt").write_text("mine")
    assert before["status"] == 0, before
    assert [*place.glob("out/runs/*.parquet")]

    after = run_in(copy, place, ["resumed"])["resumed"]

    ended(after)
    assert [*place.glob("out/runs/*")] == []
    assert (place / "out" / "campaign.json").exists()
    assert (place / "out" / "mine.txt").read_text() == "mine"


def test_each_command_flies_compiled_flights_in_a_row_or_never():
    assert {*ROWS} - {"hours"} | NEVER_COMPILED == {*COMMANDS}
    assert not {*ROWS} & NEVER_COMPILED
