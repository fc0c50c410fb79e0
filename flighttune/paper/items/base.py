"""What an item of the paper is, and what making it gives."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import pandas as pd

from flighttune.paper.parameters import Assumption
from flighttune.paper.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Made:
    """An item as computed.

    Attributes
    ----------
    figures : mapping of str to (str, Figure)
        Caption and figure by file name; the first bears the item's name.
    tables : mapping of str to DataFrame
        What the figures show, by file name; the first bears the item's name. Columns carry units.
    values : mapping
        The numbers of the item, plain.
    outcome : tuple of str
        What comes out, a sentence each.
    """

    figures: "Mapping[str, tuple[str, Figure]]"
    tables: Mapping[str, pd.DataFrame]
    values: Mapping[str, Any]
    outcome: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A table or figure of the paper that can be made again.

    Attributes
    ----------
    name : str
        As on the command line: the label in the paper's source.
    title : str
        What it shows.
    printed : str
        Where it stands in the paper.
    make : callable
        From a study to the item as computed.
    parameters : tuple of str
        What was used of what the paper prints, a line each.
    assumed : tuple of Assumption
        What the paper does not print.
    """

    name: str
    title: str
    printed: str
    make: Callable[[Study], Made]
    parameters: tuple[str, ...]
    assumed: tuple[Assumption, ...] = field(default=())


def text_of(item: Item, made: Made) -> str:
    """The short text of an item, Markdown."""
    lines = [f"# {item.name}: {item.title}", "", f"{item.printed} of arXiv 2411.13140.", ""]
    lines += ["## What comes out", "", *(f"- {line}" for line in made.outcome), ""]
    lines += ["## Parameters", "", *(f"- {line}" for line in item.parameters), ""]
    lines += ["## Assumed, because the paper does not print it", ""]
    lines += [f"- {a.what}: {a.taken}. Why: {a.why}." for a in item.assumed] or ["- nothing"]
    return "\n".join(lines) + "\n"


MANOEUVRE = (
    "Table 1: V = 25 m/s, g = 9.81 m/s², χ(0) = π/3, γ(0) = π/4, references χ_c = 0 and "
    "γ_c = π/12, 20 s",
    "Table 1: φ within ±π/4, n_z within ±2.1",
)
"""Parameters of every flight."""

TABLE_1_DISTURBANCE = "Table 1: d_χ = 0.1 sin(0.15 t), d_γ = 0.1 cos(0.15 t) rad/s"

PRINTED_STAR = (
    "K_P* = [1.6968, 0.5906; −0.5906, 1.9556], K_I* = [3.4869, 0.1784; −0.1784, 3.4869] as printed"
)

FAMILY = "Table 2: K = K* − ε (I, I), ε = −4, −2, −1, 0.5, 0.8, 1 for K1 to K6"
