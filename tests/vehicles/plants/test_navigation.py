"""Navigation: what an estimator leaves unknown, and flights of an autopilot that knows no more."""

import math
import re
from dataclasses import fields

import numpy as np
import pytest
from places import ROOT
from scipy.signal import welch
from scipy.spatial import cKDTree

import flighttune as ft
from flighttune.vehicles.plants.navigation import ReceiverFault

DT, V = 0.02, 25.0
G, DEG = 9.80665, math.pi / 180.0
GRADES = "rtk", "standard", "poor"
ERRORS = (
    *("V_a", "phi", "n_z", "north", "east", "h", "v_north", "v_east", "v_up"),
    *("wind_north", "wind_east", "wind_down", "acceleration"),
)
"""Columns of errors, seen minus true."""
KEYS = [x.name for x in fields(ft.loop.Navigation) if x.name not in ("seed", "fault", "inner_loop")]
ZERO = {name: 0.0 for name in KEYS if not re.search("time_constant|filter_|period", name)}
SMALL = np.finfo(float).eps * 1000.0

# EKF2_ACC_NOISE, EKF2_GYR_NOISE, EKF2_GYR_B_NOISE, EKF2_GPS_P_NOISE, EKF2_GPS_V_NOISE, EKF2_TAU_POS
ACC, GYR, GYR_B, GPS_P, GPS_V, TAU = 0.35, 0.015, 1e-3, 0.5, 0.3, 0.25
"""Relative difference from the steady state after 60 s."""


def standard(**numbers):
    return ft.loop.Navigation.of("standard", **numbers)


@pytest.mark.soak
@pytest.mark.parametrize("grade", GRADES)
def test_the_page_has_the_deviations_of_a_moment(grade):
    drawn = np.array(
        [ft.loop.Navigation.of(grade, seed=seed).errors(1, DT, V)[0] for seed in range(200)]
    )
    sd = dict(zip(ERRORS, np.std(drawn, axis=0), strict=True))
    sd |= {"phi": sd["phi"] / DEG}

    text = (ROOT / "docs/navigation.md").read_text().partition("| at a moment")[2]
    rows = [line.split("|") for line in text.partition("\n\n")[0].splitlines()[2:]]
    names = "north", "v_east", "h", "v_up", "phi", "n_z", "V_a", "wind_east"
    four_sigma = 4.0 / math.sqrt(2.0 * len(drawn))
    for name, row in zip(names, rows, strict=True):
        written = float(row[2 + GRADES.index(grade)].split()[0])
        assert sd[name] == pytest.approx(written, rel=four_sigma), name


def test_errors_are_a_function_of_their_seed_and_a_longer_flight_begins_as_a_shorter_one():
    long = standard(seed=4).errors(1000, DT, V)

    for samples in (1, 7, 333):
        assert np.array_equal(standard(seed=4).errors(samples, DT, V), long[:samples])
    louder = standard(seed=4, wind_sd=3.0).errors(1000, DT, V)
    same = [i for i, name in enumerate(ERRORS) if not name.startswith("wind")]
    assert np.array_equal(louder[:, same], long[:, same])
    assert not np.any(long == standard(seed=5).errors(1000, DT, V), axis=0)[:10].any()


@pytest.mark.parametrize(
    "pair", [("wind_north", "wind_east"), ("north", "east"), ("v_north", "v_east")]
)
def test_errors_to_the_north_and_to_the_east_are_drawn_apart(pair):
    short = {f"{name}_time_constant": 1.0 for name in ("wind", "position", "velocity")}
    drawn = standard(seed=1, position_fast_time_constant=1.0, **short).errors(20_000, DT, V)

    north, east = (drawn[:, ERRORS.index(name)] for name in pair)

    # 400 s hold 200 independent values of a time constant of 1 s
    assert abs(np.corrcoef(north, east)[0, 1]) < 5.0 / math.sqrt(200)


def test_noises_of_different_signals_are_drawn_apart():
    noise = {"roll_noise": 0.01, "n_z_noise": 0.01, "airspeed_noise": 0.1, "wind_sd": 1.0}
    drawn = standard(seed=1, **ZERO | noise, wind_time_constant=0.1).errors(20_000, DT, V)

    names = "V_a", "phi", "n_z", "acceleration", "wind_north", "wind_east"
    apart = np.corrcoef(drawn[:, [ERRORS.index(name) for name in names]].T) - np.eye(len(names))
    # 400 s hold 2000 independent values of a time constant of 0.1 s
    assert np.abs(apart).max() < 5.0 / math.sqrt(2000)


TURNS = [
    {"north_m": 0.0, "east_m": 0.0},
    {"north_m": 400.0, "east_m": 0.0},
    {"north_m": 600.0, "east_m": 400.0, "up_m": 10.0},
    {"north_m": 200.0, "east_m": 700.0, "up_m": 10.0},
]
LEG = [TURNS[0], {"north_m": 120.0, "east_m": 20.0}]
WIND = {"wind": {"speed_mps": 4.0, "from_deg": 70.0}}


FED = {
    "name": "fed", "law": "exact", "K_P": [[2.87, 0.0], [0.0, 2.51]],
    "K_I": [[1.16, 0.0], [0.0, 0.948]], "feedback": [0.43, 0.306],
}  # fmt: skip
"""About what tuning finds for this route, which takes its time."""
PLAIN = {key: x for key, x in FED.items() if key != "feedback"}


def flown(navigation=None, gains=FED, turns=TURNS, **tables):
    made = ft.load_scenario("circuit").as_dict()
    made["plant"] = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    made |= {"gains": [gains], "expect": [], "navigation": navigation, **tables}
    made["route"] |= {"waypoint": turns}
    (run,) = ft.fly(ft.scenario_from(made)).runs
    assert run.status == "completed", run.reason
    return run


SOURCES = (ROOT / "docs/navigation.md").read_text().partition("## Numbers and sources")[2]
TOLD = {
    key
    for row in re.findall(r"^\| (`.+?) \|", SOURCES, re.MULTILINE)
    for key in re.findall(r"`(\w+)`", row)
}
EXACT = {"grade": "poor"} | {
    key: 0.0 for key in TOLD if not re.search("time_constant|filter_|period", key)
}
NPFG = {"kind": "autopilot", "name": "px4", "parameters": {"NPFG_PERIOD": 10.0}}
PX4 = {"law": [NPFG], "gains": "paper"}


@pytest.mark.slow
@pytest.mark.parametrize("made_by", [{}, PX4])
def test_a_grade_scaled_to_zero_is_the_exact_flight_to_the_bit(made_by):
    exact = flown(turns=LEG, **made_by, **WIND)

    scaled = flown(EXACT | {"inner_loop": True}, turns=LEG, **made_by, **WIND).signals

    assert len(scaled) == len(exact.signals)
    for name, values in exact.signals.items():
        assert np.array_equal(scaled[name], values, equal_nan=True), name
    for name in ("chi", "n_z", "north", "h", "wind_east"):
        assert np.array_equal(scaled[f"{name}_meas"], scaled[name])


def test_what_is_seen_is_what_is_true_with_the_errors_of_its_seed():
    run = flown({"grade": "poor"}, turns=LEG, **WIND)
    signals = {name: x.to_numpy() for name, x in run.signals.items()}
    of = ft.loop.Navigation.of("poor", seed=run.provenance.seed)
    errors = dict(zip(ERRORS, of.errors(len(run.t), DT, V).T, strict=True))

    for name in ("V_a", "phi", "n_z", "north", "east", "h"):
        apart = signals[f"{name}_meas"] - signals[name]
        assert apart == pytest.approx(errors[name], abs=1e-9), name
    chi, gamma = signals["chi"][1:], signals["gamma"][1:]
    V_g = np.hypot(*(np.diff(signals[name]) for name in ("north", "east"))) / DT
    north = V_g * np.cos(chi) + errors["v_north"][1:]
    east = V_g * np.sin(chi) + errors["v_east"][1:]
    climb = V_g * np.tan(gamma) + errors["v_up"][1:]
    level = np.hypot(north, east)
    assert signals["V_g_meas"][1:] == pytest.approx(level, abs=1e-9)
    turned = np.exp(1j * signals["chi_meas"][1:])
    assert turned == pytest.approx((north + 1j * east) / level, abs=1e-9)
    assert signals["gamma_meas"][1:] == pytest.approx(np.arctan2(climb, level), abs=1e-9)
    share = DT / (of.wind_lag + DT)
    for name in ("wind_north", "wind_east", "wind_down"):
        wind, seen = signals[name], signals[f"{name}_meas"]
        expected = share * wind[1:] + (1.0 - share) * seen[:-1] + errors[name][1:]
        assert seen[0] == pytest.approx(wind[0] + errors[name][0], abs=1e-9)
        assert seen[1:] == pytest.approx(expected, abs=1e-9)


@pytest.mark.slow
def test_places_are_true_and_what_the_guidance_saw_stands_beside():
    """The distance from the track of an exact flight, which is within 0.04 m of its route."""
    track = flown().signals[["north", "east", "down"]].to_numpy()
    fine = np.column_stack(
        [np.interp(np.arange(0.0, len(track) - 1, 0.1), np.arange(len(track)), x) for x in track.T]
    )

    signals = flown({"grade": "standard"}).signals

    places = signals[["north", "east"]].to_numpy()
    distance, nearest = cKDTree(fine[:, :2]).query(places)
    within = nearest < len(fine) - 1
    assert np.abs(signals["cross_track"].to_numpy())[within] == pytest.approx(
        distance[within], abs=0.08
    )
    seen = signals[["north_meas", "east_meas"]].to_numpy()
    distance, nearest = cKDTree(fine[:, :2]).query(seen)
    within = (nearest > 100) & (nearest < len(fine) - 1)
    assert np.abs(signals["cross_track_seen"].to_numpy())[within] == pytest.approx(
        distance[within], abs=0.08
    )
    below = signals["height_err_seen"] - signals["height_err"]
    assert below.to_numpy() == pytest.approx(
        (signals["h"] - signals["h_meas"]).to_numpy(),
        abs=0.2,  # the route climbs by 1 in 40
    )
    late = signals[signals.index > 15.0]  # the error at the start is flown off
    assert np.abs(late["cross_track_seen"]).max() < 1.0 < np.abs(late["cross_track"]).max()


@pytest.mark.slow
@pytest.mark.parametrize(("gains", "feels"), [(FED, True), (PLAIN, False)])
def test_gains_that_feed_the_load_factor_back_get_the_measured_one(gains, feels):
    exact = flown(gains=gains, turns=LEG).signals
    biased = flown(EXACT | {"n_z_bias_sd": 0.1}, gains=gains, turns=LEG).signals

    assert bool(np.abs(biased["n_z_cmd"] - exact["n_z_cmd"]).max() > 0.001) is feels


@pytest.mark.soak
def test_the_emulated_px4_arrives():
    """Positions that wander by 1.5 m were differences of 1.9 m/s to it, and their differences."""
    air = WIND | {"turbulence": {"intensity": "light"}}

    runs = [flown({"grade": "standard"}, seed=seed, **PX4, **air) for seed in range(3)]

    assert max(abs(run.signals["height_err"]).max() for run in runs) < 25.0


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"grade": "exact"}, "`grade` .*'rtk', 'standard' or 'poor'"),
        ({"position_sd_m": -1.0}, "`position_sd_m` .*greater than or equal to 0"),
        ({"velocity_time_constant_s": 0.0}, "`velocity_time_constant_s` .*got 0"),
        ({"filter_height_m": 0.0}, "`filter_height_m` .*got 0"),
    ],
)
def test_numbers_that_cannot_be_used_are_refused(tables, message):
    made = ft.load_scenario("circuit").as_dict() | {"navigation": tables}

    with pytest.raises(ft.ScenarioError, match=message):
        ft.scenario_from(made)


def test_a_path_through_the_air_is_refused():
    made = ft.load_scenario("paper").as_dict() | {"navigation": {}}
    made["disturbance"] = made.get("disturbance") or {}
    made["disturbance"] |= {"path": "air", "as_wind": True}

    with pytest.raises(ft.ScenarioError, match="`navigation` must be absent with path"):
        ft.scenario_from(made)


def test_the_page_has_the_numbers_of_the_grades():
    rows = [line.split("|")[1:5] for line in SOURCES.splitlines() if line.startswith("| `")]
    written = {}
    for names, *cells in rows:
        for place, key in enumerate(re.findall(r"`(\w+)`", names)):
            name = re.sub("_(deg|mps|m|s)$", "", key)
            unit = DEG if key.endswith("_deg") or name.startswith("gyro") else 1.0
            written[name] = [float(cell.split(",")[place]) * unit for cell in cells]

    assert len(written) == 28
    for name, numbers in written.items():
        # The page has two digits.
        assert [getattr(ft.loop.Navigation.of(grade), name) for grade in GRADES] == pytest.approx(
            numbers, rel=0.02
        ), name


ALIASED = 0.03
"""Relative difference of a sampled process from the continuous one at half a radian a sample."""


def test_densities_and_deviations_are_those_of_drawn_errors():
    """Estimated over 1000 s, of processes that forget within a few seconds."""
    n, segment = 50_000, 4096
    quick = {name: 2.0 for name in KEYS if name.endswith("time_constant")}
    quick |= {"position_sd": 0.2, "height_sd": 0.2, "filter_velocity": 0.1, "filter_climb": 0.2}
    of = standard(seed=3, gyro_walk=1e-3, **quick)
    drawn = dict(zip(ERRORS, of.errors(n, DT, V).T, strict=True))
    seen = {
        "chi": drawn["v_east"] / V, "gamma": drawn["v_up"] / V, "V_a": drawn["V_a"] / V,
        "phi": drawn["phi"], "n_z": drawn["n_z"],
    }  # fmt: skip

    f, spectra = welch(np.array([*seen.values()]), fs=1.0 / DT, nperseg=segment)
    omega = math.tau * f
    densities = of.densities(omega, DT, V)

    assert densities.keys() == seen.keys()
    for low, high in ((0.5, 2.0), (2.0, 6.0), (6.0, 25.0)):
        band = (low <= omega) & (omega < high)
        sure = 5.0 / math.sqrt(2 * n // segment * np.count_nonzero(band))
        for name, spectrum in zip(seen, spectra / math.tau, strict=True):
            ratio = np.mean(spectrum[band] / densities[name][band])
            assert ratio == pytest.approx(1.0, abs=ALIASED + sure), (name, low)

    every = round(of.period / DT)
    before_fix = np.std([drawn["v_east"], drawn["v_up"]], axis=1, where=np.arange(n) % every == 9)
    across, up, airspeed = of.path_sd(DT, V)
    assert [across * V, up * V] == pytest.approx(before_fix, rel=0.15)  # of some 200 values each
    assert airspeed == pytest.approx(math.hypot(0.02, 0.3 / V, 0.2 / V))


def test_the_constant_parts_of_errors_have_their_deviations():
    """Roll, load factors, airspeed and height have constant errors; every other error is 0."""
    biases = {"roll_bias_sd": 0.02, "n_z_bias_sd": 0.05, "airspeed_scale_sd": 0.04}
    only = ZERO | biases | {"height_of_q": 0.1}
    drawn = np.array([standard(seed=i, **only).errors(3, DT, V) for i in range(24)])

    assert np.ptp(drawn, axis=1) == pytest.approx(0.0, abs=SMALL)
    sd = dict(zip(ERRORS, np.sqrt(np.mean(drawn[:, 0] ** 2, axis=0)), strict=True))
    # A pressure of rho V^2 / 2 is one of V^2 / (2 g) of height.
    wanted = {"phi": 0.02, "n_z": 0.05, "acceleration": 0.05 * G, "V_a": 0.04 * V}
    wanted |= {"h": 0.1 * V * V / (2.0 * G)}
    four_sigma = 4.0 / math.sqrt(2.0 * len(drawn))
    assert sd == pytest.approx(dict.fromkeys(ERRORS, 0.0) | wanted, rel=four_sigma, abs=SMALL)
    columns = [ERRORS.index(name) for name in ("phi", "V_a", "h")]
    twice_as_fast = standard(seed=0, **only).errors(1, DT, 2.0 * V)[0, columns]
    assert twice_as_fast == pytest.approx(drawn[0, 0, columns] * [1.0, 2.0, 4.0], rel=SMALL)


def test_a_failing_receiver_errs_by_its_jump_and_drift_from_its_time_on():
    exact = standard(seed=2)
    fault = ReceiverFault(start=0.06, course=math.radians(150.0), jump=40.0, drift=2.0)

    failed = standard(seed=2, fault=fault).errors(6, DT, V) - exact.errors(6, DT, V)

    size = np.array([0.0, 0.0, 0.0, 40.0, 40.0 + 2.0 * 0.02, 40.0 + 2.0 * 0.04])
    north, east = (ERRORS.index(name) for name in ("north", "east"))
    assert failed[:, north] == pytest.approx(-size * math.sqrt(0.75), abs=SMALL)
    assert failed[:, east] == pytest.approx(0.5 * size, abs=SMALL)
    assert not np.delete(failed, (north, east), axis=1).any()
    only = {"jump": 3.0}, {"drift": 2.0}
    jumps, drifts = (ReceiverFault(start=0.0, course=0.0, **size) for size in only)
    assert [x.errors(2, 0.5)[0].tolist() for x in (jumps, drifts)] == [[3.0, 3.0], [0.0, 1.0]]
