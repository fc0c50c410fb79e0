"""Sentences of many flights, those that differ in numbers alone put together."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|(?<=[\s=])-?(?:inf|nan)\b")


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """What several flights say in the same words, with other numbers.

    Attributes
    ----------
    text : str
        With an ellipsis in place of each number that they do not share.
    count : int
    run : int
        The first of them.
    example : str
        What that one says.
    """

    text: str
    count: int
    run: int
    example: str


def reasons(texts: Sequence[str], runs: Sequence[int]) -> tuple[Reason, ...]:
    """Group sentences that differ in their numbers alone, the most frequent first.

    Parameters
    ----------
    texts : sequence of str
        Empty ones are left out.
    runs : sequence of int
        Run of each.
    """
    found: dict[str, list[int]] = {}
    for place, text in enumerate(texts):
        if text:
            found.setdefault(_NUMBER.sub("…", text), []).append(place)
    grouped = [
        Reason(
            text=_shared([texts[place] for place in at]),
            count=len(at),
            run=int(runs[at[0]]),
            example=texts[at[0]],
        )
        for at in found.values()
    ]
    return tuple(sorted(grouped, key=lambda one: (-one.count, one.run)))


def _shared(texts: Sequence[str]) -> str:
    """The words of texts that differ in numbers alone, and the numbers that are the same."""
    told = zip(*(_NUMBER.findall(text) for text in texts), strict=True)
    numbers = iter([one[0] if len(set(one)) == 1 else "…" for one in told])
    return _NUMBER.sub(lambda _: next(numbers), texts[0])
