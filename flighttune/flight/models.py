"""Gains of a scenario: linear models, tuning problems, gain sets and their measures."""

import math
import pickle
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flighttune.base.arrays import FloatArray, numbers_of
from flighttune.base.errors import InfeasibleError, InputError, ScenarioError
from flighttune.base.files.shipped import nearest_name
from flighttune.base.units import wrap_angle
from flighttune.base.words import listed
from flighttune.control import inner_loop
from flighttune.control.certificates.exact_rate import Sampling
from flighttune.control.controller import LawSetup
from flighttune.control.gains import NO_FEEDBACK, RATES, PIGains, paper_family
from flighttune.control.gains_keys import (
    FIRST_FOUND,
    OF_EXACT_LAW,
    TUNED,
    TUNED_FED_BACK,
    TUNED_GENTLE,
    TUNED_IDENTIFIED,
    GainsTable,
)
from flighttune.control.law import Law, Trim, made_law
from flighttune.control.limits import Limits
from flighttune.control.linear_model import Envelope, LinearModel, closed_loop
from flighttune.control.margins import channel_margins, loop_margins
from flighttune.control.theory.indicators import indicators
from flighttune.control.tuning.envelope import tune_worst_case
from flighttune.control.tuning.problem import LARGEST_GAIN, TuningProblem, decoupled
from flighttune.control.tuning.result import TuningResult
from flighttune.control.tuning.tune import tune_problem
from flighttune.control.tuning.tuning_keys import SHAPED
from flighttune.flight.conditions import command_limits, limits_on, reference_of, stated_condition
from flighttune.flight.entry import Entry
from flighttune.flight.noise import tuning_noise
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.identification.file import DesignModel, design_model
from flighttune.vehicles.plants.weather import turbulence_scales

# Replaces a gain margin down to zero.
TINY = 1e-300

# Default maximum sensitivity of gains of the fastest decay or the smallest E_K; and the sensitivity
# that guarantees 35 deg of phase and 8 dB of gain margin, more than `meet` requires.
SENSITIVITY, LARGEST_SENSITIVITY = 1.4, 0.5 / math.sin(math.radians(17.5))

# [tuning] for the gains of these names, and the maximum sensitivity of `tuned_fed_back` at these
# rates of the load factor, 1/s. In wind 1.5 has 2 to 4 % less ITAE than 1.4 on aircraft of 1 and
# 2 1/s, and 1 % more on the c172p of 0.7 1/s, whose load factor falls behind its command.
FED_BACK = {"objective": "rms", "feedback": True, "command_rate_max": None}
IDENTIFIED: dict[str, dict[str, Any]] = {
    TUNED_IDENTIFIED: {},
    TUNED_FED_BACK: {**FED_BACK, "navigation": None},
    TUNED_GENTLE: {**FED_BACK, "navigation": "standard", "sensitivity_max": SENSITIVITY},
}
LIFT_RATES, SENSITIVITIES = (0.7, 1.0), (1.4, 1.5)

# Number of lags in a range for tuning; `certify` proves the rate for all lags.
LAGS_TUNED = 5

# Smallest integral time of a loop, relative to the delay of a limited command: design/roll_rate.md.
INTEGRAL_TIME = 4.0


def identified_models(
    scenario: Scenario, law: Law | None = None, *, everywhere: bool = False
) -> tuple[DesignModel, ...]:
    """A law, by default the first, behind the identified inner loop and half a sample of delay.

    The model is about wings-level flight on the first reference with the lags of the nearest
    condition. If `everywhere`, or with ``robust`` in [tuning], each condition has its own model.
    """
    identified, law = scenario.identified_model, law or scenario.laws[0]
    V_a, gamma = scenario.flight.V_a_mps, reference_of(scenario).initial[1]
    g, hold = scenario.flight.g_mps2, 0.5 / scenario.controller.rate_hz
    model = partial(design_model, g=g, hold=hold, law=law, airspeed=scenario.airspeed)
    if everywhere or scenario.tuning.robust:
        speed = V_a if scenario.controller.schedule else None
        return tuple(model(condition, schedule_speed=speed) for condition in identified.conditions)
    return (model(identified.nearest(V_a, gamma), V_a=V_a, gamma=gamma),)


def law_model(scenario: Scenario, law: Law | None = None) -> LinearModel:
    """A law alone, by default the first, about wings-level flight on the first reference."""
    f = scenario.flight
    gamma = reference_of(scenario).initial[1]
    trim = Trim(V_a=f.V_a_mps, gamma=gamma, g=f.g_mps2, airspeed=scenario.airspeed)
    return (law or scenario.laws[0]).linear_model(trim)


def linear_model(scenario: Scenario, law: Law | None = None) -> LinearModel:
    """The model of [tuning] on the first reference; with ``robust``, of the first condition."""
    settings = scenario.tuning
    if settings.model == "identified":
        return identified_models(scenario, law)[0].model
    model = law_model(scenario, law)
    if settings.lag_rad_s is not None:
        model = inner_loop.with_input_lag(model, settings.lag_rad_s)
    if settings.sample_delay:
        model = inner_loop.with_input_delay(model, 0.5 / scenario.controller.rate_hz)
    return model


def tuning_problem(scenario: Scenario, law: Law | None = None) -> TuningProblem:
    """The optimisation model for a scenario, on the model that its [tuning] names.

    Parameters
    ----------
    scenario : Scenario
    law : Law, optional
        Law of the gains; by default the scenario's first.

    Returns
    -------
    TuningProblem
        Maximise R_K of the loop about the first reference under ``I_K <= I_star`` (on the kinematic
        law), ``E_K <= E_star`` and, if the scenario requests it, the input limits at the first
        error. With ``robust`` in [tuning] it is the problem of the first condition.

    Notes
    -----
    Section 4.4 of arXiv 2411.13140. The limits hold for the PI part alone, as printed: a
    feed-forward is not counted.

    Examples
    --------
    >>> ft.loop.tuning_problem(ft.load_scenario("paper")).I_star
    5.0
    """
    if scenario.tuning.model == "identified":
        return identified_problems(scenario, law)[0]
    scaling = tuning_scaling(scenario, law)
    return _problem(scenario, law or scenario.laws[0], linear_model(scenario, law), scaling)


def tuning_scaling(scenario: Scenario, law: Law | None = None) -> FloatArray | None:
    """Units of state in which R_K is maximised, shape (n + p,); None for plain units."""
    settings = scenario.tuning
    if settings.model == "identified":
        return identified_models(scenario, law)[0].scaling
    if settings.state_scaling is None:
        return None
    n, _, p = linear_model(scenario, law).shape
    if len(settings.state_scaling) != n + p:
        raise InputError(
            f"`state_scaling` of [tuning] must be {n + p} numbers, one a state and one an "
            f"error, got {len(settings.state_scaling)}"
        )
    return np.array(settings.state_scaling)


def identified_problems(scenario: Scenario, law: Law | None = None) -> tuple[TuningProblem, ...]:
    """The problems whose smallest R_K the gains named ``tuned_identified`` maximise."""
    law = law or scenario.laws[0]
    return tuple(
        _problem(
            scenario,
            law,
            replace(design.model, A=design.model.A - _weight(design.model)),
            design.scaling,
            _followed(scenario, design, law),
        )
        for design in identified_models(scenario, law)
    )


def _weight(model: LinearModel) -> FloatArray:
    """The entry of A for the weight's effect on airspeed; zeros if airspeed is not a channel."""
    # A gain on the error of the path angle cancels this effect, apart from the lag of n_x
    # (`_with_weight`). Without the entry each of the three channels is tuned by itself.
    weight = np.zeros_like(model.A)
    if "V" in model.states:
        i, j = model.states.index("V"), model.states.index("gamma")
        weight[i, j] = model.A[i, j]
    return weight


def _with_weight(result: TuningResult, scenario: Scenario, law: Law) -> TuningResult:
    """The result with the gain from the path angle to n_x that cancels the weight."""
    if result.gains is None or not _weight(law_model(scenario, law)).any():
        return result
    gamma = reference_of(scenario).initial[1]
    K_P = result.gains.K_P.copy()
    K_P[2, 1] -= math.cos(gamma)
    return replace(result, gains=replace(result.gains, K_P=K_P))


def _followed(scenario: Scenario, design: DesignModel, law: Law) -> FloatArray:
    """Largest K_P and K_I, course to roll and path angle to lift, that a rate can follow."""
    # From the largest bank phi, a roll-out at the largest rate, delayed by the lag, turns the
    # course by another ``g/V phi T`` with ``T = phi / (2 rate) + lag``. This must not exceed the
    # course error that commands this bank, ``phi / K_P``: else every turn overshoots its course and
    # ends in a limit cycle. The integral must not grow by as much meanwhile, so its time is 4 T.
    # The same applies to the load factor that the first error of the path angle commands, ``K_P
    # gamma_err``.
    limits, settings = command_limits(scenario), scenario.tuning
    phi = min(limits.upper[0], -limits.lower[0])
    rates = np.minimum(limits.rate_upper, -limits.rate_lower)
    roll_lag, lift_lag = design.whole_lags[:2]
    per_rate = law.command_per_rate(design.V_a, scenario.flight.g_mps2)
    late = np.zeros(2)  # T; 0 without a bound
    if settings.roll_rate and np.isfinite([phi, rates[0]]).all():
        late[0] = phi / (2.0 * rates[0]) + roll_lag
    error = abs(reference_of(scenario).initial[1] - stated_condition(scenario).gamma)
    if settings.lift_rate and error and np.isfinite(rates[1]):
        # T = V gamma_err / (2 g rate T) + lag
        slew = design.V_a / scenario.flight.g_mps2 * error / (2.0 * rates[1])
        late[1] = 0.5 * lift_lag + math.sqrt(0.25 * lift_lag**2 + slew)
    with np.errstate(divide="ignore"):
        return per_rate / np.column_stack([late, INTEGRAL_TIME * late**2])


def _problem(
    scenario: Scenario,
    law: Law,
    model: LinearModel,
    scaling: FloatArray | None,
    gains_max: FloatArray | None = None,
) -> TuningProblem:
    """The problem on a model; `gains_max` (K_P, K_I of each channel) on an identified one."""
    chi_ref, gamma_ref = reference_of(scenario).initial
    condition, settings = stated_condition(scenario), scenario.tuning
    _, m, p = model.shape
    bound = np.full((m, 2 * p), settings.gain_max or LARGEST_GAIN)
    own: dict[str, Any] = {"weights": settings.weights, "R_min": settings.R_min}
    own["I_star"] = settings.I_star
    if gains_max is not None:
        for i, largest in enumerate(gains_max):
            bound[i, [i, p + i]] = np.minimum(bound[i, [i, p + i]], largest)
        most = min(settings.sensitivity_max or SENSITIVITY, LARGEST_SENSITIVITY)
        own = {"sensitivity_max": most, "feedback": settings.feedback}
        own["objective"] = "R_K" if settings.objective == "cost" else settings.objective
        if settings.objective == "rms":  # airspeed over the scale of gusts across the flight
            scales = turbulence_scales(scenario.flight.h_m)
            own["gusts"] = scenario.flight.V_a_mps / np.array([*scales, scales[0]][:p])
            own["noise"] = tuning_noise(scenario, law)
    return TuningProblem(
        model=model,
        E_star=settings.E_star or math.inf,
        limits=command_limits(scenario) if settings.input_limits else None,
        x_0=np.array([wrap_angle(chi_ref - condition.chi), gamma_ref - condition.gamma, 0.0][:p]),
        scaling=scaling,
        K_min=-bound,
        K_max=bound,
        K_fixed=decoupled(model) if settings.structure == "decoupled" else None,
        seed=scenario.seed,
        **own,
    )


def tune_scenario(
    scenario: Scenario, law: Law | None = None, *, lag: ArrayLike | None = None, kept: bool = False
) -> TuningResult:
    """The gains named ``tuned`` of a scenario, as a tuning result.

    `lag`: a range of lags (s) for tuning, as in `lag_problems`, by default from [tuning]. `kept`:
    reuse the result if this process has solved the same problem.
    """
    law = law or scenario.laws[0]
    if not law.by_gains and law.tuned_as == law.kind:
        raise InputError(
            f"`law` must state the linear model that its gains act on (`by_gains`) to be tuned, "
            f"got {law.name}, which has none."
        )
    if scenario.tuning.feedback and law.inputs != RATES:
        raise InputError(
            f"`feedback` of [tuning] must be false but for the exact law, got the law {law.name!r}."
        )
    identified = scenario.tuning.model == "identified"
    lag = scenario.tuning.lag_s if lag is None else lag
    if lag is not None:
        problems = lag_problems(scenario, law, lag)
    elif identified:
        problems = identified_problems(scenario, law)
    else:
        problems = tuning_problem(scenario, law)
    solved = _solved if kept else _solved.__wrapped__
    result = solved(pickle.dumps(problems), scenario.tuning.starts)
    return _with_weight(result, scenario, law) if identified and lag is None else result


@lru_cache(maxsize=64)  # flights, bands and pages need the gains repeatedly
def _solved(problems: bytes, starts: int) -> TuningResult:
    asked = pickle.loads(problems)
    if isinstance(asked, TuningProblem):
        return tune_problem(asked, starts=starts)
    return tune_worst_case(asked, starts=starts)


def gain_sets(scenario: Scenario) -> tuple[dict[str, PIGains | None], TuningResult | None]:
    """Every gain set by name, None if tuning failed, and the tuning for the first law."""
    tunings: dict[str, TuningResult] = {}
    for law in map(partial(_tuned_by, scenario), scenario.laws if TUNED in scenario.gains else ()):
        if law.tuned_as not in tunings:
            tunings[law.tuned_as] = tune_scenario(scenario, law, kept=True)
    sets = {}
    for name in scenario.gain_names:
        law = _tuned_by(scenario, scenario.law_of(name)[0])
        sets[name] = gain_set(scenario, name, tunings.get(law.tuned_as))
    return sets, tunings.get(_tuned_by(scenario, scenario.laws[0]).tuned_as)


def with_found_gains(scenario: Scenario) -> Scenario:
    """A scenario whose gains nobody stated, with the first of `FIRST_FOUND` that tuning finds.

    InfeasibleError if it finds none. A scenario of other gains is returned as it is.
    """
    if scenario.gains != [FIRST_FOUND[0]]:
        return scenario
    for name in FIRST_FOUND:
        # Tuning found no gains of the first: its roll is slow, and bounds those of the others.
        tuning = {"roll_rate": True} if name != FIRST_FOUND[0] else {}
        changed = {"gains": [name], "tuning": scenario.tuning.model_copy(update=tuning)}
        found = scenario.model_copy(update=changed)
        if gain_set(found, found.gain_names[0]) is not None:
            return found
    raise InfeasibleError(
        f"{scenario.title}: `gains` must be feasible: tuning found no {listed(FIRST_FOUND, 'or')} "
        f"for {scenario.identified_name} within the limits; faster limits may do, or a gains file."
    )


def _tuned_by(scenario: Scenario, law: Law, gains: str = TUNED) -> Law:
    """The law for which a law's gains are tuned: itself, or the first that flies by gains."""
    if law.takes_gains:
        return law
    others = (other for other in scenario.laws if other.by_gains)
    return next(others, made_law("exact") if gains in OF_EXACT_LAW else law)


def gain_set(scenario: Scenario, name: str, tuning: TuningResult | None = None) -> PIGains | None:
    """Gains by their name in a scenario; None for tuned gains of an infeasible problem."""
    # Tuned gains belong to the law before the colon of the name; other gains are mapped to it
    # (`Law.gains_from`). `tuning` is an existing result for ``tuned``.
    law, gains = scenario.law_of(name)
    inputs = {law.inputs for law in scenario.laws}
    # Gains that do not name their law belong to the scenario's only law.
    law_of_numbers = "exact" if inputs == {RATES} else "paper"
    numbers = {e.name: e.gains(law_of_numbers) for e in scenario.gains if isinstance(e, GainsTable)}
    available = {**paper_family(), **numbers}
    if gains in (TUNED, *IDENTIFIED) and gains not in numbers:
        law = _tuned_by(scenario, law, gains)
        if gains in OF_EXACT_LAW and law.inputs != RATES:
            raise InputError(
                f'`gains` {gains} must be flown with law = "exact", got the law {law.name!r}.'
            )
        if gains in IDENTIFIED:
            settings = {"model": "identified", "lag_s": None, **IDENTIFIED[gains]}
            if gains == TUNED_FED_BACK:
                limits = limits_on(scenario, scenario.aircraft)
                rate = min(limits.rate_upper[1], -limits.rate_lower[1])
                settings["sensitivity_max"] = float(np.interp(rate, LIFT_RATES, SENSITIVITIES))
            tuned = scenario.tuning.model_copy(update=settings)
            scenario, tuning = scenario.model_copy(update={"tuning": tuned}), None
        tuning = tuning or tune_scenario(scenario, law, kept=True)
        return tuning.gains if tuning.status == "optimal" else None
    if gains not in available:
        names = [TUNED, *available, *IDENTIFIED]
        raise InputError(
            f"`gains` must be one of {', '.join(names)}, got {name!r}{nearest_name(gains, names)}"
        )
    chosen = available[gains]
    if chosen.airspeed != scenario.airspeed:
        raise InputError(
            f"`gains` must have {3 if scenario.airspeed else 2} rows and columns where the "
            f"airspeed is {'' if scenario.airspeed else 'not '}followed, as {TUNED} and "
            f"{TUNED_IDENTIFIED} have, got {gains!r} of {len(chosen.inputs)}."
        )
    return law.gains_from(chosen, V_a=scenario.flight.V_a_mps, g=scenario.flight.g_mps2)


def trim_and_envelope(scenario: Scenario) -> tuple[Envelope, Envelope]:
    """Wings-level flight on the first reference, and the ranges of flight that contain it."""
    if scenario.envelope is None:
        raise ScenarioError(
            f"{scenario.title}: `envelope` must be given for a claim over one: add a table "
            "[envelope] with its ranges, or use the scenario `paper`, which has one; a claim at "
            'all conditions identified needs none, but [tuning] `model = "identified"`.'
        )
    model = linear_model(scenario)
    if len(model.states) != len(model.errors):
        raise ScenarioError(
            f"{scenario.title}: `model` of [tuning] must be the kinematic law without a lag for a "
            f"claim over an envelope, got one with the states {', '.join(model.states)}."
        )
    _, gamma = reference_of(scenario).initial
    trim = Envelope.at(V_a=scenario.flight.V_a_mps, gamma=gamma)
    envelope = scenario.envelope.envelope()
    if not envelope.contains(trim):
        raise ScenarioError(
            f"{scenario.title}: `envelope` must contain the trim {trim}, got {envelope}."
        )
    return trim, envelope


def late_ranges(
    scenario: Scenario, law: Law, lag: ArrayLike | None, everywhere: Sequence[DesignModel] = ()
) -> tuple[ArrayLike, FloatArray]:
    """Ranges of lag and delay, s: those of conditions, or the lags given."""
    settings, hold = scenario.tuning, 0.5 / scenario.controller.rate_hz
    if lag is not None:
        lag = numbers_of("lag", lag)
    if settings.model != "identified":
        return np.asarray(lag), np.full(2, hold if settings.sample_delay else 0.0)
    designs = everywhere or identified_models(scenario, law)
    each = np.array([[(x.whole - x.delay, x.delay + hold) for x in d.lags] for d in designs])
    lags, delays = np.stack([each.min(axis=0), each.max(axis=0)], axis=-1).transpose(1, 0, 2)
    return lags if lag is None else lag, delays


def lag_problems(scenario: Scenario, law: Law, lag: ArrayLike) -> tuple[TuningProblem, ...]:
    """Problems for a range of lags, whose slowest decay is to be maximised."""
    alone, settings = law_model(scenario, law), scenario.tuning
    lags, delays = late_ranges(scenario, law, lag)
    p, problems = len(alone.errors), []
    if np.shape(lags) not in ((), (1,), (2,), (1, 2), (p, 1), (p, 2)):
        raise InputError(f"`lag` must be one low and high end, s, or {p} of them, got {lag}.")
    bounds = np.broadcast_to(lags, (p, 2)), np.broadcast_to(delays, (p, 2))
    if not ((bounds[0] > 0.0) & (np.diff(bounds[0]) >= 0.0)).all():
        raise InputError(f"`lag` must be positive, its low end first, got {lag} s.")
    # The lags are evenly spaced, each with the smallest and the largest delay, as in
    # `certify_scenario`.
    for late in dict.fromkeys(map(tuple, bounds[1].T.tolist())):
        for share in np.linspace(0.0, 1.0, LAGS_TUNED):
            each = [
                inner_loop.InnerLag(
                    order=1, natural_frequency=1.0 / (low + share * (high - low)), delay=delay
                )
                for (low, high), delay in zip(bounds[0], late, strict=True)
            ]
            problem = _problem(
                scenario,
                law,
                inner_loop.with_inner_loop(alone, each),
                law.state_scaling(alone, each),
                np.full((p, 2), math.inf),
            )
            aim = problem.objective if settings.objective in SHAPED else "decay"
            most = min(settings.sensitivity_max or LARGEST_SENSITIVITY, LARGEST_SENSITIVITY)
            problems.append(replace(problem, objective=aim, sensitivity_max=most))
    return tuple(problems)


def sampling(scenario: Scenario, law: Law) -> Sampling:
    """The sampling of the linear loop of a law."""
    settings, dt = scenario.tuning, 1.0 / scenario.controller.rate_hz
    alone, lags = law_model(scenario, law), ()
    if settings.model == "identified":
        design = identified_models(scenario, law)[0]
        alone, lags = design.law_model, design.lags
    elif settings.lag_rad_s is not None:
        each = np.broadcast_to(settings.lag_rad_s, len(alone.inputs)).tolist()
        lags = tuple(inner_loop.InnerLag(order=1, natural_frequency=omega) for omega in each)
    return Sampling(model=alone, lags=lags, dt=dt, trapezoidal=law.trapezoidal)


def linear_loop(entry: Entry) -> tuple[LinearModel, PIGains] | None:
    """The linear model of a law's loop, and its gains; None without a model."""
    scenario, law, gains = entry.scenario, entry.law, entry.gains
    if gains is None:
        return None
    setup = law_setup(scenario, gains, command_limits(scenario))
    return law.loop(linear_model(scenario, law), gains, setup)


def loop_measures(entry: Entry, wanted: Collection[str]) -> dict[str, float]:
    """`LOOP_METRICS` of a gain set's linear loop on the model that [tuning] names.

    Margins and roll rate take longer and are computed only if `wanted`. The gain, phase and delay
    margins are the smallest for one input at a time; the disk margin is for all inputs. The roll
    rate lets the identified roll follow the gains at the largest bank (design/roll_rate.md). An
    unstable loop has no margins.
    """
    if (loop := linear_loop(entry)) is None:
        return {}
    model, gains = loop
    of_loop = indicators(closed_loop(model, gains), errors=len(model.errors))
    measured = {"R_K": of_loop.R_K, "I_K": of_loop.I_K, "E_K": of_loop.E_K}
    if "roll_rate_rad_s" in wanted:
        measured["roll_rate_rad_s"] = _needed_roll_rate(entry.scenario, entry.law, gains)
    if "disk_margin" in wanted and (margins := loop_margins(model, gains)):
        measured["disk_margin"] = margins[-1].disk_margin or 0.0
    single = () if measured.keys() >= set(wanted) else channel_margins(model, gains)
    if single:
        increase = min(cut.gain_increase for cut in single)
        decrease = max(cut.gain_decrease for cut in single)
        gain = min(increase, 1.0 / decrease if decrease else math.inf)
        measured |= {
            "gain_margin_dB": 20.0 * math.log10(gain),
            "phase_margin_rad": min(cut.phase_margin for cut in single),
            "delay_margin_s": min(cut.delay_margin for cut in single),
        }
    return measured


def _needed_roll_rate(scenario: Scenario, law: Law, gains: PIGains) -> float:
    """Roll rate at which `_followed` allows the gains; NaN without a limit of roll."""
    limits, design = command_limits(scenario), identified_models(scenario, law)[0]
    phi = min(limits.upper[0], -limits.lower[0])
    roll_per_turn = law.command_per_rate(design.V_a, scenario.flight.g_mps2)
    K_P, K_I = np.maximum(gains.K[0, [0, 2]], TINY)  # a gain of 0 or less needs no rate
    late = min(roll_per_turn / K_P, math.sqrt(roll_per_turn / (INTEGRAL_TIME * K_I)))
    if not math.isfinite(phi):
        return math.nan
    roll_lag = design.whole_lags[0]
    return phi / (2.0 * (late - roll_lag)) if late > roll_lag else math.inf


def law_setup(
    scenario: Scenario, gains: PIGains, limits: Limits, *, at_once: bool = False
) -> LawSetup:
    """The setup of a law of a scenario, for a plant that may follow at once."""
    settings, flight = scenario.controller, scenario.flight
    # Such a plant shows the command of the previous sample. Its feedback would be a loop of one
    # sample, which steep gains drive into a limit cycle.
    if at_once and gains.feeds_back:
        gains = replace(gains, feedback=NO_FEEDBACK)
    return LawSetup(
        dt=1.0 / settings.rate_hz,
        limits=limits,
        gains=gains,
        g=flight.g_mps2,
        scenario=scenario.as_dict(),
        anti_windup=settings.anti_windup,
        tracking_time=settings.tracking_time_s,
        schedule_speed=flight.V_a_mps if settings.schedule else None,
        feed_forward=settings.feed_forward,
        reference=reference_of(scenario),
    )
