"""The flights of a scenario as a value: runs, indicators, metrics and its requirements."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from flighttune.flight.advice import advice
from flighttune.flight.conditions import slopes_not_held
from flighttune.flight.expectations import ClaimCheck, check_claim
from flighttune.metrics import AIRSPEED, airspeed_metrics, metric_tables
from flighttune.present.answer import Answer, Answering, Table, pick
from flighttune.present.names import columns
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Claim, Run, claimed, priority_notes, with_claims
from flighttune.theory.indicators import Indicators
from flighttune.tuning.result import TuningResult

# Metrics of the printed table; ``--json`` has them all.
RUN_COLUMNS = columns(
    "plant gains status metrics.chi.ITAE metrics.gamma.ITAE metrics.chi.MO_rad "
    "metrics.gamma.MO_rad metrics.chi.settling_s metrics.gamma.settling_s"
)
ROUTE_COLUMNS = columns(
    "plant gains status metrics.flight.cross_track_m metrics.flight.height_err_m "
    "metrics.flight.V_a_dev_mps metrics.chi.saturation_s metrics.gamma.saturation_s"
)
BOUND_KEYS = "run subject measure sense bound value met flown"


@dataclass(frozen=True, eq=False)
class FlownScenario(Answering):
    """A scenario with its runs, indicators and metrics.

    Attributes
    ----------
    scenario : Scenario
    runs : tuple of Run
        Plant by plant, gain set by gain set.
    indicators : mapping of str to Indicators
        R_K, I_K and E_K on the linear model of the scenario, by name of the gain set.
    tuning : TuningResult or None
        Result of the tuning of the gains ``tuned``, where the scenario asks for them.
    source : str
        The scenario as arguments of a command, with its changes.

    Examples
    --------
    >>> flown = ft.fly("paper_as_printed")
    >>> flown.claim.verdict, flown["kinematic / paper"].status
    ('met', 'completed')
    """

    scenario: Scenario
    runs: tuple[Run, ...]
    indicators: Mapping[str, Indicators]
    tuning: TuningResult | None = None
    source: str = "SCENARIO"

    @cached_property
    def metrics(self) -> pd.DataFrame:
        """`channel_metrics` of every run flown; index (run, channel)."""
        return metric_tables(self.runs)[0]

    @cached_property
    def flight(self) -> pd.DataFrame:
        """`flight_metrics` of every run flown; index run."""
        return metric_tables(self.runs)[1]

    def __getitem__(self, label: str) -> Run:
        return next(run for run in self.runs if run.label == label)

    @property
    def claim(self) -> ClaimCheck:
        """The runs against the ``[[expect]]`` tables of the scenario."""
        return check_claim(self.scenario, self.runs)

    def within(self, *claims: Claim) -> "FlownScenario":
        """The flights with what is claimed of them; an InputError says why a claim covers none."""
        return replace(self, runs=with_claims(self.runs, claims))

    def records(self, files: Mapping[str, Path]) -> list[dict[str, Any]]:
        """How each run ended and what was measured; `files` of signals are by label."""
        return [
            {
                "plant": run.provenance.plant,
                "gains": run.provenance.gains_name,
                "status": run.status,
                "reason": run.reason,
                "duration_s": run.duration,
                "signals": files.get(run.label),
                "metrics": self.metrics_of(run),
            }
            for run in self.runs
        ]

    def metrics_of(self, run: Run) -> dict[str, dict[str, float]]:
        """Measures of one run as numbers: ``chi``, ``gamma`` and ``flight``; empty if not flown."""
        if run.label not in self.flight.index:
            return {}
        channels = self.metrics.loc[run.label].to_dict(orient="index")
        airspeed = {AIRSPEED: measured} if (measured := airspeed_metrics(run)) else {}
        return {**channels, **airspeed, "flight": self.flight.loc[run.label].to_dict()}

    def answer(self, signals: Mapping[str, Path] | None = None) -> Answer:
        """How each run ended and what was measured; a failure names the requirements missed.

        `signals`: files of recorded runs by label.
        """
        tuning, place = self.scenario.tuning, "steady flight on the first reference"
        loop = f"linear loop on the kinematic law, {place}"
        if tuning.model == "identified":
            place = "nominal condition" if tuning.robust else place
            loop = f"linear loop on the identified aircraft, {place}"
        unknown = {"R_K": None, "I_K": None, "E_K": None}
        loops = {name: pick(value, "R_K I_K E_K") for name, value in self.indicators.items()}
        runs = [
            {**record, "indicators": loops.get(record["gains"], unknown)}
            for record in self.records(signals or {})
        ]
        notes = [f"{run.label}: {run.outcome}" for run in self.runs if run.status != "completed"]
        notes += priority_notes(self.runs)
        around = claimed(self.runs)
        claim, missed = self.claim, self.claim.missed
        slopes = slopes_not_held(self.scenario)
        next_step = advice(self.scenario, self.runs, self.source, slopes)
        failed = any(run.status in ("law_failed", "plant_failed") for run in self.runs)
        if not failed and any(run.provenance.aircraft for run in self.runs):
            notes.append(f"Why aircraft and law differ: flighttune gap {self.source}")
        # how a flight ended is a note already
        sentence = claim.short if failed else claim.sentence
        more = f" ({len(missed) - 1} more)" if missed[1:] else ""
        return Answer(
            values={
                "runs": runs,
                "claim": {
                    "claim": self.scenario.verifies,
                    **pick(claim, "verdict sentence"),
                    **pick(claim.total, "requirements met not_flown"),
                    "bounds": [pick(bound, BOUND_KEYS) for bound in claim.bounds],
                    "next": next_step,
                },
                "missed": missed,
                **around.values,
            },
            tables=[
                Table(
                    RUN_COLUMNS if self.scenario.route is None else ROUTE_COLUMNS,
                    runs,
                    self.scenario.title,
                    grouped=True,
                ),
                Table(
                    columns("gains R_K I_K E_K"),
                    [{"gains": name, **values} for name, values in loops.items()],
                    loop,
                ),
            ],
            notes=[*self.scenario.notes, *slopes, *around.notes, *notes],
            verdict=f"{sentence}. {next_step}" if next_step else sentence,
            failure=around.failure or (f"{missed[0]}{more}" if missed else ""),
        )
