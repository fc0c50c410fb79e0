"""Long lines in few points keep their peaks."""

import numpy as np

from flighttune.present.chart import MAX_DRAWN, peaks, thinned


def test_a_long_line_keeps_ends_and_every_single_spike():
    t = np.arange(50_000)
    lines = np.column_stack([np.sin(t / 3000.0), np.zeros(len(t))])
    spikes = [7, 12_345, 33_333, 49_998]
    lines[spikes, 1] = [5.0, -5.0, 3.0, -2.0]

    kept = peaks(lines, most=1000)

    assert {0, 49_999, *spikes} <= set(kept.tolist())
    assert np.all(np.diff(kept) > 0)
    assert len(kept) <= 2 * 1000 + 2
    assert np.abs(np.interp(t, kept, lines[kept, 0]) - lines[:, 0]).max() < 0.02


def test_a_thinned_line_keeps_its_peaks_its_gaps_and_its_ends():
    t = np.linspace(0.0, 600.0, 30001)
    y = np.where((t > 100.0) & (t < 101.0), np.nan, np.sin(t))
    y[12345], y[23456] = 9.0, -9.0

    x, values = thinned(t, y)

    assert len(x) <= MAX_DRAWN + 10
    assert (np.nanmax(values), np.nanmin(values)) == (9.0, -9.0)
    assert (x[0], x[-1]) == (t[0], t[-1])
    assert (np.diff(x) > 0.0).all()
    assert np.isnan(values[(x > 99.0) & (x < 102.0)]).any()
