"""Boxes of an aircraft's residual rates, fitted to some flights and tested on new ones."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.arrays import FloatArray, check_at_least, check_between, check_not_negative
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.planning.load import campaign_on
from flighttune.campaign.planning.plan import Plan, plan_campaign
from flighttune.campaign.planning.schema import (
    Campaign,
    CampaignTable,
    Choice,
    Design,
    Dispersion,
    Grid,
    Uniform,
)
from flighttune.campaign.stated_set import planned, rows_of
from flighttune.conformance.boxes import (
    WINDOW_S,
    Over,
    RateBoxes,
    ResidualSummary,
    Windows,
    fitted_boxes,
)
from flighttune.conformance.file import (
    Attempt,
    Conformance,
    Distribution,
    flights_needed,
    flown_values,
)
from flighttune.conformance.residual import COUNTED, ConformantModel
from flighttune.control.law import split_name
from flighttune.errors import InputError
from flighttune.identify.file import identified_tables, load_identified
from flighttune.scenario.load import check_aircraft, scenario_from
from flighttune.scenario.places import spelled
from flighttune.scenario.schema import GainsTable, Scenario
from flighttune.scenario.tables import INTENSITIES, TUNED_IDENTIFIED
from flighttune.shipped import aircraft_folders
from flighttune.simulate.run import Run
from flighttune.table_file import hash_of
from flighttune.units import DEG_PER_RAD

# Column of the extremes of the residual rates of each flight, window by window.
RESIDUALS = "residuals"

CALM, STEADY_WIND = "calm", "wind"

# Tables of a scenario that calm air and steady wind do not have.
DROPPED = {
    CALM: ("disturbance", "gust", "turbulence", "wind"),
    STEADY_WIND: ("gust", "turbulence"),
}

# Points of the unit interval at which a dispersed key counts as lowest and highest.
UNIT_ENDS = (1e-9, 1.0 - 1e-9)

# Draws used to decide whether the references of a campaign move at the same instants.
SAMPLED_DRAWS = 16

# Number of training flights for a scenario without a campaign.
OWN_FLIGHTS = 500

# Fresh flights flown at a time; the count ends after a part in which one is outside.
PART = 4096


@dataclass(frozen=True, slots=True, kw_only=True)
class ConformSettings:
    """The claim to make, and the flights that it covers."""

    epsilon: float = 0.01  # 1; largest probability that a flight leaves the boxes
    confidence: float = 0.999  # 1; confidence of the claim, shared by all attempts
    attempts: int = 3  # maximum number of counts, fixed beforehand
    gains: str | None = None  # by default tuned_identified if the campaign has it, else its first
    plant: str | None = None  # label of an aircraft, by default the first
    air: str | None = None  # calm, wind, light, moderate or severe; by default the likeliest
    # by default time where all flights follow the same reference, else phase
    over: Over | None = None
    # s; shorter windows fit the flights more closely and are left more easily
    window: float = WINDOW_S
    start_deg: float = 0.0  # deg; range of the starts of a scenario in course and path angle
    seed: int | None = None  # seed of the draws, by default the campaign's
    tables: tuple[GainsTable, ...] = ()  # gain sets that the source does not have
    changes: Mapping[str, Any] = field(default_factory=dict)  # values of the scenario by dotted key

    @property
    def flights(self) -> int:
        """Fresh flights of each attempt."""
        return math.ceil(flights_needed(self.epsilon, self.confidence, self.attempts))

    def __post_init__(self) -> None:
        check_between(0.0, 1.0, epsilon=self.epsilon, confidence=self.confidence)
        check_at_least(1, attempts=self.attempts)
        check_not_negative(start_deg=self.start_deg)


def conform(source: str, settings: ConformSettings, pool: WorkerPool) -> Conformance:
    """Learn boxes of the residual rates of an aircraft, and count fresh flights against them.

    Parameters
    ----------
    source : str
        Folder of a campaign, whose draws are learned from; a campaign or scenario file or the name
        of a shipped one; or an aircraft (name or folder), which flies a random campaign of its own.
    settings : ConformSettings
    pool : WorkerPool
        Flies.

    Returns
    -------
    Conformance
        Its attempts end with the first without a flight outside.

    Raises
    ------
    InputError, ScenarioError
        If source, gains, plant or air are not there, or the aircraft has no identified model.
    StoppedError
        If the observer of the pool stopped the flights.

    Notes
    -----
    A plain holdout count: boxes that a flight leaves with a probability above epsilon are left by
    none of N independent fresh flights with a probability below ``(1 - epsilon)^N``. N and the
    number of attempts are fixed beforehand, and the flights of an attempt are used to fit the boxes
    of the next one only, so that the error probabilities of all attempts add up to at most
    ``1 - confidence`` (Bonferroni). Fresh flights are those of ``design = "random"``, whatever the
    design of those learned from. A count ends early once a flight is outside: it has failed.
    """
    learned, fresh, summary = _plans(source, settings)
    first, each = learned.runs, settings.flights
    attempts: list[Attempt] = []
    training = _extremes(pool, learned, summary, range(first), "learning")
    while True:
        completed = training[:, ~np.isnan(training[0]).any(axis=(1, 2))]
        boxes, widened = fitted_boxes(summary.windows, *completed, each)
        counted = _counted(pool, fresh, summary, range(first, first + each), boxes)
        outside, end = int(np.sum(~boxes.hold(*counted))), first + counted.shape[1]
        attempts.append(Attempt((0, first), (first, end), outside, widened))
        if not outside or len(attempts) == settings.attempts:
            break
        first = end
        training = np.concatenate([training, counted], axis=1)
    (group,) = fresh.groups
    gains = fresh.gain_sets[group.gains]
    assert gains is not None  # of the group that was chosen
    ((aircraft, files),) = fresh.aircraft.items()
    return Conformance(
        aircraft=aircraft,
        gains_name=group.gains,
        gains=gains,
        model=summary.model,
        boxes=boxes,
        epsilon=settings.epsilon,
        confidence=settings.confidence,
        planned=settings.attempts,
        attempts=tuple(attempts),
        seed=fresh.campaign.seed,
        distribution=distribution_of(fresh, group.plant),
        aircraft_sha256=files,
        identified_sha256=hash_of(identified_tables(load_identified(aircraft))),
        campaign_sha256=_campaign_hash(fresh, summary),
    )


def recount(
    source: str, conformance: Conformance, settings: ConformSettings, pool: WorkerPool
) -> Attempt:
    """Fly as many flights again as were counted, of the same distribution with another seed.

    The claim, gains, air and windows of the conformance replace those of the settings; the seed is
    by default the next one.
    """
    seed = conformance.seed + 1 if settings.seed is None else settings.seed
    if seed == conformance.seed:
        raise InputError(f"`seed` must not be that of the flights counted, got {seed}.")
    kept = GainsTable(name=split_name(conformance.gains_name)[1], **conformance.gains.as_lists())
    settings = replace(
        settings,
        epsilon=conformance.epsilon,
        confidence=conformance.confidence,
        attempts=conformance.planned,
        gains=conformance.gains_name,
        tables=(kept,),
        air=conformance.distribution.air,
        over=conformance.boxes.windows.over,
        window=conformance.boxes.windows.length,
        seed=conformance.seed,
    )
    _, counted, summary = _plans(source, settings)
    # The last digits of tuned gains depend on the machine, and the hash depends on them.
    counted = counted.with_tuned_gains_of(
        replace(counted, gain_sets={conformance.gains_name: conformance.gains})
    )
    if _campaign_hash(counted, summary) != conformance.campaign_sha256:
        raise InputError(
            f"{source}: must be the source of the conformance, with the same aircraft, --start-deg "
            "and --plant, got another hash."
        )
    again = replace(counted, campaign=counted.campaign.model_copy(update={"seed": seed}))
    last = conformance.attempts[-1]
    extremes = _extremes(pool, again, summary, range(*last.counted), "counting again")
    return replace(last, outside=int(np.sum(~conformance.boxes.hold(*extremes))))


def _plans(source: str, settings: ConformSettings) -> tuple[Plan, Plan, ResidualSummary]:
    """Plans of the training and of the fresh flights, and the summary made of each flight.

    All are of one aircraft and one gain set.
    """
    if source in aircraft_folders() or (Path(source) / "aircraft.toml").is_file():
        plan = plan_campaign(own_campaign(source))
    else:
        chosen = {"plant": settings.plant, "start_deg": settings.start_deg}
        chosen |= {key: getattr(settings, key) for key in ("gains", "tables", "changes")}
        plan = planned(source, kind="jsbsim", draws=OWN_FLIGHTS, **chosen)
    gains = settings.gains if settings.gains in plan.gain_sets else None  # None for a file
    group = plan.chosen_group(settings.plant, gains, kind="jsbsim")
    campaign = in_air(plan.campaign, settings.air or air_of(plan.campaign.central))
    if settings.seed is not None:
        campaign = campaign.model_copy(update={"seed": settings.seed})
    drawn = [table for table in at_random(campaign).disperse if not _is_degenerate(table)]
    if not (drawn or campaign.nominal.turbulence or campaign.nominal.sensors):
        raise InputError(
            f"{source}: `start_deg` must be given for a scenario in which nothing is random: all "
            "its flights are the same."
        )
    in_this_air = replace(plan, campaign=campaign)
    summary = ResidualSummary(
        model=conformant_model(campaign.nominal, group.plant),
        windows=Windows.covering(
            settings.over or _over(in_this_air), campaign.nominal.flight.duration_s, settings.window
        ),
    )
    aircraft = campaign.nominal.plant_table(group.plant).aircraft or ""
    learned = replace(
        in_this_air.of_group(group),
        runs=plan.draws,
        aircraft={aircraft: plan.aircraft[aircraft]},
    )
    # Fresh draws are numbered after the training draws, whose seeds they must not share.
    runs = plan.draws + settings.attempts * settings.flights
    return learned, replace(learned, campaign=at_random(campaign), runs=runs), summary


def _is_degenerate(table: Dispersion) -> bool:
    """Whether a key that is drawn has the same value in every flight."""
    if not isinstance(table, Choice):
        return False
    weights = table.weights or [1.0] * len(table.values)
    return len({value for value, weight in zip(table.values, weights, strict=True) if weight}) < 2


def _counted(
    pool: WorkerPool, plan: Plan, summary: ResidualSummary, runs: range, boxes: RateBoxes
) -> FloatArray:
    """`_extremes` of fresh flights, `PART` at a time, until one is outside."""
    parts: list[FloatArray] = []
    count = math.ceil(len(runs) / PART)
    for i in range(count):
        doing = "counting" if count == 1 else f"counting, part {i + 1} of {count}"
        part = runs[i * PART : (i + 1) * PART]
        parts.append(_extremes(pool, plan, summary, part, doing))
        if not boxes.hold(*parts[-1]).all():
            break
    return np.concatenate(parts, axis=1)


def _extremes(
    pool: WorkerPool, plan: Plan, summary: ResidualSummary, runs: range, doing: str
) -> FloatArray:
    """Lowest and highest residuals of some runs, shape (2, runs, windows, 6).

    NaN for a flight that was not completed.
    """
    probes = {RESIDUALS: partial(_residuals_of, summary)}
    rows = rows_of(pool, plan, doing, runs=runs, probes=probes)
    shape = 2, summary.windows.count, len(COUNTED)
    lost = np.full(shape, np.nan)
    values = rows[RESIDUALS].to_pylist()
    return np.stack([lost if own is None else np.reshape(own, shape) for own in values], axis=1)


def _residuals_of(summary: ResidualSummary, run: Run, scenario: Scenario) -> list[float]:
    """The extremes of the residual rates of a flight, lowest first."""
    return np.ravel(summary.of_flight(run, scenario.condition)).tolist()


def _campaign_hash(plan: Plan, summary: ResidualSummary) -> str:
    """Hash of the flights that are counted, and of what is counted of them."""
    model = summary.model
    phi, n_z = map(asdict, model.lags)
    counted = {
        "model": {"V_a_mps": model.V_a, "g_mps2": model.g, "phi": phi, "n_z": n_z},
        "windows": asdict(summary.windows),
    }
    return hash_of({**plan.as_dict(), "residuals": counted})


def conformant_model(scenario: Scenario, plant: str) -> ConformantModel:
    """The point mass behind the identified lag against which flights of a scenario are checked."""
    flight = scenario.flight
    identified = load_identified(scenario.plant_table(plant).aircraft or "")
    nearest = identified.nearest(flight.V_a_mps, scenario.followed().initial[1])
    return ConformantModel(V_a=flight.V_a_mps, g=flight.g_mps2, lags=nearest.lags)


def air_of(scenario: Scenario) -> str:
    """Class of a scenario's air: ``calm``, ``wind``, or the intensity of its turbulence."""
    if scenario.turbulence is not None:
        return scenario.turbulence.intensity or f"severity {scenario.turbulence.severity}"
    return STEADY_WIND if scenario.windy or scenario.disturbance is not None else CALM


def in_air(campaign: Campaign, air: str) -> Campaign:
    """A campaign with only the draws that fly in one class of air; in calm air without its wind."""
    nominal, central = campaign.nominal.as_dict(), campaign.central
    airs = {CALM, air_of(central), *((STEADY_WIND,) if central.wind else ())}
    if central.turbulence is not None and central.turbulence.intensity:
        airs |= set(INTENSITIES)
    if air not in airs:
        raise InputError(f"`air` must be one of {', '.join(sorted(airs))}, got {air!r}.")
    dropped = DROPPED.get(air, ("turbulence",) if air in INTENSITIES else ())
    tables = {name: table for name, table in nominal.items() if name not in dropped}
    disperse = [own for own in campaign.disperse if own.key.split(".")[0] not in dropped]
    if air in INTENSITIES:
        turbulence = central.model_dump(mode="json", exclude_none=True)["turbulence"]
        tables["turbulence"] = {**turbulence, "intensity": air}
    return _rebuilt(campaign, disperse, scenario_from(tables), campaign.design)


def at_random(campaign: Campaign) -> Campaign:
    """The same campaign with independent draws; points of a grid become equally likely values."""
    disperse = [
        Choice(key=own.key, acts=own.acts, values=own.levels) if isinstance(own, Grid) else own
        for own in campaign.disperse
    ]
    return _rebuilt(campaign, disperse, campaign.nominal, "random")


def _rebuilt(
    campaign: Campaign, disperse: Sequence[Dispersion], nominal: Scenario, design: Design
) -> Campaign:
    gridded = any(isinstance(table, Grid) for table in disperse)
    keys = {table.key for table in disperse}
    changed = {
        "design": "random" if design == "grid" and not gridded else design,
        "disperse": disperse,
        "correlation": [
            correlation for correlation in campaign.correlation if keys >= set(correlation.keys)
        ],
    }
    return campaign_on(campaign.model_copy(update=changed), nominal, campaign.title)


def distribution_of(plan: Plan, plant: str) -> Distribution:
    """The keys with one value in all flights of a plan, and the distributions of all other keys."""
    position = [table.label for table in plan.scenario.plant].index(plant)
    # A table that is only there because one of its keys is drawn has its other keys too.
    nominal, fixed = (
        flown_values(scenario, scenario.plant[position])
        for scenario in (plan.scenario, plan.campaign.central)
    )
    dispersed: dict[str, list[Any]] = {}
    for table in plan.campaign.disperse:
        for place in plan.places[table.key]:
            if place[0] == "plant" and place[1] != position:
                continue
            key = spelled(("plant", *place[2:]) if place[0] == "plant" else place)
            fixed.pop(key, None)
            dispersed[key] = _range(table, nominal.get(key))
    tables = plan.campaign.model_dump(mode="json", include={"disperse", "correlation"})
    return Distribution(
        title=plan.campaign.title,
        air=air_of(plan.campaign.central),
        fixed=fixed,
        dispersed=dispersed,
        **tables,
    )


def _range(table: Dispersion, own: Any) -> list[Any]:
    if isinstance(table, Choice):
        values = [value for value in table.values if value == value]
        if any(isinstance(value, str) for value in values):
            return values
        ends = [min(values), max(values)]
    elif isinstance(table, Uniform):
        ends = [table.lower, table.upper]
    else:
        ends = table.at(np.array(UNIT_ENDS)).tolist()
    if table.acts == "adds":
        return [own + value for value in ends]
    return sorted(own * value for value in ends) if table.acts == "multiplies" else ends


def _over(plan: Plan) -> Over:
    """``time`` if the references of the first draws move at the same instants, else ``phase``."""
    moving = set()
    for draw in range(min(plan.draws, SAMPLED_DRAWS)):
        scenario = plan.scenario_of(draw)
        rate = scenario.controller.rate_hz
        t = np.arange(round(scenario.flight.duration_s * rate) + 1) / rate
        moving.add(np.any(np.diff(scenario.followed().sampled(t)) != 0.0, axis=0).tobytes())
    return "time" if len(moving) == 1 else "phase"


def own_campaign(aircraft: str) -> Campaign:
    """A campaign of an aircraft that has none: random starts and references in calm air.

    Turns and changes of path angle are ramps of random rate that stay inside the limits, from
    steady flight at the first condition of the identified model.
    """
    limits = load_aircraft(aircraft).limits
    first = load_identified(aircraft).conditions[0]
    ramp = {"shape": "ramp", "rate_dps": 0.0}
    scenario = scenario_from(
        {
            "title": f"ramps of {aircraft}",
            "gains": [TUNED_IDENTIFIED],
            "flight": {"V_a_mps": first.V_a, "h_m": first.h, "duration_s": 20.0},
            "reference": {
                "chi_deg": [{**ramp, "start_s": 2.0, "duration_s": 6.0}],
                "gamma_deg": [{**ramp, "start_s": 5.0, "duration_s": 3.0}],
            },
            "limits": {
                "phi_deg": [edge * DEG_PER_RAD for edge in limits.phi],
                "phi_rate_dps": limits.phi_rate * DEG_PER_RAD,
                "n_z": list(limits.n_z),
                "n_z_rate_per_s": limits.n_z_rate,
            },
            "controller": {"feed_forward": True},
            "plant": [{"kind": "jsbsim", "aircraft": aircraft}],
        }
    )
    check_aircraft(scenario, aircraft)
    roll = min(-limits.phi[0], limits.phi[1])
    turn = scenario.flight.g_mps2 * math.tan(0.5 * roll) / first.V_a * DEG_PER_RAD
    uniform = {
        "flight.chi_deg": 5.0,
        "flight.gamma_deg": 2.0,
        "reference.chi_deg[0].rate_dps": turn,
        "reference.gamma_deg[0].rate_dps": 1.0,
    }
    table = CampaignTable(
        title=f"random starts and references of {aircraft}",
        scenario=aircraft,
        runs=OWN_FLIGHTS,
        disperse=[Uniform(key=key, lower=-width, upper=width) for key, width in uniform.items()],
    )
    return campaign_on(table, scenario, aircraft)
