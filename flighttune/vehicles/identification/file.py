"""An aircraft's identified inner loop, at one or more flight conditions, and its file.

The classes also define the JSON file: the keys have the units, and the file is written whole or not
at all.
"""

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PlainSerializer, computed_field

from flighttune.base import quantities as q
from flighttune.base.answering import Drawn
from flighttune.base.arrays import FloatArray, is_number
from flighttune.base.errors import InputError, ScenarioError
from flighttune.base.files import shipped
from flighttune.base.files.table import abridged, json_tables, shown, stamp, validated
from flighttune.base.files.whole import together, write_text
from flighttune.base.units import G_0
from flighttune.control.inner_loop import InnerLag, Order, with_inner_loop
from flighttune.control.law import Law, Trim, made_law
from flighttune.control.linear_model import LinearModel
from flighttune.vehicles.aircraft.aircraft import GAINS_FILE, files_hash, load_aircraft

Channel: TypeAlias = Literal["phi", "n_z", "n_x"]

# Difference of climb angle that counts like a doubling of airspeed in `nearest`.
ANGLE_PER_SPEED = math.radians(60.0)

UNITS = {
    "cross": "largest answer of the other channel to this command: 1/rad (phi), rad (n_z)",
    "model": "states, inputs and errors in rad, n_z in 1, time in s; g 9.80665 m/s^2",
}


class _Table(BaseModel):
    """A value that is also its file, with units in the keys and derived values added."""

    model_config = ConfigDict(
        frozen=True, extra="ignore", strict=True, validate_by_name=True, serialize_by_alias=True
    )


class LagTable(_Table):
    """A lag in a file; None for a parameter that its order lacks."""

    order: Order
    natural_frequency_rad_s: q.Bandwidth
    damping: q.Damping | None
    lag_s: q.TimeConstant | None
    delay_s: q.Delay

    @property
    def lag(self) -> InnerLag:
        """The lag; parameters that its order lacks keep their defaults."""
        return InnerLag(
            order=self.order,
            natural_frequency=self.natural_frequency_rad_s,
            damping=self.damping or 1.0,
            lag=self.lag_s or 1.0,
            delay=self.delay_s,
        )


def lag_table(lag: InnerLag) -> dict[str, Any]:
    """The keys of a `LagTable` and ``bandwidth_rad_s``."""
    return {
        "order": lag.order,
        "natural_frequency_rad_s": lag.natural_frequency,
        "damping": lag.damping if lag.order > 1 else None,
        "lag_s": lag.lag if lag.order > 2 else None,
        "delay_s": lag.delay,
        "bandwidth_rad_s": lag.bandwidth,
    }


class IdentifiedChannel(LagTable):
    """One channel: the identified lag and its fit."""

    # %: explained share of the variance in a manoeuvre that was not used for the fit
    fit_percent: q.Finite
    residual: q.Finite  # 1: root mean square distance between fitted and measured response
    # unit of the other channel per unit of this channel: largest response of the other channel to
    # this channel's command over the band; None if a log cannot show it
    cross: q.Finite | None
    simpler: LagTable  # the best lag of at most second order, possibly the lag itself

    @classmethod
    def of(
        cls,
        lag: InnerLag,
        *,
        fit_percent: float,
        residual: float,
        cross: float | None = None,
        simpler: InnerLag | None = None,
    ) -> "IdentifiedChannel":
        """The channel of a fit, unchecked: rounding may put a lag beyond the range of files."""
        return cls.model_construct(
            **lag_table(lag),
            fit_percent=fit_percent,
            residual=residual,
            cross=cross,
            # The default of the best lag of at most second order is the lag itself.
            simpler=LagTable.model_construct(**lag_table(simpler or lag)),
        )

    @computed_field
    @property
    def bandwidth_rad_s(self) -> float:
        """Frequency from which on the magnitude stays below 1/sqrt(2)."""
        return self.lag.bandwidth


class IdentifiedCondition(_Table):
    """The inner loop at one flight condition."""

    V_a: q.Airspeed = Field(alias="V_a_mps")  # m/s: airspeed
    # rad: flight-path angle, climb positive
    gamma: Annotated[q.Inclination, AfterValidator(math.radians), PlainSerializer(math.degrees)] = (
        Field(alias="gamma_deg")
    )
    h: q.Height = Field(alias="h_m")  # m: height above sea level
    channels: Annotated[dict[Channel, IdentifiedChannel], Field(min_length=2)]

    @property
    def lags(self) -> tuple[InnerLag, InnerLag]:
        """Lags of roll and load factor."""
        return self.channels["phi"].lag, self.channels["n_z"].lag

    @property
    def thrust_lag(self) -> InnerLag:
        """Lag of n_x; InputError if it was not identified."""
        if "n_x" not in self.channels:
            raise InputError(
                "the identified model must have the channel n_x where the airspeed is followed; "
                "`flighttune identify` measures it of an aircraft with `n_x` in its [limits]."
            )
        return self.channels["n_x"].lag

    @computed_field
    @property
    def model(self) -> dict[str, Any]:
        """The linear model of the paper's law behind the lags, for other programs."""
        model = design_model(self, g=G_0).model
        return {
            "states": model.states,
            "inputs": [f"{name}_cmd" for name in model.inputs],
            "errors": model.errors,
            **{name: getattr(model, name).tolist() for name in ("A", "B", "C")},
        }


Interval: TypeAlias = Annotated[tuple[q.Finite, q.Finite], Field(strict=False)]


class LogEvidence(_Table):
    """The logs of a model identified from them, and limits observed in them."""

    logs: Annotated[tuple[str, ...], Field(strict=False)]
    assumed: Annotated[tuple[Channel, ...], Field(strict=False)]  # channels that no log shows
    frequency_95_rad_s: dict[Channel, Interval]
    delay_95_s: dict[Channel, Interval]
    stretches: dict[Channel, int]
    phi_deg: Interval
    phi_rate_dps: q.Positive
    n_z: Interval
    n_z_rate_per_s: q.Positive
    # Largest 1 s mean of the lags' residual rates of course and path angle, in all stretches of 5 s
    # of these logs; None if the logs cannot show it
    residual_rad_s: dict[Literal["chi", "gamma"], q.Finite] | None = None
    residual_stretches: int = 0
    # Channels without command and response in the logs, and so without observed limits
    limits_assumed: Annotated[tuple[Channel, ...], Field(strict=False)] = ()

    @property
    def sentence(self) -> str:
        """The meaning of `residual_rad_s` in words."""
        return (
            f"largest mean over 1 s of what the lags miss of the rates, in the "
            f"{self.residual_stretches} stretches of 5 s of {', '.join(self.logs)}, which the lags "
            "were fitted to; no claim about other flights"
        )


class IdentifiedAircraft(_Table):
    """An aircraft's inner loop at every identified condition."""

    format: Literal["flighttune identified aircraft 1"] = "flighttune identified aircraft 1"
    aircraft: str
    seed: int = 0  # seed of the excitation
    # Hash of the inner loop's gains; empty if unknown
    gains: str = Field(alias="gains_sha256", default="")
    log: LogEvidence | None = None  # evidence of a model identified from logs of real flights
    # The first is the nominal condition
    conditions: Annotated[tuple[IdentifiedCondition, ...], Field(strict=False, min_length=1)]

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions about values that no log shows, one sentence each."""
        if self.log is None:
            return ()
        lags = self.conditions[0].channels
        return (
            *(
                f"Assumed, not measured: {name} of {self.aircraft} follows its command at "
                f"{lags[name].natural_frequency_rad_s:.4g} rad/s."
                for name in self.log.assumed
            ),
            *(
                f"Assumed, not measured: the limits of {name} of {self.aircraft}."
                for name in self.log.limits_assumed
            ),
        )

    @computed_field
    @property
    def units(self) -> dict[str, str]:
        """Units of values without a unit in their key."""
        return UNITS

    def save(self, path: str | Path) -> None:
        """Write the model (.json), whole or not at all."""
        text = json.dumps(identified_tables(self), indent=2, allow_nan=False) + "\n"
        write_text(Path(path), text)

    def nearest(self, V_a: float, gamma: float) -> IdentifiedCondition:
        """The condition nearest to an airspeed (m/s) and a flight-path angle (rad)."""

        def distance(condition: IdentifiedCondition) -> float:
            octaves = math.log2(condition.V_a / V_a)
            return math.hypot(octaves, (condition.gamma - gamma) / ANGLE_PER_SPEED)

        return min(self.conditions, key=distance)


class DesignModel(NamedTuple):
    """The chi/gamma law behind an identified inner loop, for designing gains."""

    model: LinearModel  # states (chi, gamma, lags), inputs (phi, n_z) commands, errors (chi, gamma)
    scaling: FloatArray  # (n + 2,): as `flighttune.control.inner_loop.inner_loop_scaling`
    # m/s and rad: airspeed and flight-path angle of the law
    V_a: float
    gamma: float
    law_model: LinearModel  # model of the law alone
    lags: tuple[InnerLag, ...]  # lags of roll and load factor, without the delay of the hold
    whole_lags: tuple[float, ...]  # s: sum of lag and delay of each, including the hold


def design_model(
    condition: IdentifiedCondition,
    *,
    g: float,
    V_a: float | None = None,
    gamma: float | None = None,
    hold: float = 0.0,
    schedule_speed: float | None = None,
    law: Law | None = None,
    airspeed: bool = False,
) -> DesignModel:
    """Return the plant of the outer loop: a law, the paper's by default, behind the inner loop.

    `V_a` (m/s) and `gamma` (rad) come from the condition by default. `hold` (s), half the sample
    time of the controller, is added to the delay of all channels. For gains scheduled from the
    airspeed `schedule_speed`, the inputs of the law are scaled by ``V_a / schedule_speed``, which
    gives the same loop. `airspeed`: a third channel, behind the lag of n_x.
    """
    V_a = condition.V_a if V_a is None else V_a
    gamma = condition.gamma if gamma is None else gamma
    law = law or made_law("paper")
    trim = Trim(V_a=V_a, gamma=gamma, g=g, schedule_speed=schedule_speed, airspeed=airspeed)
    model = law.linear_model(trim)
    measured = (*condition.lags, condition.thrust_lag) if airspeed else condition.lags
    lags = [lag.delayed(hold) for lag in measured]
    return DesignModel(
        model=with_inner_loop(model, lags),
        scaling=law.state_scaling(model, lags),
        V_a=V_a,
        gamma=gamma,
        law_model=model,
        lags=measured,
        whole_lags=tuple(lag.whole for lag in lags),
    )


FILE_NAME = "identified.json"

# Significant digits in files: more than a flight determines, fewer than differ between machines.
DIGITS = 6

EXACT = ("V_a_mps", "h_m")

# Relative tolerance between a number and its value from the rounded lags.
ROUNDING = 1e-4


def identified_tables(aircraft: IdentifiedAircraft) -> dict[str, Any]:
    """An identified aircraft as the object of its file."""
    absent: dict[str, Any] = {n: True for n in ("gains", "log") if not getattr(aircraft, n)}
    if aircraft.log and not aircraft.log.limits_assumed:
        absent["log"] = {"limits_assumed"}
    return rounded(aircraft.model_dump(exclude=absent), DIGITS, EXACT)


def save_with_figure(
    aircraft: IdentifiedAircraft, path: Path, result: Drawn
) -> dict[str, Path | None]:
    """Write a model and, if it has charts, the figure of its fits beside it."""
    sheet = result.sheet()
    figure = path.with_suffix(".svg") if sheet.charts else None
    with together():
        aircraft.save(path)
        if figure is not None:
            sheet.save(figure)
    return {"model": path, "figure": figure}


def load_identified(source: str | Path) -> IdentifiedAircraft:
    """Read an identified aircraft.

    Parameters
    ----------
    source : str or Path
        A JSON file saved by `identify`, the folder of an aircraft with ``identified.json``, or the
        name of a shipped aircraft.

    Raises
    ------
    InputError
        If there is no such aircraft.
    ScenarioError
        If the file cannot be read or is not an identified aircraft; the message names file and key.

    Examples
    --------
    >>> identified = ft.loop.load_identified("aerosonde")
    >>> round(identified.conditions[0].channels["phi"].fit_percent)
    100
    """
    path = Path(source)
    if path.name == str(source) and path.suffix != ".json":
        path = shipped.aircraft_folder(str(source))
    if os.path.isdir(path):
        path = path / FILE_NAME
    if not os.path.exists(path):
        raise ScenarioError(f"{path}: must be there; `flighttune identify` writes one.")
    aircraft = _read(path, stamp(path))
    if aircraft.gains and (path.parent / "aircraft.toml").is_file():
        gains = load_aircraft(path.parent).gains
        if gains is None or gains.sha256 != aircraft.gains:
            raise ScenarioError(
                f"{path}: must be identified with the gains in {GAINS_FILE}, got others; "
                "`flighttune identify` measures it anew."
            )
    return aircraft


def files_of(name: str | None) -> dict[str, str]:
    """SHA-256 of the files of an aircraft, or of the file of a model, by its name, if any."""
    if name is None:
        return {}
    file = Path(name)
    is_file = file.suffix == ".json"
    return {name: sha256(file.read_bytes()).hexdigest() if is_file else files_hash(name)}


def changed_files(known: Mapping[str, str]) -> list[str]:
    """Aircraft whose files changed or were deleted since."""
    changed = []
    for name, digest in known.items():
        with suppress(InputError, OSError):
            if files_of(name)[name] == digest:
                continue
        changed.append(name)
    return changed


@lru_cache(maxsize=32)  # cached, because every flight with a feasible reference needs its lags
def _read(path: Path, _stamp: tuple[int, ...]) -> IdentifiedAircraft:
    """The identified aircraft of a file, read again after a change."""
    tables = json_tables(path)
    aircraft = validated(IdentifiedAircraft, tables, path)
    for fault in _contradictions(tables, identified_tables(aircraft)):
        raise ScenarioError(f"{path}: {fault}.")
    return aircraft


def _contradictions(stated: Any, derived: Any, key: str = "") -> Iterator[str]:
    """Entries of a file that contradict its lags, since its matrices are for other programs."""
    if isinstance(stated, dict) and isinstance(derived, dict):
        for name, value in stated.items():
            inside = f"{key}.{name}".removeprefix(".")
            if name in derived:
                yield from _contradictions(value, derived[name], inside)
            else:
                yield f"`{shown(inside)}` is not a known key; the keys are {', '.join(derived)}"
    elif isinstance(stated, list) and isinstance(derived, list) and len(stated) == len(derived):
        for i, (entry, other) in enumerate(zip(stated, derived, strict=True)):
            yield from _contradictions(entry, other, f"{key}[{i}]")
    elif not _same(stated, derived):
        got = abridged(stated)
        yield f"`{key}` must be {abridged(derived)}, as the lags of the file make it, got {got}"


def _same(stated: Any, derived: Any) -> bool:
    if is_number(stated) and isinstance(derived, float):
        return math.isclose(stated, derived, rel_tol=ROUNDING, abs_tol=ROUNDING)
    return stated == derived


def rounded(value: Any, digits: int, exact: Sequence[str] = ()) -> Any:
    """Plain nested values with floats rounded to significant digits, except for `exact` keys."""
    if isinstance(value, Mapping):
        return {
            key: item if key in exact else rounded(item, digits, exact)
            for key, item in value.items()
        }
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [rounded(item, digits, exact) for item in value]
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value
