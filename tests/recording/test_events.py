"""What a recording says happened, and what it draws of it."""

from dataclasses import replace

import numpy as np
import pytest

from flighttune.recording.events import MAX_HOLDS, events
from flighttune.recording.record import write_recording
from flighttune.recording.scene import INSTANTS, MODEL_SPAN, REACH, WIND_TIMES, span_of

from .test_rrd import Contents

HALF_A_SAMPLE = 0.01


def texts(run):
    return [event.text for event in events(run)]


def test_the_first_steps_and_an_early_end_are_told(cut_short):
    chi, gamma, *_, last = events(cut_short)

    assert chi.text == "course reference 60 deg, from 0 deg"
    assert gamma.text == "path angle reference 30 deg, from 0 deg"
    assert (last.t, last.text[:29]) == (7.0, "left envelope: alpha 16.3 deg")


def test_limits_are_told_when_they_take_hold_and_for_how_long(four_runs):
    run = four_runs[1]
    held = run.signals["phi_limited"].to_numpy()
    begun = np.flatnonzero(np.diff(held, prepend=0.0) * (held > 0.0))

    found = [event for event in events(run) if event.text.startswith("roll command held")]

    assert [event.t for event in found] == pytest.approx(run.signals.index[begun].tolist())
    assert "rate limit" in found[0].text


def test_a_command_that_chatters_is_not_told_for_ever(four_runs):
    signals = four_runs[0].signals.copy()
    signals["phi_limited"] = np.arange(len(signals)) % 2.0

    found = texts(replace(four_runs[0], signals=signals))

    assert sum("roll command held by" in text for text in found) == MAX_HOLDS
    assert any(text.endswith("times more, not listed") for text in found)


def test_convergence_is_told_when_the_error_stays_small(four_runs):
    run = four_runs[0]
    (event,) = [e for e in events(run) if e.text.startswith("course error settled (5 %)")]
    error = run.signals["chi_err"]

    assert error.loc[event.t - HALF_A_SAMPLE :].abs().max() <= 0.05 * abs(error.iloc[0])
    assert abs(error.loc[: event.t - HALF_A_SAMPLE].iloc[-1]) > 0.05 * abs(error.iloc[0])


def gusty(run):
    t = run.signals.index.to_numpy()
    gust = np.where(np.abs(t - 8.0) < 2.0, 2.0 * (1.0 + np.cos(np.pi * (t - 8.0) / 2.0)), 0.0)
    wind = {"wind_north": 3.0 + gust, "wind_east": 0.0 * t, "wind_down": 0.0 * t}
    return replace(run, signals=run.signals.assign(**wind))


def test_a_gust_is_told_when_it_begins_and_at_its_peak(four_runs):
    begun, peak = [event for event in events(gusty(four_runs[0])) if event.sort == "wind"]

    assert 6.0 < begun.t < 7.0
    assert peak.t == pytest.approx(8.0)
    assert peak.text == "wind has changed by 4.0 m/s since the start"


def test_the_span_is_that_of_the_aircraft_file(four_runs):
    run = four_runs[0]
    other = replace(run.provenance, plant="jsbsim:c172p")
    unknown = replace(run.provenance, plant="jsbsim:none_such")
    none = replace(run.provenance, scenario={"title": "no aircraft"})

    assert span_of(four_runs[1]) == pytest.approx(2.8956)
    assert span_of(run) == pytest.approx(2.8956)
    assert span_of(replace(run, provenance=other)) == pytest.approx(35.8 * 0.3048)
    assert span_of(replace(run, provenance=unknown)) == MODEL_SPAN
    assert span_of(replace(run, provenance=none)) == MODEL_SPAN


@pytest.fixture(scope="module")
def contents(four_runs, tmp_path_factory):
    path = tmp_path_factory.mktemp("motion") / "gust.rrd"
    write_recording([gusty(run) for run in four_runs], path, page="", title="Gust")
    return Contents(path)


def test_arrows_show_velocity_and_wind_to_one_scale(contents, four_runs):
    frame = "/world/aircraft/kinematic_paper"
    velocity = contents.values(f"{frame}/velocity", "Arrows3D:vectors")[:, 0]
    wind = contents.values(f"{frame}/wind", "Arrows3D:vectors")[:, 0]
    run = gusty(four_runs[0]).signals
    scale = np.linalg.norm(velocity[0]) / run["V_a"].iloc[0]

    assert len(velocity) == INSTANTS
    assert REACH > 0.0
    assert np.linalg.norm(velocity, axis=1) == pytest.approx(scale * 25.0, rel=1e-5)
    assert -velocity[:, 2] / np.linalg.norm(velocity, axis=1) == pytest.approx(
        np.sin(run["gamma"].to_numpy()[np.unique(np.linspace(0, 1000, INSTANTS).astype(int))]),
        abs=1e-5,
    )
    assert np.linalg.norm(wind[0]) == pytest.approx(WIND_TIMES * scale * 3.0, rel=1e-5)


def test_events_are_in_the_recording_and_a_shared_gust_once(contents):
    told = [text for (text,) in contents.timed["/events"]["TextLog:text"].to_pylist()]

    assert sum("wind has changed by 4.0 m/s" in text for text in told) == 1
    assert any(text.startswith("jsbsim:aerosonde / tuned: roll command held") for text in told)
    assert contents.nanoseconds("/events").tolist() == sorted(contents.nanoseconds("/events"))
