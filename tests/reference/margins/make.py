"""The margins of some loops by python-control and SLICOT, stored in margins.json.

Needs `control` and `slycot`. The disk margin is python-control's at single frequencies (SLICOT's
AB13MD); its smallest value over frequency is found on a grid that closes in on it.
"""

import json
from pathlib import Path

import control
import numpy as np
import slycot

import flighttune as ft
from flighttune.control.gains import paper_family
from flighttune.control.inner_loop import with_input_delay, with_input_lag

GRID = 400
ZOOMS = 8
NO_GAIN = 1e-9


def smallest_disk_margin(loop, slowest, fastest):
    """The disk margin of a loop over all frequencies, from its slowest and fastest eigenvalue."""
    low, high = np.log(slowest) - 5.0, np.log(fastest) + 5.0
    for _ in range(ZOOMS):
        omega = np.exp(np.linspace(low, high, GRID))
        margins = control.disk_margins(loop, omega, returnall=True)[0]
        best = int(np.argmin(margins))
        low, high = np.log(omega[max(best - 2, 0)]), np.log(omega[min(best + 2, GRID - 1)])
    return float(margins[best])


def case(model, K):
    """One entry of the file."""
    n, m, p = model.shape
    A = np.block([[model.A, np.zeros((n, p))], [model.C, np.zeros((p, p))]])
    B = np.vstack([model.B, np.zeros((p, m))])
    C = -np.hstack([K[:, :p] @ model.C, K[:, p:]])
    rate = np.abs(np.linalg.eigvals(A - B @ C))
    channels = []
    for i in range(m):
        others = [j for j in range(m) if j != i]
        loop = control.ss(A - B[:, others] @ C[others], B[:, [i]], C[[i]], 0.0)
        gain, phase, _, _, crossover, _ = control.stability_margins(loop, returnall=True)
        lag = np.deg2rad(np.mod(phase, 360.0))
        channels.append(
            {
                "gain_increase": min(gain[gain > 1.0], default=None),
                "gain_decrease": max(gain[(gain > NO_GAIN) & (gain < 1.0)], default=0.0),
                "phase_margin": min(lag, default=None),
                "delay_margin": min(lag / crossover, default=None),
            }
        )
    everything = control.ss(A, B, C, np.zeros((m, m)))
    return {
        **{name: getattr(model, name).tolist() for name in "ABC"},
        "K": K.tolist(),
        "channels": channels,
        "disk_margin": smallest_disk_margin(everything, rate.min(), rate.max()),
    }


def random_loop(rng, n, m):
    """A coupled loop of n states and m inputs, stable."""
    while True:
        A = rng.normal(size=(n, n)) / np.sqrt(n) - 1.2 * np.eye(n)
        B, C = rng.normal(size=(n, m)), rng.normal(size=(m, n))
        K = 0.3 * rng.normal(size=(m, 2 * m))
        names = [
            tuple(f"{kind}{i}" for i in range(k)) for kind, k in (("x", n), ("u", m), ("e", m))
        ]
        model = ft.loop.LinearModel(
            A=A, B=B, C=C, states=names[0], inputs=names[1], errors=names[2]
        )
        A_K = np.block([[A + B @ K[:, :m] @ C, B @ K[:, m:]], [C, np.zeros((m, m))]])
        if np.linalg.eigvals(A_K).real.max() < -0.05:
            return model, K


def main():
    """Write margins.json beside this file."""
    rng = np.random.default_rng(0)
    paper = ft.loop.kinematic_model(V_a=25.0, gamma=np.pi / 12.0, g=9.81)
    lagged = with_input_lag(paper, (4.0, 8.0))
    delayed = with_input_delay(with_input_delay(lagged, 0.025), 0.025)
    family = paper_family()
    cases = {
        "paper": case(paper, family["paper"].K),
        "paper_K6": case(paper, family["K6"].K),
        "lagged": case(lagged, family["paper"].K),
        "lagged_and_delayed": case(delayed, family["paper"].K),
        "one_channel": case(*random_loop(rng, 4, 1)),
        "coupled_of_6": case(*random_loop(rng, 6, 2)),
        "coupled_of_10": case(*random_loop(rng, 10, 2)),
        "three_inputs": case(*random_loop(rng, 8, 3)),
    }
    versions = {"control": control.__version__, "slycot": slycot.__version__}
    text = json.dumps({"versions": versions, "cases": cases}, indent=1)
    Path(__file__).with_name("margins.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
