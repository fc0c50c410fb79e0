"""What sliders stand for: the scenario with the same values set by its keys."""

import tomllib

import pytest

import flighttune as ft
from flighttune.base.files.shipped import aircraft_folders
from flighttune.control.controller_keys import LimitsTable
from flighttune.outputs.live import sliders

SCENARIOS = "level_turn", "paper", "exact_law", "circuit", "turbulent_climb", "paper_as_printed"


def page_of(name):
    scenario, gains = sliders.with_one_gain_set(ft.load_scenario(name), None)
    return scenario, sliders.sliders_of(scenario, gains)


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_page_begins_with_the_flights_of_its_scenario(name):
    scenario, every = page_of(name)
    flown = ft.load_scenario(name, gains=[scenario.gain_names[0]])
    assert sliders.moved(scenario, every, {x.key: x.value for x in every}) is scenario
    assert len({x.key for x in every}) == len(every)
    kept = scenario.model_dump(exclude={"gains"})
    assert kept == flown.model_dump(exclude={"gains"})


@pytest.mark.parametrize(
    ("key", "value", "changes"),
    [
        ("flight.V_a_mps", 27.0, {"flight.V_a_mps": 27.0}),
        ("limits.phi_deg[1]", 30.0, {"limits.phi_deg": [-30.0, 30.0]}),
        ("limits.n_z[1]", 1.5, {"limits.n_z": [-2.1, 1.5]}),
        ("limits.phi_rate_dps", 20.0, {"limits.phi_rate_dps": 20.0}),
        ("wind.speed_mps", 4.0, {"wind.speed_mps": 4.0, "wind.from_deg": 270.0}),
        ("turbulence.intensity", "light", {"turbulence.intensity": "light"}),
        ("navigation.grade", "standard", {"navigation.grade": "standard"}),
        ("seed", 7, {"seed": 7}),
        ("plant.airframe.mass_factor", 1.1, {"plant.airframe.mass_factor": 1.1}),
        ("reference.gamma_deg", 3.0, {"reference.gamma_deg": 3.0}),
    ],
)
def test_a_slider_sets_the_key_of_the_scenario(key, value, changes):
    scenario, every = page_of("level_turn")
    wanted = ft.load_scenario("level_turn", changes=changes)
    same = {"exclude": {"gains", "title"}}
    assert sliders.moved(scenario, every, {key: value}).model_dump(**same) == wanted.model_dump(
        **same
    )


def test_a_gain_that_is_moved_flies_as_the_same_gain_of_a_file(tmp_path):
    scenario, every = page_of("level_turn")
    K_P = ft.PAPER_GAINS.K_P.copy()
    K_P[0, 0] = 1.1
    ft.PIGains(K_P=K_P, K_I=ft.PAPER_GAINS.K_I).save(tmp_path / "mine.json")
    by_file = ft.fly("level_turn", str(tmp_path / "mine.json"))
    by_page = ft.fly(sliders.moved(scenario, every, {"gains[0].K_P[0][0]": 1.1}))
    for one, other in zip(by_page.runs, by_file.runs, strict=True):
        assert one.signals.equals(other.signals)


@pytest.mark.slow
def test_without_limits_those_of_the_aircraft_are_flown_and_have_sliders():
    scenario, every = page_of("climb_beyond_power")
    stated = ft.load_scenario("climb_beyond_power")
    assert stated.limits == LimitsTable()
    # By hand from aircraft/aerosonde/aircraft.toml.
    table = tomllib.loads(aircraft_folders()["aerosonde"].joinpath("aircraft.toml").read_text())
    own, begins = table["limits"], {x.key: x.value for x in every if x.table == "limits"}
    assert begins == {
        "limits.phi_deg[1]": own["phi_deg"][1],
        "limits.phi_rate_dps": own["phi_rate_dps"],
        "limits.n_z[1]": own["n_z"][1],
        "limits.n_z_rate_per_s": own["n_z_rate_per_s"],
    }
    (by_page,), (flown, _) = ft.fly(scenario).runs, ft.fly(stated).runs
    assert by_page.signals.equals(flown.signals)
    moved = sliders.moved(scenario, every, {"limits.n_z[1]": 1.5}).limits
    assert (moved.n_z, moved.phi_deg) == ((own["n_z"][0], 1.5), tuple(own["phi_deg"]))


def test_the_roll_limits_of_both_sides_keep_their_ratio():
    stated = ft.load_scenario("level_turn", changes={"limits.phi_deg": [-30.0, 40.0]})
    scenario, _ = sliders.with_one_gain_set(stated, None)
    every = sliders.sliders_of(scenario, None)
    moved = sliders.moved(scenario, every, {"limits.phi_deg[1]": 20.0})
    assert moved.limits.phi_deg == (-15.0, 20.0)


def test_a_choice_that_is_none_takes_the_table_away():
    scenario, every = page_of("turbulent_climb")
    assert scenario.turbulence is not None
    assert sliders.moved(scenario, every, {"turbulence.intensity": "none"}).turbulence is None


@pytest.mark.parametrize(
    ("values", "what"),
    [
        ({"flight.V_a_mps": "25"}, "`V_a_mps` must be a valid number, got '25'"),
        ({"flight.V_a_mps": float("nan")}, "`V_a_mps` must be a finite number, got nan"),
        ({"flight.V_a_mps": True}, "`V_a_mps` must be a valid number, got True"),
        ({"flight.V_a_mps": 10**400}, "V_a_mps` must be a number of at most 64 bits"),
        ({"flight.V_a_mps": 1e9}, "`V_a_mps` must be less than or equal to 1000"),
        ({"limits.phi_deg[1]": "30"}, "`phi_deg` must be"),
        ({"turbulence.intensity": "mighty"}, "must be 'light', 'moderate' or 'severe', got 'mig"),
        ({"plant[0].module": "law.py"}, "must be a slider of the page"),
    ],
)
def test_a_value_that_no_slider_has_is_refused(values, what):
    with pytest.raises(ft.FlightTuneError, match=what):
        sliders.moved(*page_of("level_turn"), values)


@pytest.mark.parametrize("name", ["paper", "exact_law"])
def test_gains_of_the_channels_come_first_then_those_across_then_the_scenario(name):
    groups = list(dict.fromkeys(slider.group for slider in page_of(name)[1]))

    assert groups[:2] == ["Gains", "Gains across channels"]
    ours = [slider.group for slider in page_of(name)[1]]
    assert ours == sorted(ours, key=groups.index)


@pytest.mark.parametrize(
    ("value", "low", "high"), [(0.5, 0.0, 1.5), (-0.5, -1.5, 1.5), (0.0, 0.0, 6.0)]
)
def test_a_gain_of_a_channel_goes_from_zero_to_three_times_its_value(value, low, high):
    """A gain of zero goes as far as the largest one; gains across channels go to both sides."""
    gains = ft.PIGains(K_P=[[value, 0.25], [0.0, 2.0]], K_I=[[1.0, 0.0], [0.0, 1.0]])

    every = {x.key: x for x in sliders.gain_sliders(gains)}

    first = every["gains[0].K_P[0][0]"]
    assert (first.low, first.high, first.value) == (low, high, value)
    assert (first.group, first.together) == ("Gains", "K_P")
    across = every["gains[0].K_P[0][1]"]
    assert (across.low, across.high) == (-0.75, 0.75)
    assert (across.group, across.together) == ("Gains across channels", "")
    assert every["gains[0].K_P[1][0]"].high == 6.0
    # the gains of the channels come before those across them
    assert [x.group for x in every.values()] == ["Gains"] * 4 + ["Gains across channels"] * 4


def test_a_feedback_goes_from_zero_to_nearly_one_where_the_law_has_it():
    gains = {"K_P": [[0.5, 0.0], [0.0, 0.25]], "K_I": [[0.1, 0.0], [0.0, 0.1]]}
    rates = ft.PIGains(**gains, inputs=("chi_dot", "gamma_dot"), feedback=(0.25, 0.5))

    every = sliders.gain_sliders(rates)

    fed_back = {x.key: x for x in every if "feedback" in x.key}
    assert [(x.value, x.low, x.high) for x in fed_back.values()] == [
        (0.25, 0.0, 0.95), (0.5, 0.0, 0.95),
    ]  # fmt: skip
    assert [x.label for x in fed_back.values()] == ["feedback of φ", "feedback of n_z"]
    assert not [x for x in sliders.gain_sliders(ft.PIGains(**gains)) if "feedback" in x.key]
