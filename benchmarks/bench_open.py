"""How soon the picture of ``flighttune open`` follows a slider: compiled flights beside JSBSim's.

Run it with ``python benchmarks/bench_open.py``; ``--json`` prints one object. Times are of the
processor. Exit status 1 if a limit is not kept.
"""

import statistics
import tempfile
import time
from pathlib import Path

import running

import flighttune as ft
from flighttune.outputs.live import desk

MOVES, UNTIMED = (1, 1) if running.QUICK else (9, 3)
TURN = {"flight.duration_s": 20.0}
LIMITS = {"compiled_s": 0.1, "jsbsim_s": 0.3}
"""Most that a picture of a flight of 20 s may take after a move."""


def seconds_of_a_move() -> float:
    """Median time from a move of a gain to the pieces of the page."""
    taken = []
    with tempfile.TemporaryDirectory() as folder:
        page = desk.Desk(ft.flights("level_turn", changes=TURN), None, Path(folder))
        for number in range(UNTIMED + MOVES):
            began = time.process_time()
            moved = desk.Asked(
                values={"gains[0].K_P[0][0]": 1.0 + 0.01 * number}, ghosts={"start": {}}
            )
            page.picture(moved)
            taken.append(time.process_time() - began)
    return statistics.median(taken[UNTIMED:])


def main() -> int:
    """Measure, print, and hold against the limits."""
    wanted = running.options(__doc__).parse_args()
    found = {"compiled_s": seconds_of_a_move()}
    with ft.in_jsbsim():
        found["jsbsim_s"] = seconds_of_a_move()
    found["jsbsim_over_compiled"] = found["jsbsim_s"] / found["compiled_s"]
    return running.judged(found, LIMITS, as_json=wanted.json)


if __name__ == "__main__":
    running.end(main)
