"""Write the number of flights into docs/which_bound.md: python docs/figures/which_bound.py."""

import re
from pathlib import Path

from flighttune.campaigns.statistics.count import flights_needed

PAGE = Path(__file__).parents[1] / "which_bound.md"
EPSILON, CONFIDENCE = 1e-4, 0.95


def page(text: str) -> str:
    """The page with the number of flights of which none may be outside."""
    flights = f"{flights_needed(EPSILON, CONFIDENCE):,}".replace(",", " ")
    return re.sub(r"1e-4 from [\d ]+ flights", f"1e-4 from {flights} flights", text)


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
