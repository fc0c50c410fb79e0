# SPDX-License-Identifier: LGPL-2.1-or-later
"""Tables of one, two and three dimensions: linear between their points, constant beyond."""

from collections.abc import Sequence
from dataclasses import dataclass

from flighttune.compiled.trace import (
    Number,
    Truth,
    constrained,
    flat_index,
    lookup,
    segment,
    select,
)


@dataclass(frozen=True)
class Table1:
    """Values over one key."""

    keys: tuple[float, ...]
    values: tuple[float, ...]

    def at(self, key: Number) -> Number:
        """The value at a key."""
        xs, ys = self.keys, self.values
        if len(xs) == 1:
            return ys[0]
        i = segment(xs, key)
        x_0, x_1, y_0, y_1 = lookup(xs, i), lookup(xs, i, 1), lookup(ys, i), lookup(ys, i, 1)
        inside = (key - x_0) / (x_1 - x_0) * (y_1 - y_0) + y_0
        return select(key <= xs[0], ys[0], select(key >= xs[-1], ys[-1], inside))


@dataclass(frozen=True)
class Table2:
    """Values over a row key and a column key, row by row."""

    rows: tuple[float, ...]
    columns: tuple[float, ...]
    values: tuple[float, ...]

    def at(self, row: Number, column: Number) -> Number:
        """The value at both keys."""
        n = len(self.columns)
        if n == 1:
            return Table1(self.rows, self.values).at(row)
        c = segment(self.columns, column)
        x_0, x_1 = lookup(self.columns, c), lookup(self.columns, c, 1)
        across = constrained(0.0, (column - x_0) / (x_1 - x_0), 1.0)
        if len(self.rows) == 1:
            y_0 = lookup(self.values, c)
            return across * (lookup(self.values, c, 1) - y_0) + y_0
        r = segment(self.rows, row)
        x_0, x_1 = lookup(self.rows, r), lookup(self.rows, r, 1)
        down = constrained(0.0, (row - x_0) / (x_1 - x_0), 1.0)
        place = flat_index(r, n, c)
        v_00, v_01, v_10, v_11 = (lookup(self.values, place, by) for by in (0, 1, n, n + 1))
        left = down * v_10 + (1.0 - down) * v_00
        right = down * v_11 + (1.0 - down) * v_01
        return across * (right - left) + left


@dataclass(frozen=True)
class Table3:
    """Tables of two dimensions at the breakpoints of a third key."""

    breakpoints: tuple[float, ...]
    tables: tuple[Table2, ...]

    def at(self, row: Number, column: Number, key: Number) -> Number:
        """The value at three keys."""
        xs, ys = self.breakpoints, [table.at(row, column) for table in self.tables]
        if len(xs) == 1:
            return ys[0]
        # The segment ends at the first breakpoint that is not below the key.
        y = ys[-1]
        for n in range(len(xs) - 2, -1, -1):
            inside = (key - xs[n]) / (xs[n + 1] - xs[n]) * (ys[n + 1] - ys[n]) + ys[n]
            within: Truth = key <= xs[n + 1] if n < len(xs) - 2 else key < xs[-1]
            y = select(within, inside, y)
        return select(key <= xs[0], ys[0], y)


def numbers(text: str) -> list[list[float]]:
    """Rows of numbers in the text of a table."""
    return [[float(x) for x in line.split()] for line in text.splitlines() if line.split()]


def table_1(text: str) -> Table1:
    """A table of pairs of key and value."""
    flat = [x for row in numbers(text) for x in row]
    return Table1(tuple(flat[::2]), tuple(flat[1::2]))


def table_2(text: str) -> Table2:
    """A table whose first row has the column keys and whose first column the row keys."""
    columns, *body = numbers(text)
    values = tuple(x for row in body for x in row[1:])
    return Table2(tuple(row[0] for row in body), tuple(columns), values)


def table_of(rows: Sequence[Sequence[float]]) -> Table1:
    """A table of pairs."""
    keys, values = zip(*rows, strict=True)
    return Table1(keys, values)
