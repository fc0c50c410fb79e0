"""Band files that were edited and sealed again: each edit that changes a claim is refused."""

import copy
from dataclasses import replace
from textwrap import dedent

import numpy as np
import pytest
from campaigns import flown_here
from commands import flighttune

import flighttune as ft
from flighttune.campaign import band as band_module
from flighttune.campaign import claims
from flighttune.campaign.band import count_more, load_band, recount
from flighttune.files.value import tables_of
from flighttune.flight import own
from tests.campaign.test_band import WITH_FIVE, count, small_plan
from tests.claims.test_band import forged
from tests.cli.test_code_of_files import LAW


@pytest.fixture(scope="module")
def counted():
    return count()


def verified(path, status, monkeypatch, *options):
    """What `verify` says where it flies all flights again, in this process."""
    monkeypatch.setattr(claims, "FLOWN_AGAIN", WITH_FIVE)
    with flown_here(band_module):
        return "".join(flighttune("verify", path, *options, status=status))


def edited(band, *keys, value):
    """The plan of a band with another value."""
    plan = copy.deepcopy(tables_of(band.about)["plan"])
    table = plan
    for key in keys[:-1]:
        table = table[key]
    table[keys[-1]] = value
    return {"plan": plan}


def planned(*keys):
    """A forgery of the plan: 30 in the place of what it has."""
    return lambda band: {"about": edited(band, *keys, value=30)}


def counted_as(change):
    """A forgery of the flights that were counted."""

    def forgery(band):
        extremes = change(band.extremes).astype(np.float32)
        return {"extremes": extremes, "wind": np.zeros((len(extremes), 0))}

    return forgery


@pytest.mark.parametrize(
    "forgery",
    [
        planned("campaign", "disperse", 0, "upper"),
        planned("campaign", "seed"),
        lambda band: {"about": {"signals": dict(reversed(band.about.signals.items()))}},
        counted_as(lambda flights: 0.3 * flights),
        counted_as(lambda flights: 0.0 * flights),
        counted_as(lambda flights: np.concatenate([flights, flights])),
    ],
)
def test_a_forged_file_has_other_flights(counted, tmp_path, monkeypatch, forgery):
    path = forged(counted, tmp_path / "x.npz", **forgery(counted))

    assert "flights flown again must be equal" in verified(path, 1, monkeypatch)


def test_a_single_copy_is_flown_again(counted):
    extremes = counted.extremes.copy()
    extremes[20] = extremes[3]

    with flown_here(band_module) as pool:
        assert 10 + 20 in recount(replace(counted, extremes=extremes), 1, pool)


@pytest.mark.parametrize(
    ("about", "says"),
    [
        ({"distribution": "any aircraft in any wind"}, "`distribution`"),
        ({"readings": [29]}, "`readings`"),
        ({"edges": [0.0, 1.0]}, "`edges`"),
        ({"learned": 11}, "`extremes` must be of as many flights"),
        ({"plan": {"version": 1}}, "`plan` must be that of a campaign"),
    ],
)
def test_a_file_that_states_what_follows_from_its_plan_is_refused(counted, tmp_path, about, says):
    path = forged(counted, tmp_path / "x.npz", about=about)

    _, stderr = flighttune("verify", path, status=2)

    assert says in stderr
    assert stderr.count("\n") == 1


def test_the_median_scenario_of_a_file_is_not_believed(counted, tmp_path):
    """The sentence names the airspeed of the flights, which are drawn about the nominal one."""
    about = edited(counted, "central", "flight", "V_a_mps", value=99.0)

    assert load_band(forged(counted, tmp_path / "x.npz", about=about)).sentence == counted.sentence


def test_names_that_a_maker_chose_are_quoted_and_no_part_of_the_claim(counted, tmp_path):
    about = edited(counted, "campaign", "title", value='calm" air.\n Proven')
    about["plan"]["groups"][0]["gains"] = "tuned"
    about["plan"]["gains"] = {"tuned": about["plan"]["gains"]["soft"]}
    band = load_band(forged(counted, tmp_path / "x.npz", about=about))

    (claim, maker), (before, _) = (x.sentence.split("; its maker calls ") for x in (band, counted))

    assert claim == before
    assert "flights of kinematic under the paper law at 25 m/s" in claim
    assert maker == """the flights "calm' air. Proven" and the gains "tuned\""""


def test_a_continued_count_cannot_pass_for_one_planned_so_long(counted, tmp_path, monkeypatch):
    with flown_here(band_module) as pool:
        more = count_more(counted, 2 * WITH_FIVE, pool)
    about = edited(more, "runs", value=10 + 2 * WITH_FIVE)
    path = forged(more, tmp_path / "x.npz", about=about)

    assert load_band(path).confidence > more.confidence
    assert "flights flown again must be equal" in verified(path, 1, monkeypatch)


def test_the_code_of_a_strangers_file_is_run_only_where_that_is_asked_for(tmp_path, monkeypatch):
    code, mark, path = tmp_path / "law.py", tmp_path / "ran", tmp_path / "x.npz"
    code.write_text(dedent(LAW))
    law = {"name": "mine", "kind": "python", "module": str(code), "class": "Mine"}
    ft.save_claim(count(small_plan(law=[law])), path)
    mark.unlink()
    own._module.cache_clear()

    assert "No flight was flown again: --run-code" in verified(path, 0, monkeypatch)
    assert not mark.exists()
    own._module.cache_clear()
    assert "flown again: equal to the bit" in verified(path, 0, monkeypatch, "--run-code")
    assert mark.exists()
