"""The common style of figures: contrast on white, and lines that keep their peaks."""

import base64

import numpy as np
import pytest

from flighttune.present.figures import (
    LEAST_CONTRAST,
    MOST_POINTS,
    contrast_on_white,
    line,
    on_white,
    panel,
    svg_uri,
    thinned,
)
from flighttune.present.palette import HUES, MORE, line_styles, rgb

TWO_DIGITS = 5e-3
ONE_STEP = 1.0
"""Of 255, by rounding."""

SHADES = [shade for hue in HUES for shade, _ in hue] + [shade for shade, _ in MORE]


@pytest.mark.parametrize(
    ("colour", "ratio"),
    [("#000000", 21.0), ("#FFFFFF", 1.0), ("#777777", 4.48), ("#FF0000", 4.00), ("#767676", 4.54)],
)
def test_contrast_is_that_of_the_w3c(colour, ratio):
    assert contrast_on_white(np.array(rgb(colour), dtype=float)) == pytest.approx(
        ratio, abs=TWO_DIGITS
    )


@pytest.mark.parametrize("colour", SHADES)
def test_every_colour_can_be_seen_on_white_and_keeps_its_hue(colour):
    shown = on_white(colour)

    channels = np.array(rgb(shown), dtype=float)
    assert contrast_on_white(channels) > 0.99 * LEAST_CONTRAST
    original = np.array(rgb(colour), dtype=float)
    along = channels @ original / (original @ original)
    assert channels == pytest.approx(along * original, abs=ONE_STEP)


def test_a_thinned_line_keeps_its_peaks_and_its_ends():
    t = np.linspace(0.0, 600.0, 30001)
    y = np.sin(t)
    y[12345], y[23456] = 9.0, -9.0

    x, values = thinned(t, y)

    assert len(x) <= MOST_POINTS + 2
    assert (values.max(), values.min()) == (9.0, -9.0)
    assert (x[0], x[-1]) == (t[0], t[-1])
    assert (np.diff(x) > 0.0).all()


def test_a_thinned_line_keeps_its_gaps():
    t = np.linspace(0.0, 600.0, 30001)
    y = np.where((t > 100.0) & (t < 101.0), np.nan, 1.0)

    x, values = thinned(t, y)

    assert np.isnan(values[(x > 99.0) & (x < 102.0)]).any()


def test_a_short_line_is_drawn_as_it_is():
    t = np.linspace(0.0, 1.0, 100)

    assert thinned(t, t)[0] is t


def test_a_panel_is_an_image_that_is_part_of_the_page():
    (style,) = line_styles([("kinematic", "paper")]).values()
    with panel("Course", "χ [deg]") as axes:
        line(axes, np.arange(3.0), np.arange(3.0), style)
        uri = svg_uri(axes.get_figure())

    kind, data = uri.split(",")
    assert kind == "data:image/svg+xml;base64"
    assert b"<svg" in base64.b64decode(data)
