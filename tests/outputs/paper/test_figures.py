"""Figures of the reproduction, read back from their files, against the printed numbers."""

import math

import numpy as np
import pytest
from commands import flighttune
from drawn import drawn
from scipy.linalg import solve_continuous_lyapunov

G_OVER_V, GAMMA_C = 9.81 / 25.0, math.pi / 12.0
K_P = np.array([[1.6968, 0.5906], [-0.5906, 1.9556]])
K_I = np.array([[3.4869, 0.1784], [-0.1784, 3.4869]])
# R_K, I_K and epsilon of the gain sets, Table 2.
SETS = {
    "K1": (0.7742, 7.873, -4.0), "K2": (0.6754, 6.057, -2.0), "K3": (0.5913, 5.312, -1.0),
    "K4": (0.3626, 5.207, 0.5), "K5": (0.2849, 6.161, 0.8), "K6": (0.2192, 8.258, 1.0),
}  # fmt: skip
STAR = 0.4427, 4.9244
COMPUTED = 4.91615
"""I_K of K*."""


def loop(epsilon=0.0):
    """The linear loop with K* - epsilon (I, I) around a climb of 15 deg."""
    shift = epsilon * np.eye(2)
    A = np.diag([0.0, G_OVER_V * math.sin(GAMMA_C)])
    K = [-G_OVER_V * (K_P - shift), -G_OVER_V * (K_I - shift)]
    return np.block([[A + K[0], K[1]], [np.eye(2), np.zeros((2, 2))]])


def rate(epsilon):
    Q = solve_continuous_lyapunov(loop(epsilon).T, -np.eye(4))
    return 1.0 / np.linalg.eigvalsh(Q)[-1]


@pytest.fixture(scope="module")
def figure(tmp_path_factory):
    """Charts of a figure by its name."""
    folder = tmp_path_factory.mktemp("paper")
    flighttune("reproduce", "fig2", "gains", "table2", "eigenvalues", "--out", folder)
    return lambda name: drawn((folder / f"{name}.svg").read_text(encoding="utf-8"))


def test_eigenvalues_and_the_disturbance_are_drawn_on_their_axes(figure):
    plane, history = figure("fig2")
    assert (plane.x_ends, plane.y_ends) == ([-0.6, 0.1], [-1.6, 1.6])
    ((x, y, _),) = plane.points()
    found = np.sort_complex(x + 1j * y)
    assert found == pytest.approx(np.sort_complex(np.linalg.eigvals(loop())), abs=0.01)
    (axis,) = plane.lines()
    assert axis[0] == pytest.approx([0.0, 0.0], abs=0.001)
    assert history.x_ends == [0.0, 20.0]
    for (t, d), wave in zip(history.lines(), (np.sin, np.cos), strict=True):
        assert len(t) == 401
        assert d == pytest.approx(0.1 * wave(0.15 * t), abs=1e-3)


def test_gain_sets_stand_at_their_indicators_on_the_curve_of_all_shifts(figure):
    (chart,) = figure("gains")
    assert (chart.x_ends, chart.y_ends, chart.height) == ([0.15, 0.85], [4.5, 10.0], 256.0)
    curve, level = chart.lines()[0], chart.lines()[1]
    assert level[1] == pytest.approx([STAR[1]] * 2, abs=0.01)
    wanted = [rate(e) for e in np.linspace(-6.0, 1.25, 300)]
    inside = np.abs(np.array(wanted) - 0.5) < 0.35
    # beyond the axis a curve goes on to ten times its length
    assert len(curve[0]) == 300
    assert curve[0][inside] == pytest.approx(np.array(wanted)[inside], abs=2e-3)
    marks = [(float(x[0]), float(y[0])) for x, y, _ in chart.points()]
    for R_K, I_K in [(a, b) for a, b, _ in SETS.values()] + [(rate(0.0), COMPUTED), STAR]:
        assert any(m == pytest.approx((R_K, I_K), abs=0.012) for m in marks), (R_K, I_K)
    crosses = [one[0].get("d") for one in chart.dots if one[0].tag == "path"]
    assert [d for d in crosses if d.endswith("l10,-10")]
    assert [d for d in crosses if "h12" in d and "v12" in d]
    assert {*SETS, "K*"} == {*chart.texts()}
    for chart, place in zip(figure("table2"), (0, 1), strict=True):
        assert chart.x_ends == pytest.approx([-4.5 - 0.05 * 5.65, 1.15 + 0.05 * 5.65], rel=1e-4)
        ((x, y),) = [line for line in chart.lines() if len(line[0]) > 2]
        assert (x[0], x[-1], len(x)) == (
            pytest.approx(-4.5, abs=0.01), pytest.approx(1.15, abs=0.01), 300,
        )  # fmt: skip
        for numbers in SETS.values():
            assert np.interp(numbers[2], x, y) == pytest.approx(numbers[place], abs=0.02)
        points = [(float(a[0]), float(b[0])) for a, b, _ in chart.points()]
        for R_K, I_K, epsilon in (*SETS.values(), (*STAR, 0.0)):
            at = epsilon, (R_K, I_K)[place]
            assert any(p == pytest.approx(at, abs=0.012) for p in points), at


def test_bars_are_differences_in_last_digits_and_shares_of_limits(figure):
    for chart, place in zip(figure("gains_indicators"), (0, 1), strict=True):
        assert (chart.log, chart.y_ends) == ("y", [0.001, 1000.0])
        middle, low, high = chart.bars()
        assert middle == pytest.approx(np.arange(7.0), abs=0.02)
        assert low == pytest.approx([1e-3] * 7, rel=0.01)
        (level,) = [y for x, y in chart.lines() if len(x) == 2]
        assert level == pytest.approx([1.0, 1.0], rel=0.02)
        told = [float(x) for x in chart.texts()]
        for (name, numbers), size, top in zip(SETS.items(), told, high, strict=False):
            unit = (1e-4, 1e-3)[place]
            if place == 0:
                wanted = abs(rate(numbers[2]) - numbers[0]) / unit
                assert size == pytest.approx(wanted, rel=0.06), name
            assert top == pytest.approx(max(size, 1e-3), rel=0.08)
        last = ((rate(0.0), COMPUTED)[place] - STAR[place]) / 1e-4
        assert told[-1] == pytest.approx(abs(last), rel=0.01)
    (chart,) = figure("gains_constraints")
    middle, low, high = chart.bars()
    groups = sorted({round(float(x)) // 4 for x in middle})
    assert groups in ([0, 1, 2, 3], [0, 1, 2, 3, 4])
    # commands at the start from errors of 60 and 30 deg against pi/4, pi/6, 2.1 and 1
    e = np.array([-math.pi / 3, math.pi / 12 - math.pi / 4])
    phi, n_z = np.abs((K_P + 0.1 * K_I) @ e)  # after a tenth of a second of integration
    shares = {float(m): float(h) for m, h in zip(middle, high, strict=True)}
    assert shares[min(shares)] == pytest.approx(phi / (math.pi / 4.0), abs=0.05)
    assert any(h == pytest.approx(n_z / 2.1, abs=0.05) for h in high)
    assert low == pytest.approx(np.zeros(len(low)), abs=0.02)
    (level,) = [y for x, y in chart.lines() if len(x) == 2]
    assert level == pytest.approx([1.0, 1.0], abs=0.02)
    assert chart.y_ends == pytest.approx([0.0, 1.05 * (1.05 * high.max())], rel=0.01)
    told = [float(x) for x in chart.texts()]
    assert sorted(told) == pytest.approx(sorted(high), abs=0.06)
