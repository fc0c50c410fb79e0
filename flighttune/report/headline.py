"""The headline of a report: three questions, answered in sentences with computed numbers."""

import math
from collections.abc import Sequence

import numpy as np

from flighttune.comparison import Pair
from flighttune.flight.gap import Gap
from flighttune.guarantee.flight_check import FreeFlight
from flighttune.guarantee.ultimate_set import Verdict
from flighttune.metrics import channel_metrics
from flighttune.present.frame import Answer, share_verdict
from flighttune.present.names import CHANNEL_NAMES
from flighttune.present.names import CHANNEL_SYMBOLS as SYMBOLS
from flighttune.present.numbers import degrees
from flighttune.report.facts import (
    CONVERGED_AT_LEAST,
    CONVERGED_PART,
    LATE,
    SMALLEST_ITAE,
    Facts,
    GainFacts,
)
from flighttune.simulate.run import TUBE_SIGNALS, Run
from flighttune.units import DEG_PER_RAD

CRITERION = (
    "A run converges if it was completed and over the last quarter of the flight both errors stay "
    f"within {100.0 * CONVERGED_PART:.0f} % of their largest, or within "
    f"{CONVERGED_AT_LEAST * DEG_PER_RAD:.1f}°."
)


def headline(facts: Facts, tubes: Sequence[str] = ()) -> tuple[Answer, ...]:
    """Does it converge, how far can it be off, is it certified, what does the aircraft change?

    Parameters
    ----------
    facts : Facts
    tubes : sequence of str
        What the tubes of the runs say.
    """
    answers = [_converges(facts), *_enclosed(facts, tubes), _certified(facts)]
    if facts.aircraft is not None:
        answers.append(_changed(facts))
    return tuple(answers)


def _converges(facts: Facts) -> Answer:
    runs = facts.runs
    good = [run for run in runs if facts.final_errors[run.label].converged]
    sentences = [_convergence(facts, run) for run in runs]
    sentences += [f"{run.label} did not fly: {run.outcome.rstrip('.')}." for run in facts.grounded]
    count = len(runs) + len(facts.grounded)
    return Answer(
        question="Does it converge?",
        verdict=share_verdict(len(good), count),
        short=f"{len(good)} of {count} runs",
        sentences=tuple(sentences),
        criterion=CRITERION,
    )


def _enclosed(facts: Facts, tubes: Sequence[str]) -> list[Answer]:
    """What the tubes of the runs say."""
    if not tubes:
        return []
    having = [run for run in facts.runs if set(TUBE_SIGNALS) <= set(run.signals)]
    return [
        Answer(
            question="How far can it be off?",
            verdict="none",
            short=f"a tube around {len(having)} of {len(facts.runs)} runs",
            sentences=tuple(tubes),
        )
    ]


def _convergence(facts: Facts, run: Run) -> str:
    found = facts.final_errors[run.label]
    chi, gamma = (degrees(value) for value in found.residual)
    if run.status != "completed":
        return f"{run.label} ended after {run.duration:.1f} s: {run.outcome.rstrip('.')}."
    settling = channel_metrics(run)["settling_s"].to_dict()
    if not found.converged:
        settled = ", ".join(_settled(SYMBOLS[str(one)], value) for one, value in settling.items())
        late = [
            (SYMBOLS[channel], degrees(got), degrees(most), got > most)
            for channel, got, most in zip(SYMBOLS, found.residual, found.allowed, strict=True)
        ]
        late.sort(key=lambda one: not one[3])
        (first, got, most, _), *rest = late
        others = "".join(f"; {sign} {error}, limit {limit}" for sign, error, limit, _ in rest)
        return (
            f"{run.label} does not converge: after {LATE * run.duration:.1f} s the {first} error "
            f"still reaches {got} (limit {most}{others}). Settling to 5 %: {settled}."
        )
    times = [
        f"{SYMBOLS[str(channel)]} settled (5 %) at {value:.1f} s"
        for channel, value in settling.items()
        if math.isfinite(value)
    ]
    return (
        f"{run.label} converges{': ' if times else ''}{', '.join(times)}; over the "
        f"last quarter χ stays within {chi} and γ within {gamma}."
    )


def _settled(symbol: str, settling: float) -> str:
    return f"{symbol} {settling:.2f} s" if math.isfinite(settling) else f"{symbol} never"


def _certified(facts: Facts) -> Answer:
    broken = any(one.t_broken is not None for one in facts.checks.values())
    good = [one for one in facts.gains if one.trim.status == "certified"]
    sentences = [_guarantee(one) for one in facts.gains]
    asked = [one for one in facts.gains if one.envelope is not None]
    sentences += [_envelope(one) for one in asked]
    sentences += [] if asked else ["No certificate over an envelope was asked for."]
    sentences += _held_to_it(facts)
    return Answer(
        question="Is it certified?",
        # a proof about the linear law does not say that the aircraft converges: never "yes"
        verdict="partly" if broken else "none" if good else "no",
        short=f"{len(good)} of {len(facts.gains)} at the trim, on the linear law only"
        + ("; broken in flight" if broken else ""),
        sentences=tuple(sentences),
    )


def _held_to_it(facts: Facts) -> list[str]:
    """The norm of s in flight against its guaranteed bound."""
    known = {label: one for label, one in facts.checks.items() if np.isfinite(one.bound).any()}
    never = [label for label in facts.checks if label not in known]
    broken = [
        f"{label}, from t = {one.t_broken:.1f} s"
        for label, one in known.items()
        if one.t_broken is not None
    ]
    held = [label for label, one in known.items() if one.t_broken is None]
    lines = []
    if broken:
        lines.append(f"In flight ‖s‖ exceeded its guaranteed bound: {'; '.join(broken)}.")
    if held:
        lines.append(
            "In flight ‖s‖ stayed below its guaranteed bound while no command was limited: "
            f"{', '.join(held)}."
        )
    if never:
        lines.append(f"Commands limited to the end, nothing to compare: {', '.join(never)}.")
    return lines


def _guarantee(one: GainFacts) -> str:
    certificate = one.trim.certificate
    if certificate is None:
        return f"{one.name} is not certified: {one.trim.reason}"
    claim = certificate.claim
    proven = 0 if one.trim.verification is None else len(one.trim.verification.checks)
    growth = math.ceil(10.0 * math.sqrt(np.linalg.cond(certificate.Q))) / 10.0
    ball = (
        ""
        if claim.radius is None
        else f", and under a disturbance of rate up to {claim.L_d:.3g} rad/s² its ultimate bound "
        f"is {claim.radius:.3g}"
    )
    return (
        f"{one.name} is certified for the linear law at the trim: R_K {claim.rate:.4f} 1/s, so "
        f"‖s‖ decays at {0.5 * claim.rate:.3f} 1/s or faster from at most "
        f"{growth:.1f} times its start{ball} ({proven} checks proven exactly)."
    )


def _envelope(one: GainFacts) -> str:
    found = one.envelope
    if found is None or found.certificate is None:
        return f"Over the scenario's envelope {one.name} is not certified: {found and found.reason}"
    rate = found.certificate.claim.rate
    return f"Over the scenario's envelope {one.name} is certified at {rate:.4f} 1/s."


def _changed(facts: Facts) -> Answer:
    assert facts.aircraft is not None
    pairs = facts.aircraft.pairs
    sentences = [_change(facts, place, pair) for place, pair in enumerate(pairs)]
    sentences += [largest_step(gap) for gap in facts.gaps]
    sentences += [bound_in_flight(gap) for gap in facts.gaps]
    apart = facts.aircraft.max_distance
    return Answer(
        question="What did the full aircraft change?",
        verdict="none",
        short=f"paths up to {apart:.0f} m apart",
        sentences=tuple(sentences),
    )


def _change(facts: Facts, place: int, pair: Pair) -> str:
    assert facts.aircraft is not None
    table = facts.aircraft.metrics
    rows = table[table["pair"] == place].set_index(["channel", "name"])

    def values(channel: str, name: str) -> tuple[float, float]:
        return float(rows.at[(channel, name), "a"]), float(rows.at[(channel, name), "b"])

    parts = []
    for channel, symbol in SYMBOLS.items():
        (law, flown), (low, high) = values(channel, "ITAE"), values(channel, "MO_rad")
        parts.append(
            f"ITAE of {symbol} {law:.2f} → {flown:.2f} rad s²{_percent(law, flown)}, overshoot "
            f"{low * DEG_PER_RAD:.1f}° → {high * DEG_PER_RAD:.1f}°"
        )
    return (
        f"{pair.a.provenance.gains_name}, from {pair.a.provenance.plant} to "
        f"{pair.b.provenance.plant}: {'; '.join(parts)}; paths at most {pair.max_distance:.1f} m "
        f"apart, at {pair.t_max_distance:.1f} s."
    )


def largest_step(gap: Gap) -> str:
    """Which step of the ladder moves course and path angle most."""
    parts = []
    for channel, name in CHANNEL_NAMES.items():
        rms = {s.adds: float(np.sqrt(np.mean(getattr(s, channel) ** 2))) for s in gap.steps}
        largest = max(rms, key=lambda adds: rms[adds])
        parts.append(f"{name}, from {largest} ({rms[largest] * DEG_PER_RAD:.1f}° rms)")
    return f"With {gap.name} most of the difference comes, in {' and in '.join(parts)}."


def bound_in_flight(gap: Gap) -> str:
    """What is certified for the measured mismatch, and whether the flight kept it."""
    if set(TUBE_SIGNALS) <= set(gap.aircraft.signals):
        return f"With {gap.name} the tube says how far the aircraft can be off."
    settled = gap.check and gap.check.settled
    if gap.verdict is None or settled is None:
        return f"With {gap.name} there is no certified set to compare with the aircraft."
    return (
        f"With {gap.name} the aircraft differs from the law by a disturbance of rate up to "
        f"{gap.verdict.claim.L_d:.2f} rad/s²; {_ultimate(gap.verdict)}. In the second half that "
        f"rate is up to {settled.claim.L_d:.3f} rad/s²; {_ultimate(settled)}.{_free(gap.free)}"
    )


def _ultimate(verdict: Verdict) -> str:
    chi, gamma = (degrees(width) for width in verdict.claim.tube)
    return (
        f"the ultimate set certified for that, errors within {chi} of χ and {gamma} of γ: "
        f"{verdict.sentence}"
    )


def _free(free: FreeFlight | None) -> str:
    if free is None:
        return ""
    within = degrees(max(free.widest))
    verb = "do not exceed it" if free.sentence == "held" else f"that is {free.sentence}"
    return (
        f" After {free.t_from:.1f} s no command is limited; from there errors may differ from the "
        f"unforced linear loop by at most {within}: {verb}."
    )


def _percent(law: float, flown: float) -> str:
    """The change in per cent; empty where two decimals of ITAE cannot resolve it."""
    return f" ({100.0 * (flown / law - 1.0):+.0f} %)" if law >= SMALLEST_ITAE else ""
