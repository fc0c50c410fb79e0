"""Rules between the tables of a scenario, and the messages that refuse it."""

from collections.abc import Callable, Iterator
from itertools import product
from typing import TypeAlias

from flighttune.base.errors import InputError
from flighttune.base.files.shipped import nearest_name
from flighttune.base.files.table import abridged
from flighttune.base.quantities import FASTEST_WIND, STEEPEST_DEG, Table
from flighttune.control.gains import COMMANDS, paper_family
from flighttune.control.gains_keys import TUNED, TUNED_FOR_AIRCRAFT
from flighttune.flight.metrics import CHANNELS, OFF_ROUTE, UNSETTLED, required_names
from flighttune.flight.scenario.keys import ScenarioKeys

# Maximum samples of the controller in a flight: five and a half hours at 50 Hz, 200 MB of signals.
MAX_SAMPLES = 1_000_000

# deg, and share of a duration.
ROUNDING = 1e-9

# A rule between tables of a scenario: it returns one line for each violation.
Rule: TypeAlias = Callable[[ScenarioKeys], Iterator[str]]


def needs(key: str, why: str, when: Callable[[ScenarioKeys], object]) -> Rule:
    """A key that some scenarios require; ``table.key`` names a key of a table."""

    def rule(scenario: ScenarioKeys) -> Iterator[str]:
        if not when(scenario):
            return
        owner, name, words = _named(scenario, key)
        if name not in owner.model_fields_set or getattr(owner, name) is None:
            yield f"{words} must be given {why}"

    return rule


def excludes(key: str, why: str, when: Callable[[ScenarioKeys], object]) -> Rule:
    """A key that some scenarios exclude; ``table.key`` names a key of a table."""

    def rule(scenario: ScenarioKeys) -> Iterator[str]:
        if not when(scenario):
            return
        owner, name, words = _named(scenario, key)
        if getattr(owner, name) != type(owner).model_fields[name].default:
            yield f"{words} must be absent {why}"

    return rule


def _named(scenario: ScenarioKeys, key: str) -> tuple[Table, str, str]:
    """The table of a key, the key in it, and its name in a message."""
    table, _, name = key.rpartition(".")
    if not table:
        return scenario, name, f"`{name}`"
    return getattr(scenario, table), name, f"`{name}` of [{table}]"


def gains_are_known(scenario: ScenarioKeys) -> Iterator[str]:
    """Gains without numbers must be the paper's or tuned."""
    available = [TUNED, *paper_family(), *reversed(TUNED_FOR_AIRCRAFT)]
    for entry in scenario.gains:
        if isinstance(entry, str) and entry not in available:
            yield (
                f"`gains` must be one of {', '.join(available)}, a file of gains (.json, "
                f".toml) or a table with K_P and K_I, got {abridged(entry)}"
                + nearest_name(entry, available).removesuffix(".")
            )


def input_limits_are_those_of_commands(scenario: ScenarioKeys) -> Iterator[str]:
    """The first command can be limited only if gains act on it."""
    for law in scenario.laws:
        if scenario.tuning.input_limits and law.inputs != COMMANDS:
            yield (
                f"`input_limits` of [tuning] must be absent with the {law.kind} law: its gains "
                "act on rates, not on roll and load factor"
            )


def an_identified_model_is_named(scenario: ScenarioKeys) -> Iterator[str]:
    """Gains tuned on an identified model need the model."""
    on_identified = any(name in scenario.gains for name in TUNED_FOR_AIRCRAFT)
    if on_identified or scenario.tuning.model == "identified":
        try:
            _ = scenario.identified_name
        except InputError as error:
            yield str(error)


def _labels(scenario: ScenarioKeys) -> dict[str, list[str]]:
    laws, plants = [law.name for law in scenario.laws], [plant.label for plant in scenario.plant]
    return {"law": laws, "gains": [*scenario.gain_names], "plant": plants}


def names_differ(scenario: ScenarioKeys) -> Iterator[str]:
    """Laws, gains and plants need distinct names."""
    for key, labels in _labels(scenario).items():
        if len(set(labels)) < len(labels):
            hint = "; a `name` of its own distinguishes a plant" if key == "plant" else ""
            yield f"`{key}` must not name anything twice, got {', '.join(labels)}{hint}"


def requirements_are_of_its_runs(scenario: ScenarioKeys) -> Iterator[str]:
    """Gains and plants of a requirement must belong to the scenario."""
    labels_of = _labels(scenario)
    labels_of["plant"] += [plant.kind for plant in scenario.plant]
    for table, key in product(scenario.expect, ("gains", "plant")):
        if (label := getattr(table, key)) not in (None, *labels_of[key]):
            labels = ", ".join(dict.fromkeys(labels_of[key]))
            yield f"`{key}` of [[expect]] must be one of {labels}, got {abridged(label)}"


def a_law_without_a_model_has_no_E_star(scenario: ScenarioKeys) -> Iterator[str]:
    """The largest error under a disturbance needs a linear loop."""
    law, E_star = scenario.laws[0], scenario.tuning.E_star
    if E_star is not None and not law.by_gains:
        yield (
            f"`E_star` of [tuning] must be absent with the law {law.name}, which has no linear "
            f"model, got {E_star:g}"
        )


def something_is_followed(scenario: ScenarioKeys) -> Iterator[str]:
    """A scenario needs a reference over time or a route."""
    if (scenario.reference is None) == (scenario.route is None):
        yield "`reference` or `route` must be given, and not both"


def measures_are_those_of_what_is_followed(scenario: ScenarioKeys) -> Iterator[str]:
    """Distances need a route, and settling times need a reference over time."""
    tables = [table.model_dump() for table in scenario.expect]
    for channel, names in required_names(tables).items():
        if scenario.route is None and channel in OFF_ROUTE:
            yield f"`{channel}` of [[expect]] must be absent without [route]"
        if scenario.route is not None and channel in CHANNELS and UNSETTLED[0] in names:
            yield (
                f"`{channel}.settling_s` of [[expect]] must be absent with [route], whose "
                "guidance commands small changes all the time: bound `flight.cross_track_m` "
                "and `flight.height_err_m`"
            )


def samples_can_be_flown(scenario: ScenarioKeys) -> Iterator[str]:
    """A flight needs at least two samples, and not more than fit into memory."""
    duration, rate = scenario.flight.duration_s, scenario.controller.rate_hz
    if not 2.0 <= duration * rate <= MAX_SAMPLES:
        yield (
            "`duration_s` of [flight] must be at least two samples of the controller and at "
            f"most {MAX_SAMPLES}, got {duration:g} s at {rate:g} Hz"
        )


def all_begins_in_the_flight(scenario: ScenarioKeys) -> Iterator[str]:
    """An event after the end of the flight is a mistake."""
    duration, reference = scenario.flight.duration_s, scenario.reference
    segments = reference.segments if reference else []
    times = [(f"[reference.{key}] `start_s`", segment.start_s) for key, segment in segments]
    if scenario.gust:
        times.append(("[gust] `start_s`", scenario.gust.start_s))
    if scenario.disturbance:
        times += scenario.disturbance.last_switches()
    for key, time in times:
        if time >= duration:
            yield (
                f"{key} must lie before the end of the flight "
                f"(`duration_s` of [flight], {duration:g} s), got {time:g} s"
            )


def paths_are_not_vertical(scenario: ScenarioKeys) -> Iterator[str]:
    """A vertical path has no course."""
    t, gamma_deg = 0.0, scenario.flight.gamma_deg
    if scenario.reference is not None:
        t, gamma_deg = scenario.reference.steepest(scenario.flight)
    if abs(gamma_deg) > STEEPEST_DEG + ROUNDING:
        yield (
            f"[reference] `gamma_deg` must stay within +-{STEEPEST_DEG:g} deg, "
            f"got {gamma_deg:g} deg at t = {t:g} s"
        )


def a_disturbance_through_the_air_is_alone(scenario: ScenarioKeys) -> Iterator[str]:
    """A disturbance through the air excludes other wind, which point masses meet over ground."""
    disturbance = scenario.disturbance
    if disturbance and disturbance.path == "air" and scenario.windy:
        yield (
            '`path` of [disturbance] must be "ground" where there is other wind, which plants '
            "that are no aircraft meet over ground"
        )


def a_disturbance_is_a_wind_that_blows(scenario: ScenarioKeys) -> Iterator[str]:
    """An oscillation flown as wind must be a realistic wind."""
    disturbance = scenario.disturbance
    if disturbance is None or not disturbance.as_wind:
        return
    for channel in ("chi", "gamma"):
        amplitude = abs(getattr(disturbance, f"{channel}_amplitude"))
        omega = getattr(disturbance, f"{channel}_omega_rad_s")
        wind = scenario.flight.V_a_mps * amplitude / omega if amplitude else 0.0
        if wind > FASTEST_WIND:
            yield (
                f"[disturbance] `{channel}_amplitude` must be that of a wind of at most "
                f"{FASTEST_WIND:g} m/s with as_wind, got one of {wind:.3g} m/s"
            )


def an_airspeed_is_bounded_where_followed(scenario: ScenarioKeys) -> Iterator[str]:
    """A bound on airspeed errors needs an airspeed reference."""
    required = any("V" in {**table.at_most, **table.at_least} for table in scenario.expect)
    if required and not scenario.airspeed:
        yield "`V` of [[expect]] must be absent without `V_mps` of [reference]"


def no_cost_of_an_airspeed(scenario: ScenarioKeys) -> Iterator[str]:
    """The quadratic cost has weights for only two channels."""
    if scenario.airspeed and scenario.tuning.objective == "cost":
        yield "`objective` of [tuning] must not be cost where the airspeed is followed"


def an_airspeed_is_followed_within_limits(scenario: ScenarioKeys) -> Iterator[str]:
    """Every plant needs limits of n_x if the law commands it."""
    for plant in scenario.plant if scenario.airspeed else ():
        limits_n_x = scenario.limits.n_x if plant.aircraft is None else plant.config.limits.n_x
        where = "[limits]" if plant.aircraft is None else f"[limits] of {plant.aircraft}"
        if limits_n_x is None:
            yield (
                f"`n_x` of {where} must be given where the airspeed is followed, for the plant "
                f"{plant.label}"
            )


# In this order; the first violated rule refuses a scenario.
RULES: tuple[Rule, ...] = (
    gains_are_known,
    input_limits_are_those_of_commands,
    needs(
        "turbulence",
        'with objective = "rms" of [tuning]: calm air has no spectrum',
        when=lambda scenario: (
            scenario.tuning.objective == "rms" and scenario.tuning.navigation is None
        ),
    ),
    an_identified_model_is_named,
    names_differ,
    requirements_are_of_its_runs,
    a_law_without_a_model_has_no_E_star,
    something_is_followed,
    needs(
        "flight.duration_s",
        "with [route]: its longest time",
        when=lambda scenario: scenario.route is not None,
    ),
    measures_are_those_of_what_is_followed,
    samples_can_be_flown,
    all_begins_in_the_flight,
    paths_are_not_vertical,
    *(
        excludes(
            key,
            "without a jsbsim plant: the others replay its wind",
            when=lambda scenario: not scenario.aircraft,
        )
        for key in ("gust", "turbulence")
    ),
    excludes(
        "wind.level",
        "without a jsbsim plant",
        when=lambda scenario: scenario.wind and not scenario.aircraft,
    ),
    excludes(
        "disturbance",
        "where a plant is jsbsim, or have `as_wind`: the sinusoid is a term of the kinematic law",
        when=lambda scenario: scenario.aircraft and not scenario.swinging,
    ),
    a_disturbance_through_the_air_is_alone,
    excludes(
        "navigation",
        'with path = "air" of [disturbance]: an autopilot knows its path over ground',
        when=lambda scenario: scenario.disturbance and scenario.disturbance.path == "air",
    ),
    excludes(
        "navigation.inner_loop",
        "without an aircraft (jsbsim), which alone has an inner loop",
        when=lambda scenario: scenario.navigation and not scenario.aircraft,
    ),
    a_disturbance_is_a_wind_that_blows,
    an_airspeed_is_bounded_where_followed,
    no_cost_of_an_airspeed,
    *(
        excludes(key, "where the airspeed is followed", when=lambda scenario: scenario.airspeed)
        for key in ("tuning.lag_rad_s", "envelope")
    ),
    an_airspeed_is_followed_within_limits,
)
