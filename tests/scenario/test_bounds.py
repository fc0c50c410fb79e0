"""Numbers that no flight has: refused when the file is read, by a bound in the message."""

import pytest
from made_up import made_up_scenario

import flighttune as ft

GUST = {"axis": "down", "peak_mps": 3.0, "start_s": 0.1, "length_m": 10.0}
GAINS = {"name": "x", "K_P": [[1.0, 0.0], [0.0, 1.0]], "K_I": [[1.0, 0.0], [0.0, 1.0]]}


def short(*, flight=(), **changes):
    return made_up_scenario(flight={"duration_s": 0.4, **dict(flight)}, **changes)


AIRCRAFT = {"kind": "jsbsim", "aircraft": "a4"}
SLOW_WIND = {"chi_amplitude": 1.0, "chi_omega_rad_s": 1e-300, "as_wind": True}
BEYOND = [
    ({"flight": {"duration_s": 1e5}}, r"`duration_s` of \[flight\].* 1000000"),
    ({"gust": {**GUST, "length_m": 5e-324}}, r"\[gust\] `length_m`.* 0\.1,"),
    ({"disturbance": SLOW_WIND, "plant": [AIRCRAFT]}, r"`chi_amplitude`.* 200 m/s .* 2\.5e\+301"),
    ({"gains": [{**GAINS, "name": "x" * 240}]}, r"`name`.* 80 bytes"),
    ({"tuning": {"state_scaling": [1.0]}}, r"`state_scaling` of \[tuning\].* 4 numbers"),
    (
        {"plant": [{**AIRCRAFT, "airframe": {"drag_factor": 1e308}}]},
        r"\[plant\.airframe\] `drag_factor`.* 100",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), BEYOND)
def test_a_number_beyond_its_bound_is_refused_with_key_and_bound(changes, message):
    with pytest.raises(ft.ScenarioError, match=message) as caught:
        ft.fly(short(**changes))

    assert len(str(caught.value)) < 300


PATHS = [
    (30.0, [{"shape": "step", "start_s": 0.2, "change_deg": 80.0}], "110 deg at t = 0.2 s"),
    (45.0, [{"shape": "ramp", "duration_s": 9.0, "rate_dps": 600.0}], "285 deg at t = 0.4 s"),
    (0.0, [{"shape": "step", "change_deg": -95.0}], "-95 deg at t = 0 s"),
    (80.0, [{"shape": "doublet", "start_s": 0.1, "width_s": 0.1, "amplitude_deg": -20}], "100 deg"),
    (
        0.0,
        [{"shape": "step", "change_deg": 50}, {"shape": "step", "start_s": 0.3, "change_deg": 50}],
        "100 deg at t = 0.3 s",
    ),
]


@pytest.mark.parametrize(("start", "segments", "where"), PATHS)
def test_a_path_angle_beyond_the_vertical_is_refused_wherever_it_comes_from(start, segments, where):
    message = rf"\[reference\] `gamma_deg` must stay within \+-89 deg, got {where}"
    with pytest.raises(ft.ScenarioError, match=message):
        short(flight={"gamma_deg": start}, reference={"gamma_deg": segments})


def test_a_path_angle_beyond_the_vertical_that_is_never_reached_is_flown():
    steep = [{"shape": "ramp", "start_s": 0.3, "duration_s": 60.0, "rate_dps": 10.0}]

    short(flight={"gamma_deg": 87.0}, reference={"gamma_deg": steep})


@pytest.mark.parametrize(
    ("duration", "rate", "flown"), [(3.0, 1.5, 8 / 3), (0.05, 50.0, 0.04), (10.0, 7.3, 10.0)]
)
def test_a_duration_that_is_no_whole_number_of_samples_is_said(duration, rate, flown):
    scenario = short(flight={"duration_s": duration}, controller={"rate_hz": rate})
    (run,) = ft.fly(scenario).runs

    assert run.duration == pytest.approx(flown)
    (note,) = scenario.notes if flown != duration else ("",)
    assert note.endswith(f"{flown:.6g} s are flown" if note else "")


@pytest.mark.parametrize(
    ("expect", "message"),
    [
        ({"at_most": {"chi": {"within": [[1, 2]]}}}, r"`chi\.within`.* rising from 0 .* \[\[1"),
        ({"at_most": {"chi": {"within": [[0, 2], [3, 0]]}}}, r"`chi\.within`.* bounds positive"),
        ({"at_most": {"chi": {"within": [[0, 2], [0, 1]]}}}, r"`chi\.within`.* rising"),
        ({"at_most": {"chi": {"within": [[0, 2, 1]]}}}, r"`within`.* at most 2 items"),
        ({"at_most": {"chi": {"within": 2.0}}}, r"`chi\.within`.* rows of time"),
        ({"at_most": {"chi": {"MO_deg": [[0, 2]]}}}, r"`chi\.MO_deg` must be a number"),
        ({"at_most": {"chi": {"MO_deg": "2"}}}, r"`MO_deg` must be a valid number"),
        ({"at_least": {"chi": {"within": [[0, 2]]}}}, r"`within` must be under at_most"),
        ({"at_most": {"loop": {"within": [[0, 2]]}}}, r"`within` must be under at_most"),
        ({"at_most": {"cross_track": {"within": [[0, 2]]}}}, r"`cross_track` .* without \[route\]"),
        ({"at_most": {"V": {"within": [[0, 2]]}}}, r"`V` .* without `V_mps`"),
    ],
)
def test_an_envelope_that_is_none_is_refused_in_a_line(expect, message):
    with pytest.raises(ft.ScenarioError, match=message) as caught:
        short(expect=[expect])

    assert len(str(caught.value)) < 250
