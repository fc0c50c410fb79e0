"""Compiled functions have the bits of plain ones; damaged ones on disk cost time, nothing else."""

import math
import os
import resource

import pandas as pd
import pytest
from made_up import made_up_scenario

numba = pytest.importorskip("numba")

import flighttune as ft  # noqa: E402
from flighttune.flight.loop import loop  # noqa: E402
from flighttune.flight.loop.kernel import kernel  # noqa: E402

pytestmark = pytest.mark.slow


def compiled(folder, monkeypatch, argument=21.0):
    """A function that is compiled anew or taken from the folder, and its statistics."""

    def doubled(x):
        return 2.0 * x

    monkeypatch.setattr(numba.core.config, "CACHE_DIR", str(folder))
    doubled.__qualname__ = "doubled"
    function = kernel(doubled)
    return function, function(argument)


def hits(function):
    return sum(function.stats.cache_hits.values())


DAMAGES = {
    "cut": lambda data: data[: len(data) // 2],
    "empty": lambda _: b"",
    "garbage": lambda data: bytes(range(256)) * (len(data) // 256 + 1),
    "one bit": lambda data: data[:-200] + bytes([data[-200] ^ 1]) + data[-199:],
    "of nothing": lambda data: data[:32],
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_function_is_compiled_again_and_kept(tmp_path, monkeypatch, damage):
    first, value = compiled(tmp_path, monkeypatch)
    (file,) = tmp_path.rglob("*.compiled")
    whole = file.read_bytes()
    assert (hits(first), value) == (0, 42.0)

    file.write_bytes(damage(whole))
    second, value = compiled(tmp_path, monkeypatch)
    assert (hits(second), value) == (0, 42.0)

    third, value = compiled(tmp_path, monkeypatch)
    assert (hits(third), value) == (1, 42.0)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root makes files of other users")
@pytest.mark.parametrize("of", ["file", "folder", "another function"])
def test_a_function_that_another_user_planted_is_compiled_again(tmp_path, monkeypatch, of):
    first, _ = compiled(tmp_path, monkeypatch)
    assert hits(first) == 0
    (file,) = tmp_path.rglob("*.compiled")
    if of == "another function":
        whole = file.read_bytes()
        compiled(tmp_path / "other", monkeypatch, 21)
        (other,) = (tmp_path / "other").rglob("*.compiled")
        assert other.name != file.name
        file.write_bytes(other.read_bytes())
        assert file.read_bytes() != whole
    else:
        os.chown(file if of == "file" else file.parent, 65534, 65534)

    second, value = compiled(tmp_path, monkeypatch)

    assert (hits(second), value) == (0, 42.0)


def test_a_function_that_cannot_be_kept_is_compiled_all_the_same(tmp_path, monkeypatch):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64, before[1]))
    try:
        function, value = compiled(tmp_path, monkeypatch)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

    assert (hits(function), value) == (0, 42.0)
    assert not [*tmp_path.rglob("*.compiled")]
    assert not [*tmp_path.rglob(".flighttune*")]


@pytest.mark.parametrize("gains", [
    {"name": "own", "K_P": [[1.5, 0.1], [-0.1, 1.3]], "K_I": [[0.8, 0.0], [0.05, 0.7]]},
    {"name": "own", "K_P": [[0.9, 0.05], [0.02, 0.7]], "K_I": [[0.4, 0.0], [0.0, 0.3]],
     "law": "exact", "feedback": [0.4, 0.3]},
])  # fmt: skip
@pytest.mark.parametrize("anti_windup", ["conditional", "back_calculation"])
def test_compiled_samples_of_either_law_at_its_limits_are_those_of_the_plain_loop(
    monkeypatch, gains, anti_windup
):
    """Commands that magnitude and rate hold to either side, and what the laws record."""
    turn = {"chi_deg": [{"shape": "step", "start_s": 1.0, "change_deg": 70.0}, {
        "shape": "step", "start_s": 4.0, "change_deg": -90.0,
    }], "gamma_deg": [{"shape": "step", "start_s": 2.0, "change_deg": 12.0}]}  # fmt: skip
    limits = {"phi_deg": [-25.0, 32.0], "phi_rate_dps": [-60.0, 45.0]}
    limits |= {"n_z": [0.7, 1.35], "n_z_rate_per_s": [-1.1, 0.8]}
    scenario = made_up_scenario(
        flight={"duration_s": 8.0},
        reference=turn,
        limits=limits,
        gains=[gains],
        expect=[],
        controller={"anti_windup": anti_windup},
        plant=[{"kind": "jsbsim", "aircraft": "aerosonde"}],
        **({"law": [{"name": "exact", "kind": "exact"}]} if "law" in gains else {}),
    )
    flown = []
    for samples in (0, math.inf):
        monkeypatch.setattr(loop, "COMPILED_FROM", samples)
        flown += ft.fly(scenario).runs
    compiled, plain = flown

    held = plain.signals[["phi_limited", "n_z_limited"]].to_numpy()
    assert {*held[:, 0]} == {*held[:, 1]} == {0.0, 1.0, 2.0}
    pd.testing.assert_frame_equal(compiled.signals, plain.signals, check_exact=True)
