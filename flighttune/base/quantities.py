"""The tables of files, and the ranges of their numbers by quantity.

The ranges are wide: a number outside is a typing error, has the wrong unit, would overflow or would
take hours to fly.
"""

from pathlib import Path
from typing import Annotated, Any, Self, TypeAlias

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from flighttune.base.files.budget import MAX_NAME, MAX_PATH


class Table(BaseModel):
    """A table of a file: unknown keys and other types are refused, and it does not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    def __getstate__(self) -> dict[Any, Any]:
        """Only its keys are pickled: files that it names may lie elsewhere on another machine."""
        state = super().__getstate__()
        keys = {key: state["__dict__"][key] for key in type(self).model_fields}
        return {**state, "__dict__": keys}

    def __copy__(self) -> Self:
        """A copy without the cached values of this table, since its keys may change."""
        copied = super().__copy__()
        for name in vars(copied).keys() - type(self).model_fields.keys():
            del vars(copied)[name]
        return copied

    def must_lack(self, why: str, *keys: str) -> None:
        """Refuse the first of `keys` whose value is not its default."""
        for key in keys:
            if getattr(self, key) != type(self).model_fields[key].default:
                raise ValueError(f"`{key}` must be absent {why}")


Finite: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
Positive: TypeAlias = Annotated[Finite, Field(gt=0.0)]
NotNegative: TypeAlias = Annotated[Finite, Field(ge=0.0)]

Airspeed: TypeAlias = Annotated[Finite, Field(ge=1.0, le=1000.0)]  # m/s

FASTEST_WIND = 200.0
# m/s, or a deviation of airspeed; the fastest wind measured was 113 m/s.
Wind: TypeAlias = Annotated[Finite, Field(ge=-FASTEST_WIND, le=FASTEST_WIND)]

# m/s, where another key has the sign.
WindSpeed: TypeAlias = Annotated[Finite, Field(ge=0.0, le=FASTEST_WIND)]

Height: TypeAlias = Annotated[Finite, Field(ge=-500.0, le=30_000.0)]  # m above sea level

Duration: TypeAlias = Annotated[Positive, Field(le=1e6)]  # s: twelve days

Instant: TypeAlias = Annotated[NotNegative, Field(le=1e6)]  # s

# deg, or a change of course or of path angle: ten turns either way.
Course: TypeAlias = Annotated[Finite, Field(ge=-3600.0, le=3600.0)]

STEEPEST_DEG = 89.0
# deg of path angle or bank: there is no course straight up, and no lift to hold the bank of 90.
Inclination: TypeAlias = Annotated[Finite, Field(ge=-STEEPEST_DEG, le=STEEPEST_DEG)]

Angle: TypeAlias = Annotated[Finite, Field(ge=-180.0, le=180.0)]  # deg

AngularSpread: TypeAlias = Annotated[NotNegative, Field(le=180.0)]  # deg: standard deviation

AngularRate: TypeAlias = Annotated[Finite, Field(ge=-1e4, le=1e4)]  # deg/s, or 1/s of load factor

# deg/s, or 1/s of load factor: a limit both ways.
PositiveRate: TypeAlias = Annotated[Positive, Field(le=1e4)]

LoadFactor: TypeAlias = Annotated[Finite, Field(ge=-50.0, le=50.0)]

Gravity: TypeAlias = Annotated[Finite, Field(ge=0.1, le=100.0)]  # m/s^2

# rad/s: bandwidth of a lag. A faster lag has no effect and would take hundreds of steps a sample.
Bandwidth: TypeAlias = Annotated[Finite, Field(ge=0.05, le=200.0)]

Damping: TypeAlias = Annotated[Finite, Field(ge=0.05, le=5.0)]
TimeConstant: TypeAlias = Annotated[Finite, Field(ge=1e-3, le=1e4)]  # s

Delay: TypeAlias = Annotated[NotNegative, Field(le=2.0)]  # s

Oscillation: TypeAlias = Annotated[NotNegative, Field(le=1000.0)]  # rad/s

# rad/s: amplitude of a disturbance of course or path-angle rate.
OscillationRate: TypeAlias = Annotated[Finite, Field(ge=-1e4, le=1e4)]

Factor: TypeAlias = Annotated[Finite, Field(ge=0.01, le=100.0)]  # on an aircraft's property

Shift: TypeAlias = Annotated[Finite, Field(ge=-10.0, le=10.0)]  # m: shift of a centre of gravity

Length: TypeAlias = Annotated[Finite, Field(ge=0.1, le=1e5)]  # m

Gain: TypeAlias = Annotated[Finite, Field(ge=-1e6, le=1e6)]
PositiveGain: TypeAlias = Annotated[Positive, Field(le=1e6)]
Scale: TypeAlias = Annotated[Finite, Field(ge=1e-6, le=1e6)]  # size of the unit of a state


def _pair(value: object) -> object:
    if not (isinstance(value, list | tuple) and len(value) == 2):
        raise ValueError("must be a range [low, high]")
    return value


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] < ends[1]:
        raise ValueError("must be a range [low, high] with low below high")
    return ends


# An array of a file is a list.
Rising = Field(strict=False), BeforeValidator(_pair), AfterValidator(_rising)
Airspeeds: TypeAlias = Annotated[tuple[Airspeed, Airspeed], *Rising]
Inclinations: TypeAlias = Annotated[tuple[Inclination, Inclination], *Rising]
Angles: TypeAlias = Annotated[tuple[Angle, Angle], *Rising]
AngularRates: TypeAlias = Annotated[tuple[AngularRate, AngularRate], *Rising]
LoadFactors: TypeAlias = Annotated[tuple[LoadFactor, LoadFactor], *Rising]

# Longest name of gains, a plant or an aircraft's folder: together they name a file.
MAX_BYTES = 80


def short(value: str) -> str:
    """The value, a name or path, if file systems allow it; else a ValueError."""
    *above, name = (len(part.encode()) for part in ("", *Path(value).parts))
    if name > MAX_BYTES or max(above, default=0) > MAX_NAME or "\0" in value:
        raise ValueError(f"must be a name of at most {MAX_BYTES} bytes, it has {name}")
    return value


# Longest name of something that ships with flighttune, or longest path.
PathName: TypeAlias = Annotated[
    str, Field(min_length=1, max_length=MAX_PATH), AfterValidator(short)
]

# Name of a gain set, a law or a plant.
Name: TypeAlias = Annotated[str, Field(min_length=1, pattern=r"^[\w.*+-]+$"), AfterValidator(short)]
