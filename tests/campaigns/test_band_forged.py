"""Band files that were edited and sealed again: each edit that changes a claim is refused."""

import copy
import json
import math
from dataclasses import replace
from textwrap import dedent

import numpy as np
import pytest
from commands import flighttune
from counted_turns import ALONE, WITH_FIVE, count, forged, small_plan
from dispersed import AEROSONDE, KINEMATIC, SOFT, plan_of, uniform
from dispersed import tables_of as tables_of_plan
from flown_campaigns import flown_here
from fuzzing import marked, slow
from scipy.stats import hypergeom

import flighttune as ft
from flighttune.base.files import code
from flighttune.base.files.table import tables_of
from flighttune.claims import counting
from flighttune.claims.shape import learned_shape
from tests.cli.test_code_of_files import LAW


def verified(path, status, *options):
    """What `verify` says where it flies all flights again, in this process."""
    with flown_here():
        return "".join(flighttune("verify", path, "--count", WITH_FIVE, *options, status=status))


def edited(band, *keys, value):
    """The plan of a band with another value."""
    plan = copy.deepcopy(tables_of(band.about)["plan"])
    table = plan
    for key in keys[:-1]:
        table = table[key]
    table[keys[-1]] = value
    return {"plan": plan}


def without_a_seed(band):
    campaign = {key: value for key, value in band.about.plan["campaign"].items() if key != "seed"}
    return edited(band, "campaign", value=campaign)


@pytest.mark.parametrize(
    ("times", "about"),
    [
        ([0.3], lambda _: {}),
        ([1.0, 1.0], lambda _: {}),
        ([1.0], lambda band: edited(band, "campaign", "seed", value=30)),
        ([1.0], lambda band: {"signals": dict(reversed(band.about.signals.items()))}),
    ],
)
def test_a_forged_file_has_other_flights_or_is_about_others(counted, tmp_path, times, about):
    flights = np.concatenate([counted.extremes * np.float32(factor) for factor in times])
    wind = np.zeros((len(flights), 0))
    path = forged(counted, tmp_path / "x.npz", about(counted), extremes=flights, wind=wind)

    assert "flown again must be equal" in verified(path, 1)


def test_a_single_copy_is_flown_again(counted):
    extremes = counted.extremes.copy()
    extremes[20] = extremes[3]

    with flown_here() as pool:
        band = replace(counted, extremes=extremes)
        assert 10 + 20 in counting.differing(band, counting.some_draws(band, 1), pool)


@pytest.mark.parametrize(
    ("about", "says"),
    [
        ({"distribution": "any aircraft in any wind"}, "`distribution`"),
        ({"readings": [29]}, "`readings`"),
        ({"edges": [0.0, 1.0]}, "`edges`"),
        ({"learned": 11}, "`extremes` must be of as many flights"),
        ({"plan": {"version": 1}}, "`plan` must be that of a campaign"),
        (without_a_seed, "`plan` must be that of a campaign, with its seed"),
        (lambda band: edited(band, "aircraft", value=1.5), "`plan` must be that of a campaign"),
    ],
)
def test_a_file_that_states_what_follows_from_its_plan_is_refused(counted, tmp_path, about, says):
    about = about(counted) if callable(about) else about
    path = forged(counted, tmp_path / "x.npz", about=about)

    _, stderr = flighttune("verify", path, status=2)

    assert says in stderr
    assert stderr.count("\n") == 1


@pytest.mark.parametrize("runs", [10**12, 10**400])
def test_a_plan_of_more_runs_than_were_flown_is_refused_at_once(counted, tmp_path, runs):
    path = forged(counted, tmp_path / "x.npz", about=edited(counted, "runs", value=runs))

    with pytest.raises(ft.InputError, match=r"`plan\.runs` must be"):
        ft.load(path)


def test_the_median_scenario_of_a_file_is_not_believed(counted, tmp_path):
    """The sentence names the airspeed of the flights, which are drawn about the nominal one."""
    about = edited(counted, "central", "flight", "V_a_mps", value=99.0)

    assert ft.load(forged(counted, tmp_path / "x.npz", about=about)).sentence == counted.sentence


def test_names_that_a_maker_chose_are_quoted_and_no_part_of_the_claim(counted, tmp_path):
    about = edited(counted, "campaign", "title", value='calm" air.\n Proven')
    about["plan"]["groups"][0]["gains"] = "tuned"
    about["plan"]["gains"] = {"tuned": about["plan"]["gains"]["soft"]}
    band = ft.load(forged(counted, tmp_path / "x.npz", about=about))

    (claim, maker), (before, _) = (x.sentence.split("; its maker calls ") for x in (band, counted))

    assert claim == before
    assert "flights of kinematic under the paper law at 25 m/s" in claim
    assert maker == """the flights "calm' air. Proven" and the gains "tuned\""""


def test_a_continued_count_cannot_pass_for_one_planned_so_long(counted, tmp_path):
    with flown_here() as pool:
        more = counting.count_more(counted, 2 * WITH_FIVE, pool)
    about = edited(more, "runs", value=10 + 2 * WITH_FIVE)
    path = forged(more, tmp_path / "x.npz", about=about)

    assert ft.load(path).confidence > more.confidence
    assert "flown again must be equal" in verified(path, 1)


@pytest.mark.slow
def test_a_band_whose_flights_run_code_is_not_checked_without_it(tmp_path):
    file, mark, path = tmp_path / "law.py", tmp_path / "ran", tmp_path / "x.npz"
    file.write_text(dedent(LAW))
    law = {"name": "mine", "kind": "python", "module": str(file), "class": "Mine"}
    law["sha256"] = code.named_sha256(file, "law.py")
    with code.running(code.Runs.NAMED):
        count(small_plan(law=[law])).save(path)
    mark.unlink()
    code._run.cache_clear()

    told = " ".join(verified(path, 1).split())
    assert "claimed, not checked: a new flight" in told
    assert "not checked: flying its flights again runs" in told
    assert "allow --run-code" in told
    assert "counted" not in told.replace("claimed, not checked", "")
    assert not mark.exists()
    code._run.cache_clear()
    assert "flown again and give the shape" in " ".join(verified(path, 0, "--run-code").split())
    assert mark.exists()


@pytest.mark.parametrize("names", [*slow(["half"], ["coefficients"]), ["half", "coefficients"]])
def test_a_shape_that_was_fitted_to_the_flights_counted_is_refused(counted, tmp_path, names):
    fitted = learned_shape(counted.extremes, counted.wind, counted.about.epsilon)
    shape = dict(zip(("coefficients", "half"), fitted, strict=True))
    path = forged(counted, tmp_path / "x.npz", {name: shape[name].tolist() for name in names})

    told = verified(path, 1)
    assert f"`{sorted(names)[-1]}` must follow from the 10 flights learned from" in told


def test_a_claim_other_than_that_planned_shares_its_confidence_and_its_shape(counted, tmp_path):
    """The shape is that of the planned epsilon: the scale of the last tenths of 10 flights."""
    other = counted.claiming(0.5, 0.9)
    other.save(tmp_path / "x.npz")
    hidden = forged(other, tmp_path / "y.npz", {"planned": None})
    with flown_here():
        shown, *_ = (ft.verify(path) for path in (tmp_path / "x.npz", hidden))

        assert shown.valid
        assert not ft.verify(hidden).valid
    assert other.confidence == pytest.approx(1.0 - 0.1 - 0.1)
    assert "0.8 (shared with the claim planned, 0.3 at 0.9)" in shown.claim.sentence
    assert other.claiming(0.3, 0.9).confidence == counted.confidence


# Other words than those of a plan that its file may have too
WORDS = {"random": "sobol", "sets": "adds", "course": "heading", "conditional": "none",
         "kinematic": "point_mass", "full": "decoupled", "R_K": "decay"}  # fmt: skip
# Choices that no file can show to have been made before a flight was counted: a note says so
CHOSEN = {("epsilon",), ("confidence",)}


def fields(tables, above=()):
    """Every value in tables with its place."""
    pairs = tables.items() if isinstance(tables, dict) else enumerate(tables)
    for key, value in pairs:
        if isinstance(value, dict | list):
            yield from fields(value, (*above, key))
        else:
            yield (*above, key), value


def changed(value):
    if isinstance(value, bool | str):
        return WORDS.get(value, f"{value}, forged") if isinstance(value, str) else not value
    return "forged" if value is None else value + (1 if isinstance(value, int) else 0.01)


def told(band):
    """All that a band says of its flights, without what its maker calls them."""
    answer = band.answer()
    notes = [note for note in answer.notes if "nearest to leaving" not in note]
    flights = next(table.records for table in answer.tables if table.name == "dispersions")
    values = [answer.values.get(key) for key in ("room", "models", "fence")]
    return band.sentence.partition("; its maker")[0], notes, values, flights


def on_a_leg():
    """A plan of three seconds along a leg, from random courses."""
    tables = tables_of_plan(gains=[SOFT], route={
        "lat_deg": 47.4, "lon_deg": 8.5,
        "waypoint": [{"north_m": north, "east_m": 0.0} for north in (0.0, 60.0)],
    })  # fmt: skip
    del tables["reference"]
    tables["flight"] |= {"chi_deg": 0.0, "gamma_deg": 0.0, "duration_s": 6.0}
    return plan_of(tables, uniform("flight.chi_deg", -1.0, 1.0))


def made(kind, folder):
    if kind in ("residual", "monitor"):
        plan, more = small_plan(plants=(KINEMATIC, AEROSONDE)), {}
        if kind == "monitor":  # one half of the flights learned from are for its weights
            more["learn"] = 20
        return count(plan, kind=getattr(ft, kind), flights=ALONE, **more)
    if kind == "until_sure":
        fence = folder / "fence.geojson"
        ring = [[8.49, 47.39], [8.51, 47.39], [8.51, 47.41], [8.49, 47.41], [8.49, 47.39]]
        fence.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
        with flown_here():
            return ft.mission(on_a_leg(), fences=[fence], **UNTIL_SURE).band
    return count(flights=ALONE)


# Kinds of bands, with the fields that these have beside those of all
KINDS = {
    "recorded": [()],
    "residual": [("of",), ("signals",), ("plan", "aircraft"), ("plan", "nominal", "plant")],
    "monitor": [("of",), ("signals",), ("models",)],
    # its fence is what it is about: the flights are counted in another one again
    "until_sure": [("until_sure",), ("learned",), ("planned",), ("plan", "runs"), ("plan", "seed")],
}
UNTIL_SURE = {"epsilon": 0.3, "confidence": 0.9, "until_sure": True}


# Of these another value is true of the same flights too: at one airspeed, of gains that grow with
# it; of a place where no flight turned; of a bank, in the wind that is told with it; and of the
# height of kinematic flights in calm air.
TRUE_TOO = "schedule", "V_a_mps", "bank_deg", "h_m"


@pytest.mark.slow
@pytest.mark.parametrize("kind", marked(KINDS, pytest.mark.soak, but=("until_sure",)))
def test_no_sentence_uses_a_field_of_a_file_that_is_not_checked(tmp_path, kind):
    counted = made(kind, tmp_path)
    tables, said, claims = tables_of(counted.about), [], told(counted)
    first = {tuple(key for key in place if isinstance(key, str)): place
             for place, _ in reversed([*fields(tables)])}  # fmt: skip
    with flown_here():
        for place in first.values():
            of_kind = any(place[: len(above)] == above for above in KINDS[kind])
            if not of_kind or place[-1] in TRUE_TOO or place in CHOSEN:
                continue
            table = forgery = copy.deepcopy(tables)
            for key in place[:-1]:
                table = table[key]
            table[place[-1]] = changed(table[place[-1]])
            try:
                band = ft.load(forged(counted, tmp_path / "x.npz", forgery))
                lies = told(band) != claims  # all is flown again where it says something else
                if lies and ft.verify(band, count=len(counted.scores)).valid:
                    said.append((".".join(map(str, place)), told(band)))
            except ft.InputError:
                continue

    assert said == []


def test_the_chance_that_verify_misses_a_forgery_is_that_of_doubling_epsilon(counted, tmp_path):
    """Of N flights counted, K = epsilon N are forged, and n are flown again."""
    counted.save(tmp_path / "x.npz")
    with flown_here():
        note = " ".join(ft.verify(tmp_path / "x.npz", count=3).answer().notes)

    flights, epsilon = len(counted.scores), counted.about.epsilon
    forged_flights = math.ceil(epsilon * flights)
    assert f"forgery of {forged_flights} counted flights, which would double epsilon" in note
    missed = hypergeom.pmf(0, flights, forged_flights, 3)
    assert f"missed with probability {missed:.2g}." in note
