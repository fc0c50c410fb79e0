"""``rates.toml``: declared rates of faults per flight hour, and how a flight is ended."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from flighttune.base import quantities as q
from flighttune.base.files.table import toml_tables, validated

# Default numbers of flights: without a fault, and with each fault.
HEALTHY, FAULTY = 1000, 300


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
RANGES = tuple(dict.fromkeys(kind.range_key for kind in KINDS.values() if kind.range_key))


def _kind(name: str) -> str:
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
    # Times since the fault; without `ended_s` the autopilot flies on
    detected_s: q.Instant | None = None
    ended_s: q.Instant | None = None
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
    """``[ending]``: how a flight is ended."""

    # cut: thrust off and full surfaces; parachute: drifts with the wind
    kind: Literal["cut", "parachute"] = "cut"
    # Horizontal distance per height that the applicant declares for the fall after a cut
    fall_per_height: Annotated[q.NotNegative, Field(le=100.0)] | None = None
    sink_mps: Annotated[q.Positive, Field(le=100.0)] | None = None  # of the parachute
    opens_s: Annotated[q.NotNegative, Field(le=60.0)] | None = None  # flown on until it is open

    @model_validator(mode="after")
    def _keys_of_the_kind(self) -> Self:
        if self.kind == "cut":
            self.must_lack("without a parachute", "sink_mps", "opens_s")
            return self
        self.must_lack("with a parachute", "fall_per_height")
        for key in ("sink_mps", "opens_s"):
            if getattr(self, key) is None:
                raise ValueError(f"`{key}` must be given for a parachute")
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


def load_rates(path: str | Path) -> RatesTable:
    """Read declared rates; ScenarioError names file and key."""
    return validated(RatesTable, toml_tables(Path(path)), path)
