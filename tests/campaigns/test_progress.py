"""The numbers of a campaign that is being flown, and what it says of them."""

import time

import pytest
from dispersed import plan_of, tables_of, uniform

from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.engine.progress import CampaignProgress

ROWS = [
    {"run": run, "status": status, "reason": "", "success": success}
    for run, (status, success) in enumerate((
        ("completed", True), ("completed", False), ("completed", True), ("diverged", False),
        ("crashed", False), ("no_trim", False), ("crashed", False), ("timed_out", False),
        ("completed", True),
    ))
]  # fmt: skip


def progress(**fields):
    counted = CampaignProgress(doing="flying", **fields)
    counted.add(ROWS[:5])
    counted.add(ROWS[5:])
    return counted


def test_runs_are_counted_by_how_they_ended():
    counted = progress()

    assert (counted.done, counted.completed, counted.crashed, counted.failed) == (9, 4, 2, 3)
    assert counted.succeeded == 3
    assert [end["run"] for end in counted.endings] == [3, 4, 5, 6, 7]


@pytest.mark.parametrize(
    ("fields", "part", "left"),
    [
        ({"runs": 20}, (9, 20), 11.0),
        # a campaign that may end before, a search with phases, and more flown than wanted
        ({"runs": 20, "planned": 40}, (9, 40), 31.0),
        ({"runs": 20, "budget": 50}, (8, 50), 42.0),
        ({"runs": 5}, (9, 5), 0.0),
    ],
)
def test_the_time_left_is_that_of_the_runs_left_at_the_rate_so_far(fields, part, left):
    """8 rows in 4 s."""
    counted = progress(flown=8, began=time.perf_counter() - 4.0, **fields)

    assert counted.part == part
    assert counted.rate_per_s == pytest.approx(2.0, rel=0.05)
    assert counted.left_s == pytest.approx(left / 2.0, rel=0.05)


@pytest.mark.parametrize("fields", [{"flown": 0, "began": 1.0}, {"flown": 3, "began": None}])
def test_there_is_no_rate_before_the_first_row(fields):
    counted = progress(**fields)

    assert counted.rate_per_s == 0.0
    assert fields["flown"] or counted.left_s is None


def test_progress_says_what_is_done_and_left():
    began = time.perf_counter() - 4.0

    said = progress(runs=20, flown=8, began=began).sentence
    sure = progress(runs=20, planned=40, flown=8, began=began).sentence
    search = CampaignProgress(doing="searching", runs=7, budget=30, flown=6, began=began).sentence
    keeping = CampaignProgress(doing="keeping signals", runs=3, flown=2, began=began).sentence

    assert said.startswith("flying: 9 of 20 runs, 2")
    assert said.endswith(" left, 3 failed, 2 crashed")
    assert sure.startswith("flying: 9 of at most 40 runs, ")
    assert ", at most " in sure
    assert search.startswith("searching: 6 of at most 30 runs, ")
    assert search.endswith(" left")
    assert "left" not in keeping
    assert CampaignProgress().sentence == "starting: 0 of 0 runs"


def test_flights_flown_again_come_on_top_of_a_budget():
    plan = plan_of(tables_of(), uniform("flight.chi_deg", -5.0, 5.0)).with_runs(2)
    with WorkerPool(Fliers(workers=1)) as pool:
        pool.progress.budget = 3
        shown = []
        for runs in (range(2), range(2), [0]):
            list(pool.rows(plan, runs, doing="counting"))
            shown.append(pool.progress.part)

    assert shown == [(2, 3), (4, 4), (5, 5)]


@pytest.mark.parametrize(("counts", "said"), [(3, "stage 2 of 3, starting: "), (1, "starting: ")])
def test_a_command_that_counts_several_times_says_which_stage_it_is_at(counts, said):
    with WorkerPool(Fliers(workers=1).at_stage(min(2, counts), counts)) as pool:
        assert pool.progress.sentence.startswith(said)
