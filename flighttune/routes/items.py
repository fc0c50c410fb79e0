"""Items of a mission by their MAVLink numbers, and the path of each item."""

import math
import re
import tomllib
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from flighttune.base.errors import InputError
from flighttune.base.files.budget import LINES, check_entries
from flighttune.base.files.table import abridged
from flighttune.routes.maps import ground_at, json_bool, json_number, json_part

# A row of `waypoint` of [route], and the keys of its place.
Row: TypeAlias = dict[str, Any]
PLACE = ("lat_deg", "lon_deg", "up_m")

# How an item is treated.
Fate: TypeAlias = Literal["flown", "harmless", "no place", "refused", "not flown"]

# Numbers of items by fate and name.
_Numbers: TypeAlias = dict[Fate, dict[str, set[int]]]

# A change of speed: its first row, its airspeed if any, and number, name and fate of the item.
_Change: TypeAlias = tuple[int, float | None, int, str, Fate]

# MAVLink commands that this module names.
WAYPOINT, UNLIMITED, TURNS, TIMED, RETURN, LAND, TAKEOFF = 16, 17, 18, 19, 20, 21, 22
TO_HEIGHT, VTOL_TAKEOFF, VTOL_LAND, JUMP, SPEED, SET_HOME = 31, 84, 85, 177, 178, 179
CIRCLES, TAKEOFFS = (UNLIMITED, TURNS, TIMED, TO_HEIGHT), (TAKEOFF, VTOL_TAKEOFF)
RALLY = 5100
AREAS = (*range(5000, 5005), RALLY)  # fences and rally points
ENDS = (RETURN, LAND, VTOL_LAND)
PLACED = (WAYPOINT, *CIRCLES, LAND, VTOL_LAND)

_NUMBERED = re.compile(r"item (\d+)")  # name of a place of an item

# Index of the radius among the parameters of circles.
RADIUS = {UNLIMITED: 2, TURNS: 2, TIMED: 2, TO_HEIGHT: 1}


# MAVLink commands by number, and the commands that do not change the path.
_TABLES = tomllib.loads(Path(__file__).with_name("commands.toml").read_text(encoding="utf-8"))
COMMANDS = {int(n): f"{name} {n}" for table in _TABLES.values() for n, name in table.items()}
HARMLESS = {*map(int, _TABLES["harmless"])}

# Frames whose heights are above sea level, above the home position, and above terrain.
ABOVE_SEA, ABOVE_HOME, ABOVE_TERRAIN = (0, 5), (3, 6), (10, 11)

# Maximum repeats of a jump, turns of a circle without an end, and minimum turns of a circle that
# ends by time or height.
MAX_REPEATS, UNLIMITED_TURNS, LEAST_TURNS = 10, 2.0, 1.0

# Maximum number of items, repeats included.
MAX_ITEMS = 5000

# Height above ground at which a landing ends, m: below it an aircraft flares.
LANDING_UP_M = 10.0

# How some commands are flown instead.
FLOWN_AS = {
    UNLIMITED: f"without an end is flown as {UNLIMITED_TURNS:g} turns",
    RETURN: "ends above home, at the height of the item before",
    LAND: f"is flown to {LANDING_UP_M:g} m above its place",
    VTOL_LAND: "ends above its place: the descent in hover is not flown",
}

# Places that differ by less in latitude and longitude count as equal: 1 m.
SAME_PLACE_DEG = 1e-5

# Beginning of the sentence about changes of the airspeed.
SETS_AIRSPEED = "The plan sets an airspeed"

# Kinds of speed by the first parameter of a change of speed, and the value for the default speed.
SPEEDS = "an airspeed", "a ground speed", "a climb speed", "a descent speed"
DEFAULT_SPEED = -2


# Range of airspeeds of a route without an aircraft, m/s.
ANY_AIRSPEED = (0.0, math.inf)

# Place and height of an unknown home.
NO_HOME = (0.0, 0.0, 0.0)

# Largest latitude of a waypoint, deg: near a pole a straight flight changes its course.
MAX_LAT_DEG = 85.0

# Largest latitude and longitude of a route whose home position may have zeros, deg.
NEAR_DEG = 5.0


class RouteFile(NamedTuple):
    """A route as its file states it."""

    # Keys of [route]: ``waypoint`` with heights above the first, ``widen``, ``rally``, ``notes``
    route: dict[str, Any]
    # ``h_m``, ``ground_m`` and ``V_a_mps`` of [flight], as far as the file has them
    flight: dict[str, float]
    limits: Mapping[str, Any] = MappingProxyType({})  # [limits], which flighttune writes


def read_items(
    items: Sequence[Mapping[str, Any]],
    home: tuple[float, ...] | None,
    skip: bool,
    terrain: str | Path | None = None,
    airspeeds: tuple[float, float] | None = ANY_AIRSPEED,
    *,
    first: int = 1,
) -> RouteFile:
    """The route of some items, numbered from `first`.

    `home`: latitude and longitude, deg, height above sea level, m; None without a home in the file.
    """
    # With `skip`, commands that change the flight but have no place are omitted.
    whole = [_whole(i, x) for i, x in enumerate(_flat(items), start=first)]
    flat = dict(enumerate(_above_sea(whole, terrain), start=first))
    lost, stated, home = not _knows_home(flat, home), home, home or NO_HOME
    rows: list[Row] = []
    rally: list[Row] = []
    numbers: _Numbers = defaultdict(lambda: defaultdict(set))
    notes: dict[str, dict[str, set[int]]] = {}  # sentences, and the items that replace {}
    changes: list[_Change] = []
    end, passed = max(flat, default=0), set[int]()
    for number, item in _in_order(flat, skip):
        passed.add(number)
        name, fate = _fate(item, rows, lost, home)
        command, label = item.get("command"), f"item {number} ({name})"
        if fate == "flown" and command == SPEED:
            airspeed, others = _speed(label, item)
            notes |= {sentence: {} for sentence in others}
            changes.append((max(0, len(rows) - 1), airspeed, number, *_change(airspeed, airspeeds)))
            continue
        numbers[fate][name].add(number)
        if command == RALLY:
            rally.append(_row(label, item, home, []))
        if fate == "flown" and command != JUMP:
            row = _row(label, item, home, rows)
            if not rows and command not in (WAYPOINT, *TAKEOFFS):
                rows.append(_at_home(home, row["up_m"]))
                notes["The route begins above home."] = {}
            for sentence in (*_notes(label, item), *add_row(rows, row, f"item {number}")):
                notes.setdefault(sentence, {}).setdefault(name, set()).add(number)
        if command in ENDS and fate != "refused":
            end = number
            break
    for number, item in flat.items():
        if number not in passed:
            why = f"after the end of item {end}" if number > end else "which a jump leaves out"
            numbers["not flown"][f"{_name(item)}, {why}"].add(number)
    speeds = _speeds(changes, len(rows), numbers)
    fates = _fates(numbers, skip) if rows else _fates(numbers, skip)[1:]
    if lost and rows:
        fates.append(_without_home(flat, stated, str(rows[0]["name"])))
    flight = {"h_m": home[2] + rows[0]["up_m"], "ground_m": home[2]} if rows else {}
    flight |= {"V_a_mps": speeds[0][0]} if 0 in speeds else {}
    others = (text.replace("{}", listed_items(about)) for text, about in notes.items())
    said = [*fates, *others, *_airspeeds(rows, speeds)]
    return RouteFile({"waypoint": rows, "widen": True, "rally": rally, "notes": said}, flight)


def _speeds(changes: list[_Change], rows: int, numbers: _Numbers) -> dict[int, tuple[float, int]]:
    """Airspeed and item of the changes that are flown, by row; the fate of all joins `numbers`."""
    last = max(1, rows - 1)  # no flight goes on from there
    speeds = {
        i: (V, number)
        for i, V, number, _, fate in changes
        if V is not None and fate == "flown" and i < last
    }
    flown = {number for _, number in speeds.values()}
    for *_, number, name, fate in changes:
        unused = fate == "flown" and number not in flown
        numbers["not flown" if unused else fate][name].add(number)
    return speeds


def _without_home(
    flat: Mapping[int, Mapping[str, Any]], home: tuple[float, ...] | None, start: str
) -> str:
    """Note on a home without a place, or on a file without a home."""
    if home is not None:
        return (
            f"Home has no place in the file: the route begins at {start}, and heights "
            f"above home count from {home[2]:g} m above sea level."
        )
    number, first = next(iter(flat.items()))
    return (
        f"The file has no home: its first line is item {number} ({_name(first)}, frame "
        f"{first['frame']:g}), which is part of the route. Heights above home count from 0 m above "
        "sea level: `--set flight.h_m=` states that of the start, and `--set flight.ground_m=` "
        "that of the ground."
    )


def _whole(number: int, item: Mapping[str, Any]) -> Mapping[str, Any]:
    """The item; InputError without a key that its type needs, or if there are too many."""
    if number > MAX_ITEMS:
        raise InputError(f"`items` must be at most {MAX_ITEMS}, got more.")
    for key in ("command", "frame", "params") if item.get("type") == "SimpleItem" else ("type",):
        if key not in item:
            raise InputError(f"item {number} must have `{key}`, got none.")
    json_number(item.get("command", 0), f"`command` of item {number}")
    return item


def _above_sea(
    flat: list[Mapping[str, Any]], terrain: str | Path | None
) -> list[Mapping[str, Any]]:
    """Items with heights above a known terrain converted to heights above sea level."""
    over = [
        i
        for i, item in enumerate(flat)
        if item.get("frame") in ABOVE_TERRAIN
        and item.get("AMSLAltAboveTerrain") is None
        and _placed(item)
    ]
    if terrain is None or not over:
        return flat
    stated = [
        [json_number(x, "a place above terrain") for x in flat[i]["params"][4:7]] for i in over
    ]
    places = np.array(stated)
    heights = places[:, 2] + ground_at(terrain, places[:, :2])  # at once, as it opens the file
    above = dict(zip(over, heights.tolist(), strict=True))
    return [
        {**item, "AMSLAltAboveTerrain": above[i]} if i in above else item
        for i, item in enumerate(flat)
    ]


def _fates(numbers: Mapping[Fate, dict[str, set[int]]], skip: bool) -> list[str]:
    """Sentences on items that are flown differently or not at all; InputError refuses some."""
    no_place = numbers["no place"]
    if wrong := listed_items(numbers["refused"] | ({} if skip else no_place)):
        left = "it" if wrong == listed_items(no_place) else listed_items(no_place)
        skips = f"; `--set route.skip=true` leaves {left} out"
        raise InputError(
            "`items` must be waypoints, circles, a take-off at the beginning, landings, returns, "
            "surveys or corridor scans, at heights above home, sea level or terrain and at "
            "airspeeds that the aircraft flies, got "
            f"{wrong}{skips if no_place and not skip else ''}."
        )
    fates = [f"Flown of the plan: {listed_items(numbers['flown'])}."]
    if left_out := listed_items(numbers["harmless"] | no_place | numbers["not flown"]):
        fates.append(f"Not flown of the plan: {left_out}.")
    return fates


def _knows_home(flat: Mapping[int, Mapping[str, Any]], home: tuple[float, ...] | None) -> bool:
    """Whether the place of home is known: programs without a home write zeros."""
    placed = [(i, x) for i, x in flat.items() if x.get("command") in PLACED and _placed(x)]
    mixed = len({_counts_from_sea(item) for _, item in placed}) > 1
    if home is None:
        if mixed:
            raise InputError(
                "the first line must be the home position (item 0, command 16, frame 0), got none: "
                "heights above sea level and above home are in one file."
            )
        return False
    if not (abs(home[0]) <= 90.0 and abs(home[1]) <= 180.0):  # also catches NaN
        raise InputError(
            "the home position must have a latitude up to 90 and a longitude up to 180 deg, got "
            f"{home[0]:g} and {home[1]:g}."
        )
    about = [(f"the place of item {i}", x) for i, item in placed[:1] for x in item["params"][4:6]]
    if any(home[:2]) or sum(abs(json_number(x, name)) for name, x in about) <= NEAR_DEG:
        return True
    if not home[2] and mixed:
        raise InputError(
            "`plannedHomePosition` must be near the route: heights above sea level and above home "
            f"are in one plan, got {list(home)}."
        )
    return False


def _counts_from_sea(item: Mapping[str, Any]) -> bool:
    """Whether the height of an item above sea level is known without the height of home."""
    known = item["frame"] in ABOVE_TERRAIN and item.get("AMSLAltAboveTerrain") is not None
    return known or item["frame"] in ABOVE_SEA


def _placed(item: Mapping[str, Any]) -> bool:
    """Whether an item has a place: latitude and longitude of 0, null or NaN do not count."""
    return any(x is not None and x == x and x != 0 for x in item["params"][4:6])


def add_row(rows: list[Row], row: Row, name: str) -> list[str]:
    """Add a row called `name`, unless it repeats the last row; a note if the heights differ."""
    row = row | {"name": name}
    before = rows[-1] if rows else row
    # A take-off often repeats the last row. No aeroplane flies two heights at one place.
    apart = max(abs(row[key] - before[key]) for key in PLACE[:2])
    if not rows or "turns" in row or "turns" in before or apart >= SAME_PLACE_DEG:
        rows.append(row)
    elif abs(row["up_m"] - before["up_m"]) >= 1.0:
        rows[-1] = row
        said = f"{before['name']} and {name} have one place: it is passed at the height of {name}."
        return [said[0].upper() + said[1:]]
    return []


def _flat(items: Sequence[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """The items in order, with surveys, corridor scans and landings replaced by their parts."""
    for item in items:
        if parts := item.get("TransectStyleComplexItem", {}).get("Items"):
            yield from _flat(parts)
        elif item.get("complexItemType") in ("fwLandingPattern", "vtolLandingPattern"):
            yield from _landing(item)
        elif len(item.get("params", ())) == 4 and "coordinate" in item:  # plans before 2018
            yield {**item, "params": [*item["params"], *item["coordinate"]]}
        else:
            yield item


def _landing(item: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """The start, the circle or waypoint, and the landing of a landing pattern."""
    approach = item.get("landingApproachCoordinate") or item["loiterCoordinate"]
    radius = json_number(item.get("loiterRadius", 0.0), "`loiterRadius`")
    radius = math.copysign(radius, 1.0 if _flag(item, "loiterClockwise") else -1.0)
    down = VTOL_LAND if item["complexItemType"] == "vtolLandingPattern" else LAND
    circle = TO_HEIGHT if _flag(item, "useLoiterToAlt") else WAYPOINT
    before = [0, radius, 0, 1] if circle == TO_HEIGHT else [0, 0, 0, None]
    stops = [206, 2001] * _flag(item, "stopTakingPhotos", False)
    stops += [2501] * _flag(item, "stopVideoPhotos", False)  # QGroundControl's name for videos
    stops += [SPEED] * _flag(item, "useDoChangeSpeed", False)
    for command in (189, *stops):
        # Only a change of speed reads its parameters; frame 2 means an item without a place.
        params = [0, item.get("finalApproachSpeed"), -1, *[0] * 4]
        yield {"type": "SimpleItem", "frame": 2, "command": command, "params": params}
    ends = {"loiter": (circle, before, approach), "land": (down, [0] * 4, item["landCoordinate"])}
    for part, (command, values, coordinate) in ends.items():
        # In version 1 circle and landing have their own keys.
        relative = _flag(item, "altitudesAreRelative") and _flag(item, f"{part}AltitudeRelative")
        frame = ABOVE_HOME[0] if relative else ABOVE_SEA[0]
        params = [*values, *coordinate]
        yield {"type": "SimpleItem", "frame": frame, "command": command, "params": params}


def _flag(item: Mapping[str, Any], key: str, absent: bool = True) -> bool:
    """A boolean of an item, or the default if it is absent."""
    return json_bool(item.get(key, absent), f"`{key}`")


def _in_order(
    items: Mapping[int, Mapping[str, Any]], skip: bool
) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Items in flown order, with the repeats of jumps, and their numbers.

    With `skip`, jumps with too many repeats are omitted: they have the key ``endless``.
    """
    numbers = {item.get("doJumpId"): number for number, item in items.items()}
    repeats: dict[int, int] = defaultdict(int)
    number, count = min(items, default=0), 0
    while number in items:
        count += 1
        if count > MAX_ITEMS:
            raise InputError(f"`items` must be at most {MAX_ITEMS} with their repeats.")
        item, label, onward = items[number], f"item {number} ({COMMANDS[JUMP]})", number + 1
        if item.get("command") == JUMP:
            target, most = (json_number(x, label) for x in item["params"][:2])
            if not 0 <= most <= MAX_REPEATS:
                got = "-1, without an end" if most == -1 else f"{most:g}"
                if not skip:
                    raise InputError(
                        f"{label} must repeat at most {MAX_REPEATS} times, got {got}; "
                        "`--set route.skip=true` leaves it out."
                    )
                item, most = {**item, "endless": True}, 0
            if target not in numbers:
                raise InputError(f"{label} must lead to an item, got {target:g}.")
            if repeats[number] < most:
                repeats[number] += 1
                onward = numbers[target]
            else:
                repeats[number] = 0
        yield number, item
        number = onward


def _name(item: Mapping[str, Any]) -> str:
    if item["type"] != "SimpleItem":
        return abridged(item.get("complexItemType"))
    command = item["command"]
    return COMMANDS.get(command, f"command {command:g}")


def _fate(
    item: Mapping[str, Any], rows: Sequence[Row], lost: bool, home: tuple[float, ...]
) -> tuple[str, Fate]:
    """Name of an item, with the reason of a refusal, and its fate after the rows before it."""
    name = _name(item)
    if item["type"] != "SimpleItem":
        lacking = ", whose items are not in the file" * ("TransectStyleComplexItem" in item)
        return f"{name}{lacking}", "refused"
    command, frame = item["command"], item["frame"]
    json_number(frame, "`frame`")  # without this check false would be 0, a height above sea level
    if command in HARMLESS:
        return name, "harmless"
    placed = _placed(item)
    if lost and (command == RETURN or (command in TAKEOFFS and not placed)):
        return f"{name}, to or from a home without a place", "not flown"
    if item.get("endless"):
        return f"{name}, with too many repeats", "not flown"
    if command in (RETURN, JUMP, SPEED):
        return name, "flown"
    if command in TAKEOFFS and rows and not _again(item, rows, home):
        return f"{name}, in flight", "refused"
    if command in CIRCLES and not placed and (not rows or "turns" in rows[-1]):
        return f"{name}, at 0, 0: around where it is then, which no plan states", "refused"
    if command in CIRCLES and not rows and lost:
        return f"{name}, at the start: home, where the route would begin, has no place", "refused"
    if command in (*TAKEOFFS, *CIRCLES) or (command in PLACED and placed):
        if frame in (*ABOVE_SEA, *ABOVE_HOME, *ABOVE_TERRAIN):
            return name, "flown"
        return f"{name}, frame {frame:g}", "refused"
    if command in PLACED:
        return f"{name}, at 0, 0, which is no place", "refused"
    return name, "refused" if placed or command == SET_HOME else "no place"


def _again(item: Mapping[str, Any], rows: Sequence[Row], home: tuple[float, ...]) -> bool:
    """Whether a take-off repeats the take-off at the beginning of the route."""
    place = item["params"][4:6] if _placed(item) else home[:2]
    apart = (
        abs(json_number(x, "a take-off") - rows[0][key])
        for x, key in zip(place, PLACE[:2], strict=True)
    )
    return len(rows) == 1 and max(apart) < SAME_PLACE_DEG


def listed_items(numbers: Mapping[str, Collection[int]]) -> str:
    """Items by number and name."""
    return ", ".join(
        f"item{'s' * (len(items) > 1)} {', '.join(_runs(items))} ({name})"
        for name, items in numbers.items()
    )


def listed_places(names: Iterable[str]) -> str:
    """Places of a route, each once; numbered items share one word."""
    places = dict.fromkeys(names)
    items = {int(found[1]) for name in places if (found := _NUMBERED.fullmatch(name))}
    others = [name for name in places if not _NUMBERED.fullmatch(name)]
    numbered = f"item{'s' * (len(items) > 1)} {', '.join(_runs(items))}"
    return ", ".join([numbered, *others] if items else others)


def _runs(numbers: Collection[int]) -> Iterator[str]:
    """Numbers as text, three or more consecutive numbers as a range."""
    for _, pairs in groupby(enumerate(sorted(numbers)), lambda pair: pair[1] - pair[0]):
        run = [number for _, number in pairs]
        if len(run) > 2:
            yield f"{run[0]} to {run[-1]}"
        else:
            yield from map(str, run)


def _at_home(home: tuple[float, ...], up: float) -> Row:
    return {**dict(zip(PLACE, (*home[:2], up), strict=True)), "name": "home"}


def _row(label: str, item: Mapping[str, Any], home: tuple[float, ...], before: list[Row]) -> Row:
    """A waypoint or circles, with the height above the home position."""
    command, values = item["command"], [*item["params"], *[None] * 7][:7]
    up_before = before[-1]["up_m"] if before else 0.0
    if command == RETURN:
        return _at_home(home, up_before)
    if not _placed(item):
        values[4:6] = home[:2] if command in TAKEOFFS else [before[-1][key] for key in PLACE[:2]]
    row: Row = place(label, values[4:7])
    if item["frame"] in ABOVE_SEA:
        row["up_m"] -= home[2]
    elif item["frame"] in ABOVE_TERRAIN and item.get("AMSLAltAboveTerrain") is not None:
        above_sea = json_number(item["AMSLAltAboveTerrain"], f"`AMSLAltAboveTerrain` of {label}")
        row["up_m"] = above_sea - home[2]
    if command == LAND:
        row["up_m"] += LANDING_UP_M
    elif command == VTOL_LAND:
        row["up_m"] = up_before
    elif command in CIRCLES:
        row |= {"up_m": up_before} if _height_before(item) and before else {}
        row |= _circles(label, command, values)
    return row


def _height_before(item: Mapping[str, Any]) -> bool:
    """Whether circles keep the height of the item before: in ArduPilot a height of 0 means this."""
    return item["params"][6:] == [0] and item["frame"] in (*ABOVE_HOME, *ABOVE_TERRAIN)


def _circles(label: str, command: int, values: Sequence[Any]) -> Row:
    """Turns, radius and other keys of circles."""
    radius = json_number(values[RADIUS[command]], f"`radius_m` of {label}", 0.0)
    turns = UNLIMITED_TURNS if command == UNLIMITED else LEAST_TURNS
    if command == TURNS and (turns := json_number(values[0], f"`turns` of {label}")) <= 0.0:
        raise InputError(f"`turns` of {label} must be positive, got {turns:g}.")
    row: Row = {"turns": math.copysign(turns, radius or 1.0)}
    row |= {"radius_m": abs(radius)} if radius else {}
    if command == TIMED:
        row["hold_s"] = json_number(values[0], f"the time of {label}")
    return row | ({"spiral": True} if command == TO_HEIGHT else {})


def _notes(label: str, item: Mapping[str, Any]) -> Iterator[str]:
    """A sentence for an item that is flown differently, with {} for all such items."""
    command, values, subject = item["command"], item["params"], f"I{label[1:]}"
    if command in TAKEOFFS:
        yield f"The route begins where the take-off of {label} ends."
    if command == WAYPOINT:
        hold, *radii = (json_number(x, f"every parameter of {label}", 0.0) for x in values[:3])
        if hold:
            yield f"The hold time of {{}}, {hold:g} s, is not flown."
        if any(radii):
            yield "The radius of {} is not used: the path passes inside of the corner."
    if not _flag(item, "autoContinue"):
        yield f"{subject} waits until it is told to go on, which is not flown."
    if command in FLOWN_AS:
        yield f"{subject} {FLOWN_AS[command]}."
    if command in CIRCLES and not _placed(item):
        yield f"{subject} is at 0, 0: it circles around the item before, as ArduPilot does."
    if command in CIRCLES and _height_before(item):
        yield f"{subject} has the height 0, in ArduPilot that of the item before."
    if item["frame"] in ABOVE_TERRAIN and item.get("AMSLAltAboveTerrain") is None:
        yield "The height of {} is above terrain, which is unknown: it counts from home."


def _speed(label: str, item: Mapping[str, Any]) -> tuple[float | None, list[str]]:
    """The airspeed that a change of speed sets, m/s, and a sentence for its other settings."""
    values = [json_number(x, f"{label} (speed)", 0.0) for x in json_part(item, "params", list)[:4]]
    kind, value, throttle, relative = [*values, *[0.0] * 4][:4]
    speed = SPEEDS[int(kind)] if kind in range(len(SPEEDS)) else f"a speed of type {kind:g}"
    airspeed = value if speed == SPEEDS[0] and value > 0.0 and not relative else None
    others = []
    if value > 0.0 and airspeed is None:
        others = [f"{speed} of {value:g} m/s{' more' * bool(relative)}"]
    if value == DEFAULT_SPEED:
        others = ["the default speed of its vehicle"]
    if throttle > 0.0:
        others.append(f"a throttle of {throttle:g} %")
    hint = f": in still air `--set flight.V_a_mps={value:g}` is as fast" if kind == 1 else ""
    return airspeed, [f"I{label[1:]} sets {x}, which is not flown{hint}." for x in others]


def _change(airspeed: float | None, able: tuple[float, float] | None) -> tuple[str, Fate]:
    """Name of a change of speed, with the reason if it is not flown, and its fate."""
    name = COMMANDS[SPEED]
    if airspeed is None:
        return name, "not flown"
    if able is None:
        return f"{name}, in favour of `flight.V_a_mps`", "not flown"
    if able[0] <= airspeed <= able[1]:
        return name, "flown"
    low, high = able
    return f"{name}, to {airspeed:g} m/s, but the aircraft flies {low:g} to {high:g}", "no place"


def _airspeeds(rows: Sequence[Row], speeds: Mapping[int, tuple[float, int]]) -> list[str]:
    """Set the airspeed from each row on, except for the first; a sentence that lists all."""
    later = [i for i in speeds if i]
    for i in speeds if later else ():
        rows[i]["V_mps"] = speeds[i][0]
    if not speeds:
        return []
    stated = ", ".join(f"{speed:g} m/s by item {number}" for speed, number in speeds.values())
    each = "each " * (len(speeds) > 1)
    whole = (
        f", {each}from its place on where the law holds the airspeed (`holds_airspeed` of [route])"
    )
    return [f"{SETS_AIRSPEED} of {stated}{whole * bool(later)}."]


def place(name: str, values: Sequence[Any]) -> Row:
    """Latitude, longitude and height of a point of a file."""
    row = {key: json_number(x, f"`{key}` of {name}") for key, x in zip(PLACE, values, strict=True)}
    if abs(row["lat_deg"]) > MAX_LAT_DEG or abs(row["lon_deg"]) > 180.0:
        raise InputError(
            f"{name} must have a latitude up to {MAX_LAT_DEG:g} and a longitude up to 180 deg, got "
            f"{row['lat_deg']:.9g} and {row['lon_deg']:.9g}."
        )
    return row


# First words of Mission Planner's files, and number of values of an item in a line.
HEADER, COLUMNS = "QGC WPL 110", 12


def planner_items(text: str) -> tuple[list[float] | None, list[dict[str, Any]]]:
    """Home (latitude, longitude, height; or None) and items of a Mission Planner file."""
    first, *lines = [line.split() for line in stated_lines(text)] or [[]]
    if " ".join(first) != HEADER or not lines:
        got = abridged(" ".join(first)) if lines else "none"
        raise InputError(f"must begin with {HEADER} and have items, got {got}.")
    items: list[dict[str, Any]] = [
        {"type": "SimpleItem", "command": command, "frame": frame}
        | {"doJumpId": number, "params": values}
        for number, _, frame, command, *values, _ in map(_numbers, lines)
    ]
    home, *others = items
    # MAVProxy writes a file of only a fence or rally points without a home.
    if home["command"] in AREAS:
        return [*NO_HOME], items
    number, height = home["doJumpId"], home["params"][6]
    # Some planners write no home and begin with item 0 or 1. A height of 0 above home means home.
    if home["command"] == WAYPOINT and number == 0 and (home["frame"] in ABOVE_SEA or not height):
        return home["params"][4:], others
    if number not in (0, 1):
        raise InputError(f"the first line must be item 0 or 1, got item {number:g}.")
    return None, items


def _numbers(words: Sequence[str]) -> list[float]:
    """The values of an item in a line."""
    try:
        values = [*map(float, words)]
    except ValueError:
        values = []
    if len(values) != COLUMNS:
        got = abridged(" ".join(words))
        raise InputError(f"must have {COLUMNS} numbers with points in each line, got {got}.")
    return values


def stated_lines(text: str) -> list[str]:
    """Lines that are neither comments nor blank."""
    check_entries(text, LINES)
    lines = [line for line in text.splitlines() if line.strip() and line.lstrip()[0] != "#"]
    if len(lines) > MAX_ITEMS + 2:  # the first lines name the format and home
        raise InputError(f"must have at most {MAX_ITEMS} items, got {len(lines)} lines.")
    return lines
