"""The numbers of docs/theory.md: how well R_K, E_K and an L2 gain order gains by flown errors.

``python docs/figures/l2_gain.py`` prints the rank correlations (Spearman) of each with the ITAE of
a step in course and path angle, over random diagonal gains on two identified aircraft.
"""

import numpy as np
from scipy.stats import spearmanr

import flighttune as ft
from flighttune.base.units import G_0
from flighttune.control.linear_model import closed_loop
from flighttune.control.theory.indicators import indicators
from flighttune.vehicles.identification.file import design_model

GAINS, SEED, HALF_SAMPLE = 40, 1, 0.01
AIRCRAFT = {"aerosonde": 25.0, "c172p": 50.0}  # m/s
OMEGA = np.geomspace(1e-3, 100.0, 1500)  # rad/s
SLOWEST = 0.05  # 1/s: loops that decay more slowly are drawn again
NAMES = "R_K", "E_K", "L2 gain"


def L2_gain(A_K: np.ndarray, states: int) -> float:
    """Largest gain from disturbances of both rates to both errors over all frequencies."""
    B, C = np.eye(len(A_K))[:, :2], np.eye(len(A_K))[states : states + 2]
    loops = 1j * OMEGA[:, None, None] * np.eye(len(A_K)) - A_K
    # The state is (x', e), which the derivative of the disturbance drives.
    response = 1j * OMEGA[:, None, None] * (C @ np.linalg.solve(loops, B[None]))
    return float(np.linalg.norm(response, 2, axis=(1, 2)).max())


def drawn(aircraft: str, V_a: float) -> tuple[list[ft.PIGains], np.ndarray]:
    """Random gains whose loops behind the identified lags are stable, and the figures of each."""
    condition = ft.loop.load_identified(aircraft).nearest(V_a, 0.0)
    designed, rng = design_model(condition, g=G_0, hold=HALF_SAMPLE), np.random.default_rng(SEED)
    model, found, figures = designed.model, list[ft.PIGains](), list[list[float]]()
    while len(found) < GAINS:
        low, high = np.log([[0.36, 0.1], [3.6, 2.0]])
        K_P, K_I = V_a / G_0 * np.exp(rng.uniform(low[:, None], high[:, None], (2, 2)))
        gains = ft.PIGains(K_P=np.diag(K_P), K_I=np.diag(K_I))
        A_K = closed_loop(model, gains)
        if np.linalg.eigvals(A_K).real.max() > -SLOWEST:
            continue
        R_K = indicators(A_K, scaling=designed.scaling).R_K
        gain = L2_gain(A_K, len(model.A))
        found.append(gains)
        figures.append([-R_K, indicators(A_K, errors=2).E_K, gain])
    return found, np.array(figures)


def ITAE(aircraft: str, V_a: float, gains: list[ft.PIGains]) -> np.ndarray:
    """ITAE of course and path angle of a step, each over its median, and added."""
    tables = ft.load_scenario("level_turn").as_dict()
    tables |= {"plant": [{"kind": "jsbsim", "aircraft": aircraft}], "expect": []}
    named = enumerate(gains)
    tables["gains"] = [{"name": f"set{k}", "K_P": x.K_P.tolist(), "K_I": x.K_I.tolist()}
                       for k, x in named]  # fmt: skip
    tables["flight"] |= {"V_a_mps": V_a, "h_m": 1000.0}
    tables["controller"]["feed_forward"] = False
    tables["limits"]["n_z"] = [-0.5, 2.5]
    for channel, change in (("chi_deg", 10.0), ("gamma_deg", 2.0)):
        tables["reference"][channel] = [{"shape": "step", "start_s": 2.0, "change_deg": change}]
    flown = ft.fly(ft.scenario_from(tables)).metrics["ITAE"].unstack()
    return (
        (flown / flown.median())
        .sum(axis=1)
        .reindex([f"jsbsim:{aircraft} / set{k}" for k in range(len(gains))])
        .to_numpy()
    )


def main() -> None:
    """Print a row for each aircraft."""
    for aircraft, V_a in AIRCRAFT.items():
        gains, figures = drawn(aircraft, V_a)
        errors = ITAE(aircraft, V_a, gains)
        row = (
            f"{name} {spearmanr(x, errors)[0]:.2f}"
            for name, x in zip(NAMES, figures.T, strict=True)
        )
        print(f"{aircraft}: {', '.join(row)}")


if __name__ == "__main__":
    main()
