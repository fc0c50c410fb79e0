"""Sentences of answers: who is better, what is lost, what is met, and what matters most."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from claimed import claimed
from made_up import made_up_run, made_up_scenario
from printed import MARKED, MODEL

import flighttune as ft
from flighttune.campaigns.engine.engine import CampaignOutcome
from flighttune.campaigns.planning.plan import Group
from flighttune.claims.verify import Verified
from flighttune.control.linear_model import Envelope
from flighttune.control.margins import Margins
from flighttune.control.theory.exact import Check, Verification
from flighttune.control.tuning.noise import Noise, Rms
from flighttune.control.tuning.result import Diagnosis
from flighttune.flight.gradient import Gradient
from flighttune.flight.loop.run import Alarm
from flighttune.gaps.compare import Pair
from flighttune.gaps.of_log import LogGap
from flighttune.outputs.answers import (
    beside,
    campaign,
    certificate,
    compare,
    gap,
    log_gap,
    meeting,
    tuning,
)
from flighttune.outputs.answers import run as run_answers
from flighttune.outputs.drawing.palette import LineStyle
from flighttune.studies.adoption import adopt
from flighttune.studies.adoption.survey import SwitchedOff

DEG = math.pi / 180.0


def comparison(better, *, gains=("mine", "yours"), plants=("kinematic", "kinematic")):
    """One pair of runs, and which of them is better in each measure of the course."""
    t = 0.5 * np.arange(19)
    a, b = (
        made_up_run({"chi": 0.0 * t}, t, plant=plant, gains_name=name)
        for name, plant in zip(gains, plants, strict=True)
    )
    names = ("MO_rad", "settling_s", "ITAE", "rise_s", "ITSE", "IAE", "ISE", "ST_rad", "MS_rad")
    rows = [
        {"pair": 0, "run_a": a.label, "run_b": b.label, "channel": "chi", "name": name}
        | {"unit": "rad" if name == "MO_rad" else "s", "a": 0.1, "b": 0.3, "diff": 0.2, "better": x}
        for name, x in zip(names, better, strict=False)
    ]
    pair = Pair(
        a=a, b=b, source_a="A: one", source_b="B: two", max_distance=12.0, t_max_distance=3.0,
        differs={},
    )  # fmt: skip
    return ft.Comparison(pairs=(pair,), metrics=pd.DataFrame(rows))


@pytest.mark.parametrize(
    ("better", "options", "said"),
    [
        ("aaa", {}, "On kinematic A (mine) is better in 3 of 3 measures, B (yours) in 0."),
        (
            ("b", "same", "a", "b"), {},
            "On kinematic B (yours) is better in 2 of 3 measures, A (mine) in 1: ITAE of course.",
        ),
        (
            "abbab", {"gains": ("mine", "mine")},
            "On kinematic B (B: two) is better in 3 of 5 measures, A (A: one) in 2: overshoot of "
            "course and rise time of course.",
        ),
        (
            "bbbbaaaaa", {},
            "On kinematic A (mine) is better in 5 of 9 measures, B (yours) in 4: overshoot of "
            "course, settling time of course (5\u00a0%), ITAE of course and 1 more.",
        ),
        ("ab", {}, "On kinematic A and B are each better in 1 of 2 measures."),
        (
            "a", {"plants": ("kinematic", "point_mass")},
            "On kinematic and point_mass A (mine) is better in 1 of 1 measures, B (yours) in 0.",
        ),
    ],
)  # fmt: skip
def test_a_comparison_names_the_better_run_and_where_it_is_worse(better, options, said):
    assert compare.judged(comparison(better, **options), 0) == said


def test_compared_metrics_are_in_degrees_and_counted_by_the_better_run():
    made = comparison(("b", "same", "a", "b"))

    (angle, time, *_) = compare.comparison_table("", made.metrics).records
    assert angle["pair"] == "kinematic: mine | yours"
    assert [angle[x] for x in ("metric", "unit", "better")] == ["MO", "deg", "B"]
    numbers = [angle[x] for x in ("a", "b", "diff")]
    assert numbers == pytest.approx([0.1 / DEG, 0.3 / DEG, 0.2 / DEG])
    assert (time["a"], time["better"]) == (0.1, "same")
    (pair,) = compare.pairs_table(made).records
    assert pair["better"] == {"a": 1, "b": 2, "same": 1}
    (other,) = compare.pairs_table(comparison("aab")).records
    assert other["better"] == {"a": 2, "b": 1, "same": 0}
    assert (pair["compared_s"], pair["max_distance_m"], pair["max_distance_at_s"]) == (9, 12, 3)
    assert compare.paired("law / a", "air / a") == "law / a | air / a"
    assert compare.paired("log", "log") == "log | log"
    assert compare.different(1, 2) == " (1 and 2)"
    assert compare.different("x" * 16, "y" * 16) == f" ({'x' * 16} and {'y' * 16})"
    assert compare.different("x" * 17, "y" * 16) == ""  # 41 characters


def test_runs_that_cannot_be_compared_could_not_run_and_others_show_three_measures():
    made = comparison("abbab")
    differs = {"wind": (1, 2), "flight.V_a_mps": (20.0, 25.0)}
    (pair,) = made.pairs
    four = replace(
        made, pairs=(pair._replace(differs=differs), *[pair] * 3), missing=("x",), unpaired=("y",)
    )

    said = four.answer()

    assert (said.failure, said.status) == ("", 0)
    assert len(said.summary) == 3
    assert said.changed == [
        "A and B differ in `flight.V_a_mps` (20.0 and 25.0).",
        "A and B differ in `wind` (1 and 2).", "Missing: x.", "No partner: y.",
    ]  # fmt: skip
    shown, _, every = said.tables
    assert [row["metric"] for row in shown.records] == ["MO", "settling_s", "ITAE"]
    assert (len(every.records), every.aside, shown.aside) == (5, True, False)
    others = replace(made, metrics=made.metrics[~made.metrics["name"].isin(compare.SHOWN)])
    assert len(others.answer().tables[0].records) == 2
    assert said.values["max_distance_m"] == 12.0
    refused = replace(made, reason="other aircraft").answer()
    assert (refused.failure, refused.status) == ("other aircraft", 2)
    assert refused.values["comparable"] is False


ERRORS = [
    {"of": "cross track", "unit": "m", beside.YOURS: 3.0, beside.OURS: 2.0},
    {"of": "height", "unit": "m", beside.YOURS: 1.5, beside.OURS: 1.5},
    {"of": "airspeed", "unit": "m/s", beside.YOURS: 0.5, beside.OURS: 0.625},
]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (ERRORS[:1], "our law is better in cross track 2 m (yours 3 m)"),
        (
            ERRORS,
            "our law is better in cross track 2 m (yours 3 m), and not better in height 1.5 m "
            "(yours 1.5 m) and airspeed 0.625 m/s (yours 0.5 m/s)",
        ),
        (ERRORS[2:], "our law is not better in airspeed 0.625 m/s (yours 0.5 m/s)"),
    ],
)
def test_a_smaller_error_is_better_and_an_equal_one_is_not(rows, said):
    assert beside.nearer(rows) == said


def test_lost_aircraft_are_counted_with_their_ends():
    ends = [{"status": "left_envelope"}, {"status": "hit_ground"}, {"status": "left_envelope"}]

    assert beside.losses({beside.YOURS: [], beside.OURS: []}, 1) == (
        "Neither lost an aircraft in 1 flight."
    )
    assert beside.losses({beside.YOURS: ends, beside.OURS: []}, 20) == (
        "Aircraft lost in 20 flights: your parameters 3 (left envelope, hit ground), our law 0."
    )


def test_errors_of_few_flights_are_no_bound():
    """0.95^58 is above 0.05, and 0.95^59 is below it."""
    assert beside.kept_errors(1)[0] == "the largest errors of 1 flight"
    short, long = beside.kept_errors(58)
    assert (short, long) == (
        "the largest errors of 58 flights",
        "The largest errors of 58 flights; 59 are needed for a bound",
    )
    assert beside.kept_errors(59)[0] == "the errors that 95 % of flights keep to"
    assert beside.kept_errors(59)[1].endswith("each by itself, at a confidence of 95 %")


def test_margins_are_in_decibel_and_degrees():
    """A factor of 2 is 20 log10(2) = 6.02 dB, and 0.5 rad are 28.6 deg."""
    cut = Margins(
        loop="phi", gain_decrease=0.0, gain_increase=2.0, phase_margin=0.5, delay_margin=math.inf
    )

    assert beside.margins_at([cut], 0) == "6.0 dB, 29 deg"
    assert beside.margins_at([], 0) == "unstable"


@pytest.fixture(scope="module")
def certified():
    return ft.certify("paper", "paper")


def test_a_certificate_over_any_envelope_is_said_to_be_so(certified):
    def said(result):
        return any("holds over any envelope" in note for note in result.answer().notes)

    everywhere = replace(certified, over_envelope=True)

    assert said(everywhere)
    assert not said(certified)
    assert not said(replace(everywhere, largest_factor=0.7))


def row(measure, margin, *, active=False, run="kinematic"):
    return {"measure": measure, "run": run, "margin": margin, "active": active}


def search(*rows, **changes):
    """A search that flew 12 times and ended with these requirements."""
    stated = {
        "status": "met", "scenario": made_up_scenario(), "campaign": None,
        "gains": ft.PAPER_GAINS, "start": "tuned", "start_gains": ft.PAPER_GAINS,
        "start_of_scenario": False, "other_starts": (), "start_met": False, "flights": 12,
        "candidates": 4, "metric": {"name": "margin"}, "requirements": rows, "worse": (),
        "trade_offs": (), "success": None, "worst": None, "trials": (), "tuned_for": {},
        "notes": (), "endings": (),
    }  # fmt: skip
    return ft.Meeting(**(stated | changes))


MET = (row("chi.MO_rad", 0.25), row("gamma.settling_s", 0.0, active=True))


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (
            search(row("chi.MO_rad", -0.1), row("chi.ITAE", math.nan), row("gamma.ITAE", 0.0)),
            "2 of 3 requirements are missed after 12 flights; these are the nearest gains.",
        ),
        (
            search(*MET, flights=1),
            "Met: all 2 requirements. The gains found have 0.0 % to spare in the tightest, "
            "settling time of path angle (5\u00a0%) on kinematic, after 1 flight.",
        ),
        (
            search(MET[0], start_met=True),
            "The gains of the start, tuned, already meet all 1 requirements. The gains found have "
            "25.0 % to spare in the tightest, overshoot of course on kinematic, after 12 flights.",
        ),
    ],
)
def test_a_search_says_whether_its_requirements_are_met(made, said):
    assert meeting.sentence(made) == said


def test_a_metric_that_falls_is_said_with_what_stops_it():
    metric = {"name": "effort", "value": 0.5, "start": 0.75}
    one, two = search(*MET, metric=metric), search(*MET, MET[1], metric=metric)

    ends = [meeting.sentence(x).partition("after 12 flights. ")[2] for x in (one, two)]
    settling = "settling time of path angle (5\u00a0%) on kinematic"
    assert ends == [
        f"effort is 0.5, 0.75 at the start; {settling} stops it from falling.",
        f"effort is 0.5, 0.75 at the start; {settling} and {settling} stop it from falling.",
    ]
    alone = meeting.sentence(search(MET[0], metric=metric))
    assert alone.endswith("effort is 0.5, 0.75 at the start.")


def test_a_share_of_draws_is_said_with_its_interval_and_its_rule():
    def share(value, *ends):
        return {"value": value, "n": 200} | dict(zip(("lo", "hi"), ends, strict=False))

    success = {
        "share": share(0.925, 0.88, 0.957), "of_start": share(0.5), "seed": 7, "wanted": 0.9,
        "by": "lo", "sure": None,
    }  # fmt: skip

    assert meeting.share_met(search(), success, "12 flights") == (
        "On 200 fresh draws (seed 7) 92.5 [88, 95.7] % of the flights meet all requirements, "
        "50.0 % with tuned; 90 % are wanted, by the lower end of the interval (12 flights)."
    )
    sure = meeting.share_met(search(), success | {"sure": "no"}, "12 flights")
    assert "with a probability below 90 %, confidence" in sure


def test_a_search_names_its_start_and_what_became_worse():
    others = search(other_starts=("paper", "K1"), start_of_scenario=True)
    none = search()
    worse = {"measure": "chi.MO_rad", "value": 2.0 * DEG, "start": DEG, "run": "kinematic"}

    assert meeting.choice_of_start(others) == [
        "The start is tuned, the nearest to the requirements of the gains that the scenario flies; "
        "paper and K1 were tried too."
    ]
    tuned = replace(others, start_of_scenario=False)
    assert "requirements of the tuned gains;" in meeting.choice_of_start(tuned)[0]
    assert (meeting.choice_of_start(none), meeting.worse_sentence(none)) == ([], "")
    assert meeting.worse_sentence(search(worse=[worse])) == (
        "Worse than with tuned: overshoot of course 2 deg (was 1)."
    )


@pytest.mark.parametrize(
    ("status", "run", "by_default"),
    [("met", "kinematic", False), ("missed", "by default", True), ("evidence", "kinematic", False)],
)
def test_a_search_fails_unless_its_requirements_are_met(monkeypatch, status, run, by_default):
    monkeypatch.setattr(meeting, "certify_scenario", lambda *_, **__: SimpleNamespace(values={}))
    rows = [
        {**row("chi.MO_rad", x, run=on), "why": why, "sense": "at most", "bound": 2.0 * DEG}
        | {"value": 1.5 * DEG, "start": DEG}
        for x, on, why in ((0.25, "kinematic", ""), (0.5, run, "it never settles"))
    ]
    made = search(*rows, status=status)

    said = made.answer()

    assert said.verdict == meeting.sentence(made)
    assert said.failure == ("" if status == "met" else said.verdict)
    assert (meeting.BY_DEFAULT_NOTE in said.notes) == by_default
    assert f"{meeting.subject(rows[1])}: it never settles" in said.notes
    (first, _) = said.tables[0].records
    assert said.tables[0].columns == meeting.REQUIREMENT_COLUMNS
    assert first["must_be"] == "at most 2 deg"
    assert (first["value"], first["start"]) == pytest.approx((1.5, 1.0))
    level = ft.loop.kinematic_model(V_a=25.0, gamma=0.0, g=9.81)
    poles = np.linalg.eigvals(ft.loop.closed_loop(level, ft.PAPER_GAINS))
    assert said.values["spectral_abscissa"] == pytest.approx(poles.real.max(), rel=1e-9)


def result_of(**changes):
    problem = ft.loop.TuningProblem(model=MODEL)
    stated = {"status": "optimal", "reason": "", "method": "gradient", "problem": problem}
    figures = {"R_K": 0.5, "I_K": 5.0, "E_K": 2.0, "active": ("I_K", "phi_max")}
    return ft.TuningResult(**(stated | figures | changes))


def test_found_gains_are_said_with_their_indicators_and_active_limits():
    assert tuning.summary(result_of()) == (
        "The gains found have R_K 0.5 1/s, I_K 5 s² and E_K 2 s². "
        "Limits that bind: I_K and phi_max."
    )
    over = result_of(status="found", R_envelope=0.25, active=())
    assert tuning.summary(over) == (
        "The gains found have a rate of 0.25 1/s over the envelope, at the trim R_K 0.5 1/s, I_K "
        "5 s² and E_K 2 s²."
    )
    for status in ("infeasible", "failed"):
        assert tuning.summary(result_of(status=status, reason="None.")) == "None."


def test_gains_over_an_envelope_have_its_rate_in_their_table_and_other_gains_do_not():
    one, over = result_of(), result_of(status="found", R_envelope=0.25)

    tables = [tuning.answer(made).tables for made in (one, over)]
    shown = [[column.key for column in table.columns] for table, *_ in tables]
    assert [table.title for table, *_ in tables] == ["tuning", "tuning over the envelope"]
    assert [("R_envelope" in keys, "method" in keys) for keys in shown] == [
        (False, True), (True, False),
    ]  # fmt: skip
    assert not any("cost" in keys for keys in shown)
    assert [len(of) for of in tables] == [3, 3]
    unsolved = result_of(status="infeasible", reason="None.", gains=MARKED["K3"])
    assert tuning.answer(unsolved).failure == "None."
    assert tuning.answer(unsolved).tables[2].records == []
    assert tuning.answer(over).failure == ""


def test_the_answer_of_a_tuning_says_its_units_and_what_keeps_it_from_being_feasible():
    n = MODEL.A.shape[0] + 2
    limits = ({"name": "phi", "factor_alone": 2.0, "smallest_I_K_without": 3.0, "use": 1.5},)
    diagnosis = Diagnosis(6.0, 0.25, 1.5, None, ("phi",), limits)
    scaled = ft.loop.TuningProblem(model=MODEL, scaling=[1.0] * (n - 1) + [2.0])
    weights = np.ones(2), np.ones(2)
    weighed = ft.loop.TuningProblem(model=MODEL, weights=weights, x_0=np.ones(2))
    made = result_of(problem=scaled, status="infeasible", reason="No.", diagnosis=diagnosis)

    said = tuning.answer(made)

    assert said.notes == [tuning.SCALED]
    assert tuning.answer(result_of()).notes == [tuning.PLAIN]
    nearest, each = said.tables[-2:]
    assert (nearest.title, each.title) == ("within the limits", "limits")
    assert nearest.records[0]["common_factor"] == 1.5
    assert each.records == limits
    (*_, last) = tuning.answer(result_of(problem=weighed)).tables[0].columns
    assert last.key == "cost"


@pytest.mark.parametrize(
    ("bounds", "said"), [((0.5, 2.0), ", 20% and 25% of their bounds"), ((0.5, math.inf), "")]
)
def test_the_sensitivity_and_the_noise_of_a_loop_are_said_in_degrees(bounds, said):
    k = 3
    noise = Noise(
        omega=np.arange(1.0, k + 1.0), gusts=np.ones((2, k)), estimates=np.ones((2, k)),
        measured=np.ones((2, k)), units=np.ones(2), rates_max=np.array(bounds), dt=0.02,
    )  # fmt: skip
    problem = ft.loop.TuningProblem(
        model=MODEL, objective="rms", sensitivity_max=1.75, noise=noise, gusts=np.ones(2)
    )
    rms = Rms(np.array([0.5, 0.25]) * DEG, np.array([0.1, 0.5]))
    made = result_of(
        problem=problem, sensitivity=1.5, errors_in_gusts=[0.1, 0.25], in_noise=rms,
        active=("sensitivity",),
    )  # fmt: skip

    assert tuning.bounds_in_words(made) == [
        "The largest sensitivity is 1.500; its bound of 1.75 holds the gains.",
        "The rms errors in turbulence over that of the gusts' angle are 0.100, 0.250.",
        "In light gusts with estimation errors the rms errors are 0.5 and 0.25 deg. The rms rates "
        f"of the commands are {0.1 / DEG:.3g} deg/s and 0.5 1/s{said}.",
    ]
    free = tuning.bounds_in_words(result_of(problem=problem, sensitivity=1.5))
    assert free == ["The largest sensitivity is 1.500; its bound of 1.75 does not hold the gains."]
    assert tuning.bounds_in_words(result_of()) == []


@pytest.mark.parametrize("widest", [49.0, 51.0])
def test_a_frontier_over_more_than_a_decade_has_a_logarithmic_axis(widest):
    marks = [("paper", 6.0, 0.4, True), ("beyond", 7.0, 0.6, False), ("unstable", 2.0, 0.0, True)]
    along = [("frontier", x, 0.1 * k, True) for k, x in enumerate((5.0, 6.0, widest), start=3)]
    table = pd.DataFrame([*along, *marks], columns=["name", "I_K", "R_K", "within_limits"])

    chart = tuning.frontier_chart(table, {"paper": LineStyle("#1F78B4", "blue", 2.0, False)})

    assert chart.log == ("x" if widest > 50.0 else "")
    line, paper, *_ = chart._seen
    assert line[0].tolist() == [5.0, 6.0, widest]
    assert line[1] == pytest.approx([0.3, 0.4, 0.5])
    assert (paper[0][0], paper[1][0]) == (6.0, 0.4)
    svg = chart.svg()
    assert "beyond: R_K 0.6000 1/s, I_K 7.000 s², beyond the limits" in svg
    assert "paper: R_K 0.4000 1/s, I_K 6.000 s²<" in svg
    assert "unstable" not in svg


def test_rates_over_an_envelope_are_drawn_in_per_cent_of_it_and_end_in_a_cross_at_zero():
    curves = {
        "mine": (np.array([0.0, 0.5, 1.2]), np.array([0.5, 0.3, 0.0])),
        "yours": (np.array([0.0, 2.0]), np.array([0.4, 0.1])),
    }

    chart = tuning.rate_chart(curves, Envelope.at(V_a=25.0, gamma=0.0))

    assert chart.x_range == (0.0, 200.0)
    (x, rates), cross, (x_2, _) = chart._seen
    assert x == pytest.approx([0.0, 50.0, 120.0])
    assert rates.tolist() == [0.5, 0.3, 0.0]
    assert (cross[0].tolist(), cross[1].tolist()) == ([pytest.approx(120.0)], [0.0])
    assert x_2 == pytest.approx([0.0, 200.0])
    assert [name for name, *_ in chart.legend][1:] == ["mine", "yours"]
    assert chart.legend[0][0].startswith("V_a 25..25 m/s")


def test_speed_that_has_priority_is_said_with_its_share_and_its_cost():
    t = 0.1 * np.arange(100)
    wanted = np.where((t > 1.95) & (t < 4.45), 0.1, 0.06)
    signals = {"gamma_ref": wanted, "gamma_given": np.full(100, 0.06)}
    path, route = (made_up_run(x, t) for x in (signals, signals | {"height_err": 0.3 * t}))

    (said,) = run_answers.priority_notes([path, made_up_run({"gamma_ref": [0.0]})])

    begins = "kinematic / paper: speed has priority from 2.0 s on, in 25 % of the flight;"
    assert said == f"{begins} the path angle gives way by up to {0.04 / DEG:.1f} deg."
    assert run_answers.priority_notes([route]) == [
        f"{begins} the flight is up to 3 m below the route."
    ]


def test_facts_of_a_run_end_with_its_errors_in_degrees():
    run = made_up_run({"chi_err": [0.3, 2.0 * DEG], "gamma_err": [0.3, -DEG]}, [0.0, 0.5])

    said = {row["what"]: row["value"] for row in run_answers.facts(run).records}

    assert said["errors at the end"] == "χ 2°, γ -1°"
    assert said["flown"] == "0.5 s, 2 samples"
    assert said["signals"] == "chi_err, gamma_err"
    assert said["gains"].startswith("K_P [1.6968, 0.5906; -0.5906, 1.9556], K_I [3.4869,")
    assert "feedback" not in said["gains"]
    exact = ft.PIGains.from_lists([[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 1.0]], law="exact")
    fed = replace(exact, feedback=(0.5, 0.25))
    run = replace(run, provenance=replace(run.provenance, gains=fed))
    (gains,) = (row["value"] for row in run_answers.facts(run).records if row["what"] == "gains")
    assert gains.endswith("], feedback 0.5, 0.25")


IN, OUT, ALARM = (-0.1, 0.1), (0.1, 0.2), Alarm(3.0, "turn")


@pytest.mark.parametrize(
    ("claims", "failure", "status", "summary"),
    [
        ([("counted", OUT, {})], "", 0, 0),
        ([("proven", IN, {})], "", 0, 0),
        ([("proven", OUT, {})], "kinematic / paper: the flight leaves its tube.", 1, 0),
        ([("counted", IN, {"alarm": ALARM})], "kinematic / paper: Alarm at 3.00 s: the turn", 1, 0),
        ([("proven", OUT, {"no_claim": "other air"})], "kinematic / paper: ", 2, 1),
        (
            [("counted", OUT, {"no_claim": "other air"}), ("proven", OUT, {})],
            "kinematic / paper: the flight leaves its tube.", 1, 1,
        ),
        (
            [("counted", OUT, {"no_claim": "other air", "alarm": ALARM})],
            "kinematic / paper: ", 2, 1,
        ),
    ],
)  # fmt: skip
def test_a_flight_fails_a_proof_that_it_leaves_or_an_alarm_and_no_claim_is_could_not_say(
    claims, failure, status, summary
):
    run = made_up_run({"chi_err": [0.0, 0.0]}, [0.0, 0.5])
    for kind, ends, changes in claims:
        *before, last = claimed(run, kind, "tube", chi_err=ends).claims
        run = replace(run, claims=(*before, replace(last, **changes)))

    said = run_answers.claimed([run])

    assert said.failure.startswith(failure)
    assert bool(said.failure) == bool(failure)
    assert (said.status, len(said.summary)) == (status, summary)
    rows = said.values["claims"]
    assert [row["inside"] for row in rows] == [ends is IN for _, ends, _ in claims]
    assert not set(said.summary) & set(said.notes)
    assert said.notes[-1].startswith("Claims are drawn as their files state them")
    assert "alarm" not in rows[-1]
    *before, last = run.claims
    scored = replace(run, claims=(*before, replace(last, units={"alarm_score": "1"})))
    alarm = run_answers.claimed([scored]).values["claims"][-1]["alarm"]
    assert alarm == (last.alarm and {"at_s": 3.0, "why": "turn"})
    assert run_answers.claimed([]).notes == []


def outcome(*groups):
    """A campaign of groups, each with its successes and flights."""
    rows = [{"group": name, "succeeded": n, "runs": of} for name, n, of in groups]
    succeeded, runs = (sum(row[key] for row in rows) for key in ("succeeded", "runs"))
    return CampaignOutcome(
        dataset="made_up", planned=runs, runs=runs, completed=runs, failed=0, crashed=0,
        succeeded=succeeded, statuses={"completed": runs}, flown=runs, kept=0, wall_s=1.0,
        rate_per_s=float(runs), groups=(), by_group=rows, endings=[],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("groups", "said"),
    [
        ((("a", 3, 4),), "3 of 4 flights meet every requirement."),
        ((("a", 3, 4), ("b", 6, 8)), "9 of 12 flights meet every requirement."),
        (
            (("a", 3, 4), ("b", 7, 8), ("c", 0, 0), ("d", 1, 2)),
            "11 of 14 flights meet every requirement: the largest share with b (7 of 8), the "
            "smallest with d (1 of 2).",
        ),
    ],
)
def test_groups_of_a_campaign_are_compared_by_their_shares(groups, said):
    assert campaign.succeeded_in_words(outcome(*groups)) == said


SURE = {"a": "yes", "b": "yes"}


@pytest.mark.parametrize(
    ("changes", "failure", "status", "verdict"),
    [
        ({}, "", 0, ""),
        ({"sure": SURE, "until_sure": 0.9}, "", 0, "90 %"),
        ({"sure": SURE | {"b": "no"}, "until_sure": 0.9}, "90 %", 1, ""),
        ({"sure": SURE | {"a": ""}, "until_sure": 0.9}, "90 %", 1, ""),
        (
            {"interrupted": True, "planned": 30}, "interrupted, 12 of 30 runs are in made_up",
            130, "",
        ),
        (
            {"sure": SURE | {"b": "no"}, "until_sure": 0.9, "interrupted": True, "planned": 30},
            "interrupted, 12 of 30 runs are in made_up", 130, "",
        ),
    ],
)  # fmt: skip
def test_a_campaign_fails_if_it_is_interrupted_or_a_group_does_not_surely_reach_its_share(
    changes, failure, status, verdict
):
    groups = Group("kinematic", "a"), Group("kinematic", "b")
    made = replace(outcome(("a", 3, 4), ("b", 6, 8)), groups=groups, **changes)

    said = made.answer()

    assert failure in said.failure
    assert bool(said.failure) == bool(failure)
    assert (said.status, bool(said.verdict)) == (status, bool(verdict))
    assert verdict in said.verdict
    assert said.summary[1:] == ([said.verdict] if verdict else [])
    assert ("sure" in said.values) == ("sure" in changes)
    assert said.notes[0].startswith("12 of at most" if "until_sure" in changes else "12 flights = ")
    assert said.notes[1].startswith("flown now: 12 in ")
    assert replace(made, flown=0).answer().notes[1] == "nothing was missing"


def made_up_gap(**changes):
    """Two stretches of a log and of a model whose course differs by 2 and by 3 deg."""
    t = np.array([[0.0], [20.0]]) + 0.5 * np.arange(30)
    logged = {"chi": 0.0 * t, "gamma": 0.0 * t, "phi": 0.1 + 0.0 * t, "n_z": 1.0 + 0.0 * t}
    logged["phi_cmd"] = 0.2 + 0.0 * t
    late = np.where(t - t[:, :1] > 10.0, 1.0, -1.0)  # about a mean of nearly zero
    phi = 0.1 + np.radians([[0.5], [1.5]]) + 0.0 * t
    model = logged | {"chi": np.radians([[2.0], [3.0]]) * late, "phi": phi}
    ended = {name: np.where(t > 30.0, np.nan, x) for name, x in model.items()}
    stated = {
        "log": "mine", "aircraft": "x", "t": t, "logged": logged, "explained": 0.875,
        "flights": {"kinematic": ended, "x": model, "x, explained": logged},
        "factors": {"mass": (1.25, 1.0, 1.5)}, "causes": {"mass": (0.75, 0.5), "wind": (0.25, 1.0)},
        "tracking": (), "notes": ("a note",),
    }  # fmt: skip
    return LogGap(**(stated | changes))


def test_the_gap_of_a_log_is_said_with_its_causes_and_its_worst_time():
    of_log = made_up_gap()

    said = log_gap.answer(of_log)

    assert said.verdict.startswith(
        "Mass and wind together explain 87.5 % of the difference between the log mine and the "
        "model x. The courses differ most at "
    )
    # the second stretch, whose mean from 5 s on is -0.3 deg, goes to 3 deg after its first 10 s
    assert said.verdict.endswith(" at 30.5 s, by 3.3 deg.")
    assert said.tables[0].title == "mine: rms difference in 2 stretches of 12 s"
    assert said.values == {"explained_percent": 87.5}
    assert said.notes == [
        "a note", "kinematic: 1 of 2 flights ended early, and are compared until then.",
    ]  # fmt: skip
    rungs, causes, factors, _, parts = said.tables
    assert [row["flown"] for row in rungs.records] == ["kinematic", "x", "x, explained"]
    of_x = rungs.records[1]
    assert of_x["phi"] == pytest.approx(np.radians(math.sqrt((0.5**2 + 1.5**2) / 2.0)))
    assert rungs.records[2]["chi"] == 0.0
    assert [row["from_s"] for row in parts.records] == [5.0, 25.0]
    assert [row["phi"] for row in parts.records] == pytest.approx(np.radians([0.5, 1.5]))
    shares = [(x["alone_percent"], x["without_percent"]) for x in causes.records]
    assert shares == [(75.0, 50.0), (25.0, 100.0)]
    (mass,) = factors.records
    assert (mass["value"], mass["low"], mass["high"], mass["unit"]) == (1.25, 1.0, 1.5, "1")
    one = log_gap.answer(made_up_gap(causes={"mass": (0.75, 0.5)})).verdict
    assert one.startswith("Mass explains 87.5 % of the difference")
    none = log_gap.answer(made_up_gap(causes={}, factors={})).verdict
    assert none.startswith("The log can tell no cause of the difference")


def slope(parameter, value, each, measure="chi.ITAE", why=""):
    return {"measure": measure, "parameter": parameter, "value": value, "slope": each, "why": why}


def test_slopes_are_said_for_a_tenth_of_their_parameter_with_the_largest_first():
    slopes = (
        slope("K_P", 2.0, 3.0), slope("K_I", -4.0, 2.0), slope("mass", 1.0, math.nan, why="steps"),
        slope("K_P", 2.0, 0.0, "gamma.ITAE"),
    )  # fmt: skip
    made = Gradient(
        run=made_up_run({"chi_err": [0.0, 0.0]}), slopes=slopes, at_limits_s=1.25,
        values={"chi.ITAE": 5.0, "gamma.ITAE": 0.5},
    )  # fmt: skip

    said = made.answer()

    assert said.summary == ["ITAE of course: K_I moves it most, by -0.8 rad\u00a0s² for +10 %."]
    chi, gamma = said.tables
    assert [row["per_10_percent"] for row in chi.records][:2] == pytest.approx([0.6, -0.8])
    assert [row["parameter"] for row in gamma.records] == ["K_P"]
    assert chi.title == "ITAE of course: 5 rad\u00a0s²"
    assert said.notes == [
        "Limits hold a command for 1.25 s of the flight; slopes take the samples at limits as "
        "fixed."
    ]
    assert replace(made, at_limits_s=0.0).answer().notes == []
    assert said.values["values"] == {"chi.ITAE": 5.0, "gamma.ITAE": 0.5}


@pytest.mark.parametrize(
    ("measure", "unit"),
    [
        ("chi.peak_rad", "rad"), ("chi.peak_deg", "deg"), ("chi.effort_rms", "rad"),
        ("gamma.effort_rms", ""), ("flight.n_z_max", ""), ("flight.cross_track_m", "m"),
    ],
)  # fmt: skip
def test_slopes_are_in_the_unit_of_the_name_of_their_measure(measure, unit):
    rows = (slope("K_P", 2.0, 3.0, measure),)
    run = made_up_run({"chi_err": [0.0, 0.0]})

    said = Gradient(run=run, slopes=rows, values={measure: 5.0}, at_limits_s=0.0).answer()

    assert said.tables[0].title.endswith(f": 5 {unit}".rstrip())
    assert said.summary[0].endswith(f"by 0.6 {unit}".rstrip() + " for +10 %.")


def test_planning_is_said_with_the_largest_errors_in_degrees():
    both = {
        "chi": {"unplanned": 4.0 * DEG, "planned": 1.5 * DEG},
        "gamma": {"unplanned": 2.0 * DEG, "planned": 0.25 * DEG},
    }

    assert gap.planning(SimpleNamespace(largest_errors=both)) == [
        "Planning roll and lift takes the largest error of course from 4 to 1.5 deg and that of "
        "path angle from 2 to 0.25 deg."
    ]
    assert gap.planning(SimpleNamespace(largest_errors=None)) == []


def test_the_gap_of_a_log_is_drawn_where_it_is_largest_in_degrees():
    sheet = log_gap.sheet(made_up_gap())

    chi, _, phi, load = sheet.charts
    assert [chart.y for chart in (chi, phi, load)] == ["chi [deg]", "phi [deg]", "n_z [1]"]
    times, course = chi._seen[1]
    assert (times[0], times[-1]) == (20.0, 34.5)  # the second stretch
    assert np.abs(course) == pytest.approx(np.full(30, 3.0))
    assert [name for name, *_ in phi.legend] == ["kinematic", "x", "x, explained", "command", "log"]
    assert phi._seen[3][1] == pytest.approx(np.full(30, 0.2 / DEG))
    assert load._seen[1][1] == pytest.approx(np.ones(30))


def test_a_proof_of_an_exact_rate_states_that_of_the_slowest_eigenvalue_without_sampling(certified):
    proven = certified.certificate
    slowest = -np.linalg.eigvals(ft.loop.closed_loop(proven.model, proven.gains)).real.max()

    (said,) = certificate.proven_in_words(proven)

    assert said.startswith("Proven: errors shrink as ")
    assert f"(true rate {slowest:.4g} 1/s) for the linear model. R_K" in said


@pytest.mark.parametrize(
    ("margins", "checked", "source", "verdict", "failure"),
    [
        ((0.5, 0.25), True, "c.json", "proven: ", ""),
        ((0.5, -0.25), True, "c.json", "claimed, not proven: ", "c.json: b does not hold: margin "),
        ((0.5, 0.25), False, "", "claimed, not checked: ", "it was not flown."),
    ],
)
def test_a_claim_is_valid_if_every_check_holds_and_unchecked_is_said(
    certified, margins, checked, source, verdict, failure
):
    checks = [
        Check(name=name, margin=x, exact=x > 0.0) for name, x in zip("ab", margins, strict=True)
    ]
    found = replace(Verification.of(checks), notes=("a note",))
    if not checked:
        found = replace(found, checked=False, valid=False, reason="it was not flown.")
    claim = replace(certified.certificate, files={})

    said = Verified(claim=claim, verification=found, source=source).answer()

    assert said.verdict == f"{verdict}{claim.sentence}"
    assert said.failure.startswith(failure)
    assert bool(said.failure) == bool(failure)
    assert [row["exact"] for row in said.tables[0].records] == [x > 0.0 for x in margins]
    title = f"{source}: valid: every check holds" if not failure else ""
    assert said.summary[:1] == ([f"{title}."] if title else [])
    assert bool(said.tables[0].title) == bool(failure)
    assert ("a note" in said.notes) == (not failure)
    assert said.values["valid"] == (not failure)


def test_a_proof_says_that_a_norm_decays_at_half_the_rate_of_its_square(certified):
    """With ``V = e' Q e`` and ``V' <= -rate V`` the norm, the root of V, decays at half of it."""
    proven = certified.certificate
    at_rate = replace(proven, claim=replace(proven.claim, rate=0.5), exact_rates=())

    said, *_ = certificate.proven_in_words(at_rate)

    axes = np.sqrt(np.linalg.eigvalsh(proven.Q))
    assert said == (
        f"Proven: errors shrink by exp(-0.25 t) or faster, up to a factor of "
        f"{axes[-1] / axes[0]:.3g} for the linear model. R_K, 0.5 1/s, is the rate of the squared "
        "norm."
    )
    several = replace(at_rate.claim, conditions=((25.0, 0.0), (30.0, 0.0)))
    (mixed, *_) = certificate.proven_in_words(
        replace(at_rate, claim=several, models=(MODEL, MODEL))
    )
    assert " for the linear models at 2 conditions, which its maker states as" in mixed


@pytest.mark.parametrize(
    ("metric", "contradicts", "missed", "verdict", "failure"),
    [
        ("chi.MO_rad", False, "", "no requirement is missed", ""),
        ("chi.MO_rad", False, "missed one", "missed one", ""),
        ("tube", False, "", "no requirement is missed", ""),
        ("tube", True, "", "", "the worst flight uses 1.25 of the tube: this contradicts its"),
    ],
)
def test_a_worst_flight_that_leaves_its_tube_contradicts_its_proof(
    metric, contradicts, missed, verdict, failure
):
    found = ft.WorstFlight(
        scenario=made_up_scenario(), metric=metric, value=1.25, first=1.0, flights=40, family=None,
        distance=1.0, radius=2.0, status="completed", missed=missed, plant="kinematic",
        gains="paper", drawn={"seed": 123456789, "wind.speed_mps": 2.0}, contradicts=contradicts,
    )  # fmt: skip

    said = found.answer()

    assert said.verdict == verdict
    assert said.failure.startswith(failure)
    assert bool(said.failure) == contradicts
    near = f"the worst flight uses 1.25 of the {metric}"
    assert (near in said.notes) == (metric == "tube" and not contradicts)
    assert said.tables[0].title == f"worst {metric} in 40 flights"
    # a flight is repeated with all digits of its seed
    assert [row["value"] for row in said.tables[1].records] == ["123456789", 2.0]


def test_an_adoption_is_said_with_its_glide_and_what_its_model_lacks(tmp_path):
    flown = {
        name: {"gains": name, "status": "completed", "ITAE": {"chi": 1.0, "gamma": 2.0}}
        | {"ST_deg": {"chi": 0.25, "gamma": 0.5}}
        for name in ("tuned", "paper")
    }
    part = SwitchedOff("aero/drag/flaps", ("fcs/flaps",), "drag", 0.25)
    made = adopt.Adoption(
        name="x", status="adopted", folder=tmp_path, V_a=25.4, engines=1, flown=flown,
        fit_percent={"phi": 97.0, "n_z": 95.0}, glide_ratio=12.34, seconds=61.6,
        largest_drag=("aero/drag/basic", 0.625), switched_off=(part,),
    )  # fmt: skip

    said = made.answer()

    assert said.verdict == (
        "adopted in 62 s, with a glide ratio of 12.3 at 25 m/s (62 % of the drag is "
        "aero/drag/basic), without aero/drag/flaps (with 1 up to 25 % of the drag)"
    )
    assert said.failure == ""
    assert said.files["scenario"] == tmp_path / "turn.toml"
    assert said.values["largest_drag"] == {"aero/drag/basic": 0.625}
    assert said.values["V_a_mps"] == 25.4
    (table,) = said.tables
    assert table.title == "x at 25 m/s: course of 20 deg, climb of 3 deg"
    assert [row["gains"] for row in table.records] == ["tuned", "paper"]
    assert len(said.notes) == 1
    plain = replace(
        made, status="refused", reason="it stalls", folder=None, switched_off=(), engines=0,
        glide_ratio=math.nan, largest_drag=("", math.nan),
    ).answer()  # fmt: skip
    assert plain.verdict == "refused in 62 s"
    assert plain.failure == "refused: it stalls"
    assert plain.files["scenario"] is None
    assert plain.notes == []
    assert plain.values["largest_drag"] == {}
    assert "steeper glide of 3 deg" in plain.tables[0].title
