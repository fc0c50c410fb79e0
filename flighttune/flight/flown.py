"""The flights of a scenario as a value: runs, metrics, requirements, and advice about them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flighttune.control.gains import PAPER_SPEED, paper_family
from flighttune.control.law import split_name
from flighttune.flight.conditions import slopes_not_held
from flighttune.flight.expectations import ClaimCheck, bound_checks, check_claim
from flighttune.metrics import AIRSPEED, airspeed_metrics, measures, metric_tables
from flighttune.present.answer import Answer, Answering, Table, pick
from flighttune.present.names import columns
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import TUNED_FED_BACK, TUNED_IDENTIFIED
from flighttune.simulate.run import Claim, Run, claimed, priority_notes, with_claims
from flighttune.theory.indicators import Indicators
from flighttune.tuning.result import TuningResult
from flighttune.units import DEG

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


# Time that a command spends at a limit, s, from which the limit counts as a cause.
AT_LIMIT_S = 0.5

# Relative difference of airspeeds from which gains count as those of another airspeed.
OTHER_AIRSPEED = 0.15

# A mistake in a law shows in this time from the first error of this size on, s and rad.
FIRST_S, FIRST_ERROR = 1.0, 1.0 * DEG

# Roll commands beyond half a turn and so many times the error are degrees: laws have gains of 1 to
# 5, which become 57 to 290.
NO_ROLL, NO_GAIN = math.pi, 20.0


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
        shown = RUN_COLUMNS if self.scenario.route is None else ROUTE_COLUMNS
        tuning, place = self.scenario.tuning, "steady flight on the first reference"
        loop = f"linear loop on the kinematic law, {place}"
        if tuning.model == "identified":
            place = "nominal condition" if tuning.robust else place
            loop = f"linear loop on the identified aircraft, {place}"
        loops = {name: pick(value, "R_K I_K E_K") for name, value in self.indicators.items()}
        runs = self.records(signals or {})
        for run in runs:
            run["indicators"] = loops.get(run["gains"], dict.fromkeys(("R_K", "I_K", "E_K")))
        linear = [{"gains": name, **values} for name, values in loops.items()]
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
                Table(shown, runs, self.scenario.title, grouped=True),
                Table(columns("gains R_K I_K E_K"), linear, loop),
            ],
            notes=[*self.scenario.notes, *slopes, *around.notes, *notes],
            verdict=f"{sentence}. {next_step}" if next_step else sentence,
            failure=around.failure or (f"{missed[0]}{more}" if missed else ""),
        )


def advice(scenario: Scenario, runs: Sequence[Run], source: str, slopes: Sequence[str] = ()) -> str:
    """One line with what may help the runs that miss an upper bound; empty if nothing is known to.

    It begins with likely mistakes in laws of the user. `source` is the scenario as commands name
    it, `slopes` are sentences on those of the reference that cannot be held.
    """
    lines, sound = dict[str, None](), list[Run]()
    for run in runs:
        name = run.provenance.gains_name
        if scenario.law_table(name).of_the_user and (doubt := mistake(run)):
            lines[f"{name}: {doubt}"] = None
        else:
            sound.append(run)
    ways = dict.fromkeys(way for run in sound for way in _ways(scenario, run, runs, source, slopes))
    return " ".join([*lines, *([f"To try next: {'; '.join(ways)}."] if ways else [])])


def mistake(run: Run) -> str:
    """A likely mistake in the law of a run: its sign, or degrees; empty if none shows."""
    columns = run.signals
    if len(columns) < 2:
        return ""
    roll = columns["phi_unlimited"].to_numpy()
    lift = columns["n_z_unlimited"] * np.cos(columns["phi"]) - np.cos(columns["gamma"])
    for channel, turn in (("chi", roll), ("gamma", lift.to_numpy())):
        error = columns[f"{channel}_err"].to_numpy()
        if channel == "gamma" and "gamma_given" in columns:  # the path angle may have given way
            error = (columns["gamma_given"] - columns["gamma"]).to_numpy()
        size = np.abs(error)
        begun = np.flatnonzero(size > FIRST_ERROR)[:1]
        for k in begun:  # none or one
            end = int(np.searchsorted(run.t, run.t[k] + FIRST_S))
            away = (error * turn)[k:end] < 0.0
            if away.all() and (size[end - 1 :] > size[k]).all():
                return "the law turns away from the reference: is the sign of its output right?"
            least = max(NO_ROLL, NO_GAIN * np.median(size[k:end]))
            if channel == "chi" and np.median(np.abs(roll[k:end])) > least:
                return "its roll commands are more than half a turn: are they degrees?"
    return ""


def _ways(
    scenario: Scenario, run: Run, runs: Sequence[Run], source: str, slopes: Sequence[str]
) -> Iterator[str]:
    made_by, reference, V_a = run.provenance, scenario.reference, scenario.flight.V_a_mps
    tables = scenario.expected(made_by.plant, made_by.gains_name)
    ends = [table.status for table in tables if table.status] or ["completed"]
    measured = measures(run)
    checks = [check for check in bound_checks(tables, measured) if check.sense == "at_most"]
    missed = {(check.subject, check.measure) for check in checks if not check.met}
    if not missed or run.status not in ends:
        return
    at_limit = any(measured[channel]["saturation_s"] > AT_LIMIT_S for channel in ("chi", "gamma"))
    if at_limit and reference is not None and reference.shape is None:
        segments = isinstance(reference.chi_deg, list) or isinstance(reference.gamma_deg, list)
        slower = "a slower change, `rate_dps` of [reference]"
        within = 'a reference within the limits, `shape = "feasible"` in [reference]'
        yield f"{slower if segments else within}, as commands reach their limits"
    for law in runs if made_by.aircraft and made_by.law.by_gains else ():
        if law.provenance.aircraft or law.provenance.gains_name != made_by.gains_name:
            continue
        if any(
            check.met and (check.subject, check.measure) in missed
            for check in bound_checks(tables, measures(law))
        ):
            yield f"gains that meet it on the aircraft too, `flighttune meet {source}`"
    gains = split_name(made_by.gains_name)[1]
    better = not {TUNED_IDENTIFIED, TUNED_FED_BACK} & {
        x for x in scenario.gains if isinstance(x, str)
    }
    if better and gains in paper_family() and abs(V_a / PAPER_SPEED - 1.0) > OTHER_AIRSPEED:
        yield f"`{TUNED_IDENTIFIED}` in `gains`, as {gains} is meant for {PAPER_SPEED:g} m/s"
    strayed = (run.signals["V_a"] / V_a - 1.0).abs().max() > OTHER_AIRSPEED
    if strayed and slopes:
        yield "a path that is less steep, as its airspeed cannot be held on this one"
    elif strayed and not (scenario.controller.schedule or made_by.law.same_everywhere):
        yield "`schedule = true` in [controller], as the airspeed changes in flight"
