"""The distribution of the flights of a count: its keys, and its description."""

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from flighttune.base.errors import InputError
from flighttune.base.files.table import abridged
from flighttune.base.names import key_words, unit_of_key
from flighttune.base.words import figures, listed, number
from flighttune.flight.loop.disturbance_keys import DisturbanceTable
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.aircraft.aircraft import OffNominal
from flighttune.vehicles.navigation_keys import SensorsTable
from flighttune.vehicles.plant_keys import PlantTable

# Tables of a scenario that must equal those of the counted flights, apart from dispersed keys.
FLOWN_ALIKE = ("flight", "reference", "route", "limits", "controller")

# Tables that a scenario may omit; keys that it has must match the counted flights.
AIR_AND_AIRFRAME = (
    *("disturbance", "wind", "gust", "turbulence", "sensors", "navigation"),
    "plant",
)

# Keys of the start of a flight.
STARTS = ("flight.chi_deg", "flight.gamma_deg")

# Key of the start of the reference by that of the start of the flight, which it has by default.
BEGINS = dict(zip(STARTS, ("reference.chi_from_deg", "reference.gamma_from_deg"), strict=True))

# Distributions whose stated range contains every draw, not all but a few in 1e9.
BOUNDED = ("uniform", "choice")

# Tolerance for the rounding of a range's ends, deg.
ROUNDING_DEG = 1e-6

# Drawn keys, besides keys of the air, that the sentence of a claim names.
MAX_NAMED = 5

# Endings of keys of airspeeds: at the start, and commanded later.
AIRSPEED = "flight.V_a_mps"
AIRSPEEDS = AIRSPEED, "V_mps"

# Words for the air in a sentence.
AIR = {
    "wind": "wind {}",
    "gust": "a gust of {}",
    "turbulence": "{} turbulence",
    "sensors": "measured with {}",
    "navigation": "where the aircraft knows its place by {}",
    "disturbance": "rates disturbed by {}",
}

EXACT = "where the aircraft knows its place exactly"

# Keys whose ranges are told with the air or the airspeed.
NAMED_APART = (*(f"{name}." for name in AIR), AIRSPEED)

# Names of the grades of navigation, before their receiver.
NAMES = {"rtk": "an RTK", "standard": "a standard", "poor": "a poor"}

# Keys that the table of flights has if they are equal in all flights.
SCHEDULE = "controller.schedule"
START_AND_GAINS = "flight.h_m", "flight.chi_deg", "flight.gamma_deg", SCHEDULE
GAINS = {False: "the same at all airspeeds", True: "proportional to airspeed"}

# Position within a key: a plant, or one of two limits.
PLACE = re.compile(r"\[.*?\]")

# Keys for the size of a wind or gust, m/s.
SIZES = ("speed_mps", "down_mps", "peak_mps")

# Columns of the table of flights.
DRAWN: tuple[str, ...] = "quantity", "values", "drawn"


@dataclass(frozen=True, slots=True, kw_only=True)
class Distribution:
    """Distribution of the flights that a count covers."""

    title: str  # title of the campaign
    airspeeds: str  # all flown plants, in words
    air: str  # ``calm``, ``wind``, or the intensity of the turbulence
    fixed: dict[str, Any]  # keys of the scenario that are equal in all flights, by dotted path
    # The lowest and the highest value of a drawn key, or all values if they are words
    dispersed: dict[str, Annotated[list[Any], Field(min_length=1)]]
    # `disperse` and `correlation`: the campaign's tables with these names.
    disperse: list[dict[str, Any]]
    correlation: list[dict[str, Any]]

    def __post_init__(self) -> None:
        for key in self.dispersed:
            if self._table_of(key) is None:
                raise InputError(f"`disperse` must say how `{key}` is drawn, got no table of it.")

    @property
    def windy(self) -> bool:
        """Whether any of its flights has wind."""
        return any(key.startswith("wind.") for key in (*self.fixed, *self.dispersed))

    @property
    def fastest_wind(self) -> float:
        """Largest steady wind of its flights, m/s."""
        return max(self._values("wind.", "speed_mps"), default=0.0)

    def sentence(self, flown: str) -> str:
        """The distribution in words; `flown` names the plant and its law."""
        air = [AIR[name].format(text) for name, text in self.air_words.items()]
        if not {"wind", "gust", "turbulence"} & {*self.air_words}:
            air.insert(0, "calm air")
        if "navigation" not in self.air_words and self._values("route."):
            air.append(EXACT)
        drawn = self.varied
        if len(drawn) > MAX_NAMED:
            drawn[MAX_NAMED - 1 :] = [f"{len(drawn) - MAX_NAMED + 1} more in the table of flights"]
        keys = f"; drawn at random: {listed(drawn)}" if drawn else ""
        return f"{flown} at {self.airspeeds} in {', '.join(air)}{keys}"

    @property
    def varied(self) -> list[str]:
        """Each drawn key with its range and distribution, besides the air and the airspeed."""
        return [
            f"{words} {values}" + (f" ({how})" if how != "uniform" else "")
            for key, words, values, how in self._drawn
            if not key.startswith(NAMED_APART)
        ]

    def records(self, flown: str) -> list[dict[str, str]]:
        """Plant, airspeed, start, air, and every drawn key with its range and unit."""
        rows = [
            ("flown", flown, ""),
            ("airspeed", self.airspeeds, ""),
            *((_words(x), self._range(x), "fixed") for x in START_AND_GAINS if x in self.fixed),
            *((name, text, "") for name, text in (self.air_words or {"air": "calm"}).items()),
            *(row for _, *row in self._drawn),
        ]
        for pair in self.correlation:
            words = f"rank correlation of {listed([_words(key) for key in pair['keys']])}"
            rows.append((words, f"{pair['rank']:g}", ""))
        return [dict(zip(DRAWN, row, strict=True)) for row in rows]

    @property
    def _drawn(self) -> list[tuple[str, str, str, str]]:
        """Each drawn key: key, words, range and distribution."""
        tables = {key: self._table_of(key) or {} for key in self.dispersed}
        return [(key, _words(key), self._range(key), _how(tables[key])) for key in tables]

    def _table_of(self, key: str) -> Mapping[str, Any] | None:
        """The table that disperses a key: its own, or a table for all plants or limits."""
        tables = {table.get("key"): table for table in self.disperse}
        bare = {PLACE.sub("", str(name)): table for name, table in tables.items()}
        return tables.get(key) or bare.get(PLACE.sub("", key))

    @property
    def air_words(self) -> dict[str, str]:
        """Words for moving air, disturbances of the rates, and errors of what is seen."""
        intensity = self._range("turbulence.intensity")
        if severity := self._range("turbulence.severity"):
            intensity = f"severity {severity} ({self._range('turbulence.wind_20ft_mps')} at 20 ft)"
        errors = [key for key in self.fixed | self.dispersed if key.startswith("sensors.")]
        errors = [f"{_words(key)} {self._range(key)}" for key in errors if any(self._values(key))]
        largest = max(map(abs, self._values("disturbance.", "_amplitude")), default=0.0)
        words = {
            "wind": self._range("wind.", "speed_mps"),
            "gust": self._range("gust.peak_mps"),
            "turbulence": intensity,
            "sensors": ", ".join(errors),
            "navigation": self._navigation,
            "disturbance": f"up to {figures(largest)} rad/s" if largest else "",
        }
        if words["wind"]:
            origins = self._values("wind.", "from_deg")
            anywhere = max(origins) - min(origins) >= 360.0
            words["wind"] += f" from {'anywhere' if anywhere else spread(origins, 'deg')}"
        if words["gust"]:
            words["gust"] += f" ({self._range('gust.axis')})"
        return {name: text for name, text in words.items() if text}

    @property
    def _navigation(self) -> str:
        """The equipment by which an aircraft knows its motion; empty if it knows it exactly."""
        if not (grades := self._values("navigation.grade")):
            return ""
        numbers = (key for key in self.fixed | self.dispersed if key.startswith("navigation."))
        own = [
            f"{_words(key).removeprefix('navigation ')} {self._range(key)}"
            for key in numbers
            if not key.endswith((".grade", ".inner_loop"))
        ]
        names = listed([NAMES[grade] for grade in dict.fromkeys(grades)], "or")
        inner = " that its inner loop reads" * any(self._values("navigation.inner_loop"))
        with_own = f" with {listed(own)}" if own else ""
        return f"{names} receiver and inertial unit{inner}{with_own}"

    def _values(self, start: str, end: str = "") -> list[Any]:
        """Both ends of the range, or the value, of each key with this beginning and ending."""
        ranges = {key: [value] for key, value in self.fixed.items()} | self.dispersed
        keys = [key for key in ranges if key.startswith(start) and key.endswith(end)]
        return [value for key in keys for value in ranges[key]]

    def _range(self, start: str, end: str = "") -> str:
        """The range of all these values with unit; empty if no flight has such a key."""
        values = self._values(start, end)
        values = [GAINS[value] for value in values] if start == SCHEDULE else values
        return spread(values, unit_of_key(PLACE.sub("", end or start))) if values else ""

    def start_range(self, scenario: Scenario, plant: PlantTable) -> float | None:
        """Distance of its starts from a scenario's course and path angle, rad; None without one."""
        flown, fixed = self._begun(flown_values(scenario, plant))
        drawn = set(self.dispersed)
        # Everything but the starts must equal the scenario, in calm air. The starts are drawn in a
        # symmetric range, equal for both angles.
        alike = drawn <= set(STARTS) and {*flown} == {*fixed} | drawn and self.air == "calm"
        bounded = all(table.get("distribution") in BOUNDED for table in self.disperse)
        if not (alike and bounded) or self.reference_moves:
            return None
        ranges = ((flown[key], self.dispersed.get(key, [flown[key]])) for key in STARTS)
        away = [abs(end - start) for start, ends in ranges for end in (ends[0], ends[-1])]
        return math.radians(max(away)) if max(away) - min(away) <= ROUNDING_DEG else None

    def difference(self, scenario: Scenario, plant: PlantTable) -> str | None:
        """Why no flight of the distribution can belong to this scenario; None if one can."""
        flown, fixed = self._begun(flown_values(scenario, plant))
        for key, value, counted in self._differences(flown, fixed):
            if key.split(".")[0] in FLOWN_ALIKE or value is not None:
                allowed = counted if key in self.dispersed else abridged(fixed.get(key))
                return f"`{key}` must be {allowed}, got {abridged(value)}"
        return None

    def not_counted(self, scenario: Scenario, plant: PlantTable, but: tuple[str, ...] = ()) -> str:
        """First difference of a flight from the counted flights, in words; empty without any.

        Unlike in `difference`, the counted flights may lack a table that the flight omits. Keys
        that begin with `but` may have any value.
        """
        flown, fixed = self._begun(flown_values(scenario, plant))
        keys = dict.fromkeys([*self.dispersed, *fixed])
        flown = _with_defaults(flown, keys, self._values)
        fixed = _with_defaults(fixed, flown, lambda key: [flown[key]])
        for key, value, counted in self._differences(flown, fixed):
            if not key.startswith(but):
                return f"{key.removesuffix('.intensity')} is {_shown(value)}, counted on {counted}"
        return ""

    @property
    def reference_moves(self) -> bool:
        """Whether a reference begins at the drawn start of each flight, instead of beside it."""
        values = self.fixed | self.dispersed

        def changes(key: str) -> bool:
            segments = values.get(key) == [] or any(x.startswith(f"{key}[") for x in values)
            return segments or "reference.shape" in values  # else it is one number

        return any(
            start in self.dispersed and begin not in values and changes(begin.replace("_from", ""))
            for start, begin in BEGINS.items()
        )

    def _begun(self, flown: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Values of a flight and of the counted flights, with the start of a stated reference.

        Where only one of them states it, the reference of the other begins at the flight.
        """
        stated = {*flown, *self.fixed, *self.dispersed}
        begins = {key: flown.get(start) for start, key in BEGINS.items() if key in stated}
        counted = {key: at for key, at in begins.items() if key not in self.dispersed}
        return begins | dict(flown), counted | self.fixed

    def _differences(
        self, flown: Mapping[str, Any], fixed: Mapping[str, Any]
    ) -> Iterator[tuple[str, Any, str]]:
        """Keys whose value was never drawn: key, value or None, and the values counted."""
        flown, fixed = (_at_places(values, self.dispersed) for values in (flown, fixed))
        for key in dict.fromkeys([*flown, *fixed]):
            value, drawn = flown.get(key), self.dispersed.get(key)
            if drawn is None:
                if value != fixed.get(key):
                    yield key, value, _shown(fixed.get(key))
            elif any(isinstance(end, str) for end in drawn):
                if value not in drawn:
                    yield key, value, listed(list(map(str, drawn)), "or")
            elif value is None or not drawn[0] <= value <= drawn[-1]:
                yield key, value, f"{drawn[0]:g} to {drawn[-1]:g}"


def _with_defaults(
    values: Mapping[str, Any], keys: Collection[str], ends: Callable[[str], Sequence[Any]]
) -> dict[str, Any]:
    """Values, completed by equivalent defaults for tables among `keys` that they lack.

    `ends` has the values of a key in the other flights. Without wind or gust its size is 0, and its
    other keys do not count.
    """
    there = {key.rpartition(".")[0] for key in values}
    whole = dict(values)
    for key in keys:
        table, _, name = key.rpartition(".")
        if table not in there and table in DEFAULTS:
            whole = DEFAULTS[table] | whole
        elif table in there:
            whole.setdefault(key, None)
        elif key.startswith(("wind.", "gust.")) and name not in SIZES:
            whole[key] = ends(key)[0]
        elif name in SIZES and min(ends(key)) <= 0.0 <= max(ends(key)):
            whole[key] = 0.0
        else:
            whole[key] = None
    return whole


def _at_places(values: Mapping[str, Any], drawn: Collection[str]) -> dict[str, Any]:
    """Values, with lists split into elements if a position in them is drawn."""
    lists = {PLACE.sub("", key) for key in drawn if key.endswith("]")}
    apart = {f"{key}[{i}]": item for key in lists & {*values} for i, item in enumerate(values[key])}
    return {key: value for key, value in values.items() if key not in lists} | apart


def _shown(value: Any) -> str:
    """A value in a sentence; None becomes "none"."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return "none" if value is None else abridged(value).strip("'")


def flown_values(scenario: Scenario, plant: PlantTable) -> dict[str, Any]:
    """Keys of a scenario that determine a flight, by dotted path; the plant is in ``plant``."""
    tables = scenario.as_dict()
    tables["plant"] = plant.model_dump(mode="json", exclude_none=True, exclude={"name", "aircraft"})
    kept = {name: tables[name] for name in (*FLOWN_ALIKE, *AIR_AND_AIRFRAME) if name in tables}
    return dict(_leaves(kept, ""))


def _leaves(value: Any, above: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from _leaves(item, f"{above}.{name}" if above else name)
    elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        for i, item in enumerate(value):
            yield from _leaves(item, f"{above}[{i}]")
    else:
        yield above, value


# Defaults of tables that a scenario may omit: a flight without errors or changes.
DEFAULTS = {
    name: dict(_leaves(table.model_dump(mode="json", exclude_none=True), name))
    for name, table in {
        "sensors": SensorsTable(),
        "disturbance": DisturbanceTable(),
        "plant.airframe": OffNominal(),
    }.items()
}


def _words(key: str) -> str:
    """A key in words, with factors marked as such."""
    words = "gains" if key == SCHEDULE else key_words(key).removeprefix("sensor ").replace(",", "")
    return words + " factor" * key.endswith("_factor")


def spread(values: Sequence[Any], unit: str) -> str:
    """``0 to 8 m/s``, ``light or severe``."""
    if any(isinstance(value, str | bool | list) for value in values):
        return listed(list(dict.fromkeys(map(str, values))), "or")
    form = ".0f" if max(map(abs, values)) >= 1e4 else ".4g"
    ends = dict.fromkeys(number(end, form) for end in (min(values), max(values)))
    return f"{' to '.join(ends)} {unit}".rstrip()


def _how(table: Mapping[str, Any]) -> str:
    """The distribution of a key in words, by its table in the campaign."""
    kind, sd = table.get("distribution", "drawn"), table.get("sd") or table.get("sd_log")
    if sd is not None:
        share = " of its value" if table.get("acts") == "multiplies" else ""
        key = PLACE.sub("", table.get("key", ""))
        unit = unit_of_key(key) if "sd" in table and not share else ""
        return f"{kind.replace('_', '-')}, sd {figures(sd)} {unit}".rstrip() + share
    if kind == "uniform":
        return kind
    weights = table.get("weights") or [1.0]
    rarest = f", the rarest with probability {min(weights) / sum(weights):.2g}"
    values = table.get("count") or len(table.get("values") or ())
    return f"one of {values} values{rarest * (min(weights) < max(weights))}"
