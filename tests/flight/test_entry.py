"""What flies: the cells of plants, laws and gains, by the names that runs have."""

import numpy as np
import pytest

import flighttune as ft
from flighttune.flight.conditions import reference_of
from flighttune.flight.entry import entries, entry_of

WIND = {"speed_mps": 5.0, "from_deg": 90.0}


def scenario(**changed):
    """Two laws on the law itself and on an aircraft, in wind."""
    tables = ft.load_scenario("paper").as_dict() | {"expect": [], "wind": WIND}
    return ft.scenario_from(tables | {"law": ["paper", "exact"], "gains": ["paper"]} | changed)


@pytest.fixture(scope="module")
def cells():
    """Every entry of the scenario, with the same numbers for both laws."""
    made = scenario()
    return entries(made, dict.fromkeys(made.gain_names, ft.PAPER_GAINS))


def test_entries_are_the_runs_of_the_scenario_in_their_order(cells):
    flown = ft.fly(cells[0].scenario)

    assert [entry.label for entry in cells] == [run.label for run in flown.runs]
    for entry, run in zip(cells, flown.runs, strict=True):
        assert entry.plant.label == run.provenance.plant
        assert entry.name == run.provenance.gains_name
        assert run.provenance.listed == entry.listed == "paper"


@pytest.mark.parametrize(
    ("laws", "name", "law", "listed"),
    [
        (["paper", "exact"], "paper", "paper", "paper"),
        (["paper", "exact"], "exact:paper", "exact", "paper"),
        (["exact"], "paper", "exact", "paper"),  # the only law is meant
        (["exact"], "paper:paper", "paper", "paper"),  # that a scenario can name without a table
    ],
)
def test_a_name_says_its_law_and_gains(laws, name, law, listed):
    entry = entry_of(scenario(law=laws), name, None)

    assert (entry.law.name, entry.listed, entry.name) == (law, listed, name)


def test_gains_that_a_law_does_not_take_are_flown_by_the_law_they_are_of():
    rates = ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0, g=9.81)

    assert entry_of(scenario(), "mine", rates).law.name == "exact"
    assert entry_of(scenario(law=["paper"]), "mine", rates).law.kind == "exact"


def test_gains_that_tuning_did_not_find_are_refused_where_they_are_needed():
    with pytest.raises(ft.InputError, match=r"`gains` must be there to fly, got none for paper"):
        _ = entry_of(scenario(), "paper", None).found_gains


def test_a_plant_without_weather_replays_the_wind_of_the_aircraft_with_its_gains(cells):
    aircraft = {entry.name: entry for entry in cells if entry.plant.aircraft}

    for entry in cells:
        source = entry.wind_from
        assert (source is None) == (entry.plant.aircraft is not None)
        if source is not None:
            assert source.label == aircraft[entry.name].label
    still = entries(scenario(wind=None), {"paper": ft.PAPER_GAINS})
    assert [entry.wind_from for entry in still] == [None, None]


def test_the_limits_of_an_aircraft_bound_its_own_flights_alone():
    wide = {"phi_deg": [-80.0, 80.0], "n_z": [-9.0, 9.0]}
    law, aircraft = entries(scenario(limits=wide, law=["paper"]), {"paper": ft.PAPER_GAINS})

    assert law.limits.upper.tolist() == pytest.approx([np.deg2rad(80.0), 9.0])
    own = aircraft.plant.config.limits
    assert aircraft.limits.upper.tolist() == pytest.approx([own.phi[1], own.n_z[1]])


def test_what_a_scenario_means_is_found_anew_for_a_changed_copy():
    made = scenario()
    before = reference_of(made).initial
    flight = made.flight.model_copy(update={"chi_deg": made.flight.chi_deg + 30.0})
    reference = made.reference.model_copy(update={"chi_deg": 77.0})

    changed = made.model_copy(update={"flight": flight, "reference": reference})

    assert reference_of(made) is reference_of(made)
    assert reference_of(changed).initial[0] == pytest.approx(np.deg2rad(77.0))
    assert reference_of(made).initial == before
