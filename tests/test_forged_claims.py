"""No claim of any kind is believed once its file was edited, also with a SHA-256 made anew."""

import copy
import random
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from counted_turns import ALONE, WITH_FIVE, count, small_plan
from dispersed import AEROSONDE, KINEMATIC
from flown_campaigns import flown_here
from forging import Opened, forged, same
from fuzzing import marked
from made_up_band import count_of
from made_up_hours import SHORT, fence_around, hours_flown, made_up_hours

import flighttune as ft
from flighttune.base.files.load import CAMPAIGN, CLAIMS
from flighttune.campaigns.dataset import Dataset
from flighttune.claims.about import KINDS as COUNTS
from flighttune.claims.counted_flights import turning_back
from flighttune.claims.turn_back import TurnBack

SEED = 105
FEW, MANY = 12, 300
NUMBERS = [FEW, pytest.param(MANY, marks=pytest.mark.counts)]
"""Forgeries of each kind of claim: with the other tests, and in counts."""

OLD = Path(__file__).parent / "files_of_0_3_0"


def written_anew(*names):
    """Files of 0.3.0 as they are written today."""
    return lambda folder: [_saved(ft.load(OLD / name), folder / name) for name in names]


def _saved(claim, path):
    claim.save(path)
    return path


def bands(folder):
    return [_saved(count(flights=n), folder / f"{n}.npz") for n in (ALONE, WITH_FIVE)]


def counts_on_aircraft(kind, **settings):
    """Counts of the Aerosonde's flights, of two seeds."""

    def make(folder):
        plan = small_plan(plants=(KINEMATIC, AEROSONDE))
        return [
            _saved(count(plan, kind=kind, flights=ALONE, seed=seed, **settings),
                   folder / f"{seed}.npz")
            for seed in (1, 2)
        ]  # fmt: skip

    return make


def rooms(folder):
    """Rooms to turn back of flights that are made up: none is flown before the file is opened."""
    plan = ft.flights("circuit", changes=SHORT).plan(plant="kinematic", gains="paper")
    plan, few = turning_back(plan, 30.0).with_runs(17), {"epsilon": 0.3, "confidence": 0.9}
    measured = TurnBack.measures.chosen(plan, None)
    rooms = [count_of(TurnBack, plan, measured, [far, 3.4], np.ones(7), **few) for far in (90, 271)]
    return [_saved(room, folder / f"{i}.npz") for i, room in enumerate(rooms)]


def monitors_of_logs(folder):
    rng, t = np.random.default_rng(5), np.arange(600) / 25.0

    def log(i):
        phi, p = 0.5 * np.sin(0.7 * t + i), 0.35 * np.cos(0.7 * t + i)
        r = 0.5 * np.sin(phi) + 0.1 * p + 0.02 * rng.normal(size=len(t))
        table = {"t_s": t, "phi_rad": phi, "p": p, "r": r, "v_north": 20.0, "v_east": 0.0 * t}
        pd.DataFrame(table).to_csv(folder / f"{i}.csv", index=False)
        return ft.load_log(folder / f"{i}.csv")

    logs = [log(i) for i in range(4)]
    return [_saved(ft.monitor(*some), folder / f"{len(some)}.npz") for some in (logs, logs[:3])]


def hours(folder):
    return [
        _saved(made_up_hours(half), folder / f"{half:g}-per-hour.json") for half in (40.0, 60.0)
    ]


# Makers of two honest files of each kind of claim, in a folder.
MAKERS = {
    "flighttune certificate": written_anew("certificate.json", "certificate_sampled.json"),
    "flighttune rate bound": written_anew("bound.json"),
    "flighttune tube": written_anew("tube.npz", "tube_for_ever.npz"),
    "flighttune band": bands,
    "flighttune band of residual": counts_on_aircraft(ft.residual),
    "flighttune band of monitor": counts_on_aircraft(ft.monitor, learn=20),
    "flighttune band of turn_back": rooms,
    "flighttune monitor": monitors_of_logs,
    "flighttune flight hours": hours,
}

# Kinds whose files are there at once: no aircraft flies for them.
AT_ONCE = [kind for kind in MAKERS if not kind.endswith(("of residual", "of monitor"))]


def test_every_kind_of_claim_has_its_forger():
    bands_of = {f"flighttune band of {of}" for of in COUNTS if of}
    assert {*MAKERS} == {*CLAIMS} | bands_of


def believed(path, **by):
    """What a file claims, if `verify` finds it valid; else None, and its reason in one line."""
    try:
        verified = ft.verify(path, **by)
    except ft.InputError:
        return None
    assert "\n" not in verified.reason
    return verified if verified.valid else None


@pytest.fixture(scope="module")
def made(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("claims")
    files = MAKERS[request.param](folder)
    for file in files:
        ft.load(file)
    return [Opened.of(file) for file in (files * 2)[:2]], files[0]


def several(made, draw, number):
    """Forgeries that say other things than the honest file."""
    (whole, other), _ = made
    while number:
        changed, place = forged(whole, other, draw)
        if not same(changed, whole):
            number -= 1
            yield changed, place


@pytest.mark.slow
@pytest.mark.parametrize("made", marked(MAKERS, pytest.mark.soak, but=AT_ONCE), indirect=True)
@pytest.mark.parametrize("number", NUMBERS)
def test_a_file_that_was_edited_is_believed_in_no_place(made, number, tmp_path):
    path = tmp_path / made[1].name
    for changed, place in several(made, random.Random(SEED), number):
        changed.write(path, anew=False)

        assert believed(path) is None, place


@pytest.mark.parametrize("made", ["flighttune certificate"], indirect=True)
def test_a_file_without_its_seal_is_not_taken_for_an_old_one(made, tmp_path):
    (whole, _), file = made
    del whole.tables["sha256"]
    whole.write(path := tmp_path / file.name, anew=False)

    assert believed(path) is None


@pytest.mark.parametrize("number", NUMBERS)
def test_the_plan_of_a_campaign_that_was_edited_is_refused(number, tmp_path):
    Dataset(tmp_path, small_plan(), {}).write_plan()
    file = tmp_path / CAMPAIGN
    whole = Opened.of(file)
    ft.load(tmp_path)
    for changed, place in several(([whole, whole], file), random.Random(SEED), number):
        changed.write(file, anew=False)

        with pytest.raises(ft.InputError):
            pytest.fail(f"{place} is believed: {ft.load(tmp_path)}")


# What a forger of hours can change who makes the SHA-256 anew. Declarations and choices are told
# in the first lines or the table of flights, so a reader sees them; notes of the mission are in no
# sentence. All else is derived again, or compared with the times of flights that are flown again.
TOLD = {
    *("rates.target_per_hour", "rates.ending.fall_per_height", "rates.ending.after_alarm_s"),
    *("rates.fault.per_hour", "rates.fault.source", "rates.fault.detected_s", "confidence"),
    *("plan.campaign", "plan.nominal", "fence"),
}
NOTES = {
    *("alarms", "later"),  # of none of which a file may say nothing
    *("plan.campaign", "plan.nominal", "plan.central", "plan.runs"),
    *("plan.gains", "plan.version", "around", "units"),
}


def name_of(place):
    return ".".join(key for key in place if isinstance(key, str))


def lines(verified):
    """What `verify` says first, of the claim and what it is about, and its table of flights."""
    said = verified.answer()
    return [*said.summary, *(x.records for x in said.tables if x.name == "dispersions")]


@pytest.fixture(scope="module")
def flown_hours(tmp_path_factory):
    """Two claims per flight hour that were flown, in fences of 84 and 124 m."""
    folder = tmp_path_factory.mktemp("hours")
    files = [_saved(hours_flown(half), folder / f"{half:g}.json") for half in (42.0, 62.0)]
    return [Opened.of(file) for file in files], files[0]


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize("number", NUMBERS)
def test_hours_with_a_hash_made_anew_are_not_valid_or_tell_what_was_changed(
    flown_hours, number, tmp_path
):
    path, seen = tmp_path / flown_hours[1].name, Counter()
    with flown_here():
        honest = believed(flown_hours[1], count=99)
        assert honest is not None
        for changed, place in several(flown_hours, random.Random(SEED), number):
            changed.write(path, anew=True)

            verified = believed(path, count=99)

            name = name_of(place)
            if verified is None:
                seen["not valid"] += 1
            elif lines(verified)[1:] == lines(honest)[1:]:
                assert name.startswith(tuple(NOTES)), f"{name} is in no line"
                seen["says the same"] += 1
            else:
                assert name.startswith(tuple(TOLD)), f"{name} is not checked"
                seen["tells it"] += 1
    sys.stdout.write(f"{dict(seen)}\n")


def erased(tables):
    for term in tables["terms"]:
        term["left_s"] = [-1.0] * len(term["left_s"])


def wide(tables):
    erased(tables)
    tables["volume"]["rings"] = [[[-5e3, -5e3], [5e3, -5e3], [5e3, 5e3], [-5e3, 5e3]]]


def wide_fence(tables):
    wide(tables)
    tables["fence"] = fence_around(5e3)


def other_ending(tables):
    tables["terms"][1]["ended_at_s"][0] += 0.02


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize("change", [erased, wide, wide_fence, other_ending])
def test_erased_exits_and_exchanged_volumes_fail_with_a_hash_made_anew(
    flown_hours, change, tmp_path
):
    (whole, _), file = flown_hours
    changed = copy.deepcopy(whole)
    change(changed.tables)
    changed.write(path := tmp_path / file.name, anew=True)

    with flown_here():
        assert believed(path) is None
