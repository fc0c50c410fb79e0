"""Flights in the hands of Stable-Baselines3; `make counts` tries it where it is installed."""

import importlib.util

import numpy as np
import pytest

import flighttune as ft

SHORT = {"flight.duration_s": 3.0, "limits.n_z": [0.0, 2.0]}


def vector(n, **options):
    options = {"autoreset_mode": "same_step"} | options
    return ft.gym.FlightVectorEnv(n, ft.load_scenario("level_turn", changes=SHORT), **options)


@pytest.mark.skipif(importlib.util.find_spec("stable_baselines3") is not None, reason="installed")
def test_without_its_package_the_adapter_says_how_to_install_it():
    with pytest.raises(ft.InputError, match="pip install stable-baselines3"):
        ft.gym.stable_baselines(vector(1))


@pytest.mark.counts
def test_the_adapter_has_the_flights_of_the_vector_and_their_last_observations():
    pytest.importorskip("stable_baselines3")
    env, one = ft.gym.stable_baselines(vector(3)), vector(3)
    env.seed(4)
    actions = np.tile(np.float32([0.2, 0.1]), (3, 1))

    seen, (wanted, _) = env.reset(), one.reset(seed=4)
    assert np.array_equal(seen, wanted)
    for _ in range(30):
        seen, rewards, over, infos = env.step(actions)
        wanted, wanted_rewards, _, truncated, last = one.step(actions)
        assert np.array_equal(seen, wanted)
        assert rewards == pytest.approx(wanted_rewards)
    assert over.all()
    assert truncated.all()
    for info, obs in zip(infos, last["final_obs"], strict=True):
        assert info["TimeLimit.truncated"]
        assert np.array_equal(info["terminal_observation"], obs)
    with pytest.raises(ft.InputError, match="same_step"):
        ft.gym.stable_baselines(vector(1, autoreset_mode="next_step"))


@pytest.mark.counts
def test_its_ppo_learns():
    PPO = pytest.importorskip("stable_baselines3").PPO
    env = ft.gym.stable_baselines(vector(64))
    options = {"n_steps": 30, "batch_size": 480, "gamma": 0.95, "learning_rate": 1e-3}
    agent = PPO("MlpPolicy", env, seed=1, device="cpu", **options)

    agent.learn(20_000)

    action, _ = agent.predict(env.reset())
    assert action.shape == (64, 2)
