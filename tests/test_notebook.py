"""What a notebook shows of runs, tunings, certificates and comparisons; and the tour, run whole."""

import os
import re
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import nbclient
import nbformat
import numpy as np
import pytest
from jupyter_client.manager import start_new_kernel
from pictures import FLAT, opened_recording, pixels

import flighttune as ft

LEAST_RECORDING = 100_000
"""Bytes; what comes first is shorter."""

TOUR = Path(__file__).parents[1] / "docs" / "tour.ipynb"
LONGEST = 60.0
"""Seconds the tour may take."""


@pytest.fixture(scope="module")
def flown():
    return ft.fly(ft.load_scenario("paper_as_printed"))


@pytest.fixture(scope="module")
def shown(flown):
    """A value of each kind."""
    scenario, (run,) = flown.scenario, flown.runs
    tuning = ft.tune(scenario)
    return {
        "Run": run,
        "TuningResult": tuning,
        "Certificate": ft.certify(scenario, run.provenance.gains).certificate,
    }


def test_what_is_shown_are_the_values(shown):
    R_K = shown["TuningResult"].R_K
    assert f">{R_K:.5g}<" in shown["TuningResult"]._repr_html_()
    assert f">{shown['Certificate'].claim.rate:.6g}<" in shown["Certificate"]._repr_html_()
    assert "20 s, 4001 samples" in shown["Run"]._repr_html_()


def kinds_of_outputs(tour):
    """What each cell shows: tables, pictures, text."""
    code = [cell for cell in tour.cells if cell.cell_type == "code"]
    return [[sorted(out.data) for out in cell.outputs if "data" in out] for cell in code]


def test_a_flight_is_drawn_with_a_line_a_run(flown):
    sheet = ft.plot(flown)

    assert [chart.title for chart in sheet.charts[:2]] == ["Course error", "Path-angle error"]
    label = flown.runs[0].label
    assert all([name for name, _, _ in chart.legend] == [label] for chart in sheet.charts)
    low, high = sheet.charts[0].y_ends()
    error = np.rad2deg(flown.runs[0].signals["chi_err"].to_numpy())
    assert low <= error.min() <= low + 0.1 * (high - low)
    assert ET.fromstring(sheet._repr_svg_()).tag.endswith("svg")
    with pytest.raises(ft.FlightTuneError, match="got none"):
        ft.plot([])


def test_a_recording_is_shown_in_a_cell_where_the_viewer_is_installed(flown, monkeypatch):
    monkeypatch.setattr("flighttune.extras.find_spec", lambda name: None)
    with pytest.raises(ft.FlightTuneError, match=r"flighttune\[notebook\]"):
        ft.show(flown)


@pytest.mark.slow
def test_a_recording_that_was_shown_keeps_no_thread(flown, monkeypatch):
    pytest.importorskip("rerun_notebook", reason="needs flighttune[notebook]")
    shown, threads = [], []
    monkeypatch.setattr("IPython.display.display", shown.append)
    for _ in range(3):
        ft.show(flown)
        threads.append(len(os.listdir("/proc/self/task")))

    assert len(shown) >= 3
    assert threads[-1] == threads[0]


SHOWN = """
import os
os.environ["RERUN_NOTEBOOK_ASSET"] = "serve-local"
import flighttune as ft
ft.show(ft.fly(ft.load_scenario("paper_as_printed")))
"""


@pytest.fixture
def kernel():
    """A client of a real kernel, in which Rerun's widget can be shown."""
    pytest.importorskip("rerun_notebook", reason="needs flighttune[notebook]")
    manager, client = start_new_kernel(kernel_name="python3")
    yield client
    client.stop_channels()
    manager.shutdown_kernel(now=True)


@pytest.mark.soak
def test_the_widget_of_a_kernel_gets_a_recording_that_the_viewer_draws(kernel, tmp_path):
    heard = []
    reply = kernel.execute_interactive(SHOWN, output_hook=heard.append, timeout=LONGEST)
    assert reply["content"]["status"] == "ok"
    view = "application/vnd.jupyter.widget-view+json"
    assert any(view in message["content"].get("data", {}) for message in heard)
    (widget,) = (
        message["content"]["comm_id"]
        for message in heard
        if message["msg_type"] == "comm_open"
        and message["content"]["data"]["state"].get("_anywidget_id") == "rerun_notebook.Viewer"
    )

    # all that the page of a notebook says before it is sent the recording
    ready = {"comm_id": widget, "data": {"method": "custom", "content": "ready"}}
    kernel.shell_channel.send(kernel.session.msg("comm_msg", ready))
    sent = b""
    while len(sent) < LEAST_RECORDING:
        message = kernel.get_iopub_msg(timeout=LONGEST)
        sent = max([sent, *map(bytes, message["buffers"])], key=len)

    path = tmp_path / "shown.rrd"
    path.write_bytes(sent)
    with opened_recording(path) as viewer:
        viewer.show("Overview", at=4.0)
        for name, part in viewer.views("Overview").items():
            assert pixels(viewer.picture(part)).std() > FLAT, f"{name} is empty"
        assert viewer.complaints() == []


@pytest.mark.soak
def test_the_tour_runs_from_tune_to_gap_in_under_a_minute(tmp_path):
    tour = nbformat.read(TOUR, as_version=4)
    kept = kinds_of_outputs(tour)
    started = time.perf_counter()
    nbclient.NotebookClient(
        tour, timeout=LONGEST, resources={"metadata": {"path": tmp_path}}
    ).execute()
    assert time.perf_counter() - started < LONGEST

    code = [cell for cell in tour.cells if cell.cell_type == "code"]
    errors = [out for cell in code for out in cell.outputs if out.output_type == "error"]
    assert errors == []
    assert kinds_of_outputs(tour) == kept, "keep the tour with its outputs: see the top of it"
    assert re.search(r"report\.html", tour.cells[-1].source + tour.cells[-2].source)
