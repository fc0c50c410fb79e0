"""A campaign on disk: ``campaign.json``, a Parquet file a chunk of runs, and kept signals.

Any reader of Parquet can look at ``runs/`` at any time: a file that is there is whole.
"""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.campaign.dataset.spans import Span
from flighttune.campaign.dataset.storage import WRITING, Store
from flighttune.campaign.planning.plan import Plan, plan_from
from flighttune.errors import RecordingError

FORMAT = 1
CAMPAIGN = "campaign.json"
RUNS, SIGNALS = "runs", "signals"
NOT_OF_THE_RUN = ("wall_s",)
"""Columns that differ from one flight of a run to the next."""

_PART = re.compile(r"part-(\d+)-(\d+)\.parquet")
_SIGNALS = re.compile(r"run-(\d+)\.parquet")


class Dataset:
    """The folder of a campaign.

    Parameters
    ----------
    store : Store
        Where it is.
    plan : Plan
        What is flown into it.
    versions : mapping of str to str
        Of the libraries that shape its numbers.
    """

    def __init__(self, store: Store, plan: Plan, versions: Mapping[str, str]) -> None:
        self.store, self.plan, self.versions = store, plan, dict(versions)

    @property
    def url(self) -> str:
        """Path or URL of the folder, as it was given."""
        return self.store.url

    @property
    def spans(self) -> tuple[Span, ...]:
        """Ranges of the runs that are there, in order.

        Raises
        ------
        RecordingError
            If two files hold the same run.
        """
        spans = sorted(
            Span(int(found[1]), int(found[2]))
            for found in map(_PART.fullmatch, self.store.names(RUNS))
            if found
        )
        for one, other in pairwise(spans):
            if other.first < one.end:
                raise RecordingError(
                    f"{self.store.place(RUNS)}: a run must be in one file, got run {other.first} "
                    f"in {part_name(one)} and {part_name(other)}."
                )
        return tuple(spans)

    @property
    def kept(self) -> tuple[int, ...]:
        """The runs whose signals are there, in order."""
        found = map(_SIGNALS.fullmatch, self.store.names(SIGNALS))
        return tuple(sorted(int(name[1]) for name in found if name))

    def write_plan(self) -> None:
        """Write ``campaign.json``.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        text = {"format": FORMAT, "versions": self.versions, "plan": self.plan.as_dict()}
        self.store.write(CAMPAIGN, (json.dumps(text, indent=1) + "\n").encode())

    def write_part(self, rows: pa.Table) -> Span:
        """Write the rows of a range of runs, in order of `run`; return the range.

        Raises
        ------
        OutputError
            If they cannot be written.
        """
        runs = rows.column("run")
        span = Span(runs[0].as_py(), runs[-1].as_py() + 1)
        self.store.write(f"{RUNS}/{part_name(span)}", parquet_bytes(rows))
        return span

    def read_part(self, span: Span, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the rows of one file.

        Raises
        ------
        RecordingError
            If the file is damaged or does not hold these runs, each once.
        """
        name = f"{RUNS}/{part_name(span)}"
        wanted = None if columns is None else [*dict.fromkeys(["run", *columns])]
        try:
            file = pq.ParquetFile(
                pa.BufferReader(self.store.read(name)), page_checksum_verification=True
            )
            # a thread of Arrow that lets go of our bytes while Python ends would end the process
            rows = file.read(wanted, use_threads=False)
            sound = np.array_equal(rows.column("run").to_numpy(), np.arange(*span))
        except (pa.ArrowException, OSError, KeyError) as error:
            raise RecordingError(f"{self.store.place(name)}: is damaged: {error}.") from error
        if not sound:
            raise RecordingError(
                f"{self.store.place(name)}: must hold the runs {span.first} to {span.end - 1}, "
                "each once and in order."
            )
        return rows

    def remove_part(self, span: Span) -> None:
        """Remove the file of a range of runs."""
        self.store.remove(f"{RUNS}/{part_name(span)}")

    def tables(self, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """The rows, file by file in order of `run`.

        Raises
        ------
        RecordingError
            If a file is damaged.
        """
        for span in self.spans:
            yield self.read_part(span, columns)

    def rows(self, columns: Sequence[str] | None = None) -> pa.Table:
        """All rows that are there, in order of `run`.

        Raises
        ------
        RecordingError
            If there are none, or a file is damaged.
        """
        tables = list(self.tables(columns))
        if not tables:
            raise RecordingError(f"{self.url}: no run has been flown yet.")
        return pa.concat_tables(tables)

    def write_signals(self, run: int, data: bytes) -> None:
        """Write the recording of a run."""
        self.store.write(f"{SIGNALS}/{signals_name(run)}", data)

    def remove_signals(self, run: int) -> None:
        """Remove the recording of a run."""
        self.store.remove(f"{SIGNALS}/{signals_name(run)}")

    def clean(self) -> None:
        """Remove what was being written when a campaign was ended."""
        self.store.remove(WRITING)


def parquet_bytes(rows: pa.Table) -> bytes:
    """The file of rows."""
    sink = pa.BufferOutputStream()
    pq.write_table(rows, sink, compression="zstd", write_page_checksum=True)
    return sink.getvalue().to_pybytes()


def part_name(span: Span) -> str:
    """Name of the file of a range of runs."""
    return f"part-{span.first:010d}-{span.end:010d}.parquet"


def signals_name(run: int) -> str:
    """Name of the recording of a run."""
    return f"run-{run:010d}.parquet"


def open_dataset(url: str | Path) -> Dataset:
    """Return the campaign in a folder.

    Parameters
    ----------
    url : str or Path
        A local folder, or any URL that fsspec knows.

    Raises
    ------
    RecordingError
        If there is none, or it was written by a newer flighttune.
    InputError
        If the URL cannot be opened.
    """
    store = Store(url)
    if not store.exists(CAMPAIGN):
        raise RecordingError(f"{store.url}: must hold a campaign, got no {CAMPAIGN}.")
    try:
        text: dict[str, Any] = json.loads(store.read(CAMPAIGN))
        if text["format"] > FORMAT:
            raise RecordingError(
                f"{store.place(CAMPAIGN)}: layout must be {FORMAT} or older, got {text['format']}."
            )
        return Dataset(store, plan_from(text["plan"]), text["versions"])
    except RecordingError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError(
            f"{store.place(CAMPAIGN)}: must describe a campaign, got: {error}."
        ) from error


def dataset_hash(url: str | Path) -> str:
    """Return a digest of the rows in order of run, of all columns but ``wall_s``.

    Two campaigns have the same digest only where every number has the same bits.

    Parameters
    ----------
    url : str or Path
        Folder of a campaign.

    Raises
    ------
    RecordingError
        If there is no campaign, or a file of it is damaged.
    """
    rows = open_dataset(url).rows()
    digest = hashlib.sha256()
    for field in rows.schema:
        if field.name in NOT_OF_THE_RUN:
            continue
        digest.update(f"{field.name}:{field.type};".encode())
        for block in _bits(rows.column(field.name)):
            digest.update(block)
    return digest.hexdigest()


def _bits(column: pa.ChunkedArray) -> Iterator[bytes]:
    """Which values are missing, then the values themselves."""
    yield np.packbits(column.is_null().to_numpy()).tobytes()
    if not pa.types.is_primitive(column.type):
        for text in column.cast(pa.large_string()).fill_null("").to_pylist():
            yield f"{len(text)}:{text}".encode()
        return
    zero = False if pa.types.is_boolean(column.type) else 0
    yield column.fill_null(pa.scalar(zero, column.type)).to_numpy().tobytes()
