"""Three coupled tanks and three pumps: tune, certify and simulate a plant that does not fly."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import approx_fprime

import flighttune as ft

# Levels in dm; inflows of the pumps over the area of a tank in dm/s. Each pump feeds two tanks.
PUMPS = np.array([[0.8, 0.2, 0.0], [0.0, 0.8, 0.2], [0.2, 0.0, 0.8]])
ORIFICE = 0.3  # sqrt(dm)/s
REFERENCE = np.array([6.0, 4.5, 3.0])
LEAK, OMEGA = 0.05, 0.8  # dm/s and rad/s: a leak that comes and goes in each tank
START = np.array([0.5, -0.4, 0.3])  # dm above the reference
PHASES = 2.0 * np.pi / 3.0 * np.arange(3)


def outflow(h):
    """What leaves each tank: tank 1 runs into 2, 2 into 3, and 3 out (Torricelli)."""
    drop = h - np.append(h[1:], 0.0)
    flow = ORIFICE * np.sign(drop) * np.sqrt(np.abs(drop))
    return flow - np.append(0.0, flow[:-1])


def loop(t, state, gains):
    """The nonlinear loop: levels and integrals of their errors."""
    error = REFERENCE - state[:3]
    pumps = np.linalg.solve(PUMPS, outflow(REFERENCE)) + gains.K_P @ error + gains.K_I @ state[3:]
    leak = LEAK * np.sin(OMEGA * t + PHASES)
    return np.append(PUMPS @ pumps - outflow(state[:3]) - leak, error)


if __name__ == "__main__":
    tanks = ("tank 1", "tank 2", "tank 3")
    slope = approx_fprime(REFERENCE, outflow, 1e-6)
    model = ft.loop.LinearModel(  # of the errors: e' = -h'
        A=-slope, B=-PUMPS, C=np.eye(3), states=tanks, inputs=("a", "b", "c"), errors=tanks
    )
    tuned = ft.tune(ft.loop.TuningProblem(model=model, I_star=8.0), starts=2)
    L_d = LEAK * OMEGA * np.sqrt(1.5)  # norm of the derivative of the three leaks
    certified = ft.certify(model, tuned.gains, L_d=L_d)
    claim = certified.certificate.claim
    assert ft.verify(certified.certificate).valid
    certified.certificate.save("runs/three_tanks/certificate.json")
    print(f"R_K {tuned.R_K:.4f} 1/s, I_K {tuned.I_K:.3f} s^2")

    start = np.append(REFERENCE + START, np.zeros(3))
    t = np.linspace(0.0, 80.0, 8001)
    flown = solve_ivp(loop, (0.0, 80.0), start, t_eval=t, args=(tuned.gains,), rtol=1e-8)
    error = REFERENCE[:, None] - flown.y[:3]
    s = np.vstack([np.gradient(error, t, axis=1), error])
    late, peak = np.linalg.norm(s, axis=0)[t > 30.0].max(), np.abs(error[:, t > 30.0]).max()
    largest = L_d * ft.loop.indicators(ft.loop.closed_loop(model, tuned.gains)).E_K
    print(f"norm of (e', e) after 30 s: {late:.4f}, certified {claim.radius:.4f}")
    print(f"largest error then: {peak:.4f} dm, largest possible for it {largest:.4f} dm")
    assert late <= claim.radius
    assert peak <= largest
