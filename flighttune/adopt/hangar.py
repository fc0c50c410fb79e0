"""All models that come with JSBSim: each adopted in a process of its own, and one table."""

import math
import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from importlib.metadata import version
from multiprocessing.connection import Connection
from typing import Any

from flighttune.present.numbers import number

MAX_TIME_S = 300.0  # time that one model may take

TABLE = "hangar.md"

STATUSES = ("adopted", "flies", "refused")

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
    rows = [
        "| model | status | engines | V_a m/s | fit φ / n_z % | ITAE χ / γ, tuned "
        "| ITAE χ / γ, K* scaled | s | why not adopted, or what was done to the model |",
        "|---|---|--:|--:|--:|--:|--:|--:|---|",
    ]
    rows += [f"| {' | '.join(_cells(answer))} |" for answer in ordered]
    return f"""# The hangar: every model of JSBSim's own set

Made by `flighttune adopt --all` with flighttune {version("flighttune")} and JSBSim
{version("jsbsim")}: {counts(answers)}, of {len(answers)}.
ITAE in rad s² of a turn of 20° with a climb of 3°, of gains tuned on the identified aircraft and
of the paper's K* scaled with airspeed.
What the statuses mean, and how to bring a model of your own: [aircraft.md](aircraft.md).

{chr(10).join(rows)}
"""


def _cells(answer: dict[str, Any]) -> list[str]:
    fits = answer.get("fit_percent") or {}
    flown = answer.get("flown") or {}
    said = [text for text in (answer.get("reason"), *(answer.get("notes") or ())) if text]
    return [
        answer["model"],
        answer["status"],
        str(answer.get("engines") or ""),
        number(answer.get("V_a_mps") or math.nan, ".0f", missing=""),
        " / ".join(f"{fit:.1f}" for fit in fits.values()),
        *(_itae(flown.get(name)) for name in ("tuned", "paper")),
        f"{answer['seconds']:.0f}" if answer.get("seconds") else "",
        "; ".join(said).replace("|", "/"),
    ]


def _itae(flight: dict[str, Any] | None) -> str:
    if not flight or not flight["ITAE"]:
        return ""
    numbers = " / ".join(f"{value:.3g}" for value in flight["ITAE"].values())
    ended = "" if flight["status"] == "completed" else f" ({flight['status'].replace('_', ' ')})"
    return numbers + ended
