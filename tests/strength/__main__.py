"""How many lines, broken on purpose, does the suite notice? `make strength` learns and scores.

    python -m strength learn                        which test runs which line
    python -m strength score --lines 60 --seed 7    breaks 60 lines one after the other

Run it in a clone that nothing else uses: it writes each broken line to disk while it is tried, and
puts it back. The same seed draws the same lines from the same tests.
"""

import argparse
import random
from pathlib import Path

from strength.breaking import draw
from strength.inside import takes_nothing_from_inside
from strength.learning import learn, load
from strength.scoring import score, summary

SELECTED = ["-n", "2", "--dist", "loadfile", "-m", "not (soak or counts)"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--learnt", type=Path, default=Path("strength.json.gz"))
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("learn", help="with arguments of pytest, if not all tests are meant")
    two = commands.add_parser("score")
    two.add_argument("--lines", type=int, default=60, help="how many are broken")
    two.add_argument("--seed", type=int, default=random.randrange(10**6), help="of their draw")
    two.add_argument("--rooms", default="", help="only such paths: control/laws,routes")
    two.add_argument("--public", action="store_true", help="leave out tests from inside")
    options, selected = parser.parse_known_args()
    if options.command == "learn":
        learnt = learn(options.learnt, selected or SELECTED)
        lines = sum(map(len, learnt["lines"].values()))
        print(f"{options.learnt}: {len(learnt['tests'])} tests run {lines} lines")
        return
    if selected:
        parser.error(f"it has no {' '.join(selected)}")
    learnt = load(options.learnt)
    rooms = tuple(filter(None, options.rooms.split(",")))
    changes, of = draw(learnt["lines"], options.lines, options.seed, rooms)
    results = score(learnt, changes, lambda x: not options.public or takes_nothing_from_inside(x))
    print(f"{summary(results)}; seed {options.seed}, of {of} lines")


if __name__ == "__main__":
    main()
