"""Tubes of recorded flights: Parquet files named by a hash of their flight, found or made."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import TypeAdapter, ValidationError

from flighttune.arrays import FloatArray
from flighttune.conformance.file import CountedProbability
from flighttune.control.gains import PIGains
from flighttune.errors import FlightTuneError, InputError
from flighttune.guarantee.bounds import Bounds, cut_to, with_columns
from flighttune.mistakes import mistakes
from flighttune.scenario.load import scenario_from
from flighttune.seal import BLANK, seal, sealed_bytes
from flighttune.simulate.run import WORST_SIGNALS, Run
from flighttune.table_file import hash_of
from flighttune.value_file import STRICT
from flighttune.whole_file import whole_file

if TYPE_CHECKING:
    from flighttune.conformance.file import Conformance
    from flighttune.tube.problem import Tube

# Subfolder with the tubes of the runs in a folder
FOLDER = "tubes"

# Tables of a scenario that a tube does not depend on
NOT_OF_FLIGHT = ("title", "verifies", "source", "seed", "gains", "expect", "tuning", "envelope")

# Keys of the metadata, in the order of the file: its description as JSON, and its SHA-256
ABOUT, SEAL = b"flighttune.tube", b"flighttune.file"

KIND, REMEDY = "Parquet file of a tube", "delete it and make it again with --tube"

# Units of columns; all others are in rad
UNITS = {"t": "s", "n_z_cmd_low": "1", "n_z_cmd_high": "1"}


@dataclass(frozen=True, slots=True, kw_only=True)
class AboutTube:
    """Description in the file of a tube, beside its bounds."""

    __pydantic_config__ = STRICT

    run: str  # `flight_sha256` of its flight
    status: Literal["bounded", "unbounded"]
    reason: str
    model: str
    start_deg: float  # flights start within this of the scenario's course and path angle
    handed_over_s: float | None
    probability: CountedProbability | None
    # Width of the tube over the width that the worst flight found in it needs, for ``chi`` and
    # ``gamma``; its errors are in the columns `WORST_SIGNALS`. None unless one was searched.
    worst: dict[str, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunTube:
    """The tube of a run."""

    bounds: Bounds  # on the errors, for as long as the tube lasts
    about: AboutTube
    file: Path
    computed: bool  # whether this call computed it; a tube that is read is not proven again
    inside: bool  # whether the run stays inside

    @property
    def half_widths(self) -> dict[str, dict[str, float]]:
        """Largest and last half width of course and path-angle error, rad."""
        widths = self.bounds.half_widths
        return {
            channel: {"max": float(column.max()), "end": float(column[-1])}
            for channel, column in zip(("chi", "gamma"), widths.T, strict=True)
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunTubes:
    """Runs, and the tubes that were found or computed for them."""

    runs: tuple[Run, ...]  # a run that has a tube has its bounds as signals
    tubes: Mapping[str, RunTube]  # by label of the run
    why_not: Mapping[str, str]  # reasons, by label of a run without a tube or path of a bad file
    outside: tuple[str, ...]  # labels of runs that leave their tube

    @property
    def at_a_glance(self) -> tuple[str, ...]:
        """Probability counted for the tube of each aircraft, a sentence each."""
        counted = {label: tube.about.probability for label, tube in self.tubes.items()}
        return tuple(f"{label}: {chance.sentence}." for label, chance in counted.items() if chance)


def tubes_of(
    runs: Sequence[Run],
    folder: Path,
    *,
    make: bool = False,
    conformance: "Conformance | None" = None,
    progress: Callable[[str, float], None] | None = None,
) -> RunTubes:
    """The tubes of runs found in a folder; missing ones are computed if asked for.

    `folder`: its subfolder `FOLDER` is read and written. `make`: compute missing tubes.
    `conformance`: boxes for runs of its aircraft with its gains. `progress`: called with the label
    of the run and the part done. Raises OutputError if a file cannot be written.
    """
    files, why_not = _tube_files(folder / FOLDER)
    tubes: dict[str, RunTube] = {}
    outside: list[str] = []
    drawn: list[Run] = []
    for run in runs:
        drawn.append(run)
        sha256 = run_sha256(run)
        computed = make and sha256 not in files
        if len(run.signals) < 2 or not (computed or sha256 in files):
            continue
        try:
            if computed:
                made = _tube(run, conformance, progress)
                if not made.bounds.contain(run.signals):
                    # A tube that its own flight leaves is wrong: no later command may read it.
                    outside.append(run.label)
                    raise InputError("the flight leaves the tube made for it, which is not kept")
                files[sha256] = folder / FOLDER / f"{sha256[:16]}.parquet"
                write_signals(made, files[sha256])
                why_not.pop(str(files[sha256]), None)  # a damaged file is replaced
            tube, drawn[-1] = _read_tube(files[sha256], run, computed=computed)
        except FlightTuneError as error:
            why_not[run.label] = str(error)
            continue
        tubes[run.label] = tube
        if not tube.inside:
            outside.append(run.label)
    return RunTubes(runs=tuple(drawn), tubes=tubes, why_not=why_not, outside=tuple(outside))


def _tube(
    run: Run, conformance: "Conformance | None", progress: Callable[[str, float], None] | None
) -> "Tube":
    from flighttune.tube.problem import tube_problem
    from flighttune.tube.tube import tube_of

    scenario, gains = scenario_from(dict(run.provenance.scenario)), run.provenance.gains
    if gains is None:
        raise InputError("there is no tube for a law of your own.")
    plant = scenario.plant_table(run.provenance.plant)
    counts = None if plant.aircraft is None else conformance
    # Where only the starts were drawn, the tube begins with all of them: it then holds the flights
    # counted, and not only the flight from the scenario's own start.
    start = None if counts is None else counts.distribution.start_range(scenario, plant)
    problem = tube_problem(
        scenario,
        gains,
        plant=plant.label,
        start=start or 0.0,
        conformance=counts,
        law=run.provenance.law,
    )
    follow = None if progress is None else partial(progress, f"tube {run.label}")
    return tube_of(problem, progress=follow)


def flight_sha256(scenario: Mapping[str, Any], plant: str, gains: PIGains | None) -> str:
    """Hash of everything that the tube of a flight depends on."""
    flown = {key: value for key, value in scenario.items() if key not in NOT_OF_FLIGHT}
    return hash_of({**flown, "label": plant, "gains": None if gains is None else gains.as_lists()})


def run_sha256(run: Run) -> str:
    """Hash of what a run's tube depends on: manoeuvre, limits, controller, plant and gains."""
    made = run.provenance
    return flight_sha256(made.scenario, made.plant, made.gains)


def _tube_files(folder: Path) -> tuple[dict[str, Path], dict[str, str]]:
    """Files of tubes by the hash of their flight, and why the other files are not read."""
    files, refused = {}, {}
    for path in sorted(folder.glob("[!.]*.parquet")):
        if path.stem.endswith("-worst"):  # an earlier version wrote the worst flight on its own
            continue
        try:
            files[read_sealed(path)[0].run] = path
        except InputError as error:
            refused[str(path)] = str(error).removeprefix(f"{path}: ")
    return files, refused


def read_bounds(path: str | Path) -> Bounds:
    """Read the bounds on the errors from the file of a tube; InputError as `read_sealed`."""
    return Bounds.of(read_sealed(Path(path))[1])


def _read_tube(path: Path, run: Run, *, computed: bool) -> tuple[RunTube, Run]:
    """The tube of a run from its file, and the run with its bounds and its worst flight."""
    from flighttune.tube.problem import sample_times

    about, columns = read_sealed(path)
    bounds = Bounds.of(columns)
    t, samples = bounds.t, sample_times(scenario_from(dict(run.provenance.scenario)))
    # The bounds of a tube that was lost end early.
    least = len(samples) if about.status == "bounded" else 1
    if not (least <= len(t) <= len(samples) and np.allclose(t, samples[: len(t)], 0.0, 1e-9)):
        raise InputError(
            f"{path}: `t` must be the {len(samples)} samples of the flight, got {len(t)} rows"
            + (f": {about.reason}." if about.reason else ".")
        )
    inside, drawn = bounds.contain(run.signals), bounds.around(run)
    if about.worst is not None:
        drawn = with_columns(drawn, {name: columns[name] for name in WORST_SIGNALS})
    return RunTube(bounds=bounds, about=about, file=path, computed=computed, inside=inside), drawn


def write_signals(tube: "Tube", path: Path) -> None:
    """Write the bounds: ``t`` in s, and every quantity with ``_low`` and ``_high``.

    The metadata hold the hash of the flight, by which `tubes_of` finds its tube. Raises OutputError
    if the file cannot be written.
    """
    problem = tube.problem
    about = AboutTube(
        run=flight_sha256(problem.scenario.as_dict(), problem.plant, problem.gains),
        status=tube.status,
        reason=tube.reason,
        model=problem.model,
        start_deg=math.degrees(problem.start),
        handed_over_s=tube.handed_over,
        probability=tube.probability,
    )
    write_sealed(tube.bounds.columns, about, path)


def write_worst(path: Path, run: Run, ratio: dict[str, float]) -> None:
    """Add the errors of the worst flight found to the file of a tube, as far as the tube lasts.

    `ratio`: width of the tube over the width that this flight needs, for ``chi`` and ``gamma``.
    """
    about, columns = read_sealed(path)
    errors = {name: run.signals[name.removesuffix("_worst")].to_numpy() for name in WORST_SIGNALS}
    lasting = {name: cut_to(len(columns["t"]), values) for name, values in errors.items()}
    write_sealed(columns | lasting, replace(about, worst=ratio), path)


def write_sealed(columns: Mapping[str, FloatArray], about: AboutTube, path: Path) -> None:
    """Write signals over time with their description; the file is written whole or not at all."""
    fields = [
        pa.field(name, pa.float64(), metadata={"unit": UNITS.get(name, "rad")}) for name in columns
    ]
    metadata = {ABOUT: json.dumps(asdict(about)).encode(), SEAL: BLANK}
    table = pa.table(list(columns.values()), schema=pa.schema(fields, metadata=metadata))
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    data = seal(sink.getvalue().to_pybytes())
    with whole_file(path) as part:
        part.write_bytes(data)


def read_sealed(path: Path) -> tuple[AboutTube, dict[str, FloatArray]]:
    """Read a file of `write_sealed`: its description and its signals.

    Raises InputError if the file is of another kind or is not as it was written, if time does not
    rise, or if a bound is not finite or above the upper one.
    """
    data = sealed_bytes(path, KIND, REMEDY)
    try:
        table = pq.read_table(pa.BufferReader(data))
        stated = table.schema.metadata[ABOUT]
        described = json.loads(stated)
        columns = {name: table[name].to_numpy().astype(float) for name in table.column_names}
        t, bounds = columns["t"], Bounds.of(columns)
    except (pa.ArrowException, OSError, KeyError, TypeError, ValueError) as error:
        got = " ".join(str(error).split())
        raise InputError(f"{path}: must be a {KIND}, got: {got}.") from error
    try:
        about = TypeAdapter(AboutTube).validate_json(stated)
    except ValidationError as error:
        raise InputError(f"{path}: {mistakes(error, described)} To mend it, {REMEDY}.") from error
    if not (len(t) and np.isfinite(bounds.pairs).all() and (np.diff(t) > 0.0).all()):
        raise InputError(f"{path}: `t` must rise and every bound must be finite; {REMEDY}.")
    if about.worst is not None and not columns.keys() >= {*WORST_SIGNALS}:
        raise InputError(f"{path}: `worst` must come with {' and '.join(WORST_SIGNALS)}; {REMEDY}.")
    if not (bounds.low <= bounds.high).all():
        raise InputError(f"{path}: lower bounds must not be above upper ones.")
    return about, columns
