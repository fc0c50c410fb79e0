"""What the indicators of a matrix of one's own say when they are printed."""

import flighttune as ft


def test_indicators_of_a_diagonal_matrix_are_printed_with_its_eigenvalues():
    """``Q = diag(1/4, 1)`` solves its Lyapunov equation, so that R_K is 1 1/s."""
    said = " ".join(str(ft.loop.indicators([[-2.0, 0.0], [0.0, -0.5]])).split())

    assert said.startswith("Stable: the squared norm of states and errors decays at 1 1/s")
    assert "the slowest eigenvalue at 0.5 1/s." in said
    assert said.endswith("-0.5 0 -2 0")


def test_an_unstable_matrix_is_named_with_its_eigenvalue():
    said = str(ft.loop.indicators([[1.0, 0.0], [0.0, -1.0]]))

    assert said.startswith(
        "Not stable: The eigenvalue 1+0j 1/s is not in the open left half plane."
    )
