"""Who appears in a recording: the runs that flew, each with its key, look and name."""

from collections.abc import Sequence
from dataclasses import dataclass

from flighttune.palette import HUES, Look, looks, many_looks
from flighttune.recording.names import plain_name, told_apart
from flighttune.simulate.run import Run


@dataclass(frozen=True, slots=True, eq=False)
class Member:
    """One run in a recording.

    Attributes
    ----------
    run : Run
        A run with at least two samples.
    key : str
        Its folder in the tree of the recording, unique.
    look : Look
        How it is drawn.
    """

    run: Run
    key: str
    look: Look


def look_of(runs: Sequence[Run]) -> list[Look]:
    """Look of every run, also of those that never flew, in order."""
    pairs = [(run.provenance.plant, run.provenance.gains_name) for run in runs]
    found = looks(pairs) if len(set(pairs)) <= 2 * len(HUES) else many_looks(pairs)
    return [found[pair] for pair in pairs]


def cast(runs: Sequence[Run]) -> list[Member]:
    """Return the runs with at least two samples, in order."""
    keys = told_apart(plain_name(run.label) for run in runs)
    return [
        Member(run, key, look)
        for run, key, look in zip(runs, keys, look_of(runs), strict=True)
        if len(run.signals) > 1
    ]
