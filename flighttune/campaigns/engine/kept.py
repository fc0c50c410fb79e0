"""Rows of flights, written while they are flown, so that the same command goes on after a kill."""

import json
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from flighttune.base.errors import InputError, OutputError, keeping
from flighttune.base.files.whole import allowed, apart, write_text
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.columns import Row
from flighttune.campaigns.flying.compiled import COMPILED, CompiledFlights
from flighttune.campaigns.flying.rows import Probes
from flighttune.campaigns.planning.plan import Plan
from flighttune.flight.fly import library_versions


class KeptRows:
    """The flights of a plan that are flown, in a file."""

    def __init__(self, file: Path, plan: Plan, probes: Probes) -> None:
        self._file, self._plan, self._probes = file, plan, probes
        decides = {"plan": plan.as_dict(), "versions": library_versions(), "probes": [*probes]}
        # Each row has it, so that none of another command that writes to the file is taken.
        self._of = sha256(_text(decides).encode()).hexdigest()

    def flown(self, pool: WorkerPool) -> list[Row]:
        """Rows of all flights, in order; those that are not in the file are flown and added."""
        rows = self._kept()
        if rows:
            pool.observer.hear(f"{self._file}: {len(rows)} flights are flown already.")
        missing = [run for run in range(self._plan.runs) if run not in rows]
        with apart():  # written anew, as a killed command may have left half of a line
            write_text(self._file, "".join(map(self._line, rows.values())))
        with (
            keeping(self._file),
            allowed(self._file, "writable", OutputError),
            self._file.open("a", encoding="utf-8") as file,
        ):
            for row in pool.rows(self._plan, missing, probes=self._probes):
                rows[row["run"]] = row
                file.write(self._line(row))
                file.flush()
        return [rows[run] for run in range(self._plan.runs)]

    def remove(self) -> None:
        """Remove the file of flights that are all flown."""
        with allowed(self._file, "writable", OutputError):
            self._file.unlink(missing_ok=True)

    def _line(self, row: Row) -> str:
        if COMPILED in row:
            row = row | {COMPILED: row[COMPILED].text}
        return _text({"of": self._of, "row": row}) + "\n"

    def _kept(self) -> dict[int, Row]:
        """The plan's rows in the file, by run; none after a damaged line."""
        rows: dict[int, Row] = {}
        try:
            for line in self._file.read_text(encoding="utf-8").splitlines():
                kept = json.loads(line)
                if kept["of"] == self._of:
                    row = kept["row"]
                    if COMPILED in row:
                        row[COMPILED] = CompiledFlights.stated(row[COMPILED])
                    rows[row["run"]] = row
        except (OSError, ValueError, KeyError, TypeError, InputError):
            pass
        return {run: row for run, row in rows.items() if run in range(self._plan.runs)}


def _text(value: Mapping[str, Any]) -> str:
    """JSON from which Python reads the same numbers, to the bit."""
    return json.dumps(value, default=lambda x: x.item())  # numbers of NumPy
