"""One flown scenario and its page, and chromium without a screen to look at it."""

import pytest
from browser import headless_chromium

import flighttune as ft


@pytest.fixture(scope="session")
def flown_paper():
    """The paper's manoeuvre on both plants."""
    return ft.fly(ft.load_scenario("paper"))


@pytest.fixture(scope="session")
def written(flown_paper, tmp_path_factory):
    """Its report."""
    folder = tmp_path_factory.mktemp("report") / "paper"
    ft.record(flown_paper, folder, name="paper")
    return ft.report(folder, folder.parent / "report.html")


@pytest.fixture(scope="session")
def page(written):
    """Its text."""
    return written.path.read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def chromium():
    """Start chromium once with some flags and an empty profile; return what it printed."""
    return headless_chromium()
