"""Compiled functions have the bits of plain ones; damaged ones on disk cost time, nothing else."""

import os
import resource

import pytest

numba = pytest.importorskip("numba")

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
    "one bit": lambda data: data[:-200] + bytes([data[-200] ^ 1]) + data[-199:],
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
