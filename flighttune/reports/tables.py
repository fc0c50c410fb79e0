"""Tables of a report."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flighttune.control.gains import PIGains
from flighttune.flight.expectations import ClaimCheck
from flighttune.flight.gains import certify_scenario
from flighttune.metrics import CHANNELS, channel_metrics, flight_metrics
from flighttune.present.answer import MISSING, Column, Table, facts_table
from flighttune.present.names import CHANNEL_SYMBOLS, columns
from flighttune.records.compare import largest_distance
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run
from flighttune.units import DEG_PER_RAD

if TYPE_CHECKING:
    import pandas as pd

# An error has converged where, over the last quarter of the flight, it stays within 5 % of its
# largest or within 0.5 deg.
CONVERGED_PART = 0.05
CONVERGED_AT_LEAST = np.deg2rad(0.5)

# Part of the flight after which its last quarter begins.
LATE = 0.75

TRACKING = "ITAE_mean MO_rad PT_s rise_s MS_rad ST_rad effort_rms saturation_s"
FLIGHT = "V_a_dev_mps n_z_min n_z_max alpha_max_rad cross_track_m height_err_m"

CONVERGENCE_COLUMNS = [
    *columns("run flight requirements chi.ITAE gamma.ITAE"),
    *(
        column
        for channel, symbol in CHANNEL_SYMBOLS.items()
        for column in (
            Column(f"{channel}.settling_s", f"settles {symbol}", "s", "z.2f"),
            Column(f"residual.{channel}", f"late error {symbol}", "deg", ".2g", DEG_PER_RAD),
            Column(f"allowed.{channel}", f"limit {symbol}", "deg", ".2g", DEG_PER_RAD),
        )
    ),
]
ROUTE_COLUMNS = columns("run flight requirements cross_track_m height_err_m V_a_dev_mps")
GAIN_COLUMNS = [
    *columns("gains R_K I_K E_K"),
    Column("K_P", "K_P, rows φ n_z, columns χ γ"),
    Column("K_I", "K_I", "1/s"),
]
CERTIFICATE_COLUMNS = [
    *columns("gains"),
    Column("rate", "proven at trim", "1/s"),
    *columns("growth radius L_d checks"),
    Column("envelope_rate", "proven over envelope", "1/s"),
    Column("status", "status"),
]


def tracking_table(runs: Sequence[Run]) -> Table:
    """Tracking of the reference by each run, a row per channel."""
    records = [
        {"run": run.label, "channel": CHANNEL_SYMBOLS[str(channel)], **metrics}
        for run in runs
        for channel, metrics in channel_metrics(run).to_dict(orient="index").items()
    ]
    return _by_run("tracking", "Tracking", columns(f"run channel {TRACKING}"), records)


def by_plant(counts: Iterable[tuple[str, int, int]]) -> str:
    """Successes and flights of each plant, such as ``kinematic 2/2``, law and aircraft apart."""
    sums: dict[str, tuple[int, int]] = {}
    for plant, successes, n in counts:
        before = sums.get(plant, (0, 0))
        sums[plant] = before[0] + successes, before[1] + n
    return ", ".join(f"{plant} {successes}/{n}" for plant, (successes, n) in sums.items())


def convergence_table(runs: Sequence[Run], claim: ClaimCheck) -> Table:
    """How each run ended: requirements met, ITAE, largest errors of the last quarter and limits."""
    records = []
    for run, (n, met, not_flown) in zip(runs, claim.counts, strict=True):
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
    on_route = any("along" in run.signals for run in runs)
    layout = ROUTE_COLUMNS if on_route else CONVERGENCE_COLUMNS
    return _by_run("convergence", "", layout, records)


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
    """End of each run, those that did not fly last, and metrics of the whole flight."""
    records = [
        {
            "run": run.label,
            "flown_s": run.duration,
            **(flight_metrics(run) if len(run.signals) > 1 else {}),
            "outcome": run.outcome,
        }
        for run in sorted(runs, key=lambda run: len(run.signals) <= 1)
    ]
    return _by_run("runs", "Runs", columns(f"run flown_s {FLIGHT} outcome"), records)


def gains_table(gains: Mapping[str, PIGains], curve: "pd.DataFrame") -> Table:
    """Gains with their indicators, which `curve` (from `frontier`) has."""
    marks = curve.set_index("name")
    records = [
        {"gains": name, **marks.loc[name, ["R_K", "I_K", "E_K"]].to_dict(), **gain_set.as_lists()}
        for name, gain_set in gains.items()
    ]
    return Table(title="Gains", name="gains", columns=GAIN_COLUMNS, records=records)


def certificates_table(scenario: Scenario, gains: Mapping[str, PIGains]) -> Table:
    """The proven claim of each gain set: ``‖s‖`` decays at half the rate, after its growth."""
    records = []
    for name, gain_set in gains.items():
        trim, envelope = certify_scenario(scenario, gain_set), None
        if scenario.envelope and scenario.tuning.model == "kinematic":  # the law's ranges
            envelope = certify_scenario(scenario, gain_set, envelope=True)
        claim = trim.values
        proven = envelope.certificate if envelope else None
        proofs = list(filter(None, (trim, envelope)))
        records.append(
            {
                "gains": name,
                **{key: claim[key] for key in ("rate", "growth", "radius", "L_d")},
                "checks": len(claim["checks"]),
                "envelope_rate": proven.claim.rate if proven else None,
                "reason": "; ".join(filter(None, (proof.reason for proof in proofs))),
                "status": "; ".join({proof.reason or proof.in_words: 0 for proof in proofs}),
            }
        )
    return Table(CERTIFICATE_COLUMNS, records, "Certificates", name="certificates")


def paths_table(runs: Sequence[Run]) -> Table:
    """Largest distance of each aircraft from the first plant that is none, with the same gains."""
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
    return Table(title="Paths", name="aircraft", columns=layout, records=records)


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


def _by_run(
    name: str, title: str, layout: Sequence[Column], records: Sequence[Mapping[str, Any]]
) -> Table:
    return Table(title=title, name=name, columns=layout, records=records, label="run")
