"""When a flight leaves its operational volume, and when and how it is ended before."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
import shapely

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.files.table import STRICT
from flighttune.base.words import listed
from flighttune.claims.rates_keys import DOWN, EndingTable, HowEnded
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps.watch import SignalModel, Watch
from flighttune.routes.fence import Fence
from flighttune.routes.maps import Where
from flighttune.routes.volumes import rings_around

# Time between the samples at which a flight is looked at, s.
LOOKED_AT_S = 0.1

# Areas of a fence.
GeoJSON: TypeAlias = dict[str, Any]

# Value of a time that does not occur.
NEVER = -1.0

# Tolerance for the rounding of places of a volume on other machines, m.
SAME_M = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Around:
    """The contingency volume of a mission: how far it reaches from the route."""

    width_m: float  # to each side, and around both ends
    high_m: float  # over ground


@dataclass(frozen=True, slots=True, kw_only=True)
class Volume:
    """A volume not to leave by its sides or its top, and by its floor, in m from the start."""

    rings: tuple[tuple[tuple[float, float], ...], ...]  # north, east
    outside: tuple[bool, ...]  # whether flights must stay outside each ring
    low: float | None  # None: the ground
    high: float | None

    @classmethod
    def of(cls, fence: Fence) -> "Volume":
        """The volume of a fence."""
        rings = tuple(tuple((n, e) for n, e in ring.tolist()) for ring in fence.rings)
        low, high = (float(x) if math.isfinite(x) else None for x in (fence.low, fence.high))
        return cls(rings=rings, outside=tuple(map(bool, fence.outside)), low=low, high=high)

    @classmethod
    def around(cls, where: Where, ground_m: float, around: Around) -> "Volume":
        """The volume around a route, above the ground at a height above sea level."""
        rings = rings_around(where[0], around.width_m)
        return cls(
            rings=tuple(tuple((n, e) for n, e in ring.tolist()) for ring in rings),
            outside=(False, *(True for _ in rings[1:])),
            low=None,
            high=around.high_m + ground_m - where[2],
        )

    def differs(self, other: "Volume") -> bool:
        """Whether volumes differ by more than the rounding of their places."""
        shapes, numbers = zip(*(volume.parts for volume in (self, other)), strict=True)
        return shapes[0] != shapes[1] or not np.allclose(*numbers, rtol=0.0, atol=SAME_M)

    @property
    def parts(self) -> tuple[Any, FloatArray]:
        """Its shape, and all its lengths in m."""
        ends = [x for x in (self.low, self.high) if x is not None]
        shape = self.outside, [*map(len, self.rings)], self.low is None, self.high is None
        return shape, np.concatenate([*map(np.ravel, self.rings), ends])

    @property
    def words(self) -> str:
        """Its size, and where it is from the start."""
        shapes = [*zip(self.rings, self.outside, strict=True)]
        corners = [corner for ring, outside in shapes if not outside for corner in ring]
        if not corners:
            return "all but the areas to stay out of"
        (south, west), (north, east) = np.min(corners, axis=0), np.max(corners, axis=0)
        sides = [
            f"{_way(south, 'north', 'south')} to {_way(north, 'north', 'south')}",
            f"{_way(west, 'east', 'west')} to {_way(east, 'east', 'west')} of the start",
        ]
        low = "the ground" if self.low is None else f"{self.low:.1f} m above the start"
        high = "any height" if self.high is None else f"{self.high:.1f} m above the start"
        less = f" without {sum(self.outside)} areas in it" if any(self.outside) else ""
        size = f"{north - south:.0f} m by {east - west:.0f} m"
        return f"{size}{less} ({listed(sides)}), from {low} to {high}"

    def margins(self, places: FloatArray) -> FloatArray:
        """Distances inside the sides, the top and the floor, shape (places, 3), m; negative out."""
        points = np.asarray(shapely.points(places[:, :2]))
        beside = np.full(len(places), np.inf)
        for ring, outside in zip(self.rings, self.outside, strict=True):
            area = shapely.Polygon(ring)
            shapely.prepare(area)
            sign = np.where(shapely.contains(area, points) == outside, -1.0, 1.0)
            beside = np.minimum(beside, sign * shapely.distance(area.exterior, points))
        top = np.full(len(places), np.inf) if self.high is None else self.high - places[:, 2]
        floor = np.full(len(places), np.inf) if self.low is None else places[:, 2] - self.low
        return np.column_stack([beside, top, floor])


def _way(metres: float, ahead: str, back: str) -> str:
    """A distance and its direction."""
    return f"{abs(metres):.0f} m {ahead if metres >= 0.0 else back}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarms:
    """A monitor on board: its models, and the middle and half-width of each residual."""

    models: tuple[SignalModel, ...]
    middle: tuple[float, ...]
    half: tuple[float, ...]

    __pydantic_config__: ClassVar = STRICT

    @classmethod
    def of(cls, watch: Watch) -> "Alarms":
        """The numbers of a watch."""
        middle, half = (tuple(x.tolist()) for x in (watch.middle, watch.half))
        return cls(models=watch.models, middle=middle, half=half)

    def first(self, run: Run) -> float:
        """Time of the first alarm in a run, s; infinite without one."""
        watch = Watch(models=self.models, middle=np.array(self.middle), half=np.array(self.half))
        try:
            alarm = watch.alarm(run)
        except InputError:  # it ended within a sample, or without an airspeed
            return math.inf
        return math.inf if alarm is None else alarm.at_s


class Left(NamedTuple):
    """What a flight did; `NEVER` is a time that does not occur."""

    left_s: float  # it left the volume
    end_s: float  # the end of its record
    ended_s: float  # it was ended
    at_m: float  # place on the route at which it leaves it in its ending, m


# Values of a flight without a sample: it left at its start.
AT_ITS_START = Left(left_s=0.0, end_s=0.0, ended_s=NEVER, at_m=NEVER)


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaving:
    """Probe of a flight: when it leaves a volume, and when it is ended."""

    volume: Volume
    ending: EndingTable
    how: HowEnded
    after_s: float | None = None  # time from fault to ending
    alarms: Alarms | None = None  # of a monitor whose alarms end flights too
    lead_s: float = 0.0  # time by which a law plans commands ahead

    any_end: ClassVar[bool] = True  # also asked of flights that did not complete

    def __call__(self, run: Run, scenario: Scenario) -> list[float]:
        """The values of `Left`."""
        if not len(run.signals):
            return [*AT_ITS_START]
        t, ended_at = np.asarray(run.t, dtype=float), self._ended_at(run, scenario)
        left, end = self._left(run, scenario, ended_at), float(t[-1])
        if ended_at > end:
            return [left, end, NEVER, NEVER]
        at_m = NEVER
        if "along" in run.signals:
            # Commands are planned ahead: the route is left by so much later.
            along = run.signals["along"].to_numpy(float)
            at_m = max(float(np.interp(ended_at + self.lead_s, t, along)), 0.0)
        return [left, end, ended_at, at_m]

    def _left(self, run: Run, scenario: Scenario, ended_at: float) -> float:
        """Time at which a flight leaves the volume, s."""
        t = np.asarray(run.t, dtype=float)
        every = max(round(LOOKED_AT_S * scenario.controller.rate_hz), 1)
        looked = np.unique(np.append(np.arange(0, len(t), every), len(t) - 1))
        ended = ended_at <= t[-1]
        if parachute := ended and self.how == "parachute":
            last = int(np.searchsorted(t, ended_at))
            looked = np.unique(np.append(looked[looked < last], last))
        signals = run.signals.iloc[looked]
        up = signals["h"].to_numpy() - float(run.signals["h"].iloc[0])
        margins = self.volume.margins(np.column_stack([signals["north"], signals["east"], up]))
        if self.how in DOWN:
            # It comes down to the ground inside the sides, which is no exit.
            margins[t[looked] >= ended_at, 2] = np.inf
        out = (margins < 0.0).any(axis=1)
        if out.any():
            return float(t[looked][out.argmax()])
        if run.status in self._whole(ended) and not parachute:
            return NEVER
        # If it was not ended, the autopilot flies on, and the model no longer holds.
        inside = ended and self._falls_inside(signals.iloc[-1], margins[-1], scenario)
        return NEVER if inside else float(t[-1])

    def _whole(self, ended: bool) -> tuple[str, ...]:
        """Ends of the record of a flight that stays inside if it has done so far."""
        gliding = ended and self.how == "glide"  # until it is on the ground
        return ("ground_contact",) if gliding else ("completed", "ground_contact")

    def _ended_at(self, run: Run, scenario: Scenario) -> float:
        """Time at which the flight is ended, s; infinite for none."""
        at = math.inf if self.after_s is None else fault_time(scenario) + self.after_s
        if self.alarms is None:
            return at
        return min(at, self.alarms.first(run) + self.ending.after_alarm_s)

    def _falls_inside(
        self, end: Mapping[str, Any], margins: FloatArray, scenario: Scenario
    ) -> bool:
        """Whether an ended flight reaches the ground inside, from its last flown state."""
        height = float(end["h"]) - scenario.flight.ground_m
        rise = 0.5 * float(end["V_a"]) ** 2 / scenario.flight.g_mps2
        if self.how == "parachute":
            sink, opens = self.ending.sink_mps, self.ending.opens_s
            assert sink is not None
            assert opens is not None  # its table has both
            drift = math.hypot(float(end["wind_north"]), float(end["wind_east"]))
            reach = float(end["V_g"]) * opens + drift * height / sink
        elif self.ending.fall_per_height is None:
            return False
        else:
            reach = self.ending.fall_per_height * (height + rise)
        return bool(margins[0] >= reach and margins[1] >= rise)


def fault_time(scenario: Scenario) -> float:
    """Time of a flight's fault, s."""
    if scenario.navigation is not None and scenario.navigation.fault is not None:
        return scenario.navigation.fault.from_s
    faults = [x.airframe.fault for x in scenario.plant if x.airframe is not None]
    (fault,) = (fault for fault in faults if fault is not None)
    return fault.from_s
