"""Foreign Parquet files: their size is known before they are unpacked.

The metadata of a file state its size, and each page states the size that is reserved for it.
Page headers are structures of Thrift's compact protocol (parquet-format, PageHeader).
"""

from collections.abc import Iterator

import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.base.errors import RecordingError
from flighttune.base.files import budget

# Fields of a PageHeader: bytes of the page after and before its compression
UNPACKED, PACKED = 2, 3

# Types of the compact protocol; the others are integers of variable length
FLAGS, BYTE, DOUBLE, BINARY, LISTS, MAP, STRUCT = (1, 2), 3, 7, 8, (9, 10), 11, 12


def opened(data: bytes) -> pq.ParquetFile:
    """A Parquet file; RecordingError if its content does not fit into memory."""
    file = pq.ParquetFile(pa.BufferReader(data))
    stated = file.metadata
    check_size(stated.num_rows, stated.num_columns)
    groups = [stated.row_group(i) for i in range(stated.num_row_groups)]
    _check_bytes(sum(group.total_byte_size for group in groups))
    columns = [group.column(i) for group in groups for i in range(stated.num_columns)]
    try:
        _check_bytes(sum(unpacked for column in columns for unpacked in pages(data, column)))
    except (IndexError, RecursionError):
        raise RecordingError("its pages must have whole headers within the file.") from None
    return file


def check_size(rows: int, columns: int) -> None:
    """Refuse a file with more numbers than the maximum."""
    if rows * columns > budget.PARQUET.entries:
        raise RecordingError(
            f"it must have at most {budget.PARQUET.entries} numbers, got {rows} rows of {columns}."
        )


def _check_bytes(size: int) -> None:
    if size > budget.PARQUET.unpacked:
        raise RecordingError(
            f"it must unpack to at most {budget.PARQUET.unpacked} bytes, got {size}."
        )


def pages(data: bytes, column: pq.ColumnChunkMetaData) -> Iterator[int]:
    """Bytes of each page and its header, unpacked; IndexError if one is not within `data`."""
    at = min(filter(None, (column.dictionary_page_offset, column.data_page_offset)), default=0)
    end = at + column.total_compressed_size
    for _ in range(budget.PAGES.entries):
        if at >= end:
            return
        after, fields = _structure(data, at)
        packed, unpacked = fields.get(PACKED, -1), fields.get(UNPACKED, -1)
        if min(packed, unpacked) < 0:
            raise IndexError
        yield after - at + unpacked
        at = after + packed
    raise RecordingError(
        f"it must have at most {budget.PAGES.entries} pages in a column, got more."
    )


def _structure(data: bytes, at: int) -> tuple[int, dict[int, int]]:
    """End of a structure of the compact protocol, and its integers by field."""
    fields, field = dict[int, int](), 0
    while head := data[at]:
        at, kind = at + 1, head & 15
        if head >> 4:
            field += head >> 4
        else:
            at, number = _integer(data, at)
            field = _signed(number)
        if kind in FLAGS:
            continue
        at, fields[field] = _value(data, at, kind)
    return at + 1, fields


def _value(data: bytes, at: int, kind: int) -> tuple[int, int]:
    """End of a value, and the value if it is an integer, else 0."""
    if kind == STRUCT:
        return _structure(data, at)[0], 0
    if kind in (BYTE, DOUBLE):
        return at + (1 if kind == BYTE else 8), 0
    if kind in (*LISTS, MAP):  # no field of a page header has these types
        raise IndexError
    at, number = _integer(data, at)
    return (at + number, 0) if kind == BINARY else (at, _signed(number))


def _integer(data: bytes, at: int) -> tuple[int, int]:
    """End of an integer of variable length of at most 64 bits, and the integer."""
    number = 0
    for shift in range(0, 64, 7):
        byte = data[at]
        at, number = at + 1, number | (byte & 127) << shift
        if byte < 128:
            return at, number
    raise IndexError


def _signed(number: int) -> int:
    """The signed integer of a zigzag one."""
    return number >> 1 ^ -(number & 1)
