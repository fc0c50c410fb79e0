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
    ("#85D600", "leaf"),
    ("#7A1FFF", "violet"),
    ("#B8FFFF", "ice"),
    ("#EB66C2", "pink"),
    ("#B81FAD", "purple"),
    ("#D6FF3D", "lime"),
)
"""For more than twelve runs, and for the plants of a gap, so that no plant has the colour of gains:
as far from the twelve and from each other as those are."""

NEUTRAL = "#8C8C8C"
"""References: readable on a dark and on a white ground."""

LIMIT = "#E0475B"
"""Limit lines."""

INK = "#222222"
"""What stands out without being a run: sums, the reach of a loop."""

LEAST_CONTRAST, ON_DARK = 2.5, 3.6
"""Of a line against the ground of a page; on a dark one more, or strong shades look like shadows
of the light ones."""

LIGHT = {"paper": "#FFFFFF", "ink": "#1D2329", "soft": "#56606A", "grid": "#E4E7EA"}
DARK = {"paper": "#14181C", "ink": "#E6E9EC", "soft": "#A3ADB6", "grid": "#2A3138"}
"""Grounds and texts of the two themes of a page."""


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
        shade for the plant: the last plant has the strong one. One gain set on more plants, as in a
        gap, has colours that stand for no gain set. Otherwise up to eighteen pairs have a colour
        each in order, and more begin again.
    """
    pairs = list(dict.fromkeys(pairs))
    plants = list(dict.fromkeys(plant for plant, _ in pairs))
    gains = list(dict.fromkeys(name for _, name in pairs))
    by_hue = hue_tells_gains(pairs)
    strong, light = zip(*HUES, strict=True)
    alone = len(gains) == 1 and len(plants) > 2
    colours = (*MORE, *strong, *light) if alone else (*strong, *light, *MORE)
    found = {}
    for order, (plant, name) in enumerate(pairs):
        place = order % len(colours)
        if by_hue:
            place = gains.index(name) + len(strong) * (len(plants) - 1 - plants.index(plant))
        colour, word = colours[place]
        width = 2.2 if place < len(strong) or alone else 1.5
        found[plant, name] = LineStyle(colour, word, width, colours[place] in light)
    return found


def css_colour(colour: str) -> str:
    """A colour of the palette as a CSS variable, which follows the theme of the page."""
    name = _VARIABLES.get(colour.upper())
    return f"var(--{name})" if name else colour


def css_variables() -> str:
    """CSS that sets the variables of `css_colour` for a light page, a dark one and print."""

    def theme(grounds: dict[str, str]) -> str:
        known = {name: visible(colour, grounds["paper"]) for colour, name in _VARIABLES.items()}
        colours = {**known, **grounds}
        return "; ".join(f"--{name}: {colour}" for name, colour in colours.items())

    return (
        f":root {{ color-scheme: light dark; {theme(LIGHT)} }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {theme(DARK)} }} }}"
    )


def visible(colour: str, ground: str) -> str:
    """`colour`, darkened or lightened until a line of it can be seen on a ground.

    Parameters
    ----------
    colour, ground : str
        ``#RRGGBB``. On a light ground the hue stays; on a dark one it fades towards white.
    """
    below, channels = rgb(ground), tuple(map(float, rgb(colour)))
    dark = _luminance(below) < 0.2
    while contrast(channels, below) < (ON_DARK if dark else LEAST_CONTRAST):
        channels = tuple(c + 0.03 * (255.0 - c) if dark else 0.97 * c for c in channels)
    red, green, blue = (round(value) for value in channels)
    return f"#{red:02X}{green:02X}{blue:02X}"


def contrast(one: Iterable[float], other: Iterable[float]) -> float:
    """Contrast ratio of WCAG 2 between two colours (red, green and blue, 0 to 255), 1 to 21."""
    dark, light = sorted((_luminance(one), _luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def _luminance(channels: Iterable[float]) -> float:
    parts = (value / 255.0 for value in channels)
    linear = (p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return sum(w * p for w, p in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


_VARIABLES = {
    colour.upper(): name.replace(" ", "-")
    for colour, name in (
        *(shade for hue in HUES for shade in hue),
        *MORE,
        (NEUTRAL, "neutral"),
        (LIMIT, "limit"),
        (INK, "ink"),
    )
}
"""Name of the CSS variable of each colour."""


def hue_tells_gains(pairs: Iterable[tuple[str, str]]) -> bool:
    """Whether `line_styles` gives every gain set of `pairs` (plant, gain set) a hue of its own."""
    pairs = set(pairs)
    plants, gains = {plant for plant, _ in pairs}, {name for _, name in pairs}
    return len(plants) <= 2 and len(gains) <= len(HUES)
