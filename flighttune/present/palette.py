"""Line style of each run: one in 3D, plots, figures and text, safe for colour-blind readers."""

from collections.abc import Iterable
from dataclasses import dataclass

HUES = (
    (("#2386E5", "blue"), ("#BBCFFD", "light blue")),
    (("#A54A08", "rust"), ("#F29C66", "apricot")),
    (("#027746", "green"), ("#78F5AC", "mint")),
    (("#C91B8B", "magenta"), ("#DAA1B8", "rose")),
    (("#929E08", "olive"), ("#E4E069", "yellow")),
    (("#534EDD", "indigo"), ("#BBA5FF", "lavender")),
)
"""A strong and a light shade of each hue, chosen so that any two of twelve differ by 17 or more
(CIE 1976) as seen with normal sight, protanopia, deuteranopia and tritanopia."""

MORE = (
    ("#B81FAD", "purple"),
    ("#85D600", "leaf"),
    ("#7A1FFF", "violet"),
    ("#D6FF3D", "lime"),
    ("#B8FFFF", "ice"),
    ("#EB66C2", "pink"),
)
"""For more than twelve runs: as far from the twelve and from each other as those are."""

NEUTRAL = "#8C8C8C"
"""References: readable on a dark and on a white ground."""

LIMIT = "#E0475B"
"""Limit lines."""


@dataclass(frozen=True, slots=True)
class LineStyle:
    """How one run is drawn.

    Attributes
    ----------
    colour : str
        ``#RRGGBB``.
    name : str
        The colour in a word or two, for text.
    width : float, points
        Line width: the last plant of a scenario is drawn strongest.
    dashed : bool
        Whether a figure on white paper should break the line, because the shade is light.
    """

    colour: str
    name: str
    width: float
    dashed: bool

    @property
    def rgb(self) -> tuple[int, int, int]:
        """Red, green and blue, 0 to 255."""
        return rgb(self.colour)


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue (0 to 255) of ``#RRGGBB``."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def line_styles(pairs: Iterable[tuple[str, str]]) -> dict[tuple[str, str], LineStyle]:
    """Line style of each pair of plant and gain set.

    Parameters
    ----------
    pairs : iterable of (str, str)
        Plant and gain set of each run, in the order of the scenario.

    Returns
    -------
    dict
        By pair. With at most two plants and six gain sets the hue stands for the gain set and the
        shade for the plant: the last plant has the strong one. Otherwise up to eighteen pairs have
        a colour each in order, and more begin again.
    """
    pairs = list(dict.fromkeys(pairs))
    plants = list(dict.fromkeys(plant for plant, _ in pairs))
    gains = list(dict.fromkeys(name for _, name in pairs))
    by_hue = hue_tells_gains(pairs)
    strong, light = zip(*HUES, strict=True)
    colours = (*strong, *light, *MORE)
    found = {}
    for order, (plant, name) in enumerate(pairs):
        place = order % len(colours)
        if by_hue:
            place = gains.index(name) + len(strong) * (len(plants) - 1 - plants.index(plant))
        colour, word = colours[place]
        width = 2.2 if place < len(strong) else 1.5
        found[plant, name] = LineStyle(colour, word, width, colours[place] in light)
    return found


def hue_tells_gains(pairs: Iterable[tuple[str, str]]) -> bool:
    """Whether `line_styles` gives every gain set of `pairs` (plant, gain set) a hue of its own."""
    pairs = set(pairs)
    plants, gains = {plant for plant, _ in pairs}, {name for _, name in pairs}
    return len(plants) <= 2 and len(gains) <= len(HUES)
