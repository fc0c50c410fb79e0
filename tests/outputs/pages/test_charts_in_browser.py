"""Charts of a page under a real pointer and real keys: values, zoom, and hidden lines."""

from contextlib import contextmanager

import numpy as np
import pytest
from browser import DESK, SCREEN, chromium_at_real_speed

pytestmark = [pytest.mark.slow, pytest.mark.soak]

# Values are read from lines of 0.1 by 0.01 pixels, of 392 by 192.
DEGREES, METRES, SECONDS = 0.3, 3.0, 0.1

CHARTS = "[...document.querySelectorAll('svg.chart[data-axes]')]"
TIP = "document.getElementById('tip')"
ZOOMED = f"{CHARTS}.filter(x => x.querySelector('svg.plot[viewBox]'))"


@pytest.fixture(scope="module")
def browser():
    with chromium_at_real_speed((DESK, SCREEN)) as opened:
        yield opened


@pytest.fixture
def tab(browser, written):
    with browser(written.path.as_uri()) as opened:
        opened.until("document.readyState === 'complete'")
        yield opened


def box(tab, title):
    """Left, top, width and height of the plot under a title, which is scrolled to."""
    return tab.run(
        f"(() => {{ const c = {CHARTS}.find(x => x.ariaLabel.startsWith(`{title}`));"
        "c.scrollIntoView({block: 'center'}); const [, , , , w, h] = c.dataset.axes.split(' ');"
        "const b = c.getBoundingClientRect(), k = b.width / c.viewBox.baseVal.width;"
        "const p = c.querySelector('svg.plot');"
        "return [b.x + k * p.getAttribute('x'), b.y + k * p.getAttribute('y'), k * w, k * h] })()"
    )


@contextmanager
def pressed(tab, x, y):
    """Hold the button of the mouse at a place; what is yielded moves it."""
    mouse = {"button": "left", "buttons": 1, "clickCount": 1}

    def move(x, y):
        nonlocal place
        place = {"x": x, "y": y}
        tab.asked("Input.dispatchMouseEvent", type="mouseMoved", **place, **mouse)

    place = {"x": x, "y": y}
    tab.asked("Input.dispatchMouseEvent", type="mousePressed", **place, **mouse)
    yield move
    tab.asked("Input.dispatchMouseEvent", type="mouseReleased", **place, **mouse)


def drag(tab, title, start, end):
    """Drag over a plot between two places, as shares of its width and height."""
    left, top, width, height = box(tab, title)
    places = [(left + width * x, top + height * y) for x, y in (start, end)]
    with pressed(tab, *places[0]) as move:
        for share in (0.5, 1.0):
            move(*(a + share * (b - a) for a, b in zip(*places, strict=True)))


def point(tab, title, x, y):
    left, top, width, height = box(tab, title)
    place = {"x": left + width * x, "y": top + height * y}
    tab.asked("Input.dispatchMouseEvent", type="mouseMoved", **place)


def key(tab, name, code=0, **more):
    text = {"text": name} if len(name) == 1 else {}
    about = {"key": name, "windowsVirtualKeyCode": code, **more}
    tab.asked("Input.dispatchKeyEvent", type="keyDown", **about, **text)
    tab.asked("Input.dispatchKeyEvent", type="keyUp", **about)


def focus(tab, title):
    tab.run(f"{CHARTS}.find(x => x.ariaLabel.startsWith(`{title}`)).focus({{focusVisible: true}})")


def told(tab):
    """Values of the tip by name; empty if it is hidden."""
    lines = tab.run(f"{TIP}.hidden ? '' : {TIP}.innerText").splitlines()
    return {name: float(value) for name, _, value in (x.rpartition(" ") for x in lines if x)}


def view(tab, title):
    """Part of the plot in view, as shares of the whole: left, top, width, height."""
    return tab.run(
        f"(() => {{ const c = {CHARTS}.find(x => x.ariaLabel.startsWith(`{title}`));"
        "const [, , , , w, h] = c.dataset.axes.split(' ').map(Number);"
        "const v = (c.querySelector('svg.plot').getAttribute('viewBox') ?? `0 0 ${w} ${h}`)"
        ".split(' ').map(Number); return [v[0] / w, v[1] / h, v[2] / w, v[3] / h] })()"
    )


def course(run, t):
    return np.degrees(np.interp(t, run.t, run.signals["chi"]))


def test_a_drag_across_zooms_every_chart_over_time_and_a_double_click_shows_all(tab, flown_paper):
    drag(tab, "Course", (0.25, 0.5), (0.5, 0.5))

    left, _, width, height = view(tab, "Course;")
    assert (left, width) == pytest.approx((0.25, 0.25), abs=0.01)
    assert height < 1.0
    linked = tab.run(f"{CHARTS}.filter(x => 'linked' in x.dataset).length")
    assert tab.run(f"{ZOOMED}.length") == linked > 5
    labels = tab.run(f"[...{CHARTS}[0].querySelectorAll(':scope > text.tick[text-anchor=middle]')]"
                     ".map(x => Number(x.textContent))")  # fmt: skip
    assert len(labels) >= 3
    assert all(5.0 - SECONDS <= t <= 10.0 + SECONDS for t in labels)
    point(tab, "Course", 0.5, 0.5)
    values = told(tab)
    t = values["t [s]"]
    assert t == pytest.approx(7.5, abs=SECONDS)
    for run in flown_paper.runs:
        assert values[run.label] == pytest.approx(course(run, t), abs=DEGREES), run.label

    x, y, width, height = box(tab, "Path angle")
    for count in (1, 2):
        place = {"x": x + width / 2, "y": y + height / 2, "button": "left", "clickCount": count}
        for kind in ("mousePressed", "mouseReleased"):
            tab.asked("Input.dispatchMouseEvent", type=kind, **place)
    assert tab.run(f"{ZOOMED}.length") == 0


def test_a_box_that_is_dragged_zooms_its_chart_to_the_box(tab):
    drag(tab, "Course;", (0.2, 0.2), (0.6, 0.7))

    assert view(tab, "Course;") == pytest.approx([0.2, 0.2, 0.4, 0.5], abs=0.02)
    assert view(tab, "Path angle")[::2] == pytest.approx([0.2, 0.4], abs=0.02)


def test_the_keys_move_a_cursor_and_zoom(tab, flown_paper):
    focus(tab, "Course;")
    first = told(tab)
    key(tab, "ArrowRight", 39)
    after = told(tab)
    assert first["t [s]"] == pytest.approx(10.0, abs=SECONDS)
    assert after["t [s]"] == pytest.approx(10.4, abs=SECONDS)
    run = flown_paper.runs[-1]
    assert after[run.label] == pytest.approx(course(run, after["t [s]"]), abs=DEGREES)

    key(tab, "+")
    assert view(tab, "Course;")[2] == pytest.approx(0.5, abs=0.01)
    assert told(tab)["t [s]"] == pytest.approx(10.4, abs=SECONDS)
    key(tab, "0")
    assert tab.run(f"{ZOOMED}.length") == 0
    key(tab, "Escape", 27)
    assert told(tab) == {}


def test_the_pointer_on_a_map_shows_the_nearest_place_of_a_path(tab, flown_paper):
    run = flown_paper.runs[0]
    middle = len(run.t) // 2
    north, east = (float(run.signals[name].iloc[middle]) for name in ("north", "east"))
    x0, x1, y0, y1 = tab.run(
        f"{CHARTS}.find(x => x.ariaLabel.startsWith('From above'))"
        ".dataset.axes.split(' ').slice(0, 4).map(Number)"
    )
    tab.run("document.querySelectorAll('details').forEach(x => { x.open = true })")

    point(tab, "From above", (north - x0) / (x1 - x0), 1.0 - (east - y0) / (y1 - y0))

    text = tab.run(f"{TIP}.innerText")
    assert text.startswith("kinematic / ")
    values = {line.rpartition(" ")[0]: line.rpartition(" ")[2] for line in text.splitlines()[1:]}
    assert float(values["north [m]"]) == pytest.approx(north, abs=METRES)
    assert float(values["east [m]"]) == pytest.approx(east, abs=METRES)


def test_the_legend_of_a_chart_hides_its_line_in_this_chart_alone(tab):
    parts = "[...document.querySelectorAll('svg.plot [data-part=sum]')]"
    tab.run("document.querySelectorAll('details').forEach(x => { x.open = true })")
    button = "document.querySelector('button[data-part=sum]')"

    tab.run(f"{button}.click()")

    hidden = tab.run(f"{parts}.map(x => getComputedStyle(x).display === 'none')")
    assert hidden.count(True) == 1
    assert len(hidden) > 1
    assert tab.run(f"{button}.getAttribute('aria-pressed')") == "false"
    tab.run(f"{button}.click()")
    assert not any(tab.run(f"{parts}.map(x => getComputedStyle(x).display === 'none')"))


def test_a_name_in_a_legend_without_a_line_of_its_own_is_no_button(tab):
    named = "[...document.querySelectorAll('button[data-part]')]"
    without = tab.run(
        f"{named}.filter(x => ![...x.closest('figure').querySelectorAll('svg.plot [data-part]')]"
        ".some(y => y.dataset.part === x.dataset.part)).map(x => x.disabled)"
    )
    assert all(without)
    assert tab.run(f"{named}.some(x => !x.disabled)")
