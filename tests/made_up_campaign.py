"""Rows of a campaign with a truth that is known, made without a flight."""

from pathlib import Path

import numpy as np
import pandas as pd

from flighttune.campaign.planning.load import load_campaign
from flighttune.campaign.planning.plan import Plan, plan_campaign

CAMPAIGN = """
title    = "Rows that were made up"
verifies = "what a report says of flights whose truth is known"
scenario = "level_turn"
seed     = {seed}
runs     = {runs}
design   = "{design}"
gains    = ["paper", "K3"]

[[disperse]]
key = "flight.V_a_mps"
distribution = "uniform"
lower = 23.0
upper = 27.0

[[disperse]]
key = "flight.phi_deg"
distribution = "uniform"
lower = -10.0
upper = 10.0

[[disperse]]
key = "limits.n_z_rate_per_s"
distribution = "choice"
values = [0.8, 1.0, 1.2]
"""


def made_up_plan(folder: Path, *, runs: int = 800, design: str = "random", seed: int = 1) -> Plan:
    """A plan of two plants and two gain sets, with three parameters of which one does nothing."""
    file = folder / "made_up.toml"
    file.write_text(CAMPAIGN.format(runs=runs, design=design, seed=seed), encoding="utf-8")
    return plan_campaign(load_campaign(file))


def made_up_rows(plan: Plan) -> pd.DataFrame:
    """Rows of all runs of a plan.

    ITAE of course is 1 + (V - 23)^2 / 4 with `paper` and half of it with `K3`, half as much again
    on the aircraft; a flight succeeds where it is at most 4. At more than 26.9 m/s `paper` diverges
    on the aircraft. The certified set holds where V is below 25 m/s and roll starts to the right.
    """
    runs = np.arange(plan.runs)
    draws = runs // len(plan.groups)
    groups = [plan.groups[run % len(plan.groups)] for run in runs]
    drawn = plan.parameters().loc[draws].reset_index(drop=True)
    rows = pd.DataFrame({"run": runs, "draw": draws})
    rows["plant"] = [group.plant for group in groups]
    rows["gains"] = [group.gains for group in groups]
    rows = pd.concat([rows, drawn], axis=1)
    V, phi = rows["flight.V_a_mps"].to_numpy(), rows["flight.phi_deg"].to_numpy()
    aircraft = rows["plant"].str.startswith("jsbsim").to_numpy()
    paper = (rows["gains"] == "paper").to_numpy()
    itae = (1.0 + (V - 23.0) ** 2 / 4.0) * np.where(paper, 1.0, 0.5) * np.where(aircraft, 1.5, 1.0)
    lost = aircraft & paper & (V > 26.9)
    rows["status"] = np.where(lost, "diverged", "completed")
    rows["reason"] = [
        f"the course error passed 180 deg at t = {v:.2f} s" if gone else None
        for v, gone in zip(V, lost, strict=True)
    ]
    rows["success"] = ~lost & (itae <= 4.0)
    rows["missed"] = [
        None if ok else f"chi.ITAE must be at most 4, got {value:.4g} (missed by {value - 4:.3g})"
        for ok, value in zip(rows["success"], itae, strict=True)
    ]
    rows["chi.ITAE"] = np.where(lost, 0.1, itae)
    rows["gamma.ITAE"] = np.where(lost, np.nan, 0.2 + 0.01 * np.abs(phi))
    rows["chi.settling_s"] = np.where(lost | (V > 26.0), np.nan, 3.0)
    rows["R_K"], rows["I_K"] = 0.6, 5.2
    entered = np.where(V < 25.0, "held", "broken").astype(object)
    rows["certified"] = np.where(lost, None, np.where(phi < 0.0, "not entered", entered))
    rows["wall_s"] = 0.01
    return rows
