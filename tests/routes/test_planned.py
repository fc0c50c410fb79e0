"""References that roll in: their rates, the roll and lift planned for them, and what flies them."""

import math
import shutil

import numpy as np
import pytest
import tomlkit
from made_up import made_up_scenario, scenario_tables
from places import SHIPPED_AIRCRAFT
from scipy.integrate import quad

import flighttune as ft

DEG = math.pi / 180.0
G = 9.81

TURN = {"shape": "ramp", "start_s": 3.0, "duration_s": 6.0, "rate_dps": 8.0, "roll_in_s": 1.2}
CLIMB = {"shape": "ramp", "start_s": 12.0, "duration_s": 4.0, "rate_dps": 2.0, "roll_in_s": 1.0}
PULL = {"shape": "ramp", "start_s": 3.0, "duration_s": 1.0, "rate_dps": 2.0, "roll_in_s": 1.0}
LIMITS = {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 30.0, "n_z": [-2.0, 2.0], "n_z_rate_per_s": 1.0}


def turn_and_climb(plant="kinematic", **changes):
    """A turn, then a climb, both rolled in and planned."""
    tables = {
        "flight": {"duration_s": 20.0},
        "reference": {"chi_deg": [TURN], "gamma_deg": [CLIMB]},
        "controller": {"feed_forward": True},
        "plant": [plant if isinstance(plant, dict) else {"kind": plant}],
    }
    return made_up_scenario(**(tables | changes))


def largest_errors(scenario):
    """Largest errors of course and path angle, deg."""
    (run,) = ft.fly(scenario).runs
    assert run.status == "completed"
    return run.signals[["chi_err", "gamma_err"]].abs().max().to_numpy() / DEG


def reference(**ramp):
    """A ramp by 4 times 0.1 rad from 3 s on, as the reference of a scenario."""
    ramp = {"shape": "ramp", "start_s": 3.0, "duration_s": 4.0, "rate_dps": 0.1 / DEG} | ramp
    tables = {"chi_deg": [ramp], "gamma_deg": 0.0}
    return made_up_scenario(reference=tables, flight={"duration_s": 60.0}).stated_reference


def test_a_roll_in_is_the_mean_of_the_ramp_over_its_time_and_its_rate_a_trapezium():
    plain, rolled = reference(), reference(roll_in_s=1.5)
    t = np.linspace(0.0, 10.0, 41)

    def ramp(s):
        return float(plain.sampled(np.array([s]))[0][0])

    means = [quad(ramp, x - 0.75, x + 0.75, points=[3.0, 7.0])[0] / 1.5 for x in t]
    assert rolled.sampled(t)[0] == pytest.approx(means, abs=1e-8)  # of the quadrature
    after = rolled.sampled(np.linspace(7.75, 50.0, 99))[0]
    assert np.ptp(after) == 0.0  # it is at rest to the bit
    assert after[0] - rolled.initial[0] == pytest.approx(0.4)
    at = np.array([2.0, 2.25, 3.0, 3.75, 5.0, 6.25, 7.0, 7.75])
    assert rolled.rates(at)[0] == pytest.approx([0, 0, 0.05, 0.1, 0.1, 0.1, 0.05, 0], abs=1e-15)
    assert plain.rates(np.array([2.9, 3.0, 6.9, 7.0]))[0] == pytest.approx([0, 0.1, 0.1, 0])
    later = rolled.rates(at - 0.5, (0.5, 0.0))[0]
    assert later == pytest.approx(rolled.rates(at)[0])


STEP, RAMP = {"shape": "step", "start_s": 1.0}, {"shape": "ramp", "start_s": 1.0}
DOUBLET = {"shape": "doublet", "start_s": 1.0, "width_s": 2.0}
SHAPES = [
    # segment without its size, with its size, and at 0, 0.9, 1, 2.5, 3, 4.9 and 5 s; its rate
    (STEP, "change", 4.0, [0, 0, 4, 4, 4, 4, 4], [0] * 7),
    (RAMP | {"duration_s": 2.0}, "rate", 3.0, [0, 0, 0, 4.5, 6, 6, 6], [0, 0, 3, 3, 0, 0, 0]),
    (DOUBLET, "amplitude", 4.0, [0, 0, 4, 4, -4, -4, 0], [0] * 7),
]
UNITS = {"chi_deg": {"rate": "dps"}, "gamma_deg": {"rate": "dps"}, "V_mps": {"rate": "mps2"}}


@pytest.mark.parametrize("key", UNITS)
@pytest.mark.parametrize(("segment", "name", "size", "values", "rates"), SHAPES)
def test_a_segment_changes_its_channel_alone(key, segment, name, size, values, rates):
    """Two of it add; all else stays at its start."""
    unit = UNITS[key].get(name, key.partition("_")[2])
    segments = [segment | {f"{name}_{unit}": x * size} for x in (0.75, 0.25)]
    tables = {"chi_deg": 50.0, "gamma_deg": 2.0, "V_mps": 25.0} | {key: segments}
    start = {"chi_deg": 50.0, "gamma_deg": 2.0, "V_a_mps": 25.0, "duration_s": 4.95}
    made = made_up_scenario(reference=tables, flight=start, limits={"n_x": [-0.3, 0.3]})
    reference, t = made.stated_reference, np.array([0.0, 0.9, 1.0, 2.5, 3.0, 4.9, 5.0])

    chi, gamma = (x / DEG for x in reference.sampled(t))
    V, V_dot = reference.airspeed(t)
    slopes = [*(x / DEG for x in reference.rates(t)), V_dot]
    for channel, start, found, slope in zip(
        UNITS, (50, 2, 25), (chi, gamma, V), slopes, strict=True
    ):
        own = float(channel == key)
        assert found == pytest.approx(start + own * np.array(values))
        assert slope == pytest.approx(own * np.array(rates))
    assert reference.initial == pytest.approx((50 * DEG, 2 * DEG))
    stated = made.reference
    if key == "gamma_deg":
        at, steepest = stated.steepest(made.flight)
        assert steepest == pytest.approx(2.0 + max(values))
        assert 1.0 <= at <= 4.95
    if key == "V_mps":
        lowest, highest = stated.airspeeds(made.flight)
        assert (lowest, highest) == pytest.approx((25.0 + min(values), 25.0 + max(values)))


def test_the_law_alone_flies_a_planned_turn_without_an_error():
    """The paper's law turns by its roll: only what commands are held for is left."""
    chi, gamma = largest_errors(turn_and_climb())

    assert chi < 5e-3
    assert gamma < 0.03  # the load factor is that of the roll measured, a sample before


def test_behind_a_lag_the_plan_goes_ahead_by_it():
    lag = {"kind": "point_mass_lag", "roll_lag_rad_s": 5.0, "n_z_lag_rad_s": 6.0}
    unplanned = turn_and_climb(lag, controller={"feed_forward": False})

    assert largest_errors(turn_and_climb(lag)) == pytest.approx([0.0, 0.0], abs=0.35)
    assert largest_errors(unplanned)[0] > 2.0


@pytest.mark.parametrize(
    ("ramp", "message"),
    [
        (TURN | {"roll_in_s": 7.0}, "`roll_in_s` must be at most 6 s"),
        (TURN | {"start_s": 0.1}, "`roll_in_s` must be at most 0.2 s"),
        (TURN | {"roll_in_s": 0.1}, "`roll_in_s` must be at least 0.68 s, in which `phi_rate_dps`"),
        (TURN | {"rate_dps": 10.0, "roll_in_s": 0.1}, "`roll_in_s` must be at least 0.85 s"),
        (TURN | {"rate_dps": 30.0}, "`rate_dps` must lie within 22.48 deg/s .* `phi_deg`"),
        (TURN | {"rate_dps": -30.0}, "`rate_dps` must lie within -22.48 deg/s"),
        # Level flight takes 1 of the 2 up and adds 1 to the 2 down.
        (PULL | {"rate_dps": 23.0}, "`rate_dps` must lie within 22.48 deg/s .* `n_z`"),
        (PULL | {"rate_dps": -68.0}, "`rate_dps` must lie within -67.45 deg/s .* `n_z`"),
    ],
)
def test_a_roll_in_that_cannot_be_flown_is_refused(ramp, message, tmp_path):
    file = tmp_path / "turn.toml"
    channel = "gamma_deg" if "`n_z`" in message else "chi_deg"
    reference = {"chi_deg": 0.0, "gamma_deg": 0.0} | {channel: [ramp]}
    tables = scenario_tables(reference=reference, limits=LIMITS, flight={"duration_s": 20.0})
    file.write_text(tomlkit.dumps(tables))
    with pytest.raises(ft.ScenarioError, match=f"turn.toml.*{message}"):
        ft.load_scenario(file)


@pytest.mark.parametrize("rates", [[-20.0, 40.0], [-40.0, 20.0]])
def test_a_roll_in_is_as_slow_as_the_slower_side_of_its_rate(rates, tmp_path):
    file = tmp_path / "turn.toml"
    reference = {"chi_deg": [TURN | {"roll_in_s": 1.0}], "gamma_deg": 0.0}
    tables = scenario_tables(
        reference=reference, limits=LIMITS | {"phi_rate_dps": rates}, flight={"duration_s": 20.0}
    )
    file.write_text(tomlkit.dumps(tables))

    # 8 deg/s at 25 m/s take 8 / 9.81 * 25 deg of roll by its tangent, at 20 deg/s.
    with pytest.raises(ft.ScenarioError, match=r"`roll_in_s` must be at least 1\.02 s"):
        ft.load_scenario(file)


def test_an_aircraft_whose_lag_is_not_known_flies_no_plan(tmp_path):
    aircraft = tmp_path / "mine"
    shutil.copytree(SHIPPED_AIRCRAFT / "c172p", aircraft)
    (aircraft / "identified.json").unlink()
    tables = ft.load_scenario("mission").as_dict()
    tables |= {"gains": ["paper"], "expect": [], "limits": {}, "tuning": {}}
    tables["reference"] = {"chi_deg": [TURN | {"rate_dps": 3.0}], "gamma_deg": 0.0}
    tables["plant"] = [{"kind": "jsbsim", "aircraft": str(aircraft)}]
    file = tmp_path / "mission.toml"
    file.write_text(tomlkit.dumps(tables | {"flight": tables["flight"] | {"V_a_mps": 50.0}}))

    with pytest.raises(ft.ScenarioError, match=r"mission.toml: .*identified.json: must be there"):
        ft.load_scenario(file)


def test_a_law_of_ones_own_sees_the_reference_ahead():
    seen = []

    class Looks:
        dt, signals = 0.02, {}

        def __init__(self, setup):
            self.setup = setup

        def start(self, condition):
            pass

        def step(self, m, reference, t):
            chi, _ = self.setup.reference.sampled(np.array([t + 1.0]))
            seen.append((t, chi[0], reference.planned))
            return 0.0, math.cos(m.gamma)

    ft.fly(turn_and_climb(), laws={"looks": Looks})

    t, chi, planned = seen[round(5.0 / 0.02)]
    assert chi == pytest.approx((t + 1.0 - 3.0) * 8.0 * DEG)
    assert math.tan(planned[0]) == pytest.approx(8.0 * DEG * 25.0 / G)


@pytest.mark.soak
def test_gap_says_what_planning_takes_away():
    paper = {"law": "paper", "gains": ["tuned_identified"]}
    answer = ft.gap("mission", changes=paper).answer()

    planning = answer.values["planning"]["chi"]
    assert planning["planned"] < 0.3 * DEG < 6.0 * DEG < planning["unplanned"]
    assert any("Planning roll and lift takes" in note for note in answer.notes)
