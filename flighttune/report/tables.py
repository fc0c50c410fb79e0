"""Tables of a report: headings and rows as text, ready to be laid out."""

import math
from collections.abc import Iterable, Sequence

from flighttune.flight.gap import Gap
from flighttune.flight.ladder import rung_metrics
from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.present.names import CHANNEL_SYMBOLS, METRIC_LABELS
from flighttune.present.numbers import MISSING, matrix, number
from flighttune.present.tables import Table
from flighttune.report.facts import Facts
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import SensorsTable
from flighttune.simulate.run import Run

TRACKING = ("ITAE", "MO_rad", "PT_s", "rise_s", "settling_s", "MS_rad", "ST_rad", "saturation_s")
FLIGHT = ("V_a_dev_mps", "n_z_min", "n_z_max", "alpha_max_rad")
GAINS_HEAD = (
    "gains",
    "R_K [1/s]",
    "I_K [s²]",
    "proven at trim [1/s]",
    "over envelope [1/s]",
    "K_P, rows φ n_z, columns χ γ",
    "K_I [1/s]",
)


def tracking_table(facts: Facts) -> Table:
    """How each run followed its reference, a row a channel."""
    rows, labels = [], []
    for run in facts.runs:
        for channel, metrics in channel_metrics(run).to_dict(orient="index").items():
            cells = (METRIC_LABELS[key].text(float(metrics[key])) for key in TRACKING)
            rows.append((f"{run.label}, {CHANNEL_SYMBOLS[str(channel)]}", *cells))
            labels.append(run.label)
    head = ("run, channel", *_headings(TRACKING))
    return Table(title="Tracking", head=head, rows=rows, labels=labels)


def runs_table(facts: Facts) -> Table:
    """How each run ended, and what the whole aircraft did."""
    runs = (*facts.runs, *facts.grounded)
    rows = []
    for run in runs:
        metrics = flight_metrics(run) if len(run.signals) > 1 else {}
        cells = (METRIC_LABELS[key].text(metrics.get(key, math.nan)) for key in FLIGHT)
        rows.append((run.label, f"{run.duration:.2f}", *cells, run.outcome))
    head = ("run", "flown [s]", *_headings(FLIGHT), "outcome")
    labels = [run.label for run in runs]
    return Table(title="Runs", head=head, rows=rows, labels=labels, last_is_text=True)


def gains_table(facts: Facts) -> Table:
    """Gains with the rate certified at the trim and over the envelope."""
    marks = facts.frontier.set_index("name")
    rows = []
    for one in facts.gains:
        indicators = (number(float(marks.at[one.name, key]), "z.4f") for key in ("R_K", "I_K"))
        proven = (
            MISSING
            if found is None
            else "refused"
            if found.certificate is None
            else number(found.certificate.claim.rate, "z.4f")
            for found in (one.trim, one.envelope)
        )
        matrices = matrix(one.gains.K_P), matrix(one.gains.K_I)
        rows.append((one.name, *indicators, *proven, *matrices))
    return Table(title="Gains", head=GAINS_HEAD, rows=rows)


def gap_table(gaps: Sequence[Gap]) -> Table:
    """ITAE from the paper's law to the aircraft, step by step."""
    rows, labels = [], []
    for gap in gaps:
        law = rung_metrics(gap.runs[0])["ITAE"].to_dict()
        for channel, symbol in CHANNEL_SYMBOLS.items():
            steps = [float(step.metrics["ITAE"].to_dict()[channel]) for step in gap.steps]
            first = float(law[channel])
            cells = [number(first, "z.2f"), *(number(step, "+.2f") for step in steps)]
            rows.append((f"{gap.name}, {symbol}", *cells, number(first + sum(steps), "z.2f")))
            labels.append(gap.aircraft.label)
    steps = gaps[0].steps if gaps else ()
    head = ("gains, channel", "paper's law", *(f"+ {step.adds}" for step in steps), "aircraft")
    title = "ITAE [rad\u00a0s²], step by step"
    return Table(title=title, head=head, rows=rows, labels=labels)


def provenance_table(name: str, scenario: Scenario, flown: Sequence[Run]) -> Table:
    """What made the runs, which come from `name`."""
    made = flown[0].provenance
    versions = ", ".join(f"{name} {value}" for name, value in made.versions.items())
    rows = [
        ("runs from", name),
        ("scenario, SHA-256", scenario.sha256),
        ("seed", str(made.seed)),
        *_sensors(scenario.sensors),
        ("flown with", versions),
        ("time to fly", f"{sum(run.provenance.wall_s for run in flown):.2f} s"),
        ("source of the scenario", scenario.source or MISSING),
    ]
    return Table(title="Provenance", head=("what", "value"), rows=rows)


def _headings(metrics: Iterable[str]) -> list[str]:
    return [METRIC_LABELS[key].heading for key in metrics]


def _sensors(table: SensorsTable | None) -> list[tuple[str, str]]:
    """Errors of the sensors that the controller read; empty without sensors."""
    if table is None:
        return []
    signals = (
        ("χ", table.chi_bias_deg, table.chi_noise_sd_deg, "°"),
        ("γ", table.gamma_bias_deg, table.gamma_noise_sd_deg, "°"),
        ("V_a", table.V_a_bias_mps, table.V_a_noise_sd_mps, " m/s"),
    )
    biases = [f"{symbol} {bias:+g}{unit}" for symbol, bias, _, unit in signals if bias]
    noises = [f"{symbol} {sd:g}{unit}" for symbol, _, sd, unit in signals if sd]
    tau = table.noise_time_constant_s
    colour = "white" if tau is None else f"time constant {tau:g} s"
    bias = f"bias of {', '.join(biases)}" if biases else "no bias"
    noise = f"noise, standard deviation {', '.join(noises)}, {colour}" if noises else "no noise"
    return [("sensors of the controller", f"{bias}; {noise}")]
