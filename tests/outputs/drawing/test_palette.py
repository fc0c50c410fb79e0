"""Colours must differ for every kind of sight, as the model of Machado et al. (2009) shows them."""

import itertools

import numpy as np
import pytest

from flighttune.outputs.drawing import palette

SMALLEST_DIFFERENCE = 17.0
"""CIE 1976 colour difference; 2.3 is just noticeable."""

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
COLOURS = [colour for hue in palette.HUES for colour, _ in hue]
EIGHTEEN = [*COLOURS, *(colour for colour, _ in palette.MORE)]


def linear(colour):
    share = np.array(palette.rgb(colour)) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def lab(light):
    x = XYZ_OF_RGB @ np.clip(light, 0.0, 1.0) / XYZ_OF_RGB.sum(axis=1)
    f = np.where(x > 216.0 / 24389.0, np.cbrt(x), (24389.0 / 27.0 * x + 16.0) / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", SIGHT)
def test_colours_can_be_told_apart_and_from_references_and_limits(sight):
    seen = [lab(np.array(SIGHT[sight]) @ linear(colour)) for colour in EIGHTEEN]
    marks = [
        lab(np.array(SIGHT[sight]) @ linear(colour)) for colour in (palette.NEUTRAL, palette.LIMIT)
    ]

    def smallest(colours):
        return min(np.linalg.norm(a - b) for a, b in colours)

    assert smallest(itertools.combinations(seen[:12], 2)) >= SMALLEST_DIFFERENCE
    assert smallest(itertools.combinations(seen, 2)) >= OF_MANY
    assert smallest(itertools.product(seen[12:], marks)) >= OF_MANY
    rungs = [lab(np.array(SIGHT[sight]) @ linear(colour)) for colour, _ in palette.PLANTS]
    assert smallest(itertools.combinations(rungs, 2)) >= OF_MANY


def contrast(colour, ground):
    light, dark = (XYZ_OF_RGB[1] @ linear(one) + 0.05 for one in (colour, ground))
    return max(light, dark) / min(light, dark)


@pytest.mark.parametrize("colour", [*EIGHTEEN, *(colour for colour, _ in palette.PLANTS)])
def test_every_colour_stands_out_from_the_viewer_and_from_both_pages_with_its_hue(colour):
    on_light, on_dark = (
        palette.visible(colour, ground["paper"]) for ground in (palette.LIGHT, palette.DARK)
    )

    for ground, least in GROUNDS.items():
        assert contrast(colour, ground) >= least
    assert contrast(on_light, palette.LIGHT["paper"]) > 0.99 * palette.MIN_CONTRAST
    assert contrast(on_dark, palette.DARK["paper"]) > 0.99 * palette.ON_DARK
    original, channels = (
        np.array(palette.rgb(colour), float),
        np.array(palette.rgb(on_light), float),
    )
    along = channels @ original / (original @ original)
    assert channels == pytest.approx(along * original, abs=ONE_STEP)


def test_eighteen_runs_have_a_colour_each_and_the_first_twelve_keep_theirs():
    pairs = [("plant", f"gains{k}") for k in range(19)]

    found = palette.line_styles(pairs)

    assert len({found[pair].colour for pair in pairs[:18]}) == 18
    assert found[pairs[18]] == found[pairs[0]]
    assert {pair: found[pair] for pair in pairs[:12]} == palette.line_styles(pairs[:12])
