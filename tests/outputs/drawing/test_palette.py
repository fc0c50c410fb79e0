"""Colours must differ for every kind of sight, as the model of Machado et al. (2009) shows them."""

import itertools
import re

import numpy as np
import pytest
from drawn import drawn
from made_up import made_up_run

import flighttune as ft

SMALLEST_DIFFERENCE = 17.0
"""CIE 1976 colour difference; 2.3 is just noticeable."""

ON_LIGHT, ON_DARK = 2.5, 3.6
"""Lowest contrast of a line on a light and on a dark page."""

OF_MANY = 12.0
"""The same where there are more than twelve runs."""

ONE_STEP = 1.5
"""Of 255, by rounding."""

GROUNDS = {"#0D0D0D": 3.0, "#FFFFFF": 2.5}
"""Grounds of the viewer in its two themes, and the lowest contrast (WCAG 2.1) on each."""

SIGHT = {
    "normal": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
"""G. M. Machado, M. M. Oliveira, L. A. F. Fernandes, A Physiologically-based Model for Simulation
of Color Vision Deficiency, IEEE TVCG 15(6), 2009, severity 1.0, on linear RGB."""

XYZ_OF_RGB = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


def plot(*pairs):
    """A plot of runs by their plants and gain sets."""
    signals = {x: [0.0, 1.0] for x in ("chi_err", "gamma_err", "phi", "n_z")}
    return ft.plot([made_up_run(signals, [0.0, 1.0], plant=a, gains_name=b) for a, b in pairs])


def looks(*pairs):
    """Colour, width and dashes of the line of each run, in a page's pixels."""
    made = plot(*pairs)
    chart, colours = drawn(made.svg())[0], [x[1] for x in made.charts[0].legend]
    lines = [one for one in chart.paths if one.get("data-run")]
    return [
        (colour, float(line.get("stroke-width")), line.get("stroke-dasharray") or "")
        for colour, line in zip(colours, lines, strict=True)
    ]


STYLE = plot(("p", "g")).svg()
LIGHT, DARK = (
    dict(re.findall(r"--([\w-]+): (#[0-9A-F]{6})", theme))
    for theme in re.findall(r"svg\.sheet \{ (.*?)\}", STYLE)
)
"""Colours of the two themes of a page by the names of their variables."""
EIGHTEEN = [colour for colour, *_ in looks(*(("p", f"g{k}") for k in range(18)))]
PLANTS = [colour for colour, *_ in looks(*((f"p{k}", "g") for k in range(4)))]


def rgb(colour):
    return [int(colour[i : i + 2], 16) for i in (1, 3, 5)]


def linear(colour):
    share = np.array(rgb(colour)) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def lab(light):
    x = XYZ_OF_RGB @ np.clip(light, 0.0, 1.0) / XYZ_OF_RGB.sum(axis=1)
    f = np.where(x > 216.0 / 24389.0, np.cbrt(x), (24389.0 / 27.0 * x + 16.0) / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", SIGHT)
def test_colours_can_be_told_apart_and_from_references_and_limits(sight):
    seen = [lab(np.array(SIGHT[sight]) @ linear(colour)) for colour in EIGHTEEN]
    marks = [
        lab(np.array(SIGHT[sight]) @ linear(colour))
        for colour in (LIGHT["neutral"], LIGHT["limit"])
    ]

    def smallest(colours):
        return min(np.linalg.norm(a - b) for a, b in colours)

    assert smallest(itertools.combinations(seen[:12], 2)) >= SMALLEST_DIFFERENCE
    assert smallest(itertools.combinations(seen, 2)) >= OF_MANY
    assert smallest(itertools.product(seen[12:], marks)) >= OF_MANY
    rungs = [lab(np.array(SIGHT[sight]) @ linear(colour)) for colour in PLANTS]
    assert smallest(itertools.combinations(rungs, 2)) >= OF_MANY


def line_in(colour):
    """A line of a plot in a colour."""
    made = plot(("p", "g"))
    made.charts[0].line([0, 1], [0, 1], colour)
    return made.charts[0].svg().split("<path ")[-2]


def contrast(colour, ground):
    light, dark = (XYZ_OF_RGB[1] @ linear(one) + 0.05 for one in (colour, ground))
    return max(light, dark) / min(light, dark)


@pytest.mark.parametrize("colour", [*EIGHTEEN, *PLANTS])
def test_every_colour_stands_out_from_the_viewer_and_from_both_pages_with_its_hue(colour):
    (name,) = re.findall(r"stroke=\"var\(--([\w-]+)\)\"", line_in(colour))
    on_light, on_dark = LIGHT[name], DARK[name]

    for ground, least in GROUNDS.items():
        assert contrast(colour, ground) >= least
    original = np.array(rgb(colour), float)
    for shown, page, least in ((on_light, LIGHT, ON_LIGHT), (on_dark, DARK, ON_DARK)):
        found = contrast(shown, page["paper"])
        assert found > 0.99 * least
        if contrast(colour, page["paper"]) >= least:
            assert shown == colour
        else:  # no further from the colour than it must be
            assert found < 1.09 * least
    channels, lighter = np.array(rgb(on_light), float), np.array(rgb(on_dark), float)
    along = channels @ original / (original @ original)
    assert channels == pytest.approx(along * original, abs=ONE_STEP)
    from_white = (255.0 - lighter) @ (255.0 - original) / ((255.0 - original) @ (255.0 - original))
    assert 255.0 - lighter == pytest.approx(from_white * (255.0 - original), abs=ONE_STEP)


def test_styles_tell_gains_by_hue_and_plants_by_shade():
    """A line has 0.85 of its width in points; light shades are thinner and dashed for print."""
    strong, light, more = EIGHTEEN[:6], EIGHTEEN[6:12], EIGHTEEN[12:]
    thick, thin = 0.85 * 2.2, 0.85 * 1.5

    def styles(colours, width, dash=""):
        return [(x, pytest.approx(width), dash) for x in colours]

    both = [(p, f"g{k}") for p in ("law", "craft") for k in range(6)]
    assert looks(*both) == [*styles(light, thin, "5 3"), *styles(strong, thick)]
    assert looks(*both[6:]) == styles(strong, thick)
    # where hues do not suffice, runs have a colour each in their order, and it begins again
    every = [("p", f"g{k}") for k in range(19)]
    wanted = [*styles(strong, thick), *styles(light, thin, "5 3"), *styles(more, thin)]
    assert looks(*every) == [*wanted, wanted[0]]
    three = [(f"p{i}", f"g{k}") for i in range(3) for k in range(2)]
    assert looks(*three) == styles(strong, thick)
    # one gain set on several plants: colours that no gain set has, the last plant the thickest
    assert not {*PLANTS} & {*EIGHTEEN}
    for n in (3, 4):
        used = [*PLANTS[: n - 1], PLANTS[-1]]
        ladder = looks(*((f"p{k}", "g") for k in range(n)))
        assert ladder == [*styles(used[:-1], thin), *styles(used[-1:], thick)]
    assert looks(("p0", "g"), ("p1", "g")) == [
        *styles(light[:1], thin, "5 3"),
        *styles(strong[:1], thick),
    ]
    five = looks(*((f"p{k}", "g") for k in range(5)))
    assert five == styles(strong[:5], thick)
