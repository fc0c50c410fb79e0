"""What a scenario expects is held against what was flown, and said in one line each."""

import dataclasses
import re

import numpy as np
import pytest
from made_up import made_up_run, made_up_scenario

from flighttune.flight import flown as checks
from flighttune.flight import metrics
from flighttune.outputs.answers.verdict import sentence, short

T = np.linspace(0.0, 10.0, 101)


def scenario(*expect):
    return made_up_scenario(gains=["paper", "K5"], expect=list(expect))


def flown(chi_err=0.0, n_z=1.0, gains="paper", status="completed", reason="", turn_deg=20.0):
    """A run with constant course error and load factor, whose course is to turn after 1 s."""
    columns = dict.fromkeys(
        ("gamma_err", "gamma_ref", "phi_cmd", "n_z_cmd", "phi_limited", "n_z_limited"), 0.0
    )
    columns |= {"chi_err": chi_err, "chi_ref": np.deg2rad(turn_deg) * (T >= 1.0)}
    columns |= {"n_z": n_z, "V_a": 25.0}
    return made_up_run(columns, T, gains_name=gains, status=status, reason=reason)


@pytest.mark.parametrize(
    ("bounds", "missed"),
    [
        ({"at_most": {"chi": {"peak_deg": 2.1}}}, None),
        ({"at_most": {"chi": {"peak_deg": 1.5}}},
         "chi.peak_deg must be at most 1.5, got 2 (missed by 0.5)"),
        ({"at_least": {"flight": {"n_z_min": 1.3}}},
         "flight.n_z_min must be at least 1.3, got 1.2 (missed by 0.1)"),
        ({"at_most": {"flight": {"n_z_max": 1.2}}}, None),
        ({"at_most": {"chi": {"ITAE": 1.0}}},
         "chi.ITAE must be at most 1, got 1.745 (missed by 0.745)"),
        ({"at_most": {"chi": {"settling_s": 5.0}}},
         "chi.settling_s must be at most 5, got no value"),
    ],
)  # fmt: skip
def test_a_bound_is_met_or_missed_by_so_much(bounds, missed):
    # 2 deg of error for 10 s: the integral of t |e| is 50 s^2 times 0.0349 rad.
    found = checks.check_claim(scenario(bounds), [flown(np.deg2rad(2.0), n_z=1.2)]).missed

    assert found == (() if missed is None else (f"kinematic / paper: {missed}",))


@pytest.mark.parametrize(
    ("band", "missed"),
    [
        ({}, "chi.settling_s must be at most 5, got no value: 5 % of the change is "
         "0.15 deg, errors in the last quarter of the flight reach 0.6 deg"),
        ({"band_deg": 0.5}, "chi.settling_s within 0.5 deg must be at most 5, got no "
         "value: the band is 0.5 deg, errors in the last quarter of the flight reach 0.6 deg"),
        ({"band_deg": 1.0}, None),
        ({"start_deg": 0.0}, "chi.settling_s must be at most 5, got no value: no "
         "change is commanded of which 5 % could be a band: state `band_deg` beside it"),
    ],
)  # fmt: skip
def test_a_response_that_never_settles_is_said_why_and_may_have_a_band_of_its_own(band, missed):
    start = band.pop("start_deg", 3.0)
    of = scenario({"at_most": {"chi": {"settling_s": 5.0, **band}}})
    swing = np.where(T < 1.0, start, 0.6 * np.cos(2.0 * np.pi * T))
    run = flown(np.deg2rad(swing), turn_deg=0.0)
    made = dataclasses.replace(run.provenance, scenario=of.as_dict())

    found = checks.check_claim(of, [dataclasses.replace(run, provenance=made)]).missed

    assert found == (() if missed is None else (f"kinematic / paper: {missed}",))


def test_without_a_word_a_run_must_be_completed():
    run = flown(status="left_envelope", reason="t = 3 s: too slow.")

    assert checks.check_claim(scenario(), [flown(), run]).missed == (
        "kinematic / paper: left_envelope: t = 3 s: too slow.",
    )


def test_an_end_that_was_expected_is_none_to_complain_of_and_its_absence_is():
    wanted = scenario({"gains": "paper", "status": "left_envelope"})

    ended = flown(status="left_envelope", reason="t = 3 s: too slow.")
    assert checks.check_claim(wanted, [ended]).missed == ()
    assert checks.check_claim(wanted, [flown()]).missed == (
        "kinematic / paper: completed, must be left_envelope: flown to its end",
    )
    either = scenario({"status": "completed"}, {"status": "left_envelope"})
    assert checks.check_claim(either, [flown(), ended]).missed == ()


# A step of the course by 20 deg: 4 deg are a fifth of it.
BOUND = {"at_most": {"flight": {"V_a_dev_mps": 1.0}}}


@pytest.mark.parametrize(
    ("late_deg", "expect", "missed"),
    [
        (3.9, [BOUND], None),
        (-3.9, [BOUND], None),
        (4.1, [BOUND], "at most 4 deg, got 4.1"),
        (-4.1, [BOUND], "at most 4 deg, got 4.1"),
        (20.0, [BOUND | {"status": "completed"}], "at most 4 deg, got 20"),  # a law does nothing
        (20.0, [{"status": "completed"}], None),
        (20.0, [], None),
        (20.0, [BOUND, {"at_least": {"chi": {"ST_deg": 0.0}}}], None),
        (20.0, [BOUND, {"at_least": {"gamma": {"ST_deg": 0.0}}}], "at most 4 deg, got 20"),
    ],
)
def test_a_flight_with_requirements_follows_its_reference_to_the_end(late_deg, expect, missed):
    swing = np.where(T < 7.5, 0.0, np.deg2rad(late_deg + 9.0 * np.cos(2.0 * np.pi * T / 0.5)))
    swing[0], swing[-1] = 0.0, np.deg2rad(late_deg)  # whole periods

    claim = checks.check_claim(scenario(*expect), [flown(swing)])

    said = "kinematic / paper: chi does not follow its reference to the end: the mean error there "
    assert claim.missed == (() if missed is None else (f"{said}must be {missed}",))
    if missed:
        assert claim.total.met == claim.total.requirements  # that it follows is implied
        assert short(claim).endswith("0 missed; 1 of 1 run did not follow the reference to the end")


LATE = {"end_error": np.deg2rad(3.0), "end_allowed": np.deg2rad(2.0)}
LATER = {"end_error": np.deg2rad(2.5), "end_allowed": np.deg2rad(1.0)}
SWINGING = {"held_magnitude": 0.4, "held_rate": 0.2, "swings": 3.0}
SWINGING_MORE = {"held_magnitude": 0.1, "held_rate": 0.6, "swings": 3.0}
LOWER = [BOUND, {"at_least": {"gamma": {"ST_deg": 0.0}}}]


@pytest.mark.parametrize(
    ("expect", "measured", "said"),
    [
        ([BOUND], {"chi": LATE, "gamma": LATER}, "gamma does .* at most 1 deg, got 2.5$"),
        ([BOUND], {"chi": LATER, "gamma": LATE}, "chi does .* at most 1 deg, got 2.5$"),
        ([BOUND], {"V": {"end_error": 0.4, "end_allowed": 0.1}}, "V does .* 0.1 m/s, got 0.4$"),
        (LOWER, {"chi": LATE, "gamma": LATER}, "chi does .* at most 2 deg, got 3$"),
        (LOWER, {"gamma": SWINGING}, "^$"),
        ([BOUND], {"chi": SWINGING, "gamma": SWINGING_MORE}, "n_z_cmd swings .* got 70 %$"),
        ([BOUND], {"chi": SWINGING_MORE, "gamma": SWINGING}, "phi_cmd swings .* got 70 %$"),
        ([BOUND], {"chi": SWINGING, "gamma": LATER}, "phi_cmd swings .* got 60 %$"),
        ([BOUND, {"status": "left_envelope"}], {"gamma": LATER}, "^$"),
    ],
)
def test_the_worst_of_channels_that_do_not_follow_is_said_where_no_bound_asks_for_it(
    expect, measured, said
):
    tables = scenario(*expect).expected("kinematic", "paper")

    assert re.search(said, checks.not_followed(tables, measured, calm=True))


def test_a_response_that_settles_too_late_has_no_other_reason():
    """From 2 deg the error is within 5 % of the change, 1 deg, after 4 s."""
    late = np.deg2rad(np.where(T < 5.0, 2.0 * (T >= 1.0), 0.5))

    (missed,) = checks.check_claim(
        scenario({"at_most": {"chi": {"settling_s": 3.0}}}), [flown(late)]
    ).missed

    assert missed.endswith("chi.settling_s must be at most 3, got 4 (missed by 1)")


@pytest.mark.parametrize(
    ("sense", "bound", "value", "margin"),
    [("at_least", -2.0, -3.0, 0.5), ("at_most", 4.0, 3.0, -0.25), ("at_most", 0.0, 3.0, 3.0)],
)
def test_a_margin_is_relative_to_the_size_of_its_bound(sense, bound, value, margin):
    check = checks.BoundCheck(
        run="a", subject="flight", measure="n_z_min", sense=sense, bound=bound, value=value
    )

    assert check.margin == margin


def test_envelopes_around_an_error_are_those_of_its_subject_and_run():
    of = scenario(
        {"at_most": {"chi": {"within": [[0.0, 30.0], [2.0, 1.0]], "peak_deg": 9.0}}},
        {"at_most": {"gamma": {"within": [[0.0, 5.0]]}, "flight": {"n_z_max": 2.0}}},
        {"gains": "K5", "at_most": {"chi": {"within": [[0.0, 7.0]]}}},
    )
    run = flown()
    made_by = dataclasses.replace(run.provenance, scenario=of.as_dict())
    run = dataclasses.replace(run, provenance=made_by)

    (chi,), (gamma,) = (checks.envelopes(run, signal) for signal in ("chi_err", "gamma_err"))

    # the course changes after 1 s
    assert np.rad2deg(chi) == pytest.approx(np.where(T < 3.0 - 1e-9, 30.0, 1.0))
    assert np.rad2deg(gamma) == pytest.approx(5.0)


def test_expectations_hold_for_the_runs_they_name():
    wanted = scenario({"gains": "K5", "at_most": {"chi": {"peak_deg": 1.0}}})
    off = np.deg2rad(2.0)

    assert checks.check_claim(wanted, [flown(off)]).missed == ()
    assert len(checks.check_claim(wanted, [flown(off, gains="K5")]).missed) == 1
    # gains that fly beside those that are judged may end early, where all requirements name gains
    early = [flown(gains="K5"), flown(status="left_envelope", reason="t = 3 s.")]
    assert short(checks.check_claim(wanted, early)) == "1 of 1 requirement met"
    assert [count.requirements for count in checks.check_claim(wanted, early).counts] == [1, 0]
    assert (
        len(checks.check_claim(scenario(*wanted.expect, {"status": "completed"}), early).missed)
        == 1
    )


def test_runs_that_end_early_are_no_requirements_of_the_user():
    runs = [flown(), flown(status="law_failed", reason="t = 3 s.")] * 6

    claim = checks.check_claim(scenario(), runs)
    bounded = checks.check_claim(
        scenario({"gains": "K5", "status": "completed"}), [flown(gains="K5")]
    )

    assert claim.total[:3] == (0, 0, 0)
    assert short(claim) == (
        "No requirement ([[expect]]) applies to these runs; 6 of 12 runs ended early"
    )
    assert len(claim.missed) == 6  # the exit status is that of a failure all the same
    assert short(bounded) == "1 of 1 requirement met"


MANY = {"chi": {"peak_deg": 2.1, "ITAE": 3.0, "MS_deg": 3.0, "ST_deg": 3.0, "saturation_s": 3.0}}


@pytest.mark.parametrize(
    ("expect", "run", "verdict", "told"),
    [
        ([{"at_most": MANY}], {}, "met", ("5 of 5", "chi.peak_deg", "2.1")),
        ([{"at_most": {"chi": {"ITAE": 1.8}, "gamma": {"peak_deg": 1.0}}}], {}, "met",
         ("2 of 2", "chi.ITAE", "1.745")),
        ([{"at_most": {"flight": {"n_z_max": 1.232}}}], {"n_z": 1.2344}, "not met",
         ("0 of 1 requirement met", "n_z_max", "1.232", "1.234", "0.0024")),
        ([{"status": "left_envelope"}], {"status": "left_envelope"}, "met",
         ("1 of 1 requirement",)),
        # 2 deg is above a lower bound of 1 deg by once the bound, and 1 deg below one of 3 deg
        ([{"at_least": {"chi": {"peak_deg": 1.0}}}], {}, "met",
         ("1 of 1 requirement met; 1 asks for a slow or poor flight. Tightest: ",
          "chi.peak_deg must be at least 1, got 2")),
        ([{"at_most": {"chi": {"peak_deg": 3.0}}, "at_least": {"chi": {"peak_deg": 1.0}}}], {},
         "met", ("2 of 2 requirements met. Tightest",)),
        ([{"at_least": {"flight": {"n_z_max": 0.5}}}], {}, "met",
         ("1 of 1 requirement met. Tightest",)),
        ([{"at_least": {"chi": {"peak_deg": 3.0}}}], {}, "not met",
         ("0 of 1 requirement met", "chi.peak_deg must be at least 3, got 2 (missed by 1)")),
        ([], {}, "not tested", ("[[expect]]",)),
        ([], {"status": "crashed", "reason": "t = 3 s"}, "not tested",
         ("No requirement ([[expect]])", "; 1 of 1 run ended early. ", "t = 3 s")),
        ([{"at_most": {"chi": {"peak_deg": 3.0}}}], {"status": "crashed", "reason": "t = 3 s"},
         "not met", ("0 of 1 requirement met, 0 missed, 1 not flown; 1 of 1 run ended early",)),
    ],
)  # fmt: skip
def test_a_claim_is_met_or_not_in_one_sentence(expect, run, verdict, told):
    # 2 deg of error for 10 s: the integral of t |e| is 50 s^2 times 0.034907 rad, 1.74533.
    found = checks.check_claim(scenario(*expect), [flown(np.deg2rad(2.0), **run)])

    assert found.verdict == verdict
    assert sentence(found).startswith(short(found))
    assert all(part in sentence(found) for part in told), sentence(found)


def test_a_verdict_has_the_first_missed_requirement_and_counts_runs_in_words():
    run, other = flown(np.deg2rad(2.0)), flown(np.deg2rad(2.0), gains="K5")
    twice = scenario({"at_most": {"chi": {"peak_deg": 1.0, "ITAE": 0.1}}})

    claim = checks.check_claim(twice, [run])

    first, second = claim.missed
    assert sentence(claim) == f"0 of 2 requirements met, 2 missed. {first}"
    assert second not in sentence(claim)
    untested = "No requirement ([[expect]]) applies to these runs"
    assert short(checks.check_claim(scenario(), [run])) == f"{untested}; 1 of 1 run completed"
    both = checks.check_claim(scenario(), [run, other])
    assert short(both) == f"{untested}; 2 of 2 runs completed"
    late = np.where(T < 7.5, 0.0, np.deg2rad(20.0))  # neither follows to the end
    lost = [flown(late), flown(late, gains="K5")]
    said = short(checks.check_claim(scenario(BOUND), lost))
    assert said.endswith("; 2 of 2 runs did not follow the reference to the end")


@pytest.mark.parametrize(
    ("expect", "counts"),
    [
        # K5's flight ends early: alone, with two bounds on all runs, with the stated end of it
        ([], (0, 0, 0, 1)),
        ([{"at_most": {"chi": {"peak_deg": 2.1, "ITAE": 1.0}}}], (4, 1, 2, 1)),
        ([{"gains": "K5", "status": "left_envelope", "at_most": {"chi": {"ITAE": 1.0}}}],
         (2, 0, 1, 0)),
    ],
)  # fmt: skip
def test_every_requirement_is_met_or_missed_or_was_not_flown(expect, counts):
    runs = [flown(np.deg2rad(2.0)), flown(gains="K5", status="diverged", reason="t = 0 s.")]

    claim = checks.check_claim(scenario(*expect), runs)

    assert claim.total == (*counts, 0)
    assert (f", {counts[2]} not flown" in short(claim)) == (counts[2] > 0)
    assert short(claim).endswith("; 1 of 2 runs ended early") == (counts[3] > 0)
    assert [check.flown for check in claim.bounds] == [
        check.run == runs[0].label for check in claim.bounds
    ]


def test_a_bound_above_a_measure_of_one_run_is_none_of_another():
    """Of both bounds of a, the lower is no poor one; b has no other."""
    bounds = tuple(
        checks.BoundCheck(
            run=run, subject="chi", measure="MO_deg", sense=sense, bound=2.0, value=2.0
        )
        for run, sense in (("a", "at_least"), ("a", "at_most"), ("b", "at_least"))
    )
    counts = checks.Counts(requirements=2, met=2), checks.Counts(requirements=1, met=1)
    claim = checks.ClaimCheck(verdict="met", counts=counts, bounds=bounds, missed=())

    assert [check.run for check in claim.lower] == ["b"]
    assert short(claim) == "3 of 3 requirements met; 1 asks for a slow or poor flight"


@pytest.mark.parametrize("step_s", [1.0, 8.5])
@pytest.mark.parametrize("given_deg", [0.0, -6.0])
def test_the_error_at_the_end_is_that_of_the_last_quarter_or_since_the_last_change(
    step_s, given_deg
):
    """Against the path angle that the law is given, where thrust is short."""
    begin = max(step_s, 7.5)
    ref = np.deg2rad(20.0) * (T >= step_s)
    err = np.deg2rad(np.where(begin <= T, 0.7 - given_deg, 5.0 * (T > 0.0)))
    run = flown()
    run = dataclasses.replace(run, signals=run.signals.assign(gamma_ref=ref, gamma_err=err))
    if given_deg:
        signals = run.signals.assign(gamma_given=ref + np.deg2rad(given_deg))
        run = dataclasses.replace(run, signals=signals)

    gamma = metrics.measures(run)["gamma"]

    # Means of samples and of the time differ by half a sample at each end.
    assert gamma["end_error"] == pytest.approx(np.deg2rad(0.7), abs=np.deg2rad(0.1))
    assert gamma["end_allowed"] == pytest.approx(0.2 * np.deg2rad(20.0))


def test_measures_are_of_the_flights_that_were_flown_and_not_of_logs():
    one, short, real = flown(), flown(gains="K5"), flown(gains="K1")
    short = dataclasses.replace(short, signals=short.signals.iloc[:1])
    of_a_log = dataclasses.replace(real.provenance, scenario={"log": {"file": "flight.ulg"}})
    real = dataclasses.replace(real, provenance=of_a_log)

    channels, flights = metrics.metric_tables([one, short, real])

    assert {*channels.index.get_level_values("run")} == {*flights.index} == {"kinematic / paper"}
    assert all(len(table) == 0 for table in metrics.metric_tables([short, real]))
