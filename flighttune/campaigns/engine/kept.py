"""Rows of flights, written while they are flown, so that the same command goes on after a kill."""

import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from flighttune.base.errors import InputError, OutputError, keeping
from flighttune.base.files.budget import KEPT, file_bytes
from flighttune.base.files.table import json_object
from flighttune.base.files.whole import allowed, apart, made_folder, write_text
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.columns import Row
from flighttune.campaigns.flying.compiled import COMPILED, CompiledFlights
from flighttune.campaigns.flying.rows import Drawn, Probes
from flighttune.campaigns.planning.plan import Plan
from flighttune.flight.fly import library_versions

# What progress counts of a row, with its type.
COUNTED = {"run": int, "status": str, "reason": str, "success": bool}


class KeptRows:
    """Flights of one command, in one or several plans, in a file if there is any.

    `decides` tells the command from others that write to the file, beside the versions. The file is
    removed once the command has ended well.
    """

    def __init__(self, file: Path | None, decides: Mapping[str, Any], pool: WorkerPool) -> None:
        self._file, self.pool = file, pool
        self._of = _hash({"of": decides, "versions": library_versions()})
        # Rows by plan and run.
        self._rows: dict[tuple[str, int], Row] = {}
        if file is None:
            return
        self._read(file)
        if self._rows:
            pool.observer.hear(f"{file}: {len(self)} flights are flown already.")
            pool.progress.add([*self._rows.values()])
        if file.exists():
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
        if self._file is None:
            self._rows |= {(of_plan, row["run"]): row for row in rows}
        else:
            made_folder(self._file.parent)
            with (
                keeping(self._file),
                allowed(self._file, "writable", OutputError),
                self._file.open("a", encoding="utf-8") as file,
            ):
                for row in rows:
                    place = of_plan, row["run"]
                    self._rows[place] = row
                    file.write(self._line(place, row))
                    file.flush()
        return [self._rows[place] for place in places]

    def remove(self) -> None:
        """Remove the file, of a command whose flights are all flown."""
        if self._file is not None:
            with allowed(self._file, "writable", OutputError):
                self._file.unlink(missing_ok=True)

    def _line(self, place: tuple[str, int], row: Row) -> str:
        if COMPILED in row:
            row = row | {COMPILED: row[COMPILED].text}
        text = _text({"of": self._of, "plan": place[0], "row": row})
        return f"{sha256(text.encode()).hexdigest()} {text}\n"

    def _read(self, file: Path) -> None:
        """Take the rows of the command from the file; none from a damaged line on."""
        with suppress(InputError, UnicodeDecodeError, KeyError, TypeError):
            for line in file_bytes(file, KEPT).decode().splitlines()[: KEPT.entries]:
                digest, _, text = line.partition(" ")
                if digest != sha256(text.encode()).hexdigest():
                    break
                kept = json_object(text, str(file))
                if kept["of"] == self._of:
                    row = kept["row"]
                    if any(type(row[key]) is not kind for key, kind in COUNTED.items()):
                        break
                    if COMPILED in row:
                        row[COMPILED] = CompiledFlights.stated(row[COMPILED])
                    self._rows[kept["plan"], row["run"]] = row


def _hash(value: Mapping[str, Any]) -> str:
    return sha256(_text(value).encode()).hexdigest()


def _text(value: Mapping[str, Any]) -> str:
    """JSON from which Python reads the same numbers, to the bit."""
    return json.dumps(value, default=lambda x: x.item())  # numbers of NumPy
