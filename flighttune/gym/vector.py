"""A scenario or campaign as a vector environment of Gymnasium: all flights in compiled code."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, ScenarioError, TrimError, need
from flighttune.base.files import code
from flighttune.base.signatures import with_short_signatures
from flighttune.base.words import got
from flighttune.campaigns.planning import schema, source
from flighttune.compiled.simulator import Aircraft, State, Trimmed
from flighttune.flight.entry import entry_of
from flighttune.flight.fly import manoeuvre, plant_of, steady_wind
from flighttune.flight.loop.aircraft import CEILING
from flighttune.flight.loop.loop import sampled
from flighttune.flight.scenario.schema import Scenario
from flighttune.gym.flight import HALF_RAD, MAX_DRAWS, FlightEnv
from flighttune.vehicles.plants.jsbsim.plant import LARGEST_SEED, JSBSimPlant
from flighttune.vehicles.simulated import Simulated, started

if TYPE_CHECKING or find_spec("gymnasium"):
    from gymnasium.vector import AutoresetMode, VectorEnv
else:  # its name stays public without the extra
    VectorEnv = object

# Signals that must stay inside of the envelope, and the height above the ground.
GUARDED = ("alpha", "V_a", "n_z", "theta")

# Signals of the envelope, and further ones of the observations.
SEEN = (*GUARDED, "h", "chi", "gamma", "phi")

# Height above the ground at which a flight ends, m: parts of the aircraft may touch it.
LOWEST = 5.0


@dataclass(frozen=True)
class Flown:
    """What an episode begins with: its scenario, reference, limits and envelope.

    `reference` has rows of course, path angle and their rates by sample; `limits` has lower, upper,
    and the most that a command falls and rises in a sample; `envelope` has both ends of `GUARDED`.
    """

    scenario: Scenario
    draw: int | None
    reference: FloatArray
    commands: FloatArray
    limits: FloatArray
    envelope: FloatArray


@with_short_signatures
class FlightVectorEnv(VectorEnv):
    """Vector environment of Gymnasium whose flights are steps of compiled code, many in a vector.

    Its flights, observations, actions and rewards are those of `FlightEnv`, with JSBSim's bits.
    Needs ``flighttune[gym]``.

    Parameters
    ----------
    num_envs : int
        Number n of flights.
    world : Scenario, Campaign, str or Path
        A scenario or campaign with an aircraft, without a route or navigation, in still
        air, steady wind, turbulence and a gust.
    plant, rate_hz, scaled
        As for `FlightEnv`.
    aircraft : int, optional
        Draws of a campaign that are flown, by default n. Each is trimmed once; an episode flies one
        of them with other turbulence.
    autoreset_mode : str
        ``next_step``, ``same_step`` or ``disabled``, as Gymnasium describes them. Where it is
        disabled, ``reset(options={"reset_mask": mask})`` begins flights anew.

    Attributes
    ----------
    single_action_space, single_observation_space : gymnasium.spaces.Box
        Of one flight: float32, in the units of `FlightEnv`.
    observed : tuple of str
        Names of the observed values.
    state : State
        The flights, as `flighttune.compiled` shows them.

    Raises
    ------
    InputError, PlantError
        If the world cannot be flown in compiled code; the line says what `FlightEnv` can fly.

    Notes
    -----
    ``gymnasium.make_vec("flighttune.gym:flighttune/Flight-v0", num_envs=256)`` makes it scaled.

    Examples
    --------
    >>> env = ft.gym.FlightVectorEnv(8, "level_turn", scaled=False)
    >>> obs, infos = env.reset(seed=1)
    >>> obs, rewards, terminated, truncated, infos = env.step([[0.1, 1.0]] * 8)
    >>> obs.shape, rewards.shape, bool(terminated.any())
    ((8, 10), (8,), False)
    """

    def __init__(
        self,
        num_envs: int = 1,
        world: source.Flights | Scenario | schema.Campaign | str | Path = "level_turn",
        *,
        plant: str | None = None,
        rate_hz: float = 10.0,
        scaled: bool = True,
        aircraft: int | None = None,
        autoreset_mode: Literal["next_step", "same_step", "disabled"] = "next_step",
    ) -> None:
        need("`FlightVectorEnv`", "gymnasium")
        modes = {mode.name.lower(): mode for mode in AutoresetMode}
        if autoreset_mode not in modes:
            raise InputError(
                f"`autoreset_mode` must be {', '.join(modes)}, got {got(autoreset_mode)}."
            )
        if num_envs < 1:
            raise InputError(f"`num_envs` must be at least 1, got {num_envs}.")
        self.metadata = {"autoreset_mode": modes[autoreset_mode], "render_modes": []}
        self._mode, self.num_envs = autoreset_mode, num_envs
        self._alone = one = FlightEnv(world, plant=plant, rate_hz=rate_hz, scaled=scaled)
        self.observed, self._dt = one.observed, 1.0 / rate_hz
        self._check(one.scenario)
        from gymnasium.spaces import Box
        from gymnasium.vector.utils import batch_space

        action, observation = one.action_space, one.observation_space
        assert isinstance(action, Box)
        assert isinstance(observation, Box)
        self.single_action_space, self.single_observation_space = (
            Box(space.low.astype(np.float32), space.high.astype(np.float32), dtype=np.float32)
            for space in (action, observation)
        )
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._kinds = aircraft or (num_envs if one.draws else 1)
        self._begun: State | None = None
        self._over = np.zeros(num_envs, dtype=bool)

    def _check(self, scenario: Scenario) -> None:
        lacks = {
            "a route": scenario.route is None,
            "a commanded airspeed": not scenario.airspeed,
            "errors of navigation": scenario.navigation is None,
            "speed priority": not scenario.controller.speed_priority,
        }
        if has := [name for name, lacking in lacks.items() if not lacking]:
            raise InputError(
                f"{scenario.title}: `FlightVectorEnv` must have a scenario without {has[0]}, which "
                "`FlightEnv` flies."
            )

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        """Begin all flights, or those of ``reset_mask``; the infos have ``seed`` and ``draw``."""
        super().reset(seed=seed)
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise InputError(
                f"`reset_mask` must be {self.num_envs} truth values, some of them true."
            )
        if self._begun is None or seed is not None:
            self._draw()
        if not mask.all() and not hasattr(self, "state"):
            raise InputError("`reset` must begin all flights first.")
        infos = self._begin(np.flatnonzero(mask))
        return self._observations(), infos

    def _draw(self) -> None:
        """Draw the aircraft of the episodes, and trim each of them."""
        one, generator = self._alone, self.np_random
        kinds: list[tuple[Any, Any, Any, Flown]] = []
        left = MAX_DRAWS
        while len(kinds) < self._kinds:
            try:
                kinds.append(self._kind(int(generator.integers(one.draws)) if one.draws else None))
            except (ScenarioError, TrimError):  # another draw can start
                left -= 1
                if not (left and one.draws):
                    raise
        steps, starts, shown, flown = zip(*kinds, strict=True)
        if any(step.source != steps[0].source for step in steps):
            raise InputError(f"{flown[0].scenario.title}: its draws must have the same model.")
        self._flown: tuple[Flown, ...] = flown
        config = self._config
        self._aircraft = Aircraft(Simulated(config, "commands"))
        self._begun = self._aircraft.begin(Trimmed(steps[0], starts, shown))
        self._lasts = np.array([x.reference.shape[1] - 1 for x in flown])
        rest = self._lasts.max() - self._lasts
        self._references = np.stack(
            [
                np.pad(x.reference, ((0, 0), (0, n)), "edge")
                for x, n in zip(flown, rest, strict=True)
            ]
        )
        self._limits = np.stack([x.limits for x in flown])
        self._envelopes = np.stack([x.envelope for x in flown])
        self._starts = np.stack([x.commands for x in flown])
        n = self.num_envs
        sensed = any(x.scenario.sensors_on(self._alone.plant) for x in flown)
        self._errors = np.zeros((n, self._lasts.max() + 1, 3)) if sensed else None
        self._of, self._sample = np.zeros(n, dtype=int), np.zeros(n, dtype=int)
        self._commands, self._seen = np.zeros((n, 2)), np.zeros((n, len(self.observed)))

    @code.flies
    def _kind(self, draw: int | None) -> tuple[Any, Any, Any, Flown]:
        """One aircraft at its start, and what its episodes begin with."""
        scenario = self._alone.scenario_of(draw)
        self._check(scenario)
        entry = entry_of(scenario, self._alone.gains, None, self._alone.plant).bound("plant")
        plant = plant_of(entry.plant, scenario, steady_wind(scenario))
        if not isinstance(plant, JSBSimPlant):
            raise InputError(
                f"{scenario.title}: `FlightVectorEnv` must fly an aircraft (jsbsim), got "
                f"{entry.plant.label}, which `FlightEnv` flies."
            )
        self._config, stated = plant.config, manoeuvre(entry, plant, entry.plant.label)
        start = started(plant, stated["condition"])
        samples = round(scenario.flight.duration_s / self._dt) + 1
        t = np.arange(samples) * self._dt
        limits, e = entry.limits.within(plant.limits), plant.config.envelope
        steps = (limits.rate_lower * self._dt, limits.rate_upper * self._dt)
        self._steps, self._between = plant.count_steps(self._dt), plant.guarded_steps
        ends = [getattr(e, name) for name in GUARDED]
        heights = plant.ground + LOWEST, CEILING
        flown = Flown(
            scenario=scenario,
            draw=draw,
            reference=np.stack(sampled(stated["reference"], t, entry.lead)),
            commands=np.array(stated["condition"].commands(2)),
            limits=np.stack([limits.lower, limits.upper, *steps]),
            envelope=np.array([*ends, heights]).T,
        )
        return *start, flown

    def _begin(self, lanes: npt.NDArray[np.integer[Any]]) -> dict[str, Any]:
        """Begin some flights; what is said of them."""
        assert self._begun is not None
        kinds = self.np_random.integers(len(self._flown), size=len(lanes))
        if len(lanes) == self.num_envs == len(self._flown):
            kinds = np.arange(self.num_envs)
        seeds = self.np_random.integers(1, LARGEST_SEED + 1, size=len(lanes))
        begun = self._begun[kinds].with_seeds(seeds)
        every = len(lanes) == self.num_envs
        self.state = begun if every else self.state.put(lanes, begun)
        self._of[lanes], self._sample[lanes] = kinds, 0
        self._commands[lanes] = self._starts[kinds]
        self._over[lanes] = False
        self._last, self._of_limits = self._lasts[self._of], self._limits[self._of].swapaxes(0, 1)
        self._of_envelope = self._envelopes[self._of].swapaxes(0, 1)
        self._draw_errors(lanes, seeds)
        begun = np.stack([self.state[name] for name in SEEN], axis=1)
        self._seen[lanes] = self._shown(begun)[lanes]
        infos = {"seed": np.zeros(self.num_envs, dtype=int), "_seed": np.zeros(self.num_envs, bool)}
        infos["seed"][lanes], infos["_seed"][lanes] = seeds, True
        if self._alone.draws:
            draws = np.array([self._flown[kind].draw for kind in self._of])
            infos |= {"draw": draws, "_draw": infos["_seed"].copy()}
        return infos

    def _draw_errors(
        self, lanes: npt.NDArray[np.integer[Any]], seeds: npt.NDArray[np.integer[Any]]
    ) -> None:
        """Draw what the sensors of flights that begin will err."""
        if self._errors is None:
            return
        for lane, seed in zip(lanes, seeds, strict=True):
            scenario = self._flown[self._of[lane]].scenario.model_copy(update={"seed": int(seed)})
            sensors = scenario.sensors_on(self._alone.plant)
            self._errors[lane] = sensors.errors(self._errors.shape[1], self._dt) if sensors else 0.0

    def _shown(self, signals: FloatArray) -> FloatArray:
        """The values of `observed` in their units, by those of `SEEN`; shape (n, len(observed))."""
        _, V_a, n_z, _, _, chi, gamma, phi = signals.T
        if self._errors is not None:
            of_chi, of_gamma, of_V_a = self._errors[np.arange(self.num_envs), self._sample].T
            chi, gamma, V_a = chi + of_chi, gamma + of_gamma, V_a + of_V_a
        shown = np.empty_like(self._seen)
        ref = self._references[self._of, :, self._sample]
        shown[:, 0] = np.remainder(ref[:, 0] - chi + math.pi, math.tau) - math.pi
        shown[:, 1] = ref[:, 1] - gamma
        shown[:, 2:4] = ref[:, 2:]
        shown[:, 4], shown[:, 5], shown[:, 6], shown[:, 7] = gamma, phi, n_z, V_a
        shown[:, 8:] = self._commands
        return shown

    def _observations(self) -> npt.NDArray[np.float32]:
        sizes = self._alone.sizes
        seen = self._seen if sizes is None else np.clip(self._seen / sizes, -1.0, 1.0)
        return seen.astype(np.float32)

    def step(
        self, actions: npt.ArrayLike
    ) -> tuple[
        npt.NDArray[np.float32], FloatArray, npt.NDArray[Any], npt.NDArray[Any], dict[str, Any]
    ]:
        """Fly one sample of every flight under its action, shape (n, m)."""
        if not hasattr(self, "state"):
            raise InputError("`reset` must be called before `step`: no flight is under way.")
        waiting, some_wait = self._over.copy(), bool(self._over.any())
        if self._mode == "disabled" and some_wait:
            raise InputError("`reset` must begin the flights that are over before `step`.")
        wanted = self._wanted(actions)
        last, late = self._last, self._sample
        (failed, signals), infos = self._fly(wanted), dict[str, Any]()
        self._sample = np.minimum(late + 1, last)
        now = self._shown(signals)
        flying = ~failed & ~waiting
        self._seen[flying] = now[flying]
        error = np.hypot(now[:, 0], now[:, 1]) / HALF_RAD
        rewards = np.where(failed, (late - last) * self._dt, -error / (1.0 + error) * self._dt)
        truncated = ~failed & (self._sample == last)
        if some_wait:
            rewards[waiting] = 0.0
            failed[waiting] = truncated[waiting] = False
        self._over = failed | truncated
        if some_wait and self._mode == "next_step":
            infos |= self._begin(np.flatnonzero(waiting))
        elif self._over.any() and self._mode == "same_step":
            infos |= {"final_obs": self._observations(), "_final_obs": self._over.copy()}
            infos |= self._begin(np.flatnonzero(self._over))
        return self._observations(), rewards, failed, truncated, infos

    def _wanted(self, actions: npt.ArrayLike) -> FloatArray:
        """The commands that actions ask for, in rad and 1."""
        given, shape = np.asarray(actions), self.action_space.shape
        if given.dtype.kind not in "fiu" or given.shape != shape:
            raise InputError(f"`actions` must be numbers of the shape {shape}, got {given.shape}.")
        if not np.isfinite(given).all():
            raise InputError("`actions` must be finite.")
        if self._alone.sizes is None:
            return given.astype(float)
        low, high, _, _ = self._of_limits
        return low + (given.astype(float) + 1.0) * (high - low) / 2.0

    def _fly(self, wanted: FloatArray) -> tuple[npt.NDArray[np.bool_], FloatArray]:
        """Fly a sample within the limits; which flights left their envelope, and `SEEN`."""
        low, high, down, up = self._of_limits
        # As `limit_command`: the rate has priority where the command lies outside of its range.
        below, above = self._commands + down, self._commands + up
        below = np.where(below > low, below, np.minimum(low, above))
        above = np.where(above < high, above, np.maximum(high, below))
        self._commands = np.minimum(np.maximum(wanted, below), above)
        self.state, seen = self._aircraft.trace(
            self.state, self._commands, of=SEEN, steps=self._steps, every=self._between
        )
        least, largest = self._of_envelope
        guarded = seen[:, :, : least.shape[1]]
        inside = (least < guarded) & (guarded < largest)
        return ~inside.all(axis=(0, 2)), seen[-1]
