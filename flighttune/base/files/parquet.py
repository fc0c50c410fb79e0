"""Foreign Parquet files: their size is read from the metadata before they are unpacked."""

import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.base.errors import RecordingError

# Maximum count of numbers in a file, two hours of 40 signals at 100 Hz, and of their bytes.
MAX_NUMBERS, MAX_BYTES = 30_000_000, 2**28


def opened(data: bytes) -> pq.ParquetFile:
    """A Parquet file; RecordingError if its content does not fit into memory."""
    file = pq.ParquetFile(pa.BufferReader(data))
    stated = file.metadata
    check_size(stated.num_rows, stated.num_columns)
    size = sum(stated.row_group(i).total_byte_size for i in range(stated.num_row_groups))
    if size > MAX_BYTES:
        raise RecordingError(f"it must unpack to at most {MAX_BYTES} bytes, got {size}.")
    return file


def check_size(rows: int, columns: int) -> None:
    """Refuse a file with more numbers than the maximum."""
    if rows * columns > MAX_NUMBERS:
        raise RecordingError(
            f"it must have at most {MAX_NUMBERS} numbers, got {rows} rows of {columns}."
        )
