"""Tables of a report."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flighttune.comparison.compare import SHOWN, comparison_table
from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.present.names import CHANNEL_SYMBOLS, columns
from flighttune.present.numbers import MISSING, matrix
from flighttune.present.tables import Column, Table, facts_table
from flighttune.report.facts import Facts, GainFacts
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import SensorsTable
from flighttune.simulate.run import Run
from flighttune.units import DEG_PER_RAD

TRACKING = "ITAE MO_rad PT_s rise_s settling_s MS_rad ST_rad saturation_s"
FLIGHT = "V_a_dev_mps n_z_min n_z_max alpha_max_rad"

TRACKING_COLUMNS = columns(f"run channel {TRACKING}")
CONVERGENCE_COLUMNS = [
    *columns("run converges"),
    *(
        Column(f"{key}.{channel}", f"{name} {symbol}", "deg", ".2g", DEG_PER_RAD)
        for channel, symbol in CHANNEL_SYMBOLS.items()
        for key, name in (("residual", "largest late error"), ("allowed", "limit"))
    ),
]
RUN_COLUMNS = columns(f"run flown_s {FLIGHT} outcome")
GAIN_COLUMNS = [
    *columns("gains R_K I_K"),
    Column("K_P", "K_P, rows φ n_z, columns χ γ"),
    Column("K_I", "K_I", "1/s"),
]
CERTIFICATE_COLUMNS = [
    *columns("gains"),
    Column("rate", "proven at trim", "1/s"),
    *columns("growth radius L_d checks"),
    Column("envelope_rate", "proven over envelope", "1/s"),
    Column("reason", "refused"),
]
KEPT_COLUMNS = [
    *columns("run"),
    Column("kept", "‖s‖ below its bound", good=("yes",)),
    Column("t_broken", "exceeded from", "s"),
]
PAIR_COLUMNS = columns("gains from to max_distance_m max_distance_at_s")


def tracking_table(facts: Facts) -> Table:
    """Tracking of the reference by each run, a row per channel."""
    records = [
        {"run": run.label, "channel": CHANNEL_SYMBOLS[str(channel)], **metrics}
        for run in facts.runs
        for channel, metrics in channel_metrics(run).to_dict(orient="index").items()
    ]
    return _by_run("tracking", "Tracking", TRACKING_COLUMNS, records)


def convergence_table(facts: Facts) -> Table:
    """Largest errors over the last quarter of each flight, and their limits."""
    records = []
    for run in facts.runs:
        late = facts.final_errors[run.label]
        records.append(
            {
                "run": run.label,
                "converges": late.converged,
                "residual": dict(zip(CHANNEL_SYMBOLS, late.residual, strict=True)),
                "allowed": dict(zip(CHANNEL_SYMBOLS, late.allowed, strict=True)),
            }
        )
    records += [{"run": run.label, "converges": False} for run in facts.grounded]
    return _by_run("convergence", "Convergence", CONVERGENCE_COLUMNS, records)


def runs_table(facts: Facts) -> Table:
    """End of each run, and metrics of the whole flight."""
    records = [
        {
            "run": run.label,
            "flown_s": run.duration,
            **(flight_metrics(run) if len(run.signals) > 1 else {}),
            "outcome": run.outcome,
        }
        for run in (*facts.runs, *facts.grounded)
    ]
    return _by_run("runs", "Runs", RUN_COLUMNS, records)


def gains_table(facts: Facts) -> Table:
    """Gains with their indicators."""
    marks = facts.frontier.set_index("name")
    records = [
        {
            "gains": gain_set.name,
            "R_K": float(marks.at[gain_set.name, "R_K"]),
            "I_K": float(marks.at[gain_set.name, "I_K"]),
            "K_P": matrix(gain_set.gains.K_P),
            "K_I": matrix(gain_set.gains.K_I),
        }
        for gain_set in facts.gains
    ]
    return Table(title="Gains", name="gains", columns=GAIN_COLUMNS, records=records)


def certificates_table(facts: Facts) -> Table:
    """The proven claim of each gain set: ``‖s‖`` decays at half the rate, after its growth."""
    records = [_certificate(gain_set) for gain_set in facts.gains]
    return Table(
        title="Certificates", name="certificates", columns=CERTIFICATE_COLUMNS, records=records
    )


def _certificate(gain_set: GainFacts) -> dict[str, Any]:
    trim, envelope = gain_set.trim, gain_set.envelope
    refused = [made.reason for made in (trim, envelope) if made and made.certificate is None]
    values: dict[str, Any] = {"gains": gain_set.name, "reason": "; ".join(refused)}
    if trim.certificate is not None:
        claim = trim.certificate.claim
        values |= {
            "rate": claim.rate,
            "growth": math.sqrt(float(np.linalg.cond(trim.certificate.Q))),
            "radius": claim.radius,
            "L_d": claim.L_d,
            "checks": len(trim.verification.checks) if trim.verification else 0,
        }
    if envelope is not None and envelope.certificate is not None:
        values["envelope_rate"] = envelope.certificate.claim.rate
    return values


def kept_table(facts: Facts) -> Table:
    """Whether ``‖s‖`` stayed below its guaranteed bound in flight."""
    records = [
        {
            "run": label,
            # a command that is limited to the end leaves nothing to compare
            "kept": check.t_broken is None if np.isfinite(check.bound).any() else None,
            "t_broken": check.t_broken,
        }
        for label, check in facts.checks.items()
    ]
    return _by_run("kept", "Certificates in flight", KEPT_COLUMNS, records)


def aircraft_tables(facts: Facts) -> list[Table]:
    """The first aircraft against the first plant that is none: paths and metrics."""
    if facts.aircraft is None:
        return []
    pairs = [
        {
            "gains": pair.a.provenance.gains_name,
            "from": pair.a.provenance.plant,
            "to": pair.b.provenance.plant,
            "max_distance_m": pair.max_distance,
            "max_distance_at_s": pair.t_max_distance,
        }
        for pair in facts.aircraft.pairs
    ]
    metrics = facts.aircraft.metrics
    return [
        Table(title="Paths", name="aircraft", columns=PAIR_COLUMNS, records=pairs),
        comparison_table("Law (A) and aircraft (B)", metrics[metrics["name"].isin(SHOWN)]),
    ]


def provenance_table(name: str, scenario: Scenario, flown: Sequence[Run]) -> Table:
    """Provenance of the runs from `name`."""
    made = flown[0].provenance
    versions = ", ".join(f"{name} {value}" for name, value in made.versions.items())
    return facts_table(
        "Provenance",
        {
            "runs from": name,
            "scenario, SHA-256": scenario.sha256,
            "seed": str(made.seed),
            **_sensors(scenario.sensors),
            "flown with": versions,
            "time to fly": f"{sum(run.provenance.wall_s for run in flown):.2f} s",
            "source of the scenario": scenario.source or MISSING,
        },
    )


def _by_run(
    name: str, title: str, shown: Sequence[Column], records: Sequence[Mapping[str, Any]]
) -> Table:
    return Table(title=title, name=name, columns=shown, records=records, label="run")


def _sensors(table: SensorsTable | None) -> dict[str, str]:
    """Errors of the sensors that the controller read; empty without sensors."""
    if table is None:
        return {}
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
    return {"sensors of the controller": f"{bias}; {noise}"}
