"""Chromium without a screen, and what a page says of itself in it."""

import html
import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
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
DESK, TABLET, PHONE, NARROW = 1280, 600, 390, 320
"""Widths in pixels: 600 of a small tablet, 390 of a phone, 320 the narrowest still in use."""

FLAT = 3.0
"""Standard deviation of the pixels of a screen that shows nothing."""

SCREEN = 1000
"""Height of a screen in pixels."""

BROWSER_ITSELF = "not an origin"
"""Who the log of the browser names for requests that no page made."""

POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
TELL = """<script>addEventListener("load", () => setTimeout(() => {
  const page = document.documentElement;
  const wide = [...document.querySelectorAll("body *")].filter(
    e => !e.closest(".scroll, pre, svg") && e.getBoundingClientRect().right > page.clientWidth + 1
  ).map(e => e.tagName + "." + e.className);
  const cut = [...document.querySelectorAll("h1, h2, h3, li, p, .legend span")].filter(
    e => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== "inline");
  const sideways = [...document.querySelectorAll(".scroll")].filter(
    e => e.scrollWidth > e.clientWidth + 1).map(e => e.textContent);
  parent.postMessage({width: page.clientWidth, needs: page.scrollWidth, wide, sideways,
    columns: getComputedStyle(
      document.querySelector(".charts")).gridTemplateColumns.split(" ").length,
    cut: cut.map(e => e.textContent), images: [...document.images].map(i => i.naturalWidth)}, "*");
}, 100));</script>"""
FRAMES = """<!doctype html><meta charset="utf-8"><title>[]</title><body>{frames}<script>
const told = [];
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


def told_at_widths(chromium: Callable[..., str], page: str, folder: Path) -> dict[int, dict]:
    """What the page says of itself, by the width it is shown at."""
    (folder / "page.html").write_text(POLICY.sub("", page) + TELL, encoding="utf-8")
    frames = "".join(
        f'<iframe src="page.html" width={width} height={SCREEN} style="border:0"></iframe>'
        for width in (DESK, TABLET, PHONE, NARROW)
    )
    (folder / "frames.html").write_text(FRAMES.format(frames=frames), encoding="utf-8")
    shown = chromium("--window-size=2800,1000", "--dump-dom", folder / "frames.html")
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
