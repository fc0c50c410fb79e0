"""Line style of each run, equal in 3D, plots, figures and text, safe for colour-blind readers."""

from collections.abc import Iterable
from typing import NamedTuple

# A strong and a light shade of each hue, for dark and light backgrounds of the viewer and for
# paper. Any two of twelve differ by 19 or more (CIE 1976) for normal sight, protanopia,
# deuteranopia and tritanopia. All have a contrast of at least 3 to black and 2.5 to white (WCAG).
HUES = (
    (("#354FD8", "blue"), ("#8AA0EB", "light blue")),
    (("#9F4338", "rust"), ("#D88F59", "apricot")),
    (("#0B7973", "green"), ("#48B38B", "mint")),
    (("#9E2AA3", "magenta"), ("#CA91BD", "rose")),
    (("#7F6903", "olive"), ("#9AA701", "lime")),
    (("#7807FF", "violet"), ("#A07CFF", "lavender")),
)

# For more than twelve runs: they differ by at least 12 from the twelve and from each other.
MORE = (
    ("#C9459F", "pink"),
    ("#C318FF", "purple"),
    ("#B61F54", "crimson"),
    ("#0081CF", "azure"),
    ("#51607F", "slate"),
    ("#A58829", "brass"),
)

# For one gain set on more than two plants, such as the rungs from law to aircraft: colours that no
# gain set has.
PLANTS = (("#7C8794", "grey"), ("#A99BC9", "lilac"), ("#8A5FBF", "plum"), ("#C77700", "amber"))

# References: readable on dark and white backgrounds.
NEUTRAL = "#8C8C8C"

# Limit lines.
LIMIT = "#E0475B"

# Colour of emphasised marks that are not runs: sums, the reach of a loop.
INK = "#222222"

# Contrast of a line on the background of a page. A dark page needs more, or strong shades look like
# shadows of the light shades.
MIN_CONTRAST, ON_DARK = 2.5, 3.6

# Background and text colours of the two themes of a page.
LIGHT = {"paper": "#FFFFFF", "ink": "#1D2329", "soft": "#56606A", "grid": "#E4E7EA"}
DARK = {"paper": "#14181C", "ink": "#E6E9EC", "soft": "#A3ADB6", "grid": "#2A3138"}


class LineStyle(NamedTuple):
    """Style of the line of one run."""

    colour: str  # #RRGGBB
    name: str  # name of the colour
    width: float  # line width, points; the last plant of a scenario has the widest line
    dashed: bool  # whether figures on white paper dash the line, because the shade is light

    @property
    def rgb(self) -> tuple[int, int, int]:
        """Red, green and blue, 0 to 255."""
        return rgb(self.colour)


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue (0 to 255) of ``#RRGGBB``."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def line_styles(pairs: Iterable[tuple[str, str]]) -> dict[tuple[str, str], LineStyle]:
    """Line style of each pair of plant and gain set, in the order of the scenario."""
    pairs = list(dict.fromkeys(pairs))
    plants = list(dict.fromkeys(plant for plant, _ in pairs))
    gains = list(dict.fromkeys(name for _, name in pairs))
    by_hue = hue_tells_gains(pairs)
    if len(gains) == 1 and 2 < len(plants) <= len(PLANTS):
        shades = dict(zip(plants, PLANTS[: len(plants) - 1] + PLANTS[-1:], strict=True))
        return {
            (plant, name): LineStyle(*shades[plant], 2.2 if plant == plants[-1] else 1.5, False)
            for plant, name in pairs
        }
    strong, light = zip(*HUES, strict=True)
    colours = (*strong, *light, *MORE)
    styles = {}
    for order, (plant, name) in enumerate(pairs):
        place = order % len(colours)
        if by_hue:
            place = gains.index(name) + len(strong) * (len(plants) - 1 - plants.index(plant))
        colour, word = colours[place]
        width = 2.2 if place < len(strong) else 1.5
        styles[plant, name] = LineStyle(colour, word, width, colours[place] in light)
    return styles


def css_colour(colour: str) -> str:
    """A colour of the palette as a CSS variable, which follows the theme of the page."""
    name = _VARIABLES.get(colour.upper())
    return f"var(--{name})" if name else colour


def css_variables() -> str:
    """CSS that sets the variables of `css_colour` for a light page, a dark one and print."""

    def theme(grounds: dict[str, str]) -> str:
        visible_colours = {
            name: visible(colour, grounds["paper"]) for colour, name in _VARIABLES.items()
        }
        colours = {**visible_colours, **grounds}
        return "; ".join(f"--{name}: {colour}" for name, colour in colours.items())

    return (
        f":root {{ color-scheme: light dark; {theme(LIGHT)} }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {theme(DARK)} }} }}"
    )


def visible(colour: str, ground: str) -> str:
    """`colour`, darkened or lightened until its line is visible on a background."""
    below, channels = _luminance(rgb(ground)), tuple(map(float, rgb(colour)))
    # Contrast of WCAG 2: (lighter + 0.05) / (darker + 0.05).
    if below < 0.2:
        while _luminance(channels) + 0.05 < ON_DARK * (below + 0.05):
            channels = tuple(c + 0.03 * (255.0 - c) for c in channels)
    else:
        while below + 0.05 < MIN_CONTRAST * (_luminance(channels) + 0.05):
            channels = tuple(0.97 * c for c in channels)
    red, green, blue = (round(value) for value in channels)
    return f"#{red:02X}{green:02X}{blue:02X}"


def _luminance(channels: Iterable[float]) -> float:
    """Relative luminance of WCAG 2 (red, green and blue, 0 to 255), 0 to 1."""
    parts = (value / 255.0 for value in channels)
    linear = (p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return sum(w * p for w, p in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


# Name of the CSS variable of each colour.
_VARIABLES = {
    colour.upper(): name.replace(" ", "-")
    for colour, name in (
        *(shade for hue in HUES for shade in hue),
        *MORE,
        *PLANTS,
        (NEUTRAL, "neutral"),
        (LIMIT, "limit"),
        (INK, "ink"),
    )
}


def hue_tells_gains(pairs: Iterable[tuple[str, str]]) -> bool:
    """Whether `line_styles` gives every gain set of `pairs` (plant, gain set) a hue of its own."""
    pairs = set(pairs)
    return len({plant for plant, _ in pairs}) <= 2 and len({name for _, name in pairs}) <= len(HUES)
