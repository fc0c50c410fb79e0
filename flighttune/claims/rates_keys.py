"""``rates.toml``: declared rates of faults per flight hour, and how a flight is ended."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from flighttune.base import quantities as q
from flighttune.base.files.table import toml_tables, validated
from flighttune.routes.ending_keys import Manoeuvre
from flighttune.vehicles.aircraft.aircraft import SURFACES

# Default numbers of flights: without a fault, and with each fault.
HEALTHY, FAULTY = 1000, 300


HowEnded: TypeAlias = Literal["cut", "parachute", "turn_back", "circle", "glide"]

# Endings after which a flight comes down, and manoeuvres of the others and of the glide.
DOWN = ("cut", "parachute", "glide")
MANOEUVRES: Mapping[HowEnded, Manoeuvre] = {
    "turn_back": "turn_back",
    "circle": "circle",
    "glide": "straight",
}


class Kind(NamedTuple):
    """A kind of fault: the key of its size in a scenario, and the key of its range."""

    key: str = ""  # of [plant.airframe.fault], or of [navigation.fault] with `receiver`
    range_key: str = ""  # of [[fault]]
    fixed: float | None = None  # size of a fault without a range
    receiver: bool = False
    surface: str = ""


KINDS: Mapping[str, Kind] = {
    "engine": Kind("throttle_factor", fixed=0.01),
    "aileron_stuck": Kind("aileron_stuck_deg", "stuck_deg", surface="aileron"),
    "elevator_stuck": Kind("elevator_stuck_deg", "stuck_deg", surface="elevator"),
    "rudder_stuck": Kind("rudder_stuck_deg", "stuck_deg", surface="rudder"),
    "actuator_slow": Kind("actuator_lag_factor", "factor"),
    "airspeed_wrong": Kind("V_a_bias_mps", "bias_mps"),
    "receiver_jump": Kind("jump_m", "jump_m", receiver=True),
    "receiver_lost": Kind("drift_mps", "drift_mps", receiver=True),
    "link_lost": Kind(),
}
FLOATING = tuple(f"{name}_floating" for name in SURFACES)
RANGES = tuple(dict.fromkeys(kind.range_key for kind in KINDS.values() if kind.range_key))


def _kind(name: str) -> str:
    if name in FLOATING:
        raise ValueError(
            f"must be a fault that a model has: no aircraft here has the hinge moments with which "
            f"a surface floats; declare {name.replace('floating', 'stuck')}"
        )
    if name not in KINDS:
        raise ValueError(f"must be one of {', '.join(KINDS)}")
    return name


Range: TypeAlias = Annotated[tuple[q.Finite, q.Finite], *q.Rising]
Number: TypeAlias = Annotated[int, Field(ge=1, le=10**6)]


class FaultRateTable(q.Table):
    """``[[fault]]``: a kind of fault with its declared rate; its size is drawn from a range."""

    kind: Annotated[str, AfterValidator(_kind)]
    # Faults per flight hour that the applicant declares
    per_hour: Annotated[q.Positive, Field(le=1.0)]
    source: Annotated[str, Field(min_length=1, max_length=1000)]  # origin of the rate
    stuck_deg: Range | None = None  # position of a stuck surface; its travel if left out
    factor: Range | None = None  # on the time constants of the surface actuators
    bias_mps: Range | None = None  # measured minus true airspeed
    jump_m: Range | None = None  # jump of the position, in any direction
    drift_mps: Range | None = None  # growth of the error of position without a receiver
    # Times since the fault; without `ended_s` the autopilot flies the route on
    detected_s: q.Instant | None = None
    ended_s: q.Instant | None = None
    ending: HowEnded | None = None  # if left out, that of [ending]
    flights: Number = FAULTY

    @property
    def of_kind(self) -> Kind:
        """Description of its kind."""
        return KINDS[self.kind]

    @model_validator(mode="after")
    def _keys_of_the_kind(self) -> Self:
        own = self.of_kind.range_key
        self.must_lack(f"for the fault {self.kind}", *(key for key in RANGES if key != own))
        if own not in ("", "stuck_deg") and getattr(self, own) is None:
            raise ValueError(f"`{own}` must be given for the fault {self.kind}")
        if self.detected_s is not None and self.ended_s is None:
            raise ValueError("`ended_s` must be given beside `detected_s`")
        if (self.ended_s or 0.0) < (self.detected_s or 0.0):
            raise ValueError(
                f"`ended_s` must be at least `detected_s`, {self.detected_s:g} s, got "
                f"{self.ended_s:g}: no flight is ended before its fault is detected"
            )
        return self


class EndingTable(q.Table):
    """``[ending]``: how a flight is ended, and by which alarms."""

    # cut: thrust off and full surfaces; parachute: drifts with the wind; turn_back and circle: as
    # tight as the turns of the route; glide: thrust off, straight on under control
    kind: HowEnded = "cut"
    # Horizontal distance per height that the applicant declares for a fall, after a cut or where
    # the model no longer holds
    fall_per_height: Annotated[q.NotNegative, Field(le=100.0)] | None = None
    sink_mps: Annotated[q.Positive, Field(le=100.0)] | None = None  # of the parachute
    opens_s: Annotated[q.NotNegative, Field(le=60.0)] | None = None  # flown on until it is open
    # File of a monitor (.npz) on board: its first alarm ends a flight, true or false
    monitor: Annotated[str, Field(min_length=1)] | None = None
    after_alarm_s: Annotated[q.Instant, Field(le=600.0)] = 0.0  # from the alarm to the ending

    @model_validator(mode="after")
    def _with_a_monitor(self) -> Self:
        if self.monitor is None:
            self.must_lack("without a `monitor`", "after_alarm_s")
        return self


class RatesTable(q.Table):
    """A file of declared rates."""

    target_per_hour: Annotated[q.Positive, Field(le=1.0)] | None = None
    flights: Number = HEALTHY  # without a fault
    ending: EndingTable = EndingTable()
    fault: Annotated[list[FaultRateTable], Field(min_length=1, max_length=50)]

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        kinds = [fault.kind for fault in self.fault]
        if again := next((kind for kind in kinds if kinds.count(kind) > 1), ""):
            raise ValueError(f"`fault` must have each kind once, got {again} again")
        return self

    @model_validator(mode="after")
    def _of_its_endings(self) -> Self:
        table = self.ending
        endings = {table.kind, *(fault.ending for fault in self.fault if fault.ending)}
        for key in ("sink_mps", "opens_s"):
            if "parachute" not in endings:
                table.must_lack("without a parachute", key)
            elif getattr(table, key) is None:
                raise ValueError(f"`{key}` of [ending] must be given for a parachute")
        if endings == {"parachute"}:
            table.must_lack("with a parachute", "fall_per_height")
        for fault in self.fault if table.monitor is None else ():
            if fault.ended_s is None:
                fault.must_lack("without `ended_s` and without a monitor", "ending")
        return self

    def name_of(self, fault: int | None, ended_s: float | None) -> str:
        """The flights with a fault, or without one, and how they are ended, in words."""
        name = "healthy flight" if fault is None else self.fault[fault].kind.replace("_", " ")
        after = [] if ended_s is None else [f"after {ended_s:g} s"]
        alarm = [] if self.ending.monitor is None else ["at an alarm"]
        when = " or ".join([*after, *alarm])
        return f"{name}, {self.ending_of(fault).replace('_', ' ')} {when}" if when else name

    def flights_of(self, fault: int | None) -> int:
        """Number of flights with a fault, or without one."""
        return self.flights if fault is None else self.fault[fault].flights

    def ending_of(self, fault: int | None) -> HowEnded:
        """How a flight with a fault, or without one, is ended."""
        own = None if fault is None else self.fault[fault].ending
        return own or self.ending.kind


def load_rates(path: str | Path) -> RatesTable:
    """Read declared rates; ScenarioError names file and key."""
    return validated(RatesTable, toml_tables(Path(path)), path)
