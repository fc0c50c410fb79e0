"""All models that come with JSBSim: each adopted in a process of its own, and one table."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from importlib.metadata import version
from multiprocessing.connection import Connection
from typing import Any

from flighttune.present.names import columns
from flighttune.present.tables import Column, Table

MAX_TIME_S = 600.0  # time that one model may take

TABLE = "hangar.md"

STATUSES = ("adopted", "flies", "refused")

COLUMNS = [
    *columns("model status engines V_a_mps"),
    Column("fit_percent.phi", "fit φ", "%", ".1f"),
    Column("fit_percent.n_z", "fit n_z", "%", ".1f"),
    Column("flown.tuned.ITAE.chi", "tuned: ITAE χ", digits=".3g"),
    Column("flown.tuned.ITAE.gamma", "ITAE γ", digits=".3g"),
    Column("flown.paper.ITAE.chi", "K* scaled: ITAE χ", digits=".3g"),
    Column("flown.paper.ITAE.gamma", "ITAE γ", digits=".3g"),
    Column("flown.paper.status", "K* scaled"),
    Column("seconds", "time", "s", ".0f"),
    *columns("remarks"),
]

# A forked process would share JSBSim and the threads of the libraries with this one.
SPAWN = multiprocessing.get_context("spawn")


def adopt_all(
    models: Sequence[str],
    adopt: Callable[[str], dict[str, Any]],
    seen: Callable[[dict[str, Any]], object],
) -> list[dict[str, Any]]:
    """Answers of `adopt` in the order of the models, as many at once as there are processors.

    `adopt` is a function of a module, which each process imports; `seen` is called with each
    answer as it comes.
    """
    answers = {}
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        pending = {pool.submit(_adopt_alone, adopt, model): model for model in models}
        try:
            for done in as_completed(pending):
                answers[pending[done]] = done.result()
                seen(done.result())
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in SPAWN.active_children():
                process.kill()  # its thread then sees the end of the pipe
            raise
    return [answers[model] for model in models]


def _adopt_alone(adopt: Callable[[str], dict[str, Any]], model: str) -> dict[str, Any]:
    """Adopt a model in a process of its own: a crash of JSBSim costs this model alone."""
    receiver, sender = SPAWN.Pipe(duplex=False)
    process = SPAWN.Process(target=_answer, args=(adopt, model, sender), daemon=True)
    process.start()
    sender.close()  # else the pipe would stay open here when the process ends
    try:
        if not receiver.poll(MAX_TIME_S):
            return _refused(model, f"it took over {MAX_TIME_S:g} s")
        return receiver.recv()
    except EOFError:
        process.join()
        return _refused(model, f"its process ended with status {process.exitcode}")
    finally:
        process.kill()
        process.join()


def _answer(adopt: Callable[[str], dict[str, Any]], model: str, sender: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the command that started it
    try:
        sender.send({"model": model, **adopt(model)})
    except Exception as error:
        sender.send(_refused(model, str(error)))


def _refused(model: str, reason: str) -> dict[str, Any]:
    return {"model": model, "status": "refused", "reason": reason}


def counts(answers: Sequence[dict[str, Any]]) -> str:
    """Numbers of models that were adopted, that fly, and that were refused."""
    statuses = [answer["status"] for answer in answers]
    return ", ".join(f"{statuses.count(status)} {status}" for status in STATUSES)


def hangar_text(answers: Sequence[dict[str, Any]]) -> str:
    """The table as Markdown."""
    ordered = sorted(answers, key=lambda answer: STATUSES.index(answer["status"]))
    records = [
        answer | {"remarks": [*filter(None, [answer["reason"], *answer.get("notes", ())])]}
        for answer in ordered
    ]
    table = Table(columns=COLUMNS, records=records)
    return f"""# The hangar: every model of JSBSim's own set

Made by `flighttune adopt --all` with flighttune {version("flighttune")} and JSBSim
{version("jsbsim")}: {counts(answers)}, of {len(answers)}.
ITAE in rad s² of a turn of 20° with a climb of 3°, of gains tuned on the identified aircraft and
of the paper's K* scaled with airspeed. A glider descends 3° steeper than its glide instead.
What the statuses mean, and how to bring a model of your own: [aircraft.md](aircraft.md).

{table.markdown()}
"""
