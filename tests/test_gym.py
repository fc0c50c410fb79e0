"""Scenarios, campaigns and routes as environments of Gymnasium."""

import math
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from fuzzing import slow
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

import flighttune as ft

# A corridor in which the law flies a leg, a turn of 73 deg and a leg, m.
CORRIDOR_M = 1.0


FED = "exact:tuned_fed_back"
SOFT = {
    "name": "soft", "law": "exact", "K_P": [[2.87, 0.0], [0.0, 2.51]],
    "K_I": [[1.16, 0.0], [0.0, 0.948]], "feedback": [0.43, 0.306],
}  # fmt: skip
"""About what tuning finds for the circuit, which takes its time."""


def route_of(waypoints, **flight):
    """The first legs of the circuit, with gains as numbers: tuning depends on the seed."""
    tables = ft.load_scenario("circuit").as_dict()
    tables["gains"] = [SOFT]
    tables["route"]["waypoint"] = tables["route"]["waypoint"][:waypoints]
    tables["flight"] |= flight
    return ft.scenario_from(tables)


def calm_legs():
    """Two legs, flown in wind and off the nominal as the shipped campaign draws them."""
    campaign = ft.load_campaign("circuit_in_wind", route_of(3))
    return campaign.model_copy(
        update={
            key: getattr(campaign, key).model_copy(update={"turbulence": None})
            for key in ("nominal", "central")
        }
    )


def flown_by_the_law(env, **reset):
    """Observations, rewards and the last step of a flight under the actions of the law."""
    obs, info = env.reset(**reset)
    observations, rewards, ended = [obs], [], False
    while not ended:
        obs, reward, terminated, truncated, last = env.step(env.baseline(obs))
        observations.append(obs)
        rewards.append(reward)
        ended = terminated or truncated
    return np.array(observations), np.array(rewards), (info, terminated, truncated, last)


@pytest.mark.soak
def test_the_law_has_gains_tuned_for_the_aircraft_where_others_are_listed_before():
    both = ft.load_scenario("circuit", changes={"gains": ["paper", "tuned_fed_back"]})
    actions = {}
    for gains in (None, FED, "exact:paper"):
        env = ft.gym.FlightEnv(both, gains=gains)
        obs, _ = env.reset(seed=1)
        actions[gains] = env.baseline(obs).tolist()
    assert actions[None] == actions[FED] != actions["exact:paper"]


@pytest.mark.parametrize("world", ["mission", *slow("speed_change_in_turn")])
def test_it_keeps_the_rules_of_gymnasium(world):
    with warnings.catch_warnings():
        # commands are in their units, and no error of a flight has a bound
        warnings.filterwarnings("ignore", message=".*(symmetric and normalized|infinity).*")
        check_env(ft.gym.FlightEnv(world), skip_render_check=True)


@pytest.mark.parametrize("world", ["level_turn", "mission"])
def test_gymnasium_makes_it_scaled_without_a_warning_of_its_checker(world):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make("flighttune.gym:flighttune/Flight-v0", world=world)
        check_env(env.unwrapped, skip_render_check=True)

    assert (env.action_space.low == -1.0).all()
    assert (env.observation_space.high == 1.0).all()


def test_a_scaled_flight_under_the_law_is_the_one_in_units():
    units, scaled = ft.gym.FlightEnv("level_turn"), ft.gym.FlightEnv("level_turn", scaled=True)
    seen, rewards, _ = flown_by_the_law(units, seed=5)
    shares, shared_rewards, _ = flown_by_the_law(scaled, seed=5)

    def of(values, name):
        return values[:, units.observed.index(name)]

    # rounding of a command to a share of its range and back
    assert shared_rewards == pytest.approx(rewards, abs=1e-9)
    assert np.abs(shares).max() <= 1.0
    assert of(shares, "chi_err") * np.pi == pytest.approx(of(seen, "chi_err"), abs=1e-9)
    assert of(shares, "V_a") * 2.0 * 25.0 == pytest.approx(of(seen, "V_a"), abs=1e-7)
    phi_max = np.deg2rad(units.scenario.limits.phi_deg[1])
    assert of(shares, "phi_cmd") * phi_max == pytest.approx(of(seen, "phi_cmd"), abs=1e-9)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("world", "gains"),
    [
        ("route", "exact:soft"),
        ("speed_change_in_turn", "exact:speed"),
        ("turbulent_climb", "paper"),
        ("sensor_noise", "paper"),
    ],
)
def test_under_the_actions_of_the_law_it_flies_what_fly_does(world, gains):
    env = ft.gym.FlightEnv(route_of(2) if world == "route" else world, gains=gains)
    observations, _, (info, *_) = flown_by_the_law(env, seed=5)

    flown = ft.fly(env.scenario, gains)
    expected = next(run for run in flown.runs if run.provenance.aircraft)
    (run,) = env.flown.runs

    assert expected.provenance.scenario["controller"]["rate_hz"] == 10.0
    assert expected.provenance.seed == info["seed"]
    # an action is in its limits already, the command of a law is not
    shared = [name for name in run.signals if not name.endswith(("_unlimited", "_limited"))]
    # the commands of the last sample fly nothing: an agent is not asked for them
    states = run.signals[shared].to_numpy()[:-1], expected.signals[shared].to_numpy()[:-1]
    assert np.array_equal(*states)
    if env.scenario.sensors is None:
        for name in ("chi_err", "phi", "V_a"):
            column = observations[:, env.observed.index(name)]
            assert np.array_equal(column, run.signals[name])


@pytest.mark.soak
def test_seeds_give_the_same_bits_beside_other_environments():
    def make():
        return ft.gym.FlightEnv("circuit_in_wind")

    actions = np.random.default_rng(1).uniform((-0.5, 0.8), (0.5, 1.3), (40, 3, 2))

    def flights(envs):
        observations = [envs.reset(seed=[4, 5, 4])[0]]
        observations += [envs.step(action)[0] for action in actions]
        envs.close()
        return np.array(observations)

    beside = flights(SyncVectorEnv([make] * 3))
    apart = flights(AsyncVectorEnv([make] * 3))
    env = make()
    alone = [env.reset(seed=5)[0]] + [env.step(action)[0] for action in actions[:, 1]]

    assert np.array_equal(beside, apart)
    assert np.array_equal(beside[:, 1], alone)
    assert np.array_equal(beside[0, 0], beside[0, 2])
    assert not np.array_equal(beside[0, 0], beside[0, 1])


def test_the_file_of_a_route_is_a_world():
    env = ft.gym.FlightEnv(Path(ft.__file__).parents[1] / "scenarios" / "approach.plan")
    obs, _ = env.reset(seed=1)

    assert env.observed[-2:] == ("cross_track", "height_err")
    assert obs[-2:] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert env.scenario.route is not None


@pytest.mark.soak
def test_a_plant_without_weather_meets_the_wind_of_the_start():
    env = ft.gym.FlightEnv("crosswind_course", plant="kinematic")
    _, _, (_, _, truncated, _) = flown_by_the_law(env, seed=1)
    wind = env.flown.runs[0].signals[["wind_north", "wind_east"]].to_numpy()
    expected = ft.fly("crosswind_course").runs

    assert truncated
    assert np.all(wind == wind[0])
    aircraft = next(run for run in expected if run.provenance.aircraft)
    assert wind[0] == pytest.approx(aircraft.signals[["wind_north", "wind_east"]].iloc[0])


@pytest.mark.slow
def test_each_episode_of_a_campaign_is_a_draw_that_can_be_asked_for():
    env, plan = ft.gym.FlightEnv(calm_legs()), ft.plan_campaign(calm_legs())
    obs, info = env.reset(seed=2)
    following = env.reset()[1]

    assert info["draw"] != following["draw"]
    assert info["seed"] == plan.values_of(info["draw"])["seed"]
    assert np.array_equal(env.reset(options={"draw": info["draw"]})[0], obs)
    assert env.scenario.wind.speed_mps == plan.values_of(info["draw"])["wind.speed_mps"]


def largest_distances(draws):
    """Largest distance from the route in each draw of two legs that the law flies, m."""
    env = ft.gym.FlightEnv(calm_legs())
    place = [env.observed.index(name) for name in ("cross_track", "height_err")]
    for draw in draws:
        observations, _, (_, terminated, _, last) = flown_by_the_law(env, options={"draw": draw})
        assert terminated, last
        assert last["status"] == "completed"
        yield np.hypot(*observations[:, place].T).max()


@pytest.mark.soak
@pytest.mark.parametrize(
    "draws", [pytest.param(5, marks=pytest.mark.slow), pytest.param(100, marks=pytest.mark.counts)]
)
def test_the_law_flies_a_leg_and_a_turn_within_a_metre(draws):
    distances = [*largest_distances(range(draws))]

    assert max(distances) < CORRIDOR_M
    assert min(distances) > 0.0


def test_a_flight_that_fails_is_terminated_and_loses_the_time_left():
    env = ft.gym.FlightEnv("mission")
    env.reset(seed=1)
    rewards, terminated = [], False
    while not terminated:
        _, reward, terminated, truncated, info = env.step([0.7, -2.0])
        rewards.append(reward)

    assert not truncated
    assert info["status"] == "left_envelope"
    assert f"t = {len(rewards) * 0.1 - 0.1:.0f}" in info["reason"]
    assert rewards[-1] == pytest.approx(-(45.0 - 0.1 * (len(rewards) - 1)))
    assert env.flown.runs[0].status == "left_envelope"


@pytest.mark.parametrize(
    ("duration", "status", "arrived"), [(60.0, "completed", True), (35.0, "not_arrived", False)]
)
def test_the_end_of_a_route_terminates_and_the_end_of_time_truncates(duration, status, arrived):
    env = ft.gym.FlightEnv(route_of(3, duration_s=duration))
    _, rewards, (_, terminated, truncated, last) = flown_by_the_law(env, seed=1)

    assert (terminated, truncated, last["status"]) == (arrived, not arrived, status)
    assert arrived or len(rewards) == 350


def test_the_reward_is_the_time_lost_to_errors():
    halves_m, halves_rad, halves_mps = 5.0, math.radians(5.0), 5.0
    for world, names, half in (
        (route_of(3), ("cross_track", "height_err"), halves_m),
        ("speed_change_in_turn", ("chi_err", "gamma_err"), halves_rad),
    ):
        env = ft.gym.FlightEnv(world)
        env.reset(seed=1)
        for k in range(30):
            obs, reward, *_ = env.step([0.3, 1.1, 0.0][: len(env.action_space.low)])
            at = dict(zip(env.observed, obs, strict=True))
            error = math.hypot(
                *(at[name] / half for name in names), at.get("V_err", 0.0) / halves_mps
            )
            assert reward == pytest.approx(-0.1 * error / (1.0 + error), rel=1e-12), k


def test_actions_are_those_that_scenario_and_aircraft_allow():
    env = ft.gym.FlightEnv("speed_change_in_turn")
    limits, n_x = ft.loop.JSBSimPlant("aerosonde", takes_n_x=True).limits, env.action_space.high[2]
    env.reset(seed=1)
    env.step([1.5, 1.0, 9.0])
    obs = env.step([1.5, 1.0, 9.0])[0]
    command = dict(zip(env.observed, obs, strict=True))

    assert np.all(env.action_space.low >= limits.lower)
    assert np.all(env.action_space.high <= limits.upper)
    assert command["n_x_cmd"] <= n_x
    assert command["phi_cmd"] == pytest.approx(0.2 * limits.rate_upper[0])


@pytest.mark.parametrize(
    ("world", "options", "said"),
    [
        ("nowhere", {}, "nowhere"),
        ("mission", {"plant": "kinematic"}, "`plant` must be one of jsbsim:aerosonde, got kinem"),
        ("mission", {"gains": "K1"}, "`gains` must be one of exact:tuned_fed_back, got K1"),
        ("mission", {"rate_hz": 0.5}, "`rate_hz`"),
        ("mission", {"rate_hz": 33.0}, "`controller.rate_hz` must divide"),
    ],
)
def test_a_world_that_there_is_not_is_refused(world, options, said):
    with pytest.raises(ft.InputError, match=said):
        ft.gym.FlightEnv(world, **options)


def test_a_command_without_limits_is_refused():
    tables = ft.load_scenario("paper_as_printed").as_dict()
    del tables["limits"]

    with pytest.raises(ft.InputError, match=r"`n_z`\), got .-inf -inf."):
        ft.gym.FlightEnv(ft.scenario_from(tables))


def begun(*actions):
    """A mission that was reset, and flown by some actions."""
    env = ft.gym.FlightEnv("mission")
    obs, _ = env.reset(seed=1)
    for action in actions:
        env.step(action)
    return env, obs


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (lambda env: env.step([0.0, 1.0]), "`reset` must be called before"),
        (lambda env: env.baseline(np.zeros(10)), "`obs` must be the latest"),
        (lambda env: env.flown, "after the end"),
        (lambda env: env.reset(options={"draw": 1}), "`draw` must be absent"),
    ],
    ids=["step", "baseline", "flown", "draw"],
)
def test_what_cannot_be_asked_before_a_flight_is_refused(asked, words):
    with pytest.raises(ft.InputError, match=words):
        asked(ft.gym.FlightEnv("mission"))


def test_a_world_that_is_not_there_may_be_of_any_kind():
    with pytest.raises(ft.ScenarioError, match="the scenario, campaign or mission must be a file"):
        ft.gym.FlightEnv("nope")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (lambda env, before: env.baseline(before), "`obs` must be the latest"),
        (lambda env, _: env.flown, "after the end"),
    ],
    ids=["baseline", "flown"],
)
def test_what_cannot_be_asked_in_flight_is_refused(asked, words):
    env, before = begun([0.5, 1.0])

    with pytest.raises(ft.InputError, match=words):
        asked(env, before)


NO_ACTIONS = {
    "one": [0.1],
    "three": [0.1, 0.2, 0.3],
    "none": [],
    "a number": 0.1,
    "a row": [[0.1, 0.2]],
    "a column": [[0.1], [0.2]],
    "ragged": [[0.1], [0.2, 0.3]],
    "NaN": [math.nan, 1.0],
    "infinite": [0.1, -math.inf],
    "texts": ["0.1", "0.2"],
    "a text": "01",
    "truths": [True, False],
    "complex": [0.1j, 1.0],
    "nothing": None,
    "names": {"phi": 0.1, "n_z": 1.0},
}


@pytest.mark.parametrize("scaled", [False, True])
def test_an_action_that_is_not_as_many_finite_numbers_is_refused_and_the_flight_goes_on(scaled):
    env = gymnasium.make(ft.gym.NAME, world="level_turn") if scaled else begun()[0]
    env.reset(seed=1)
    for action in NO_ACTIONS.values():
        with pytest.raises(ft.InputError, match="`action` must be 2 "):
            env.unwrapped.step(action)

    after = env.step(np.array([0.1, 0.9], dtype=np.float32))
    env.reset(seed=1)
    np.testing.assert_array_equal(after[0], env.step(np.array([0.1, 0.9], dtype=np.float32))[0])


@pytest.mark.slow
def test_a_draw_that_cannot_start_is_replaced_unless_it_is_asked_for_or_all_are_such(tmp_path):
    """The Aerosonde starts at 15 m/s or faster."""

    def drawn(low, high):
        file = tmp_path / "drawn.toml"
        file.write_text(
            'title = "drawn"\nscenario = "level_turn"\nruns = 40\n[[disperse]]\n'
            'key = "flight.V_a_mps"\ndistribution = "uniform"\n'
            f"lower = {low}\nupper = {high}\n"
        )
        scenario = ft.load_scenario("level_turn", changes={"gains": ["paper"]})
        return ft.gym.FlightEnv(ft.load_campaign(file, scenario))

    env = drawn(10.0, 20.0)
    begun = {}
    for seed in range(12):
        _, info = env.reset(seed=seed)
        begun[info["draw"]] = env.scenario.flight.V_a_mps
        assert env.scenario.seed == info["seed"]
    refused = set()
    for draw in range(20):
        try:
            env.reset(options={"draw": draw})
        except ft.ScenarioError:
            refused.add(draw)
        else:
            assert begun.get(draw, 15.0) >= 15.0
    assert refused
    assert not refused & begun.keys()
    with pytest.raises(ft.ScenarioError, match="15 to 45"):
        drawn(10.0, 14.0).reset(seed=1)
