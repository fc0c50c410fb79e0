"""The findings of a campaign as plain values, for ``--json`` and for tables."""

from dataclasses import asdict
from typing import Any

from flighttune.campaign.statistics.findings import SUCCESS, Findings
from flighttune.campaign.statistics.flights import worst_first
from flighttune.campaign.statistics.intervals import Estimate
from flighttune.campaign.statistics.summary import CertifiedCount, GroupSummary, Reason, Spread
from flighttune.guarantee.ultimate_set import UltimateSet
from flighttune.units import DEG

WORST = 5
"""Worst flights of a group."""


def findings_values(findings: Findings) -> dict[str, Any]:
    """Findings as plain values, shares between 0 and 1, units as in the columns."""
    flown = findings.flights
    return {
        "dataset": flown.url,
        "title": flown.plan.campaign.title,
        "runs": len(flown.rows),
        "planned": flown.plan.runs,
        "design": flown.plan.campaign.design,
        "interval": flown.method,
        "confidence": flown.confidence,
        "worst_by": findings.measure,
        "groups": [
            {
                **_group(group, findings.claims.get(group.group)),
                "worst": _worst(findings, group),
                "sensitivity": _sensitivity(findings, group),
            }
            for group in findings.groups
        ],
        "paired": [asdict(pair) for pair in findings.paired],
    }


def _group(group: GroupSummary, claim: UltimateSet | None) -> dict[str, Any]:
    return {
        "group": group.group.label,
        "gains": group.group.gains,
        "plant": group.group.plant,
        "n": group.n,
        "success": group.success.value,
        "lo": group.success.lo,
        "hi": group.success.hi,
        "successes": group.successes,
        "statuses": {status.status: status.count for status in group.statuses},
        "reasons": [
            {"status": status.status, **_reason(why)}
            for status in group.statuses
            for why in status.reasons
        ],
        "missed": [_reason(why) for why in group.missed],
        "certified": None if group.certified is None else _certified(group.certified, claim),
        "metrics": {name: _spread(spread) for name, spread in group.measures.items()},
    }


def _worst(findings: Findings, group: GroupSummary) -> list[dict[str, Any]]:
    """The worst completed flights, with all that was drawn."""
    if findings.measure is None:
        return []
    rows = next(rows for of, rows in findings.flights.groups() if of == group.group)
    return [
        {
            "run": flight["run"],
            "draw": flight["draw"],
            findings.measure: flight[findings.measure],
            "success": flight["success"],
            "parameters": {key: flight[key] for key in findings.flights.keys},
        }
        for flight in worst_first(rows, findings.measure, WORST).to_dict("records")
    ]


def _sensitivity(findings: Findings, group: GroupSummary) -> dict[str, Any]:
    by_measure = {}
    for name in (SUCCESS, findings.measure):
        if name is None:
            continue
        indices = findings.sobol.get((group.group, name))
        by_measure[name] = {
            "ranks": [asdict(influence) for influence in findings.influences[group.group, name]],
            "sobol": None
            if indices is None
            else {
                factor: {
                    "first": indices.first[:, i].tolist(),
                    "total": indices.total[:, i].tolist(),
                    "blocks": indices.n,
                }
                for i, factor in enumerate(findings.flights.plan.factors)
            },
        }
    return by_measure


def _reason(reason: Reason) -> dict[str, Any]:
    return {"reason": reason.text, "count": reason.count, "run": reason.run}


def _spread(spread: Spread) -> dict[str, Any]:
    values = {name: estimate.value for name, estimate in spread.percentiles.items()}
    intervals = {f"{name}_interval": _interval(e) for name, e in spread.percentiles.items()}
    return {**values, "mean": spread.mean, "n": spread.n, **intervals}


def _certified(count: CertifiedCount, claim: UltimateSet | None) -> dict[str, Any]:
    bound: dict[str, Any] = {}
    if claim is not None:
        bound = {
            "L_d_rad_s2": claim.L_d,
            "from_s": claim.t_from,
            "tube_deg": [width / DEG for width in claim.tube],
            "says_nothing": claim.vacuous,
        }
    return {
        **bound,
        "held": count.held,
        "broken": count.broken,
        "not_entered": count.not_entered,
        "lost": count.lost,
        "rate": count.of_all.value,
        "interval": _interval(count.of_all),
        "rate_of_entered": count.of_entered.value,
        "interval_of_entered": _interval(count.of_entered),
    }


def _interval(estimate: Estimate) -> list[float]:
    return [estimate.lo, estimate.hi]
