"""Chromium without a screen, and what a page says of itself in it."""

import base64
import html
import json
import os
import re
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import numpy as np
import pytest
from pictures import DEMANDED
from PIL import Image

QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--hide-scrollbars",
)  # fmt: skip
VIRTUAL_TIME = "--virtual-time-budget=4000"
"""Ends timers at once, and with them hides what depends on which of two things comes first."""
SECONDS = 90
ANSWER_S = 60.0

WIDE, DESK, TABLET, PHONE, NARROW = 1600, 1280, 600, 390, 320
"""Widths in pixels: 600 of a small tablet, 390 of a phone, 320 the narrowest still in use."""

FLAT = 3.0
"""Standard deviation of the pixels of a screen that shows nothing."""

SCREEN = 1000
"""Height of a screen in pixels."""

BROWSER_ITSELF = "not an origin"
"""Who the log of the browser names for requests that no page made."""

POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
# Texts that lie on each other: all that is visible once every part is open, without what a box that
# scrolls cuts off. Of its height a text has the middle half, as lines may touch; one with a ground
# of its own covers its whole box.
OVERLAPS = """
  const seen = e => e.checkVisibility({visibilityProperty: true, opacityProperty: true});
  const boxes = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let text; text = walk.nextNode();) {
    const parent = text.parentElement, look = getComputedStyle(parent);
    if (!text.data.trim() || parent.closest("script, style, title") || !seen(parent)) continue;
    const range = document.createRange();
    range.selectNodeContents(text);
    const pill = look.display.startsWith("inline") && look.backgroundColor !== "rgba(0, 0, 0, 0)";
    for (const r of pill ? parent.getClientRects() : range.getClientRects()) {
      const inset = pill ? 0 : r.height / 4;
      const box = {text, x: r.left, X: r.right, y: r.top + inset, Y: r.bottom - inset};
      for (let e = parent; e !== document.body && !e.ownerSVGElement; e = e.parentElement)
        if (getComputedStyle(e).overflowX !== "visible") {
          const b = e.getBoundingClientRect();
          Object.assign(box, {x: Math.max(box.x, b.left), X: Math.min(box.X, b.right),
            y: Math.max(box.y, b.top), Y: Math.min(box.Y, b.bottom)});
        }
      if (box.X - box.x > 1 && box.Y - box.y > 1) boxes.push(box);
    }
  }
  boxes.sort((a, b) => a.y - b.y);
  const overlaps = [];
  boxes.forEach((a, i) => {
    for (let j = i + 1; j < boxes.length && boxes[j].y < a.Y - 1; j++) {
      const b = boxes[j], wide = Math.min(a.X, b.X) - Math.max(a.x, b.x);
      if (a.text !== b.text && wide > 1) overlaps.push([a.text.data.trim(), b.text.data.trim()]);
    }
  });"""
TELL = """<script>addEventListener("load", () => setTimeout(() => {
  const page = document.documentElement, charts = document.querySelector(".charts");
  const wide = [...document.querySelectorAll("body *")].filter(
    e => !e.closest(".scroll, pre, svg") && e.getBoundingClientRect().right > page.clientWidth + 1
  ).map(e => e.tagName + "." + e.className);
  const cut = [...document.querySelectorAll("h1, h2, h3, li, p, .legend span")].filter(
    e => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== "inline");
  const sideways = [...document.querySelectorAll(".scroll")].filter(
    e => e.scrollWidth > e.clientWidth + 1).map(e => e.textContent);
  const columns = charts ? getComputedStyle(charts).gridTemplateColumns.split(" ").length : 0;
  const closed = [...document.querySelectorAll("details:not([open])")];
  closed.forEach(e => e.open = true);OVERLAPS
  parent.postMessage({width: page.clientWidth, needs: page.scrollWidth, wide, sideways, columns,
    overlaps, cut: cut.map(e => e.textContent),
    images: [...document.images].map(i => i.naturalWidth)}, "*");
}, 100));</script>""".replace("OVERLAPS", OVERLAPS)
FRAMES = """<!doctype html><meta charset="utf-8"><title>[]</title><body>{frames}<script>
var told = [];
addEventListener("message", event => {{ told.push(event.data);
  document.title = JSON.stringify(told); }});</script>"""


def chromium_program() -> str:
    """Path of chromium; the test is skipped where there is none."""
    program = shutil.which("chromium")
    if program is None:
        reason = "chromium is not installed (apt-get install -y --no-install-recommends chromium)"
        if DEMANDED:
            pytest.fail(reason)
        pytest.skip(reason)
    return program


class Tab:
    """A tab of a chromium that keeps running: called, it takes a picture (PNG).

    A picture is empty while the page is busy; TimeoutError if there is no answer at all.
    """

    def __init__(self, asked: Callable[..., dict]) -> None:
        self.asked = asked  # calls a method of the browser's protocol in this tab

    def __call__(self) -> bytes:
        return base64.b64decode(self.asked("Page.captureScreenshot", format="png").get("data", ""))

    def run(self, script: str) -> object:
        """Value of an expression of JavaScript in the page, once its promise is kept."""
        told = self.asked(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def until(self, script: str, seconds: float = SECONDS) -> None:
        """Wait until an expression holds in the page; an AssertionError if it does not."""
        end = time.monotonic() + seconds
        while not self.run(script):
            assert time.monotonic() < end, f"not within {seconds} s: {script}"
            time.sleep(0.02)


@contextmanager
def chromium_at_real_speed(
    size: tuple[int, int],
) -> Iterator[Callable[[str], AbstractContextManager[Tab]]]:
    """A chromium that keeps running: opens an address in a new tab."""
    ours_in, theirs_out = os.pipe()
    theirs_in, ours_out = os.pipe()
    pipes = f'exec "$@" 3<&{theirs_in} 4>&{theirs_out}'  # it reads from 3 and writes to 4
    flags = [f"--window-size={size[0]},{size[1]}", "--remote-debugging-pipe"]
    flags += ["--enable-unsafe-swiftshader"]  # WebGL without a graphics card
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
        subprocess.Popen(
            ["bash", "-c", pipes, "chromium", chromium_program(), *QUIET, *flags,
             f"--user-data-dir={profile}"],
            pass_fds=(theirs_in, theirs_out), stderr=subprocess.DEVNULL,
        ) as browser,
        open(ours_in, "rb") as answers,
        open(ours_out, "wb", buffering=0) as questions,
    ):  # fmt: skip
        os.close(theirs_in)
        os.close(theirs_out)
        received, sent = b"", 0

        def call(method, session=None, **params):
            nonlocal received, sent
            sent += 1
            about = {"id": sent, "method": method, "params": params}
            about |= {"sessionId": session} if session else {}
            questions.write(json.dumps(about).encode() + b"\0")
            end = time.monotonic() + ANSWER_S
            while True:
                while b"\0" not in received:
                    # a page that draws nothing is never photographed, and nobody says so
                    if not select.select([answers], [], [], max(end - time.monotonic(), 0.0))[0]:
                        raise TimeoutError(f"chromium must answer {method}")
                    part = os.read(answers.fileno(), 1 << 20)
                    assert part, "chromium has ended"
                    received += part
                message, _, received = received.partition(b"\0")
                told = json.loads(message)
                if told.get("id") == sent:
                    return told.get("result", {})

        @contextmanager
        def tab(url):
            target = call("Target.createTarget", url="about:blank")["targetId"]
            session = call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            call("Page.navigate", session, url=url)

            def asked(method, **params):
                return call(method, session, **params)

            try:
                yield Tab(asked)
            finally:
                call("Target.closeTarget", targetId=target)

        try:
            yield tab
        finally:
            browser.kill()


def headless_chromium() -> Callable[..., str]:
    """Starts chromium once with some flags and an empty profile, and returns what it printed.

    The test is skipped where there is none.
    """
    program = chromium_program()

    def run(*flags):
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
            done = subprocess.run(
                [program, *QUIET, VIRTUAL_TIME, f"--user-data-dir={profile}", *map(str, flags)],
                capture_output=True,
                text=True,
                timeout=SECONDS,
                check=True,
            )
        return done.stdout

    return run


WIDTHS = WIDE, DESK, TABLET, PHONE, NARROW


def _write_frames(page: str, folder: Path) -> Path:
    """A page of the page at all widths; its title becomes what they say of themselves."""
    (folder / "page.html").write_text(POLICY.sub("", page) + TELL, encoding="utf-8")
    frames = "".join(
        f'<iframe src="page.html" width={width} height={SCREEN} style="border:0"></iframe>'
        for width in WIDTHS
    )
    (folder / "frames.html").write_text(FRAMES.format(frames=frames), encoding="utf-8")
    return folder / "frames.html"


def told_in_a_tab(
    open_tab: Callable[[str], AbstractContextManager[Tab]], page: str, folder: Path
) -> dict[int, dict]:
    """What the page says of itself, by the width it is shown at, in a chromium that runs on."""
    with open_tab(_write_frames(page, folder).as_uri()) as tab:
        tab.until(f"window.told?.length === {len(WIDTHS)}")
        return {one["width"]: one for one in tab.run("told")}


def told_at_widths(chromium: Callable[..., str], page: str, folder: Path) -> dict[int, dict]:
    """What the page says of itself, by the width it is shown at."""
    frames = _write_frames(page, folder)
    shown = chromium("--window-size=4400,1000", "--dump-dom", frames)
    title = re.search(r"<title>(.*?)</title>", shown, re.DOTALL).group(1)
    return {one["width"]: one for one in json.loads(html.unescape(title))}


def asked_by_the_page(chromium: Callable[..., str], page: Path, log: Path) -> set[str]:
    """Addresses that a page asks for outside its file; the browser itself has no origin."""
    chromium(f"--log-net-log={log}", "--dump-dom", page)
    told = json.loads(log.read_text(encoding="utf-8"))
    kind = told["constants"]["logSourceType"]["URL_REQUEST"]
    asked = [
        event["params"]
        for event in told["events"]
        if event["source"]["type"] == kind and "initiator" in event.get("params", {})
    ]
    urls = {params["url"] for params in asked if params["initiator"] != BROWSER_ITSELF}
    return {url for url in urls if not url.startswith(("file:", "data:"))}


def screenshot(
    chromium: Callable[..., str], page: Path, path: Path, *, width: int, height: int
) -> np.ndarray:
    """Grey levels of the page as it is shown, shape (height, width)."""
    chromium(f"--window-size={width},{height}", f"--screenshot={path}", page)
    return np.asarray(Image.open(path).convert("L"), dtype=float)
