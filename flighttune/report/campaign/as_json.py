"""The findings of a campaign as plain values."""

from dataclasses import asdict
from typing import Any

from flighttune.campaign.statistics.findings import SUCCESS, Findings
from flighttune.campaign.statistics.flights import worst_first
from flighttune.campaign.statistics.intervals import Estimate
from flighttune.campaign.statistics.summary import CertifiedCount, GroupSummary, Reason, Spread
from flighttune.guarantee.ultimate_set import UltimateSet
from flighttune.units import DEG

WORST = 5


def findings_json(found: Findings) -> dict[str, Any]:
    """Findings as one object of plain values, shares between 0 and 1, units as in the columns."""
    flown = found.flights
    return {
        "dataset": flown.url,
        "title": flown.plan.campaign.title,
        "runs": len(flown.rows),
        "planned": flown.plan.runs,
        "design": flown.plan.campaign.design,
        "interval": flown.method,
        "confidence": flown.confidence,
        "worst_by": found.measure,
        "groups": [
            {
                **_group(one, found.claims.get(one.group)),
                **_flights(found, one),
                **_matters(found, one),
            }
            for one in found.groups
        ],
        "paired": [asdict(one) for one in found.paired],
    }


def _group(one: GroupSummary, claim: UltimateSet | None) -> dict[str, Any]:
    return {
        "gains": one.group.gains,
        "plant": one.group.plant,
        "n": one.n,
        "success": one.success.value,
        "lo": one.success.lo,
        "hi": one.success.hi,
        "successes": one.successes,
        "statuses": {status.status: status.count for status in one.statuses},
        "reasons": [
            {"status": status.status, **_reason(why)}
            for status in one.statuses
            for why in status.reasons
        ],
        "missed": [_reason(why) for why in one.missed],
        "certified": None if one.certified is None else _certified(one.certified, claim),
        "metrics": {name: _spread(spread) for name, spread in one.measures.items()},
    }


def _flights(found: Findings, one: GroupSummary) -> dict[str, Any]:
    """The worst completed flights, with all that was drawn."""
    if found.measure is None:
        return {"worst": []}
    rows = next(rows for group, rows in found.flights.groups() if group == one.group)
    return {
        "worst": [
            {
                "run": flight["run"],
                "draw": flight["draw"],
                found.measure: flight[found.measure],
                "success": flight["success"],
                "parameters": {key: flight[key] for key in found.flights.keys},
            }
            for flight in worst_first(rows, found.measure, WORST).to_dict("records")
        ]
    }


def _matters(found: Findings, one: GroupSummary) -> dict[str, Any]:
    by_measure = {}
    for name in (SUCCESS, found.measure):
        if name is None:
            continue
        indices = found.sobol.get((one.group, name))
        by_measure[name] = {
            "ranks": [asdict(influence) for influence in found.influences[one.group, name]],
            "sobol": None
            if indices is None
            else {
                factor: {
                    "first": indices.first[:, i].tolist(),
                    "total": indices.total[:, i].tolist(),
                }
                for i, factor in enumerate(found.flights.plan.factors)
            },
        }
    return {"sensitivity": by_measure}


def _reason(one: Reason) -> dict[str, Any]:
    return {"reason": one.text, "count": one.count, "run": one.run}


def _spread(one: Spread) -> dict[str, Any]:
    values = {name: estimate.value for name, estimate in one.percentiles.items()}
    intervals = {f"{name}_interval": _interval(e) for name, e in one.percentiles.items()}
    return {**values, "mean": one.mean, "n": one.n, **intervals}


def _certified(one: CertifiedCount, claim: UltimateSet | None) -> dict[str, Any]:
    answer: dict[str, Any] = {}
    if claim is not None:
        answer = {
            "L_d_rad_s2": claim.L_d,
            "from_s": claim.t_from,
            "tube_deg": [width / DEG for width in claim.tube],
            "says_nothing": claim.vacuous,
        }
    return {
        **answer,
        "held": one.held,
        "broken": one.broken,
        "not_entered": one.not_entered,
        "lost": one.lost,
        "rate": one.of_all.value,
        "interval": _interval(one.of_all),
        "rate_of_entered": one.of_entered.value,
        "interval_of_entered": _interval(one.of_entered),
    }


def _interval(one: Estimate) -> list[float]:
    return [one.lo, one.hi]
