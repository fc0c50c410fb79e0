"""Plants that follow at once leave a law nothing to feed back, so that steep gains do not swing."""

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft

# Sampled at 50 Hz without lag, (z - 1)(z + k) + dt (1 + k) K_P z has a root beyond -1 if
# dt (1 + k) K_P exceeds 2 (1 - k): 0.37 and 0.1 here.
STEEP, FED = 9.4, 0.95
DT = 0.02

# Mean rate of a command at rest, 1/s; one in a limit cycle moves at its limit of 1.5.
AT_REST, LIMIT, SAME = 1e-4, 1.5, 1e-9


class OwnPoint(ft.loop.PointMassPlant):
    """A plant of a user's that says of itself that it follows at once."""


def steep(feedback):
    return {
        "name": "steep",
        "law": "exact",
        "K_P": [[1.2, 0.0], [0.0, STEEP]],
        "K_I": [[0.1, 0.0], [0.0, 0.5]],
        "feedback": feedback,
    }


def scene(kind, feedback):
    limits = {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 40.0, "n_z": [0.4, 1.9]}
    return made_up_scenario(
        law=["exact"],
        gains=[steep(feedback)],
        flight={"V_a_mps": 12.5, "duration_s": 8.0},
        reference={"chi_deg": 30.0, "gamma_deg": 3.0},
        limits={**limits, "n_z_rate_per_s": LIMIT},
        plant=[{"kind": kind}],
    )


def flown(kind, feedback):
    if kind == "own":
        return ft.fly(scene("kinematic", feedback), plants={"own": OwnPoint}).runs[-1]
    return ft.fly(scene(kind, feedback)).runs[0]


@pytest.mark.parametrize("kind", ["kinematic", "point_mass", "own"])
def test_a_plant_that_follows_at_once_is_flown_without_the_feedback(kind):
    fed, plain = flown(kind, [0.7, FED]), flown(kind, [0.0, 0.0])

    late = fed.signals["n_z_cmd"].to_numpy()[len(fed.t) * 3 // 4 :]
    assert np.abs(np.diff(late)).mean() / DT < AT_REST
    assert fed.signals.equals(plain.signals)
    assert fed.provenance.gains.feedback == (0.7, FED)  # the gains are named as they are


def test_behind_a_lag_the_feedback_is_flown():
    lagged = {"kind": "point_mass_lag", "roll_lag_rad_s": 6.0, "n_z_lag_rad_s": 4.0}
    tables = ft.load_scenario("level_turn").as_dict()
    tables |= {"law": ["exact"], "plant": [lagged], "expect": []}
    tables["flight"]["duration_s"] = 4.0
    fed, plain = (
        ft.fly(ft.scenario_from({**tables, "gains": [steep(k)]})).runs[0]
        for k in ([0.4, 0.3], [0.0, 0.0])
    )

    assert not fed.signals["n_z_cmd"].equals(plain.signals["n_z_cmd"])
