"""What a notebook shows of values; and the notebooks of the docs, run whole."""

import os
import re
import time
import xml.etree.ElementTree as ET

import nbclient
import nbformat
import numpy as np
import pytest
from figures.notebooks import NOTEBOOKS
from jupyter_client.manager import start_new_kernel
from made_up_band import WIDE, counted_boxes
from made_up_tubes import aircraft_scenario
from pictures import FLAT, opened_recording, pixels

import flighttune as ft

LEAST_RECORDING = 100_000
"""Bytes; what comes first is shorter."""

# What they show is what other tests count: agents, requirements, missions and logs.
OF_OTHER_TESTS = "agent", "requirement", "mission", "log"

# Characters of an output.
LONGEST_TEXT = 3000

# Of a cell; until the last thread of a recording has ended: s
LONGEST, ENDED_S = 120.0, 20.0


@pytest.fixture(scope="module")
def flown():
    return ft.fly(ft.load_scenario("paper_as_printed"))


def kinds_of_outputs(notebook):
    """What each cell shows: tables, pictures, text."""
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    return [[sorted(out.data) for out in cell.outputs if "data" in out] for cell in code]


NUMBER = re.compile(r"[-+]?\d[\d.e-]*")

# Times and the last digits of searches differ from machine to machine.
LEAST_EQUAL = 0.9


def texts_of_outputs(notebook):
    """What each cell says, in one line without the rules of tables."""
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    said = (out.get("text") or out.data.get("text/plain", "") for x in code for out in x.outputs)
    return [" ".join(re.sub("[─ ]+", " ", text).split()) for text in said]


def is_stale(kept, now):
    """Whether the words of an output have changed, or more than a few of its numbers."""
    if NUMBER.sub("#", kept) != NUMBER.sub("#", now):
        return True
    pairs = [*zip(NUMBER.findall(kept), NUMBER.findall(now), strict=True)]
    return sum(a == b for a, b in pairs) < LEAST_EQUAL * len(pairs)


def test_an_output_is_stale_if_its_words_or_most_numbers_have_changed():
    kept = "3 of 4 requirements met: 1.25 s, 2.5 deg, 7 %, 8 %, 9 %, 1 %, 2 %, 3 %"

    assert not is_stale(kept, kept)
    assert not is_stale(kept, kept.replace("1.25", "1.27"))
    assert is_stale(kept, kept.replace("met", "missed"))
    assert is_stale(kept, kept.replace("1.25", "1.27").replace("2.5", "3.5"))


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_shows_its_answers_without_the_folders_of_a_machine(file):
    notebook = nbformat.read(file, as_version=4)

    assert all(texts_of_outputs(notebook))
    assert not [x for x in texts_of_outputs(notebook) if re.search(r"/(tmp|home|root|work)/", x)]
    assert all(len(x) <= LONGEST_TEXT for x in texts_of_outputs(notebook))


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


def test_a_claim_is_drawn_and_a_console_shows_its_sentence():
    band = counted_boxes(aircraft_scenario(duration_s=0.2))
    charts = ft.plot(band).charts

    assert len(charts) == len(band.about.signals)
    low, high = charts[0].y_ends()
    assert low < -np.rad2deg(WIDE) < np.rad2deg(WIDE) < high
    assert band.sentence[1:] in " ".join(repr(band).split())  # printed with a capital


def test_a_recording_is_shown_in_a_cell_where_the_viewer_is_installed(flown, monkeypatch):
    monkeypatch.setattr("flighttune.base.errors.find_spec", lambda name: None)
    with pytest.raises(ft.FlightTuneError, match=r"flighttune\[notebook\]"):
        ft.show(flown)


@pytest.mark.soak
def test_a_recording_that_was_shown_keeps_no_thread(flown, monkeypatch):
    pytest.importorskip("rerun_notebook", reason="needs flighttune[notebook]")

    def threads():
        return len(os.listdir("/proc/self/task"))

    shown = []
    monkeypatch.setattr("IPython.display.display", shown.append)
    ft.show(flown)
    after_one, end = threads(), time.monotonic() + ENDED_S
    for _ in range(2):
        ft.show(flown)
    while threads() > after_one and time.monotonic() < end:
        time.sleep(0.05)

    assert len(shown) >= 3
    assert threads() <= after_one


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


@pytest.mark.counts
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
@pytest.mark.parametrize(
    "files",
    [
        [file for file in NOTEBOOKS if file.stem not in OF_OTHER_TESTS],
        pytest.param([file for file in NOTEBOOKS if file.stem in OF_OTHER_TESTS],
                     marks=pytest.mark.counts),
    ],
    ids=["short", "long"],
)  # fmt: skip
def test_a_notebook_runs_and_shows_what_is_kept_in_it(files, tmp_path):
    """One after the other in a single kernel, each with its names alone."""
    notebooks = [nbformat.read(file, as_version=4) for file in files]
    kept = [(kinds_of_outputs(x), texts_of_outputs(x)) for x in notebooks]
    joined = nbformat.v4.new_notebook()
    for notebook in notebooks:
        joined.cells += [nbformat.v4.new_code_cell("%reset -f"), *notebook.cells]
    place = {"metadata": {"path": tmp_path}}

    nbclient.NotebookClient(joined, timeout=LONGEST, resources=place).execute()

    code = [cell for cell in joined.cells if cell.cell_type == "code"]
    assert not [out for cell in code for out in cell.outputs if out.output_type == "error"]
    for file, notebook, (kinds, texts) in zip(files, notebooks, kept, strict=True):
        again = f"python docs/figures/notebooks.py {file.stem}"
        assert kinds_of_outputs(notebook) == kinds, again
        for before, now in zip(texts, texts_of_outputs(notebook), strict=True):
            assert not is_stale(before, now), f"{again}: {before} is now {now}"


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_uses_public_names_alone(file):
    code = "\n".join(
        cell.source for cell in nbformat.read(file, as_version=4).cells if cell.cell_type == "code"
    )

    assert not re.search(r"(from|import) flighttune\.", code)
    assert set(re.findall(r"\bft\.(\w+)", code)) <= set(ft.__all__)
