"""The page: everything inside, every sentence from the runs, small enough to send."""

import base64
import dataclasses
import hashlib
import html
import re

import pytest
from made_up import made_up_scenario, run_folder

import flighttune as ft

pytestmark = pytest.mark.slow


@pytest.mark.soak
def test_the_one_script_of_the_page_is_the_one_that_its_policy_allows(page):
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page).group(1)

    assert page.count("<script") == 1
    assert "default-src 'none'" in policy
    assert f"script-src 'sha256-{digest}'" in policy


@pytest.mark.soak
def test_the_answer_stands_before_the_first_figure_in_a_hundred_and_five_words(
    page, written, flown_paper
):
    top = re.sub(
        r"<style>.*?</style>|<title>.*?</title>", "", page.partition("<figure")[0], flags=re.S
    )
    words = html.unescape(re.sub(r"<[^>]*>", " ", top)).split()

    assert len(words) <= 105
    claim, converges = written.summary
    assert flown_paper.answer().verdict.startswith(claim.rstrip("."))
    assert converges == "Converged: kinematic 2/2, jsbsim:aerosonde 1/2."


def test_words_of_a_scenario_are_text_and_not_markup(results, tmp_path):
    wicked = "<script>alert('1')<script> & co"

    def named(run):
        made = run.provenance
        scenario = {**made.scenario, "title": wicked}
        return dataclasses.replace(run, provenance=dataclasses.replace(made, scenario=scenario))

    (run,) = results.of("met").runs
    written = ft.report(run_folder(tmp_path / wicked, named(run)), tmp_path / "wicked.html")
    text = written.path.read_text()

    assert "<script>alert" not in text
    assert "&lt;script&gt;alert" in text


@pytest.mark.soak
def test_an_aircraft_beside_its_nominal_self_has_a_gap_of_its_own(tmp_path):
    written = ft.report("heavy_and_aft@paper", tmp_path / "both.html")

    (table,) = (table for table in written.tables if table.name == "gap")
    nominal, heavy = (
        [record["metrics"] for record in table.records if record["gains"] == name]
        for name in ("paper", "paper (heavy_aft)")
    )
    assert {record["gains"] for record in table.records} == {"paper", "paper (heavy_aft)"}
    assert nominal != heavy


@pytest.mark.soak
def test_flights_need_no_folder_for_a_page(flown_paper, tmp_path):
    written = ft.report(flown_paper, tmp_path / "page.html")

    assert written.summary[0].startswith("8 of 8 requirements met")
    with pytest.raises(ft.InputError, match="`changes` must be absent"):
        ft.report(flown_paper, tmp_path / "page.html", changes={"seed": 2})


def test_gains_from_a_file_are_called_by_their_name(results, tmp_path):
    run = results.of("missed").runs[0]
    own = dataclasses.replace(run.provenance, gains_name="mine")
    runs = run, dataclasses.replace(run, provenance=own)
    written = ft.report(run_folder(tmp_path / "runs", *runs), tmp_path / "page.html")

    assert "Gains: K*, arXiv 2411.13140 (paper), mine." in html.unescape(written.path.read_text())


def test_a_page_has_no_character_that_steers_a_terminal(tmp_path):
    """XML forbids them, and a page may be shown by a pager."""
    wicked = "a\x1b[31m\x00title\u202e\x07"
    flown = ft.fly(made_up_scenario(title=wicked, flight={"duration_s": 0.2}))
    page = ft.report(flown, tmp_path / "page.html")

    text = page.path.read_text(encoding="utf-8")
    assert "title" in text
    assert all(char.isprintable() or char in "\n\u00a0" for char in text)
