"""The paper's gain sets and disturbances, flown, as runs in one recording."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid

from flighttune.flight.fly import library_versions
from flighttune.paper import parameters as printed
from flighttune.paper.flight import PaperFlight
from flighttune.paper.parameters import STAR
from flighttune.paper.study import Study
from flighttune.simulate.run import Provenance, Run
from flighttune.units import DEG

# Name of the recording's file, without `.rrd`.
NAME = "families"

TITLE = "The families of the paper"

# One sample in so many is recorded: 50 a second are more than a screen shows.
EVERY = 2

MAGNITUDE_LIMITED = 1.0


def family_runs(study: Study) -> list[Run]:
    """K1 to K6 under the printed disturbance, then K* under d1 to d9."""
    flights = {("kinematic", name): study.flights[name] for name in printed.TABLE_2}
    flights |= {(f"kinematic, {name}", STAR): study.disturbed[name] for name in study.disturbed}
    return [
        Run(
            signals=_signals(flight).iloc[::EVERY],
            status="diverged" if flight.reason else "completed",
            reason=flight.reason,
            provenance=Provenance(
                scenario=_scenario(),
                plant=plant,
                gains_name=name,
                gains=study.gains[name],
                seed=0,
                versions=library_versions(),
                wall_s=0.0,  # the study does not time its flights one by one
            ),
        )
        for (plant, name), flight in flights.items()
    ]


def write_families(study: Study, folder: Path) -> Path:
    """Write the recording of the families; return its file."""
    from flighttune.recording.page import scenario_page
    from flighttune.recording.record import write_recording

    runs = family_runs(study)
    page = scenario_page(
        runs,
        scenario=_scenario(),
        indicators={name: (row.R_K, row.I_K) for name, row in study.indicators.items()},
    )
    path = folder / f"{NAME}.rrd"
    write_recording(runs, path, page=page, title=TITLE)
    return path


def _scenario() -> dict[str, Any]:
    limits = printed.printed_limits()
    return {
        "title": TITLE,
        "verifies": "K1 to K6 under the disturbance of Table 1; K* under d1 to d9 of Table 3",
        "source": "arXiv 2411.13140, Tables 1 to 3, Figs. 8 and 11; ranges cut off, no rate "
        "limits, no anti-windup",
        "flight": {"V_a_mps": printed.V_A, "g_mps2": printed.G},
        "limits": {
            "phi_deg": [limits.lower[0] / DEG, limits.upper[0] / DEG],
            "n_z": [float(limits.lower[1]), float(limits.upper[1])],
        },
    }


def _signals(flight: PaperFlight) -> pd.DataFrame:
    t, (chi, gamma) = flight.t, flight.x.T
    velocity = printed.V_A * np.stack(
        [np.cos(gamma) * np.cos(chi), np.cos(gamma) * np.sin(chi), -np.sin(gamma)]
    )
    disturbance = flight.disturbance or (lambda _: (0.0, 0.0))
    columns: dict[str, Any] = {"V_a": printed.V_A, "chi_ref": printed.CHI_C}
    columns["gamma_ref"] = printed.GAMMA_C
    for names, values in (
        (("chi", "gamma"), flight.x.T),
        (("phi", "n_z"), flight.u.T),
        (("phi_cmd", "n_z_cmd"), flight.u.T),
        (("phi_unlimited", "n_z_unlimited"), flight.unlimited.T),
        (("phi_integral", "n_z_integral"), flight.integral.T),
        (("phi_limited", "n_z_limited"), MAGNITUDE_LIMITED * (flight.u != flight.unlimited).T),
        (("north", "east", "down"), cumulative_trapezoid(velocity, t, initial=0.0)),
        (("d_chi", "d_gamma"), np.array([disturbance(moment) for moment in t.tolist()]).T),
    ):
        columns |= zip(names, values, strict=True)
    # Only the error in course is an angle that may be beyond a half turn.
    columns["chi_err"] = np.remainder(flight.error[:, 0] + np.pi, 2.0 * np.pi) - np.pi
    columns["gamma_err"] = flight.error[:, 1]
    return pd.DataFrame(columns, index=pd.Index(t, name="t"), dtype=float)
