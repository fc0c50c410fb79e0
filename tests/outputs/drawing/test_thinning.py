"""Long lines in few points keep their peaks."""

import numpy as np

from flighttune.outputs.drawing import chart


def test_a_thinned_line_keeps_its_peaks_its_gaps_and_its_ends():
    t = np.linspace(0.0, 600.0, 30001)
    y = np.where((t > 100.0) & (t < 101.0), np.nan, np.sin(t))
    y[12345], y[23456] = 9.0, -9.0
    y[1:3] = y[-3:-1] = -2.0, 2.0  # the ends are no peaks of their stretches

    x, values = chart.thinned(t, y)

    assert len(x) <= chart.MAX_DRAWN + 10
    assert (np.nanmax(values), np.nanmin(values)) == (9.0, -9.0)
    assert (x[0], x[-1]) == (t[0], t[-1])
    assert (np.diff(x) > 0.0).all()
    assert np.isnan(values[(x > 99.0) & (x < 102.0)]).any()
