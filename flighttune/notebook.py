"""How values show themselves in a notebook: small tables of escaped text."""

import math
from collections.abc import Iterable, Sequence
from html import escape

from flighttune.arrays import FloatArray

CELL = "text-align:left"


def table(title: str, rows: Iterable[Sequence[str]], *, head: Sequence[str] = ()) -> str:
    """HTML of a small table.

    Parameters
    ----------
    title : str
        Caption.
    rows : iterable of sequence of str
        Plain text; markup in it is shown as it is.
    head : sequence of str, optional
        Headings of the columns; without them the first cell of a row is its heading.
    """
    lines = [f"<table><caption style='{CELL}'><b>{escape(title)}</b></caption>"]
    if head:
        lines.append(f"<thead><tr>{_cells(head, 'th')}</tr></thead>")
    lines.append("<tbody>")
    for first, *rest in rows:
        lines.append(f"<tr>{_cells([first], 'td' if head else 'th')}{_cells(rest, 'td')}</tr>")
    return "".join([*lines, "</tbody></table>"])


def number(value: float, digits: int = 4) -> str:
    """A number with so many digits, or a dash where there is none."""
    return f"{value:.{digits}g}" if math.isfinite(value) else "∞" if math.isinf(value) else "–"


def matrix(values: FloatArray) -> str:
    """A matrix in one line, its rows parted by semicolons."""
    return "[" + "; ".join(", ".join(f"{value:z.4f}" for value in row) for row in values) + "]"


def _cells(texts: Sequence[str], kind: str) -> str:
    return "".join(f"<{kind} style='{CELL}'>{escape(text)}</{kind}>" for text in texts)
