"""The example of docs/theory.md: a loop of the reader's own matrices, without names."""

import re

import numpy as np
import pytest
from places import ROOT
from scipy.linalg import solve_continuous_lyapunov

import flighttune as ft

PAGE = ROOT / "docs" / "theory.md"


def test_the_loop_of_own_matrices_has_the_rate_of_its_lyapunov_equation(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names = {}
    exec(compile(block, "theory.md", "exec"), names)

    assert capsys.readouterr().out.splitlines()[-1] == "True"
    A_K = np.array([[0, 1, 0], [-6, -3, 6], [-1, 0, 0]])  # [[A + B K_P C, B K_I], [C, 0]]
    Q = solve_continuous_lyapunov(A_K.T, -np.eye(3))
    assert names["certified"].indicators.R_K == pytest.approx(
        1.0 / np.linalg.eigvalsh(Q).max(), rel=1e-9
    )


def test_channels_without_names_are_those_of_flight_or_numbered():
    two = ft.loop.LinearModel(A=np.zeros((2, 2)), B=np.eye(2), C=-np.eye(2))
    three = ft.loop.LinearModel(A=np.zeros((3, 3)), B=np.eye(3), C=-np.eye(3))

    ft.loop.closed_loop(two, ft.PAPER_GAINS)
    assert (three.states, three.inputs) == (("x1", "x2", "x3"), ("u1", "u2", "u3"))
    with pytest.raises(ft.InputError, match=r"shape \(3, 3\) \(inputs, errors\), got \(2, 2\)"):
        ft.loop.closed_loop(three, ft.PAPER_GAINS)
