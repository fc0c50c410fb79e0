"""How much a metric may change before it counts: tolerances for regression."""

import difflib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flighttune.comparison.compare import Comparison
from flighttune.comparison.measures import FLIGHT, FLIGHT_UNITS, WANTED, better
from flighttune.errors import InputError
from flighttune.metrics import CHANNELS, METRICS

DISTANCE, DURATION = "max_distance_m", "duration_s"
OPTIONS = ("absolute", "relative", "only_worse")


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """Largest change ``|b - a|`` of a metric: ``absolute + relative |a|``.

    Attributes
    ----------
    absolute : float, unit of the metric
    relative : float, 1
    only_worse : bool
        Whether a change for the better may be of any size.
    """

    absolute: float = 0.0
    relative: float = 0.0
    only_worse: bool = False

    def __post_init__(self) -> None:
        for name in ("absolute", "relative"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"`{name}` must not be negative, got {value}.")

    def allows(self, name: str, a: float, b: float) -> bool:
        """Whether metric `name` may go from `a` to `b`; both missing is no change."""
        if math.isnan(a) and math.isnan(b):
            return True
        if self.only_worse and better(name, a, b) == "b":
            return True
        return abs(b - a) <= self.room(a)

    def room(self, a: float) -> float:
        """Largest change from `a`."""
        return self.absolute + self.relative * abs(a)


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """One metric that is out of tolerance.

    Attributes
    ----------
    run_a, run_b, channel, name : str
    a, b : float, unit of the metric
        Zero and the distance for ``max_distance_m``, times flown for ``duration_s``.
    allowed : float
        Largest change of it.
    """

    run_a: str
    run_b: str
    channel: str
    name: str
    a: float
    b: float
    allowed: float

    @classmethod
    def of(
        cls,
        labels: tuple[str, str],
        channel: str,
        name: str,
        values: tuple[float, float],
        allowed: float,
    ) -> "Violation":
        """The violation of one metric of the runs of two labels."""
        return cls(
            run_a=labels[0], run_b=labels[1], channel=channel, name=name,
            a=values[0], b=values[1], allowed=allowed,
        )  # fmt: skip

    @property
    def sentence(self) -> str:
        """What was allowed and what came."""
        return (
            f"{self.run_b}: {self.channel} {self.name} must be within {self.allowed:.4g} of "
            f"{self.a:.6g}, got {self.b:.6g}."
        )


def load_tolerances(path: str | Path) -> dict[str, Tolerance]:
    """Read a tolerance file.

    Parameters
    ----------
    path : path-like
        TOML: a table each metric with ``absolute`` and ``relative`` (they add) and ``only_worse``.
        A metric stands for all its channels, or inside a table ``[chi]``, ``[gamma]`` or
        ``[flight]`` for one, which goes before. ``max_distance_m`` takes ``absolute``.

    Returns
    -------
    dict
        Tolerance by metric, or by ``channel.metric``.

    Raises
    ------
    InputError
        If the file cannot be read, or a metric or an option is unknown.
    """
    path = Path(path)
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: must be a readable file, got: {error.strerror}.") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: must be valid TOML, got: {error}.") from error
    found: dict[str, Tolerance] = {}
    for key, value in tables.items():
        if key in (*CHANNELS, FLIGHT):
            for name, one in _table(path, key, value).items():
                _check_known(path, name, tuple(FLIGHT_UNITS if key == FLIGHT else METRICS), key)
                found[f"{key}.{name}"] = _tolerance(path, f"{key}.{name}", one)
        else:
            _check_known(path, key, (*WANTED, DISTANCE), "")
            found[key] = _tolerance(path, key, value)
    if not found:
        raise InputError(f"{path}: must hold a tolerance for at least one metric, got none.")
    return found


def violations(found: Comparison, tolerances: Mapping[str, Tolerance]) -> list[Violation]:
    """Every metric of a comparison that changed by more than its tolerance.

    Parameters
    ----------
    found : Comparison
    tolerances : mapping of str to Tolerance
        What `load_tolerances` returns; a metric without one is not looked at. A run that ended
        early where the first one was completed is out in any case.
    """
    out = []
    for row in found.metrics.to_dict(orient="records"):
        name, a, b = str(row["name"]), float(row["a"]), float(row["b"])
        limit = tolerances.get(f"{row['channel']}.{name}", tolerances.get(name))
        if limit is not None and not limit.allows(name, a, b):
            labels, allowed = (str(row["run_a"]), str(row["run_b"])), limit.room(a)
            out.append(Violation.of(labels, str(row["channel"]), name, (a, b), allowed))
    apart = tolerances.get(DISTANCE)
    for pair in found.pairs:
        labels = (pair.a.label, pair.b.label)
        if pair.status[0] == "completed" != pair.status[1]:
            out.append(Violation.of(labels, FLIGHT, DURATION, pair.durations, 0.0))
        if apart is not None and pair.max_distance > apart.absolute:
            values = 0.0, pair.max_distance
            out.append(Violation.of(labels, FLIGHT, DISTANCE, values, apart.absolute))
    return out


def _table(path: Path, key: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(
            f"{path}: `{key}` must be a table with one of {', '.join(OPTIONS)}, got {value!r}."
        )
    return value


def _tolerance(path: Path, key: str, value: Any) -> Tolerance:
    table = _table(path, key, value)
    for option, one in table.items():
        _check_known(path, option, OPTIONS, key)
        wanted = bool if option == "only_worse" else (int, float)
        if not isinstance(one, wanted) or (option != "only_worse" and isinstance(one, bool)):
            kind = "true or false" if option == "only_worse" else "a number"
            raise InputError(f"{path}: [{key}] `{option}` must be {kind}, got {one!r}.")
    if not {"absolute", "relative"} & table.keys():
        raise InputError(f"{path}: [{key}] must give `absolute` or `relative`, got {table}.")
    try:
        return Tolerance(**table)
    except InputError as error:
        raise InputError(f"{path}: [{key}] {error}") from error


def _check_known(path: Path, name: str, known: tuple[str, ...], table: str) -> None:
    if name in known:
        return
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f"did you mean `{close[0]}`?" if close else f"known are {', '.join(known)}."
    raise InputError(f"{path}: {f'[{table}] ' if table else ''}`{name}` is not known; {hint}")
