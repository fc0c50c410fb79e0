"""The items that can be made again, described in ``items.toml`` in the order of the paper.

To add one, describe it there, and put the function that makes it, under its name, into a module of
this folder.
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from flighttune.errors import InputError
from flighttune.files.shipped import nearest_name
from flighttune.paper import parameters as printed
from flighttune.paper.items import flights, gains, oscillator
from flighttune.paper.items.base import Made
from flighttune.paper.study import Study

# Functions by name: an item is made by that of its own name.
MAKERS = {**vars(oscillator), **vars(gains), **vars(flights)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A table or figure of the paper that can be made again."""

    name: str  # as on the command line: the label in the paper's source
    title: str
    printed: str  # where it stands in the paper
    make: Callable[[Study], Made]  # from a study to the item as computed
    parameters: list[str]  # the printed parameters used, a line each
    # What the paper does not print: what is missing, what was taken instead, and why
    assumed: list[dict[str, str]]
    outcome: list[str]  # the results, a sentence each, with braces where `Made` has the numbers
    captions: Mapping[str, str]  # captions of the figures by file name, with braces as well

    def filled_in(self, text: str, output: Made) -> str:
        """A caption or a sentence of the outcome with the numbers as computed."""
        return text.format(printed=printed, values=output.values, **output.numbers)

    def text(self, output: Made) -> str:
        """The short text of the item, Markdown."""
        assumed = ["{what}: {taken}. Why: {why}.".format(**choice) for choice in self.assumed]
        parts = [f"# {self.name}: {self.title}\n\n{self.printed} of arXiv 2411.13140.\n"]
        for title, lines in (
            ("What comes out", [self.filled_in(line, output) for line in self.outcome]),
            ("Parameters", self.parameters),
            ("Assumed, because the paper does not print it", assumed or ["nothing"]),
        ):
            parts.append(f"## {title}\n\n" + "".join(f"- {line}\n" for line in lines))
        return "\n".join(parts)


def _described() -> dict[str, Item]:
    """Each item of ``items.toml`` with its maker."""
    text = tomllib.loads(Path(__file__).with_name("items.toml").read_text(encoding="utf-8"))
    assumptions = {
        name: {key: words.format(**vars(printed)) for key, words in entry.items()}
        for name, entry in text["assumption"].items()
    }
    items = {}
    for name, entry in text["item"].items():
        entry["parameters"] = [text["parameter"][key] for key in entry["parameters"]]
        entry["assumed"] = [assumptions[key] for key in entry["assumed"]]
        items[name] = Item(name=name, make=MAKERS[name], **entry)
    return items


# By name, in the order of the paper.
ITEMS = _described()


def chosen(names: Sequence[str]) -> list[Item]:
    """Items by name in the order of the paper; all for no names."""
    for name in names:
        if name not in ITEMS:
            listed = ", ".join(ITEMS)
            raise InputError(
                f"`ITEM` must be one of {listed}, got {name}{nearest_name(name, ITEMS)}"
            )
    return [item for item in ITEMS.values() if not names or item.name in names]
