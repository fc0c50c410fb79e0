"""Compiled steps of the tests are kept in a folder of theirs."""

import pytest


@pytest.fixture(scope="session")
def shared_cache(tmp_path_factory):
    """A folder for the steps of all tests."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def own_cache(shared_cache, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(shared_cache))


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """A new folder of steps."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "flighttune" / "compiled"
