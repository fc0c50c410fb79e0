"""How long ``flighttune gap`` takes for the paper's manoeuvre, from start to figure and recording.

Run it with ``python benchmarks/bench_gap.py``; ``--json`` prints one object. Exits with 1 where the
fastest, which other work on the machine disturbed least, is above `LONGEST`.
"""

import argparse
import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time

LONGEST = 5.0
REPEATS = 3


def seconds() -> tuple[float, float]:
    """Return the time of one command, a process of its own, and its time on the processor, s."""
    with tempfile.TemporaryDirectory() as folder:
        began, used = time.perf_counter(), processor_seconds()
        subprocess.run(
            [sys.executable, "-m", "flighttune", "gap", "paper", "--out", folder, "--json"],
            check=True,
            capture_output=True,
        )
        return time.perf_counter() - began, processor_seconds() - used


def processor_seconds() -> float:
    """Return the time that processes begun from here have had on the processor, s."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one object")
    as_json = parser.parse_args().json

    times = [seconds() for _ in range(REPEATS)]
    result = {
        "median_s": statistics.median(wall for wall, _ in times),
        "fastest_s": min(wall for wall, _ in times),
        "processor_s": statistics.median(used for _, used in times),
        "longest_s": LONGEST,
    }
    if as_json:
        print(json.dumps(result))
    else:
        print(
            f"flighttune gap paper: median {result['median_s']:.2f} s, fastest "
            f"{result['fastest_s']:.2f} s, on the processor {result['processor_s']:.2f} s "
            f"(at most {LONGEST:g} s)"
        )
    return 0 if result["fastest_s"] <= LONGEST else 1


if __name__ == "__main__":
    sys.exit(main())
