"""Flights streamed while they are flown: into a viewer without a window, paced, stopped."""

import time
from contextlib import contextmanager

import pytest
from figures.screenshot import NEEDS_DRIVER, NO_GRAPHICS, viewer_client
from pictures import DEMANDED, FLAT, pixels

from flighttune.errors import InputError, RecordingError
from flighttune.flight.fly import fly
from flighttune.recording.live import LIVE_PLOTS, LiveSession
from flighttune.recording.viewer import ViewerProcess, free_port, stream_url
from flighttune.scenario import load_scenario, scenario_from

pytestmark = pytest.mark.slow

SLOW_MACHINE = 1.0
TRIES = 6
"""Seconds that pacing may be late."""


def short(seconds, *, plants=1):
    tables = load_scenario("paper").as_dict()
    tables["flight"]["duration_s"] = seconds
    tables["gains"] = ["paper"]
    tables["plant"] = tables["plant"][:plants]
    tables.pop("expect", None)
    return scenario_from(tables)


@contextmanager
def server():
    """A data server on this machine with nobody who looks."""
    port = free_port()
    with ViewerProcess(["--serve-grpc"], port=port) as process:
        yield process, stream_url(port)


def test_a_watched_flight_is_the_same_to_the_bit():
    scenario = short(3.0, plants=2)
    alone = fly(scenario)
    with server() as (_, url), LiveSession(scenario, url, pace=None) as session:
        watched = fly(scenario, observer=session)

    for a, b in zip(alone.runs, watched.runs, strict=True):
        assert a.signals.equals(b.signals)
        assert (a.status, a.label) == (b.status, b.label)


@pytest.mark.parametrize("pace", [1.0, 4.0])
def test_the_pace_is_kept(pace):
    least = 0.9 * 1.5 / pace - 0.15
    # A busy machine may be late once; a pace that is not kept is late every time.
    for _ in range(TRIES):
        scenario = short(1.5)
        with server() as (_, url), LiveSession(scenario, url, pace=pace) as session:
            began = time.monotonic()
            fly(scenario, observer=session)
            took = time.monotonic() - began
        assert took > least
        if took < 1.5 / pace + SLOW_MACHINE:
            return
    pytest.fail(f"late in {TRIES} of {TRIES} flights, the last by {took - 1.5 / pace:.1f} s")


@pytest.mark.parametrize("pace", [0.0, -1.0, float("nan")])
def test_a_pace_must_be_positive(pace):
    with pytest.raises(InputError, match="`pace` must be positive"):
        LiveSession(short(1.0), stream_url(free_port()), pace=pace)


class StopsItself(LiveSession):
    """A session that somebody stops after so many observations."""

    left = 40

    def watch(self, plant, label):
        watched = super().watch(plant, label)
        observe = watched.observe

        def counted():
            self.left -= 1
            if not self.left:
                self.stop()
            return observe()

        watched.observe = counted
        return watched


def test_a_flight_that_is_stopped_keeps_what_was_flown():
    scenario = short(3.0, plants=2)
    alone = fly(scenario)
    with server() as (_, url), StopsItself(scenario, url, pace=None) as session:
        stopped = fly(scenario, observer=session)

    first, late = sorted(stopped.runs, key=lambda run: -len(run.signals))
    whole = next(run for run in alone.runs if run.label == first.label)
    assert first.status == "interrupted"
    assert first.reason == "stopped by hand at t = 0.78 s."
    assert first.signals.equals(whole.signals.iloc[:40])
    assert (late.status, len(late.signals)) == ("interrupted", 0)
    assert late.reason == "the flights were stopped before this one began"


def test_a_viewer_that_goes_away_does_not_stop_the_flight():
    scenario = short(2.0)
    with server() as (process, url), LiveSession(scenario, url, pace=4.0) as session:
        process.close()
        (run,) = fly(scenario, observer=session).runs

    assert run.status == "completed"


@pytest.fixture(scope="module")
def window():
    """A viewer without a screen that waits for data, and its client."""
    port = free_port()
    try:
        process = ViewerProcess(
            ["--headless", "--hide-welcome-screen", "--window-size", "1200x800"],
            port=port,
            environment={"RUST_LOG": "error"},
        )
    except RecordingError as error:
        if DEMANDED or not any(word in str(error) for word in NO_GRAPHICS):
            raise
        pytest.skip(f"{NEEDS_DRIVER}: {error}")
    with process:
        yield viewer_client(stream_url(port)), stream_url(port)


def test_a_viewer_shows_the_flight_and_complains_of_nothing(window, tmp_path):
    client, url = window
    scenario = short(6.0, plants=2)
    with LiveSession(scenario, url, pace=None) as session:
        fly(scenario, observer=session)
    end = time.monotonic() + 20.0
    while len(client.get_state().views) < 1 + len(LIVE_PLOTS) and time.monotonic() < end:
        time.sleep(0.2)
    time.sleep(1.0)
    state = client.get_state()
    picture = client.take_screenshot()
    (tmp_path / "live.png").write_bytes(picture)

    assert len(state.views) == 1 + len(LIVE_PLOTS)
    assert [report for view in state.views for report in view.reports] == []
    assert [entry for entry in client.get_logs() if entry.level == "ERROR"] == []
    assert pixels(picture).std() > FLAT
