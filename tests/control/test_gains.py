"""Gain sets as values: equal by their numbers and names."""

from dataclasses import replace

import numpy as np

import flighttune as ft


def test_gains_are_equal_by_numbers_and_names():
    copy = ft.PIGains(K_P=ft.PAPER_GAINS.K_P.copy(), K_I=ft.PAPER_GAINS.K_I.copy())

    assert copy == ft.PAPER_GAINS
    assert hash(copy) == hash(ft.PAPER_GAINS)
    assert {ft.PAPER_GAINS: "paper"}[copy] == "paper"
    assert copy != ft.PAPER_GAINS.K_P.tolist()


def test_gains_differ_by_the_last_bit_of_a_number_and_by_a_name():
    K_I = ft.PAPER_GAINS.K_I.copy()
    K_I[0, 1] = np.nextafter(K_I[0, 1], 1.0)

    assert replace(ft.PAPER_GAINS, K_I=K_I) != ft.PAPER_GAINS
    assert replace(ft.PAPER_GAINS, inputs=("phi", "alpha")) != ft.PAPER_GAINS


def test_a_zero_has_no_sign():
    zero = np.zeros((2, 2))
    plus, minus = (ft.PIGains(K_P=one, K_I=zero) for one in (zero, -zero))

    assert plus == minus
    assert hash(plus) == hash(minus)
