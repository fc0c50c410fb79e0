"""The tube of a flight: found by its hash, or made, and put around the errors flown."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from flighttune.arrays import FloatArray
from flighttune.errors import FlightTuneError, InputError
from flighttune.present.numbers import degrees, number
from flighttune.scenario.load import scenario_from
from flighttune.seal import seal_of
from flighttune.simulate.run import TUBE_SIGNALS, WORST_SIGNALS, Run
from flighttune.tube.flight_hash import flight_sha256
from flighttune.tube.sealed import AboutTube, AboutWorst, read_sealed, write_sealed

if TYPE_CHECKING:
    from flighttune.conformance import Conformance
    from flighttune.tube.result import Tube

FOLDER = "tubes"
"""Subfolder with the tubes of the runs in a folder."""

COUNTED_ONLY = "The model's set is lost, and the bounds are those counted"
"""Said of a tube whose bounds end as `within_counted` has them, before the reason."""

WORST = "-worst"
"""At the end of the name of the file of the worst flight found in a tube."""

EARLIER = "computed earlier and not proven again here"
"""Said of a tube that is read from its file."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunTube:
    """Bounds that hold for the errors of a run, and what they rest on."""

    t: FloatArray  # (k,), s: to where the bounds last
    bounds: FloatArray  # (k, 4), rad: columns are `TUBE_SIGNALS`
    about: AboutTube
    file: Path
    computed: bool = False  # in this call; False for a tube read from its file
    worst: "WorstOfTube | None" = None  # None unless `flighttune worst` was run

    @property
    def half_widths(self) -> FloatArray:
        """Half widths of course and path-angle error, largest and at the end, shape (2, 2), rad."""
        widths = 0.5 * (self.bounds[:, 1::2] - self.bounds[:, ::2])
        return np.stack(
            [values.max(axis=0, initial=0.0) for values in (widths, widths[-1:])], axis=1
        )

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
    """The flight found that comes nearest to leaving a tube."""

    errors: FloatArray  # (samples, 2), rad: course and flight-path angle
    about: AboutWorst


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunTubes:
    """Tubes of runs."""

    runs: tuple[Run, ...]  # a run that has a tube has its bounds as signals
    found: Mapping[str, RunTube]  # by label of the run
    why_not: Mapping[str, str]  # why there is none, of runs for which one was to be made
    # Labels of runs that leave the tube made for them, which is not kept
    left: tuple[str, ...] = ()

    @property
    def at_a_glance(self) -> tuple[str, ...]:
        """Largest error of each aircraft and its probability, a sentence each."""
        aircraft = [run.label for run in self.runs if run.provenance.aircraft is not None]
        return tuple(self._glance(label) for label in aircraft if label in self.found)

    def _glance(self, label: str) -> str:
        about = self.found[label].about
        # Where the bounds are those counted they hold all the same, and why is said below.
        lost = self._lost(label) if about.counted_from_s is None else ""
        return f"{self._width(label)}{_probability(about)}.{lost}"

    def sentence(self, label: str) -> str:
        """The statement of a run's tube in words."""
        tube = self.found[label]
        about = tube.about
        # Bounds that were counted hold for flights of the distribution, not for all of the model.
        holds = "It is for every flight of" if about.counted_from_s is None else "It rests on"
        return (
            f"{self._width(label)}{_probability(about)}.{self._lost(label)} {holds} {about.model}. "
            f"{_nearest(tube)}"
        )

    def _width(self, label: str) -> str:
        tube = self.found[label]
        about = tube.about
        (chi, chi_end), (gamma, gamma_end) = ([degrees(w) for w in row] for row in tube.half_widths)
        starts = f" from every start within {number(about.start_deg)}°" if about.start_deg else ""
        origin = "" if tube.computed else f" ({EARLIER})"
        flown = "leaves it" if label in self.outside else "is inside"
        handed = about.handed_over_s
        ever = "" if handed is None else f", from {handed:.1f} s on for ever"
        return (
            f"{label}: the tube{starts}{origin} is ±{chi} of course and ±{gamma} of path angle "
            f"wide, ±{chi_end} and ±{gamma_end} at the end{ever}; the flight flown {flown}"
        )

    def _lost(self, label: str) -> str:
        about = self.found[label].about
        lost = "It is lost" if about.counted_from_s is None else COUNTED_ONLY
        return f" {lost}: {about.reason}." if about.reason else ""

    @property
    def outside(self) -> tuple[str, ...]:
        """Labels of runs that leave their tube."""
        drawn = (run for run in self.runs if run.label in self.found)
        return (*self.left, *(run.label for run in drawn if leaves_tube(run)))


def _probability(about: AboutTube) -> str:
    return f"; {about.probability.sentence}" if about.probability else ""


def _nearest(tube: RunTube) -> str:
    """Comparison of a tube with the worst flight inside, or the way to get it."""
    if tube.worst is None:
        return (
            "The worst flight inside is not known yet: "
            f"flighttune worst SCENARIO|CAMPAIGN --tube {tube.file} searches it."
        )
    chi, gamma = tube.worst.about.chi, tube.worst.about.gamma
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

    `folder`: its subfolder `FOLDER` is read and written. `make`: compute missing tubes.
    `conformance`: boxes for runs of its aircraft with its gains. `progress`: called with the label
    of the run and the part done. Raises OutputError if a file cannot be written.
    """
    files, why_not = _tube_files(folder / FOLDER)
    tubes: dict[str, RunTube] = {}
    left: list[str] = []
    for run in runs:
        if len(run.signals) < 2:
            continue
        sha256, computed = run_sha256(run), False
        if sha256 not in files and make:
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
            why_not.pop(str(path), None)  # a damaged file is replaced
            files[sha256], computed = path, True
        if sha256 in files:
            path = files[sha256]
            try:
                tubes[run.label] = replace(read_tube(path, run), computed=computed)
            except InputError as error:
                why_not[run.label] = str(error)
    drawn = [tubes[run.label].around(run) if run.label in tubes else run for run in runs]
    return RunTubes(runs=tuple(drawn), found=tubes, why_not=why_not, left=tuple(left))


def _tube(
    run: Run,
    conformance: "Conformance | None",
    progress: Callable[[str, float], None] | None,
) -> "Tube":
    from flighttune.tube.tube import tube

    scenario, gains = scenario_from(dict(run.provenance.scenario)), run.provenance.gains
    if gains is None:
        raise InputError("a law of one's own has no tube.")
    plant = scenario.plant_table(run.provenance.plant)
    counts = None if plant.aircraft is None else conformance
    # Where only the starts were drawn, the tube begins with all of them: it then holds the flights
    # counted, and not only the flight from the scenario's own start.
    start = None if counts is None else counts.distribution.start_range(scenario, plant)
    return tube(
        scenario,
        gains,
        plant=plant.label,
        start=start or 0.0,
        conformance=counts,
        law=run.provenance.law,
        progress=None if progress is None else lambda part: progress(f"tube {run.label}", part),
    )


def _tube_files(folder: Path) -> tuple[dict[str, Path], dict[str, str]]:
    """The tubes in a folder by the hash of their flight, and why the others are not read."""
    files, refused = {}, {}
    for path in sorted(folder.glob("[!.]*.parquet")):
        if path.stem.endswith(WORST):
            continue
        try:
            files[read_sealed(path, AboutTube, TUBE_SIGNALS)[0].run] = path
        except InputError as error:
            refused[str(path)] = str(error).removeprefix(f"{path}: ")
    return files, refused


def run_sha256(run: Run) -> str:
    """Hash of what the tube of a run depends on: manoeuvre, limits, controller, plant and gains."""
    made = run.provenance
    return flight_sha256(made.scenario, made.plant, made.gains)


def read_tube(path: Path, run: Run) -> RunTube:
    """The bounds in the file of the tube of a run.

    Raises InputError if it is no such file, not as it was written, or its bounds are not those of
    the samples.
    """
    from flighttune.tube.problem import sample_times

    about, t, bounds = read_sealed(path, AboutTube, TUBE_SIGNALS)
    samples = sample_times(scenario_from(dict(run.provenance.scenario)))
    # One that is lost ends early.
    least = len(samples) if about.status == "bounded" else 1
    if not (least <= len(t) <= len(samples) and np.allclose(t, samples[: len(t)], atol=1e-9)):
        raise InputError(
            f"{path}: `t` must be the {len(samples)} samples of the flight, got {len(t)} rows"
            + (f": {about.reason}." if about.reason else ".")
        )
    if not (bounds[:, ::2] <= bounds[:, 1::2]).all():
        raise InputError(f"{path}: lower bounds must not be above upper ones.")
    return RunTube(t=t, bounds=bounds, about=about, file=path, worst=_read_worst(path))


def write_worst(tube: Path, run: Run, ratio: Mapping[str, float]) -> Path:
    """Write the errors of the worst flight found next to the file of its tube; return the file.

    `ratio` says how many times wider the tube is than this flight needs, of ``chi`` and ``gamma``.
    """
    path = _worst_file(tube)
    columns = {"t": run.t, **{name: run.signals[name[: -len("_worst")]] for name in WORST_SIGNALS}}
    about = AboutWorst(tube=seal_of(tube.read_bytes()), chi=ratio["chi"], gamma=ratio["gamma"])
    write_sealed(pa.table(columns), about, path)
    return path


def _worst_file(tube: Path) -> Path:
    return tube.with_name(f"{tube.stem}{WORST}.parquet")


def _read_worst(tube: Path) -> WorstOfTube | None:
    """The worst flight of a tube; None where none is known of these very bounds."""
    path = _worst_file(tube)
    if not path.exists():
        return None
    about, _, errors = read_sealed(path, AboutWorst, WORST_SIGNALS)
    if about.tube != seal_of(tube.read_bytes()):
        return None
    return WorstOfTube(errors=errors, about=about)
