"""The report of a campaign: the JSON object, the page, and what a browser makes of it."""

import re
import shutil
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest
from commands import answer
from flown_campaigns import parts, plan
from made_up_campaign import made_up_plan, made_up_rows
from scipy import stats

import flighttune as ft
from flighttune.campaigns.dataset import dataset_hash
from flighttune.campaigns.statistics import findings
from flighttune.outputs.pages import campaign, campaign_charts

pytestmark = pytest.mark.slow

RUNS = 40


@pytest.fixture(scope="module")
def flown_folder(tmp_path_factory):
    """A real campaign of two gain sets on law and aircraft, in wind."""
    folder = tmp_path_factory.mktemp("flown")
    ours, out = plan(folder / "files", runs=RUNS), folder / "out"
    ft.run_campaign(ours.with_runs(RUNS // 2), out, workers=1)
    ft.run_campaign(ours, out, workers=1, resume=True)  # at least two files of rows
    return out


@pytest.fixture(scope="module")
def told(flown_folder):
    """What the command says of it."""
    return answer("report", flown_folder)


@pytest.fixture(scope="module")
def made_up():
    """Findings of rows that were made up, with everything in them that a report can show."""
    made = made_up_plan(runs=4 * 200)
    return findings.findings_of(made_up_rows(made), made)


@pytest.fixture(scope="module")
def page(made_up, tmp_path_factory):
    """Their page."""
    return campaign.write_campaign_report(made_up, tmp_path_factory.mktemp("page") / "report.html")


def test_the_page_counts_each_gain_set_on_each_plant_apart(made_up, page):
    rows = made_up.rows
    counts = rows.groupby(["plant", "gains"], sort=False)["success"].agg(["sum", "size"])

    shares = [f"{plant} / {gains} {good}/{n}" for (plant, gains), (good, n) in counts.T.items()]
    assert len(counts) == 4
    assert page.summary[0] == f"Flights that succeed: {', '.join(shares)}."


@pytest.mark.soak
def test_the_json_object_has_what_the_rows_say(told, flown_folder):
    rows = pd.concat(map(pd.read_parquet, parts(flown_folder)))

    assert told["runs"] == told["planned"] == RUNS
    groups = [(group["plant"], group["gains"]) for group in told["groups"]]
    assert groups == [*product(("jsbsim:aerosonde", "kinematic"), ("paper", "soft"))]
    for group in told["groups"]:
        own = rows[(rows["plant"] == group["plant"]) & (rows["gains"] == group["gains"])]
        counted = stats.binomtest(int(own["success"].sum()), len(own))
        interval = counted.proportion_ci(method="wilson")
        assert group["n"] == len(own) == 10
        assert group["success"] == own["success"].mean()
        assert (group["lo"], group["hi"]) == pytest.approx((interval.low, interval.high))
        assert group["statuses"] == own["status"].value_counts().to_dict()
        for name, q in (("p05", 0.05), ("p50", 0.5), ("p95", 0.95)):
            assert group["metrics"]["chi.ITAE"][name] == pytest.approx(own["chi.ITAE"].quantile(q))
        worst = own.sort_values("chi.ITAE").iloc[-1]
        assert group["worst"][0]["run"] == worst["run"]
        assert group["worst"][0]["parameters"] == {"flight.V_a_mps": worst["flight.V_a_mps"]}
    assert told["sha256"] == dataset_hash(flown_folder)


@pytest.mark.soak
def test_the_page_stands_in_the_folder_and_the_campaign_is_still_one(told, flown_folder):
    assert told["report"] == str(flown_folder / "report.html")
    text = (flown_folder / "report.html").read_text(encoding="utf-8")

    assert dataset_hash(flown_folder) in text
    assert f"flighttune verify {flown_folder} --run 0" in text
    assert "short_turn_in_wind" in text


@pytest.mark.soak
def test_intervals_and_their_confidence_can_be_chosen(told, flown_folder, tmp_path):
    chosen = "--interval", "clopper-pearson", "--confidence", 0.9, "--out", tmp_path / "page.html"
    other = answer("report", flown_folder, *chosen)

    for one in other["groups"]:
        expected = stats.binomtest(one["successes"], one["n"]).proportion_ci(0.9, method="exact")
        assert (one["lo"], one["hi"]) == pytest.approx((expected.low, expected.high))
    assert (tmp_path / "page.html").is_file()


@pytest.mark.soak
def test_a_campaign_that_is_not_over_says_how_much_is_there(tmp_path, flown_folder):
    out = tmp_path / "out"
    shutil.copytree(flown_folder, out)
    first = parts(out)
    for path in first[len(first) // 2 :]:
        path.unlink()

    found = findings.load_findings(out)

    assert 0 < len(found.rows) < RUNS
    said = campaign.notes(found)[0]
    assert f"{len(found.rows)} of {RUNS} flights" in said
    for path in first[: len(first) // 2]:
        path.unlink()
    with pytest.raises(ft.RecordingError, match=r"no run .*flown"):
        findings.load_findings(out)


def test_the_first_screen_says_what_success_is_and_draws_the_measure_that_decides(page):
    first = page.path.read_text(encoding="utf-8").partition("<body>")[2].partition("<details")[0]

    sentence = r"A flight succeeds if it is completed with [^.]*ITAE of course at most 4 rad\ss²"
    assert re.search(sentence, first)
    assert "Flights by settling time of course (5\u00a0%)" in first  # has most misses
    assert "settling time of course (5\u00a0%) at most 5 s</button>" in first
    assert "initial airspeed" in first
    assert not re.search(r"certified|flight\.\w|chi\.\w", first)


@pytest.mark.parametrize("ITAE", [4.0, 3.0, 1.3])
def test_the_shares_are_drawn_within_their_range_with_room_on_both_sides(ITAE):
    """`ITAE` is the bound that leaves all, some or few flights successful."""
    made = made_up_plan(runs=4 * 200)
    rows = made_up_rows(made)
    rows["success"] = rows["success"] & (rows["chi.ITAE"] <= ITAE)

    found = findings.findings_of(rows, made)

    shares, *_ = campaign_charts.rates(found)
    low, high = shares.x_range
    ends = [100.0 * group[key] for group in found.values["groups"] for key in ("lo", "hi")]
    width = max(ends) - min(ends)
    assert low == -2.0 or min(ends) - low >= 0.05 * width
    assert high == 102.0 or max(ends) + 0.1 * width <= high < 102.0
    assert -2.0 <= low < min(ends) <= max(ends) < high <= 102.0


def test_every_part_is_on_the_page(page):
    text = page.path.read_text(encoding="utf-8")

    titles = "How often/Worst flights/Metrics/What matters/Gains on the same draws/Convergence"
    assert page.sections == tuple(titles.split("/"))
    for part in ("Provenance", "How to reproduce", *page.sections):
        assert f"<h2>{part}</h2>" in text
    assert re.search(r"campaign campaign.toml --runs \d+ --out", text)
    assert text.count('<svg class="chart" ') > 8
    assert page.path.stat().st_size < 3_000_000


@pytest.mark.parametrize("completed", [True, False])
def test_a_bound_of_zero_is_drawn_and_says_whose_it_is(completed, tmp_path):
    made = made_up_plan({"gains": "K3", "at_most": {"chi": {"ITAE": 0.0}}}, runs=40)
    rows = made_up_rows(made)
    rows["chi.ITAE"] = np.geomspace(0.01, 10.0, len(rows))  # spans decades
    if not completed:
        rows["status"] = "diverged"

    made_page = campaign.write_campaign_report(
        findings.findings_of(rows, made), tmp_path / "page.html"
    )

    assert "at most 0 rad\u00a0s² (K3)</button>" in made_page.path.read_text(encoding="utf-8")


def found_of(made, kept=None, until_sure=None):
    """Findings of a made-up plan, of which so many flights are there."""
    rows = made_up_rows(made)
    if until_sure is not None:
        table = made.campaign.model_copy(update={"until_sure": until_sure})
        made = replace(made, campaign=table)
    return findings.findings_of(rows if kept is None else rows[:kept], made)


@pytest.mark.parametrize(
    ("design", "kept", "said"),
    [
        ("random", None, None),
        ("random", 30, "Not finished: the numbers are those of 30 of 40 flights."),
        ("latin_hypercube", None, "Draws are spread evenly (latin hypercube); "),
        ("sobol", None, "Draws are spread evenly (sobol); "),
    ],
)
def test_notes_of_a_campaign_say_how_many_flights_it_has_and_how_they_were_drawn(
    design, kept, said
):
    notes = campaign.notes(found_of(made_up_plan(runs=40, design=design), kept))

    special = [note for note in notes if note.startswith(("Not finished", "Draws", "The campaign"))]
    assert len(special) == (said is not None)
    assert all(note.startswith(said) for note in special)


def test_a_campaign_that_ended_because_it_was_sure_says_so_with_its_answer():
    """Of 150 flights on the law all succeed: at least half of all do, as surely as asked."""
    bound = {"at_most": {"chi": {"ITAE": 1e3}}}
    found = found_of(made_up_plan(bound, runs=800), 600, until_sure=0.5).by(None)

    notes, (first, *_) = campaign.notes(found), campaign.summary(found)

    assert {*found.values["sure"].values()} == {"yes"}
    assert (
        "The campaign ended after 600 of 800 flights by its own rule, sure of each answer." in notes
    )
    assert any("hold whenever the campaign ends" in note for note in notes)
    assert first.startswith("At least 50 % of the flights of ")
    few = found_of(made_up_plan(bound, runs=800), 12, until_sure=0.5).by(None)
    assert "Not finished: the numbers are those of 12 of 800 flights." in campaign.notes(few)
    assert campaign.summary(few)[0].startswith("It is not sure whether at least 50 % of")


def test_success_over_a_parameter_is_its_share_at_each_value_with_its_interval(made_up):
    charts = campaign_charts.split_panels(made_up)

    (title,) = {chart.title for chart in charts}
    assert title == "Success over initial airspeed"
    for split, (ends, shares, dots) in zip(
        made_up.splits, zip(*[iter(charts[0]._seen)] * 3, strict=True), strict=True
    ):
        rows = made_up.rows[
            (made_up.rows["plant"] + " / " + made_up.rows["gains"]) == split["group"]
        ]
        assert shares[1] == pytest.approx([100.0 * x.value for x in split["success"]])
        assert dots[0] == pytest.approx(split["centres"])
        n = len(rows)
        assert np.mean(shares[1]) == pytest.approx(100.0 * rows["success"].mean(), abs=100.0 / n)
        low, high = ends[1][::3], ends[1][1::3]
        assert (low <= shares[1]).all()
        assert (shares[1] <= high).all()


def test_convergence_ends_at_the_share_and_the_percentile_of_all_flights(made_up):
    success, p95 = campaign_charts.convergence(made_up)

    for k, (group, rows) in enumerate(made_up.groups()):
        lines = success._seen[3 * k + 2]
        assert lines[0][-1] == len(rows) == 200
        assert lines[1][-1] == pytest.approx(100.0 * rows["success"].mean())
        own = [x for x in made_up.values["groups"] if x["group"] == group.label]
        assert p95._seen[3 * k + 2][1][-1] == pytest.approx(
            own[0]["metrics"][made_up.measure]["p95"], nan_ok=True
        )
    bare = made_up_plan(runs=40)
    rows = made_up_rows(bare).drop(columns=["chi.ITAE", "gamma.ITAE", "chi.settling_s"])
    without = findings.findings_of(rows, bare)
    assert campaign_charts.convergence(without) == []
    assert campaign_charts.scatter_panels(without) == []
