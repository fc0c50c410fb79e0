"""The top of a report: which gains are best on the aircraft, and a matrix of gains and plants."""

import math
from typing import Any

import numpy as np

from flighttune.metrics import channel_metrics
from flighttune.present.chart import spark
from flighttune.present.names import CHANNEL_SYMBOLS
from flighttune.present.numbers import number
from flighttune.report.facts import SMALLEST_ITAE, Facts
from flighttune.simulate.run import Run


def best_sentence(facts: Facts) -> str:
    """Sentence on the gains with the lowest ITAE on the aircraft, and their lead."""
    plant = _decisive_plant(facts)
    runs = [run for run in facts.runs if run.provenance.plant == plant]
    where = f"On {plant}"
    completed = [run for run in runs if run.status == "completed"]
    if not completed:
        return f"{where} no flight was completed."
    good = [run for run in completed if facts.final_errors[run.label].converged] or completed
    itae = {run.label: _itae(run) for run in completed}
    best = min(good, key=lambda run: _product(itae[run.label]))
    name, own = best.provenance.gains_name, itae[best.label]
    converges = facts.final_errors[best.label].converged
    others = [run for run in completed if run is not best]
    if not others:
        values = ", ".join(
            f"{own[channel]:.2f} ({sign})" for channel, sign in CHANNEL_SYMBOLS.items()
        )
        tail = "" if converges else ", not converging"
        return f"{where} {name} has ITAE {values} rad s²{tail}."
    by_gains = {run.provenance.gains_name: run for run in others}
    other = by_gains.get("paper") or min(others, key=lambda run: _product(itae[run.label]))
    head = f"{where} {name} is best" if converges else f"{where} no gains converge; {name} is best"
    return f"{head}: ITAE {_ratio(own, itae[other.label])} {other.provenance.gains_name}'s."


def matrix(facts: Facts) -> list[dict[str, Any]]:
    """Errors, ITAE and settling time of every run: a row a gain set, a cell a plant."""
    plants = dict.fromkeys(run.provenance.plant for run in facts.runs)
    names = dict.fromkeys(run.provenance.gains_name for run in facts.runs)
    of = {(run.provenance.gains_name, run.provenance.plant): run for run in facts.runs}
    lowest = {
        (plant, channel): min(
            (
                _itae(run)[channel]
                for run in facts.runs
                if run.provenance.plant == plant and run.status == "completed"
            ),
            default=math.nan,
        )
        for plant in plants
        for channel in CHANNEL_SYMBOLS
    }
    longest = max(run.duration for run in facts.runs)
    errors = np.concatenate([error for run in facts.runs for error in _errors(run).values()])
    ends = float(errors.min()), float(errors.max())  # one scale for all

    def cell(run: Run | None, plant: str) -> dict[str, Any] | None:
        if run is None:
            return None
        done = run.status == "completed"
        settling = channel_metrics(run)["settling_s"].to_dict()
        colour = facts.styles[run.label].colour
        return {
            "spark": spark(run.t, _errors(run), colour, longest, ends),
            "converged": facts.final_errors[run.label].converged,
            "ended": "" if done else f"{run.status.replace('_', ' ')} at {run.duration:.1f} s",
            "itae": [
                (f"{value:.2f}", done and len(names) > 1 and value == lowest[plant, channel])
                for channel, value in _itae(run).items()
            ],
            "settling": [number(settling[channel], ".1f") for channel in CHANNEL_SYMBOLS],
        }

    return [
        {"gains": name, "cells": {plant: cell(of.get((name, plant)), plant) for plant in plants}}
        for name in names
    ]


def _decisive_plant(facts: Facts) -> str:
    """The first aircraft that flew, else the last plant."""
    aircraft = [run for run in facts.runs if run.provenance.aircraft is not None]
    return (aircraft[0] if aircraft else facts.runs[-1]).provenance.plant


def _itae(run: Run) -> dict[str, float]:
    itae = channel_metrics(run)["ITAE"].to_dict()
    return {channel: float(itae[channel]) for channel in CHANNEL_SYMBOLS}


def _product(itae: dict[str, float]) -> float:
    """Product over the channels; a channel with almost no error does not decide alone."""
    return math.prod(max(value, SMALLEST_ITAE) for value in itae.values())


def _ratio(own: dict[str, float], other: dict[str, float]) -> str:
    """``0.43 (χ), 0.26 (γ) of``, or values where the other has next to nothing."""
    parts = [
        f"{own[channel] / other[channel]:.2f} ({sign})"
        for channel, sign in CHANNEL_SYMBOLS.items()
        if other[channel] >= SMALLEST_ITAE
    ]
    return f"{', '.join(parts)} of" if parts else "next to nothing, as are"


def _errors(run: Run) -> dict[str, np.ndarray]:
    return {
        f"error of {sign}": run.signals[f"{channel}_err"].to_numpy()
        for channel, sign in CHANNEL_SYMBOLS.items()
    }
