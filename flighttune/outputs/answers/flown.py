"""The answer of a flown scenario."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from flighttune.base.words import pick
from flighttune.flight.conditions import slopes_not_held
from flighttune.flight.flown import FlownScenario
from flighttune.flight.scenario.schema import Scenario
from flighttune.outputs.answers.advice import advice
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.answers.run import claimed, priority_notes
from flighttune.outputs.answers.verdict import sentence, short

# Metrics of the printed table; ``--json`` has them all.
RUN_COLUMNS = columns(
    "plant gains status metrics.chi.MO_rad metrics.gamma.MO_rad metrics.chi.settling_s "
    "metrics.gamma.settling_s"
) + [replace(x, spare=True) for x in columns("metrics.chi.ITAE metrics.gamma.ITAE")]
ROUTE_COLUMNS = columns(
    "plant gains status metrics.flight.cross_track_m metrics.flight.height_err_m "
    "metrics.flight.V_a_dev_mps metrics.chi.saturation_s metrics.gamma.saturation_s"
)
BOUND_KEYS = "run subject measure sense bound value met flown"


def answer(flown: FlownScenario, signals: Mapping[str, Path] | None = None) -> Answer:
    """End and measures of each run; a failure names the missed requirements.

    `signals`: files of recorded runs by label.
    """
    scenario, around = flown.scenario, claimed(flown.runs)
    loops = {name: pick(value, "R_K I_K E_K") for name, value in flown.indicators.items()}
    runs = flown.records(signals or {})
    for run in runs:
        run["indicators"] = loops.get(run["gains"], dict.fromkeys(("R_K", "I_K", "E_K")))
    linear = [{"gains": name, **values} for name, values in loops.items()]
    shown = RUN_COLUMNS if scenario.route is None else ROUTE_COLUMNS
    if all(run.status == "completed" for run in flown.runs):
        shown = [column for column in shown if column.key != "status"]
    claim, missed = flown.claim, flown.claim.missed
    slopes = slopes_not_held(scenario)
    next_step = advice(scenario, flown.runs, flown.source, slopes)
    # a note already tells how a flight ended
    said = sentence(claim)
    stated = short(claim) if failed(flown) else said
    more = f" ({len(missed) - 1} more)" if missed[1:] else ""
    return Answer(
        values={
            "runs": runs,
            "claim": {
                "claim": scenario.verifies,
                "verdict": claim.verdict,
                "sentence": said,
                **pick(claim.total, "requirements met not_flown"),
                "bounds": [pick(bound, BOUND_KEYS) for bound in claim.bounds],
                "next": next_step,
            },
            "missed": missed,
            **around.values,
        },
        tables=[
            Table(shown, runs, scenario.title, grouped=True),
            Table(columns("gains R_K I_K E_K"), linear, loop_in_words(scenario), aside=True),
        ],
        lines=around.summary,
        notes=[*scenario.notes, *slopes, *around.notes, *notes(flown)],
        verdict=f"{stated}. {next_step}" if next_step else f"{stated.removesuffix('.')}.",
        findings=[*around.findings, *(unmet(f"{missed[0]}{more}") if missed else [])],
    )


def failed(flown: FlownScenario) -> bool:
    """Whether a flight ended in an error of its law or plant."""
    return any(run.status in ("law_failed", "plant_failed") for run in flown.runs)


def loop_in_words(scenario: Scenario) -> str:
    """The linear loop of the indicators, in words."""
    tuning, place = scenario.tuning, "steady flight on the first reference"
    if tuning.model != "identified":
        return f"linear loop on the kinematic law, {place}"
    place = "nominal condition" if tuning.robust else place
    return f"linear loop on the identified aircraft, {place}"


def notes(flown: FlownScenario) -> list[str]:
    """Ends of flights, gains without indicators, priority of channels, and the next command."""
    told = [f"{run.label}: {run.outcome}" for run in flown.runs if run.status != "completed"]
    told += [
        f"{name}: R_K none: its law states no linear model that its gains act on."
        for name in dict.fromkeys(run.provenance.gains_name for run in flown.runs)
        if name not in flown.indicators and not flown.scenario.law_of(name)[0].by_gains
    ]
    told += priority_notes(flown.runs)
    told += [
        f"{run.label}: flown by JSBSim itself: {run.why_jsbsim}."
        for run in flown.runs
        if run.why_jsbsim
    ]
    if not failed(flown) and any(run.provenance.aircraft for run in flown.runs):
        command = f"flighttune gap {flown.source} {flown.chosen}".rstrip()
        told.append(f"Why aircraft and law differ: {command}")
    return told
