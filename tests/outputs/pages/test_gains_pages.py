"""Pages of gains compare the gains found with those of the start, each with its own flights."""

import math
import re

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft
from flighttune.control.tuning.result import TuningResult
from flighttune.flight.flown import BoundCheck
from flighttune.flight.models import tuning_problem
from flighttune.outputs.pages import meet
from flighttune.studies.meeting import Trial
from tests.outputs.drawing.test_chart import elements, plot_axes


@pytest.mark.slow
def test_the_page_of_tuned_gains_counts_what_the_tuned_ones_meet_beside_the_papers(tmp_path):
    bounds = {"peak_rad": 0.9, "MO_rad": 0.0, "ITAE": 1e-3}
    scenario = made_up_scenario(
        flight={"duration_s": 2.0},
        reference={"chi_deg": 40.0},
        plant=[{"kind": "kinematic"}, {"kind": "point_mass"}],
        expect=[{"at_most": {"chi": bounds}}],
    )
    gains = ft.PIGains(K_P=np.diag([1.7, 2.1]), K_I=np.diag([0.6, 0.9]))
    problem = tuning_problem(scenario)
    found = TuningResult(
        status="optimal", reason="", method="m", problem=problem, gains=gains, R_K=0.25, I_K=60.0,
        active=("I_K",),
    )  # fmt: skip
    tables = [{"name": "tuned", **gains.as_lists()}, "paper"]
    flown = ft.fly(ft.scenario_from({**scenario.as_dict(), "gains": tables}))

    page = meet.write_tune_page(tmp_path / "page.html", scenario, found, "tune")

    requirements = page.tables[0].records
    assert [(row["run"], row["measure"]) for row in requirements] == [
        (plant, f"chi.{name}") for plant in ("kinematic", "point_mass") for name in bounds
    ]
    values = {(check.run, check.measure): (check.value, check.met) for check in flown.claim.bounds}
    for row in requirements:
        name = row["measure"].removeprefix("chi.")
        factor = 180.0 / math.pi if row["unit"] == "deg" else 1.0
        for key, gains_name in (("value", "tuned"), ("start", "paper")):
            value, _ = values[f"{row['run']} / {gains_name}", name]
            assert row[key] == pytest.approx(factor * value)
    met = [
        sum(ok for (run, _), (_, ok) in values.items() if run == f"{plant} / tuned")
        for plant in ("kinematic", "point_mass")
    ]
    first, second = page.summary
    assert first == f"Requirements met: kinematic {met[0]}/3, point_mass {met[1]}/3."
    assert second == "R_K is 0.25 1/s with an I_K of 60 s², limited by I_K."


def test_candidates_are_drawn_by_two_requirements_and_filled_if_they_meet_all_others():
    def trial(values, excess):
        checks = [
            BoundCheck(run="", subject="chi", measure="MO_rad", sense="at_most", bound=1.0, value=x)
            for x in values
        ]
        return Trial(gains=ft.PAPER_GAINS, excess=np.array([excess]), checks=(tuple(checks),))

    trials = [
        trial((1.0, 2.0, 3.0), (0.5, 0.0, 0.5)),
        trial((4.0, 5.0, 6.0), (-0.5, 0.1, -0.5)),
        trial((7.0, 8.0, 9.0), (0.5, -0.1, 0.5)),
    ]
    rows = [
        {"measure": measure, "run": run, "bound": bound, "start": start, "value": value}
        for measure, run, bound, start, value in (
            ("chi.MO_deg", "kinematic", 2.0, 6.0, 1.5),
            ("chi.rise_s", "none", 0.0, 0.0, 0.0),
            ("gamma.settling_s", "point_mass", 4.0, 8.0, 3.5),
        )
    ]

    plane = meet.chart(trials, rows, 0, 2)

    seen = [(x.tolist(), y.tolist()) for x, y in plane._seen if not np.isnan(x).any()]
    assert seen == [([1.0, 4.0, 7.0], [3.0, 6.0, 9.0]), ([6.0], [8.0]), ([1.5], [3.5])]
    circles = elements(plane, "circle")
    assert [x.get("fill") for x in circles] == [None, "var(--paper)", None, None]
    assert [name for name, *_ in plane.legend] == ["candidate", "bound", "start", "result"]
    assert plane.x.endswith(", kinematic")
    assert plane.y.endswith(", point_mass")
    assert re.match("settling time of path angle .*against overshoot of course", plane.title)
    x_0, x_1, y_0, y_1, width, height = plot_axes(plane)
    bounds = [one.get("d") for one in elements(plane, "path") if "l" not in one.get("d")]
    across, up = (float(re.findall(r"[\d.]+", d)[k]) for d, k in zip(bounds, (0, 1), strict=True))
    assert x_0 + across / width * (x_1 - x_0) == pytest.approx(2.0, abs=0.02)
    assert y_1 - up / height * (y_1 - y_0) == pytest.approx(4.0, abs=0.02)
    alone = meet.chart([trial((1.0, 2.0), (0.5, 0.5))], rows[:2], 0, 1)
    assert elements(alone, "circle")[0].get("fill") is None


def test_the_requirements_with_the_smallest_margins_are_drawn_against_each_other():
    def pairs(*margins):
        return meet.nearest_pairs([{"margin": margin} for margin in margins])

    assert pairs(0.5, -0.2, np.nan, 0.1) == [(2, 1), (2, 3), (1, 3)]
    assert pairs(0.5, -0.2) == [(1, 0)]
    assert pairs(0.5) == []
