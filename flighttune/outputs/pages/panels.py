"""Charts and tables of runs: tracking, commands with limits, paths, certificates, convergence."""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from flighttune.base.arrays import FloatArray, true_spans
from flighttune.base.errors import FlightTuneError
from flighttune.base.signals import (
    CHANNEL_SYMBOLS,
    COMMAND_OF,
    SIGNAL_UNITS,
    SIGNALS,
    SUBJECTS,
    titles,
)
from flighttune.base.units import DEG_PER_RAD, shown_unit
from flighttune.base.words import MISSING
from flighttune.claims.linear_loop import LinearBound
from flighttune.control.gains import PIGains
from flighttune.flight.conditions import reference_of, stated_condition
from flighttune.flight.flown import ClaimCheck, envelopes
from flighttune.flight.gains import certify_scenario
from flighttune.flight.loop.run import Run, claims_around
from flighttune.flight.metrics import CHANNELS, FLIGHT_METRICS, channel_metrics, flight_metrics
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps.compare import largest_distance
from flighttune.outputs.answers.answer import Table, facts_table
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.drawing.chart import DASHED, DOTTED, MAX_DRAWN, Chart
from flighttune.outputs.drawing.palette import LIMIT, NEUTRAL, LineStyle
from flighttune.outputs.recording.plots import displayed, limits_of
from flighttune.routes.follow import ROUTE_SIGNALS
from flighttune.vehicles.aircraft.aircraft import load_aircraft

# Words of the pages.
TEXTS = tomllib.loads(Path(__file__).with_name("texts.toml").read_text(encoding="utf-8"))

# Signals with their references, errors, and commands.
REFERENCES = {name: signal.reference for name, signal in SIGNALS.items() if signal.reference}
ERRORS = tuple(SUBJECTS[channel].error for channel in COMMAND_OF)

# Height of one run's bar as a share of the panel.
LANE = 0.035

FEW_RUNS = 4

# An envelope is drawn if its bound is at most this factor times the largest error.
FAR = 2.0

# Lower end of the logarithmic axis of ``||s||``.
FLOOR = 1e-4

TINY = 1e-9

# Number of samples for the description of a reference in words.
ANGLES = 2001

# Maximum number of bars side by side in a flight.
FINEST = 300


# Signals of a place.
PLACE = {"north", "east", "down"}

# Runs that are drawn together, with their lines.
Drawn: TypeAlias = Sequence[tuple[Run, LineStyle]]


def most_points(runs: int) -> int:
    """Maximum points of a line, so that the page of many long runs stays small."""
    return MAX_DRAWN * FEW_RUNS // max(FEW_RUNS, runs)


def panel(
    flights: Drawn,
    signal: str,
    note: str = "",
    *,
    reference: str = "",
    limits: str = "",
    zero: bool = False,
    bounds: bool = False,
    si_unit: str = "",
) -> Chart:
    """A signal over time for the runs that have it, to the end of the longest flight."""
    longest = max((run for run, _ in flights), key=lambda run: run.duration)
    (title, label), ends = titles(signal, si_unit), (0.0, longest.duration)
    chart = Chart(title=f"{title}{note}", y=label, x_range=ends, linked=True)
    most = most_points(len(flights))
    # The reference is the same for all runs; the log of a real flight may not say it.
    if told := [run for run, _ in flights if reference in run.signals]:
        longest = max(told, key=lambda run: run.duration)
        chart.line(longest.t, displayed(longest.signals, reference), NEUTRAL, width=2.2, most=most)
    for limit in limits_of(flights[0][0].provenance.scenario, limits) or ():
        chart.level(limit)
    if zero:
        chart.level(0.0, NEUTRAL, dash="")
    having = [(run, style) for run, style in flights if signal in run.signals]
    for run, style in having if bounds else ():
        draw_bounds(chart, run, run.t, signal, style.colour)
    for run, style in having:
        chart.run_line(run.t, displayed(run.signals, signal), style, run.label, most=most)
    return chart


def draw_bounds(chart: Chart, run: Run, x: FloatArray, signal: str, colour: str) -> None:
    """Bounds of a signal: a tube in its run's colour, a band grey, required envelopes red."""
    for claim, ends in claims_around(run.claims, signal):
        low, high = shown_unit(claim.units[signal])[1] * ends
        counted = claim.kind == "counted"
        chart.band(x, low, high, NEUTRAL if counted else colour, run=run.label, name=claim.title)
        for edge in (low, high) if counted else ():
            chart.line(x, edge, NEUTRAL, run=run.label, dash=DOTTED, width=1.2, hover=False)
    for bound in envelopes(run, signal):
        factor = shown_unit(SIGNAL_UNITS[signal])[1]
        error = run.signals[signal].abs().max()
        # A bound far beyond all errors would hide them.
        shown = factor * np.where(bound > FAR * max(error, bound.min()), np.nan, bound)
        for edge in (-shown, shown):
            chart.line(x, edge, LIMIT, run=run.label, dash=DASHED, width=1.2, hover=False)
        if (entry := ("required envelope", LIMIT, DASHED)) not in chart.legend:
            chart.legend.append(entry)


def flown_in_words(scenario: Scenario, runs: Sequence[Run]) -> str:
    """Aircraft, airspeed, manoeuvre and weather of a scenario in one line."""
    aircraft = []
    for name in dict.fromkeys(filter(None, (run.provenance.aircraft for run in runs))):
        try:
            aircraft.append(load_aircraft(name).title)
        except FlightTuneError:  # of somebody else's recording
            aircraft.append(name)
    start, subject = stated_condition(scenario), "; ".join(aircraft) or "Guidance law"
    at = f"{subject}: at {scenario.airspeed_words} in {scenario.air}"
    if scenario.route is not None:
        return f"{at}, {len(scenario.route.waypoint)} waypoints."
    t = np.linspace(0.0, scenario.flight.duration_s, ANGLES)
    chi, gamma = reference_of(scenario).sampled(t)
    course, climb = _moves("course", start.chi, chi), _moves("path angle", start.gamma, gamma)
    if "goes from" in course:
        climb = climb.replace("goes from", "from")  # the page has no room to say it twice
    return f"{at}, {course} and {climb}."


def _moves(name: str, start: float, reference: FloatArray) -> str:
    """Words for the reference of an angle, in degrees, from the angle at the start."""
    path = np.round(DEG_PER_RAD * np.append(start, reference), 1) + 0.0
    first, last, low, high = (f"{end:g}°" for end in (path[0], path[-1], path.min(), path.max()))
    if low == high:
        return f"the {name} stays at {first}"
    if {first, last} == {low, high}:
        return f"the {name} goes from {first} to {last}"
    if first == last and first in (low, high):
        return f"the {name} goes from {first} to {high if first == low else low} and back"
    return f"the {name} moves between {low} and {high}"


def tracking(flights: Drawn) -> list[Chart]:
    """Course, path angle and airspeed with their references, if any."""
    return [
        panel(flights, signal, "; reference grey", reference=reference)
        for signal, reference in REFERENCES.items()
        if any(reference in run.signals for run, _ in flights)
    ]


def errors(flights: Drawn) -> list[Chart]:
    """Both errors with their claims, and other signals with claims."""
    charts = [
        panel(flights, signal, zero=True, bounds=True)
        for signal in ERRORS
        # logs of real flights may lack references
        if any(signal in run.signals for run, _ in flights)
    ]
    claimed = {
        name: claim.units[name]
        for run, _ in flights
        for claim in run.claims
        for name in claim.bounds.names
        if name not in (*ROUTE_SIGNALS, *ERRORS)
    }
    for signal, si_unit in claimed.items():
        bounded = [(run, style) for run, style in flights if any(claims_around(run.claims, signal))]
        charts.append(panel(bounded, signal, bounds=True, si_unit=si_unit))
    return charts


def commands(flights: Drawn) -> list[Chart]:
    """Commands after limits, the limits, and bars while a command is limited."""
    charts = []
    for name in COMMAND_OF.values():
        if not all(f"{name}_cmd" in run.signals for run, _ in flights):
            continue
        chart = panel(flights, f"{name}_cmd", "; limits dashed, bars: limited", limits=name)
        low, high = chart.y_ends()
        room = LANE * (len(flights) + 1)
        chart.y_range = low - room / (1.0 - room) * (high - low), high
        for place, (run, style) in enumerate(flights):
            limited = run.signals[f"{name}_limited"].to_numpy() != 0.0
            chart.spans(_spans(run.t, limited), LANE * (place + 0.8), style.colour, run=run.label)
        charts.append(chart)
    return charts


def flown_signals(flights: Drawn, signals: str = "phi n_z") -> list[Chart]:
    """Signals of flights over time, with limits; names are separated by spaces."""
    return [panel(flights, signal, limits=signal) for signal in signals.split()]


def paths(flights: Drawn) -> list[Chart]:
    """The paths from above, with north up, or to the right for a long way north; and heights.

    Runs without places, such as some logs, are left out; nothing is drawn if no run has places.
    """
    flights = [(run, style) for run, style in flights if PLACE <= {*run.signals}]
    if not flights:
        return []
    ned = [run.signals[["north", "east", "down"]].to_numpy() for run, _ in flights]
    extent = np.ptp(np.vstack(ned), axis=0)
    across, up = (0, 1) if extent[0] > extent[1] else (1, 0)
    names = "north", "east"
    above = Chart(
        title="From above, start at the cross",
        x=f"{names[across]} [m]",
        y=f"{names[up]} [m]",
        equal=True,
        downwards=across == 0,  # with north to the right, east points down
    )
    longest, most = max(run.duration for run, _ in flights), most_points(len(flights))
    title, unit = "Height over the start", "height [m]"
    height = Chart(title=title, y=unit, x_range=(0.0, longest), linked=True)
    for (run, style), place in zip(flights, ned, strict=True):
        above.run_line(place[:, across], place[:, up], style, run.label, most=most)
        height.run_line(run.t, -place[:, 2], style, run.label, most=most)
    above.points(0.0, 0.0, NEUTRAL, shape="plus", size=6)
    return [above, height]


def certificate_panels(flights: Drawn, bounds: Mapping[str, LinearBound]) -> list[Chart]:
    """The norm of s against its bound on the linear loop, with a chart per gain set."""
    sets: dict[str, list[tuple[Run, LineStyle]]] = {}
    for run, style in flights:
        if run.label in bounds:
            sets.setdefault(run.provenance.gains_name, []).append((run, style))
    charts = []
    for name, compared in sets.items():
        chart = Chart(
            title=f"{name}: ‖s‖ of the law, bound of the linear loop dashed",
            y="‖(e′, e)‖ [rad/s, rad]",
            x_range=(0.0, max(run.duration for run, _ in compared)),
            log="y",
            linked=True,
        )
        look: dict[str, Any] = {"most": most_points(len(flights))}
        for run, style in compared:
            curve, label = bounds[run.label], run.label
            chart.run_line(curve.t, np.maximum(curve.size, TINY), style, label, dash="", **look)
            chart.run_line(
                curve.t, np.maximum(curve.bound, TINY), style, label, dash=DASHED, width=1.2, **look
            )
            if curve.radius > 0.0:
                chart.level(curve.radius, style.colour, dash=DOTTED, run=label)
        low, high = chart.y_ends()
        chart.y_range = max(low, FLOOR), max(high, 10.0 * FLOOR)
        charts.append(chart)
    return charts


def _spans(t: FloatArray, flag: np.ndarray) -> Sequence[tuple[float, float]]:
    """Start and end of every stretch in which `flag` is true; close stretches are joined."""
    times = np.append(t, t[-1]).tolist()
    spans: list[tuple[float, float]] = []
    for first, after in true_spans(flag):
        start, end = times[first], times[after]
        if spans and start - spans[-1][1] < t[-1] / FINEST:
            start = spans.pop()[0]
        spans.append((start, end))
    return spans


# An error has converged if, over the last quarter of the flight, it stays within 5 % of its largest
# value or within 0.5 deg.
CONVERGED_PART = 0.05
CONVERGED_AT_LEAST = np.deg2rad(0.5)

# Share of the flight before its last quarter.
LATE = 0.75

TRACKING = "run channel ITAE_mean MO_rad PT_s rise_s MS_rad ST_rad effort_rms saturation_s"
FLIGHT = " ".join(FLIGHT_METRICS)

CONVERGENCE_COLUMNS = columns(
    "run flight requirements chi.ITAE gamma.ITAE chi.settling_s residual.chi allowed.chi "
    "gamma.settling_s residual.gamma allowed.gamma",
    of="convergence",
)
ROUTE_COLUMNS = columns("run flight requirements cross_track_m height_err_m V_a_dev_mps")
GAIN_COLUMNS = columns("gains R_K I_K E_K K_P K_I", of="gains")
CERTIFICATE_COLUMNS = columns(
    "gains rate growth radius L_d checks envelope_rate status", of="certificates"
)


def tracking_table(runs: Sequence[Run]) -> Table:
    """Tracking of the reference by each run, with a row per channel."""
    records = [
        {"run": run.label, "channel": CHANNEL_SYMBOLS[str(channel)], **metrics}
        for run in runs
        for channel, metrics in channel_metrics(run).to_dict(orient="index").items()
    ]
    return Table(columns(TRACKING), records, "Tracking", name="tracking", label="run")


def by_plant(counts: Iterable[tuple[str, int, int]]) -> str:
    """Successes and flights of each plant, such as ``kinematic 2/2``, law and aircraft apart."""
    sums: dict[str, tuple[int, int]] = {}
    for plant, successes, n in counts:
        before = sums.get(plant, (0, 0))
        sums[plant] = before[0] + successes, before[1] + n
    return ", ".join(f"{plant} {successes}/{n}" for plant, (successes, n) in sums.items())


def convergence_table(runs: Sequence[Run], claim: ClaimCheck) -> Table:
    """End of each run: met requirements, ITAE, largest errors of the last quarter and limits."""
    records = []
    for run, (n, met, not_flown, *_) in zip(runs, claim.counts, strict=True):
        record = {"run": run.label, "converges": False, "flight": run.status.replace("_", " ")}
        if n:
            poor = sum(bound.run == run.label for bound in claim.lower)
            lower = f" ({poor} lower bound{'s' * (poor > 1)})" if poor else ""
            record["requirements"] = "not flown" if not_flown == n else f"{met} of {n} met{lower}"
        if len(run.signals) > 1:
            record |= final_errors(run)
            record |= channel_metrics(run)[["ITAE", "settling_s"]].to_dict(orient="index")
            record |= flight_metrics(run) if "along" in run.signals else {}
        if run.status == "completed":
            record["flight"] = "converges" if record["converges"] else "does not converge"
            record["flight"] = "arrives" if "along" in run.signals else record["flight"]
        elif len(run.signals):
            record["flight"] += f" at {run.duration:.1f} s"
        records.append(record)
    layout = ROUTE_COLUMNS if any("along" in run.signals for run in runs) else CONVERGENCE_COLUMNS
    return Table(layout, records, name="convergence", label="run")


def final_errors(run: Run) -> dict[str, Any]:
    """Whether a run converges: its largest errors over the last quarter and their limits, rad."""
    t = run.t
    errors = np.abs(run.signals[[f"{channel}_err" for channel in CHANNELS]].to_numpy())
    residual = errors[t >= LATE * t[-1]].max(axis=0)
    allowed = np.maximum(CONVERGED_PART * errors.max(axis=0), CONVERGED_AT_LEAST)
    return {
        "converges": run.status == "completed"
        and ("along" in run.signals or bool((residual <= allowed).all())),
        "residual": dict(zip(CHANNELS, residual.tolist(), strict=True)),
        "allowed": dict(zip(CHANNELS, allowed.tolist(), strict=True)),
    }


def runs_table(runs: Sequence[Run]) -> Table:
    """End of each run and metrics of the whole flight; runs that did not fly come last."""
    records = [
        {
            "run": run.label,
            "flown_s": run.duration,
            **(flight_metrics(run) if len(run.signals) > 1 else {}),
            "outcome": run.outcome,
        }
        for run in sorted(runs, key=lambda run: len(run.signals) <= 1)
    ]
    layout = columns(f"run flown_s {FLIGHT} outcome")
    return Table(layout, records, "Runs", name="runs", label="run")


def gains_table(gains: Mapping[str, PIGains], curve: pd.DataFrame) -> Table:
    """Gains with their indicators from `curve` (the result of `frontier`)."""
    marks = curve.set_index("name")
    records = [
        {"gains": name, **marks.loc[name, ["R_K", "I_K", "E_K"]].to_dict(), **gain_set.as_lists()}
        for name, gain_set in gains.items()
    ]
    return Table(GAIN_COLUMNS, records, "Gains", name="gains")


def certificates_table(scenario: Scenario, gains: Mapping[str, PIGains]) -> Table:
    """The proven claim of each gain set: ``‖s‖`` decays at half the rate, after its growth."""
    records = []
    for name, gain_set in gains.items():
        proofs = [certify_scenario(scenario, gain_set)]
        if scenario.envelope and scenario.tuning.model == "kinematic":  # ranges of the law
            proofs.append(certify_scenario(scenario, gain_set, envelope=True))
        claim = proofs[0].values
        proven = [proof.certificate for proof in proofs[1:] if proof.certificate]
        records.append(
            {
                "gains": name,
                **{key: claim[key] for key in ("rate", "growth", "radius", "L_d")},
                "checks": len(claim["checks"]),
                "envelope_rate": proven[0].claim.rate if proven else None,
                "reason": "; ".join(filter(None, (proof.reason for proof in proofs))),
                "status": "; ".join({proof.reason or proof.in_words: 0 for proof in proofs}),
            }
        )
    return Table(CERTIFICATE_COLUMNS, records, "Certificates", name="certificates")


def paths_table(runs: Sequence[Run]) -> Table:
    """Largest distance of each aircraft from the first point mass with the same gains."""
    laws = [run for run in runs if run.provenance.aircraft is None]
    first = {
        run.provenance.gains_name: run
        for run in laws
        if run.provenance.plant == laws[0].provenance.plant
    }
    records = []
    for run in runs:
        flight = run.provenance
        law = first.get(flight.gains_name)
        if law is None or flight.aircraft is None:
            continue
        distance, t_farthest = largest_distance(law, run)
        flights = {"gains": flight.gains_name, "from": law.provenance.plant, "to": flight.plant}
        records.append({**flights, "max_distance_m": distance, "max_distance_at_s": t_farthest})
    layout = columns("gains from to max_distance_m max_distance_at_s")
    return Table(layout, records, "Paths", name="aircraft")


def provenance_table(name: str, scenario: Scenario, runs: Sequence[Run]) -> Table:
    """Provenance of the runs from `name`."""
    first = runs[0].provenance
    versions = ", ".join(f"{name} {value}" for name, value in first.versions.items())
    return facts_table(
        "Provenance",
        {
            "runs from": name,
            "scenario, SHA-256": scenario.sha256,
            "seed": str(first.seed),
            "flown with": versions,
            "time to fly": f"{sum(run.provenance.wall_s for run in runs):.2f} s",
            "source of the scenario": scenario.source or MISSING,
        },
    )
