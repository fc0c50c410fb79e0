"""The frontier against optima known from elsewhere and the paper's own gains."""

import numpy as np
import pytest
from commands import flighttune
from printed import TABLE_2

import flighttune as ft

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("objective", ["E_K", "decay"])
def test_a_frontier_of_another_objective_is_refused(objective):
    changes = {"tuning.model": "identified", "tuning.objective": objective}

    with pytest.raises(ft.InputError, match=rf"`objective` .* got {objective}"):
        ft.frontier("mission", changes=changes)


def test_a_file_is_no_folder_for_a_frontier(tmp_path):
    _, err = flighttune("tune", "paper", "--frontier", "--out", tmp_path / "f.json", status=2)

    assert "f.json: `--out` must be a folder with --frontier" in err


def largest_rate(I_star):
    """Of all channels ``e'' + p e' + q e = 0`` on grids that close in: both have the same."""
    p, q = np.geomspace(0.2, 20.0, 200), np.geomspace(0.2, 20.0, 200)
    for _ in range(3):
        P, Q = np.meshgrid(p, q)
        A = np.stack([np.stack([-P, -Q], -1), np.stack([np.ones_like(P), 0.0 * P], -1)], -2)
        found = ft.loop.indicators_batch(A)
        rates = np.where(found.I_K <= I_star, found.R_K, 0.0)
        i, j = np.unravel_index(rates.argmax(), rates.shape)
        p, q = (x[k] * np.linspace(0.97, 1.03, 200) for x, k in ((p, j), (q, i)))
    return rates.max()


def test_a_frontier_has_the_largest_rate_for_each_radius_and_the_gains_of_table_2():
    table = ft.frontier("paper", points=3, changes={"gains": ["paper"], "expect": []}).table

    front = table[table["name"] == "frontier"]
    # from the smallest I_K to three times it, closest at first
    assert front["I_star"].to_numpy() == pytest.approx(4.8503 * 3.0 ** np.array([0, 0.25, 1]), 1e-4)
    assert (front["I_K"] <= front["I_star"] * (1.0 + 1e-9)).all()
    assert front["R_K"].to_numpy()[1:] == pytest.approx(
        [largest_rate(x) for x in front["I_star"][1:]], rel=1e-3
    )
    marked = table.set_index("name")
    for name, (_, R_K, I_K) in TABLE_2.items():
        assert tuple(marked.loc[name, ["R_K", "I_K"]]) == pytest.approx((R_K, I_K), abs=1e-3)
    assert marked["I_star"].drop("frontier").isna().all()
    K = marked.loc["paper", [f"{x}[{i},{e}]" for x in ("K_P", "K_I") for i, e in (("phi", "chi"),)]]
    assert [*K] == pytest.approx([1.6968, 3.4869])
