"""The vector environment beside flights of JSBSim, beside `FlightEnv`, and in Gymnasium's hands."""

import math
import warnings

import gymnasium
import numpy as np
import pytest
from dispersed import campaign_of, uniform

import flighttune as ft

SHORT = {"flight.duration_s": 3.0, "controller.rate_hz": 10.0}
ROUGH = SHORT | {"turbulence": {"intensity": "light"}, "wind": {"speed_mps": 3.0, "from_deg": 20.0}}
BUMP = {"gust": {"axis": "right", "peak_mps": 2.0, "start_s": 0.5, "length_m": 20.0}}


def world(changes, name="level_turn"):
    return ft.load_scenario(name, changes=changes)


def vector(n, changes=SHORT, **options):
    options = {"scaled": False} | options
    return ft.gym.FlightVectorEnv(n, world(changes), **options)


class Given:
    """Actions that are known before the flight, as a law."""

    actions = ()

    def __init__(self, setup):
        self.signals, self.dt = {}, setup.dt

    def start(self, condition):
        self.left = list(Given.actions)

    def step(self, *_):
        return self.left.pop(0) if self.left else (0.0, 1.0)


def flown_by_jsbsim(changes, seed, actions):
    """Signals of JSBSim's flight of the same world under these actions."""
    Given.actions = [(float(phi), float(n_z)) for phi, n_z in actions]
    scenario = world(changes).model_copy(update={"seed": int(seed)})
    with ft.in_jsbsim():
        runs = ft.fly(scenario, laws={"given": Given}).runs
    run = next(x for x in runs if "given" in x.label and x.provenance.aircraft)
    assert run.status == "completed"
    return run.signals


def drawn_actions(n, samples=30):
    generator = np.random.default_rng(4)
    ends = (-0.4, 0.9), (0.4, 1.2)
    return generator.uniform(*ends, (samples, n, 2)).astype(np.float32).astype(float)


@pytest.mark.parametrize(
    "changes", [SHORT, pytest.param(ROUGH, marks=pytest.mark.slow), BUMP | SHORT], ids=str
)
def test_flights_are_those_of_jsbsim_under_the_same_actions(changes):
    """Whose commands, roll, load factor, airspeed and path angle have the same bits."""
    n = 3
    env, actions = vector(n, changes), drawn_actions(3)
    _, infos = env.reset(seed=5)
    states = [env.state]
    for action in actions[:-1]:
        env.step(action)
        states.append(env.state)

    for lane in range(n):
        run = flown_by_jsbsim(changes, infos["seed"][lane], actions[:, lane])
        for name in ("phi", "n_z", "V_a", "gamma", "p", "h", "thrust"):
            flown = [state[name][lane] for state in states]
            assert flown == run[name].tolist()[: len(flown)], name


@pytest.mark.parametrize("scaled", [False, True])
def test_an_episode_has_the_observations_and_rewards_of_the_environment_of_one(scaled):
    """In still air, up to the rounding of 32 bits."""
    one = ft.gym.FlightEnv(world(SHORT), scaled=scaled)
    many = vector(5, scaled=scaled, autoreset_mode="same_step")
    (first, _), (seen, _) = one.reset(seed=1), many.reset(seed=1)
    assert many.observed == one.observed
    assert seen == pytest.approx(np.tile(first, (5, 1)), abs=1e-6)

    ended, flown = False, 0
    while not ended:
        action = np.array([0.3, 0.1] if scaled else [0.2, 1.05])
        obs, reward, terminated, truncated, _ = one.step(action)
        seen, rewards, failed, over, infos = many.step(np.tile(action, (5, 1)))
        flown += 1
        seen = infos["final_obs"] if over.any() else seen
        # a command is rounded to 32 bits of a share
        assert seen == pytest.approx(np.tile(obs, (5, 1)), abs=2e-6)
        assert rewards == pytest.approx([reward] * 5, abs=1e-7)
        assert (failed.tolist(), over.tolist()) == ([terminated] * 5, [truncated] * 5)
        ended = terminated or truncated
    assert flown == 30


@pytest.mark.parametrize(
    "changes",
    [
        {"sensors": {"chi_bias_deg": 1.0, "gamma_noise_sd_deg": 0.3, "V_a_noise_sd_mps": 0.5}},
        pytest.param(
            {"sensors": {"chi_noise_sd_deg": 0.5, "noise_time_constant_s": 0.5}},
            marks=pytest.mark.slow,
        ),
    ],
    ids=["bias and noise", "slow noise"],
)
def test_sensors_err_by_the_seed_of_an_episode(changes):
    """As in a flight with that seed, also in an episode that begins later."""
    env, action = vector(2, SHORT | changes), (0.2, 1.05)
    seen, infos = env.reset(seed=3)
    for again in range(2):
        if again:
            seen, infos = env.reset(options={"reset_mask": np.array([False, True])})
        observed = [seen[1]]
        for _ in range(20):
            observed.append(env.step([action] * 2)[0][1])
        flown = flown_by_jsbsim(SHORT | changes, infos["seed"][1], [action] * 30)

        for name in ("gamma", "V_a"):
            column = np.array(observed)[:, env.observed.index(name)]
            wanted = flown[f"{name}_meas"].to_numpy()[: len(column)]
            assert column == pytest.approx(wanted, abs=3e-6)  # in 32 bits


@pytest.mark.parametrize("mode", ["next_step", "same_step", "disabled"])
def test_flights_that_are_over_begin_anew_as_the_mode_says(mode):
    """The second of two flights dives out of its envelope; the other one is over at its time."""
    env = vector(2, {"flight.duration_s": 20.0}, autoreset_mode=mode)
    assert env.metadata["autoreset_mode"].name.lower() == mode
    first, _ = env.reset(seed=1)
    dive = np.array([[0.0, 1.0], [0.7, 0.0]])
    failed, rewards = np.zeros(2, dtype=bool), []
    while not failed.any():
        seen, reward, failed, over, infos = env.step(dive)
        rewards.append(reward)
        assert not over.any()
    time = len(rewards) / 10.0

    assert failed.tolist() == [False, True]
    # all of the time that was left after the last sample is lost
    assert rewards[-1][1] == pytest.approx(time - 0.1 - 20.0)
    if mode == "same_step":
        assert infos["_final_obs"].tolist() == [False, True]
        assert seen[1] == pytest.approx(first[1])
        assert infos["final_obs"][1] != pytest.approx(first[1])
    elif mode == "next_step":
        seen, reward, failed, over, _ = env.step(dive)
        assert (reward[1], failed[1], over[1]) == (0.0, False, False)
        assert seen[1] == pytest.approx(first[1])
    else:
        with pytest.raises(ft.InputError, match="must begin the flights that are over"):
            env.step(dive)
        seen, _ = env.reset(options={"reset_mask": np.array([False, True])})
        assert seen[1] == pytest.approx(first[1])
    assert env.state["t"][0] > env.state["t"][1]


def test_a_seed_gives_the_same_flights_and_another_one_others():
    seen = []
    for seed in (1, 1, 2):
        env = vector(2, ROUGH)
        env.reset(seed=seed)
        seen.append([env.step(np.tile([0.1, 1.0], (2, 1)))[0].tolist() for _ in range(5)])
    assert seen[0] == seen[1] != seen[2]
    assert seen[0][-1][0] != seen[0][-1][1]


@pytest.mark.slow
def test_a_campaign_gives_aircraft_that_differ():
    drawn = uniform("plant.airframe.mass_factor", 0.9, 1.1), uniform("flight.V_a_mps", 23.0, 27.0)
    campaign = campaign_of(world(SHORT), *drawn, runs=40)
    env = ft.gym.FlightVectorEnv(6, campaign, aircraft=4)
    _, infos = env.reset(seed=3)
    for _ in range(10):
        obs, *_ = env.step(np.tile([0.3, 0.1], (6, 1)))

    draws = infos["draw"].tolist()
    assert 2 <= len({*draws}) <= 4
    one = ft.gym.FlightEnv(campaign, scaled=True)
    for lane in (0, 5):
        seen, _ = one.reset(seed=1, options={"draw": draws[lane]})
        for _ in range(10):
            seen, *_ = one.step(np.array([0.3, 0.1]))
        assert obs[lane] == pytest.approx(seen, abs=2e-6)


def test_gymnasium_makes_it_scaled_in_32_bits_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make_vec(
            "flighttune.gym:flighttune/Flight-v0", num_envs=4, world=world(SHORT)
        )
        obs, _ = env.reset(seed=1)
        obs, rewards, *_ = env.step(env.action_space.sample())

    assert obs in env.observation_space
    assert obs.dtype == env.single_action_space.dtype == np.float32
    assert (env.single_action_space.low == -1.0).all()
    assert rewards.shape == (4,)


REFUSED = {
    "one number": (lambda env: env.step(0.0), r"shape \(2, 2\), got \(\)"),
    "one flight": (lambda env: env.step([0.0, 1.0]), r"shape \(2, 2\), got \(2,\)"),
    "text": (lambda env: env.step([["a", "b"]] * 2), "must be numbers"),
    "not finite": (lambda env: env.step([[math.nan, 1.0]] * 2), "must be finite"),
    "a mask of none": (
        lambda env: env.reset(options={"reset_mask": np.zeros(2, dtype=bool)}),
        "`reset_mask` must be 2 truth values",
    ),
    "no flights": (lambda _: vector(0), "`num_envs` must be at least 1"),
    "another mode": (lambda _: vector(1, autoreset_mode="never"), "must be next_step, same_step"),
    "a route": (lambda _: ft.gym.FlightVectorEnv(1, "circuit"), "without a route"),
    "navigation": (
        lambda _: ft.gym.FlightVectorEnv(1, world({"navigation.grade": "standard"} | SHORT)),
        "without errors of navigation",
    ),
    "no aircraft": (
        lambda _: ft.gym.FlightVectorEnv(1, "level_turn", plant="kinematic").reset(),
        "must fly an aircraft",
    ),
    "before its start": (lambda _: vector(1).step([[0.0, 1.0]]), "`reset` must be called before"),
}


@pytest.fixture(scope="module")
def begun():
    env = vector(2)
    env.reset(seed=1)
    return env


@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_flown_is_refused_in_a_line(begun, kind):
    call, words = REFUSED[kind]
    with pytest.raises(ft.FlightTuneError, match=words) as refused:
        call(begun)
    assert "\n" not in str(refused.value)
