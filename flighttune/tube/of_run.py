"""The tube of a flight: found by its hash, or made, and put around the errors flown."""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.arrays import FloatArray
from flighttune.errors import FlightTuneError, InputError
from flighttune.present.numbers import degrees
from flighttune.scenario.load import scenario_from
from flighttune.simulate.run import TUBE_SIGNALS, WORST_SIGNALS, Run
from flighttune.tube.flight_hash import ABOUT, flight_sha256
from flighttune.whole_file import whole_file

if TYPE_CHECKING:
    from flighttune.conformance import Conformance
    from flighttune.tube.result import Tube

FOLDER = "tubes"
"""Where the tubes of the runs in a folder are."""

COUNTED_ONLY = "The model's set is lost, and the bounds are those counted"
"""Said of a tube whose bounds end as `within_counted` has them, before the reason."""

ABOUT_WORST = b"flighttune.worst"
"""Key in the metadata of the file of a worst flight: of which tube, and how near, as JSON."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunTube:
    """Bounds that hold for the errors of a run, and what they rest on.

    Attributes
    ----------
    t : ndarray, shape (k,), s
        To where the bounds last.
    bounds : ndarray, shape (k, 4), rad
        Of `TUBE_SIGNALS`.
    status, reason, model : str
        As of `Tube`.
    handed_over : float or None, s
        From when on they hold for ever.
    counted_from : float or None, s
        From when on they are those that flights were counted against.
    file : Path
    worst : WorstOfTube or None
        Where `flighttune worst` found one.
    """

    t: FloatArray
    bounds: FloatArray
    status: str
    reason: str
    model: str
    handed_over: float | None
    counted_from: float | None
    file: Path
    worst: "WorstOfTube | None" = None

    @property
    def half_widths(self) -> FloatArray:
        """Of course and flight-path-angle error, largest and at the end, shape (2, 2), rad."""
        widths = 0.5 * (self.bounds[:, 1::2] - self.bounds[:, ::2])
        return np.stack([one.max(axis=0, initial=0.0) for one in (widths, widths[-1:])], axis=1)

    def around(self, run: Run) -> Run:
        """The run with the bounds as signals; NaN where they do not last."""
        names, values = TUBE_SIGNALS, self.bounds
        signals = run.signals.assign(**_as_long(values, names, len(run.signals)))
        if self.worst is not None:
            signals = signals.assign(**_as_long(self.worst.errors, WORST_SIGNALS, len(signals)))
        return replace(run, signals=signals)


def _as_long(values: FloatArray, names: Sequence[str], samples: int) -> dict[str, FloatArray]:
    """Columns by name, as many samples long: cut, or with NaN at their end."""
    at = np.full((samples, len(names)), np.nan)
    n = min(samples, len(values))
    at[:n] = values[:n]
    return dict(zip(names, at.T, strict=True))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorstOfTube:
    """The flight found that comes nearest to leaving a tube.

    Attributes
    ----------
    errors : ndarray, shape (samples, 2), rad
        Of course and flight-path angle.
    ratio : mapping of str to float
        How many times wider the tube is than this flight needs, of ``chi`` and ``gamma``.
    """

    errors: FloatArray
    ratio: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunTubes:
    """Tubes of runs.

    Attributes
    ----------
    runs : tuple of Run
        With the bounds as signals where there are any.
    found : mapping of str to RunTube
        By label of the run.
    why_not : mapping of str to str
        Why there is none, of runs for which one was to be made.
    left : tuple of str
        Labels of runs that leave the tube made for them, which is not kept.
    """

    runs: tuple[Run, ...]
    found: Mapping[str, RunTube]
    why_not: Mapping[str, str]
    left: tuple[str, ...] = ()

    @property
    def at_a_glance(self) -> tuple[str, ...]:
        """How far each aircraft can be off and with which probability, a sentence each."""
        aircraft = [run.label for run in self.runs if run.provenance.aircraft is not None]
        return tuple(self._glance(label) for label in aircraft if label in self.found)

    def _glance(self, label: str) -> str:
        from flighttune.conformance.file import LEAVES  # not to be imported where there is no tube

        one = self.found[label]
        _, counted, chance = one.model.rpartition(LEAVES)
        share = f"; a flight leaves it with probability at most{chance}" if counted else ""
        # Where the bounds are those counted they hold all the same, and why is said below.
        lost = self._lost(label) if one.counted_from is None else ""
        return f"{self._width(label)}{share}.{lost}"

    def sentence(self, label: str) -> str:
        """What the tube of a run says."""
        one = self.found[label]
        return (
            f"{self._width(label)}.{self._lost(label)} It is for every flight of {one.model}. "
            f"{_nearest(one)}"
        )

    def _width(self, label: str) -> str:
        one = self.found[label]
        (chi, chi_end), (gamma, gamma_end) = ([degrees(w) for w in row] for row in one.half_widths)
        flown = "leaves it" if label in self.outside else "is inside"
        ever = "" if one.handed_over is None else f", from {one.handed_over:.1f} s on for ever"
        return (
            f"{label}: the tube is ±{chi} of course and ±{gamma} of path angle wide, "
            f"±{chi_end} and ±{gamma_end} at the end{ever}; the flight flown {flown}"
        )

    def _lost(self, label: str) -> str:
        one = self.found[label]
        lost = "It is lost" if one.counted_from is None else COUNTED_ONLY
        return f" {lost}: {one.reason}." if one.reason else ""

    @property
    def outside(self) -> tuple[str, ...]:
        """Labels of runs that leave their tube."""
        drawn = (run for run in self.runs if run.label in self.found)
        return (*self.left, *(run.label for run in drawn if leaves_tube(run)))


def _nearest(tube: RunTube) -> str:
    """What the worst flight found says of a tube, or how to find one."""
    if tube.worst is None:
        return (
            "The worst flight inside is not known yet: "
            f"flighttune worst SCENARIO|CAMPAIGN --tube {tube.file} searches it."
        )
    chi, gamma = tube.worst.ratio["chi"], tube.worst.ratio["gamma"]
    return f"It is {chi:.2g} and {gamma:.2g} times as wide as the worst flight found needs."


def leaves_tube(run: Run) -> bool:
    """Whether a run that has the bounds of its tube is outside at any sample."""
    names = [*TUBE_SIGNALS, "chi_err", "gamma_err"]
    chi_low, chi_high, gamma_low, gamma_high, chi, gamma = run.signals[names].to_numpy().T
    pairs = (chi < chi_low) | (chi > chi_high), (gamma < gamma_low) | (gamma > gamma_high)
    return bool(np.any(pairs))


def tubes_of(
    runs: Sequence[Run],
    folder: Path,
    *,
    make: bool = False,
    conformance: "Conformance | None" = None,
    progress: Callable[[str, float], None] | None = None,
) -> RunTubes:
    """The tubes of runs that are in a folder, and where asked those that are not.

    Parameters
    ----------
    runs : sequence of Run
    folder : Path
        Its subfolder `FOLDER` is read, and written to.
    make : bool
        Make what is not there.
    conformance : Conformance, optional
        For runs of its aircraft with its gains.
    progress : callable, optional
        Called with the label of the run and the part done.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    known = dict(_known(folder / FOLDER))
    found: dict[str, RunTube] = {}
    why_not: dict[str, str] = {}
    left: list[str] = []
    for run in runs:
        if len(run.signals) < 2:
            continue
        sha256 = run_sha256(run)
        if sha256 not in known and make:
            try:
                made = _tube(run, conformance, progress)
            except FlightTuneError as error:
                why_not[run.label] = str(error)
                continue
            if not made.contains(run.signals):
                # A tube that its own flight leaves is wrong: nobody is to find it here later.
                why_not[run.label] = "the flight leaves the tube made for it, which is not kept"
                left.append(run.label)
                continue
            from flighttune.tube.signals import write_signals

            path = folder / FOLDER / f"{sha256[:16]}.parquet"
            write_signals(made, path)
            known[sha256] = path
        if sha256 in known:
            found[run.label] = read_tube(known[sha256])
    drawn = [found[run.label].around(run) if run.label in found else run for run in runs]
    return RunTubes(runs=tuple(drawn), found=found, why_not=why_not, left=tuple(left))


def _tube(
    run: Run,
    conformance: "Conformance | None",
    progress: Callable[[str, float], None] | None,
) -> "Tube":
    from flighttune.tube.tube import tube

    scenario, gains = scenario_from(dict(run.provenance.scenario)), run.provenance.gains
    if gains is None:
        raise InputError("a law of one's own has no tube.")
    aircraft = run.provenance.aircraft is not None
    return tube(
        scenario,
        gains,
        plant=run.provenance.plant,
        conformance=conformance if aircraft else None,
        law=run.provenance.gains_name.rpartition(":")[0] or "exact",
        progress=progress and (lambda part: progress(f"tube {run.label}", part)),
    )


def _known(folder: Path) -> Iterator[tuple[str, Path]]:
    for path in sorted(folder.glob("*.parquet")):
        try:
            yield about_tube(path)["run"], path
        except InputError:
            continue


def run_sha256(run: Run) -> str:
    """Hash of what the tube of a run depends on: manoeuvre, limits, controller, plant and gains."""
    made = run.provenance
    return flight_sha256(made.scenario, made.plant, made.gains)


def about_tube(path: Path) -> dict[str, Any]:
    """What stands in the file of a tube beside its bounds.

    Raises
    ------
    InputError
        If it is no such file.
    """
    try:
        return json.loads(pq.read_schema(path).metadata[ABOUT])
    except (OSError, TypeError, KeyError, ValueError, pa.ArrowException) as error:
        raise InputError(f"{path}: must hold a tube, got none.") from error


def read_tube(path: Path) -> RunTube:
    """The bounds in the file of a tube.

    Raises
    ------
    InputError
        If it is no such file.
    """
    stated = about_tube(path)
    table = pq.read_table(path, columns=["t", *TUBE_SIGNALS])
    return RunTube(
        t=table["t"].to_numpy(),
        bounds=np.column_stack([table[name].to_numpy() for name in TUBE_SIGNALS]),
        status=stated["status"],
        reason=stated["reason"],
        model=stated["model"],
        handed_over=stated["handed_over_s"],
        counted_from=stated["counted_from_s"],
        file=path,
        worst=_read_worst(path),
    )


def write_worst(tube: Path, run: Run, ratio: Mapping[str, float]) -> Path:
    """Write the errors of the worst flight found next to the file of its tube.

    Parameters
    ----------
    tube : Path
    run : Run
        The flight.
    ratio : mapping of str to float
        As of `WorstOfTube`.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    path = _worst_file(tube)
    columns = {"t": run.t, **{name: run.signals[name[: -len("_worst")]] for name in WORST_SIGNALS}}
    about = {"tube": _sha256(tube), "ratio": dict(ratio)}
    with whole_file(path) as part:
        table = pa.table(columns).replace_schema_metadata({ABOUT_WORST: json.dumps(about).encode()})
        pq.write_table(table, part, compression="zstd")
    return path


def _worst_file(tube: Path) -> Path:
    return tube.with_name(f"{tube.stem}-worst.parquet")


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _read_worst(tube: Path) -> WorstOfTube | None:
    """The worst flight of a tube; None where none is known of these very bounds."""
    try:
        table = pq.read_table(_worst_file(tube))
        about = json.loads(table.schema.metadata[ABOUT_WORST])
        if about["tube"] != _sha256(tube):
            return None
        errors = np.column_stack([table[name].to_numpy() for name in WORST_SIGNALS])
    except (OSError, TypeError, KeyError, ValueError, pa.ArrowException):
        return None
    return WorstOfTube(errors=errors, ratio=about["ratio"])
