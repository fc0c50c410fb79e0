"""Options that all benchmarks have, and how they end: 0 met, 1 missed, `CRASHED`."""

import argparse
import sys
import traceback
from collections.abc import Callable

CRASHED = 3

# One tiny repetition of everything: whether it runs, not how fast.
QUICK = "--quick" in sys.argv


def options(text: str | None) -> argparse.ArgumentParser:
    """A parser with the options of all benchmarks, about the docstring of one of them."""
    parser = argparse.ArgumentParser(description=(text or "").partition("\n")[0])
    parser.add_argument("--json", action="store_true", help="print one object")
    parser.add_argument(
        "--quick", action="store_true", help="run everything once, tiny; no figure is judged"
    )
    return parser


def end(main: Callable[[], int]) -> None:
    """Run a benchmark and exit; a crash is no missed target."""
    try:
        status = main()
    except Exception:
        traceback.print_exc()
        status = CRASHED
    sys.exit(0 if QUICK and status == 1 else status)
