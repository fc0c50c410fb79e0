"""Short manoeuvres that a tube encloses, and flights inside such a tube."""

import numpy as np

import flighttune as ft

EXACT = ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0)
FED_BACK = ft.PIGains(K_P=EXACT.K_P, K_I=EXACT.K_I, inputs=EXACT.inputs, feedback=(0.5, 0.3))
# A loop that settles within three samples, a second apart.
QUICK = ft.PIGains(K_P=3.0 * np.eye(2), K_I=1.5 * np.eye(2))

KINEMATIC, POINT = {"kind": "kinematic"}, {"kind": "point_mass"}
LAGS = {"kind": "point_mass_lag", "roll_lag_rad_s": 8.0, "n_z_lag_rad_s": 6.0}
DELAYS = {"roll_delay_s": 0.03, "n_z_delay_s": 0.05, "roll_damping": 0.7, "n_z_damping": 1.2}
# Brakes for larger errors only.
EXACT_LAW = {"name": "exact", "kind": "exact", "braking": 100.0}


def manoeuvre(  # noqa: PLR0913 - each is a choice of a test
    plant=KINEMATIC, *, exact=False, chi_deg=10.0, gamma_deg=5.0, gamma_ref_deg=0.0, roll_deg=45.0,
    roll_dps=30.0, n_z=2.1, n_z_per_s=1.0, rate_hz=50.0, duration_s=0.4, anti_windup="conditional",
    feed_forward=True, ramp_dps=None, **tables,
):  # fmt: skip
    """A turn and descent that starts so far off, within limits of any size.

    With a ramp of the path angle to the end no set is looked for that holds for ever.
    """
    reference = {"chi_deg": 0.0, "gamma_deg": gamma_ref_deg}
    if ramp_dps is not None:
        start_s = 0.5 * min(duration_s, 0.4)
        ramp = {"shape": "ramp", "start_s": start_s, "rate_dps": ramp_dps, "duration_s": 9.0}
        reference |= {"gamma_deg": [ramp], "gamma_from_deg": gamma_ref_deg}
    return ft.scenario_from({
        "title": "manoeuvre",
        "gains": ["paper"],
        **({"law": [EXACT_LAW]} if exact else {}),
        "flight": {"V_a_mps": 25.0, "chi_deg": chi_deg, "gamma_deg": gamma_deg,
                   "duration_s": duration_s},
        "reference": reference,
        "limits": {"phi_deg": [-roll_deg, roll_deg], "phi_rate_dps": roll_dps,
                   "n_z": [-n_z, n_z], "n_z_rate_per_s": n_z_per_s},
        "controller": {"rate_hz": rate_hz, "anti_windup": anti_windup,
                       "feed_forward": feed_forward},
        "plant": [plant],
        **tables,
    })  # fmt: skip


def changed(scenario, **tables):
    """The scenario with other tables, merged into its own."""
    own = scenario.as_dict()
    return ft.scenario_from({**own, **{x: {**own.get(x, {}), **of} for x, of in tables.items()}})


def flown(tube, off=(0.0, 0.0), disturbance=0.0, held_s=0.02, rng=None):
    """Signals of a flight that starts so far off, in a disturbance of full size, its signs drawn.

    It is flown by the scenario of the tube, with its gains under a name of their own.
    """
    scenario, gains = tube.problem.scenario, tube.problem.gains
    flight = scenario.as_dict()["flight"]
    flight["chi_deg"] += np.rad2deg(off[0])
    flight["gamma_deg"] = flight.get("gamma_deg", 0.0) + np.rad2deg(off[1])
    tables = scenario.as_dict() | {"flight": flight, "gains": [{"name": "own", **listed(gains)}]}
    for name in ("chi", "gamma"):  # ramps begin where those of the scenario do
        if isinstance(tables["reference"][f"{name}_deg"], list):
            begin = scenario.as_dict()["flight"].get(f"{name}_deg", 0.0)
            tables["reference"] = {f"{name}_from_deg": begin, **tables["reference"]}
    if disturbance:
        times = np.arange(held_s, flight["duration_s"] - 1e-9, held_s)
        sides = {name: rng.choice([-1.0, 1.0], len(times) + 1) for name in ("chi", "gamma")}
        tables["disturbance"] = {
            key: value
            for name, of in sides.items()
            for key, value in {
                f"{name}_amplitude": disturbance * of[0],
                f"{name}_switch_s": times[np.flatnonzero(np.diff(of))].tolist(),
            }.items()
        }
    (run,) = ft.fly(ft.scenario_from(tables)).runs
    return run.signals


def listed(gains):
    """Gains as a table of a scenario."""
    table = {"K_P": gains.K_P.tolist(), "K_I": gains.K_I.tolist()}
    if gains.inputs != ("phi", "n_z"):
        table |= {"law": "exact"}
    return table | ({"feedback": list(gains.feedback)} if any(gains.feedback) else {})


def all_stay(tube, disturbance, rng, flights=6):
    """Whether flights from inside or the edge of the starts stay in the tube, disturbed or not."""
    dt = 1.0 / tube.problem.scenario.controller.rate_hz
    sides = rng.choice([-1.0, 1.0], (flights, 2)) * rng.choice([1.0, rng.random()], (flights, 2))
    return all(
        tube.bounds.contain(flown(tube, off, disturbance, rng.choice([1, 5, 25]) * dt, rng))
        for off in tube.problem.start * sides
    )
