"""Tables of a report: headings and rows as text, ready to be laid out."""

import math

from flighttune.control.gains import PIGains
from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.recording.page import number
from flighttune.report.facts import Facts
from flighttune.report.frame import PageTable
from flighttune.report.headline import DEG, SYMBOLS
from flighttune.scenario.sensors_table import SensorsTable

TRACKED = (
    ("ITAE", "ITAE [rad\u00a0s²]", 1.0, 2),
    ("MO_rad", "overshoot [deg]", DEG, 2),
    ("PT_s", "peak time [s]", 1.0, 2),
    ("rise_s", "rise [s]", 1.0, 2),
    ("settling_s", "settling 5\u00a0% [s]", 1.0, 2),
    ("MS_rad", "mean error, last quarter [deg]", DEG, 3),
    ("ST_rad", "its deviation [deg]", DEG, 3),
    ("saturation_s", "held by limits [s]", 1.0, 2),
)
FLOWN = (
    ("V_a_dev_mps", "airspeed off by [m/s]", 1.0, 2),
    ("n_z_min", "least n_z [1]", 1.0, 2),
    ("n_z_max", "largest n_z [1]", 1.0, 2),
    ("alpha_max_rad", "largest |α| [deg]", DEG, 1),
)


def tracking_table(facts: Facts) -> PageTable:
    """How each run followed its reference, a row a channel."""
    rows, labels = [], []
    for run in facts.runs:
        metrics = channel_metrics(run)
        for channel, symbol in SYMBOLS.items():
            cells = (
                number(float(metrics.at[channel, key]) * factor, digits)
                for key, _, factor, digits in TRACKED
            )
            rows.append((f"{run.label}, {symbol}", *cells))
            labels.append(run.label)
    return PageTable(
        title="Tracking",
        head=("run, channel", *(heading for _, heading, _, _ in TRACKED)),
        rows=tuple(rows),
        label=tuple(labels),
    )


def runs_table(facts: Facts) -> PageTable:
    """How each run ended, and what the whole aircraft did."""
    rows, labels = [], []
    for run in (*facts.runs, *facts.grounded):
        measures = flight_metrics(run) if len(run.signals) > 1 else {}
        cells = (
            number(measures.get(key, math.nan) * factor, digits) for key, _, factor, digits in FLOWN
        )
        ended = run.status.replace("_", " ") + (f": {run.reason}" if run.reason else "")
        rows.append((run.label, f"{run.duration:.2f}", *cells, ended))
        labels.append(run.label)
    head = ("run", "flown [s]", *(heading for _, heading, _, _ in FLOWN), "outcome")
    return PageTable(
        title="Runs", head=head, rows=tuple(rows), label=tuple(labels), ends_in_words=True
    )


def gains_table(facts: Facts) -> PageTable:
    """Gains with the rate certified at the trim and over the envelope."""
    marks = facts.frontier.set_index("name")
    rows = []
    for one in facts.gains:
        certificate = one.trim.certificate
        over = None if one.envelope is None else one.envelope.certificate
        rows.append(
            (
                one.name,
                number(float(marks.at[one.name, "R_K"]), 4),
                number(float(marks.at[one.name, "I_K"]), 4),
                "refused" if certificate is None else number(certificate.claim.rate, 4),
                "–" if one.envelope is None else "refused" if over is None
                else number(over.claim.rate, 4),
                *_matrices(one.gains),
            )
        )  # fmt: skip
    head = (
        "gains", "R_K [1/s]", "I_K [s²]", "proven at trim [1/s]", "over envelope [1/s]",
        "K_P, rows φ n_z, columns χ γ", "K_I [1/s]",
    )  # fmt: skip
    return PageTable(title="Gains", head=head, rows=tuple(rows), label=("",) * len(rows))


def gap_table(facts: Facts) -> PageTable:
    """ITAE from the paper's law to the aircraft, step by step."""
    rows, labels = [], []
    for gap in facts.gaps:
        law = gap.ladder.known_metrics(gap.ladder.runs[0])["ITAE"].to_dict()
        for channel, symbol in SYMBOLS.items():
            steps = [float(s.metrics["ITAE"].to_dict()[channel]) for s in gap.ladder.steps]
            first = float(law[channel])
            name = f"{gap.name}, {symbol}"
            parts = (f"{step:+.2f}" if math.isfinite(step) else "–" for step in steps)
            rows.append((name, number(first, 2), *parts, number(first + sum(steps), 2)))
            labels.append(gap.run.label)
    steps = facts.gaps[0].ladder.steps if facts.gaps else ()
    head = ("gains, channel", "paper's law", *(f"+ {step.adds}" for step in steps), "aircraft")
    return PageTable(
        title="ITAE [rad\u00a0s²], step by step", head=head, rows=tuple(rows), label=tuple(labels)
    )


def provenance_table(facts: Facts) -> PageTable:
    """What made the runs."""
    made = facts.runs[0].provenance
    versions = ", ".join(f"{name} {value}" for name, value in made.versions.items())
    rows = (
        ("runs from", facts.name),
        ("scenario, SHA-256", facts.scenario.sha256),
        ("seed", str(made.seed)),
        *_sensors(facts.scenario.sensors),
        ("flown with", versions),
        ("time to fly", f"{sum(run.provenance.wall_s for run in facts.runs):.2f} s"),
        ("source of the scenario", facts.scenario.source or "–"),
    )
    return PageTable(title="Provenance", head=("what", "value"), rows=rows, label=("",) * len(rows))


def _sensors(table: SensorsTable | None) -> list[tuple[str, str]]:
    """What the controller saw in place of the true signals; empty without sensors."""
    if table is None:
        return []
    signals = (
        ("χ", table.chi_bias_deg, table.chi_noise_sd_deg, "°"),
        ("γ", table.gamma_bias_deg, table.gamma_noise_sd_deg, "°"),
        ("V_a", table.V_a_bias_mps, table.V_a_noise_sd_mps, " m/s"),
    )
    biases = [f"{symbol} {bias:+g}{unit}" for symbol, bias, _, unit in signals if bias]
    noises = [f"{symbol} {sd:g}{unit}" for symbol, _, sd, unit in signals if sd]
    lasts = table.noise_time_constant_s
    colour = "white" if lasts is None else f"time constant {lasts:g} s"
    told = [
        f"bias of {', '.join(biases)}" if biases else "no bias",
        f"noise, standard deviation {', '.join(noises)}, {colour}" if noises else "no noise",
    ]
    return [("sensors of the controller", "; ".join(told))]


def _matrices(gains: PIGains) -> tuple[str, str]:
    shown = [
        "[" + "; ".join(", ".join(f"{value:z.4f}" for value in row) for row in matrix) + "]"
        for matrix in (gains.K_P, gains.K_I)
    ]
    return shown[0], shown[1]
