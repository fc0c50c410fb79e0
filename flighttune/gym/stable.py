"""What Stable-Baselines3 needs, where it is installed."""

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from flighttune.base.errors import InputError

if TYPE_CHECKING:
    from flighttune.gym.vector import FlightVectorEnv


def stable_baselines(env: "FlightVectorEnv") -> Any:
    """Flights as a vector environment of Stable-Baselines3, which does not take Gymnasium's.

    Parameters
    ----------
    env : FlightVectorEnv
        Its option `autoreset_mode` must be ``same_step``.

    Returns
    -------
    stable_baselines3.common.vec_env.VecEnv
        For its algorithms, such as ``PPO("MlpPolicy", ft.gym.stable_baselines(env))``.

    Raises
    ------
    InputError
        If Stable-Baselines3 is not installed, or the flights begin anew in another step.

    Examples
    --------
    >>> env = ft.gym.FlightVectorEnv(64, "level_turn", autoreset_mode="same_step")
    >>> flights = ft.gym.stable_baselines(env)  # doctest: +SKIP
    >>> agent = PPO("MlpPolicy", flights).learn(1_000_000)  # doctest: +SKIP
    """
    if find_spec("stable_baselines3") is None:
        raise InputError(
            "`stable_baselines` must have Stable-Baselines3: pip install stable-baselines3"
        )
    from flighttune.gym.baselines import Baselines

    return Baselines(env)
