"""The page where the gains move, as a browser shows it: ``python docs/figures/open.py``.

The gains of a level turn are moved from the paper's, and twenty aircraft that differ fly them.
"""

import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

import flighttune as ft

DOCS = Path(__file__).parents[1]
sys.path += [str(DOCS), str(DOCS.parent / "tests")]

SIZE, COLOURS = (1280, 840), 256
GAINS = {"K_P[0][0]": 2.2, "K_I[0][0]": 1.2, "K_P[1][1]": 2.6, "K_I[1][1]": 2.0}
ENOUGH_S = 120.0


def main() -> None:
    """Write the picture beside the page of the docs."""
    from browser import chromium_at_real_speed  # of the tests

    with (
        tempfile.TemporaryDirectory() as folder,
        ft.open("level_turn", out=folder, browser=False) as page,
        chromium_at_real_speed(SIZE) as opened,
        opened(page.url) as tab,
    ):
        tab.until("document.body?.dataset.drawn", ENOUGH_S)
        for key, value in GAINS.items():
            moved = f"document.getElementById('gains[0].{key}')"
            event = "new Event('input', {bubbles: true})"
            tab.run(f"{moved}.value = {value}, {moved}.dispatchEvent({event})")
        tab.run("document.querySelector('[data-doing=aircraft]').click()")
        tab.until("/20 aircraft/.test(document.querySelector('#verdict').textContent)", ENOUGH_S)
        picture = Image.open(io.BytesIO(tab())).convert("RGB")
    picture.quantize(COLOURS).save(DOCS / "open.png", optimize=True)


if __name__ == "__main__":
    main()
