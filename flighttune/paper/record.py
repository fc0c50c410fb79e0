"""The families as runs, in one recording."""

import math
import platform
import time
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.metrics import channel_metrics
from flighttune.paper import parameters as printed
from flighttune.paper.flight import PaperFlight
from flighttune.paper.parameters import STAR
from flighttune.paper.study import Study
from flighttune.simulate.run import Provenance, Run

NAME = "families"
"""Name of the recording's file, without ``.rrd``."""

TITLE = "The families of the paper"
EVERY = 2
"""Of the samples of a flight one in so many is recorded."""

MAGNITUDE_LIMITED = 1.0


def family_runs(study: Study) -> list[Run]:
    """K1 to K6 under the printed disturbance, then K* under d1 to d9."""
    runs = [
        _run("kinematic", name, study.gains[name], study.flights[name]) for name in printed.TABLE_2
    ]
    runs += [
        _run(f"kinematic, {name}", STAR, study.star, flight)
        for name, flight in study.disturbed.items()
    ]
    return runs


def write_families(study: Study, folder: Path) -> Path:
    """Write the recording of the families; return its file."""
    from flighttune.recording.page import scenario_page
    from flighttune.recording.rrd import write_recording

    runs = family_runs(study)
    page = scenario_page(
        runs,
        scenario=_scenario(),
        indicators={name: (found.R_K, found.I_K) for name, found in study.indicators.items()},
        metrics=pd.concat({run.label: channel_metrics(run) for run in runs}, names=["run"]),
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
            "phi_deg": np.rad2deg([limits.lower[0], limits.upper[0]]).tolist(),
            "n_z": [float(limits.lower[1]), float(limits.upper[1])],
        },
    }


def _run(plant: str, name: str, gains: PIGains, flight: PaperFlight) -> Run:
    started = time.perf_counter()
    signals = pd.DataFrame(_signals(flight), index=pd.Index(flight.t, name="t"), dtype=float)
    signals = signals.iloc[::EVERY]
    return Run(
        signals=signals,
        status="completed" if flight.status == "completed" else "diverged",
        reason=flight.reason,
        provenance=Provenance(
            scenario=_scenario(),
            plant=plant,
            gains_name=name,
            gains=gains,
            seed=0,
            versions={
                "python": platform.python_version(),
                **{library: version(library) for library in ("flighttune", "numpy", "scipy")},
            },
            wall_s=time.perf_counter() - started,
        ),
    )


def _signals(flight: PaperFlight) -> Mapping[str, FloatArray]:
    t = flight.t
    chi, gamma = flight.x.T
    level = printed.V_A * np.cos(gamma)
    held = np.where(flight.u != flight.unlimited, MAGNITUDE_LIMITED, 0.0)
    disturbed = flight.disturbance
    d = np.array([disturbed(moment) if disturbed else (0.0, 0.0) for moment in t.tolist()])
    return {
        "chi": chi,
        "gamma": gamma,
        "phi": flight.u[:, 0],
        "n_z": flight.u[:, 1],
        "V_a": np.full(len(t), printed.V_A),
        "north": _integral(t, level * np.cos(chi)),
        "east": _integral(t, level * np.sin(chi)),
        "down": _integral(t, -printed.V_A * np.sin(gamma)),
        "d_chi": d[:, 0],
        "d_gamma": d[:, 1],
        "chi_ref": np.full(len(t), printed.CHI_C),
        "gamma_ref": np.full(len(t), printed.GAMMA_C),
        "chi_err": np.remainder(flight.error[:, 0] + math.pi, 2.0 * math.pi) - math.pi,
        "gamma_err": flight.error[:, 1],
        "phi_cmd": flight.u[:, 0],
        "n_z_cmd": flight.u[:, 1],
        "phi_unlimited": flight.unlimited[:, 0],
        "n_z_unlimited": flight.unlimited[:, 1],
        "phi_integral": flight.integral[:, 0],
        "n_z_integral": flight.integral[:, 1],
        "phi_limited": held[:, 0],
        "n_z_limited": held[:, 1],
    }


def _integral(t: FloatArray, rate: FloatArray) -> FloatArray:
    """Integral from the start by the trapezoidal rule, shape (k,)."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)
    return np.concatenate([[0.0], np.cumsum(steps)])
