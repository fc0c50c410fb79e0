"""Compiled steps of the tests are kept in a folder of theirs."""

import pytest

from flighttune.vehicles.compiled import face


@pytest.fixture(scope="session")
def shared_cache(tmp_path_factory):
    """A folder for the steps of all tests."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _own_cache(shared_cache, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(shared_cache))


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """A new folder, and nothing kept in the process."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    kept = face._known, face._code, face._writing
    for cached in kept:
        cached.cache_clear()
    yield tmp_path / "cache" / "flighttune" / "compiled"
    for cached in kept:
        cached.cache_clear()
