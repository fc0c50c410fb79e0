"""A tube's file and its commands: read back, checked, refused where something in it is not so."""

import io
import json
import math
import re
import shutil
import subprocess
import sys
import tracemalloc
import zipfile

import numpy as np
import pytest
from commands import flighttune
from made_up import scenario_file
from made_up_tubes import FEW_PIECES, arrays_of, claim_of, rewritten, tube, tube_scenario

import flighttune as ft
from flighttune.base.files import load
from flighttune.base.words import quoted
from flighttune.claims.tubes import tube as tubes
from flighttune.claims.tubes.enclosure import BOUND_MARGIN
from flighttune.vehicles.identification.file import LogEvidence


@pytest.fixture(scope="module")
def proven(tmp_path_factory):
    path = tmp_path_factory.mktemp("tube") / "tube.npz"
    # Roll leaves its rate limit within the time: there is something to choose.
    scenario = tube_scenario(chi_err_deg=15.0, gamma_deg=15.0, duration_s=1.0)
    found = tube(scenario, ft.PAPER_GAINS, for_ever=False, disturbance=0.02)
    found.save(path)
    return found, path


@pytest.fixture
def changed(proven, tmp_path):
    """A copy of the file with one array, or one entry of the claim, changed, put in or left out."""

    def change(name, function):
        arrays, claim = arrays_of(proven[1]), claim_of(proven[1])
        in_claim = {name: function(claim.get(name))} if name in (*claim, "counted") else {}
        other = {} if in_claim else {name: function(arrays.get(name, np.zeros((51, 2))).copy())}
        return rewritten(proven[1], other, tmp_path / "changed.npz", **in_claim)

    return change


@pytest.mark.slow
def test_a_tube_reads_back_and_is_proven_again(proven):
    found, path = proven

    again = ft.load(path)

    assert again.bounds.pairs == pytest.approx(found.bounds.pairs, abs=1e-8)
    assert (again.can_limit == found.can_limit).all()
    verified = ft.verify(path)
    assert verified.valid
    # Bounds in a file are looser than those proven, which are found again but for rounding.
    margins = [check.margin for check in verified.checks]
    assert margins == pytest.approx([BOUND_MARGIN] * 4, rel=0.01)


@pytest.mark.parametrize(
    ("name", "index", "value", "inequality"),
    [
        ("bounds", (30, 0, 0), lambda x: x + 1e-6, "sample 30 .*chi_err >= .* is not proven"),
        ("bounds", (20, 1, 1), lambda x: x - 1e-6, "sample 20 .*gamma_err <= .* is not proven"),
        ("bounds", (40, 2, 1), lambda x: x - 1e-6, "sample 40 .*phi_cmd <= .* is not proven"),
        ("held", (0, 0), lambda _: False, "sample 0 .*no limit holds phi_cmd"),
    ],
)
def test_a_claim_of_more_than_is_proven_is_refused_with_sample_and_inequality(
    changed, name, index, value, inequality
):
    def forge(array):
        array[index] = value(array[index])
        return array

    found = ft.verify(changed(name, forge))

    assert not found.valid
    assert re.search(inequality, found.reason)


@pytest.mark.slow
def test_what_is_wrong_in_the_choices_makes_the_set_wider_and_is_refused(changed):
    assert not ft.verify(changed("chosen", lambda chosen: chosen * 0.9)).valid
    assert "early" in ft.verify(changed("chosen", lambda chosen: chosen[:-40])).reason


def in_table(*path, value):
    """A change of one value deep in the claim."""

    def change(table):
        inner = table
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = value
        return table

    return change


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("gains", lambda gains: {**gains, "K_I": [[3.6, 0.1784], [-0.1784, 3.4869]]}),
        ("disturbance_rad_s", lambda _: 1e306),
        ("start_rad", lambda _: 0.01),
        ("scenario", in_table("reference", "chi_deg", value=-90.0)),
        ("scenario", in_table("limits", "phi_deg", value=[-5.0, 5.0])),
        ("scenario", in_table("controller", "feed_forward", value=False)),
        ("scenario", in_table("plant", 0, "kind", value="point_mass")),
    ],
)
def test_another_loop_than_the_one_enclosed_is_refused(changed, key, change):
    path = changed(key, change)
    if key == "scenario":
        label = ft.scenario_from(claim_of(path)["scenario"]).plant[0].label
        path = rewritten(path, {}, plant=label)

    assert "is not proven" in ft.verify(path).reason


def test_a_disturbance_that_is_left_out_is_that_of_the_scenario(proven, tmp_path):
    swing = {"chi_amplitude": 0.5, "chi_omega_rad_s": 1.0}
    scenario = {**claim_of(proven[1])["scenario"], "disturbance": swing}
    path = tmp_path / "changed.npz"

    rewritten(proven[1], {}, path, scenario=scenario, disturbance_rad_s=None)
    assert "is not proven" in ft.verify(path).reason
    rewritten(proven[1], {}, path, scenario=scenario)
    with pytest.raises(ft.InputError, match=r"changed\.npz: `disturbance`.* 0.5 "):
        ft.load(path)


@pytest.mark.slow
def test_a_feasible_reference_in_the_file_must_be_that_of_the_scenario(tmp_path):
    tables = tube_scenario(chi_err_deg=4.0, gamma_deg=0.0, gamma_ref_deg=0.0).as_dict()
    tables["reference"]["shape"] = "feasible"
    tables["flight"]["duration_s"] = 1.0
    path = tmp_path / "tube.npz"
    found = tube(ft.scenario_from(tables), ft.PAPER_GAINS, for_ever=False)
    found.save(path)
    near, far = (found.problem.reference + by for by in (1e-9, 1e-5))

    again = ft.load(rewritten(path, {"reference": near}, tmp_path / "near.npz"))

    assert (again.problem.reference == near).all()
    assert ft.verify(path).valid
    with pytest.raises(ft.InputError, match=r"far\.npz: `reference`.*1e-05"):
        ft.load(rewritten(path, {"reference": far}, tmp_path / "far.npz"))


@pytest.mark.parametrize(
    ("name", "change", "what"),
    [
        ("format", lambda _: "flighttune tube 4", "format"),
        ("bounds", lambda bounds: bounds[:-1], "bounds"),
        ("held", lambda held: held.astype(float), r"`held\.npy` must be of type bool"),
        ("chosen", lambda chosen: chosen.astype(float), r"`chosen\.npy` .* float32, got float64"),
        ("chosen", lambda chosen: chosen * np.nan, r"`chosen\.npy` must be finite"),
        ("settings", lambda s: {**s, "sides": 10**6}, r"`settings\.sides`"),
        ("start_rad", lambda _: float("nan"), "`start_rad`"),
        ("hand_over", lambda _: [40.7, 5], r"`hand_over\.0`"),
        ("scenario", lambda s: {**s, "colour": "red"}, "colour"),
        ("scenario", in_table("flight", "duration_s", value=2e4), "`bounds` must have shape"),
        ("counted", lambda _: "on 10^9 flights", "`counted`"),
        *(
            (name, lambda array: array, rf"`{name}\.npy` must not")
            for name in ("reference", "boxes", "ever_W", "colour")
        ),
        *((name, lambda _: None, rf"`{name}\.npy` must be in") for name in ("bounds", "chosen")),
    ],
)
def test_what_is_no_tube_is_refused_in_one_line_by_name(changed, name, change, what):
    with pytest.raises(ft.InputError, match=rf"changed\.npz: .*{what}") as refused:
        ft.verify(changed(name, change))

    assert "\n" not in str(refused.value)


def test_a_file_without_its_claim_is_refused(proven, tmp_path):
    path = rewritten(proven[1], {"claim": None}, tmp_path / "changed.npz")

    with pytest.raises(ft.InputError, match=r"changed\.npz: must be a file"):
        ft.load(path)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_an_array_that_is_there_twice_is_refused(proven, tmp_path):
    path = tmp_path / "changed.npz"
    shutil.copy(proven[1], path)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("bounds.npy", archive.read("bounds.npy"))
        archive.comment = load.BLANK.encode()
    load.seal_end(path)

    with pytest.raises(ft.InputError, match=r"`bounds\.npy`.*once"):
        ft.load(path)


BOMB = 70_000_000
"""Choices of a member of zeros: 280 MB, more than a tube may have, and 0.3 MB in the file."""

LITTLE = 20_000_000
"""Bytes that reading may take to refuse a file: that of `proven` has a thousandth of it."""


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "stated"), [("chosen.npy", None), ("chosen.npy", 1000), ("colour.npy", 1000)]
)
def test_a_member_that_is_too_large_is_refused_before_it_is_unpacked(
    proven, tmp_path, name, stated
):
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(proven[1]) as whole, zipfile.ZipFile(path, "w") as archive:
        for entry in whole.infolist():
            if entry.filename != name:
                archive.writestr(entry, whole.read(entry))
        zeros = io.BytesIO()
        np.save(zeros, np.zeros(BOMB, np.float32))
        archive.writestr(name, zeros.getvalue(), compress_type=zipfile.ZIP_DEFLATED)
        size = len(zeros.getvalue())
        del zeros
    if stated is not None:  # the directory of the file may say that the member is small
        lie = path.read_bytes().replace(size.to_bytes(4, "little"), stated.to_bytes(4, "little"))
        path.write_bytes(lie)

    tracemalloc.start()
    with pytest.raises(ft.InputError, match=r"bomb\.npz: "):
        ft.load(path)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()

    assert most < LITTLE


@pytest.mark.soak
def test_choices_that_split_the_set_without_end_are_refused(proven, tmp_path):
    # Each split names all pieces and doubles them.
    endless = np.ones(6_000_000, dtype=np.float32)
    path = rewritten(proven[1], {"chosen": endless}, tmp_path / "changed.npz")

    assert "the choices make the set too large" in ft.verify(path).reason


@pytest.mark.soak
def test_the_check_does_not_import_the_search():
    code = (
        "import sys, flighttune.claims.tubes.enclosure; "
        "print([m for m in sys.modules if 'tube' in m])"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert "flighttune.claims.tubes.enclosure" in shown.stdout
    assert "flighttune.claims.tubes.search" not in shown.stdout


@pytest.fixture
def scenario(tmp_path):
    def write(duration=0.6, ramp_dps=None, **more):
        level = {"gamma_deg": 0.0, "gamma_ref_deg": 0.0, "ramp_dps": ramp_dps}
        turn = tube_scenario(chi_err_deg=20.0, duration_s=duration, **level)
        return scenario_file(tmp_path / "short.toml", turn, **more)

    return write


@pytest.mark.slow
def test_a_title_in_a_proof_is_quoted_and_cannot_move_the_cursor(scenario, tmp_path):
    proof = tmp_path / "proof.npz"
    # While its reference moves at the end, no set is looked for that holds for ever.
    flighttune("tube", scenario(ramp_dps=1.0), "--out", proof)
    assert [x.title for x in ft.plot(ft.load(proof)).charts] == ["Course error", "Path-angle error"]
    title = "A turn of 90 deg\x1b[2J, of 10^9 flights none left"
    rewritten(proof, {}, scenario={**claim_of(proof)["scenario"], "title": title})

    stdout, _ = flighttune("verify", proof)

    assert "\x1b" not in stdout
    assert quoted(title) in " ".join(stdout.split())


@pytest.mark.slow
def test_a_set_that_cannot_be_bounded_is_an_answer_with_time_and_reason(scenario, tmp_path):
    # The disturbance alone turns the path upright in half a second.
    out = tmp_path / "proof.npz"
    arguments = scenario(), "--disturbance", "4", "--out", out

    stdout, stderr = flighttune("tube", *arguments, "--json", status=1)

    found = json.loads(stdout)
    assert found["status"] == "unbounded"
    assert re.search(r"from t = 0\.\d\d s on", found["reason"])
    # The start is 20 deg off: roll meets its rate limit of 30 deg/s at once.
    assert found["limits_can_hold"]["phi_cmd"][0][0] == 0.0
    assert found["reason"] in stderr
    assert not out.exists()


# rad/s: a disturbance that the scenario has itself
OWN = 0.15


@pytest.mark.slow
def test_the_next_larger_disturbance_of_two_digits_is_not_bounded():
    """A sample of a second is longer than the time in which a width may double."""
    start = {"chi_err_deg": 1.0, "gamma_deg": 1.0, "gamma_ref_deg": 0.0}
    tables = tube_scenario(**start, duration_s=2.0, rate_hz=1.0).as_dict()
    swing = {"chi_amplitude": OWN, "chi_omega_rad_s": 1.0}
    scenario = ft.scenario_from(tables | {"disturbance": swing})
    quick = ft.PIGains(K_P=3.0 * np.eye(2), K_I=1.5 * np.eye(2))

    found = tubes.largest_disturbance(tubes.stated_problem(scenario, quick))

    by_status = {"bounded": [], "unbounded": []}
    for size, of in found.tried.items():
        by_status[of.status].append(size)
    assert found.largest == max(by_status["bounded"])
    next_larger = float(f"{found.largest + 10.0 ** math.floor(math.log10(found.largest) - 1):.1e}")
    assert min(by_status["unbounded"]) == pytest.approx(next_larger)
    assert [*found.tried] == sorted(found.tried)
    assert OWN < min(found.tried)
    assert found.tried[next_larger].reason.endswith("from t = 2.00 s on")


@pytest.mark.parametrize(("grows_at", "said"), [(50, "from 0.96 s on"), (0, "from 0.00 s on")])
def test_from_when_on_a_lost_set_doubles_is_said(grows_at, said):
    """One width of the errors doubles in 8 samples: over 0.2 s, of 10, from two before it grows."""
    t = np.arange(100) / 50.0
    width = 2.0 ** (np.maximum(np.arange(80) - grows_at, 0) / 8.0)
    ranges = np.zeros((80, 4, 2))
    ranges[:, 0, 1], ranges[:, 1, 1] = 1.0, width
    reason = tubes._why_lost("lost", t, ranges)
    steady = ranges.copy()
    steady[:, 1, 1], steady[:, 2, 1] = 1.0, width

    assert reason == f"lost from t = 1.60 s on; {said} the width doubles within 0.2 s"
    # a command may grow
    assert tubes._why_lost("lost", t, steady) == "lost from t = 1.60 s on"
    assert tubes._why_lost("lost", t, ranges[:10]) == "lost from t = 0.20 s on"


def test_the_progress_of_a_tube_is_said_at_each_fiftieth_sample():
    seen = []
    problem = tubes.stated_problem(tube_scenario(chi_err_deg=0.1, duration_s=1.2), ft.PAPER_GAINS)
    tubes.tube_of(problem, attempts=FEW_PIECES, for_ever=False, progress=seen.append)

    assert seen == pytest.approx([0.0, 50.0 / 61.0])


@pytest.mark.soak
def test_the_largest_disturbance_that_is_bounded_is_found_to_two_digits(scenario):
    stdout, _ = flighttune("tube", scenario(duration=0.1), "--disturbance", "largest", "--json")

    found = json.loads(stdout)
    tried = {row["disturbance"]: row["status"] for row in found["tried"]}
    largest = found["largest_disturbance"]
    assert tried[largest] == "bounded"
    lost = [size for size, status in tried.items() if status == "unbounded"]
    assert all(row["reason"] for row in found["tried"] if row["disturbance"] in lost)
    # No number of two digits is in between.
    assert largest < min(lost) <= float(f"{largest * 1.1:.1e}")


@pytest.mark.parametrize(
    ("arguments", "more", "what"),
    [
        (["--disturbance", "-1"], {}, "`disturbance` must be positive, got -1"),
        (["--disturbance", "most"], {}, "--disturbance: must be a number, got 'most'"),
        (["--plant", "jsbsim:x"], {}, "`plant` must be one of kinematic"),
        (
            ["--disturbance", "largest", "--out", "proof.npz"],
            {},
            "`disturbance` must be a number with",
        ),
        ([], {"wind": {"speed_mps": 3.0, "from_deg": 0.0}}, "`wind` must not"),
        (
            ["--plant", "jsbsim:aerosonde"],
            {"plant": [{"kind": "jsbsim", "aircraft": "aerosonde"}]},
            "`start_deg` must be given",
        ),
        (
            ["--disturbance", "0.01"],
            {"disturbance": {"chi_amplitude": 0.1, "chi_omega_rad_s": 1.0}},
            "at least that of the scenario's",
        ),
    ],
)
def test_what_no_tube_is_known_for_is_refused_in_one_line(scenario, arguments, more, what):
    stdout, stderr = flighttune("tube", scenario(**more), *arguments, status=2)

    assert stdout == ""
    assert what in stderr
    assert stderr.count("\n") == 1


@pytest.mark.parametrize(("chi", "gamma"), [(0.02, 0.01), (0.01, 0.02)])
def test_the_disturbance_of_a_model_from_logs_is_the_larger_residual_rate(tmp_path, chi, gamma):
    evidence = LogEvidence(
        logs=("flight.csv",), assumed=(), frequency_95_rad_s={}, delay_95_s={}, stretches={},
        phi_deg=(-30.0, 30.0), phi_rate_dps=30.0, n_z=(0.0, 2.0), n_z_rate_per_s=1.0,
        residual_rad_s={"chi": chi, "gamma": gamma},
    )  # fmt: skip
    model = ft.loop.load_identified("aerosonde").model_copy(update={"log": evidence})
    model.save(tmp_path / "mine.json")
    plants = [{"kind": "point_mass_lag", "identified": str(tmp_path / "mine.json")}]
    flown = ft.scenario_from(tube_scenario(gamma_deg=0.0).as_dict() | {"plant": plants})

    assert tubes.stated_problem(flown, ft.PAPER_GAINS).disturbance == 0.02


@pytest.mark.parametrize("n_z", [[0.95, 2.0], [0.0, 0.98]])
def test_load_factors_at_both_ends_of_the_starts_are_inside_their_range(n_z):
    """Path angles of 10 to 20 deg are steady with 0.985 to 0.940."""
    tables = tube_scenario(gamma_deg=15.0).as_dict()
    tables["limits"]["n_z"] = n_z
    flown = ft.scenario_from(tables)

    assert tubes.stated_problem(flown, ft.PAPER_GAINS, start=np.deg2rad(0.5)).start > 0.0
    with pytest.raises(ft.InputError, match=r"`n_z` .* must start inside its range"):
        tubes.stated_problem(flown, ft.PAPER_GAINS, start=np.deg2rad(5.0))
