"""The gap between the paper's law and an aircraft, as a value with its tables and sentences."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import InnerLag
from flighttune.flight.flown import FlownScenario
from flighttune.gaps.residual import Mismatch
from flighttune.identification.file import lag_table
from flighttune.present.answer import Answer, Answering, Column, Table, pick
from flighttune.present.names import CHANNEL_NAMES, CHANNEL_SYMBOLS, columns
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Claim, Run, claimed, with_claims
from flighttune.theory.indicators import Indicators
from flighttune.units import DEG_PER_RAD

# If the course reference moves by more between two samples, it may itself wrap the error.
REFERENCE_STEP = math.radians(5.0)

LagSource = Literal["identified", "fitted"]

# Metrics of the tables; ``--json`` has them all.
METRICS = [
    f"metrics.{channel}.{key}"
    for key in ("ITAE", "MO_rad", "ST_rad", "saturation_s")
    for channel in CHANNEL_SYMBOLS
]


RUNG_COLUMNS = columns(" ".join(["plant", "status", *METRICS]))
STEP_COLUMNS = [
    *columns("gains"),
    Column("adds", "upper minus lower plant"),
    *(replace(column, digits="+.2f") for column in columns(" ".join(METRICS))),
]
AIRSPEED_COLUMNS = columns(
    "plant metrics.V.ITAE metrics.V.MO_mps metrics.V.settling_s metrics.V.ST_mps metrics.V.min_mps"
)
LAG_COLUMNS = columns("channel order natural_frequency_rad_s delay_s fit_percent")
MISMATCH_TITLE = "mismatch d: rates flown minus the law's"
MISMATCH_COLUMNS = [Column("bound", "largest |d|", "rad/s"), *columns("L_d")]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """One step of the ladder: from a plant to the next one up."""

    # Labels of the two plants
    lower: str
    upper: str
    adds: str  # Effect that only the upper plant models
    # (n,), rad: Upper minus lower at every sample
    chi: FloatArray
    gamma: FloatArray
    # Upper minus lower; index ``chi``, ``gamma`` and columns as `channel_metrics`. NaN if one of
    # the two failed; see `Gap.failed`.
    metrics: pd.DataFrame
    flight: pd.Series  # Upper minus lower of `flight_metrics` that both have; NaN as in `metrics`

    @property
    def values(self) -> dict[str, Any]:
        """The step as ``--json`` has it."""
        return {
            "from": self.lower,
            "to": self.upper,
            "adds": self.adds,
            "metrics": {**self.metrics.to_dict(orient="index"), "flight": self.flight.to_dict()},
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gap(Answering):
    """The difference between the paper's law and the aircraft, split into its causes.

    Attributes
    ----------
    scenario : Scenario
    runs : tuple of Run
        The rungs with the same controller and limits: paper's law, exact point mass, point mass
        behind the inner loop, and the aircraft with its mismatch as signals. They are cut to the
        time that all of them flew, each with the status it ended with. The aircraft alone where it
        did not fly.
    indicators : Indicators
        Indicators of the kinematic law's loop about wings-level flight on the first reference.
    steps : tuple of Step
        Three steps, from each rung to the next; none where the aircraft did not fly.
    whole : Step or None
        From the first rung to the last.
    lags : mapping of str to (InnerLag, float)
        Lags of roll (``phi``) and load factor (``n_z``) of the third rung, with the share of the
        flight's variance that each explains.
    lag_source : "identified", "fitted" or None
        Source of the lags: the aircraft's model file, or this flight.
    mismatch : Mismatch or None
        Mismatch of the aircraft against the paper's law.
    unplanned : Run or None
        The aircraft once more without roll and lift planned, where the reference rolls in.

    Examples
    --------
    >>> found = ft.gap("paper", ft.PAPER_GAINS)
    >>> found.status, [run.provenance.plant for run in found.runs]
    ('explained', ['kinematic', 'point_mass', 'point_mass_lag', 'jsbsim:aerosonde'])
    """

    scenario: Scenario
    runs: tuple[Run, ...]
    indicators: Indicators
    steps: tuple[Step, ...] = ()
    whole: Step | None = None
    lags: Mapping[str, tuple[InnerLag, float]] = field(default_factory=dict)
    lag_source: LagSource | None = None
    mismatch: Mismatch | None = None
    unplanned: Run | None = None

    @property
    def status(self) -> Literal["explained", "cut_short", "not_flown"]:
        """Whether all rungs flew to the end; otherwise results are about the time they all flew."""
        if not self.steps:
            return "not_flown"
        return "cut_short" if self.reason else "explained"

    @property
    def reason(self) -> str:
        """Why the status is not ``explained``; else empty."""
        if not self.steps:
            return f"{self.aircraft.label}: {self.aircraft.status}: {self.aircraft.reason}"
        early = next((run for run in self.runs if run.reason), None)
        return f"{early.label}: {early.reason}" if early else ""

    @property
    def aircraft(self) -> Run:
        """The top rung."""
        return self.runs[-1]

    @property
    def name(self) -> str:
        """Name of the gains, with that of the plant in brackets if the scenario names it."""
        made_by = self.aircraft.provenance
        plant = self.scenario.plant_table(made_by.plant).name
        return f"{made_by.gains_name} ({plant})" if plant else made_by.gains_name

    @property
    def failed(self) -> dict[str, str]:
        """Why a rung has no metrics, by plant, lowest first; empty if all were completed."""
        return {run.provenance.plant: why for run in self.runs if (why := failure_of(run))}

    @property
    def residual(self) -> float:
        """Largest difference between the sum of the steps and the whole; should be rounding."""
        parts = []
        for name in ("chi", "gamma", "metrics", "flight"):
            steps = [np.asarray(getattr(step, name), dtype=float) for step in self.steps]
            parts.append(np.ravel(sum(steps) - np.asarray(getattr(self.whole, name), dtype=float)))
        return float(np.nanmax(np.abs(np.concatenate(parts))))

    def cause(self, channel: str) -> tuple[str, float] | None:
        """The step that changes the ITAE of a channel most, and by how much; None without ITAE."""
        changes = [(step.adds, float(step.metrics.loc[channel, "ITAE"])) for step in self.steps]
        valid = all(math.isfinite(change) for _, change in changes) and changes
        return max(changes, key=lambda change: abs(change[1])) if valid else None

    def flown(self) -> FlownScenario:
        """The rungs as a flown scenario, to be recorded like any other."""
        names = {run.provenance.gains_name for run in self.runs}
        return FlownScenario(
            self.scenario, self.runs, MappingProxyType(dict.fromkeys(names, self.indicators))
        )

    def within(self, *claims: Claim) -> "Gap":
        """The gap with what is claimed of the aircraft's flight; an InputError says why not."""
        return replace(self, runs=(*self.runs[:-1], *with_claims(self.runs[-1:], claims)))

    def answer(self, signals: Mapping[str, Path] | None = None) -> Answer:
        """The steps and the inner loop; a failure unless all rungs flew to the end."""
        ladder, lags = self.flown().records(signals or {}), self._lags
        inner_loop = {"source": self.lag_source} | lags if lags else None
        mismatch = self.mismatch and pick(self.mismatch, "L_d bound")
        failed = "; ".join(f"{plant} {reason}" for plant, reason in self.failed.items())
        early = "" if self.status == "explained" else f"{self.scenario.title}: {self.reason}"
        hidden = failed and self.steps
        notes = [f"No metrics of, from or to a rung that failed: {failed}"] if hidden else []
        rows, around = [{"channel": name, **lag} for name, lag in lags.items()], claimed(self.runs)
        tables = [
            Table(RUNG_COLUMNS, ladder, "plants, from the law to the aircraft"),
            Table(AIRSPEED_COLUMNS, ladder if self.scenario.airspeed else [], "airspeed"),
            step_table([self]),
            Table(LAG_COLUMNS, rows, f"inner loop ({self.lag_source})"),
            Table(MISMATCH_COLUMNS, list(filter(None, [mismatch])), MISMATCH_TITLE),
        ]
        return Answer(
            values={
                **pick(self, "status reason"),
                "gains": self.aircraft.provenance.gains_name,
                "ladder": ladder,
                "inner_loop": inner_loop,
                "contributions": [step.values for step in self.steps],
                "whole": None if self.whole is None else self.whole.values,
                "largest_residual": self.residual if self.steps else None,
                "cause": {
                    channel: {"adds": cause[0], "ITAE": cause[1]}
                    for channel in CHANNEL_SYMBOLS
                    if (cause := self.cause(channel))
                },
                "mismatch": mismatch,
                "planning": self._largest,
                **around.values,
            },
            tables=tables if self.steps else [],
            notes=[*self.scenario.notes, *notes, *self.causes, *self._planning, *around.notes],
            failure=around.failure or early,
        )

    @property
    def _lags(self) -> dict[str, dict[str, Any]]:
        """Lags of the third rung with their fits, by channel."""
        return {
            name: {**lag_table(lag), "fit_percent": fit_percent}
            for name, (lag, fit_percent) in self.lags.items()
        }

    @property
    def _largest(self) -> dict[str, dict[str, float]] | None:
        """Largest errors (rad) with roll and lift planned and without, by channel."""
        if self.unplanned is None:
            return None
        return {
            channel: {
                word: float(run.signals[f"{channel}_err"].abs().max())
                for word, run in (("planned", self.aircraft), ("unplanned", self.unplanned))
            }
            for channel in CHANNEL_SYMBOLS
        }

    @property
    def _planning(self) -> list[str]:
        """A sentence on what planning takes away; none where nothing is planned."""
        errors = " and that of ".join(
            f"{CHANNEL_NAMES[channel]} from {largest['unplanned'] * DEG_PER_RAD:.3g} to "
            f"{largest['planned'] * DEG_PER_RAD:.3g} deg"
            for channel, largest in (self._largest or {}).items()
        )
        return [f"Planning roll and lift takes the largest error of {errors}."] if errors else []

    @property
    def causes(self) -> tuple[str, ...]:
        """A sentence for each channel: its ITAE from law to aircraft, and the largest step."""
        itae, sentences = self.flown().metrics["ITAE"], []
        for channel, name in CHANNEL_NAMES.items():
            if (cause := self.cause(channel)) is None:
                continue
            first, aircraft = (itae[run.label, channel] for run in (self.runs[0], self.aircraft))
            plant = self.runs[0].provenance.plant
            sentences.append(
                f"{name.capitalize()} with {self.name}: ITAE is {first:.2f} rad s² on {plant} and "
                f"{aircraft:.2f} on the aircraft; the largest step is {cause[1]:+.2f} ({cause[0]})."
            )
        return tuple(sentences)


def step_table(gaps: Sequence[Gap]) -> Table:
    """The difference that each step from the paper's law to the aircraft adds, and the total."""
    records = [
        {"gains": gap.name, **step.values}
        for gap in gaps
        if gap.whole is not None
        for step in (*gap.steps, gap.whole)
    ]
    layout = STEP_COLUMNS if len(gaps) > 1 else STEP_COLUMNS[1:]
    return Table(title="steps", columns=layout, records=records)


def failure_of(run: Run) -> str:
    """Why the metrics of a run are meaningless; empty if they are valid."""
    if run.status != "completed":
        return f"ended early ({run.status.replace('_', ' ')})"
    jumps, moved = (
        np.abs(np.diff(run.signals[f"chi_{part}"].to_numpy())) for part in ("err", "ref")
    )
    # The flight went around: its overshoot is an artefact of the wrapping.
    wrapped = (jumps > math.pi) & (moved < REFERENCE_STEP)
    return "diverged (course error past 180 deg)" if wrapped.any() else ""
