"""Compile the kernels of aircraft and of navigation once, and not in each process of the tests."""

import flighttune as ft
from flighttune.flight.loop import loop

loop.COMPILED_FROM = 0  # the first flight is compiled
SHORT = {"flight.duration_s": 4.0, "navigation": {"grade": "standard"}}
ft.fly(ft.load_scenario("level_turn", changes=SHORT), gains=["paper"])
