"""Run every benchmark, print one table, and end with 1 if any of them missed a bar.

Run it with ``make bench``, or with names to choose some: ``python benchmarks/all.py gap jsbsim``.
"""

import subprocess
import sys
import time
from pathlib import Path

FOLDER = Path(__file__).parent


def main(names: list[str]) -> int:
    """Fly the benchmarks named, all by default; 0 where every bar was met."""
    files = sorted(FOLDER.glob("bench_*.py"))
    chosen = [file for file in files if not names or file.stem.removeprefix("bench_") in names]
    outcomes = []
    for file in chosen:
        print(f"== {file.stem}", flush=True)
        began = time.perf_counter()
        status = subprocess.run([sys.executable, file], check=False).returncode
        outcomes.append((file.stem.removeprefix("bench_"), time.perf_counter() - began, status))
    print(f"\n{'benchmark':20}{'time':>9}  bars")
    for name, seconds, status in outcomes:
        said = "met" if status == 0 else "missed" if status == 1 else f"failed ({status})"
        print(f"{name:20}{seconds:7.1f} s  {said}")
    return int(any(status for _, _, status in outcomes))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
