"""Charts and tables of runs hold the numbers of the runs, their bounds and their limits."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from claimed import claimed
from made_up import made_up_run, made_up_scenario, scenario_tables

import flighttune as ft
from flighttune.claims.linear_loop import LinearBound
from flighttune.flight.flown import check_claim
from flighttune.outputs.drawing.chart import DASHED, DOTTED
from flighttune.outputs.drawing.palette import LIMIT, NEUTRAL, LineStyle
from flighttune.outputs.pages import panels
from tests.outputs.drawing.test_chart import SVG
from tests.outputs.drawing.test_chart import drawn as tree_of

LINE = LineStyle("#1F78B4", "blue", 2.0, dashed=False)
OTHER = LineStyle("#33A02C", "green", 2.0, dashed=False)
T = 0.1 * np.arange(41)
DEGREES = 180.0 / np.pi


def owned(chart, run):
    """Marks of a run in a chart, in the order of drawing."""
    return [one for one in tree_of(chart).iter(f"{SVG}path") if one.get("data-run") == run]


def test_the_size_of_the_error_is_drawn_with_its_bound_and_the_ultimate_radius_of_its_run():
    still = {"phi": 0.0 * T}
    slow, fast, other = (
        made_up_run(still, T, gains_name=name, plant=plant)
        for name, plant in (("slow", "kinematic"), ("fast", "kinematic"), ("slow", "point_mass"))
    )
    long = made_up_run({"phi": np.zeros(61)}, 0.1 * np.arange(61), gains_name="slow", plant="long")
    decay = np.exp(-T)
    bounds = {
        slow.label: LinearBound(T, 0.5 * decay, decay, 0.25),
        fast.label: LinearBound(T, 1e-7 * decay, 2.0 * decay, 0.0),
        long.label: LinearBound(T, 0.4 * decay, 0.8 * decay, 0.03),
    }
    flights = [(slow, LINE), (fast, LINE), (other, LINE), (long, OTHER)]

    first, second = panels.certificate_panels(flights, bounds)

    assert [x.title.split(":")[0] for x in (first, second)] == ["slow", "fast"]
    assert (first.x_range, second.x_range) == ((0.0, pytest.approx(6.0)), (0.0, pytest.approx(4.0)))
    assert (first.log, first.linked) == ("y", True)
    values = [y for _, y in first._seen]
    expected = 0.5 * decay, decay, [0.25], 0.4 * decay, 0.8 * decay, [0.03]
    for value, wanted in zip(values, expected, strict=True):
        assert value == pytest.approx(np.array(wanted))
    size, bound, radius = owned(first, slow.label)
    assert [x.get("stroke-dasharray") for x in (size, bound, radius)] == [None, DASHED, DOTTED]
    assert [y for _, y in second._seen][1] == pytest.approx(2.0 * decay)
    assert len(second._seen) == 2  # without a disturbance the loop comes to rest
    assert second.y_range[0] == 1e-4  # what is less is rounding
    assert first.y_range[0] == pytest.approx(0.4 * np.exp(-4.0), rel=0.3)
    assert second.y_range[1] > 2.0


def test_a_tube_is_in_the_colour_of_its_run_and_a_counted_band_grey_with_dotted_edges():
    signals = {"chi_err": 0.1 * np.sin(T), "gamma_err": 0.0 * T}
    run = made_up_run(signals, T)
    proven = claimed(run, kind="proven", title="tube", chi_err=(-0.1, 0.3))
    counted = claimed(proven, chi_err=(-0.2, 0.4))

    chart, other = panels.errors([(counted, LINE)])

    assert chart.legend == [("tube", LINE.colour, "band"), ("counted band", NEUTRAL, "band")]
    ends = [float(y[0]) * np.pi / 180.0 for _, y in chart._seen]
    assert ends == pytest.approx([0.0, -0.1, 0.3, -0.2, 0.4, -0.2, 0.4, 0.0])
    assert [x.get("stroke-dasharray") for x in owned(chart, run.label)] == [
        None, None, DOTTED, DOTTED, None
    ]  # fmt: skip
    assert (chart.y, other.y) == ("e_χ [deg]", "e_γ [deg]")
    assert chart._seen[-1][1] == pytest.approx(DEGREES * signals["chi_err"])
    assert other.legend == []


def test_a_required_envelope_stands_on_both_sides_but_not_far_beyond_the_errors():
    """A bound is drawn up to twice the largest error, and the least of its bounds always is."""
    expect = [
        {"at_most": {"chi": {"within": [[0, 40], [1, 15], [2, 5]]}}},
        {"at_most": {"gamma": {"within": [[0, 20], [1, 12], [2, 8]]}}},
        {"at_most": {"chi": {"within": [[0, 1]]}}, "plant": "jsbsim:aerosonde"},
    ]
    signals = {
        "chi": 0.0 * T, "chi_ref": 0.0 * T, "chi_err": np.radians(np.where(T < 2.0, -10.0, 1.0)),
        "gamma": 0.0 * T, "gamma_ref": 0.0 * T, "gamma_err": np.full(41, np.radians(1.0)),
        "phi": 0.0 * T, "n_z": 0.0 * T, "V_a": 0.0 * T,
    }  # fmt: skip
    run = made_up_run(signals, T, scenario=scenario_tables(expect=expect))

    course, path_angle = panels.errors([(run, LINE), (run, LINE)])

    for chart, then, last in ((course, 15.0, 5.0), (path_angle, 12.0, 8.0)):
        bound = np.repeat([np.nan, then, last], [10, 10, 21])
        assert [y for _, y in chart._seen[1:5]] == [
            pytest.approx(side * bound, nan_ok=True) for side in (-1.0, 1.0, -1.0, 1.0)
        ]
        assert chart.legend == [("required envelope", LIMIT, DASHED)]


def test_limits_of_a_command_are_drawn_at_their_values_and_a_claim_beside_the_errors_alone():
    scenario = {"limits": {"phi_deg": [-45.0, 30.0], "n_z": [0.5, 2.0]}}
    names = ("phi", "n_z", "phi_cmd", "n_z_cmd", "phi_limited", "n_z_limited")
    run = made_up_run(dict.fromkeys(names, 0.1 + 0.0 * T), T, scenario=scenario)

    roll, load = panels.flown_signals([(run, LINE)])
    assert [float(y[0]) for _, y in roll._seen] == [-45.0, 30.0, pytest.approx(0.1 * DEGREES)]
    assert [float(y[0]) for _, y in load._seen] == [0.5, 2.0, pytest.approx(0.1)]
    without = made_up_run({"phi": 0.0 * T}, T)
    assert [x.title for x in panels.commands([(run, LINE)])] == [
        "Roll command; limits dashed, bars: limited",
        "Load-factor command; limits dashed, bars: limited",
    ]
    assert panels.commands([(run, LINE), (without, OTHER)]) == []


def test_references_are_drawn_where_a_run_has_them():
    """The log of a real flight may lack them."""
    turn = {"chi": T, "chi_ref": 0.5 + 0.0 * T, "gamma": 0.0 * T}

    before = {name: signal[:20] for name, signal in turn.items()}
    flights = [(made_up_run(x, T[: len(x["chi"])]), LINE) for x in (before, turn, {"chi": T})]

    (chart,) = panels.tracking(flights)

    assert chart.title == "Course; reference grey"
    ends = [(float(x[-1]), float(np.radians(y[-1]))) for x, y in chart._seen]
    assert ends == [pytest.approx(end) for end in ((4.0, 0.5), (1.9, 1.9), (4.0, 4.0), (4.0, 4.0))]
    assert panels.errors(flights) == []
    both = [*flights, (made_up_run({"chi_err": T}, T), LINE)]
    (error,) = panels.errors(both)
    assert len(error._seen) == 2
    claims = (
        claimed(made_up_run({"V_a": 25.0 + T}, T), V_a=(24.0, 30.0)),
        made_up_run({"V_a": T}, T),
    )
    (speed,) = panels.errors([(run, LINE) for run in claims])
    assert min(float(np.nanmin(y)) for _, y in speed._seen) == 24.0


def test_paths_are_drawn_to_the_end_of_the_longest_flight_on_equal_scales():
    flights = [
        (made_up_run({"north": t, "east": t, "down": t}, t), LINE) for t in (T[:20], T, T[:30])
    ]

    above, height = panels.paths(flights)

    assert (above.equal, height.equal) == (True, False)
    assert height.x_range == (0.0, pytest.approx(4.0))
    assert [len(x) for x, _ in height._seen] == [20, 41, 30]


def test_a_flight_is_said_in_words():
    tables = {
        "flight": {"V_a_mps": 25.0, "chi_deg": 10.0, "gamma_deg": 5.0},
        "reference": {"chi_deg": 60.0, "gamma_deg": 15.0},
    }
    law = made_up_run({}, [], plant="kinematic")
    unknown = made_up_run({}, [], plant="jsbsim:nobodys")

    said = panels.flown_in_words(made_up_scenario(**tables), [law, law])

    assert said.startswith("Guidance law: at ")
    assert "25 m/s" in said
    assert said.endswith(", the course goes from 10° to 60° and the path angle from 5° to 15°.")
    craft = [made_up_run({}, [], plant=plant) for plant in ("jsbsim:c172p", "jsbsim:nobodys")]
    both = panels.flown_in_words(made_up_scenario(**tables), [law, *craft, *craft])
    assert re.match("Cessna 172P[^;]*; nobodys: at ", both)
    route = {"waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 900.0, 1800.0)]}
    assert panels.flown_in_words(
        ft.load_scenario("circuit", changes={"route": route}), [law]
    ).endswith(", 3 waypoints.")
    level = {**tables, "reference": {"chi_deg": 10.0, "gamma_deg": 15.0}}
    assert panels.flown_in_words(made_up_scenario(**level), [unknown]).endswith(
        ", the course stays at 10° and the path angle goes from 5° to 15°."
    )


def run_of(errors, t=T, **made):
    """A run with these errors of course and path angle from a reference of zero, rad."""
    names = ("chi", "gamma", "chi_ref", "gamma_ref", "phi", "n_z", "phi_cmd", "n_z_cmd")
    signals = dict.fromkeys((*names, "phi_limited", "n_z_limited"), 0.0 * t)
    signals |= {f"{name}_err": error for name, error in zip(("chi", "gamma"), errors, strict=True)}
    signals |= {"chi": -errors[0], "gamma": -errors[1], "V_a": 25.0 + 0.0 * t}
    return made_up_run(signals, t, **made)


def test_the_end_of_each_run_is_told_with_its_requirements_and_largest_errors():
    expect = [
        {"at_most": {"chi": {"peak_rad": 0.6}}, "at_least": {"gamma": {"peak_rad": 0.2}}},
        {"at_most": {"gamma": {"peak_rad": 0.05}}, "gains": "K1"},
    ]
    tables = scenario_tables(expect=expect, gains=["paper", "K1"])
    calm, wild = (0.5 * np.exp(-3.0 * T) for _ in range(2))
    late = np.where(T > 3.5, -0.1, wild)
    runs = [
        run_of((calm, 0.2 * calm), scenario=tables),
        run_of((late, 0.2 * calm), scenario=tables, gains_name="K1"),
        run_of(
            (calm, calm), scenario=tables, status="left_envelope", reason="stall",
            plant="point_mass",
        ),
        made_up_run({}, [], scenario=tables, status="no_gains", reason="none", plant="none"),
    ]  # fmt: skip

    table = panels.convergence_table(runs, check_claim(ft.scenario_from(tables), runs))

    first, second, third, fourth = table.records
    assert [x["converges"] for x in table.records] == [True, False, False, False]
    assert [x["flight"] for x in table.records] == [
        "converges", "does not converge", "left envelope at 4.0 s", "no gains"
    ]  # fmt: skip
    assert [x["requirements"] for x in table.records] == [
        "1 of 2 met (1 lower bound)", "1 of 3 met", "not flown", "not flown"
    ]  # fmt: skip
    assert second["residual"]["chi"] == 0.1
    assert first["residual"]["chi"] == pytest.approx(0.5 * np.exp(-9.0))
    assert first["chi"]["ITAE"] == pytest.approx(5.0 * first["gamma"]["ITAE"])
    assert set(fourth) == {"run", "converges", "flight", "requirements"}
    assert third["run"] == "point_mass / paper"


def test_a_flight_along_a_route_arrives_however_far_it_was_off_its_reference():
    tables = scenario_tables()
    run = run_of((0.5 + 0.0 * T, 0.0 * T), scenario=tables)
    along = dict.fromkeys(("along", "cross_track", "height_err"), 2.0 + 0.0 * T)
    route = replace(run, signals=run.signals.assign(**along))
    claim = check_claim(ft.scenario_from(tables), [route])

    table, plain = (panels.convergence_table([x], claim) for x in (route, run))

    (record,) = table.records
    assert (record["flight"], record["converges"]) == ("arrives", True)
    assert record["cross_track_m"] == pytest.approx(2.0)
    keys = ["run", "flight", "requirements", "cross_track_m", "height_err_m", "V_a_dev_mps"]
    assert [column.key for column in table.columns] == keys
    assert "cross_track_m" not in [column.key for column in plain.columns]
    assert plain.records[0]["flight"] == "does not converge"


def test_tracking_has_a_row_of_each_channel_and_the_provenance_its_times_and_its_seed():
    """Each of the runs took 0.3 s."""
    decay = 0.5 * np.exp(-3.0 * T)
    runs = [run_of((x, 0.2 * x), versions={"jsbsim": "9.9"}) for x in (decay, 2.0 * decay)]

    rows = panels.tracking_table(runs).records
    facts = panels.provenance_table("here", made_up_scenario(), runs).records

    assert [row["channel"] for row in rows] == ["χ", "γ"] * 2
    means = [row["ITAE_mean"] for row in rows]
    assert np.divide(means, means[0]) == pytest.approx([1.0, 0.2, 2.0, 0.4])
    said = {name: value for row in facts for name, value in [[*row.values()][:2]]}
    assert said["time to fly"] == "0.60 s"
    assert said["seed"] == "7"
    assert said["flown with"] == "jsbsim 9.9"
    assert said["runs from"] == "here"
    assert said["scenario, SHA-256"] == made_up_scenario().sha256


def test_an_aircraft_is_compared_with_the_first_law_of_its_gains():
    """Both fly north; the second law and the aircraft lie to the east of the first."""

    def flown(east, **made):
        places = {"north": 10.0 * T, "east": east, "down": 0.0 * T}
        return made_up_run(places, T, **made)

    aside = 3.0 * T * (T <= 3.0)
    runs = [
        flown(0.0 * T), flown(7.0 + 0.0 * T, plant="point_mass"),
        flown(5.0 + 0.0 * T, gains_name="K1"), flown(aside, plant="jsbsim:aerosonde"),
        flown(5.0 - aside, plant="jsbsim:c172p", gains_name="K1"),
        flown(aside, plant="jsbsim:aerosonde", gains_name="alone"),
    ]  # fmt: skip

    rows = panels.paths_table(runs).records

    told = [[row[key] for key in ("gains", "from", "to")] for row in rows]
    assert told == [["paper", "kinematic", "jsbsim:aerosonde"], ["K1", "kinematic", "jsbsim:c172p"]]
    for row in rows:
        assert (row["max_distance_m"], row["max_distance_at_s"]) == pytest.approx((9.0, 3.0))


@pytest.mark.slow
def test_tables_of_gains_have_the_indicators_and_certificates_of_their_own_row():
    other = ft.PIGains(K_P=np.diag([1.7, 2.1]), K_I=np.diag([0.6, 0.9]))
    sets = {"paper": ft.PAPER_GAINS, "other": other}
    model = ft.loop.kinematic_model(V_a=25.0, gamma=0.0, g=9.81)
    found = {
        name: ft.loop.indicators(ft.loop.closed_loop(model, gains)) for name, gains in sets.items()
    }
    keys = ("R_K", "I_K", "E_K")
    curve = pd.DataFrame(
        [{"name": name, **{key: getattr(x, key) for key in keys}} for name, x in found.items()]
    )

    rows = panels.gains_table(sets, curve).records
    proofs = panels.certificates_table(made_up_scenario(), sets).records

    for row, proof, (name, gains) in zip(rows, proofs, sets.items(), strict=True):
        assert (row["gains"], proof["gains"]) == (name, name)
        assert [row[key] for key in keys] == [getattr(found[name], key) for key in keys]
        assert row["K_I"] == gains.K_I.tolist()
        assert proof["rate"] == pytest.approx(found[name].R_K, rel=1e-3)
        assert proof["envelope_rate"] is None
        assert proof["status"].startswith("certified")
    ranges = {"V_a_mps": [24.0, 26.0], "gamma_deg": [-2.0, 2.0], "phi_deg": [-2.0, 2.0]}
    ranges["n_z"] = [0.99, 1.01]
    wide = made_up_scenario(envelope=ranges, tuning={"model": "kinematic"})
    (over,) = panels.certificates_table(wide, {"paper": ft.PAPER_GAINS}).records
    assert 0.0 < over["envelope_rate"] < over["rate"]
