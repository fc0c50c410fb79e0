"""A tube's file: read back, checked, and refused where something in it is not so."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest

from flighttune.control.gains import PAPER_GAINS
from flighttune.errors import InputError
from flighttune.tube.proof import is_tube_file, load_tube, save_tube, verify_tube
from flighttune.tube.tube import tube
from tests.tube.test_soundness import made_up


@pytest.fixture(scope="module")
def proven(tmp_path_factory):
    path = tmp_path_factory.mktemp("tube") / "tube.npz"
    # Roll leaves its rate limit within the time: there is something to choose.
    scenario = made_up(chi_err_deg=15.0, gamma_deg=15.0, duration_s=1.0)
    found = tube(scenario, PAPER_GAINS, disturbance=0.02)
    save_tube(found, path)
    return found, path


@pytest.fixture
def changed(proven, tmp_path):
    """A copy of the file with one array, or one entry of the claim, changed."""

    def change(name, function):
        with np.load(proven[1]) as arrays:
            content = {key: arrays[key] for key in arrays.files}
        if name in content:
            content[name] = function(content[name].copy())
        else:
            claim = json.loads(str(content["claim"]))
            claim[name] = function(claim[name])
            content["claim"] = np.array(json.dumps(claim))
        path = tmp_path / "changed.npz"
        np.savez_compressed(path, **content)
        return path

    return change


def with_entry(index, value):
    def change(array):
        array[index] = value(array[index])
        return array

    return change


def test_a_tube_reads_back_and_is_proven_again(proven):
    found, path = proven

    again = load_tube(path)

    assert is_tube_file(path)
    assert again.bounds == pytest.approx(found.bounds, abs=1e-8)
    assert (again.held == found.held).all()
    assert verify_tube(path).valid


@pytest.mark.parametrize(
    ("index", "by", "inequality"),
    [
        ((30, 0, 0), 1e-6, "sample 30 .*chi_err >= .* is not proven"),
        ((20, 1, 1), -1e-6, "sample 20 .*gamma_err <= .* is not proven"),
        ((40, 2, 1), -1e-6, "sample 40 .*phi_cmd <= .* is not proven"),
    ],
)
def test_a_bound_made_narrower_is_refused_with_sample_and_inequality(
    changed, index, by, inequality
):
    found = verify_tube(changed("bounds", with_entry(index, lambda bound: bound + by)))

    assert not found.valid
    assert re.search(inequality, found.reason)


def test_a_limit_said_not_to_hold_is_refused(changed):
    found = verify_tube(changed("held", with_entry((0, 0), lambda _: False)))

    assert not found.valid
    assert "sample 0" in found.reason
    assert "phi_cmd" in found.reason


@pytest.mark.slow
def test_what_is_wrong_in_the_choices_makes_the_set_wider_and_is_refused(changed):
    assert not verify_tube(changed("chosen", lambda chosen: chosen * 0.9)).valid
    assert "early" in verify_tube(changed("chosen", lambda chosen: chosen[:-40])).reason


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("gains", lambda gains: {**gains, "K_I": [[3.6, 0.1784], [-0.1784, 3.4869]]}),
        ("start_rad", lambda _: 0.01),
    ],
)
def test_another_loop_than_the_one_enclosed_is_refused(changed, key, change):
    assert "is not proven" in verify_tube(changed(key, change)).reason


def test_a_wider_disturbance_is_refused(changed):
    assert "is not proven" in verify_tube(changed("d_high", lambda d: d * 1.001)).reason


@pytest.mark.parametrize(
    ("name", "change", "what"),
    [
        ("format", lambda _: "flighttune tube 9", "format"),
        ("bounds", lambda bounds: bounds[:-1], "bounds"),
        ("chosen", lambda chosen: chosen * np.nan, "finite"),
        ("d_low", lambda d: d + 1.0, "d_low"),
        ("settings", lambda s: {**s, "sides": 10**6}, "settings"),
        ("scenario", lambda s: {**s, "colour": "red"}, "colour"),
        ("plant", lambda _: "glider", r"changed\.npz: `plant` must be one of .* got glider"),
    ],
)
def test_what_is_no_tube_is_refused_in_one_line(changed, name, change, what):
    with pytest.raises(InputError, match=what):
        verify_tube(changed(name, change))


def test_a_damaged_file_is_refused(proven, tmp_path):
    path = tmp_path / "cut.npz"
    path.write_bytes(proven[1].read_bytes()[:-200])

    assert not is_tube_file(path)
    with pytest.raises(InputError, match=r"cut\.npz"):
        load_tube(path)


@pytest.mark.slow
def test_the_check_imports_neither_the_search_nor_what_looks_for_a_set_that_is_kept():
    code = "import sys, flighttune.tube.proof; print([m for m in sys.modules if 'tube' in m])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert "flighttune.tube.proof" in shown.stdout
    assert "flighttune.tube.search" not in shown.stdout
    assert "flighttune.tube.settling" not in shown.stdout
