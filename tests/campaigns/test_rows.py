"""Rows of runs: what `fly` says of the same flight, and the same bits however they are flown."""

import re
import typing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from dispersed import (
    AEROSONDE,
    KINEMATIC,
    TURBULENCE,
    WIND,
    one_of,
    plan_of,
    rows_of,
    tables_of,
    uniform,
)

import flighttune as ft

WAVE = {
    "chi_amplitude": 0.1, "chi_omega_rad_s": 1.5, "gamma_amplitude": 0.1, "gamma_omega_rad_s": 0.7,
}  # fmt: skip
# A bound below an error lets a channel end away from its reference, as these short flights do.
SUCCESS = {
    "at_most": {"chi": {"peak_deg": 18.0}, "flight": {"n_z_max": 1.3}},
    "at_least": {"chi": {"ITAE": 0.0}, "gamma": {"ITAE": 0.0}},
}
EVERYTHING = (
    uniform("flight.V_a_mps", 15.0, 40.0),
    uniform("flight.chi_deg", -170.0, 170.0),
    uniform("flight.gamma_deg", -30.0, 45.0),
    uniform("flight.phi_deg", -60.0, 60.0),
    uniform("flight.n_z", -0.5, 2.5),
    uniform("flight.g_mps2", 9.0, 10.0),
    one_of("flight.duration_s", 1.0, 1.5),
    uniform("reference.chi_deg", -20.0, 20.0),
    uniform("reference.gamma_deg", -20.0, 20.0),
    uniform("limits.phi_deg[1]", 20.0, 80.0),
    uniform("limits.phi_rate_dps[0]", -90.0, -10.0),
    uniform("limits.n_z[0]", -3.0, 0.0),
    uniform("limits.n_z_rate_per_s[1]", 0.5, 3.0),
    one_of("controller.rate_hz", 50.0, 100.0, 32.0),
    one_of("controller.anti_windup", "none", "conditional", "back_calculation"),
    one_of("controller.feed_forward", True, False),
    one_of("controller.schedule", True, False),
    uniform("disturbance.chi_amplitude", 0.0, 0.2),
    uniform("disturbance.gamma_omega_rad_s", 0.1, 3.0),
)
SEEN = (
    uniform("sensors.chi_bias_deg", -2.0, 2.0),
    uniform("sensors.gamma_bias_deg", -2.0, 2.0),
    uniform("sensors.V_a_bias_mps", -2.0, 2.0),
    one_of("sensors.chi_noise_sd_deg", 0.0, 0.5),
    uniform("sensors.gamma_noise_sd_deg", 0.0, 0.5),
    uniform("sensors.V_a_noise_sd_mps", 0.0, 0.5),
)
MOVING = {
    "chi_deg": [
        {"shape": "step", "start_s": 0.5, "change_deg": 20.0},
        {"shape": "ramp", "start_s": 1.0, "duration_s": 0.5, "rate_dps": 8.0},
    ],
    "gamma_deg": [{"shape": "doublet", "width_s": 0.6, "amplitude_deg": 6.0}],
}
MOVED = (
    uniform("reference.chi_deg[0].start_s", 0.0, 2.0),
    uniform("reference.chi_deg[0].change_deg", -40.0, 40.0),
    uniform("reference.chi_deg[1].rate_dps", -40.0, 40.0),
    uniform("reference.chi_deg[1].duration_s", 0.1, 1.0),
    uniform("reference.gamma_deg[0].width_s", 0.2, 1.0),
    uniform("reference.gamma_deg[0].amplitude_deg", -10.0, 10.0),
)
EXACT = {"name": "e", "kind": "exact", "braking": 0.2, "lift_floor": 0.5}
FED = {"name": "fed", "K_P": [[1.5, 0.0], [0.0, 1.3]], "K_I": [[0.8, 0.0], [0.0, 0.7]]}
BY_RATES = {**FED, "law": "exact"}
FED = {**BY_RATES, "feedback": [0.5, 0.3]}
BY_EXACT = {"law": [EXACT], "gains": [FED]}
SLOW_NOISE = {"noise_time_constant_s": 0.3}
HIGH = {**tables_of()["limits"], "n_z": [-2.0, 8.0]}
WITHIN = {"at_most": {"chi": {"settling_s": 8.0, "band_deg": 2.0, "within": [[0, 40], [4, 2]]}}}
START = uniform("flight.chi_deg", -60.0, 60.0)
TURNED = uniform("disturbance.chi_amplitude", 0.3, 0.5), uniform("flight.chi_deg", -120.0, 120.0)


def lasting(seconds, plants=(KINEMATIC,), **tables):
    made = tables_of(plants, **tables)
    made["flight"]["duration_s"] = seconds
    return made


def assert_flown_as_alone(plan, rows, draws, rounding=1e-12):
    """The rows of these draws say what `fly` says of their scenarios, but for rounding."""
    for draw in draws:
        scenario, drawn = plan.scenario_of(draw), plan.values_of(draw)
        flown = ft.fly(scenario)
        for row in rows.filter(pa.compute.equal(rows["draw"], draw)).to_pylist():
            (run,) = (
                x for x in flown.runs
                if (x.provenance.plant, x.provenance.gains_name) == (row["plant"], row["gains"])
            )  # fmt: skip
            assert (row["status"], row["reason"]) == (run.status, run.reason)
            for subject, metrics in flown.metrics_of(run).items():
                for name, value in metrics.items():
                    got = np.nan if row[f"{subject}.{name}"] is None else row[f"{subject}.{name}"]
                    assert got == pytest.approx(value, rel=rounding, abs=rounding, nan_ok=True), (
                        name
                    )
            for channel in ("chi", "gamma") if len(run.signals) > 1 else ():
                peak = np.abs(run.signals[f"{channel}_err"]).max()
                assert row[f"{channel}.peak_rad"] == pytest.approx(peak, rel=rounding)
            said = (
                [x for x in flown.claim.missed if x.startswith(f"{run.label}: ")]
                if flown.claim
                else []
            )
            assert row["missed"] == "; ".join(x.removeprefix(f"{run.label}: ") for x in said)
            assert row["success"] == (not said and run.status == "completed")
            found = flown.indicators[row["gains"]]
            assert (row["R_K"], row["I_K"], row["E_K"]) == (found.R_K, found.I_K, found.E_K)
            assert {key: row[key] for key in drawn} == drawn


@pytest.mark.soak
@pytest.mark.parametrize(
    ("tables", "dispersed", "runs", "flown"),
    [
        ({"disturbance": WAVE, "expect": [SUCCESS]}, EVERYTHING, 40, (0, 7, 19)),
        ({"disturbance": WAVE, "sensors": SLOW_NOISE}, (*EVERYTHING, *SEEN), 40, (1, 8)),
        ({"reference": MOVING}, MOVED, 40, (0, 3)),
        ({"disturbance": WAVE, "law": [EXACT], "gains": [BY_RATES]}, EVERYTHING, 40, (2, 17)),
        ({**BY_EXACT, "disturbance": WAVE, "limits": HIGH}, EVERYTHING, 30, (4, 9)),
        ({"expect": [WITHIN]}, (START,), 12, range(4)),
        ({"limits": {}, "disturbance": {"chi_omega_rad_s": 1.0}}, TURNED, 12, range(6)),
        ({"law": [EXACT], "gains": ["paper"], "limits": HIGH,
          "reference": {"chi_deg": 120.0, "gamma_deg": 0.0}},
         (uniform("law[0].lift_floor", 0.79, 0.95),), 4, range(4)),
    ],
    ids=["seen as it is", "seen by sensors", "references that move", "exact law", "fed back",
         "bands", "beyond 90 deg", "options of the law"],
)  # fmt: skip
def test_draws_of_everything_at_once_are_flown_as_flights_alone(tables, dispersed, runs, flown):
    plan = plan_of(tables_of(**tables), *dispersed, runs=runs)

    rows = rows_of(plan)

    assert_flown_as_alone(plan, rows, flown)
    assert rows["run"].to_pylist() == [*range(runs)]
    outcomes = rows.drop_columns(["run", "draw", "seed", *plan.keys]).to_pylist()
    assert len({*map(repr, outcomes)}) > 0.9 * runs or "limits" in tables


@pytest.mark.slow
def test_settling_within_a_band_and_errors_within_an_envelope_are_columns():
    rows = rows_of(plan_of(tables_of(expect=[WITHIN]), START, runs=12)).to_pylist()

    assert len({row["chi.settling_s within 2 deg"] for row in rows}) > 3
    ratios = [row["chi.error within 40 deg, 2 deg from 4 s"] for row in rows]
    misses = ["chi.error within" in row["missed"] for row in rows]
    assert misses == [ratio > 1.0 for ratio in ratios]
    assert min(ratios) < 1.0 < max(ratios)
    assert all(row["chi.late_rad"] is not None for row in rows)


@pytest.mark.slow
def test_rows_have_the_same_bits_in_another_order_and_of_any_part_of_the_plan(tmp_path):
    """Above 2000 kinematic flights the workers fly them; a flight again is of one run alone."""
    plan = plan_of(lasting(0.5), START, *SEEN, runs=2100)
    whole, part = rows_of(plan), rows_of(plan.with_runs(131))

    assert part.equals(whole.slice(0, 131))
    ft.run_campaign(plan.with_runs(40), tmp_path / "out")
    again = ft.refly(tmp_path / "out", count=40)
    assert again.equal
    assert len(again.runs) == 40
    assert [x.name for x in again.runs] == [
        f"run {run}: kinematic / {('paper', 'soft')[run % 2]}, draw {run // 2}" for run in range(40)
    ]
    assert [x.drawn for x in again.runs[::2]] == [plan.values_of(draw) for draw in range(20)]
    one = ft.refly(tmp_path / "out", 7)
    assert [x.status for x in one.runs] == ["completed"]
    assert one.flown.runs[0].provenance.gains_name == "soft"


@pytest.mark.slow
@pytest.mark.parametrize("windy", [True, False])
def test_laws_points_and_aircraft_in_one_wind_are_flown_as_flights_alone(windy, tmp_path):
    """In turbulence the law and the point mass replay what the aircraft met."""
    air = {"wind": WIND, "turbulence": TURBULENCE} if windy else {}
    drawn = [uniform("wind.from_deg", 0.0, 360.0)] if windy else []
    plants = KINEMATIC, {"kind": "point_mass"}, AEROSONDE
    bounds = {"at_most": {"chi": {"peak_deg": 21.0}, "flight": {"alpha_max_rad": 0.3}}}
    plan = plan_of(lasting(0.5, plants, expect=[bounds], **air), START, *drawn, runs=12)
    ft.run_campaign(plan, tmp_path / "out", workers=1)
    rows = ft.load(tmp_path / "out").rows()

    assert_flown_as_alone(plan, rows, range(2))
    assert ft.refly(tmp_path / "out", count=12).equal


OTHERS = {
    "flight.h_m": 1500.0,
    "flight.ground_m": 100.0,
    "flight.start": "heading",
    "controller.tracking_time_s": 0.3,
    "disturbance.chi_omega_rad_s": 2.0,
    "disturbance.gamma_amplitude": 0.13,
    "disturbance.wave": "square",
    "disturbance.chi_phase_deg": 40.0,
    "disturbance.gamma_phase_deg": 40.0,
    "disturbance.as_wind": True,
    "disturbance.path": "air",
    "disturbance.chi_switch_s[0]": 0.9,
    "disturbance.gamma_switch_s[0]": 0.9,
    "sensors.noise_time_constant_s": 0.4,
    "navigation.velocity_sd_mps": 1.5,
    "navigation.grade": "poor",
    "wind.speed_mps": 9.0,
    "wind.from_deg": 30.0,
    "wind.down_mps": 1.0,
}
"""A value, other than that of `base`, of every key that is not dispersed with everything."""

WITHOUT_EFFECT = {
    "flight.h_m", "flight.ground_m", "flight.start", "disturbance.as_wind", "disturbance.path",
}  # fmt: skip
OF_OTHERS = {
    "": {"title", "verifies", "source", "seed", "gains", "law", "tuning", "envelope", "expect",
         "assumed",
         "plant", "gust", "turbulence", "route", "turn_back"},
    "wind": {"level"},
    "limits": {"n_x", "n_x_rate_per_s"},
    "controller": {"speed_priority"},
    "navigation": None,  # the others are drawn with a grade
}  # fmt: skip
"""What is not dispersed, needs an aircraft, is flown alone or drawn with another number, or is for
an airspeed to follow."""


def base(key):
    """The tables that a key stands in, so that it makes a difference."""
    tables = lasting(1.0, gains=["paper"], disturbance=WAVE)
    tables["flight"]["V_a_mps"] = 24.0
    if key == "controller.tracking_time_s":
        tables["controller"]["anti_windup"] = "back_calculation"
        tables["limits"]["phi_deg"] = [-10.0, 10.0]
    if key == "sensors.noise_time_constant_s":
        tables["sensors"] = {"chi_noise_sd_deg": 1.0}
    if key.startswith("navigation."):
        tables["navigation"] = {"grade": "standard"}
    if key == "disturbance.path":
        tables["disturbance"] = {**WAVE, "as_wind": True}
    if key.endswith("_switch_s[0]"):
        channel = key.split(".")[1].split("_")[0]
        tables["disturbance"] = {f"{channel}_amplitude": 0.1, f"{channel}_switch_s": [0.5, 0.95]}
    if key.startswith("wind."):
        tables["wind"] = WIND
    return tables


def outcome(row):
    drawn = ("run", "draw", "plant", "gains", "seed")
    return {key: x for key, x in row.items() if key not in drawn and key not in OTHERS}


@pytest.mark.slow
@pytest.mark.parametrize("key", OTHERS)
def test_every_other_key_of_a_scenario_is_drawn_and_reaches_its_flight(key):
    plan, bare = plan_of(base(key), one_of(key, OTHERS[key]), runs=1), plan_of(base(key), runs=1)
    rows = rows_of(plan)

    assert_flown_as_alone(plan, rows, [0])
    (row,), (undispersed,) = rows.to_pylist(), rows_of(bare).to_pylist()
    assert row[key] == OTHERS[key]
    at = re.sub(r"\[0\]$", "", key).split(".")[1]
    stated = plan.scenario_of(0).as_dict()[key.split(".")[0]][at]
    assert OTHERS[key] in (stated, *(stated if isinstance(stated, list) else ()))
    assert (outcome(row) == outcome(undispersed)) == (key in WITHOUT_EFFECT)


@pytest.mark.parametrize("channel", MOVING)
def test_a_reference_of_which_one_channel_moves_is_flown_as_alone(channel):
    reference = {"chi_deg": 5.0, "gamma_deg": 2.0, channel: MOVING[channel]}
    plan = plan_of(lasting(1.5, gains=["paper"], reference=reference), START, runs=2)

    assert_flown_as_alone(plan, rows_of(plan), range(2))


def test_no_key_of_a_scenario_is_left_out_of_these_tests():
    keys = [*OTHERS, *(drawn["key"] for drawn in (*EVERYTHING, *SEEN, *MOVED))]
    tops = {key.split(".")[0] for key in keys}
    assert tops == set(ft.Scenario.model_fields) - OF_OTHERS[""]
    for name in tops - {"reference"}:
        kind = ft.Scenario.model_fields[name].annotation
        (table,) = (x for x in (kind, *typing.get_args(kind)) if hasattr(x, "model_fields"))
        tried = {key.split(".")[1].split("[")[0] for key in keys if key.startswith(f"{name}.")}

        left = OF_OTHERS.get(name, set())
        assert tried == set(table.model_fields) - (
            set(table.model_fields) - tried if left is None else left
        )


UNITS = {
    "flight.V_a_mps": "m/s", "flight.chi_deg": "deg", "flight.g_mps2": "m/s^2", "flight.h_m": "m",
    "flight.duration_s": "s", "controller.rate_hz": "1/s", "limits.phi_rate_dps[0]": "deg/s",
    "limits.n_z_rate_per_s[1]": "1/s", "disturbance.chi_amplitude": "rad/s", "flight.n_z": "1",
    "disturbance.gamma_omega_rad_s": "rad/s", "controller.anti_windup": None,
    "controller.feed_forward": None, "plant.airframe.mass_factor": "1",
}  # fmt: skip


def test_drawn_columns_have_the_type_and_unit_of_their_key(tmp_path):
    """A factor has none, whatever it multiplies."""
    drawn = [x for x in EVERYTHING if x["key"] in UNITS] + [uniform("flight.h_m", 400.0, 500.0)]
    factor = uniform("flight.V_a_mps", 0.9, 1.1, acts="multiplies")
    plan = plan_of(lasting(0.5, disturbance=WAVE), *drawn, runs=1)
    schema, of_factor = rows_of(plan).schema, rows_of(plan_of(lasting(0.5), factor, runs=1)).schema

    def unit(field):
        return field.metadata and field.metadata[b"unit"].decode()

    assert {key: unit(schema.field(key)) for key in plan.keys} == {
        key: UNITS[key] for key in plan.keys
    }
    assert unit(of_factor.field("flight.V_a_mps")) == "1"
    assert schema.field("controller.anti_windup").type == pa.string()
    assert schema.field("controller.feed_forward").type == pa.bool_()
    numbers = [x for x in schema if pa.types.is_floating(x.type)]
    assert all(unit(field) for field in numbers)
    assert unit(schema.field("chi.ITAE")) == "rad s^2"
    assert unit(schema.field("gamma.effort_rms")) == unit(schema.field("flight.n_z_max")) == "1"


ENDINGS = {"rad": "rad", "s": "s", "m": "m", "mps": "m/s"}
"""Units that a name tells; others stand in brackets behind the name, a number has none."""


def test_the_columns_in_the_documentation_are_those_of_the_rows(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "campaigns.md").read_text()
    listed = page.split("The columns, in SI")[1].split("\nA value that")[0].replace("²", "^2")
    names = {*re.findall(r"`(?:chi\.)?([\w.]+)`", listed)}

    def told(name):
        behind = re.search(rf"`(?:chi\.)?{name}`(?:, `\w+`)* \(([^)]+)\)", listed)
        ending = ENDINGS.get(name.rpartition("_")[2])
        return ending or (behind[1] if behind and len(behind[1].split()) < 3 else "1")

    ft.run_campaign(plan_of(lasting(0.5), runs=1), tmp_path / "out")
    for field in ft.load(tmp_path / "out").rows().schema:
        channel, _, short = field.name.rpartition(".")
        name = field.name if field.name in names else short
        assert name in names
        assert channel in ("", "flight", "chi", "gamma")
        if field.metadata and short != "effort_rms":  # its unit differs by channel
            assert told(name) == field.metadata[b"unit"].decode(), name
    assert "`effort_rms` (rad of `chi`, 1 of `gamma`)" in listed


POISONS = [
    *(("flight.V_a_mps", 25.0, bad) for bad in (np.nan, -3.0)),
    ("flight.gamma_deg", 10.0, np.nan),
    ("sensors.chi_noise_sd_deg", 0.5, -1.0),
    ("controller.rate_hz", 50.0, 0.0),
]


@pytest.mark.parametrize(("key", "good", "bad"), POISONS)
def test_a_drawn_value_that_is_refused_is_a_row_that_names_its_key(key, good, bad):
    drawn = one_of(key, good, bad, weights=[1.0, 0.9])

    for row in rows_of(plan_of(lasting(0.5), drawn, runs=12)).to_pylist():
        if row[key] == good:
            assert row["status"] == "completed"
            continue
        assert row["status"] == "invalid"
        assert f"`{key.split('.')[-1]}`" in row["reason"]
        assert "\n" not in row["reason"]
        assert not row["success"]
        assert row["missed"] == f"invalid: {row['reason']}"
        assert row["chi.ITAE"] is row["R_K"] is None


def test_a_bound_on_the_loop_is_in_every_row():
    bound = {"at_least": {"loop": {"phase_margin_deg": 179.0}}}
    plan = plan_of(lasting(0.5, gains=["paper", "K3"], expect=[bound]), START, runs=8)

    for row in rows_of(plan).to_pylist():
        (margin,) = re.findall(
            r"phase_margin_deg must be at least 179, got ([\d.]+)", row["missed"]
        )
        found = ft.fly(plan.scenario_of(0), gains=[row["gains"]]).claim
        assert any(f"got {margin}" in said for said in found.missed)


@pytest.mark.slow
def test_every_way_in_which_a_flight_ends_is_counted_named_and_documented(tmp_path):
    """No trim, the ground, an invalid draw, no gains and a flight that is completed."""
    tables = tables_of((AEROSONDE,), gains=["paper", "tuned"], tuning={"I_star": 1e-6})
    tables["flight"].update(gamma_deg=0.0, ground_m=0.0, duration_s=4.0)
    tables["reference"]["gamma_deg"] = -60.0
    drawn = (
        one_of("plant.throttle_max", 0.02, 1.0, weights=[1.0, 1.2]),
        one_of("flight.h_m", 20.0, 500.0, weights=[1.0, 1.2]),
        one_of("flight.V_a_mps", 25.0, 90.0, weights=[3.0, 1.0]),
    )
    plan, out = plan_of(tables, *drawn, runs=48), tmp_path / "out"
    done = ft.run_campaign(plan, out, workers=1)
    rows = ft.load(out).rows().to_pandas()
    statuses = {"no_trim", "ground_contact", "completed", "invalid", "no_gains"}

    assert plan.gain_sets["tuned"] is None
    for row in rows.to_dict("records"):
        weak, low = row["plant.throttle_max"] < 1.0, row["flight.h_m"] < 100.0
        flies = "no_trim" if weak else "ground_contact" if low else "completed"
        flies = "no_gains" if row["gains"] == "tuned" else flies
        assert row["status"] == ("invalid" if row["flight.V_a_mps"] > 80.0 else flies)
        assert row["success"] == (row["status"] == "completed")
        assert bool(row["reason"]) == (row["status"] != "completed")
        assert np.isnan(row["chi.ITAE"]) == (row["status"] in ("invalid", "no_trim", "no_gains"))
        assert np.isnan(row["R_K"]) == (row["status"] in ("invalid", "no_gains"))
    counts = rows["status"].value_counts().to_dict()
    assert {*counts} == statuses
    assert done.statuses == counts
    others = len(rows) - counts["completed"]
    assert (done.completed, done.failed, done.crashed) == (counts["completed"], others, 0)
    assert (
        sorted(x["run"] for x in done.endings)
        == rows["run"][rows["status"] != "completed"].tolist()
    )
    values = done.answer().values
    assert (values["statuses"], values["failed"]) == (counts, others)
    told = ft.report(out).answer().values["groups"]
    for group in told:
        mine = rows[rows["gains"] == group["gains"]]["status"].value_counts().to_dict()
        assert group["statuses"] == mine
        assert sum(x["count"] for x in group["reasons"]) == 24 - mine.get("completed", 0)
    page = (Path(__file__).parents[2] / "docs" / "campaigns.md").read_text()
    for status in {*statuses, "crashed", "timed_out", "diverged", "left_envelope"}:
        assert f"`{status}`" in page, status
    for group in done.by_group:
        mine = rows[rows["gains"] == group["group"].split(" / ")[1]]
        assert (group["runs"], group["completed"]) == (24, (mine["status"] == "completed").sum())
        assert group["failed"] == (mine["status"] != "completed").sum()
        assert group["succeeded"] == mine["success"].sum()
    lost = int(rows.index[rows["status"] == "no_gains"][0])
    with pytest.raises(ft.InputError, match=r"`gains` .* none for tuned"):
        ft.refly(out, lost)


@pytest.mark.slow
def test_the_scenario_of_a_run_has_gains_as_numbers_whatever_their_name(tmp_path):
    tables = lasting(0.5, gains=["tuned", "paper"], tuning={"I_star": 8.0}, expect=[
        {"gains": "tuned", "status": "completed"}, {"gains": "paper", "status": "diverged"},
    ])  # fmt: skip
    plan = plan_of(tables, START, runs=4)
    ft.run_campaign(plan, tmp_path / "out")

    (run,) = ft.refly(tmp_path / "out", 2).flown.runs

    assert run.provenance.gains_name == "tuned"
    assert run.provenance.gains == plan.gain_sets["tuned"]
    for missing in (-1, 4):
        with pytest.raises(ft.FlightTuneError, match=rf"`run` must be .*, got {missing}"):
            ft.refly(tmp_path / "out", missing)
    shorter = ft.load(tmp_path / "out").plan
    assert shorter.sha256 == replace(plan).sha256
