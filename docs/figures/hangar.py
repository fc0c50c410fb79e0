"""Write docs/hangar.md, `adopt` on every model of JSBSim's own set: python docs/figures/hangar.py.

Each model is adopted by a command of its own, as many at once as there are cores, in some minutes.
"""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from flighttune.files.shipped import models_of_jsbsim
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table

PAGE = Path(__file__).parents[1] / "hangar.md"

MAX_TIME_S = 600.0  # time that one model may take

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


def adopted(model: str) -> dict[str, Any]:
    """The answer of the command for a model; a crash or an endless flight refuses it."""
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "flighttune", "adopt", model, "--json", "--out"]
        done = None
        try:
            done = subprocess.run(
                [*command, f"{folder}/{model}"], capture_output=True, text=True, timeout=MAX_TIME_S
            )
            answer = json.loads(done.stdout)
        except subprocess.TimeoutExpired:
            answer = {"status": "refused", "reason": f"it took over {MAX_TIME_S:g} s"}
        except json.JSONDecodeError:
            assert done is not None
            reason = f"its process ended with status {done.returncode}: {done.stderr}"
            answer = {"status": "refused", "reason": reason}
    print(f"{model}: {answer['status']}", flush=True)
    return {"model": model, **answer}


def hangar_text(answers: Sequence[dict[str, Any]]) -> str:
    """The page: a row for each model, those that are adopted first."""
    statuses = [answer["status"] for answer in answers]
    counts = ", ".join(f"{statuses.count(status)} {status}" for status in STATUSES)
    records = [
        answer | {"remarks": [*filter(None, [answer["reason"], *answer.get("notes", ())])]}
        for answer in sorted(answers, key=lambda answer: STATUSES.index(answer["status"]))
    ]
    return f"""# The hangar: every model of JSBSim's own set

Made by `python docs/figures/hangar.py` with flighttune {version("flighttune")} and JSBSim
{version("jsbsim")}: {counts}, of {len(answers)}.
ITAE in rad s² of a turn of 20° with a climb of 3°, of gains tuned on the identified aircraft and
of the paper's K* scaled with airspeed. A glider descends 3° steeper than its glide instead.
What the statuses mean, and how to bring a model of your own: [aircraft.md](aircraft.md).

{Table(columns=COLUMNS, records=records).markdown()}
"""


if __name__ == "__main__":
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        PAGE.write_text(hangar_text(list(pool.map(adopted, models_of_jsbsim()))), encoding="utf-8")
