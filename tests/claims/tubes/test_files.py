"""Files of tubes: read back, proven again, and refused where something in them is not so."""

import io
import re
import tracemalloc
import zipfile

import numpy as np
import pytest
from commands import answer
from enclosed import LAGS, flown, manoeuvre
from enclosed import changed as other
from flown_campaigns import flown_here
from forging import Opened, changed, sealed
from small_claims import proven, residual, saved

import flighttune as ft

OWN = {"chi_amplitude": 0.5, "chi_omega_rad_s": 1.0}


def test_a_tube_reads_back_and_its_bounds_are_looser_than_those_proven(tmp_path):
    found = ft.tube(manoeuvre(ramp_dps=1.0), ft.PAPER_GAINS, start=0.004, disturbance=0.02)
    found.save(tmp_path / "tube.npz")

    again, verified = ft.load(tmp_path / "tube.npz"), ft.verify(tmp_path / "tube.npz")

    margin = found.bounds.pairs - again.bounds.pairs
    assert np.abs(margin).max() <= 1.01e-9
    assert [x.margin for x in verified.checks] == pytest.approx([1e-9] * 4, rel=0.01)
    assert (again.can_limit == found.can_limit).all()
    assert (again.problem.start, again.problem.disturbance) == (0.004, 0.02)
    assert again.sentence.split(" of the middle")[0] == found.sentence.split(" of the middle")[0]


def array_at(name, index, value):
    """A change of one number of an array."""

    def change(tables, arrays):
        del tables
        array = arrays[name].copy()
        array[index] = value(array[index])
        arrays[name] = array

    return change


def of_claim(*path, value=None):
    """A change of one value of the claim, deep in its tables."""

    def change(tables, arrays):
        del arrays
        for key in path[:-1]:
            tables = tables[key]
        tables[path[-1]] = value(tables[path[-1]]) if callable(value) else value

    return change


def array(name, of):
    def change(tables, arrays):
        del tables
        arrays[name] = of(arrays.get(name, np.zeros((21, 2))))
        if arrays[name] is None:
            del arrays[name]

    return change


# File, a change of it, and words of the answer: a reason why it is not valid, or a refusal.
FORGED = [
    ("law", array_at("bounds", (15, 0, 0), lambda x: x + 1e-6), "sample 15 .*chi_err >= .* is not"),
    ("law", array_at("bounds", (10, 1, 1), lambda x: x - 1e-6), "sample 10 .*gamma_err <= "),
    ("law", array_at("bounds", (12, 2, 1), lambda x: x - 1e-6), "sample 12 .*phi_cmd <= .* is not"),
    ("lags", array_at("bounds", (9, 3, 0), lambda x: x + 1e-6), "sample 9 .*n_z_cmd >= .* is not"),
    ("law", array_at("held", (0, 0), lambda _: False), "sample 0 .*no limit holds phi_cmd"),
    ("law", array("chosen", lambda x: x * 0.9), "is not proven"),
    ("law", array("chosen", lambda x: x[:-40]), "the choices end early"),
    ("law", array("chosen", lambda _: np.ones(60_000, np.float32)), "a split names|end early"),
    ("law", of_claim("gains", "K_P", 1, 1, value=lambda x: 1.1 * x), "is not proven"),
    ("law", of_claim("disturbance_rad_s", value=1e306), "is not proven"),
    ("law", of_claim("start_rad", value=0.01), "is not proven"),
    ("law", of_claim("scenario", "reference", "chi_deg", value=-90.0), "is not proven"),
    ("law", of_claim("scenario", "limits", "phi_deg", value=[-5.0, 5.0]), "is not proven"),
    ("law", of_claim("scenario", "limits", "n_z_rate_per_s", value=3.0), "is not proven"),
    ("lags", of_claim("scenario", "plant", 0, "roll_lag_rad_s", value=7.0), "is not proven"),
    ("lags", of_claim("scenario", "plant", 0, "n_z_delay_s", value=0.0), "is not proven"),
    ("exact", of_claim("scenario", "flight", "V_a_mps", value=26.0), "is not proven"),
    ("fed_back", of_claim("gains", "feedback", value=[0.4, 0.3]), "is not proven"),
    ("settled", array("ever_W", lambda W: 0.9 * W), "sample .*: the set that is kept"),
    ("settled", array("ever_size", lambda x: 0.5 * x), "sample .*: the set that is kept"),
    ("settled", array("ever_size", lambda x: np.r_[4.0 * x[:1], x[1:]]), "proven to be kept"),
    ("settled", array("ever_bounds", lambda x: 0.9 * x), "after .*chi_err >= .* is not proven"),
    ("settled", array("ever_chosen", lambda x: x[:-3]), "the choices end early"),
    ("settled", of_claim("hand_over", value=[0, 4]), "`hand_over` must be after the last .*13.*"),
    ("settled", of_claim("hand_over", value=[13, 4]), "`hand_over` must be .*got sample 13"),
    ("law", of_claim("format", value="flighttune tube 4"), "format"),
    ("law", array("bounds", lambda x: x[:-1]), "`bounds` must have shape"),
    ("law", array("held", lambda x: x.astype(float)), r"`held\.npy` must be of type bool"),
    ("law", array("chosen", lambda x: x.astype(float)), "float32, got float64"),
    ("law", array("chosen", lambda x: x * np.nan), r"`chosen\.npy` must be finite"),
    ("law", of_claim("settings", "sides", value=10**6), r"`settings\.sides`"),
    ("law", of_claim("start_rad", value=float("nan")), "`start_rad`"),
    ("law", of_claim("start_rad", value=0.8), "`start` must lie in 0..45 deg, got 45.8"),
    ("law", of_claim("hand_over", value=[40.7, 5]), r"`hand_over\.0`"),
    ("law", of_claim("scenario", "colour", value="red"), "colour"),
    ("law", of_claim("scenario", "flight", "duration_s", value=2e4), "`bounds` must have shape"),
    ("law", of_claim("scenario", "disturbance", value={**OWN}), "`disturbance`.* 0.5 "),
    ("law", of_claim("plant", value="point_mass"), "point_mass"),
    ("law", of_claim("lags", value=3), "`lags"),
    ("law", of_claim("band_sha256", value="0" * 64), r"`boxes\.npy` must be in"),
    *(("law", array(name, lambda x: x), rf"`{name}\.npy` must not")
      for name in ("reference", "boxes", "ever_W", "colour")),
    *(("law", array(name, lambda _: None), rf"`{name}\.npy` must be in")
      for name in ("bounds", "held", "chosen")),
]  # fmt: skip


@pytest.mark.parametrize(("name", "change", "words"), FORGED)
def test_more_than_is_proven_is_refused_in_one_line(name, change, words, tmp_path):
    opened = Opened.of(proven(name))
    opened.tables["scenario"] = {**opened.tables["scenario"]}
    change(opened.tables, opened.arrays)
    path = opened.write(tmp_path / "forged.npz")
    try:
        verified = ft.verify(path)
        said = verified.reason
        assert not verified.valid
    except ft.InputError as refused:
        said = str(refused)
        assert "forged.npz: " in said
    assert re.search(words, said), said
    assert "\n" not in said


def test_every_check_of_a_tube_has_a_change_of_the_file_that_fails_it():
    names = {x.name.split()[0] for x in ft.verify(proven("law")).checks}

    assert names == {"chi_err", "gamma_err", "phi_cmd", "n_z_cmd"}
    for name in names:
        assert any(name in words for _, _, words in FORGED), name


def test_a_member_twice_and_a_file_without_its_claim_are_refused(tmp_path):
    opened, path = Opened.of(proven()), tmp_path / "t.npz"
    opened.write(path)
    with pytest.warns(UserWarning, match="Duplicate"), zipfile.ZipFile(path, "a") as archive:
        archive.writestr("bounds.npy", archive.read("bounds.npy"))
    path.write_bytes(sealed(path.read_bytes()))
    with pytest.raises(ft.InputError, match=r"`bounds\.npy`.*once"):
        ft.load(path)
    with path.open("wb") as file:
        np.savez_compressed(file, **opened.arrays)
    with pytest.raises(ft.InputError, match=r"t\.npz: must be"):
        ft.load(path)


@pytest.mark.soak
@pytest.mark.parametrize("stated", [None, 1000])
def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path, stated):
    """280 MB of zeros in 0.3 MB, also where the directory of the file says that they are few."""
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(proven()) as whole, zipfile.ZipFile(path, "w") as archive:
        for entry in whole.infolist():
            if entry.filename != "chosen.npy":
                archive.writestr(entry, whole.read(entry))
        zeros = io.BytesIO()
        np.save(zeros, np.zeros(70_000_000, np.float32))
        archive.writestr("chosen.npy", zeros.getvalue(), compress_type=zipfile.ZIP_DEFLATED)
        size = len(zeros.getvalue())
        del zeros
    if stated is not None:
        data = path.read_bytes()
        path.write_bytes(data.replace(size.to_bytes(4, "little"), stated.to_bytes(4, "little")))

    tracemalloc.start()
    with pytest.raises(ft.InputError, match=r"bomb\.npz: "):
        ft.load(path)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 20_000_000


@pytest.mark.soak
def test_choices_that_split_the_set_without_end_are_refused(tmp_path):
    endless = changed(proven(), tmp_path / "t.npz", chosen=np.ones(6_000_000, np.float32))

    assert "the choices make the set too large" in ft.verify(endless).reason


# ---------------------------------------------------------------- what has no tube
@pytest.mark.parametrize(
    ("scenario", "options", "words"),
    [
        (manoeuvre(), {"disturbance": -1.0}, "`disturbance` must be positive, got -1"),
        (manoeuvre(), {"plant": "jsbsim:x"}, "`plant` must be one of kinematic"),
        (manoeuvre(), {"start": -0.01}, "`start` must lie in 0..45 deg, got -0.57"),
        (manoeuvre(wind={"speed_mps": 3.0, "from_deg": 0.0}), {}, "`wind` must not"),
        (manoeuvre(sensors={"chi_bias_deg": 1.0}), {}, "`sensors` must not"),
        (manoeuvre(disturbance={**OWN, "as_wind": True}), {}, "`wind` must not"),
        (manoeuvre(disturbance=OWN), {"disturbance": 0.01}, "at least that of the scenario's"),
        (manoeuvre(anti_windup="back_calculation"), {}, "got back_calculation"),
        (manoeuvre(gamma_deg=30.0, n_z=0.8), {"start": 0.2}, "`n_z` of .flight. must start inside"),
        (manoeuvre({"kind": "jsbsim", "aircraft": "aerosonde"}), {}, "of kind kinematic"),
    ],
)  # fmt: skip
def test_what_no_tube_is_known_for_is_refused_by_its_key(scenario, options, words):
    with pytest.raises(ft.InputError, match=words):
        ft.tube(scenario, ft.PAPER_GAINS, **options)


@pytest.mark.parametrize(
    ("chi", "gamma", "words"),
    [
        (0.02, -0.02, "any disturbance of at most 0.02 rad/s, in"),
        (0.02, 0.005, "any disturbance of at most 0.02 rad/s of χ and 0.005 rad/s of γ, in"),
        (0.0, 0.0, "from its start, in"),
    ],
)
def test_a_claim_is_of_the_disturbances_that_its_sets_contain(chi, gamma, words):
    swing = {"chi_amplitude": chi, "gamma_amplitude": gamma}
    found = ft.tube(manoeuvre(duration_s=0.1, ramp_dps=1.0, disturbance=swing), ft.PAPER_GAINS)

    assert words in found.sentence
    widest = np.rad2deg(found.bounds.half_widths[:, :2].max(axis=0))
    stated = [float(x.split()[0]) for x in found.sentence.split(" within ")[-2:]]
    assert all(widest <= stated)
    assert all(stated <= np.maximum(1.11 * widest, 1e-4))


@pytest.mark.slow
def test_the_largest_disturbance_is_known_to_two_digits(tmp_path):
    scenario = tmp_path / "s.toml"
    scenario.write_text(QUICK_TOML)
    found = answer("tube", scenario, "--disturbance", "largest", "--gains", "quick")

    tried = {row["disturbance"]: row["status"] for row in found["tried"]}
    largest = found["largest_disturbance"]
    lost = [size for size, status in tried.items() if status == "unbounded"]
    assert tried[largest] == "bounded"
    assert min(lost) == pytest.approx(largest + 10.0 ** np.floor(np.log10(largest) - 1))
    assert [*tried] == sorted(tried)


QUICK_TOML = """
title = "quick"
gains = [{ name = "quick", K_P = [[3.0, 0.0], [0.0, 3.0]], K_I = [[1.5, 0.0], [0.0, 1.5]] }]
flight = { V_a_mps = 25.0, chi_deg = 1.0, gamma_deg = 1.0, duration_s = 2.0 }
reference = { chi_deg = 0.0, gamma_deg = 0.0 }
controller = { rate_hz = 1.0 }
limits = { phi_deg = [-45.0, 45.0], phi_rate_dps = 30.0, n_z = [-2.1, 2.1], n_z_rate_per_s = 1.0 }
plant = [{ kind = "kinematic" }]
"""


# ---------------------------------------------------------------- which runs a tube covers
START, PUSH = np.radians(1.0), 0.004


@pytest.fixture(scope="module")
def around():
    return ft.tube(manoeuvre(ramp_dps=1.0), "paper", start=START, disturbance=PUSH)


FLIGHT = {"V_a_mps": 25.0, "chi_deg": 10.0, "gamma_deg": 5.0, "duration_s": 0.4}
BEGIN = {"gamma_from_deg": 0.0}


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({}, ""),
        ({"flight": {"chi_deg": 9.01}}, ""),
        ({"flight": {"chi_deg": 11.01}}, r"`flight\.chi_deg` must be"),
        ({"flight": {"gamma_deg": 3.9}}, r"`flight\.gamma_deg` must be"),
        ({"flight": {"V_a_mps": 26.0}}, r"`flight\.V_a_mps` must be 25"),
        ({"disturbance": {"chi_amplitude": 0.0039, "chi_omega_rad_s": 3.0}}, ""),
        ({"disturbance": {"chi_amplitude": 0.0041, "chi_omega_rad_s": 3.0}},
         r"`disturbance\.chi_amplitude` must be"),
        ({"disturbance": {"gamma_amplitude": -0.0041}}, r"gamma_amplitude` must be"),
        ({"disturbance": {"chi_amplitude": 0.001, "chi_omega_rad_s": 3.0, "as_wind": True}},
         "as_wind` must be"),
        ({"wind": {"speed_mps": 3.0, "from_deg": 0.0}}, r"`wind\."),
        ({"reference": {"chi_deg": 1.0}}, "its reference must be"),
        ({"gains": ["K5"]}, "its gains must be"),
        ({"law": [{"name": "exact", "kind": "exact"}]}, "its law must be paper, got exact"),
        ({"plant": [{"kind": "point_mass"}]}, "its plant must be kinematic"),
        ({"limits": {"phi_deg": [-30.0, 30.0]}}, r"`limits\."),
    ],
)  # fmt: skip
def test_a_run_is_covered_if_it_is_one_of_the_flights_enclosed(around, tables, words):
    lists = {key: of for key, of in tables.items() if isinstance(of, list)}
    own = {key: of for key, of in tables.items() if key not in lists}
    scenario = ft.scenario_from(other(manoeuvre(ramp_dps=1.0), **own).as_dict() | lists)
    flight = ft.fly(scenario)

    (run,) = flight.runs
    assert (around.why_not(run) == "") == (words == "")
    if words:
        with pytest.raises(ft.InputError, match=rf"`claim` must cover a run: .*{words}"):
            flight.within(around)
        return
    (claim,) = flight.within(around).runs[0].claims
    assert (claim.kind, claim.bounds.names) == ("proven", ("chi_err", "gamma_err"))
    assert claim.contains(run.signals)


@pytest.mark.slow
def test_the_disturbance_of_a_model_from_logs_is_its_larger_residual_rate(tmp_path):
    evidence = {
        "logs": ["flight.csv"], "assumed": [], "frequency_95_rad_s": {}, "delay_95_s": {},
        "stretches": {}, "phi_deg": [-30.0, 30.0], "phi_rate_dps": 30.0, "n_z": [0.0, 2.0],
        "n_z_rate_per_s": 1.0, "residual_rad_s": {"chi": 0.01, "gamma": 0.02},
    }  # fmt: skip
    model = ft.loop.load_identified("aerosonde")
    type(model).model_validate({**model.model_dump(), "log": evidence}).save(tmp_path / "m.json")
    plant = {"kind": "point_mass_lag", "identified": str(tmp_path / "m.json")}

    found = ft.tube(manoeuvre(plant, chi_deg=1.0, gamma_deg=1.0, duration_s=0.1, ramp_dps=1.0),
                    ft.PAPER_GAINS)  # fmt: skip

    assert found.problem.disturbance == 0.02


# ---------------------------------------------------------------- an aircraft in counted boxes
AEROSONDE = {"kind": "jsbsim", "aircraft": "aerosonde"}


@pytest.fixture(scope="module")
def boxes():
    return ft.load(residual())


@pytest.fixture(scope="module")
def aircraft(boxes):
    return ft.tube(boxes.flights.scenario, "paper", boxes)


@pytest.mark.soak
def test_the_aircraft_flies_in_the_tube_of_its_boxes_which_is_proven_again(
    aircraft, boxes, tmp_path
):
    aircraft.save(tmp_path / "t.npz")
    alone, with_boxes = ft.verify(tmp_path / "t.npz"), ft.load(tmp_path / "t.npz")

    assert aircraft.status == "bounded"
    assert (aircraft.flown.leave, aircraft.flown.outside_boxes) == (0, 0)
    assert (aircraft.probability.of, aircraft.probability.at_most) == ("residual_rates", 0.3)
    assert "with probability at most 0.3" in aircraft.sentence
    assert alone.valid
    assert "the boxes in the file is not checked" in with_boxes.sentence
    assert with_boxes.probability is None
    run = next(x for x in ft.fly(boxes.flights.scenario, gains=["paper"]).runs
               if x.provenance.aircraft)  # fmt: skip
    assert aircraft.why_not(run) == ""
    assert aircraft.on(run).contains(run.signals)
    assert aircraft.bounds.contain(run.signals)


@pytest.mark.soak
def test_boxes_other_than_those_counted_are_refused(aircraft, boxes, tmp_path):
    stated = aircraft.probability
    assert (stated.of, stated.at_most, stated.confidence) == ("residual_rates", 0.3, 0.9)
    file = saved(aircraft, "aircraft.npz")
    kept = Opened.of(file).arrays["boxes"]
    other_boxes = changed(file, tmp_path / "b.npz", boxes=0.5 * kept)
    other_hash = changed(file, tmp_path / "h.npz", {"band_sha256": "0" * 64})
    none = changed(file, tmp_path / "n.npz", {"band_sha256": None}, boxes=None)

    for path, words in ((other_boxes, "`boxes` must"), (other_hash, "`band_sha256` must")):
        with pytest.raises(ft.InputError, match=words):
            ft.verify(path, boxes=boxes)
    with pytest.raises(ft.InputError, match="`boxes` must be given"):
        ft.load(none)
    with pytest.raises(ft.InputError, match="`boxes` must be given for the tube"):
        ft.verify(residual(), boxes=boxes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tables", "options", "words"),
    [
        ({}, {"gains": ft.PIGains(K_P=2.0 * ft.PAPER_GAINS.K_P, K_I=ft.PAPER_GAINS.K_I)}, "`K_P`"),
        ({}, {"gains": ft.PIGains(K_P=ft.PAPER_GAINS.K_P, K_I=1.001 * ft.PAPER_GAINS.K_I)},
         "`K_I`"),
        ({"flight": {"chi_deg": 8.0}}, {}, r"`flight.chi_deg`|flight.chi_deg is 8"),
        ({"flight": {"V_a_mps": 26.0}}, {}, "V_a_mps"),
        ({}, {"disturbance": 0.1}, "`disturbance` must not be given"),
        ({}, {"boxes": None, "plant": "jsbsim:aerosonde", "gains": ft.PAPER_GAINS},
         "`boxes` must be given"),
        ({}, {"start": np.radians(2.5)}, r"`start` must be at most 2 deg"),
        ({"controller": {"schedule": True}}, {}, "schedule` must be"),
    ],
)  # fmt: skip
def test_what_the_boxes_say_nothing_about_is_refused(boxes, tables, options, words):
    scenario = other(boxes.flights.scenario, **tables)

    with pytest.raises(ft.InputError, match=words):
        ft.tube(scenario, **{"gains": "paper", "boxes": boxes, **options})


@pytest.mark.soak
def test_boxes_are_counted_for_an_aircraft_that_is_asked_for_and_bound_flights_from_all_starts():
    with flown_here():
        found = ft.tube(manoeuvre(AEROSONDE, chi_deg=4.0, gamma_deg=0.0, ramp_dps=1.0), "paper",
                        plant="jsbsim:aerosonde", start=np.radians(1.0))  # fmt: skip

    assert (found.status, found.probability.of) == ("bounded", "flight")
    assert (found.flown.flights, found.flown.drawn) == (13, 8)
    assert found.flown.leave == 0


def test_lags_and_flights_of_a_plant_are_those_of_its_scenario():
    found = ft.tube(manoeuvre(LAGS, ramp_dps=1.0, duration_s=0.1), ft.PAPER_GAINS)

    assert [x.natural_frequency for x in found.problem.lags] == [8.0, 6.0]
    assert len(found.bounds.t) == 6
    assert flown(found).index.tolist() == pytest.approx(found.bounds.t.tolist())


class Pushed(ft.loop.PointMassPlant):
    """The model of an aircraft under residual rates of each sample, (samples, 2).

    Its controller sees `beyond` more roll at each sample.
    """

    def __init__(self, lags, rates, beyond):
        self.left, self.now, self.beyond = iter(rates.tolist()), (0.0, 0.0), iter(beyond.tolist())
        super().__init__(lags, disturbance=lambda _: self.now)

    def advance(self, *commands):
        self.now = tuple(next(self.left))
        return super().advance(*commands)

    def observe(self):
        chi, gamma, phi, *rest = super().observe()
        return (chi, gamma, phi + next(self.beyond, 0.0), *rest)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_no_flight_of_the_model_in_the_boxes_leaves_the_tube(aircraft, boxes, seed):
    """Its rates are anywhere in their boxes or at their ends, and so is the roll that is seen."""
    rng, (low, high) = np.random.default_rng(seed), np.moveaxis(
        aircraft.problem.boxes.bounds.pairs[:-1], 2, 0
    )  # fmt: skip
    share = rng.random(low.shape) if seed % 2 else rng.choice([0.0, 1.0], low.shape)
    values = low + share * (high - low)
    roll = [values[0, 2]]
    for k in range(1, len(values)):  # it changes by no more than the box of its change
        moved = np.clip(values[k, 2] - roll[-1], low[k - 1, 3], high[k - 1, 3])
        roll.append(np.clip(roll[-1] + moved, low[k, 2], high[k, 2]))
    scenario = boxes.flights.scenario.as_dict() | {"gains": ["paper"], "plant": []}

    def plant(*_):
        return Pushed(aircraft.problem.lags, values[:, :2], np.array([*roll, roll[-1]]))

    tables = scenario | {"plant": [{"kind": "kinematic"}]}
    runs = ft.fly(ft.scenario_from(tables), plants={"pushed": plant}).runs

    (run,) = (run for run in runs if "pushed" in run.label)
    assert aircraft.bounds.contain(run.signals)
