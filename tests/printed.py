"""Numbers as the paper prints them, arXiv 2411.13140, and the loop they make."""

import numpy as np

import flighttune as ft
from flighttune.control.inner_loop import with_input_lag
from flighttune.control.linear_model import disturbance_entry

MODEL = ft.loop.kinematic_model(V_a=25.0, gamma=np.pi / 12.0, g=9.81)
A_K = ft.loop.closed_loop(MODEL, ft.PAPER_GAINS)
E = disturbance_entry(MODEL)
L_D = 0.1 * 0.15
"""Largest rate of the disturbance of Table 1: its amplitude times its frequency, rad/s^2."""

TABLE_2 = {
    "K1": (-4.0, 0.7742, 7.873),
    "K2": (-2.0, 0.6754, 6.057),
    "K3": (-1.0, 0.5913, 5.312),
    "K4": (0.5, 0.3626, 5.207),
    "K5": (0.8, 0.2849, 6.161),
    "K6": (1.0, 0.2192, 8.258),
}
"""Table 2: epsilon, R_K and I_K by name of the gains."""

LAST_DIGIT_R, LAST_DIGIT_I = 1e-4, 1e-3
"""One unit of the last digit: the table cuts some figures and rounds others."""

MARKED = {
    "paper": ft.PAPER_GAINS,
    **{
        name: ft.PIGains(
            K_P=ft.PAPER_GAINS.K_P - epsilon * np.eye(2),
            K_I=ft.PAPER_GAINS.K_I - epsilon * np.eye(2),
        )
        for name, (epsilon, *_) in TABLE_2.items()
    },
}
"""The gains of the paper by name: K* and K* - epsilon [I I]."""


def lagged(roll=4.0, load=8.0):
    """The paper's model behind first-order lags of roll and load factor, rad/s."""
    return with_input_lag(MODEL, (roll, load))
