"""The verbs about gains: tune for a scenario, certify, and draw the frontier."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from flighttune.base.answering import FIGURES, Answering, function_for
from flighttune.base.arrays import check_at_least
from flighttune.base.errors import InfeasibleError, InputError
from flighttune.base.files import code
from flighttune.base.files.whole import together, write_text
from flighttune.base.units import RadiansPerSecond2
from flighttune.control.certificates.bound import bound_rate
from flighttune.control.certificates.certificate import Certificate
from flighttune.control.certificates.exact_rate import exact_rates
from flighttune.control.certificates.lag_box import lag_boxes
from flighttune.control.certificates.make import Certification, certify_model
from flighttune.control.gains import PIGains, paper_family
from flighttune.control.law import Law
from flighttune.control.linear_model import LinearModel
from flighttune.control.tuning.envelope import largest_factor, tune_over_envelope
from flighttune.control.tuning.problem import TuningProblem
from flighttune.control.tuning.result import TuningResult
from flighttune.control.tuning.tune import POINTS, STARTS, diagnosis, tune_problem
from flighttune.control.tuning.tune import frontier as frontier_table
from flighttune.control.tuning.tuning_keys import TuningModel
from flighttune.flight import models
from flighttune.flight.load import as_scenario, chosen_entry
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.identification.file import DesignModel, files_of
from flighttune.vehicles.plant_keys import flown_aircraft
from flighttune.vehicles.plants.navigation import Grade, Navigation


def tune(
    source: Scenario | TuningProblem | str | Path,
    *,
    model: TuningModel | None = None,
    law: Law | None = None,
    envelope: bool = False,
    lag: Sequence[float] | Sequence[Sequence[float]] | None = None,
    starts: int | None = None,
    prove: bool = False,
    changes: Mapping[str, Any] | None = None,
) -> TuningResult:
    """Find the gains with the largest R_K, or the smallest cost, under a scenario's constraints.

    This takes a second, or up to a minute over an envelope or for an infeasible problem.

    Parameters
    ----------
    source : Scenario, TuningProblem, str or Path
        A scenario, its file, or the name of a shipped scenario; or a problem, for which `starts` is
        the only other argument.
    model : "kinematic" or "identified", optional
        By default as in the scenario's [tuning]. On the identified model each channel is tuned by
        itself, for the smallest R_K over the models of its conditions.
    law : Law, optional
        Law of the gains; by default the scenario's first.
    envelope : bool
        Maximise the rate over the scenario's ranges of flight instead of R_K at the trim; on the
        identified model, the smallest R_K over all identified conditions. A law whose loop is equal
        in every flight is tuned as at the trim.
    lag : two numbers, or two of each channel, s, optional
        Smallest and largest lag of the inner loop: maximise the slowest decay behind lags between
        them, within the sensitivity of [tuning], by default its `lag_s`; `certify` proves its rate.
    starts : int, optional
        Searches from random starts; by default as in the scenario's [tuning].
    prove : bool
        Also prove a bound on R_K over all gains, within a minute.
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.

    Returns
    -------
    TuningResult
        Its gains, or the reason for none; for an infeasible scenario a `diagnosis` tells which
        limits would have to change.

    Raises
    ------
    InputError, ScenarioError
        If `starts` is less than 1, an identified model or an envelope is missing, or an envelope is
        combined with a quadratic cost.
    InfeasibleError
        If no bound on R_K is proven.

    Examples
    --------
    >>> result = ft.tune("paper")
    >>> result.status, round(result.R_K, 4)
    ('optimal', 0.5398)
    >>> wider = ft.tune("paper", changes={"tuning.I_star": 10.0})
    >>> wider.R_K > result.R_K
    True
    """
    if isinstance(source, TuningProblem):
        return tune_problem(source, starts=STARTS if starts is None else starts)
    scenario = as_scenario(source, changes)
    stated = scenario.tuning
    chosen = {} if starts is None else {"starts": starts}
    check_at_least(1, **chosen)
    everywhere = (model or stated.model) == "identified"
    own = {"model": model or stated.model, "robust": stated.robust or (everywhere and envelope)}
    scenario = scenario.model_copy(update={"tuning": stated.model_copy(update=own | chosen)})
    lag = stated.lag_s if lag is None else lag
    if lag is not None and (envelope or stated.objective == "cost"):
        raise InputError("`lag` must be absent over an envelope, and with a quadratic cost.")
    if envelope and not everywhere and not (law or scenario.laws[0]).same_everywhere:
        if scenario.tuning.objective != "R_K":
            raise InputError("`objective` of [tuning] must be R_K over an envelope, got cost.")
        trim, ranges = models.trim_and_envelope(scenario)
        problem = models.tuning_problem(scenario, law)
        result = tune_over_envelope(problem, ranges, trim, g=scenario.flight.g_mps2, **chosen)
    else:
        result = models.tune_scenario(scenario, law, lag=lag)
        if result.status == "infeasible":
            result = replace(result, diagnosis=diagnosis(result.problem))
    result = replace(result, tuned_for=_tuned_for(scenario, law, envelope=envelope))
    if prove:
        problem = result.problem
        if (bound := bound_rate(problem.model, problem.I_star, problem.scaling)) is None:
            raise InfeasibleError(f"no bound on R_K was proven for `I_star` {problem.I_star:g}.")
        result = replace(result, bound=bound)
    return result


def _tuned_for(scenario: Scenario, law: Law | None, *, envelope: bool) -> dict[str, Any]:
    """Aircraft and airspeeds of the models for tuning."""
    speeds = [scenario.flight.V_a_mps]
    if scenario.tuning.model == "identified":
        identified = scenario.identified_model
        if scenario.tuning.robust:
            speeds = [condition.V_a for condition in identified.conditions]
        assumed = {"assumed": [*identified.assumptions]} if identified.assumptions else {}
        speeds = [min(speeds), max(speeds)]
        return {"aircraft": [identified.aircraft], "V_a_mps": speeds, **assumed}
    if envelope and scenario.envelope:
        speeds = [*scenario.envelope.V_a_mps]
    same = (law or scenario.laws[0]).same_everywhere
    return {"aircraft": flown_aircraft(scenario.plant), "V_a_mps": [] if same else speeds}


@code.flies
def certify(
    source: Scenario | LinearModel | str | Path,
    gains: PIGains | str | None = None,
    *,
    envelope: bool = False,
    L_d: RadiansPerSecond2 | None = None,
    lag: Sequence[float] | Sequence[Sequence[float]] | None = None,
    navigation: Grade | None = None,
    changes: Mapping[str, Any] | None = None,
) -> Certification:
    """Certify the rate of gains on a linear model, and their ultimate radius under a disturbance.

    This takes a fraction of a second, or some seconds over an envelope.

    Parameters
    ----------
    source : Scenario, LinearModel, str or Path
        A scenario, its file, or the name of a shipped scenario, with the linear model of its law;
        or a model.
    gains : PIGains or str, optional
        Gains, or a gain set by name or file; by default the first of the scenario.
    envelope : bool
        Certify over the envelope, for every flight inside the scenario's ranges. If [tuning] names
        the identified model: at every identified condition and every mixture of their loops, and
        over the box of their lags and delays.
    L_d : float, rad/s^2, optional
        Bound on the norm of the derivative of the disturbance, by default from the scenario's
        sinusoid. Without a bound only the rate is claimed. For your own law the unit is the unit of
        its x' per second.
    lag : two numbers, or two of each channel, s, optional
        Smallest and largest lag of the inner loop: a rate is proven for all lags between them,
        constant or changing. Delays come from [tuning].
    navigation : "rtk", "standard" or "poor", optional
        Also bound the true tracking errors that estimation errors of this grade cause at the trim:
        the peak gain, which is the L1 norm of the impulse response, times three standard
        deviations.
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.

    Returns
    -------
    Certification
        Every inequality of its certificate has been proven; the claims are about 1e-8 weaker than
        the computed values to leave room for the proof. Refused without a certificate.

    Raises
    ------
    InputError, ScenarioError
        If `L_d` is not positive, the channels do not fit, or an envelope or an identified model is
        missing.
    InfeasibleError
        If tuning finds no such gains, or the law has no linear model.

    Examples
    --------
    >>> certification = ft.certify("paper", "paper")
    >>> certification.status, round(certification.certificate.claim.rate, 4)
    ('certified', 0.4599)
    >>> model = ft.loop.kinematic_model(V_a=25.0, gamma=0.26, g=9.81)
    >>> ft.certify(model, ft.PAPER_GAINS).status
    'certified'
    """
    if isinstance(source, LinearModel):
        if not isinstance(gains, PIGains) or envelope or lag is not None or navigation:
            raise InputError(
                "`gains` must be given for a model, and `envelope`, `lag` and `navigation` not."
            )
        return certify_model(source, gains, L_d=L_d, rates=exact_rates(source, gains)[0])
    entry = chosen_entry(source, gains, changes)
    scenario, law, name, chosen = entry.scenario, entry.law, entry.name, entry.found_gains
    if isinstance(gains, PIGains):  # numbers do not name their law
        law = scenario.law_for(gains)
    if not law.by_gains:
        if envelope or lag is not None or navigation:
            raise InputError(
                f"`envelope`, `lag` and `navigation` must be absent for {name}, whose gains are of "
                "a law of its own."
            )
        if (linear := models.linear_loop(entry.bound("law"))) is None:
            raise InfeasibleError(
                f"{name}: the law must have `linear()` to be certified, got none."
            )
        certification = certify_model(
            *linear, L_d=L_d, scenario_sha256=scenario.sha256, rates=exact_rates(*linear)[0]
        )
        return replace(certification, name=name)
    options = {"envelope": envelope, "L_d": L_d, "law": law, "lag": lag, "navigation": navigation}
    return replace(certify_scenario(scenario, chosen, **options, full=True), name=name)


def _everywhere(scenario: Scenario, law: Law) -> tuple[DesignModel, ...]:
    """The models of every identified condition, which have one order."""
    designs = models.identified_models(scenario, law, everywhere=True)
    orders = sorted({len(design.model.states) for design in designs})
    if len(orders) > 1:
        raise InputError(
            f"`identified` must have lags of one order at every condition for a common Q, got "
            f"models of {' and '.join(map(str, orders))} states."
        )
    return designs


def certify_scenario(
    scenario: Scenario,
    gains: PIGains,
    *,
    envelope: bool = False,
    L_d: float | None = None,
    law: Law | None = None,
    lag: Sequence[float] | Sequence[Sequence[float]] | None = None,
    navigation: Grade | None = None,
    full: bool = False,
) -> Certification:
    """A certificate of gains on the linear model of a scenario, or why there is none.

    The arguments are the same as for `certify`. `full` also proves the exact rate of the sampled
    loop and finds the largest envelope, which takes up to a second.
    """
    settings = scenario.tuning
    law = law or scenario.law_for(gains)
    if L_d is None and scenario.disturbance is not None:
        bound = scenario.disturbance.sinusoid().rate_bound
        L_d = bound if 0.0 < bound < math.inf else None
    identified = envelope and settings.model == "identified"
    varies = envelope and not (identified or law.same_everywhere)
    if varies and lag is not None:
        raise InputError("`lag` must be absent over the ranges of [envelope].")
    over = models.trim_and_envelope(scenario) if varies else None
    everywhere = _everywhere(scenario, law) if identified else ()
    model, scaling = models.linear_model(scenario, law), models.tuning_scaling(scenario, law)
    g = scenario.flight.g_mps2 if over else None
    proven, unsampled = (), ""
    if not envelope:
        sampled = models.sampling(scenario, law) if full else None
        proven, unsampled = exact_rates(model, gains, scaling=scaling, sampling=sampled)
    boxes, why = (), ""
    if lag is not None or identified:
        late = models.late_ranges(scenario, law, lag, everywhere)
        boxes, why = lag_boxes([model, *(design.law_model for design in everywhere)], gains, *late)
    whole: dict[str, Any] = {"over_envelope": envelope, "scaling": scaling}
    if navigation:
        known, rate = Navigation.of(navigation), scenario.controller.rate_hz
        sd = known.path_sd(1.0 / rate, scenario.flight.V_a_mps)[: len(model.errors)]
        whole |= {"navigation": navigation, "estimate_sd": sd}
    if why and lag is not None:
        return Certification(status="refused", reason=why, model=model, gains=gains, **whole)
    certification = certify_model(
        model,
        gains,
        envelope=over and over[1],
        g=g,
        L_d=L_d,
        conditions=[((design.V_a, design.gamma), design.model) for design in everywhere],
        scenario_sha256=scenario.sha256,
        rates=proven,
        boxes=boxes,
        estimates=navigation is not None,
    )
    certificate = certification.certificate
    if certificate is not None and settings.model == "identified":
        certificate = _of_identified(certificate, scenario)
    largest = None
    if over and full:
        largest = largest_factor(gains, over[1], over[0], g=scenario.flight.g_mps2)
    return replace(
        certification,
        certificate=certificate,
        absent=why or unsampled,
        ranges=over,
        g=g,
        largest_factor=largest,
        **whole,
    )


def _of_identified(certificate: Certificate, scenario: Scenario) -> Certificate:
    """A certificate with the files and assumptions of the identified aircraft."""
    files = files_of(scenario.identified_name)
    return replace(certificate, files=files, assumed=scenario.identified_model.assumptions)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frontier(Answering):
    """The largest R_K for each I_K of a scenario, and the positions of gain sets.

    Attributes
    ----------
    scenario : Scenario
    table : DataFrame
        A row for each point (``name`` is ``frontier``) and gain set: ``I_K`` and ``E_K`` in s^2,
        ``R_K`` and ``spectral_abscissa`` in 1/s, and the gains.

    Examples
    --------
    >>> files = ft.frontier("paper", points=3).save("runs/paper")
    """

    scenario: Scenario
    table: pd.DataFrame

    @property
    def sheet(self) -> Any:
        """R_K against I_K, and the same gains against E_K."""
        return function_for(self, FIGURES)(self)

    def save(self, folder: str | Path) -> dict[str, Path]:
        """Write ``frontier.csv`` and ``frontier.svg`` into a folder."""
        csv, figure = (Path(folder) / f"frontier.{ending}" for ending in ("csv", "svg"))
        with together():
            write_text(csv, self.table.to_csv(index=False, lineterminator="\n"))
            self.sheet.save(figure)
        return {"csv": csv, "figure": figure}


def frontier(
    source: Scenario | str | Path, *, points: int = POINTS, changes: Mapping[str, Any] | None = None
) -> Frontier:
    """Find the largest R_K for each I_K, with the paper's and the scenario's gains for comparison.

    25 points take some seconds.

    Parameters
    ----------
    source : Scenario, str or Path
        A scenario, its file, or the name of a shipped scenario.
    points : int
        Points of the frontier, at least 2, from the smallest I_K, where they are closest.
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.

    Returns
    -------
    Frontier
        Only the gain sets if no stable gains were found within the limits.

    Raises
    ------
    InputError, ScenarioError
        If the scenario cannot be read, its objective is E_K or decay, or `points` is less than 2.

    Examples
    --------
    >>> sorted(set(ft.frontier("paper", points=3).table["name"]))[-3:]
    ['frontier', 'paper', 'tuned']
    """
    scenario = as_scenario(source, changes)
    if (objective := scenario.tuning.objective) in ("E_K", "decay"):
        raise InputError(
            "`objective` of [tuning] must be R_K or cost for a frontier, which is the largest R_K "
            f"for each I_K, got {objective}; `tune` finds those gains."
        )
    law, flight = scenario.laws[0], scenario.flight
    names = [name for name in scenario.gain_names if scenario.law_of(name)[0].by_gains]
    sets = {**paper_family(), **{name: models.gain_set(scenario, name) for name in names}}
    marked = {
        name: law.gains_from(gains, V_a=flight.V_a_mps, g=flight.g_mps2)
        for name, gains in sets.items()
        if gains is not None
    }
    table = frontier_table(models.tuning_problem(scenario), points=points, marked=marked)
    return Frontier(scenario=scenario, table=table)
