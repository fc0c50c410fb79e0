"""A `FlightVectorEnv` as the vector environment of Stable-Baselines3."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]

from flighttune.base.errors import InputError
from flighttune.gym.vector import FlightVectorEnv


class Baselines(VecEnv):
    """Flights that begin anew in the step in which they end, as Stable-Baselines3 expects."""

    def __init__(self, env: FlightVectorEnv) -> None:
        if env.metadata["autoreset_mode"].name != "SAME_STEP":
            raise InputError('`env` must have the option autoreset_mode="same_step".')
        self.env, self.render_mode = env, None
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> npt.NDArray[np.float32]:
        # `seed` of the base class keeps seeds until here: one draws those of all flights.
        seed = self._seeds[0]
        self._reset_seeds()
        return self.env.reset(seed=seed)[0]

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        self._actions = actions

    def step_wait(self) -> Any:
        obs, rewards, failed, truncated, given = self.env.step(self._actions)
        over = failed | truncated
        infos: list[dict[str, Any]] = [{} for _ in over]
        for lane in np.flatnonzero(over):
            infos[lane] = {
                "terminal_observation": given["final_obs"][lane],
                "TimeLimit.truncated": bool(truncated[lane]),
            }
        return obs, rewards.astype(np.float32), over, infos

    def close(self) -> None:
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.env, attr_name)] * len(self._lanes(indices))

    def set_attr(self, attr_name: str, *_: Any, **__: Any) -> None:
        raise InputError(f"`{attr_name}` of flights cannot be set one by one.")

    def env_method(self, method_name: str, *_: Any, **__: Any) -> list[Any]:
        raise InputError(f"`{method_name}` of flights cannot be called one by one.")

    def env_is_wrapped(self, _: type, indices: Any = None) -> list[bool]:
        return [False] * len(self._lanes(indices))

    def _lanes(self, indices: Any) -> Sequence[int]:
        return list(self._get_indices(indices))
