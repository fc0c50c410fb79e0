"""Band files that were edited and sealed again: what flying all flights again shows, and no word
of a sentence that is from a field which nothing checks."""

import copy
import json
import math

import numpy as np
import pytest
from flown_campaigns import flown_here
from forging import Opened, changed
from scipy.stats import hypergeom
from small_claims import (
    ALONE,
    RULE,
    STRAIGHT,
    WITH_FIVE,
    around_leg,
    band,
    folder,
    monitor,
    residual,
)

import flighttune as ft
from flighttune.claims.shape import learned_shape


def flown_again(path):
    """What `verify` finds where it flies all flights again, in this process."""
    with flown_here():
        return ft.verify(path, count=len(ft.load(path).scores))


def copies(times):
    flights = Opened.of(band()).arrays["extremes"]
    flights = np.concatenate([flights * np.float32(factor) for factor in times])
    return {"extremes": flights, "wind": np.zeros((len(flights), 0))}


def one_copy():
    flights = Opened.of(band()).arrays["extremes"]
    flights[20] = flights[3]
    return {"extremes": flights}


def turned(tables):
    tables["signals"] = dict(reversed(tables["signals"].items()))


@pytest.mark.parametrize(
    ("change", "arrays"),
    [
        ({}, lambda: copies([0.3])),
        ({}, lambda: copies([1.0, 1.0])),
        ({}, one_copy),
        (lambda x: x["plan"]["campaign"].update(seed=30), dict),
        (turned, dict),
    ],
)
def test_a_forged_file_has_other_flights_or_is_about_others(change, arrays, tmp_path):
    verified = flown_again(changed(band(), tmp_path / "x.npz", change, **arrays()))

    assert not verified.valid
    assert "flown again must be equal" in verified.reason


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"distribution": "any aircraft in any wind"}, "`distribution`"),
        ({"readings": [29]}, "`readings`"),
        ({"edges": [0.0, 1.0]}, "`edges`"),
        ({"plan": {"version": 1}}, "`plan` must be that of a campaign"),
        (lambda x: x["plan"]["campaign"].pop("seed"), "`plan` must be that of a campaign, with"),
        (lambda x: x["plan"].update(aircraft=1.5), "`plan` must be that of a campaign"),
        (lambda x: x["plan"].update(runs=10**12), r"`plan\.runs` must be"),
        (lambda x: x["plan"].update(runs=10**400), r"`plan\.runs` must be"),
    ],
)
def test_a_file_that_states_what_follows_from_its_plan_is_refused_at_once(change, says, tmp_path):
    with pytest.raises(ft.InputError, match=says) as refused:
        ft.load(changed(band(), tmp_path / "x.npz", change))
    assert "\n" not in str(refused.value)


def test_the_median_scenario_of_a_file_is_not_believed(tmp_path):
    """The sentence names the airspeed of the flights, which are drawn about the nominal one."""

    def faster(tables):
        tables["plan"]["central"]["flight"]["V_a_mps"] = 99.0

    forgery = changed(band(), tmp_path / "x.npz", faster)

    assert ft.load(forgery).sentence == ft.load(band()).sentence


def test_names_that_a_maker_chose_are_quoted_and_no_part_of_the_claim(tmp_path):
    def renamed(tables):
        plan = tables["plan"]
        plan["campaign"]["title"] = 'calm" air.\n Proven'
        plan["gains"] = {"tuned": plan["gains"][plan["groups"][0]["gains"]]}
        plan["groups"][0]["gains"] = "tuned"

    forgery = ft.load(changed(band(), tmp_path / "x.npz", renamed))

    (claim, maker), (before, _) = (
        x.sentence.split("; its maker calls ") for x in (forgery, ft.load(band()))
    )
    assert claim == before
    assert "calm' air. Proven" in maker
    assert "\n" not in maker


def test_a_continued_count_cannot_pass_for_one_planned_so_long(tmp_path):
    file = tmp_path / "more.npz"
    file.write_bytes(band(ALONE).read_bytes())
    with flown_here():
        more = ft.band(file, flights=2 * ALONE)

    path = changed(file, tmp_path / "x.npz", lambda x: x["plan"].update(runs=10 + 2 * ALONE))

    assert ft.load(path).confidence > more.confidence
    assert "flown again must be equal" in flown_again(path).reason


@pytest.mark.parametrize("names", [["half"], ["coefficients"], ["half", "coefficients"]])
def test_a_shape_that_was_fitted_to_the_flights_counted_is_refused(names, tmp_path):
    counted = ft.load(band())
    fitted = learned_shape(counted.extremes, counted.wind, counted.about.epsilon)
    shape = dict(zip(("coefficients", "half"), fitted, strict=True))
    shape = {name: shape[name].tolist() for name in names}

    verified = flown_again(changed(band(), tmp_path / "x.npz", shape))

    assert not verified.valid
    assert f"`{max(names)}` must follow from the 10 flights learned from" in verified.reason


def test_a_claim_that_hides_the_one_planned_is_not_valid(tmp_path):
    """The shape is that of the planned epsilon: the scale of the last tenths of 10 flights."""
    file = tmp_path / "other.npz"
    ft.band(band(), epsilon=0.5, confidence=0.9, out=file)

    hidden = changed(file, tmp_path / "x.npz", {"planned": None})

    assert flown_again(file).valid
    assert not flown_again(hidden).valid


def test_the_chance_that_verify_misses_a_forgery_is_that_of_doubling_epsilon():
    """Of N flights counted, K = epsilon N are forged, and n are flown again."""
    with flown_here():
        note = " ".join(ft.verify(band(), count=3).answer().notes)

    forged = math.ceil(RULE["epsilon"] * WITH_FIVE)
    missed = hypergeom.pmf(0, WITH_FIVE, forged, 3)
    assert f"forgery of {forged} counted flights, which would double epsilon" in note
    assert f"missed with probability {missed:.2g}." in note


@pytest.mark.slow
def test_a_flight_that_cannot_start_is_the_reason_why_its_signals_cannot_be_counted():
    dive = ft.load_scenario("level_turn", changes={"flight.gamma_deg": -30.0})

    with pytest.raises(ft.InputError, match=r"must start: .* no steady .*[^.]\.$"):
        ft.band(dive, start_deg=1.0, plant="jsbsim:aerosonde", gains="paper", signals=["h"])


@pytest.mark.slow
def test_flights_of_an_aircraft_whose_files_have_changed_are_not_flown_again(tmp_path):
    def of_others(tables):
        tables["plan"]["aircraft"] = dict.fromkeys(tables["plan"]["aircraft"], "0" * 64)

    path = changed(residual(), tmp_path / "x.npz", of_others)
    run = next(
        x for x in ft.fly(folder() / "turn.toml", "paper").runs if x.label.startswith("jsbsim")
    )

    assert "the files of aerosonde are not those counted on" in ft.load(path).why_not(run)
    verified = flown_again(path)
    assert not verified.valid
    assert "`aerosonde` must have the files" in verified.reason


# ---------------------------------------------------------------- every field of every kind
# Other words than those of a plan that its file may have too.
WORDS = {"random": "sobol", "sets": "adds", "course": "heading", "conditional": "none",
         "kinematic": "point_mass", "full": "decoupled", "R_K": "decay"}  # fmt: skip
# Choices that no file can show to have been made before a flight was counted: a note says so.
CHOSEN = {("epsilon",), ("confidence",)}
# Of these another value is true of the same flights too: at one airspeed, of gains that grow with
# it; and of the height of kinematic flights in calm air.
TRUE_TOO = "schedule", "V_a_mps", "h_m"


def fields(tables, above=()):
    """Every value in tables with its place."""
    for key, value in tables.items() if isinstance(tables, dict) else enumerate(tables):
        if isinstance(value, dict | list):
            yield from fields(value, (*above, key))
        else:
            yield (*above, key), value


def other(value):
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return WORDS.get(value, f"{value}, forged")
    return "forged" if value is None else value + (1 if isinstance(value, int) else 0.01)


def told(counted):
    """All that a count says of its flights, without what its maker calls them."""
    answer = counted.answer()
    notes = [note for note in answer.notes if "nearest to leaving" not in note]
    flights = next(table.records for table in answer.tables if table.name == "dispersions")
    values = [answer.values.get(key) for key in ("room", "models", "fence")]
    return counted.sentence.partition("; its maker")[0], notes, values, flights


def until_sure(folder):
    """The file of a count on a leg in a fence until it is sure."""
    fence, out = folder / "fence.geojson", folder / "sure.npz"
    fence.write_text(json.dumps(around_leg(60.0)))
    with flown_here():
        ft.mission(
            "circuit_in_wind", changes=STRAIGHT, fences=[fence], until_sure=True, out=out, **RULE
        )
    return out


# Makers of files, with the fields that these have beside those of all.
KINDS = {
    "recorded": (lambda _: band(ALONE), [()]),
    "residual": (lambda _: residual(),
                 [("of",), ("signals",), ("plan", "aircraft"), ("plan", "nominal", "plant")]),
    "monitor": (lambda _: monitor(), [("of",), ("signals",), ("models",)]),
    # its fence is what it is about: the flights are counted in another one again
    "until_sure": (until_sure, [("until_sure",), ("learned",), ("planned",), ("plan", "runs"),
                                ("plan", "seed")]),
}  # fmt: skip


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_no_sentence_uses_a_field_of_a_file_that_is_not_checked(kind, tmp_path):
    maker, own = KINDS[kind]
    file, said, tried = maker(tmp_path), [], 0
    tables, claims = Opened.of(file).tables, told(ft.load(file))
    first = {tuple(key for key in place if isinstance(key, str)): place
             for place, _ in reversed([*fields(tables)])}  # fmt: skip
    for place in first.values():
        of_kind = any(place[: len(above)] == above for above in own)
        if not of_kind or place[-1] in TRUE_TOO or place in CHOSEN:
            continue
        table = forgery = copy.deepcopy(tables)
        for key in place[:-1]:
            table = table[key]
        table[place[-1]] = other(table[place[-1]])
        tried += 1
        try:
            path = changed(file, tmp_path / "x.npz", forgery)
            # all is flown again where it says something else
            if told(ft.load(path)) != claims and flown_again(path).valid:
                said.append((".".join(map(str, place)), told(ft.load(path))))
        except ft.InputError:
            continue

    assert said == []
    assert tried > 1
