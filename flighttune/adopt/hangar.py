"""All models that come with JSBSim: each adopted in a process of its own, and one table."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from flighttune.processes import OWN_GROUP

LONGEST_S = 300.0
"""Time that one model may take."""

TABLE = "hangar.md"

STATUSES = ("adopted", "flies", "refused")


@dataclass(slots=True)
class Hangar:
    """The processes that adopt models; `close` ends them.

    Attributes
    ----------
    out : path
        Folder of the aircraft.
    h : float, m
    """

    out: Path
    h: float
    _running: list[subprocess.Popen[str]] = field(default_factory=list)
    _closed: bool = False

    def adopt_all(
        self, models: Sequence[str], seen: Callable[[dict[str, Any]], object]
    ) -> list[dict[str, Any]]:
        """Adopt every model, as many at once as there are processors.

        Parameters
        ----------
        models : sequence of str
        seen : callable
            Called with each answer as it comes.

        Returns
        -------
        list of dict
            Answers of ``flighttune adopt --json``, in the order of the models.
        """
        answers = {}
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            pending = {pool.submit(self._adopt, model): model for model in models}
            try:
                for done in as_completed(pending):
                    answers[pending[done]] = done.result()
                    seen(done.result())
            except BaseException:
                self.close()
                pool.shutdown(cancel_futures=True)
                raise
        return [answers[model] for model in models]

    def close(self) -> None:
        """End the processes that still run."""
        self._closed = True
        for process in list(self._running):
            process.kill()

    def _adopt(self, model: str) -> dict[str, Any]:
        if self._closed:
            return {"model": model, "status": "refused", "reason": "the command was ended"}
        command = [sys.executable, "-P", "-m", "flighttune", "adopt", model, "--json"]
        process = subprocess.Popen(
            [*command, "--h", repr(self.h), "--out", str(self.out / model)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for the command that started it
            creationflags=OWN_GROUP,
        )
        self._running.append(process)
        try:
            stdout, stderr = process.communicate(timeout=LONGEST_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return {"model": model, "status": "refused", "reason": f"it took over {LONGEST_S:g} s"}
        finally:
            self._running.remove(process)
        try:
            return {"model": model, **json.loads(stdout)}
        except ValueError:
            line = (stderr.strip().splitlines() or [f"status {process.returncode}"])[-1]
            return {"model": model, "status": "refused", "reason": line}


def counts(answers: Sequence[dict[str, Any]]) -> str:
    """How many were adopted, fly, and were refused."""
    of = [one["status"] for one in answers]
    return ", ".join(f"{of.count(status)} {status}" for status in STATUSES)


def hangar_text(answers: Sequence[dict[str, Any]]) -> str:
    """The table as Markdown."""
    ordered = sorted(answers, key=lambda one: STATUSES.index(one["status"]))
    rows = [
        "| model | status | engines | V_a m/s | fit φ / n_z % | ITAE χ / γ, tuned "
        "| ITAE χ / γ, K* scaled | s | why not adopted, or what was done to the model |",
        "|---|---|--:|--:|--:|--:|--:|--:|---|",
    ]
    rows += [f"| {' | '.join(_cells(one))} |" for one in ordered]
    return f"""# The hangar: every model of JSBSim's own set

Made by `flighttune adopt --all` with flighttune {version("flighttune")} and JSBSim
{version("jsbsim")}: {counts(answers)}, of {len(answers)}.
ITAE in rad s² of a turn of 20° with a climb of 3°, of gains tuned on the identified aircraft and
of the paper's K* scaled with airspeed.
What the statuses mean, and how to bring a model of your own: [aircraft.md](aircraft.md).

{chr(10).join(rows)}
"""


def _cells(one: dict[str, Any]) -> list[str]:
    fits = one.get("fit_percent") or {}
    flown = one.get("flown") or {}
    said = [text for text in (one.get("reason"), *(one.get("notes") or ())) if text]
    return [
        one["model"],
        one["status"],
        str(one.get("engines") or ""),
        f"{one['V_a_mps']:.0f}" if one.get("V_a_mps") else "",
        " / ".join(f"{fit:.1f}" for fit in fits.values()),
        *(_itae(flown.get(name)) for name in ("tuned", "paper")),
        f"{one['seconds']:.0f}" if one.get("seconds") else "",
        "; ".join(said).replace("|", "/"),
    ]


def _itae(flight: dict[str, Any] | None) -> str:
    if not flight or not flight["ITAE"]:
        return ""
    numbers = " / ".join(f"{value:.3g}" for value in flight["ITAE"].values())
    ended = "" if flight["status"] == "completed" else f" ({flight['status'].replace('_', ' ')})"
    return numbers + ended
