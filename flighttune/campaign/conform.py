"""Boxes of an aircraft's residual rates, fitted to some flights and tested on new ones."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from flighttune.arrays import FloatArray, check_not_negative
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.planning.load import campaign_on
from flighttune.campaign.planning.places import dispersed_places
from flighttune.campaign.planning.plan import Plan
from flighttune.campaign.planning.schema import Campaign, Choice, Design, Dispersion, Grid, Uniform
from flighttune.campaign.stated_set import planned
from flighttune.claims.boxes import WINDOW_S, Over, RateBoxes, Windows
from flighttune.claims.conformance import Conformance, boxes_at_scale
from flighttune.claims.count import fresh_flights, refuting_outside
from flighttune.claims.distribution import Distribution, flown_values
from flighttune.control.law import split_name
from flighttune.errors import InputError
from flighttune.files.table import hash_of
from flighttune.flight.conditions import reference_of, start_condition
from flighttune.gaps.residual import RESIDUALS, ConformantModel, residuals_of
from flighttune.identification.file import identified_tables, load_identified
from flighttune.scenario.load import scenario_from
from flighttune.scenario.places import spelled
from flighttune.scenario.schema import GainsTable, Scenario
from flighttune.scenario.tables import INTENSITIES
from flighttune.simulate.run import Run

# Column of what is kept of the residuals of each flight.
KEPT = "residuals"

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

# Number of training flights about a scenario.
TRAINING_FLIGHTS = 500


@dataclass(frozen=True, slots=True, kw_only=True)
class ConformSettings:
    """The claim to make, and the flights that it covers."""

    epsilon: float = 0.01  # 1; largest probability that a flight leaves the boxes
    confidence: float = 0.999  # 1; confidence of the claim
    flights: int | None = None  # fresh flights, by default as for `fresh_flights`
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

    def __post_init__(self) -> None:
        fresh_flights(self.flights, self.epsilon, self.confidence)
        check_not_negative(start_deg=self.start_deg)


def conform(source: str, settings: ConformSettings, pool: WorkerPool) -> Conformance:
    """Learn boxes of the residual rates of an aircraft, and count fresh flights against them.

    Parameters
    ----------
    source : str
        Folder of a campaign, whose draws are learned from, or a campaign or scenario file or the
        name of a shipped one.
    settings : ConformSettings
    pool : WorkerPool
        Flies.

    Returns
    -------
    Conformance

    Raises
    ------
    InputError, ScenarioError
        If source, gains, plant or air are not there, the aircraft has no identified model, or more
        fresh flights were not completed than may lie outside.
    StoppedError
        If the observer of the pool stopped the flights.

    Notes
    -----
    The shape of the boxes is learned from some flights. Each fresh flight then has a score, the
    scale of that shape with which it stays inside, and the scale of the boxes is an order statistic
    of the scores (`counted_scale`). Fresh flights are those of ``design = "random"``, whatever the
    design of those learned from.
    """
    plan, fresh, model, windows = _plans(source, settings)
    training = plan.runs
    probe = partial(_residuals_of, model, windows)
    rows = pool.in_order(
        plan, range(training), doing="learning", probes={KEPT: partial(probe, None)}
    )
    extremes = [row[KEPT] for row in rows if row.get(KEPT)]
    lows, highs = np.moveaxis(np.reshape(extremes, (-1, 2, windows.count, len(RESIDUALS))), 1, 0)
    learned = RateBoxes.around(windows, lows, highs)
    scores = _scores(pool, fresh, partial(probe, learned), training, "counting")
    completed = scores[np.isfinite(scores)]
    boxes = boxes_at_scale(learned, scores, settings.epsilon, settings.confidence)
    (group,) = fresh.groups
    gains = fresh.gain_sets[group.gains]
    assert gains is not None  # of the group that was chosen
    ((aircraft, files),) = fresh.aircraft.items()
    return Conformance(
        aircraft=aircraft,
        gains_name=group.gains,
        gains=gains,
        model=model,
        learned=learned,
        boxes=boxes,
        epsilon=settings.epsilon,
        confidence=settings.confidence,
        scores=completed,
        not_completed=len(scores) - len(completed),
        training=training,
        seed=fresh.campaign.seed,
        distribution=distribution_of(fresh.campaign, group.plant),
        aircraft_sha256=files,
        identified_sha256=hash_of(identified_tables(load_identified(aircraft))),
        campaign_sha256=_campaign_hash(fresh, model, windows),
    )


def recount(
    source: str, conformance: Conformance, settings: ConformSettings, pool: WorkerPool
) -> dict[str, int]:
    """Fly as many flights again as were counted, of the same distribution with another seed.

    Returns their number, how many are outside, and from how many on they refute the claim.
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
        flights=len(conformance.all_scores),
        gains=conformance.gains_name,
        tables=(kept,),
        air=conformance.distribution.air,
        over=conformance.boxes.windows.over,
        window=conformance.boxes.windows.length,
        seed=conformance.seed,
    )
    _, counted, model, windows = _plans(source, settings)
    # The last digits of tuned gains depend on the machine, and the hash depends on them.
    counted = counted.with_tuned_gains_of(
        replace(counted, gain_sets={conformance.gains_name: conformance.gains})
    )
    if _campaign_hash(counted, model, windows) != conformance.campaign_sha256:
        raise InputError(
            f"{source}: must be the source of the conformance, with the same aircraft, --start-deg "
            "and --plant, got another hash."
        )
    again = replace(counted, campaign=counted.campaign.model_copy(update={"seed": seed}))
    probe = partial(_residuals_of, model, windows, conformance.boxes)
    scores = _scores(pool, again, probe, conformance.training, "counting again")
    refuting = refuting_outside(len(scores), conformance.epsilon, conformance.confidence)
    return {"flights": len(scores), "outside": int(np.sum(scores > 1.0)), "refuting": refuting}


def _plans(source: str, settings: ConformSettings) -> tuple[Plan, Plan, ConformantModel, Windows]:
    """Plans of the training and of the fresh flights, and the model and windows of the residuals.

    All are of one aircraft and one gain set.
    """
    chosen = ("plant", "start_deg", "gains", "tables", "changes")
    options = {key: getattr(settings, key) for key in chosen}
    plan = planned(source, kind="jsbsim", draws=TRAINING_FLIGHTS, **options)
    gains = settings.gains if settings.gains in plan.gain_sets else None  # None for a file
    group = plan.chosen_group(settings.plant, gains, kind="jsbsim")
    plan.scenario.check_over_time("boxes of residual rates")
    campaign = in_air(plan.campaign, settings.air or air_of(plan.campaign.central))
    if settings.seed is not None:
        campaign = campaign.model_copy(update={"seed": settings.seed})
    in_this_air = replace(plan, campaign=campaign)
    over = settings.over or _over(in_this_air)
    windows = Windows.covering(over, campaign.nominal.flight.duration_s, settings.window)
    aircraft = campaign.nominal.plant_table(group.plant).aircraft or ""
    learned = replace(
        in_this_air.of_group(group),
        runs=plan.draws,
        aircraft={aircraft: plan.aircraft[aircraft]},
    )
    # Fresh draws are numbered after the training draws, whose seeds they must not share.
    flights = fresh_flights(settings.flights, settings.epsilon, settings.confidence)
    fresh = replace(learned, campaign=at_random(campaign), runs=plan.draws + flights)
    check_random(source, distribution_of(fresh.campaign, group.plant), campaign.central)
    return learned, fresh, conformant_model(campaign.nominal, group.plant), windows


def check_random(source: str, distribution: Distribution, central: Scenario) -> None:
    """Refuse flights of a source that are all the same."""
    drawn = any(len({*values}) > 1 for values in distribution.dispersed.values())
    if not (drawn or central.turbulence or central.sensors):
        raise InputError(
            f"{source}: `start_deg` must be given for a scenario in which nothing is random: all "
            "its flights are the same."
        )


def _scores(
    pool: WorkerPool, fresh: Plan, probe: "partial[list[float]]", first: int, doing: str
) -> FloatArray:
    """Score of each fresh flight from a run on; infinite for one that was not completed."""
    rows = pool.in_order(fresh, range(first, fresh.runs), doing=doing, probes={KEPT: probe})
    return np.array([row[KEPT][0] if KEPT in row else math.inf for row in rows])


def _residuals_of(
    model: ConformantModel,
    windows: Windows,
    boxes: RateBoxes | None,
    run: Run,
    scenario: Scenario,
) -> list[float]:
    """The score of a flight in boxes; without boxes its extremes, lowest first."""
    references = (run.signals[name].to_numpy() for name in ("chi_ref", "gamma_ref"))
    window = windows.of_samples(run.t, *references)
    extremes = windows.extremes(residuals_of(model, run, start_condition(scenario)), window)
    return np.ravel(extremes).tolist() if boxes is None else [boxes.score(*extremes)]


def _campaign_hash(plan: Plan, model: ConformantModel, windows: Windows) -> str:
    """Hash of the flights that are counted, and of what is counted of them."""
    phi, n_z = map(asdict, model.lags)
    counted = {
        "model": {"V_a_mps": model.V_a, "g_mps2": model.g, "phi": phi, "n_z": n_z},
        "windows": asdict(windows),
    }
    return hash_of({**plan.as_dict(), "residuals": counted})


def conformant_model(scenario: Scenario, plant: str) -> ConformantModel:
    """The point mass behind the identified lag against which flights of a scenario are checked."""
    flight = scenario.flight
    identified = load_identified(scenario.plant_table(plant).aircraft or "")
    nearest = identified.nearest(flight.V_a_mps, reference_of(scenario).initial[1])
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


def distribution_of(campaign: Campaign, plant: str) -> Distribution:
    """The keys with one value in all flights of a plant, and how all other keys are drawn."""
    position = [table.label for table in campaign.nominal.plant].index(plant)
    # A table that is only there because one of its keys is drawn has its other keys too.
    nominal, fixed = (
        flown_values(scenario, scenario.plant[position])
        for scenario in (campaign.nominal, campaign.central)
    )
    places = dispersed_places(campaign.disperse, campaign.nominal, campaign.title)
    dispersed: dict[str, list[Any]] = {}
    disperse: list[dict[str, Any]] = []
    for table in campaign.disperse:
        own = [place for place in places[table.key] if place[0] != "plant" or place[1] == position]
        for place in own:
            key = spelled(("plant", *place[2:]) if place[0] == "plant" else place)
            fixed.pop(key, None)
            dispersed[key] = _range(table, nominal.get(key))
        disperse += [table.model_dump(mode="json")] * bool(own)
    correlation = campaign.model_dump(mode="json", include={"correlation"})
    return Distribution(
        title=campaign.title,
        air=air_of(campaign.central),
        fixed=fixed,
        dispersed=dispersed,
        disperse=disperse,
        **correlation,
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
        moving.add(np.any(np.diff(reference_of(scenario).sampled(t)) != 0.0, axis=0).tobytes())
    return "time" if len(moving) == 1 else "phase"
