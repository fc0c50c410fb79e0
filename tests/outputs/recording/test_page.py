"""Words of a recording: the run that is followed, runs, gains and times, and how to read it."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from claimed import claimed
from made_up import made_up_run, made_up_scenario, run_file

import flighttune as ft
from flighttune.outputs.recording import page, record
from flighttune.outputs.recording.entities import runs_to_draw

T = 0.1 * np.arange(31)
STILL = (
    *("east", "down", "chi", "gamma", "chi_ref", "gamma_ref", "chi_err", "gamma_err"),
    *("phi", "n_z", "phi_cmd", "n_z_cmd", "phi_limited", "n_z_limited", "V_a"),
)
SIGNALS = {"north": 10.0 * T, **dict.fromkeys(STILL, 0.0 * T)}


def flown(n, **made):
    """A run of so many samples."""
    return made_up_run({name: x[:n] for name, x in SIGNALS.items()}, T[:n], **made)


def test_the_view_follows_the_first_that_ended_early_else_the_last_of_the_longest():
    runs = [flown(20), flown(31, gains_name="a"), flown(31, gains_name="b"), flown(9, plant="x")]
    early = [flown(n, plant="y", gains_name=f"{n}", status="left_envelope") for n in (5, 7)]

    followed = [page.leader(runs_to_draw(some)).run for some in (runs, [*runs, *early])]

    assert [run.label for run in followed] == ["kinematic / b", "y / 5"]


def test_the_page_has_what_each_run_flew_the_indicators_of_its_gains_and_the_time_of_all():
    """Each run took 0.3 s."""
    runs = [flown(31), flown(11, gains_name="other"), flown(1, gains_name="none")]
    marks = {
        name: SimpleNamespace(R_K=R_K, I_K=10.0 * R_K, E_K=20.0 * R_K)
        for name, R_K in (("paper", 0.25), ("other", 0.5))
    }

    text = page.scenario_page(runs, scenario={"title": "T", "source": "s"}, indicators=marks)

    rows = {
        cells[0]: cells[1:]
        for line in text.partition("## Tracking")[0].splitlines()
        if len(cells := [x.strip() for x in line.strip("|").split("|")]) > 3
    }
    for run, seconds in zip(runs, ("3.00", "1.00", "0.00"), strict=True):
        colour, said, *_ = rows[run.label]
        assert said == seconds
        assert (colour == "not drawn") == (len(run.signals) < 2)
    for name, mark in marks.items():
        values = [float(x) for x in rows[name][:3]]
        assert values == pytest.approx([mark.R_K, mark.I_K, mark.E_K])
    assert "flown in 0.90 s." in text
    assert "Seed 7;" in text
    assert re.search(r"\*\*Source:\*\* s", text)
    assert "**Verifies:**" not in text


def test_the_reading_line_says_what_colours_and_lines_are_and_how_large_all_is_drawn():
    """A flight of 290 m has lines of the ground 20 m apart, and aircraft a tenth as wide."""
    t = 0.1 * np.arange(5)
    way = {"north": 290.0 * t / t[-1], "east": 0.0, "down": 0.0}

    def drawn(*names, **claims):
        runs = [made_up_run(way, t, plant=plant, gains_name=gains) for plant, gains in names]
        for kind in claims:
            runs[0] = claimed(runs[0], kind, kind, V_a=(24.0, 26.0))
        return page.reading_line(runs_to_draw(runs))

    law, craft = "kinematic", "jsbsim:aerosonde"
    hue = drawn((law, "paper"), (craft, "paper"), (law, "K1"), (craft, "K1"))
    assert hue.startswith("**Hue:** gains, **dashed, outline:** a law, **aircraft:** ")
    assert drawn((craft, "paper"), (law, "paper")).startswith("**Colour:** plant, **dashed, ")
    alone = drawn((craft, "paper"), proven=True, counted=True)
    assert "a law" not in alone
    assert "**thin around a signal:** proven tube" in alone
    assert "**dashed around a signal:** counted band" in alone
    assert alone.endswith("**aircraft:** 10 times their size, **arrow:** velocity, **grid:** 20 m.")


def test_compared_runs_have_the_title_and_the_scenario_of_the_first(tmp_path, monkeypatch):
    files = []
    for number, (title, gains) in enumerate((("First", "paper"), ("Second", "K1"))):
        scenario = made_up_scenario(title=title, flight={"duration_s": 1.0}, gains=[gains])
        (run,) = ft.fly(scenario).runs
        files.append(str(run_file(tmp_path / f"{number}.parquet", run)))
    told = {}
    monkeypatch.setattr(record, "write_recording", lambda runs, path, **more: told.update(more))

    record.write_overlay(ft.compare(*files), tmp_path / "both.rrd")

    assert told["title"] == "First: comparison"
    assert told["page"].startswith("# First\n")
    assert "## Compared" in told["page"]
