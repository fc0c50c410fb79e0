"""Options that all benchmarks have, and how they end: 0 met, 1 missed, `CRASHED`."""

import argparse
import json
import sys
import traceback
from collections.abc import Callable, Mapping

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


def judged(found: Mapping[str, float], limits: Mapping[str, float], *, as_json: bool) -> int:
    """Print figures, and those above their limit; 1 if there are any, else 0."""
    if as_json:
        print(json.dumps(found))
    else:
        for name, value in found.items():
            print(f"{name:22s} {value:10.3f}")
    over = [name for name, limit in limits.items() if found[name] > limit]
    for name in over:
        print(f"{name} must be at most {limits[name]:g}, got {found[name]:.3f}", file=sys.stderr)
    return int(bool(over))


def end(main: Callable[[], int]) -> None:
    """Run a benchmark and exit; a crash is no missed target."""
    try:
        status = main()
    except Exception:
        traceback.print_exc()
        status = CRASHED
    sys.exit(0 if QUICK and status == 1 else status)
