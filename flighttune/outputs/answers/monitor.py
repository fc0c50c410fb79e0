"""The answer of a monitor of logs."""

from dataclasses import asdict
from pathlib import Path

from flighttune.base.words import listed
from flighttune.campaigns.statistics.count import flights_needed
from flighttune.claims.monitor import SETTLED_S, LogMonitor
from flighttune.gaps import watch as watching
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.labels import columns

COLUMNS = columns("name seconds score why", of="healthy_logs")


def answer(monitor: LogMonitor, _: str | Path = "FILE") -> Answer:
    """The logs, the watched and unwatched signals, and the claim."""
    models = monitor.logs[0].models
    seen, possible = {x.name for x in models}, {x.name: x for x in watching.OF_LOGS[::-1]}
    lacking = [x for name, x in possible.items() if name not in seen]
    unseen = [f"{x.name} ({listed(sorted(x.signals))})" for x in lacking]
    notes = [
        f"Watched are {listed([f'{x.name} ({x.target})' for x in models])}, from "
        f"{SETTLED_S:g} s of a log on. How often faults are found is not in the claim.",
        "A claim of 5 % takes 19 logs; at a confidence of 0.95 for these limits it takes "
        f"{flights_needed(0.05, 0.95)} further logs without an alarm. Parts of one flight are "
        "not exchangeable with another flight, and longer flights alarm more often.",
    ]
    if unseen:
        notes.insert(1, f"Not watched, as a log lacks the signals: {listed(unseen)}.")
    rows = [asdict(log) for log in monitor.logs]
    return Answer(
        values={"epsilon": monitor.epsilon, "sentence": monitor.sentence, "settled_s": SETTLED_S},
        tables=[Table(COLUMNS, rows, "what each log scores", name="logs")],
        notes=notes,
        verdict=monitor.sentence,
    )
