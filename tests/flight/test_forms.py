"""Every key of a flight changes the flight, and all its forms fly the change to the same bits.

Forms are the law of the package and the same one inside another class, which an aircraft flies
compiled and by JSBSim. A new key is a new row; a key without one is told.
"""

import copy

import numpy as np
import pytest
from made_up import made_up_scenario, scenario_tables
from pydantic import BaseModel

import flighttune as ft

COUPLED = {"name": "own", "K_P": [[1.4, 0.15], [-0.1, 1.6]], "K_I": [[0.4, 0.02], [0.03, 0.6]]}
LIMITS = {"phi_deg": [-30.0, 30.0], "phi_rate_dps": 40.0, "n_z": [0.6, 1.4], "n_z_rate_per_s": 2.0}
LAG = {"kind": "point_mass_lag", "roll_lag_rad_s": 8.0, "n_z_lag_rad_s": 6.0}
LAG |= {"roll_damping": 0.8, "roll_delay_s": 0.03, "n_z_damping": 0.7, "n_z_delay_s": 0.02}
AIRCRAFT = {"kind": "jsbsim", "aircraft": "aerosonde"}
SWING = {"chi_amplitude": 0.05, "chi_omega_rad_s": 1.5, "gamma_amplitude": 0.04}
SWING |= {"gamma_omega_rad_s": 1.1}
AS_WIND = SWING | {"as_wind": True}
NOISE = {"chi_noise_sd_deg": 0.5, "gamma_noise_sd_deg": 0.4, "V_a_noise_sd_mps": 0.3}
WIND = {"speed_mps": 4.0, "from_deg": 70.0}
LEVELS = [{"h_m": 400.0, **WIND}, {"h_m": 600.0, "speed_mps": 8.0, "from_deg": 100.0}]
TURN = {"chi_deg": 40.0, "gamma_deg": 0.0}


def tables(flown, /, **changes):
    """A turn out of a climb that meets its limits, of half a second."""
    flight = {"h_m": 500.0, "chi_deg": 20.0, "gamma_deg": 3.0, "duration_s": 0.5}
    made = {"flight": flight, "reference": TURN, "limits": LIMITS, "gains": [COUPLED], "seed": 3}
    return scenario_tables(**made | {"plant": [flown]}) | copy.deepcopy(changes)


# Keys of errors of navigation: a value that no grade has, and the errors of a grade in a wind.
KNOWN = {"wind": WIND, "navigation": {"grade": "standard"}}
FAILED = KNOWN | {"navigation": {"fault": {"from_s": 0.2, "jump_m": 3.0, "drift_mps": 1.0}}}
NAVIGATION = {"grade": ("poor", {"navigation": {"grade": "rtk"}})}
NAVIGATION |= dict.fromkeys(
    """position_sd_m position_time_constant_s position_fast_sd_m
    position_fast_time_constant_s position_noise_m velocity_noise_mps velocity_sd_mps
    velocity_time_constant_s height_sd_m height_time_constant_s height_noise_m height_of_q
    climb_noise_mps climb_time_constant_s period_s accelerometer_noise gyro_noise gyro_walk
    roll_bias_sd_deg roll_noise_deg n_z_bias_sd n_z_noise airspeed_scale_sd airspeed_sd_mps
    airspeed_time_constant_s airspeed_noise_mps wind_sd_mps wind_time_constant_s wind_lag_s
    filter_position_m filter_velocity_mps filter_height_m filter_climb_mps""".split(),  # noqa: SIM905
    (0.37, KNOWN),
)
NAVIGATION |= {
    f"fault.{key}": (0.37, FAILED) for key in ("from_s", "course_deg", "jump_m", "drift_mps")
}

# Keys of a law's flight on a point mass behind lags: a value, and what else stands beside it.
ON_LAWS = {
    "seed": (4, {"sensors": NOISE}),
    "flight.V_a_mps": (27.0, {}), "flight.h_m": (700.0, {}), "flight.chi_deg": (25.0, {}),
    "flight.gamma_deg": (4.0, {}), "flight.phi_deg": (10.0, {}), "flight.n_z": (1.3, {}),
    "flight.start": ("heading", {"wind": WIND}), "flight.duration_s": (0.6, {}),
    "flight.g_mps2": (9.0, {}),
    "reference.chi_deg": (50.0, {}), "reference.gamma_deg": (1.0, {}),
    "reference.shape": ("feasible", {}),
    "reference.margin": (0.5, {"reference": TURN | {"shape": "feasible"}}),
    "reference.chi_from_deg": (22.0, {"reference": TURN | {"shape": "feasible"}}),
    "reference.gamma_from_deg": (2.0, {"reference": TURN | {"shape": "feasible"}}),
    "limits.phi_deg": ([-30.0, 10.0], {}), "limits.phi_rate_dps": (20.0, {}),
    "limits.n_z": ([0.8, 1.4], {}), "limits.n_z_rate_per_s": (1.0, {}),
    "controller.rate_hz": (40.0, {}), "controller.anti_windup": ("none", {}),
    "controller.tracking_time_s": (0.3, {"controller": {"anti_windup": "back_calculation"}}),
    "controller.feed_forward": (True, {}),
    "controller.schedule": (True, {"sensors": {"V_a_bias_mps": 2.0}}),
    "disturbance.chi_amplitude": (0.1, {"disturbance": SWING}),
    "disturbance.chi_omega_rad_s": (2.0, {"disturbance": SWING}),
    "disturbance.gamma_amplitude": (0.1, {"disturbance": SWING}),
    "disturbance.gamma_omega_rad_s": (2.0, {"disturbance": SWING}),
    "disturbance.wave": ("square", {"disturbance": SWING}),
    "disturbance.chi_phase_deg": (40.0, {"disturbance": SWING}),
    "disturbance.gamma_phase_deg": (40.0, {"disturbance": SWING}),
    "disturbance.chi_switch_s": ([0.2, 0.3], {"disturbance": {"chi_amplitude": 0.05}}),
    "disturbance.gamma_switch_s": ([0.2, 0.3], {"disturbance": {"gamma_amplitude": 0.05}}),
    "wind.speed_mps": (6.0, {"wind": WIND}), "wind.from_deg": (90.0, {"wind": WIND}),
    "wind.down_mps": (0.5, {"wind": WIND}),
    **{f"sensors.{key}": (x, {"sensors": NOISE}) for key, x in {
        "chi_bias_deg": 1.0, "gamma_bias_deg": 1.0, "chi_noise_sd_deg": 1.0,
        "gamma_noise_sd_deg": 1.0, "noise_time_constant_s": 2.0}.items()},
    **{f"sensors.{key}": (x, {"sensors": NOISE, "controller": {"schedule": True}}) for key, x in {
        "V_a_bias_mps": 1.0, "V_a_noise_sd_mps": 1.0}.items()},
    **{f"navigation.{key}": row for key, row in NAVIGATION.items() if "wind" not in key},
    **{f"plant.{key}": (0.6 if "damp" in key else 0.05 if "delay" in key else 4.0, {})
       for key in LAG if key != "kind"},
    "plant.identified": ("x8", {"plant": [{"kind": "point_mass_lag", "identified": "aerosonde"}]}),
}  # fmt: skip

# Keys of a flight of an aircraft alone; those after the first need a compiled step of their own.
ON_AIRCRAFT = {
    "flight.h_m": (700.0, {}),
    "wind.level": (LEVELS, {}),
    "disturbance": (AS_WIND, {}),
    "disturbance.path": ("air", {"disturbance": AS_WIND}),
    "plant.throttle_max": (0.17, {}),
    "plant.throttle_max_from_s": (0.3, {"plant": [AIRCRAFT | {"throttle_max": 0.17}]}),
    "controller.speed_priority": (True, {"plant": [AIRCRAFT | {"throttle_max": 0.17}]}),
    **{f"navigation.{key}": row for key, row in NAVIGATION.items()},
    "navigation.inner_loop": (True, KNOWN),
    **{key: row for key, row in ON_LAWS.items() if key.startswith("sensors.")},
}
ALONE = {
    "flight.ground_m": (460.0, {"turbulence": {"intensity": "light"}}),
    "turbulence.intensity": ("moderate", {"turbulence": {"intensity": "light"}}),
    "turbulence.severity": (5, {"turbulence": {"severity": 3, "wind_20ft_mps": 8.0}}),
    "turbulence.wind_20ft_mps": (9.0, {"turbulence": {"severity": 3, "wind_20ft_mps": 8.0}}),
    "turbulence.model": ("milspec", {"turbulence": {"intensity": "light"}}),
    **{f"gust.{key}": (x, {"gust": {"axis": "right", "peak_mps": 3.0, "start_s": 0.2,
                                    "length_m": 5.0}})
       for key, x in {"axis": "down", "peak_mps": 4.0, "start_s": 0.3, "length_m": 8.0,
                      "hold_s": 0.1}.items()},
    "plant.airframe.mass_factor": (1.1, {}),
    "plant.airframe.cg_aft_m": (0.01, {}),
    "plant.airframe.lift_factor": (0.9, {}),
    "plant.airframe.drag_factor": (1.2, {}),
    "plant.airframe.thrust_factor": (0.8, {}),
    "plant.airframe.actuator_lag_factor": (2.0, {}),
}  # fmt: skip
# Keys that have tests of their own: what text or tuning means, what is planned, and the airspeed.
ELSEWHERE = {
    *("title", "verifies", "source", "law", "gains", "assumed", "route", "turn_back"),
    *("tuning", "envelope", "expect", "reference.V_mps", "limits.n_x", "limits.n_x_rate_per_s"),
    *(f"plant.{key}" for key in ("kind", "name", "aircraft", "module", "class", "sha256")),
    *(f"plant.{key}" for key in ("parameters", "airframe", "n_x_lag_rad_s", "n_x_damping")),
    "plant.n_x_delay_s",
}


class Plain:
    """The paper's law inside another class, which the plain loop and JSBSim fly."""

    def __init__(self, setup):
        self.signals = {}
        gains = ft.PIGains(**{key: np.array(COUPLED[key]) for key in ("K_P", "K_I")})
        names = ["dt", "anti_windup", "tracking_time", "schedule_speed", "feed_forward", "g"]
        options = {name: getattr(setup, name) for name in names}
        self.dt, self.law = setup.dt, ft.loop.MimoPI(gains, setup.limits, **options)
        self.start = self.law.start

    def step(self, *sample):
        return [*self.law.step(*sample)][:2]


@pytest.fixture(scope="module")
def compiled():
    """A process that has flown so much that it compiles flights; this one soon hits the ground."""
    flight = {"duration_s": 400.0, "h_m": 20.0}
    ft.fly(made_up_scenario(plant=[AIRCRAFT], flight=flight, reference={"gamma_deg": -20.0}))


def changed(made, key, value):
    """The tables with a value at a dotted key."""
    made = copy.deepcopy(made)
    table = made
    *above, last = key.split(".")
    for name in above:
        table = table.setdefault(name, {})
        table = table[0] if isinstance(table, list) else table
    table[last] = value
    return made


def both(made):
    """Signals of the law of the package, whose flight is that of the same one in another class."""
    first, second = ft.fly(ft.scenario_from(made), laws={"plain": Plain}).runs

    assert (first.status, second.status) == ("completed", "completed"), (first.reason, second)
    own = [x for x in second.signals if not x.endswith(("limited", "unlimited"))]
    one, other = (run.signals[own].to_numpy() for run in (first, second))
    assert one.tobytes() == other.tobytes()
    return first


FLOWN = {}  # flights that several keys change


def assert_flown(plant, key, value, beside):
    made = tables(plant, **beside)
    if (stated := repr(made)) not in FLOWN:
        FLOWN[stated] = both(made)
    before, after = FLOWN[stated], both(changed(made, key, value))

    one, other = (run.signals.to_numpy() for run in (before, after))
    assert one.shape != other.shape or not np.array_equal(one, other, equal_nan=True)
    return before, after


@pytest.mark.parametrize("key", [key for key in ON_LAWS if key != "flight.h_m"])
def test_a_key_changes_the_flight_of_a_law_which_another_class_flies_to_the_bit(key):
    assert_flown(LAG, key, *ON_LAWS[key])


@pytest.mark.soak
@pytest.mark.parametrize("key", [*ON_AIRCRAFT, *ALONE])
def test_a_key_changes_the_flight_of_an_aircraft_which_its_compiled_form_flies_to_the_bit(
    compiled, key
):
    pytest.importorskip("numba")
    runs = assert_flown(AIRCRAFT, key, *(ON_AIRCRAFT | ALONE)[key])

    assert all(run.compiled or run.why_jsbsim for run in runs)


def keys(model=ft.Scenario, place=""):
    """Dotted keys of a model and the tables in it."""
    for name, field in model.model_fields.items():
        key = f"{place}.{field.alias or name}".strip(".")
        if key in ELSEWHERE:
            continue
        inside = [x for x in leaves(field.annotation) if issubclass(x, BaseModel)]
        if not inside or key in (*ON_LAWS, "wind.level"):
            yield key
        else:
            yield from keys(inside[0], key)


def leaves(annotation):
    """Every class in an annotation."""
    if isinstance(annotation, type) and not getattr(annotation, "__args__", ()):
        return [annotation]
    return [leaf for part in getattr(annotation, "__args__", ()) for leaf in leaves(part)]


def test_every_key_of_a_flight_has_its_row():
    assert {*keys()} - {*ON_LAWS, *ON_AIRCRAFT, *ALONE} == {
        "disturbance.as_wind"
    }  # as `disturbance`
