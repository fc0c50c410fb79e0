"""Batches of kinematic draws have the bits of flights alone, whatever is dispersed."""

import typing

import pytest
from dispersed import WIND, one_of, plan_of, tables_of, uniform
from fuzzing import marked

import flighttune as ft
from flighttune.campaigns.flying import columns
from flighttune.campaigns.flying import rows as flying
from flighttune.campaigns.planning.schema import MEASURES
from flighttune.vehicles.navigation_keys import NavigationTable

pytestmark = pytest.mark.slow

WAVE = {
    "chi_amplitude": 0.1, "chi_omega_rad_s": 1.5, "gamma_amplitude": 0.1, "gamma_omega_rad_s": 0.7,
}  # fmt: skip
# A bound below an error lets a channel end away from its reference, as these short flights do.
SUCCESS = {
    "at_most": {"chi": {"peak_deg": 18.0}, "flight": {"n_z_max": 1.3}},
    "at_least": {"chi": {"ITAE": 0.0}, "gamma": {"ITAE": 0.0}},
}
ROUNDING = 1e-12
"""Rounding in measures over a few hundred samples, in their units."""

FAR_ROUND = 1e-10
"""The same of courses up to 1000 rad, whose last bit is 1e-13 rad."""


def rows_of(plan, **probes):
    """The rows of a plan without the time flights took; with a probe all are flown alone."""
    rows = flying.rows_flown(plan, range(plan.runs), probes=probes)
    return columns.table_of(plan, rows).drop_columns(["wall_s"]).to_pylist()


def outcome(row):
    """Everything that the flight of a row decides."""
    return tuple(row[name] for name in (*columns.OUTCOME, *MEASURES))


def assert_flown_as_alone(rows, plan, rounding=ROUNDING):
    """The rows of a plan are those of flights alone, but for rounding."""
    for row, other in zip(rows, rows_of(plan, alone=lambda run, start: [0.0]), strict=True):
        for name, value in other.items():
            if isinstance(value, float):
                value = pytest.approx(value, rel=rounding, abs=rounding)
            assert row[name] == value, name


EVERYTHING = (
    uniform("flight.V_a_mps", 15.0, 40.0),
    uniform("flight.chi_deg", -170.0, 170.0),
    uniform("flight.gamma_deg", -30.0, 45.0),
    uniform("flight.phi_deg", -60.0, 60.0),
    uniform("flight.n_z", -0.5, 2.5),
    uniform("flight.g_mps2", 9.0, 10.0),
    one_of("flight.duration_s", 2.0, 2.5),
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
FED |= {"law": "exact", "feedback": [0.5, 0.3]}
# A load factor that is cut to the largest one is held by it or not as rounding has it.
HIGH = {**tables_of()["limits"], "n_z": [-2.0, 8.0]}
DISTURBED_BY = {"disturbance": WAVE, "expect": [SUCCESS]}


@pytest.mark.counts
@pytest.mark.parametrize(
    ("tables", "dispersed", "runs"),
    [
        (DISTURBED_BY, EVERYTHING, 100),
        ({**DISTURBED_BY, "sensors": {"noise_time_constant_s": 0.3}}, (*EVERYTHING, *SEEN), 100),
        ({"reference": MOVING}, MOVED, 60),
        ({**DISTURBED_BY, "law": [EXACT], "gains": ["paper"]}, EVERYTHING, 80),
        ({**DISTURBED_BY, "law": [EXACT], "gains": [FED], "limits": HIGH}, EVERYTHING, 40),
    ],
    ids=["seen as it is", "seen by sensors", "references that move", "exact law", "fed back"],
)
def test_draws_of_everything_at_once_are_flown_as_flights_alone(tables, dispersed, runs):
    plan = plan_of(tables_of(**tables), *dispersed, runs=runs)
    assert flying.batchable(plan.scenario_of(0), plan.entry(plan.groups[0]))

    rows = rows_of(plan)

    assert_flown_as_alone(rows, plan)
    assert len({outcome(row) for row in rows}) > 0.9 * plan.runs
    assert 0 < sum(row["success"] for row in rows) < plan.runs or "expect" not in tables


def test_settling_within_a_band_and_errors_within_an_envelope_are_columns_of_both():
    bounds = {"settling_s": 8.0, "band_deg": 2.0, "within": [[0, 40], [4, 2]]}
    tables = tables_of(expect=[{"at_most": {"chi": bounds}}])
    plan = plan_of(tables, uniform("flight.chi_deg", -60.0, 60.0), runs=12)

    rows = rows_of(plan)

    assert_flown_as_alone(rows, plan)
    assert len({row["chi.settling_s within 2 deg"] for row in rows}) > 3
    ratios = [row["chi.error within 40 deg, 2 deg from 4 s"] for row in rows]
    misses = ["chi.error within" in row["missed"] for row in rows]
    assert misses == [ratio > 1.0 for ratio in ratios]
    assert min(ratios) < 1.0 < max(ratios)
    assert all(row["chi.late_rad"] is not None for row in rows)


def test_draws_of_a_law_with_other_options_fly_by_their_own():
    limits = {**HIGH, "phi_deg": [-85.0, 85.0], "n_z": [-2.0, 1.5]}
    turn = {"chi_deg": 120.0, "gamma_deg": 0.0}
    tables = tables_of(law=[EXACT], gains=["paper"], expect=[], limits=limits, reference=turn)
    plan = plan_of(tables, uniform("law[0].lift_floor", 0.79, 0.95), runs=4)

    rows = rows_of(plan)

    assert_flown_as_alone(rows, plan)
    assert len({row["chi.ITAE"] for row in rows}) == plan.runs


BEYOND_1000_RAD = {"phi_deg": [-45.0, 45.0]}, 0.015, 160.0, (6.0, 10.0), 8, {"", "chi"}, FAR_ROUND


@pytest.mark.parametrize(
    ("limits", "omega", "duration", "amplitude", "runs", "reasons", "rounding"),
    [
        pytest.param({}, 1.0, 3.0, (0.0, 0.5), 10, {"", "roll"}, ROUNDING, id="some beyond 90 deg"),
        pytest.param(
            {},
            1.0,
            3.0,
            (0.0, 0.5),
            80,
            {"", "roll"},
            ROUNDING,
            id="beyond 90 deg of roll",
            marks=pytest.mark.counts,
        ),
        pytest.param(*BEYOND_1000_RAD, id="beyond 1000 rad", marks=pytest.mark.counts),
    ],
)
def test_flights_that_leave_the_law_say_so_as_flights_alone_do(
    limits, omega, duration, amplitude, runs, reasons, rounding
):
    tables = tables_of(limits=limits, disturbance={"chi_omega_rad_s": omega})
    tables["flight"]["duration_s"] = duration
    plan = plan_of(
        tables, uniform("flight.chi_deg", -120.0, 120.0), one_of("controller.rate_hz", 50.0, 32.0),
        uniform("disturbance.chi_amplitude", *amplitude), runs=runs,
    )  # fmt: skip

    rows = rows_of(plan)

    assert_flown_as_alone(rows, plan, rounding)
    assert {row["reason"].split(" ")[0] for row in rows} == reasons


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
    "navigation": NavigationTable.model_fields.keys() - {"velocity_sd_mps", "grade"},
}  # fmt: skip
"""What is not dispersed, needs an aircraft, is flown alone or drawn with another number, or is for
an airspeed to follow."""


def base(key):
    """The tables that a key stands in, so that it makes a difference."""
    tables = tables_of(gains=["paper"], disturbance=WAVE)
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
        tables["disturbance"] = {f"{channel}_amplitude": 0.1, f"{channel}_switch_s": [0.5, 1.5]}
    if key.startswith("wind."):
        tables["wind"] = WIND
    return tables


@pytest.mark.parametrize(
    "key",
    marked(
        OTHERS,
        pytest.mark.soak,
        but=("disturbance.wave", "disturbance.gamma_switch_s[0]", "navigation.velocity_sd_mps"),
    ),
)
def test_every_other_key_of_a_scenario_is_honoured_or_flown_alone(key):
    plan = plan_of(base(key), one_of(key, OTHERS[key]), runs=1)

    (row,) = rows_of(plan)

    assert_flown_as_alone([row], plan)
    (undispersed,) = rows_of(plan_of(base(key), runs=1))
    assert (outcome(row) == outcome(undispersed)) == (key in WITHOUT_EFFECT)


def test_no_key_of_a_scenario_is_left_out_of_these_tests():
    keys = [*OTHERS, *(drawn["key"] for drawn in (*EVERYTHING, *SEEN, *MOVED))]
    tops = {key.split(".")[0] for key in keys}
    assert tops == set(ft.Scenario.model_fields) - OF_OTHERS[""]
    for name in tops - {"reference"}:
        kind = ft.Scenario.model_fields[name].annotation
        (table,) = (x for x in (kind, *typing.get_args(kind)) if hasattr(x, "model_fields"))
        tried = {key.split(".")[1].split("[")[0] for key in keys if key.startswith(f"{name}.")}

        assert tried == set(table.model_fields) - OF_OTHERS.get(name, set())
