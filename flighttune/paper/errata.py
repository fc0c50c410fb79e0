"""Disagreements of the paper's print with computation, and its slips.

The text is in ``errata.toml``; `numbers` computes what its braces name.
"""

import math
import tomllib
from pathlib import Path
from typing import Any

from flighttune.control.linear_model import closed_loop, disturbance_entry
from flighttune.paper import parameters as printed
from flighttune.paper.flight import initial_commands, largest_share
from flighttune.paper.parameters import STAR
from flighttune.paper.study import Study
from flighttune.present.tables import Column, Table
from flighttune.theory.attractor import invariant_ellipsoid, paper_balls

COLUMNS = {"where": "where", "printed": "printed", "holds": "what holds"}

TEXT = Path(__file__).with_name("errata.toml")

HEAD = """# Errata of arXiv 2411.13140

“Robust Convergency Indicator using MIMO-PI Controller in the presence of disturbances.” Where print
and computation disagree, both are given. `flighttune reproduce` makes this file anew from the
printed parameters.
"""


def errata(study: Study) -> list[Table]:
    """All errata by part, in the order of ``errata.toml``: where, what is printed, what holds."""
    named = numbers(study)
    tables = []
    for part, entries in tomllib.loads(TEXT.read_text(encoding="utf-8")).items():
        records = [
            {key: entry[key].format(**named) for key in COLUMNS}
            for entry in entries
            if named.get(entry.get("only_if"), True)
        ]
        shown = [Column(key, heading) for key, heading in COLUMNS.items()]
        tables.append(Table(title=part, columns=shown, records=records))
    return tables


def numbers(study: Study) -> dict[str, Any]:
    """Every name that stands in braces, or after ``only_if``, in ``errata.toml``."""
    star, flight, duffing = study.indicators[STAR], study.flights[STAR], study.duffing
    _, rate_limited, anti_windup, unlimited = study.readings.values()
    rate_bound = printed.disturbance(printed.PRINTED_DISTURBANCE).rate_bound
    n_z_trim = math.cos(printed.GAMMA_C)
    A_K = closed_loop(study.model, study.star)
    named = {
        "printed": printed,
        "star": star,
        "optimum": study.optimum,
        "constrained": study.constrained,
        "use": initial_commands(study.star),
        "largest_use": largest_share(study.star),
        "peak_time": {channel: flight.peak(channel)[1] for channel in ("chi", "gamma")},
        "rate_limited_error": max(rate_limited.after(name, 18.0) for name in ("chi", "gamma")),
        "anti_windup_overshoot": anti_windup.peak("chi")[0],
        "growth_of_ST": max(study.growth_of_ST(channel) for channel in ("s_chi", "s_gamma")),
        "norm_decay": star.R_K / 2.0,
        "duffing": duffing,
        "constant_push": duffing.hard["constant L_d"],
        "unlimited_diverges": unlimited.status == "diverged",
        "unlimited_end": unlimited.t[-1],
        "n_z_trim": n_z_trim,
        "gamma_rate": printed.G / printed.V_A * (n_z_trim - n_z_trim / printed.G),
        "phi_0_deg": math.degrees(printed.PHI_0),
        "rate_bound": rate_bound,
        "stable": star.status == "stable",
    }
    if named["stable"]:  # an unstable loop has neither a ball nor an ellipsoid
        named["balls"] = paper_balls(A_K, study.model.A, I_K=star.I_K, L_d=rate_bound)
        named["ellipsoid"] = invariant_ellipsoid(
            A_K, disturbance_entry(study.model), L_d=rate_bound
        )
    return named
