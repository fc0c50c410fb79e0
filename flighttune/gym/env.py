"""A scenario, campaign or route as an environment of Gymnasium."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, ScenarioError, TrimError, need
from flighttune.base.files import code
from flighttune.base.files.table import validated
from flighttune.base.signatures import with_short_signatures
from flighttune.base.units import DEG, wrap_angle
from flighttune.base.words import got
from flighttune.campaigns.planning import plan, schema, source
from flighttune.control.controller import FlightCondition, GuardedLaw, LawError
from flighttune.control.controller_keys import ControllerTable
from flighttune.control.gains import PIGains
from flighttune.control.gains_keys import default_gains
from flighttune.flight.entry import Entry, entry_of
from flighttune.flight.flown import FlownScenario
from flighttune.flight.fly import manoeuvre, plant_of, provenance, steady_wind
from flighttune.flight.loop.aircraft import CompiledAircraft, inside
from flighttune.flight.loop.loop import Flight, Sample, step_of
from flighttune.flight.loop.run import Run, RunStatus
from flighttune.flight.models import gain_set, law_setup
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.plants.base import N_X_SIGNALS, follows_at_once
from flighttune.vehicles.plants.jsbsim.plant import LARGEST_SEED

if TYPE_CHECKING or find_spec("gymnasium"):
    from gymnasium import Env, register, spaces
else:  # its name stays public without the extra, and `need` says what is missing
    Env = object

# Errors of position, angles and airspeed that each cost half of the reward of a step.
HALF_M, HALF_RAD, HALF_MPS = 5.0, 5.0 * DEG, 5.0

# Size of observed values that a scaled environment shows as 1; `sizes` has the others.
SIZES = {
    **dict.fromkeys(("chi_err", "gamma_err", "phi"), math.pi),
    **dict.fromkeys(("chi_dot_ref", "gamma_dot_ref"), 1.0),
    **dict.fromkeys(("cross_track", "height_err"), 100.0),
    "gamma": math.pi / 2.0,
}

# Its name in Gymnasium, whose options are those of `FlightEnv`, and the world by default.
NAME, WORLD = "flighttune/Flight-v0", "level_turn"

# Draws of a campaign that may fail to start before an episode gives up.
MAX_DRAWS = 100


@with_short_signatures
class FlightEnv(Env):
    """Gymnasium environment in which an agent commands roll and load factor in place of a law.

    An action is held for one sample of the outer loop, and an episode is one flight. It is
    terminated where the aircraft leaves its envelope, hits the ground or diverges, and at the end
    of a route; it is truncated when the time of the scenario is over. Needs ``flighttune[gym]``.

    Parameters
    ----------
    world : Scenario, Campaign, str or Path
        The scenario or campaign to fly, its file or name, or the file of a route. Each episode of a
        campaign flies one of its draws; each episode of a scenario has another seed for turbulence
        and sensors.
    plant : str, optional
        Label of the plant; by default the first aircraft, else the first plant. A plant without
        weather meets the wind of the start.
    gains : str, optional
        Gain set of `baseline`; by default the gains tuned for the aircraft, else the first set.
    rate_hz : float, 1/s
        Actions per second. It replaces the rate of the scenario, and gains are tuned for it.
    scaled : bool
        Whether actions and observations are numbers from -1 to 1, by default False. An action of 1
        is the upper limit, -1 the lower one. An observed angle is divided by pi, the path angle by
        pi / 2, a rate by 1 rad/s, a distance by 100 m, an airspeed by twice that of the start, and
        the rest by its largest limit; larger values are cut off.

    Attributes
    ----------
    action_space : gymnasium.spaces.Box, shape (m,)
        Roll (rad) and load factor (1), and n_x (1) where the airspeed is a channel, within the
        limits of scenario and plant; or -1 to 1. Their rate limits hold too.
    observation_space : gymnasium.spaces.Box, shape (n,)
        The values named in `observed`; or -1 to 1.
    observed : tuple of str, length n
        Names of the observed values, in SI and rad: errors of course and path angle, rates of their
        reference, ``gamma``, ``phi``, ``n_z``, ``V_a`` and the commands in force. On a route also
        ``cross_track`` (right of it) and ``height_err``; where the airspeed is a channel also
        ``V_err`` and n_x with its least and largest value.
    scenario : Scenario
        The scenario of this episode, with its seed and what was drawn.
    plant, gains : str
        Label of the plant, and name of the gain set.
    sizes : ndarray or None
        Size of each observed value that is shown as 1; None without scaling.

    Raises
    ------
    InputError
        If Gymnasium is not installed, there is no such world, plant or gain set, or a command has
        no limits.

    Notes
    -----
    ``gymnasium.make("flighttune.gym:flighttune/Flight-v0", world=...)`` makes it scaled.

    The reward of a step of length dt is ``-dt e / (1 + e)``. On a route e is the distance from it
    over 5 m, else the error of course and path angle over 5 deg; a commanded airspeed adds its
    error over 5 m/s, as root of the sum of squares. A failed flight loses all of the time that was
    left, so that failing early never pays.

    ``reset(seed=...)`` gives the same bits anywhere, also beside other environments of the process.
    ``reset(options={"draw": 3})`` flies a draw of a campaign by its number. A draw that cannot
    start is replaced by another, unless asked for.

    Examples
    --------
    >>> env = ft.gym.FlightEnv("mission")
    >>> obs, info = env.reset(seed=1)
    >>> obs, reward, terminated, truncated, info = env.step(env.baseline(obs))
    >>> env.action_space.high.round(3).tolist(), len(obs), terminated
    ([0.785, 2.1], 10, False)
    """

    def __init__(
        self,
        world: source.Flights | Scenario | schema.Campaign | str | Path,
        *,
        plant: str | None = None,
        gains: str | None = None,
        rate_hz: float = 10.0,
        scaled: bool = False,
    ) -> None:
        need("`FlightEnv`", "gymnasium")
        stated, self._plan = source.flights(world), None
        campaign, stated = stated.campaign if stated.mission is None else None, stated.scenario
        if campaign is not None:
            both = {key: _at(rate_hz, getattr(campaign, key)) for key in ("nominal", "central")}
            self._plan = plan.plan_campaign(campaign.model_copy(update=both))
            stated = self._plan.scenario
        self._world = self.scenario = scenario = _at(rate_hz, stated)
        self.plant = plant or (*scenario.aircraft, *scenario.plant)[0].label
        names = scenario.gain_names
        if gains not in (None, *names):
            raise InputError(f"`gains` must be one of {', '.join(names)}, got {gains}.")
        self.gains = gains or default_gains(names)
        self._gain_set = None if self._plan is None else self._plan.gain_sets[self.gains]
        self._episode = self._prepared(scenario)
        limits = self._episode.limits
        if not np.isfinite([limits.lower, limits.upper]).all():
            keys = ("`phi_deg`", "`n_z`", "`n_x`")[: len(limits.lower)]
            raise InputError(
                f"{scenario.title}: [limits] must bound every action ({', '.join(keys)}), got "
                f"{limits.lower} to {limits.upper}."
            )
        self.observed: tuple[str, ...] = (
            *("chi_err", "gamma_err", "chi_dot_ref", "gamma_dot_ref", "gamma", "phi", "n_z", "V_a"),
            *("phi_cmd", "n_z_cmd", "n_x_cmd")[: len(limits.lower)],
            *(("cross_track", "height_err") if scenario.route is not None else ()),
            *(("V_err", *N_X_SIGNALS) if scenario.airspeed else ()),
        )
        self.sizes = self._sizes_of(scenario) if scaled else None
        ends = (
            (-np.ones_like(limits.lower), np.ones_like(limits.upper))
            if scaled
            else (limits.lower, limits.upper)
        )
        most = 1.0 if scaled else np.inf
        self.action_space = spaces.Box(*ends, dtype=np.float64)
        self.observation_space = spaces.Box(-most, most, (len(self.observed),), np.float64)

    def _sizes_of(self, scenario: Scenario) -> FloatArray:
        """The size of each observed value that is shown as 1."""
        limits = self._episode.limits
        largest = np.maximum(np.abs(limits.lower), np.abs(limits.upper))
        commands = dict(zip(("phi_cmd", "n_z_cmd", "n_x_cmd"), largest, strict=False))
        speed, n_x = 2.0 * scenario.flight.V_a_mps, commands.get("n_x_cmd", 1.0)
        sizes = SIZES | commands | {"n_z": commands["n_z_cmd"], "V_a": speed, "V_err": speed}
        return np.array([sizes.get(name, n_x) for name in self.observed])

    def _observation(self) -> FloatArray:
        """The latest observation, in the units of this environment."""
        seen = self._episode.observation()
        return seen if self.sizes is None else np.clip(seen / self.sizes, -1.0, 1.0)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin a flight; the info has the ``seed`` of its scenario, and the ``draw``."""
        super().reset(seed=seed)
        asked = (options or {}).get("draw")
        if asked is not None and self._plan is None:
            raise InputError(f"`draw` must be absent where the world is no campaign, got {asked}.")
        left = MAX_DRAWS if self._plan is not None and asked is None else 1
        while True:
            try:
                info = self._begin(asked)
                return self._observation(), info
            except (ScenarioError, TrimError):
                left -= 1
                if not left:
                    raise

    @property
    def draws(self) -> int:
        """Number of draws of the campaign; 0 where the world is a scenario."""
        return 0 if self._plan is None else self._plan.draws

    def scenario_of(self, draw: int | None) -> Scenario:
        """A draw of the campaign, or the scenario of the world."""
        return self._world if self._plan is None or draw is None else self._plan.scenario_of(draw)

    def _prepared(self, scenario: Scenario) -> "_Episode":
        return _Episode(entry_of(scenario, self.gains, None, self.plant))

    def _begin(self, draw: int | None) -> dict[str, Any]:
        info = {}
        if self._plan is None:
            seed = int(self.np_random.integers(LARGEST_SEED + 1))
            self.scenario = self._world.model_copy(update={"seed": seed})
        else:
            draw = int(self.np_random.integers(self.draws)) if draw is None else draw
            self.scenario, info = self.scenario_of(draw), {"draw": draw}
        self._episode = self._prepared(self.scenario)
        self._episode.start()
        return {"seed": self.scenario.seed, **info}

    def step(
        self, action: Sequence[float] | FloatArray
    ) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Fly one sample under an action; the last info of a flight has ``status`` and ``reason``.

        Raises InputError if the action is not m finite numbers, or no flight is under way.
        """
        episode = self._episode
        if episode.over:
            raise InputError("`reset` must be called before `step`: no flight is under way.")
        given = self._numbers(action)
        if self.sizes is not None:
            low, high = episode.limits.lower, episode.limits.upper
            given = low + (given + 1.0) * (high - low) / 2.0
        episode.agent.action = given
        _, _, t, _, _ = episode.sample
        episode.fly_on()
        failed = episode.over
        if failed:
            reward = t - self.scenario.flight.duration_s
        else:
            reward = -episode.loss() * episode.agent.dt
            *_, ends = episode.sample
            if ends:
                episode.fly_on()  # records the last sample, with the last action in force
        arrived = episode.over and self.scenario.route is not None and episode.stop is None
        terminated = failed or arrived
        truncated = episode.over and not terminated
        status, reason = episode.outcome
        info = {"status": status, "reason": reason} if episode.over else {}
        return self._observation(), reward, terminated, truncated, info

    def _numbers(self, action: Sequence[float] | FloatArray) -> FloatArray:
        """The action as m finite numbers; InputError if it is something else."""
        m = len(self._episode.limits.lower)
        try:
            given = np.asarray(action)
        except ValueError:  # rows of several lengths
            given = np.asarray(None)
        if given.dtype.kind not in "fiu":
            raise InputError(f"`action` must be {m} numbers, got {got(action)}.")
        if given.shape != (m,):
            size = len(given) if given.ndim == 1 else f"an array of shape {given.shape}"
            raise InputError(f"`action` must be {m} numbers, got {size}.")
        if not np.isfinite(given).all():
            raise InputError(f"`action` must be {m} finite numbers, got {given.tolist()}.")
        return given.astype(float)

    def baseline(self, obs: FloatArray) -> FloatArray:
        """Action of the scenario's law at the latest observation, shape (m,).

        The law gets the measurements and the reference behind `obs`; its integrals begin with
        the first call of a flight.
        """
        if self._episode.over or not np.array_equal(obs, self._observation()):
            raise InputError("`obs` must be the latest observation of a flight under way.")
        if self._gain_set is None:
            self._gain_set = gain_set(self._world, self.gains)
        if self._gain_set is None:
            raise InputError(f"`gains` must be feasible, got {self.gains}: tuning found none.")
        action = self._episode.law_action(self._gain_set)
        if self.sizes is None:
            return action
        low, high = self._episode.limits.lower, self._episode.limits.upper
        return 2.0 * (action - low) / (high - low) - 1.0

    @property
    def flown(self) -> FlownScenario:
        """The flight that has ended, as `fly` returns it, to be recorded, plotted or measured."""
        episode = self._episode
        signals = episode.flight.signals() if episode.over else ()
        if not len(signals):
            raise InputError("`flown` must be asked for after the end of a flight.")
        status, reason = episode.outcome
        made_by = provenance(replace(episode.entry, name="actions"))
        run = Run(signals=signals, status=status, reason=reason, provenance=made_by)
        return FlownScenario(self.scenario, (run,), {})


class _Agent:
    """Actions in place of a law."""

    signals: Mapping[str, str] = {}

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self.action: Sequence[float] | FloatArray = ()

    def start(self, condition: FlightCondition) -> None:
        pass

    def step(self, *_: Any) -> Any:
        return self.action


class _Episode:
    """One flight, from `start` until it is `over`."""

    @code.flies
    def __init__(self, entry: Entry) -> None:
        entry = self.entry = entry.bound("plant")
        scenario = entry.scenario
        from flighttune.flight.loop.kernel import COMPILED

        plant = plant_of(entry.plant, scenario, steady_wind(scenario), compiled=COMPILED)
        if (aircraft := inside(plant, CompiledAircraft)) is not None:
            aircraft.compiles = True
        self.limits = entry.limits.within(plant.limits)
        self.agent = _Agent(1.0 / scenario.controller.rate_hz)
        self._actions = GuardedLaw(self.agent, self.limits, "action")
        stated = manoeuvre(entry, plant, entry.plant.label)
        self.flight = Flight(plant, self._actions, **stated, lead=entry.lead)
        self._plant, self._condition = plant, stated["condition"]
        self._step: Callable[..., Sequence[float]] | None = None
        self._law_action: FloatArray | None = None
        self.over, self.stop = True, None

    def start(self) -> None:
        """Start the plant."""
        self._samples = self.flight.samples()
        self.sample: Sample = next(self._samples)
        self.over = False

    def fly_on(self) -> None:
        """Fly one sample under the action of the agent."""
        try:
            commands = self._actions.step(*self.sample[:3])
        except LawError as error:
            raise InputError(str(error)) from None
        try:
            self.sample = self._samples.send(commands)
        except StopIteration as end:
            self.over, self.stop = True, end.value
        self._law_action = None

    @property
    def outcome(self) -> tuple[RunStatus, str]:
        """Status of the flight, and its reason."""
        return ("completed", "") if self.stop is None else (self.stop.status, self.stop.reason)

    def observation(self) -> FloatArray:
        """The values of `FlightEnv.observed`."""
        m, ref, _, place, _ = self.sample
        chi_err, gamma_err = wrap_angle(ref.chi - m.chi), ref.gamma - m.gamma
        speed = () if m.n_x is None or ref.V is None else (ref.V - m.V_a, *m.n_x)
        # Where the autopilot takes itself to be
        aside = ref.path[1:3] if self.entry.scenario.navigation and ref.path else place[1:]
        flying = m.gamma, m.phi, m.n_z, m.V_a, *self._actions.limiter.u
        return np.array([chi_err, gamma_err, ref.chi_dot, ref.gamma_dot, *flying, *aside, *speed])

    def loss(self) -> float:
        """Share of the reward lost at this sample, 0 to 1."""
        m, ref, _, place, _ = self.sample
        if place:
            error = math.hypot(*place[1:]) / HALF_M
        else:
            error = math.hypot(wrap_angle(ref.chi - m.chi), ref.gamma - m.gamma) / HALF_RAD
        if ref.V is not None:
            error = math.hypot(error, (ref.V - m.V_a) / HALF_MPS)
        return error / (1.0 + error)

    @code.flies
    def law_action(self, gains: PIGains) -> FloatArray:
        """Commands of the law at this sample, which it steps once."""
        if self._step is None:
            entry, at_once = self.entry.bound("law"), follows_at_once(self._plant)
            setup = law_setup(entry.scenario, gains, self.limits, at_once=at_once)
            controller = entry.law.controller(setup)
            controller.start(self._condition)
            self._step = step_of(controller, self.flight.plant)
        if self._law_action is None:
            self._law_action = np.array(self._step(*self.sample[:3])[: len(self.limits.lower)])
        return self._law_action.copy()


def _at(rate_hz: float, scenario: Scenario) -> Scenario:
    """The scenario with another rate of its outer loop."""
    tables = scenario.controller.model_dump() | {"rate_hz": rate_hz}
    controller = validated(ControllerTable, tables, "`FlightEnv`")
    return scenario.model_copy(update={"controller": controller})


if Env is not object:
    many = "flighttune.gym.vector:FlightVectorEnv"
    options = {"world": WORLD, "scaled": True}
    register(NAME, "flighttune.gym.env:FlightEnv", vector_entry_point=many, kwargs=options)
