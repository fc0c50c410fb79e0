"""Trims against JSBSim's own trim routine, on the models as JSBSim ships them.

Both bring the six accelerations to zero. JSBSim's holds the sideslip at zero and lets the aircraft
bank, flighttune's holds the wings level and lets it slip: the same flight where nothing pushes to
one side, and nearly so behind a propeller, whose drag of sideslip is then the difference.
"""

import math
from pathlib import Path

import jsbsim
import pytest

import flighttune as ft

DEG = math.pi / 180.0
FPS = 0.3048
H = 1000.0
EARTH = Path(ft.__file__).parent / "vehicles/plants/jsbsim/earth.xml"
ADOPTED = Path(__file__).parents[1] / "adopted"
AIRCRAFT = {
    "a4": "a4",
    "c172p": "c172p",
    **{name: ADOPTED / name for name in ("737", "A320", "MD11", "T38", "f16", "J3Cub")},
}
PROPELLERS = "c172p", "J3Cub"
SPEEDS = 0.95, 1.0, 1.05, 1.1, 1.2
"""Over the airspeed that the inner loop was designed for."""

CLIMBS = -2.0, 0.0, 1.0, 2.0
"""Deg."""

SAME_ALPHA = 0.001 * DEG
SAME_THROTTLE = 1e-4
THROTTLE_OF_A_SLIP = 0.002
"""By the drag of the sideslip, 0.17 |beta| q S on the c172p: 7 N of 700 N."""

NO_SIDESLIP = 1e-4 * DEG
FULL_TRIM = 1


def jsbsim_trim(config, V_a, gamma):
    """Alpha, beta, phi (rad) and throttle of JSBSim's full trim, over the same flat Earth."""
    fdm = jsbsim.FGFDMExec(jsbsim.get_default_root_dir())
    fdm.set_debug_level(0)
    assert fdm.load_model(config.model)
    assert fdm.load_planet(str(EARTH), False)
    for name, value in config.settings.items():
        fdm[name] = value
    fdm["ic/h-sl-ft"], fdm["ic/vt-fps"], fdm["ic/gamma-rad"] = H / FPS, V_a / FPS, gamma
    fdm.run_ic()
    fdm["propulsion/set-running"] = -1
    fdm["simulation/do_simple_trim"] = FULL_TRIM
    names = "aero/alpha-rad", "aero/beta-rad", "attitude/phi-rad", "fcs/throttle-cmd-norm"
    return [fdm[name] for name in names]


@pytest.mark.counts
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.soak if name in PROPELLERS else pytest.mark.slow)
        for name in AIRCRAFT
    ],
)
def test_twenty_trims_are_those_of_jsbsim(name):
    config = ft.loop.JSBSimPlant(AIRCRAFT[name]).config
    assert config.design is not None
    for speed in SPEEDS:
        for climb in CLIMBS:
            V_a, gamma = speed * config.design.V_a, climb * DEG
            alpha, beta, phi, throttle = jsbsim_trim(config, V_a, gamma)

            (row,) = ft.trim(AIRCRAFT[name], V_a=[V_a], gamma=[gamma], h=H).records
            found = row["trim"]
            assert found["alpha_deg"] * DEG == pytest.approx(alpha, abs=SAME_ALPHA), (speed, climb)
            assert abs(beta) < NO_SIDESLIP
            if name in PROPELLERS:
                # A slip to the left stands for a bank to the right.
                assert found["beta_deg"] * phi <= 0.0
                assert found["throttle"] == pytest.approx(throttle, abs=THROTTLE_OF_A_SLIP)
            else:
                assert abs(found["beta_deg"] * DEG) < NO_SIDESLIP
                assert abs(phi) < NO_SIDESLIP
                assert found["throttle"] == pytest.approx(throttle, abs=SAME_THROTTLE)
