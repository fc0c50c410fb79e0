"""Rows of a campaign with a truth that is known, made without a flight."""

import numpy as np
import pandas as pd
from dispersed import campaign_of, one_of, uniform

import flighttune as ft


def made_up_plan(*expect: dict, runs: int = 800, design: str = "random") -> ft.Plan:
    """A plan of two plants and two gain sets, with three parameters of which one does nothing."""
    stated = expect or [{"at_most": {"chi": {"ITAE": 4.0, "settling_s": 5.0}}}]
    gains = ["paper", "K3"]
    tables = ft.load_scenario("level_turn").as_dict() | {"gains": gains, "expect": list(stated)}
    campaign = campaign_of(
        ft.scenario_from(tables),
        uniform("flight.V_a_mps", 23.0, 27.0),
        uniform("flight.phi_deg", -10.0, 10.0),
        one_of("limits.n_z_rate_per_s", 0.8, 1.0, 1.2),
        gains=gains, scenario="level_turn", seed=1, runs=runs, design=design,
    )  # fmt: skip
    return ft.plan_campaign(campaign)


def made_up_rows(plan: ft.Plan) -> pd.DataFrame:
    """Rows of all runs of a plan.

    ITAE of course is 1 + (V - 23)^2 / 4 with `paper` and half of it with `K3`, half as much again
    on the aircraft; a flight succeeds where it is at most 4. At more than 26.9 m/s `paper` diverges
    on the aircraft.
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
    rows["R_K"], rows["I_K"], rows["E_K"] = 0.6, 5.2, 1.2
    rows["wall_s"] = 0.01
    return rows
