"""Compiled functions on disk are an aid: damaged or unwritable ones cost time and nothing else."""

import resource

import pytest

numba = pytest.importorskip("numba")

from flighttune.flight.loop.kernel import kernel  # noqa: E402

pytestmark = pytest.mark.slow


def compiled(folder, monkeypatch):
    """A function that is compiled anew or taken from the folder, and its statistics."""

    def doubled(x):
        return 2.0 * x

    monkeypatch.setattr(numba.core.config, "CACHE_DIR", str(folder))
    doubled.__qualname__ = "doubled"
    function = kernel(doubled)
    return function, function(21.0)


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
