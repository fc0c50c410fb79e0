"""What no flight can have is refused when its file is read, in one line that names file and key."""

import pytest
from fuzzing import to_toml
from made_up import scenario_tables

import flighttune as ft

KINEMATIC, AEROSONDE = {"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}
A4 = {"kind": "jsbsim", "aircraft": "a4"}
GAINS = {"name": "x", "K_P": [[1.0, 0.0], [0.0, 1.0]], "K_I": [[1.0, 0.0], [0.0, 1.0]]}
GUST = {"axis": "down", "peak_mps": 3.0, "start_s": 0.1, "length_m": 10.0}
STILL = {"h_m": 9.0, "speed_mps": 0.0, "from_deg": 0.0}
SINUSOID = {
    "chi_amplitude": 0.1, "chi_omega_rad_s": 0.15, "gamma_amplitude": 0.1,
    "gamma_omega_rad_s": 0.15,
}  # fmt: skip
SLOW_WIND = {"chi_amplitude": 1.0, "chi_omega_rad_s": 1e-300, "as_wind": True}
IDENTIFIED = {"model": "identified", "identified": "aerosonde"}

KEYS = [
    ({"flight": {"V_a_mps": -50.0}}, r"\[flight\] `V_a_mps` must be greater .* 1, got -50\.0"),
    ({"flight": {"V_a": 50.0}}, r"\[flight\] `V_a` is not a known key; did you mean `V_a_mps`\?"),
    ({"flight": {"V_a_mps": "25"}}, "`V_a_mps` must be a valid number, got '25'"),
    ({"flight": {"duration_s": 0.01}}, r"`duration_s` of \[flight\] must be at least two samples"),
    ({"flight": {"duration_s": 1e5}}, r"`duration_s` of \[flight\].* 1000000"),
    ({"limits": {"phi_deg": [45.0, -45.0]}}, r"must be a range \[low, high\] with low below high"),
    ({"limits": {"n_z": [1.2, 2.0]}}, r"\[limits\] `n_z` .* level flight, 1, got 1\.2 to 2"),
    ({"limits": {"phi_deg": [10.0, 40.0]}}, r"`phi_deg` .* level flight, 0, got 10 to 40"),
    ({"limits": {"phi_rate_dps": [3.0, 5.0]}}, "`phi_rate_dps` must be a range of rates"),
    ({"controller": {"anti_windup": "clamp"}}, "must be 'none', 'conditional' or 'back_calc"),
    ({"reference": {"chi_deg": [{"shape": "jump"}]}}, "'shape' .*'doublet'"),
    ({"reference": {"chi_deg": 5.0, "chi_from_deg": 3.0}}, "`chi_from_deg` .* must be absent"),
    ({"reference": {"gamma_deg": [{"shape": "step", "start_s": 99.0, "change_deg": 5.0}]}},
     r"\[reference\.gamma_deg\] `start_s` must lie before the end of the flight .*, got 99 s\.$"),
    ({"gains": ["paper", "paper"]}, "`gains` must not name anything twice"),
    ({"gains": [{"name": "x", "K_P": [[1.0]], "K_I": [[1.0]]}]}, "must have 2 rows"),
    ({"gains": [{**GAINS, "name": "x" * 240}]}, "`name`.* 80 bytes"),
    ({"gains": ["tuned_identified"]}, r"`identified` of \[tuning\] must be given"),
    ({"law": "best"}, "`law` must name paper or exact.*, got 'best'"),
    ({"law": ["exact", "exact"]}, "`law` must not name anything twice"),
    ({"law": [{"name": "a", "kind": "paper", "braking": 0.5}]}, "`braking` .* kind exact only"),
    ({"law": [{"name": "exact", "kind": "paper"}]}, "`name` of .* must not be 'exact'"),
    ({"law": "exact", "tuning": {"input_limits": True}}, "`input_limits` of .* the exact law"),
    ({"tuning": {"R_min": 0.3}}, "`R_min` must be absent"),
    ({"tuning": {"E_star": 0.0}}, "`E_star` must be greater than 0"),
    ({"tuning": {"model": "identified", "I_star": 4.0}}, "`I_star` must be absent with model"),
    ({"tuning": {"model": "identified", "lag_rad_s": [4, 8]}}, "`lag_rad_s` must be absent"),
    ({"tuning": {"lag_s": [0.6, 0.2]}}, "`lag_s` must have its low end first"),
    ({"tuning": {"lag_s": [0.2, 0.6], "lag_rad_s": [4, 8]}}, "`lag_rad_s` .* absent with `lag_s`"),
    ({"tuning": {"lag_s": [0.2, 0.6], "objective": "cost"}}, "`lag_s` must be absent with obj"),
    ({"tuning": {"identified": "nowhere.json"}}, r"\[tuning\] `identified` .*nowhere"),
    ({"tuning": {"state_scaling": [1.0]}}, r"`state_scaling` of \[tuning\].* 4 numbers"),
    ({"tuning": {"objective": "decay"}}, "`identified` of .* given: no plant is an aircraft"),
    ({"tuning": {"objective": "E_K", "model": "kinematic"}}, "`model` must be .* or absent"),
    ({"tuning": {"sensitivity_max": 1.3}}, "`sensitivity_max` must be absent"),
    ({"tuning": {**IDENTIFIED, "objective": "E_K", "sensitivity_max": 1.0}}, "`sensitivity_max`"),
    ({"tuning": {**IDENTIFIED, "objective": "rms"}}, "`turbulence` must be given"),
    ({"tuning": {**IDENTIFIED, "objective": "E_K", "feedback": True}}, "`feedback` .* be absent"),
]  # fmt: skip

PLANTS = [
    ({"plant": [{"kind": "jsbsim"}]}, "`aircraft` must be given with kind jsbsim"),
    ({"plant": [{**KINEMATIC, "roll_lag_rad_s": 4.0}]},
     "`roll_lag_rad_s` must be given with kind point_mass_lag only"),
    ({"plant": [{"kind": "point_mass_lag", "roll_lag_rad_s": 4.0}]},
     "`n_z_lag_rad_s` must be given with kind point_mass_lag"),
    ({"plant": [{**AEROSONDE, "throttle_max_from_s": 3.0}]},
     "`throttle_max` must be given beside `throttle_max_from_s`"),
    ({"plant": [{**KINEMATIC, "airframe": {}}]}, "`airframe` must be given with"),
    *(({"plant": [{**AEROSONDE, "name": name}]}, r"\[plant\] `name`")
      for name in ("", "two words", "a:b", "a/b", "a[0]")),
    *(({"plant": [{**AEROSONDE, "airframe": airframe}]}, message) for airframe, message in (
        ({"mass_facto": 1.1}, r"`mass_facto` is not .*did you mean `mass_factor`\?"),
        ({"coefficient_factors": {"Cm_alpha": -1.0}}, "`Cm_alpha` must be greater than"),
        ({"coefficient_factors": {"CM_alpha": 1.1}}, r"`coefficient_factors\.CM_alpha` .*Cm_al"),
        ({"drag_factor": 1e308}, r"\[plant\.airframe\] `drag_factor`.* 100"),
        ({"izz_factor": 1.5}, r"\[plant\.airframe\] `izz_factor` must leave principal inertias"),
    )),
    *(({"plant": [AEROSONDE], table: change}, message) for table, change, message in (
        ("flight", {"h_m": -500.0}, r"\[flight\] `h_m` must .* ground at 0 m, got -500 m"),
        ("flight", {"ground_m": 2e3}, r"\[flight\] `h_m` must be above the ground at 2000 m"),
        ("flight", {"phi_deg": 50.0}, r"\[flight\] `phi_deg` .* in -45 to 45 deg .*, got 50"),
        ("flight", {"n_z": 9.0}, r"\[flight\] `n_z` must lie in .*aircraft\.toml\), got 9"),
        ("limits", {"phi_deg": [50.0, 60.0]}, r"\[limits\] `phi_deg` must overlap -45 to 45 deg"),
        ("limits", {"n_z": [20.0, 30.0]}, r"\[limits\] `n_z` must overlap"),
    )),
    ({"plant": [{**A4, "aircraft": "boeing"}]}, r"\[plant\] `aircraft` must be one of .*'boeing'"),
    ({"plant": [{**A4, "aircraft": "my/b"}]}, r"\[plant\] `aircraft` must be one that can be read"),
]  # fmt: skip

AIR = [
    ({"wind": {"speed_mps": 5.0}}, r"\[wind\] `speed_mps` and `from_deg` must be given"),
    ({"wind": {"speed_mps": 1.0, "from_deg": 0.0, "level": [STILL]}},
     r"\[wind\] `from_deg` must be absent where there are levels"),
    ({"wind": {"down_mps": 1.0, "level": [STILL]}},
     r"\[wind\] `down_mps` must be absent where there are levels"),
    ({"wind": {"level": [STILL] * 2}}, r"`level` must rise in h_m, got \[9.0, 9.0\]"),
    ({"gust": {**GUST, "start_s": 20.0}}, r"\[gust\] `start_s` .* the end .*20 s\), got 20 s"),
    ({"gust": {**GUST, "length_m": 5e-324}}, r"\[gust\] `length_m`.* 0\.1,"),
    ({"gust": GUST}, "`gust` .*jsbsim"),
    *(({"turbulence": change}, "`intensity` must be given, or both `severity` and")
      for change in ({}, {"severity": 3})),
    ({"turbulence": {"intensity": "light", "severity": 3, "wind_20ft_mps": 5.0}}, "in its"),
    ({"disturbance": SINUSOID, "plant": [AEROSONDE]}, "`disturbance` must .* or have `as_wind`"),
    ({"disturbance": {**SINUSOID, "path": "air"}}, '`path` must be "ground" without as_wind'),
    ({"disturbance": {**SINUSOID, "as_wind": True, "path": "air"},
      "wind": {"speed_mps": 5.0, "from_deg": 0.0}},
     r'`path` of \[disturbance\] must be "ground" where there is other wind'),
    ({"disturbance": {"chi_amplitude": 0.1, "as_wind": True}}, "`chi_omega_rad_s` .* positive"),
    ({"disturbance": SLOW_WIND, "plant": [A4]}, r"`chi_amplitude`.* 200 m/s .* 2\.5e\+301"),
    # what no course over ground can be held in
    ({"wind": {"speed_mps": 30.0, "from_deg": 90.0}}, "`speed_mps` of .*got 30 m/s across"),
    ({"wind": {"speed_mps": 26.0, "from_deg": 0.0}}, "`speed_mps` of .*-26 m/s along"),
    ({"wind": {"speed_mps": 30.0, "from_deg": 180.0}, "flight": {"gamma_deg": 60.0},
      "reference": {"gamma_deg": 60.0}}, "`speed_mps` .*got 26 m/s across"),
]  # fmt: skip

STEP = {"shape": "step", "change_deg": 50.0}
STEEP = [
    ({"shape": "step", "start_s": 0.2, "change_deg": 80.0}, 30.0, "110 deg at t = 0.2 s"),
    ({"shape": "ramp", "duration_s": 9.0, "rate_dps": 600.0}, 45.0, "285 deg at t = 0.4 s"),
    ({"shape": "step", "change_deg": -95.0}, 0.0, "-95 deg at t = 0 s"),
    ({"shape": "doublet", "start_s": 0.1, "width_s": 0.1, "amplitude_deg": -20}, 80.0, "100 deg"),
    ({**STEP, "start_s": 0.3}, 50.0, "100 deg at t = 0.3 s"),
]

EXPECT = [
    ({"gains": "paper"}, "`status`, `at_most`"),
    ({"gains": "exact:K1", "status": "completed"}, "`gains` of .* one of paper, got 'exact:K1'"),
    ({"plant": "jsbsim:f16", "status": "completed"}, "`plant` of .* one of kinematic, got"),
    ({"status": "crashed"}, "`status` must be 'completed', "),
    ({"at_most": {"chi": {"MO": 1.0}}}, "`chi.MO`.*MO_rad"),
    ({"at_most": {"chi": {"MO_deg": -1.0}}}, r"`chi\.MO_deg` must be at least 0, got -1"),
    ({"at_most": {"flight": {"V_a_dev_mps": -0.1}}}, r"must be at least 0, got -0\.1"),
    ({"at_most": {"chi": {"band_deg": 1.0}}}, "`chi.band_deg` must be .* beside `settling_s`"),
    ({"at_most": {"chi": {"settling_s": 5.0, "band_deg": 0.0}}}, "must be positive"),
    ({"at_most": {"chi": {"within": [[1, 2]]}}}, r"`chi\.within`.* rising from 0 .* \[\[1"),
    ({"at_most": {"chi": {"within": [[0, 2], [3, 0]]}}}, r"`chi\.within`.* bounds positive"),
    ({"at_most": {"chi": {"within": [[0, 2], [0, 1]]}}}, r"`chi\.within`.* rising"),
    ({"at_most": {"chi": {"within": [[0, 2, 1]]}}}, "`within`.* at most 2 items"),
    ({"at_most": {"chi": {"within": 2.0}}}, r"`chi\.within`.* rows of time"),
    ({"at_most": {"chi": {"MO_deg": [[0, 2]]}}}, r"`chi\.MO_deg` must be a number"),
    ({"at_most": {"chi": {"MO_deg": "2"}}}, "`MO_deg` must be a valid number"),
    ({"at_least": {"chi": {"within": [[0, 2]]}}}, "`within` must be under at_most"),
    ({"at_most": {"loop": {"within": [[0, 2]]}}}, "`within` must be under at_most"),
    ({"at_most": {"cross_track": {"within": [[0, 2]]}}}, r"`cross_track` .* without \[route\]"),
    ({"at_most": {"V": {"within": [[0, 2]]}}}, "`V` .* without `V_mps`"),
]

REFUSED = [
    *(*KEYS, *PLANTS, *AIR),
    *(({"expect": [expect]}, message) for expect, message in EXPECT),
    *(
        (
            {
                "flight": {"duration_s": 0.4, "gamma_deg": start},
                "reference": {"gamma_deg": [change]},
            },
            rf"\[reference\] `gamma_deg` must stay within \+-89 deg, got {where}",
        )
        for change, start, where in STEEP
    ),
]


AUTOPILOT = {"name": "guidance", "kind": "python"}
TWO_POINTS = {"waypoint": [{"north_m": 0.0, "east_m": 0.0}, {"north_m": 900.0, "east_m": 0.0}]}
FOLLOWED = {"reference": {"chi_deg": 0.0, "gamma_deg": 0.0, "V_mps": 25.0}}
AIRSPEED = "where the airspeed is followed"
RANGES = {"V_a_mps": [20.0, 30.0], "gamma_deg": [-5.0, 5.0], "phi_deg": [-9.0, 9.0]}

# What must hold between tables.
REFUSED += [
    ({"gains": ["papr"]}, "`gains` must be one of tuned, paper, .* did you mean paper"),
    (
        {"law": [AUTOPILOT], "tuning": {"E_star": 2.0}},
        r"`E_star` of \[tuning\] must be absent with the law guidance, .* got 2",
    ),
    ({"route": TWO_POINTS}, "`reference` or `route` must be given, and not both"),
    ({"turbulence": {"intensity": "light"}}, "`turbulence` must be absent without a jsbsim"),
    (
        {"wind": {"level": [{"h_m": 0.0, "speed_mps": 1.0, "from_deg": 0.0}]}},
        r"`level` of \[wind\] must be absent without a jsbsim plant",
    ),
    (
        FOLLOWED | {"tuning": {"objective": "cost"}},
        rf"`objective` of \[tuning\] must not be cost {AIRSPEED}",
    ),
    (
        FOLLOWED | {"tuning": {"lag_rad_s": [4.0, 9.0]}},
        rf"`lag_rad_s` of \[tuning\] must be absent {AIRSPEED}",
    ),
    (
        FOLLOWED | {"envelope": RANGES | {"n_z": [0.9, 1.2]}},
        f"`envelope` must be absent {AIRSPEED}",
    ),
    (FOLLOWED, rf"`n_x` of \[limits\] must be given {AIRSPEED}, for the plant kinematic"),
]


@pytest.mark.parametrize(("changes", "message"), REFUSED)
def test_what_cannot_be_is_refused_in_one_line_with_file_and_key(changes, message, tmp_path):
    file = tmp_path / "wrong.toml"
    file.write_text(to_toml(scenario_tables(**changes)))

    with pytest.raises(ft.ScenarioError, match=message) as caught:
        ft.load_scenario(file)

    said = str(caught.value).removeprefix(f"{file}: ")
    assert len(said) < min(len(str(caught.value)), 400)
    assert "\n" not in said


def test_the_longest_time_of_a_route_is_stated():
    tables = scenario_tables(route=TWO_POINTS)
    del tables["reference"]

    with pytest.raises(
        ft.ScenarioError, match=r"`duration_s` of \[flight\] must be given with \[r"
    ):
        ft.scenario_from(tables)
