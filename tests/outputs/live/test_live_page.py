"""The page in a real browser: sliders that are dragged, windows side by side, searches stopped."""

import time
from contextlib import contextmanager
from functools import partial

import psutil
import pytest
from browser import DESK, NARROW, OVERLAPS, PHONE, SCREEN, WIDE, chromium_at_real_speed
from plans import plan_file, waypoint

import flighttune as ft
from flighttune.claims import mission

pytestmark = [pytest.mark.slow, pytest.mark.soak]

# A second after which a picture that was asked for is late, on a machine that does much else.
PATIENCE_S = 60.0

DRAWN = "Number(document.body.dataset.drawn ?? 0)"
PICTURE = "document.querySelector('#charts').innerHTML"
VERDICT = "document.querySelector('#verdict').textContent"
K_P = "gains[0].K_P[0][0]"


@pytest.fixture(scope="module")
def browser():
    with chromium_at_real_speed((DESK, SCREEN)) as opened:
        yield opened


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    with ft.open("level_turn", out=folder, browser=False, budget=5000) as opened:
        yield opened


@contextmanager
def window(browser, page):
    with browser(page.url) as tab:
        tab.until(f"document.body && {DRAWN} > 0", PATIENCE_S)
        yield tab


def drag(tab, key, part, moves=8):
    """Drag the slider of a key to a part of its length by the mouse."""
    place = f"document.querySelector(`input[type=range][name='{key}']`).getBoundingClientRect()"
    x, y, wide, high, now = tab.run(
        f"(() => {{ const b = {place}, s = document.querySelector(`[name='{key}']`);"
        "return [b.x, b.y, b.width, b.height, (s.value - s.min) / (s.max - s.min)] })()"
    )
    radius, y = 8.0, y + high / 2.0

    def at(along):
        return {"x": x + radius + along * (wide - 2.0 * radius), "y": y, "button": "left"}

    for kind, along in [
        ("mousePressed", now),
        *(("mouseMoved", now + (part - now) * i / moves) for i in range(1, moves + 1)),
        ("mouseReleased", part),
    ]:
        tab.asked("Input.dispatchMouseEvent", type=kind, clickCount=1, buttons=1, **at(along))


def set_value(tab, key, value):
    """Type a number beside a slider, or choose a word."""
    tab.run(
        f"(() => {{ const i = document.getElementById('{key}'); i.value = '{value}';"
        "i.dispatchEvent(new Event('input', {bubbles: true})) })()"
    )


def click(tab, selector):
    tab.run(f"document.querySelector(`{selector}`).click()")


def said(tab):
    return tab.run("document.querySelector('#said').textContent")


def test_a_slider_that_is_dragged_changes_picture_and_numbers(browser, page):
    with window(browser, page) as tab:
        before, drawn = tab.run(PICTURE), tab.run(DRAWN)
        numbers = tab.run("document.querySelector('#numbers').textContent")
        drag(tab, K_P, 0.9)
        tab.until(f"{DRAWN} > {drawn} && {PICTURE}.length", PATIENCE_S)
        value = float(tab.run(f"document.getElementById('{K_P}').value"))
        assert value == pytest.approx(0.9 * 3.0 * ft.PAPER_GAINS.K_P[0, 0], rel=0.05)
        assert tab.run(PICTURE) != before
        assert tab.run("document.querySelector('#numbers').textContent") != numbers


OPACITY = "Number(getComputedStyle(document.querySelector('{}')).opacity)"


def test_a_flight_that_fails_says_why_and_the_page_goes_on(browser, page):
    with window(browser, page) as tab:
        set_value(tab, "plant.airframe.mass_factor", 3.0)
        tab.until(f"/no trim: .*it would stall/.test({VERDICT})", PATIENCE_S)
        set_value(tab, "plant.airframe.mass_factor", 1.0)
        tab.until(f"/requirements? met/.test({VERDICT})", PATIENCE_S)


def test_a_value_that_is_refused_says_why_and_the_page_goes_on(browser, page):
    with window(browser, page) as tab:
        set_value(tab, "flight.V_a_mps", 12.0)
        tab.until("/`V_a_mps` must lie in 15/.test(document.querySelector('#said').textContent)")
        # nothing of the values before is left as an answer
        assert not tab.run(f"/met/.test({VERDICT})")
        assert tab.run("document.querySelector('#verdict .yes, #verdict .no')") is None
        assert tab.run(OPACITY.format("#charts")) < 0.5
        assert tab.run(OPACITY.format(".beside")) < 0.5
        set_value(tab, "flight.V_a_mps", 26.0)
        tab.until("/at 26 m.s/.test(document.querySelector('#about').textContent)", PATIENCE_S)
        assert said(tab) == ""
        assert tab.run(f"/requirements? met/.test({VERDICT})")
        assert tab.run(OPACITY.format("#charts")) == 1.0


def test_tuned_gains_move_the_sliders(browser, page):
    with window(browser, page) as tab:
        drawn = tab.run(DRAWN)
        click(tab, "[data-doing=tune]")
        tab.until("/R_K is/.test(document.querySelector('#said').textContent)", PATIENCE_S)
        tab.until(f"{DRAWN} > {drawn}", PATIENCE_S)
        tuned = ft.tune(ft.load_scenario("level_turn")).gains
        value = float(tab.run(f"document.getElementById('{K_P}').value"))
        assert value == pytest.approx(float(tuned.K_P[0, 0]), rel=1e-4)


def test_a_search_shows_how_far_it_is_and_stops_while_sliders_move(browser, page):
    with window(browser, page) as tab:
        click(tab, "[data-doing=meet]")
        tab.until("!document.querySelector('#search').hidden", PATIENCE_S)
        tab.until("/searching/.test(document.querySelector('#said').textContent)", PATIENCE_S)
        drawn = tab.run(DRAWN)
        set_value(tab, K_P, 1.4)
        tab.until(f"{DRAWN} > {drawn}", PATIENCE_S)
        click(tab, "[data-ask=stop]")
        tab.until("/stopped/.test(document.querySelector('#said').textContent)", PATIENCE_S)
        assert tab.run("document.querySelector('#search').hidden")
        assert float(tab.run(f"document.getElementById('{K_P}').value")) == 1.4


def test_a_snapshot_stays_as_a_ghost_until_it_is_removed(browser, page):
    legend = "document.querySelector('#legend').textContent"
    with window(browser, page) as tab:
        set_value(tab, K_P, 1.2)
        click(tab, "#snapshot")
        tab.until(f"/snapshot 1/.test({legend})", PATIENCE_S)
        click(tab, "[aria-label='remove the ghost snapshot 1']")
        tab.until(f"!/snapshot 1/.test({legend})", PATIENCE_S)
        assert "start" in tab.run(legend)


def test_saving_and_recording_tell_the_command_that_does_the_same(browser, page):
    with window(browser, page) as tab:
        for button, command in (
            ("[data-ask=save]", "flighttune fly"),
            ("[data-recorded=yes]", "flighttune view"),
        ):
            click(tab, button)
            tab.until(f"/{command}/.test(document.querySelector('#said').textContent)", PATIENCE_S)


BOX = [[47.397, 8.496], [47.397, 8.51], [47.407, 8.51], [47.407, 8.496]]


def test_a_mission_has_its_map_and_fence_and_a_corridor_until_a_slider_moves(
    browser, tmp_path, monkeypatch
):
    few = partial(mission.mission, epsilon=0.5, confidence=0.9)
    monkeypatch.setattr(mission, "mission", few)
    route = [waypoint(47.4, 8.5, 60), waypoint(47.402, 8.5, 60), waypoint(47.402, 8.503, 70)]
    fence = {"polygons": [{"inclusion": True, "polygon": BOX}], "circles": []}
    plan = plan_file(tmp_path / "m.plan", *route, geoFence=fence)
    captions = "document.querySelector('#charts').textContent"
    with ft.open(plan, browser=False) as page, window(browser, page) as tab:
        assert {"Map", "planned path", "fence"} <= {
            *tab.run("[...document.querySelectorAll('figcaption :is(b, button)')]"
                     ".map(x => x.textContent.trim())")
        }  # fmt: skip
        click(tab, "[data-doing=corridor]")
        tab.until(f"/corridor/.test({captions})", 5.0 * PATIENCE_S)
        assert "stays inside its fence" in said(tab)
        set_value(tab, "wind.speed_mps", 3.0)
        tab.until(f"!/corridor/.test({captions})", PATIENCE_S)


@pytest.mark.parametrize(
    ("width", "scheme"),
    [
        (DESK, "light"),
        (PHONE, "dark"),
        *(pytest.param(x, "light", marks=pytest.mark.counts) for x in (WIDE, PHONE, NARROW)),
        *(pytest.param(x, "dark", marks=pytest.mark.counts) for x in (WIDE, DESK, NARROW)),
    ],
)
def test_nothing_overlaps_or_leaves_the_page(browser, page, width, scheme):
    with window(browser, page) as tab:
        tab.asked("Emulation.setDeviceMetricsOverride", width=width, height=SCREEN,
                  deviceScaleFactor=1, mobile=False)  # fmt: skip
        scheme_of = [{"name": "prefers-color-scheme", "value": scheme}]
        tab.asked("Emulation.setEmulatedMedia", features=scheme_of)
        assert tab.run(
            "document.documentElement.scrollWidth <= document.documentElement.clientWidth"
        )
        tab.run("for (const one of document.querySelectorAll('.pictures, .sliders, .buttons'))"
                " Object.assign(one.style, {position: 'static', maxHeight: 'none'})")  # fmt: skip
        assert tab.run(f"(() => {{ {OVERLAPS}; return overlaps; }})()") == []


def test_everything_that_moves_has_a_name_for_screen_readers(browser, page):
    with window(browser, page) as tab:
        tab.asked("Accessibility.enable")
        nodes = tab.asked("Accessibility.getFullAXTree")["nodes"]
    moving = (
        "slider",
        "spinbutton",
        "combobox",
        "ComboBoxMenuList",
        "button",
        "checkbox",
        "progressbar",
        "image",
    )
    named = [(x["role"]["value"], x.get("name", {}).get("value", "")) for x in nodes
             if not x["ignored"] and x["role"]["value"] in moving]  # fmt: skip
    assert {"slider", "spinbutton", "button", "checkbox"} <= {role for role, _ in named}
    assert [role for role, name in named if not name.strip()] == []


def test_a_page_asks_nobody_but_its_server(browser, page):
    with window(browser, page) as tab:
        blocked = tab.run(
            "fetch('http://127.0.0.1:9/').then(() => 'sent', (error) => String(error))"
        )
        asked = tab.run("performance.getEntriesByType('resource').map(x => new URL(x.name).host)")
    assert "sent" not in blocked
    assert {*asked} <= {f"127.0.0.1:{page.port}"}


def test_fifty_moves_a_second_are_followed_in_bounded_memory(browser, page):
    process, seconds, room = psutil.Process(), 1.5, 60e6
    with window(browser, page) as tab:
        tab.run(
            f"window.sent = 0; window.moves = document.getElementById('{K_P}'); window.timer ="
            "setInterval(() => { moves.value = 0.5 + (sent++ % 100) / 50;"
            "moves.dispatchEvent(new Event('input', {bubbles: true})) }, 20)"
        )
        time.sleep(seconds)
        before, drawn = process.memory_info().rss, tab.run(DRAWN)
        time.sleep(seconds)
        more, pictures = process.memory_info().rss - before, tab.run(DRAWN) - drawn
        sent = tab.run("clearInterval(timer), sent")
        tab.run(f"window.last = {DRAWN}")
        started = time.monotonic()
        set_value(tab, K_P, 1.0)
        tab.until(f"{DRAWN} > last", PATIENCE_S)

    assert sent > 25.0 * seconds  # a busy machine sends fewer than fifty a second
    assert pictures > seconds  # and they were followed, not queued:
    assert time.monotonic() - started < 10.0
    assert more < room
