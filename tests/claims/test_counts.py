"""Counts of small flights: what their files hold, claim, and refuse, against flights and SciPy."""

import re
from itertools import pairwise

import numpy as np
import pytest
from flown_campaigns import flown_here
from forging import Opened, changed
from scipy.stats import binom
from small_claims import (
    ALONE,
    FEW,
    RULE,
    WITH_FIVE,
    band,
    band_in_wind,
    folder,
    log_monitor,
    monitor,
    proven,
    residual,
)

import flighttune as ft

SINGLE = 1e-6  # relative rounding of single precision


@pytest.fixture(scope="module")
def counted():
    return ft.load(band())


def test_the_scale_is_the_score_below_as_many_as_may_be_outside(counted):
    """Of 29 flights five may be: the largest k with a binomial sum of at most 0.1."""
    may = max(k for k in range(WITH_FIVE) if binom.cdf(k, WITH_FIVE, 0.3) <= 0.1)
    middle, half = counted.about.coefficients[0], counted.about.half
    scores = (np.abs(counted.extremes - middle[..., None]).max(axis=-1) / half).max(axis=(1, 2))

    assert (counted.allowed, may) == (may, 5)
    assert counted.scores == pytest.approx(scores)
    assert counted.scale == pytest.approx(np.sort(scores)[-1 - may])
    assert counted.outside == (scores > counted.scale).sum() <= may
    assert counted.draws.tolist() == list(range(10, 39))
    assert counted.nearest == 10 + np.flatnonzero(scores == counted.scale)[0]
    assert counted.half_widths == pytest.approx(counted.scale * half)


def test_bounds_are_those_of_the_window_of_each_time(counted):
    edges, middle = counted.flights.edges, counted.about.coefficients[0]
    t = np.array([-1.0, 0.0, edges[1] - 1e-6, edges[1], edges[-2], edges[-1], 99.0])
    windows = [0, 0, 0, 1, len(edges) - 2, len(edges) - 2, len(edges) - 2]

    bounds = counted.bounds(t)

    assert bounds.names == ("chi_err", "gamma_err")
    assert bounds.low == pytest.approx((middle - counted.half_widths)[windows])
    assert bounds.high == pytest.approx((middle + counted.half_widths)[windows])
    (chi, gamma) = counted.answer().tables[0].records
    whole = counted.bounds(edges[:-1])
    late = edges[:-1] >= 0.75 * edges[-1]
    for i, row in enumerate((chi, gamma)):
        widths = np.rad2deg(counted.half_widths[:, i])
        assert [row[x] for x in ("largest", "last_quarter", "end")] == pytest.approx(
            [widths.max(), widths[late].max(), widths[-1]]
        )
        ends = np.rad2deg([whole.low[:, i].min(), whole.high[:, i].max()])
        assert [row["low"], row["high"]] == pytest.approx(ends)
    with pytest.raises(ft.InputError, match="`wind` must be there"):
        counted.bounds(t, np.zeros(2))


STARTS = """
title = "starts"
scenario = "turn.toml"
seed = 5
runs = 88
design = "random"
disperse = [
  { key = "flight.chi_deg", distribution = "uniform", lower = 3.0, upper = 7.0 },
  { key = "flight.gamma_deg", distribution = "uniform", lower = 0.0, upper = 4.0 },
]
"""


def test_a_count_is_of_the_flights_of_its_campaign_after_those_that_taught_it():
    """Each is also flown as a flight of its own, of which the band is drawn around each sample."""
    (folder() / "starts.toml").write_text(STARTS)
    options = {"plant": "kinematic", "gains": "paper", "flights": 12, "learn": 10, **RULE}
    with flown_here():
        counted = ft.band(folder() / "starts.toml", **options)
    plan, inside = ft.plan_campaign(ft.load_campaign(folder() / "starts.toml")), []
    for i, draw in enumerate(counted.draws.tolist()):
        runs = ft.fly(plan.scenario_of(draw), ["paper"]).runs
        run = next(run for run in runs if run.label.startswith("kinematic"))
        values = run.signals[["chi_err", "gamma_err"]].to_numpy()
        edges = np.searchsorted(run.t, counted.flights.edges - 1e-9)
        parts = [values[a : b + 1] for a, b in pairwise(edges)]
        low, high = (np.array([of(part, axis=0) for part in parts]) for of in (np.min, np.max))
        assert counted.extremes[i] == pytest.approx(np.stack([low, high], axis=-1), rel=SINGLE)
        assert (counted.extremes[i][..., 0] < low).all()  # rounded outwards
        assert (counted.extremes[i][..., 1] > high).all()
        assert counted.why_not(run) == ""
        inside.append(counted.on(run).contains(run.signals))
    assert inside == (counted.scores <= counted.scale).tolist()


@pytest.mark.soak
def test_the_middle_in_wind_is_the_least_squares_fit_of_learning_flights():
    """Another count has those flights as counted ones, and with them the winds."""
    by_wind = ft.load(band_in_wind())
    learned = by_wind.about.learned
    # draws 0 to 39 taught; those that another count counted are 10 and later
    with flown_here():
        other = ft.band(folder() / "in_wind.toml", plant="kinematic", flights=29,
                        predicted_from="wind", learn=11, gains="paper", **RULE)  # fmt: skip
    north, east = by_wind.wind.T
    terms = np.column_stack([north**i * east**j for i in range(4) for j in range(4 - i)])
    middle = np.einsum("nc,cws->nws", terms, by_wind.about.coefficients)
    away = np.abs(by_wind.extremes - middle[..., None]).max(axis=-1) / by_wind.about.half

    assert by_wind.scores == pytest.approx(away.max(axis=(1, 2)), rel=1e-5)
    assert (np.hypot(north, east) <= 8.0 + 1e-9).all()
    assert learned == 40
    taught = [draw for draw in other.draws.tolist() if draw < learned]
    scores = [
        (np.abs(x - np.einsum("c,cws->ws", term, by_wind.about.coefficients)[..., None]).max(-1)
         / by_wind.about.half).max()
        for x, term in zip(other.extremes[: len(taught)], np.column_stack(
            [other.wind[:, 0] ** i * other.wind[:, 1] ** j for i in range(4) for j in range(4 - i)]
        )[: len(taught)], strict=True)
    ]  # fmt: skip
    assert len(taught) > 20
    assert np.median(scores) < 1.0  # the shape is about as wide as those that taught it
    given = by_wind.bounds([0.0], np.array([2.0, -3.0]))
    own = np.array([2.0**i * (-3.0) ** j for i in range(4) for j in range(4 - i)])
    at = np.einsum("c,cs->s", own, by_wind.about.coefficients[:, 0])
    assert 0.5 * (given.low + given.high)[0] == pytest.approx(at)
    with pytest.raises(ft.InputError, match="`wind` must be there"):
        by_wind.bounds([0.0])
    with pytest.raises(ft.InputError, match="the wind must be drawn for `given` wind"):
        ft.band(folder() / "turn.toml", plant="kinematic", predicted_from="wind", **FEW)


def test_a_count_grows_to_twice_its_flights_and_to_no_other_number(tmp_path):
    file = tmp_path / "b.npz"
    file.write_bytes(band(ALONE).read_bytes())
    for number in (8, 13, 15, 7):
        with pytest.raises(ft.InputError, match=r"numbers fixed .*14, 28, 56"):
            ft.band(file, flights=number)

    with flown_here():
        grown = ft.band(file, flights=14)
        whole = ft.band(folder() / "turn.toml", plant="kinematic", gains="paper", flights=14, **FEW)

    first = ft.load(band(ALONE))
    assert ft.load(file).sha256 == grown.sha256
    assert (grown.readings, first.readings) == ((7, 14), (7,))
    assert grown.draws.tolist() == [*range(10, 17), *range(18, 25)]  # one is left out
    assert grown.confidence == pytest.approx(0.8)
    assert (grown.extremes[:7] == first.extremes).all()
    assert (grown.extremes[7:13] == whole.extremes[8:14]).all()
    with flown_here():
        again = ft.band(file, flights=14)
        assert ft.verify(file, count=14).valid
    assert again.sha256 == grown.sha256


def test_another_claim_of_a_file_shares_its_confidence_with_the_one_planned(tmp_path):
    flown, out = band(), tmp_path / "other.npz"

    other = ft.band(flown, epsilon=0.4, confidence=0.8, out=out)
    back = ft.band(out, epsilon=0.3, confidence=0.9)

    assert (other.about.epsilon, other.about.confidence) == (0.4, 0.8)
    assert other.about.planned == (0.3, 0.9)
    assert other.confidence == pytest.approx(1.0 - (0.2 + 0.1))
    assert "with the claim planned, 0.3 at 0.9" in other.sentence
    assert ft.load(out).sha256 == other.sha256
    assert (back.about.planned, back.sha256) == (None, ft.load(flown).sha256)
    may = max(k for k in range(WITH_FIVE) if binom.cdf(k, WITH_FIVE, 0.4) <= 0.2)
    assert other.allowed == may > ft.load(flown).allowed
    with pytest.raises(ft.InputError, match="at least"):
        ft.band(flown, epsilon=0.01)


@pytest.mark.parametrize(
    ("change", "claims", "readings", "spent"),
    [
        ({}, 1, 1, 0.1),
        ({"planned": [0.2, 0.95]}, 1, 1, 0.15),
        ({"confidence": 0.98}, 1, 1, 0.02),
        ({"confidence": 0.98, "planned": [0.3, 0.9]}, 1, 1, 0.12),
    ],
)
def test_the_confidence_of_a_file_is_that_of_all_it_claims(
    change, claims, readings, spent, tmp_path
):
    count = ft.load(changed(band(), tmp_path / "b.npz", change))

    assert count.confidence == pytest.approx(1.0 - claims * readings * spent)
    assert f"confidence {count.confidence:g}" in count.sentence


def test_flights_that_were_not_completed_are_outside_and_too_many_leave_no_claim(tmp_path):
    extremes = Opened.of(band()).arrays["extremes"]
    for lost, claims in ((1, True), (5, True), (6, False)):
        extremes[:lost] = [-np.inf, np.inf]

        count = ft.load(changed(band(), tmp_path / "b.npz", extremes=extremes))

        assert (count.not_completed, count.claims) == (lost, claims)
        assert (f"{lost} did not complete" in count.sentence) == (not claims)
        assert count.decided == (not claims)
    run, *_ = ft.fly(folder() / "turn.toml", "paper").runs
    assert "nothing is claimed" in count.why_not(run)


# ---------------------------------------------------------------- files that are not so
def half(tables):
    tables["half"] = (0.0 * np.array(tables["half"])).tolist()


def wider(name):
    def change(tables):
        values = np.array(tables[name])
        values.flat[3] += 1e-3 * np.abs(values).max()
        tables[name] = values.tolist()

    return change


def of_models(change):
    return lambda tables: change(tables["models"])


def scaled_weights(models):
    models[0]["weights"] = [1.001 * x for x in models[0]["weights"]]


def units(unit):
    return lambda tables: tables.update(signals=dict.fromkeys(tables["signals"], unit))


NO = {"name": "roll", "target": "p", "terms": ["1"], "weights": [0.0]}
# Maker of the file, a change, and words of the refusal when it is read.
REFUSED = [
    (band, {"format": "flighttune band 0"}, "`format`"),
    (band, {"scale": 1.0}, "`scale`"),
    (band, {"epsilon": 0.001}, "`flights` must be at least 2302"),
    (band, {"predicted_from": "wind"}, r"`coefficients` must have shape \(10,"),
    (band, {"early": 29}, "`early` must be below the 29 flights planned"),
    (band, half, "`half` must be positive"),
    (band, units("ft"), r"`signals`: \w+ must be in rad, got .ft"),
    (band, {"of": "residual"}, "residual|`signals`|aircraft"),
    (band, {"of": "roll"}, "`of` must be .*residual, turn_back, monitor.*'roll'"),
    (band, {"of": "turn_back"}, "`signals` must be from_route and height of flights that turn"),
    (band, {"models": [NO]}, "`models` must be those of the `signals` of"),
    (band, {"plan": {"runs": 39}}, "`plan`"),
    (band, {"learned": 3}, "learned"),
    (band, {"learned": 11}, "`extremes` must be of as many flights as were planned"),
    (band, {"confidence": 0.9, "planned": [0.3, 0.05]}, "`confidence`"),
    (monitor, units("m"), r"`signals`: \w+ must be in \S+, got 'm'"),
    (monitor, of_models(lambda x: x.pop()), "`models` must be those of the `signals`"),
    (monitor, of_models(lambda x: x[0]["weights"].pop()), "with a weight for each"),
    (monitor, of_models(lambda x: x[0].update(room=9.0)), "that flighttune monitor counts"),
]  # fmt: skip
ARRAYS = [
    (lambda x: {"extremes": x["extremes"].astype(float)}, r"`extremes\.npy` must be of type"),
    (lambda x: {"extremes": np.nan * x["extremes"]}, "`extremes` must be lowest"),
    (lambda x: {"extremes": x["extremes"][..., ::-1]}, "`extremes` must be lowest"),
    (lambda x: {"extremes": x["extremes"][:-1], "wind": x["wind"][:-1]},
     "`plan.runs` must be the flights learned from and counted, 38"),
    (lambda x: {"extremes": np.concatenate([x["extremes"], x["extremes"][:1]]),
                "wind": np.zeros((30, 0))}, "or of 2, 4.* got 30 for 29"),
    (lambda x: {"wind": np.ones((29, 2))}, r"`wind` must have shape \(29, 0\)"),
    (lambda x: {"navigation": np.ones((29, 4))}, r"`navigation` must have shape \(29, 0\)"),
    (lambda x: {"by_rtk": np.ones((2, 3))}, r"`by_rtk` must have shape \(2, 2\)"),
    (lambda x: {"by_rtk": np.full((2, 2), np.nan)}, r"`by_rtk\.npy` must be finite"),
    (lambda x: {"more": np.zeros(1)}, r"`more\.npy` must not be in the file of a band"),
    (lambda x: {"endings": np.array('{"10": "stall: it did"}')}, "`endings` must be of draws"),
    (lambda x: {"endings": np.array('{"a": "stall"}')}, "`endings` must have a sentence"),
    (lambda x: {"endings": np.array('{"10": 3}')}, "`endings` must have a sentence"),
    (lambda x: {"extremes": None}, r"`extremes\.npy` must be in the file"),
    (lambda x: {"wind": None}, "`wind"),
]  # fmt: skip


@pytest.mark.parametrize(("maker", "change", "words"), REFUSED)
def test_a_file_that_does_not_fit_together_is_refused_by_its_key(maker, change, words, tmp_path):
    with pytest.raises(ft.InputError, match=rf"x\.npz: .*({words})") as refused:
        ft.load(changed(maker(), tmp_path / "x.npz", change))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("of", "words"), ARRAYS)
def test_arrays_that_do_not_fit_are_refused_by_their_name(of, words, tmp_path):
    file = changed(band(), tmp_path / "x.npz", **of(Opened.of(band()).arrays))
    with pytest.raises(ft.InputError, match=rf"x\.npz: .*({words})") as refused:
        ft.load(file)
    assert "\n" not in str(refused.value)


def one_bit(name):
    def change(arrays):
        array = arrays[name].copy()
        array[3] = np.nextafter(array[3], array.dtype.type(np.inf))
        return {name: array}

    return change


# What only flying again shows: file, tables and arrays that are changed, and words of the reason.
FLOWN_AGAIN = [
    (band, {}, None, ""),
    (band, {}, one_bit("extremes"), r"equal to the bit, draw 13 is not"),
    (band, wider("half"), None, "`half` must follow from the 10 flights"),
    (band, wider("coefficients"), None, "`coefficients` must follow from the 10 flights"),
    (band, {"signals": {"chi_err": "rad", "h": "m"}}, None, "`signal` must be one of .*got 'h'"),
    (band, lambda x: x["plan"]["campaign"].update(seed=99), None, "bit|`half`"),
    (band_in_wind, {}, None, ""),
    (band_in_wind, {}, one_bit("wind"), r"equal to the bit, draw 43 is not"),
    (band_in_wind, wider("coefficients"), None, "`coefficients` must follow from the 40"),
    (residual, {}, None, ""),
    (residual, {}, one_bit("extremes"), r"equal to the bit, draw 13 is not"),
    (residual, wider("half"), None, "`half` must follow"),
    (residual, units("m"), None, "`signals`"),
    (monitor, {}, None, ""),
    (monitor, of_models(scaled_weights), None, "`weights` of airspeed must|draw 20 is not"),
    (monitor, wider("half"), None, "`half` must follow"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("maker", "tables", "arrays", "words"),
    [pytest.param(*row, marks=[pytest.mark.soak] * (row[0] is not band)) for row in FLOWN_AGAIN],
)
def test_a_count_is_flown_again_and_what_was_changed_is_named(
    maker, tables, arrays, words, tmp_path
):
    own = {} if arrays is None else arrays(Opened.of(maker()).arrays)
    file = changed(maker(), tmp_path / "x.npz", tables, **own)
    number = len(Opened.of(file).arrays["extremes"])

    with flown_here():
        verified = ft.verify(file, count=number)

    assert verified.valid == (words == "")
    assert re.search(words, verified.reason)
    if verified.valid:
        note = verified.verification.notes[0]
        assert f"{number} of the {number} counted" in note
        assert "probability 0." in note


def test_as_many_flights_as_asked_are_flown_again_and_no_more_than_there_are():
    with flown_here():
        said = ft.verify(band(), count=3).verification.notes[0]
        default = ft.verify(band()).verification.notes[0]
        for count in (0, 30):
            with pytest.raises(ft.InputError, match=f"1 to the 29 counted, got {count}"):
                ft.verify(band(), count=count)

    # forged are ceil(0.3 29) = 9 of 29: missed by (20 19 18) / (29 28 27), and by nine by chance
    assert "3 of the 29 counted" in said
    assert "9 counted flights" in said
    assert f"probability {20 * 19 * 18 / (29 * 28 * 27):.2g}" in said
    assert "9 of the 29 counted" in default


def test_options_of_one_kind_of_claim_are_refused_for_others():
    for options, words in (
        ({"boxes": residual()}, "`boxes` must be given for the tube"),
        ({"logs": ["x.csv"]}, "`logs` and `columns` must be given"),
    ):
        with pytest.raises(ft.InputError, match=words):
            ft.verify(band(), **options)
    for name, value in {"signals": ["h"], "learn": 12, "gains": "K1", "seed": 0, "plant": "x",
                        "air": "calm", "navigation": "rtk", "start_deg": 1.0,
                        "changes": {"a": 1}}.items():  # fmt: skip
        with pytest.raises(ft.InputError, match=f"`{name}` must be absent for a band file"):
            ft.band(band(), **{name: value})
    with pytest.raises(ft.InputError, match=r"`count`|tube|band"):
        ft.band(proven())
    for other in (log_monitor, monitor, residual):
        with pytest.raises(ft.InputError):
            ft.mission(other())


def test_too_few_flights_and_what_cannot_be_counted_are_refused_before_any_flies():
    turn = folder() / "turn.toml"
    few = {"plant": "kinematic", **FEW}
    for options, words in (
        ({"flights": 6}, "`flights` must be at least 7"),
        ({"learn": 9}, "at least 10, got 9"),
        ({"signals": ["altitude"]}, "`signal` must be one of .*chi_err.*got 'altitude'"),
        ({"start_deg": 0.0}, "random"),
        ({"plant": "jsbsim:x8"}, "`plant` must be one of"),
        ({"gains": "K9"}, "`gains` must be one of"),
        ({"air": "light"}, "air"),
        ({"epsilon": 1.5}, "`epsilon`"),
        ({"confidence": 0.0}, "`confidence`"),
    ):
        with pytest.raises(ft.InputError, match=words):
            ft.band(turn, **{**few, **options})
    with pytest.raises(ft.InputError, match="at least 20, got 19"):
        ft.monitor(turn, **{**FEW, "learn": 19})
    with pytest.raises(ft.InputError, match="`columns` must be absent"):
        ft.monitor(turn, columns={"p": "q"})


@pytest.mark.parametrize("names", [["north"], ["phi", "chi_err"]])
def test_any_recorded_signal_is_bounded_in_its_unit(names):
    with flown_here():
        counted = ft.band(folder() / "turn.toml", plant="kinematic", signals=names, gains="paper",
                          flights=ALONE, **FEW)  # fmt: skip

    assert [*counted.about.signals] == names
    assert counted.about.signals[names[0]] == {"north": "m", "phi": "rad"}[names[0]]
    rows = counted.answer().tables[0].records
    assert [(row["signal"], row["unit"]) for row in rows] == [
        (name, "m" if name == "north" else "deg") for name in names
    ]


# ---------------------------------------------------------------- which flights a count is about
AEROSONDE = {"kind": "jsbsim", "aircraft": "aerosonde"}
WIND = {"speed_mps": 5.0, "from_deg": 0.0}
FAULT = {"from_s": 0.1, "aileron_stuck_deg": 5.0}
AIR = """
title = "air"
scenario = "air_turn.toml"
seed = 4
runs = 24
disperse = [
  { key = "wind.speed_mps", distribution = "uniform", lower = 2.0, upper = 8.0 },
  { key = "plant.airframe.mass_factor", distribution = "uniform", lower = 0.9, upper = 1.1 },
  { key = "turbulence.intensity", distribution = "choice", values = ["light", "moderate"] },
]
"""


@pytest.fixture(scope="module")
def in_air():
    """A band of the Aerosonde in wind and turbulence with a mass that is drawn."""
    text = (folder() / "turn.toml").read_text().replace(
        "limits", 'wind = { speed_mps = 5.0, from_deg = 0.0 }\n'
        'turbulence = { intensity = "light" }\nlimits')  # fmt: skip
    (folder() / "air_turn.toml").write_text(text)
    (folder() / "air.toml").write_text(AIR)
    with flown_here():
        return ft.band(folder() / "air.toml", plant="jsbsim:aerosonde", gains="paper",
                       flights=ALONE, learn=10, **RULE)  # fmt: skip


def plant(**airframe):
    return {"plant": [AEROSONDE | {"airframe": airframe}]}


LIGHT, SEVERE = {"intensity": "light"}, {"intensity": "severe"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tables", "differs"),
    [
        ({}, ""),
        ({"wind": {**WIND, "speed_mps": 7.9}}, ""),
        ({"wind": {**WIND, "speed_mps": 9.0}}, "wind.speed_mps is 9, counted on 2 to 8"),
        ({"wind": None}, "wind.speed_mps is none, counted on 2 to 8"),
        ({"turbulence": {"intensity": "moderate"}}, ""),
        ({"turbulence": SEVERE}, "turbulence is severe, counted on light or "),
        ({"turbulence": None}, "turbulence is none, counted on"),
        (plant(mass_factor=1.05), ""),
        (plant(mass_factor=1.2), "plant.airframe.mass_factor is 1.2, counted on 0.9 to 1.1"),
        (plant(fault=FAULT), "plant.airframe.fault.from_s is 0.1, counted on none"),
        ({"sensors": {"chi_bias_deg": 1.0}}, "sensors.chi_bias_deg is 1, counted on 0"),
        ({"reference": {"chi_deg": 1.0, "gamma_deg": 0.0}}, "reference.chi_deg is 1, counted on 0"),
        ({"controller": {"anti_windup": "none"}}, "controller.anti_windup is none"),
        ({"limits": {"phi_deg": [-30.0, 45.0]}}, "limits.phi_deg is [-30.0, 45.0], "),
        ({"flight": {"V_a_mps": 26.0, "chi_deg": 5.0, "gamma_deg": 2.0, "duration_s": 0.5}},
         "flight.V_a_mps is 26, counted on 25"),
        ({"gains": ["K1"]}, "its gains are not those counted on, paper"),
        ({"law": "exact"}, "law is exact, counted on paper"),
    ],
)  # fmt: skip
def test_a_flight_of_others_than_those_counted_is_named_with_both_values(in_air, tables, differs):
    own = in_air.flights.scenario.as_dict() | {"gains": ["paper"]} | tables
    own = {key: value for key, value in own.items() if value is not None}
    own["plant"] = tables.get("plant", [AEROSONDE])
    (run,) = ft.fly(ft.scenario_from(own)).runs

    said = in_air.why_not(run)

    assert said.startswith(differs)
    assert bool(said) == bool(differs)


@pytest.mark.slow
def test_the_flights_of_a_claim_are_told_with_their_ranges(in_air, counted):
    said = " ".join(in_air.sentence.split())

    for words in (
        "jsbsim:aerosonde under the paper law",
        "wind 2 to 8 m/s",
        "25 m/s",
        "0.9 to 1.1",
    ):
        assert words in said
    rows = {row["quantity"]: row for row in in_air.answer().tables[1].records}
    assert rows["mass factor"] == {"quantity": "mass factor", "values": "0.9 to 1.1",
                                   "drawn": "uniform"}  # fmt: skip
    assert "light or moderate" in str([*rows.values()])
    assert "3 to 7 deg" in str(counted.answer().tables[1].records)


@pytest.mark.parametrize(
    ("chi", "gamma", "range_deg"),
    [(5.0, 2.0, ""), (6.9, 3.9, ""), (7.1, 2.0, "chi_deg is 7.1, counted on 3 to 7"),
     (5.0, -0.1, "gamma_deg is -0.1, counted on 0 to 4")],
)  # fmt: skip
def test_a_flight_is_one_of_those_counted_if_it_starts_among_them(counted, chi, gamma, range_deg):
    tables = counted.flights.scenario.as_dict() | {"plant": [{"kind": "kinematic"}]}
    flight = {**tables["flight"], "chi_deg": chi, "gamma_deg": gamma}
    (run,) = ft.fly(ft.scenario_from(tables | {"flight": flight, "gains": ["paper"]})).runs

    assert counted.why_not(run).removeprefix("flight.") == range_deg


# ---------------------------------------------------------------- a monitor that was counted
def test_a_monitor_alarms_at_a_fault_and_at_no_healthy_flight():
    watched = ft.load(monitor())
    tables = watched.flights.scenario.as_dict() | {"gains": ["paper"], "plant": [AEROSONDE]}
    healthy, stuck = (
        ft.fly(ft.scenario_from({**tables, **more})).runs[0]
        for more in ({}, plant(fault={"from_s": 0.5, "aileron_stuck_deg": 20.0}))
    )

    assert watched.alarm(healthy) is None
    alarm = watched.alarm(stuck)
    assert 0.5 < alarm.at_s < 2.0
    assert alarm.why in [model.name for model in watched.about.models]
    for run in (healthy, stuck):
        assert watched.why_not(run) == watched.not_about(run) == ""
    score = watched.on(stuck).signals["alarm_score"]
    assert (np.diff(score) >= 0.0).all()
    assert stuck.t[np.argmax(score > 1.0)] == pytest.approx(alarm.at_s)
    assert watched.on(healthy).signals["alarm_score"].max() <= 1.0
    low, high = (np.array([row[x] for row in watched.answer().tables[0].records])
                 for x in ("low", "high"))  # fmt: skip
    assert len(low) == len(watched.watch.models) == 8
    assert (high > low).all()
    assert watched.watch.half == pytest.approx(watched.scale * watched.about.half[0])
