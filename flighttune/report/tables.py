"""Tables of a report."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flighttune.comparison.compare import largest_distance
from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.present.names import CHANNEL_SYMBOLS, columns
from flighttune.present.numbers import MISSING, matrix
from flighttune.present.tables import Column, Table, facts_table
from flighttune.report.certified import certification_values
from flighttune.report.facts import Facts, GainFacts
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run
from flighttune.units import DEG_PER_RAD

TRACKING = "ITAE_mean MO_rad PT_s rise_s MS_rad ST_rad effort_rms saturation_s"
FLIGHT = "V_a_dev_mps n_z_min n_z_max alpha_max_rad"

CONVERGENCE_COLUMNS = [
    *columns("run converges chi.ITAE gamma.ITAE chi.settling_s gamma.settling_s"),
    *(
        Column(f"{key}.{channel}", f"{name} {symbol}", "deg", ".2g", DEG_PER_RAD)
        for channel, symbol in CHANNEL_SYMBOLS.items()
        for key, name in (("residual", "late error"), ("allowed", "limit"))
    ),
]
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
    Column("kept", "‖s‖ below its bound"),
    Column("t_broken", "exceeded from", "s"),
]


def tracking_table(facts: Facts) -> Table:
    """Tracking of the reference by each run, a row per channel."""
    records = [
        {"run": run.label, "channel": CHANNEL_SYMBOLS[str(channel)], **metrics}
        for run in facts.runs
        for channel, metrics in channel_metrics(run).to_dict(orient="index").items()
    ]
    return _by_run("tracking", "Tracking", columns(f"run channel {TRACKING}"), records)


def convergence_table(facts: Facts) -> Table:
    """Whether each run converges: largest errors over its last quarter, their limits, and ITAE."""
    records = [
        {
            "run": run.label,
            **facts.convergence[run.label],
            **channel_metrics(run)[["ITAE", "settling_s"]].to_dict(orient="index"),
        }
        for run in facts.runs
    ]
    records += [{"run": run.label, "converges": False} for run in facts.grounded]
    return _by_run("convergence", "", CONVERGENCE_COLUMNS, records)


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
    return _by_run("runs", "Runs", columns(f"run flown_s {FLIGHT} outcome"), records)


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

    def record(gain_set: GainFacts) -> dict[str, Any]:
        trim, envelope = gain_set.trim, gain_set.envelope
        own = certification_values(trim)
        reasons = [made.reason for made in (trim, envelope) if made and made.reason]
        proven = envelope.certificate if envelope else None
        return {
            "gains": gain_set.name,
            **{key: own[key] for key in ("rate", "growth", "radius", "L_d")},
            "checks": len(own["checks"]),
            "envelope_rate": proven.claim.rate if proven else None,
            "reason": "; ".join(reasons),
        }

    return Table(
        title="Certificates",
        name="certificates",
        columns=CERTIFICATE_COLUMNS,
        records=[record(gain_set) for gain_set in facts.gains],
    )


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


def paths_table(facts: Facts) -> Table:
    """Largest distance of each aircraft from the first plant that is none, with the same gains."""
    laws = [run for run in facts.runs if run.provenance.aircraft is None]
    first = {
        run.provenance.gains_name: run
        for run in laws
        if run.provenance.plant == laws[0].provenance.plant
    }
    records = []
    for run in facts.runs:
        law = first.get(run.provenance.gains_name)
        if law is None or run.provenance.aircraft is None:
            continue
        distance, at = largest_distance(law, run)
        records.append(
            {
                "gains": run.provenance.gains_name,
                "from": law.provenance.plant,
                "to": run.provenance.plant,
                "max_distance_m": distance,
                "max_distance_at_s": at,
            }
        )
    shown = columns("gains from to max_distance_m max_distance_at_s")
    return Table(title="Paths", name="aircraft", columns=shown, records=records)


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
            "flown with": versions,
            "time to fly": f"{sum(run.provenance.wall_s for run in flown):.2f} s",
            "source of the scenario": scenario.source or MISSING,
        },
    )


def _by_run(
    name: str, title: str, shown: Sequence[Column], records: Sequence[Mapping[str, Any]]
) -> Table:
    return Table(title=title, name=name, columns=shown, records=records, label="run")
