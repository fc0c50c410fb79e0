"""Plants of one scenario fly in the same air: what the aircraft met, the others replay."""

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft

pytestmark = pytest.mark.slow

WIND = ("wind_north", "wind_east", "wind_down")
LAGS = {"roll_lag_rad_s": 4.0, "n_z_lag_rad_s": 8.0}
SAMPLE_TO_SAMPLE = 1e-9
LAW, AIRCRAFT = {"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}


def flown_in(plants, **tables):
    flight = {"duration_s": 6.0, "chi_deg": 20.0}
    limits = {"phi_deg": [-45.0, 45.0], "n_z": [-2.1, 2.1]}
    made = {"flight": flight, "limits": limits, "controller": {"feed_forward": True}, **tables}
    return ft.fly(made_up_scenario(seed=3, gains=["paper", "K5"], plant=plants, **made))


@pytest.mark.soak
def test_every_plant_meets_the_wind_of_the_aircraft():
    flown = flown_in(
        [LAW, {"kind": "point_mass_lag", **LAGS}, AIRCRAFT],
        wind={"speed_mps": 4.0, "from_deg": 200.0},
        gust={"axis": "right", "peak_mps": 3.0, "start_s": 2.0, "length_m": 30.0},
        turbulence={"intensity": "light"},
    )

    assert [run.provenance.plant for run in flown.runs[::2]] == [
        "kinematic", "point_mass_lag", "jsbsim:aerosonde",
    ]  # fmt: skip
    for aircraft in flown.runs[4:]:
        name = aircraft.provenance.gains_name
        for run in flown.runs[:4]:
            if run.provenance.gains_name == name:
                ours, theirs = (r.signals[list(WIND)].to_numpy() for r in (run, aircraft))
                assert ours == pytest.approx(theirs, abs=SAMPLE_TO_SAMPLE)
    met = [run.signals[list(WIND)].to_numpy() for run in flown.runs[4:]]
    assert np.max(np.abs(met[0] - met[1])) > 0.0, "each gain set meets its own turbulence"


def test_without_a_flight_of_the_aircraft_there_is_no_wind_to_replay():
    dive = {"gamma_deg": -20.0, "duration_s": 5.0}
    flown = flown_in([LAW, AIRCRAFT], flight=dive, turbulence={"intensity": "light"})

    assert {run.status for run in flown.runs} == {"no_trim"}
    assert flown.runs[0].reason.startswith("the wind is that of jsbsim:aerosonde, which did not")
    assert not len(flown.runs[0].signals)


def test_the_sinusoid_as_wind_blows_on_the_aircraft_and_stays_a_rate_on_the_law():
    wind = {"chi_amplitude": 0.02, "chi_omega_rad_s": 0.3, "as_wind": True}
    flown = flown_in([LAW, AIRCRAFT], disturbance=wind)

    law, aircraft = flown.runs[0], flown.runs[2]
    t = law.signals.index.to_numpy()
    assert law.signals["d_chi"].to_numpy() == pytest.approx(0.02 * np.sin(0.3 * t))
    east = 25.0 * 0.02 / 0.3 * np.cos(0.3 * t)
    assert aircraft.signals["wind_east"].to_numpy() == pytest.approx(east)


@pytest.fixture(scope="module")
def storm():
    """Errors in deg once the manoeuvre of the shipped scenario is over, by run."""
    runs, errors = ft.fly("oscillating_wind").runs, ["chi_err", "gamma_err"]
    return {run.label: np.rad2deg(run.signals.loc[15.0:, errors]) for run in runs}


@pytest.mark.soak
@pytest.mark.parametrize(
    ("gains", "apart_deg"), [("tuned_identified", (0.1, 0.06)), ("paper", (0.5, 0.8))]
)
def test_steered_through_the_air_the_aircraft_meets_the_papers_disturbance(storm, gains, apart_deg):
    aircraft, law = (storm[f"{plant} / {gains}"] for plant in ("jsbsim:aerosonde", "point_mass"))

    assert ((aircraft - law).abs().max() < np.array(apart_deg)).all()
    assert (law.abs().max() > 0.6).all()
    assert (aircraft - law).loc[45.0:].abs().max().max() < 0.05
