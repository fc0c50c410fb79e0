"""A run with a made-up claim around its signals."""

from dataclasses import replace

import numpy as np

import flighttune as ft
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.flight.loop.run import Bounds, RunClaim

SENTENCE = "of 9 flights 1 lies outside"


def claimed(run: ft.Run, kind: str = "counted", title: str = "counted band", **ends) -> ft.Run:
    """The run with lower and upper bounds (SI, constants or arrays) around some signals."""
    low, high = (
        np.column_stack([np.broadcast_to(pair[side], len(run.t)) for pair in ends.values()])
        for side in (0, 1)
    )
    claim = RunClaim(
        kind=kind,
        title=title,
        sentence=SENTENCE,
        bounds=Bounds(run.t, low, high, tuple(ends)),
        units={name: SIGNAL_UNITS[name] for name in ends},
    )
    return replace(run, claims=(*run.claims, claim))
