"""The pictures of docs/logs.md: what is identified from a log of our own, and the gap to a model.

``python docs/figures/log.py`` flies a Cessna of 1.2 times its mass in wind, writes its flight as a
table at 25 Hz with noise, and draws log_fit.svg and log_gap.svg, in two minutes.
"""

import sys
import tempfile
from pathlib import Path

import flighttune as ft
from flighttune.logs.identify import LogIdentification

DOCS = Path(__file__).parents[1]
sys.path.append(str(DOCS.parent / "tests"))


def main() -> None:
    """Write the log, identify it, and draw."""
    from log_files import heavy_cessna, sampled, write_csv  # of the tests

    with tempfile.TemporaryDirectory() as folder:
        log = write_csv(Path(folder) / "flight.csv", *sampled(heavy_cessna(180.0)))
        found = ft.identify(log)
        assert isinstance(found, LogIdentification)
        gap = ft.gap(log, aircraft="c172p")
    print(found, gap, sep="\n\n")
    found.sheet().save(DOCS / "log_fit.svg")
    gap.sheet().save(DOCS / "log_gap.svg")


if __name__ == "__main__":
    main()
