"""Rows of flights, written while they are flown, so that the same command goes on after a kill."""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from flighttune.base.errors import InputError, OutputError, keeping
from flighttune.base.files import owned
from flighttune.base.files.budget import KEPT, file_bytes
from flighttune.base.files.table import json_object
from flighttune.base.files.whole import allowed, apart, made_folder, write_text
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.columns import Row
from flighttune.campaigns.flying.compiled import COMPILED, CompiledFlights
from flighttune.campaigns.flying.rows import Drawn, Probes
from flighttune.campaigns.planning.plan import Plan
from flighttune.flight.fly import library_versions
from flighttune.flight.records.refly import other_libraries

# Digits of what decides, in the name of a file.
DIGITS = 8

# What progress counts of a row, with its type.
COUNTED = {"run": int, "status": str, "reason": str, "success": bool}


class KeptRows:
    """Flights of one command, in one or several plans, in a file if there is any.

    `decides` and the versions tell the command from others of the same name, in the name of the
    file: each goes on with its own flights. It is removed once the command has ended well.
    """

    def __init__(self, file: Path | None, decides: Mapping[str, Any], pool: WorkerPool) -> None:
        self._of, self._versions = _hash({"of": decides}), library_versions()
        if file is not None:
            file = file.with_name(f"{file.stem}-{self._of[:DIGITS]}{file.suffix}")
        self.file, self.pool = file, pool
        # Rows by plan and run.
        self._rows: dict[tuple[str, int], Row] = {}
        if file is None:
            return
        if other := self._read(file):
            pool.observer.hear(
                f"{file}: its flights are of other libraries ({other}) and are flown again."
            )
        if self._rows:
            pool.observer.hear(f"{file}: {len(self)} flights are flown already.")
            pool.progress.add([*self._rows.values()])
        if os.path.lexists(file):
            with apart():  # written anew, as a killed command may have left half of a line
                write_text(file, "".join(self._line(*x) for x in self._rows.items()))

    def __len__(self) -> int:
        """Number of flights that are kept."""
        return len(self._rows)

    def flown(
        self,
        plan: Plan,
        probes: Probes,
        runs: Iterable[int] | None = None,
        *,
        draws: Sequence[Drawn] | None = None,
        doing: str | None = None,
    ) -> list[Row]:
        """Rows of runs of a plan, by default of all; those that are not kept are flown and added.

        `draws` must depend on the plan alone.
        """
        of_plan = _hash({"plan": plan.as_dict(), "probes": [*probes]})
        places = [(of_plan, run) for run in (range(plan.runs) if runs is None else runs)]
        missing = [run for place, run in places if (place, run) not in self._rows]
        rows = self.pool.rows(plan, missing, doing=doing, probes=probes, draws=draws)
        if self.file is None:
            self._rows |= {(of_plan, row["run"]): row for row in rows}
        else:
            made_folder(self.file.parent)
            with (
                keeping(self.file),
                allowed(self.file, "writable", OutputError),
                owned.appended(self.file) as opened,
                open(opened, "a", encoding="utf-8", closefd=False) as file,
            ):
                for row in rows:
                    place = of_plan, row["run"]
                    self._rows[place] = row
                    file.write(self._line(place, row))
                    file.flush()
        return [self._rows[place] for place in places]

    def remove(self) -> None:
        """Remove the file, of a command whose flights are all flown."""
        if self.file is not None:
            with allowed(self.file, "writable", OutputError):
                self.file.unlink(missing_ok=True)

    def _line(self, place: tuple[str, int], row: Row) -> str:
        if COMPILED in row:
            row = row | {COMPILED: row[COMPILED].text}
        kept = {"of": self._of, "versions": self._versions, "plan": place[0], "row": row}
        text = _text(kept)
        return f"{sha256(text.encode()).hexdigest()} {text}\n"

    def _read(self, file: Path) -> str:
        """Take the rows of the command from the user's own file; none from a damaged line on.

        Returns what differs of the libraries of rows that were left.
        """
        other = ""
        if not owned.is_believed(file):
            return other
        with suppress(InputError, UnicodeDecodeError, KeyError, TypeError):
            for line in file_bytes(file, KEPT).decode().splitlines()[: KEPT.entries]:
                digest, _, text = line.partition(" ")
                if digest != sha256(text.encode()).hexdigest():
                    break
                kept = json_object(text, str(file))
                if kept["of"] == self._of and kept["versions"] != self._versions:
                    other = other_libraries(kept["versions"])
                elif kept["of"] == self._of:
                    row = kept["row"]
                    if any(type(row[key]) is not kind for key, kind in COUNTED.items()):
                        break
                    if COMPILED in row:
                        row[COMPILED] = CompiledFlights.stated(row[COMPILED])
                    self._rows[kept["plan"], row["run"]] = row
        return other


def _hash(value: Mapping[str, Any]) -> str:
    return sha256(_text(value).encode()).hexdigest()


def _text(value: Mapping[str, Any]) -> str:
    """JSON from which Python reads the same numbers, to the bit."""
    return json.dumps(value, default=lambda x: x.item())  # numbers of NumPy
