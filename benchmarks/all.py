"""Run every benchmark, print one table, and end with 1 if any of them missed a bar or crashed.

Run it with ``make bench``, or with names to choose some: ``python benchmarks/all.py gap jsbsim``.
With ``--quick`` everything runs once, tiny, and no figure is judged.
"""

import subprocess
import sys
import time
from pathlib import Path

import running

FOLDER = Path(__file__).parent
ENDS = {0: "ran" if running.QUICK else "met", 1: "missed"}


def main() -> int:
    """Fly the benchmarks named, all by default; 0 where every bar was met."""
    names = [name for name in sys.argv[1:] if name != "--quick"]
    files = sorted(FOLDER.glob("bench_*.py"))
    chosen = [file for file in files if not names or file.stem.removeprefix("bench_") in names]
    outcomes = []
    for file in chosen:
        print(f"== {file.stem}", flush=True)
        began = time.perf_counter()
        quick = ["--quick"] if running.QUICK else []
        status = subprocess.run([sys.executable, file, *quick], check=False).returncode
        outcomes.append((file.stem.removeprefix("bench_"), time.perf_counter() - began, status))
    print(f"\n{'benchmark':20}{'time':>9}  bars")
    for name, seconds, status in outcomes:
        print(f"{name:20}{seconds:7.1f} s  {ENDS.get(status, f'crashed ({status})')}")
    return int(any(status for _, _, status in outcomes))


if __name__ == "__main__":
    sys.exit(main())
