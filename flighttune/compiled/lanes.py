# SPDX-License-Identifier: LGPL-2.1-or-later
"""The step of an aircraft for many flights, several in the lanes of one vector."""

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from flighttune.compiled import machine
from flighttune.compiled.aircraft import Start
from flighttune.compiled.dynamics import Doubles
from flighttune.compiled.machine import Loaded
from flighttune.compiled.normals import seeded, together
from flighttune.compiled.step import MachineStep, Names

# Integration steps whose normal numbers are drawn at once.
_DRAWN = 256

# Lanes of a vector, by the instructions that a processor has. Eight are slower than four where the
# C library is called lane by lane.
_WIDTHS, _WITH_FUNCTIONS = {"avx2": 4, "sse2": 2}, {"avx512f": 8}

# Steps and flights on which lanes are compared with flights alone, and the largest change of a
# command there, as a share of one.
_STEPS, _SHARE = 400, 0.2

# Flights of one block after the other; the normal numbers of steps are drawn ahead of them.
_FLY = """
define void @fly(ptr %s, ptr %p, i64 %blocks, i64 %n, ptr %random, ptr %u, ptr %o, i64 %m) {{
entry:
  %any = icmp sgt i64 %blocks, 0
  %all = icmp sgt i64 %m, 1
  %row = select i1 %all, i64 {all}, i64 {signals}
  br i1 %any, label %block, label %end
block:
  %b = phi i64 [ 0, %entry ], [ %b1, %block ]
  %s0 = mul i64 %b, {states}
  %sb = getelementptr double, ptr %s, i64 %s0
  %p0 = mul i64 %b, {parameters}
  %pb = getelementptr double, ptr %p, i64 %p0
  %o0 = mul i64 %b, %row
  %ob = getelementptr double, ptr %o, i64 %o0
  %r0 = mul i64 %b, {width}
  %count = mul i64 %n, {stream}
  %pr = getelementptr i64, ptr %random, i64 %r0
  call void @together(ptr %pr, i64 %count, ptr %u)
  call void @step(ptr %sb, ptr %pb, i64 %n, ptr %u, ptr %ob, i64 %m)
  %b1 = add i64 %b, 1
  %more = icmp slt i64 %b1, %blocks
  br i1 %more, label %block, label %end
end:
  ret void
}}
"""


def widths() -> list[int]:
    """Lanes of a vector on this processor: with functions over vectors, and without."""
    _, features = machine.processor()
    has = {feature[1:] for feature in features.split(",") if feature.startswith("+")}
    return [
        next((width for name, width in known.items() if name in has), 1)
        for known in (_WITH_FUNCTIONS | _WIDTHS, _WIDTHS)
    ]


def fly_ir(names: Names, width: int) -> str:
    """IR of ``fly``, which steps blocks of flights; the module has ``step``."""
    text = _FLY.format(
        states=len(names.states) * width,
        parameters=len(names.parameters) * width,
        signals=len(names.signals) * width,
        all=(len(names.signals) + len(names.properties)) * width,
        stream=len(names.stream),
        width=width,
    )
    return together(width) + text


class LaneStep:
    """The step of an aircraft in machine code, for blocks of `width` flights.

    Arrays have a block, a name and a lane on their axes: shape (blocks, names, `width`).
    """

    def __init__(self, names: Names, code: bytes, width: int) -> None:
        self.names, self.width = names, width
        self._loaded = Loaded(code)
        self._loaded.place_library()
        pointer, count = ctypes.c_void_p, ctypes.c_int64
        kind = ctypes.CFUNCTYPE(
            *(None, pointer, pointer, count, count, pointer, pointer, pointer, count)
        )
        self._fly: Any = kind(self._loaded.address("fly"))

    def blocks(self, rows: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Rows of flights, shape (n, names), as blocks; the last flight fills up the last one."""
        n = len(rows)
        count = -(-n // self.width)
        padded = rows[np.minimum(np.arange(count * self.width), n - 1)]
        blocks = padded.reshape(count, self.width, -1).transpose(0, 2, 1)
        return np.ascontiguousarray(blocks)

    def rows(self, blocks: npt.NDArray[Any], n: int) -> npt.NDArray[Any]:
        """Blocks as rows of flights."""
        return blocks.transpose(0, 2, 1).reshape(-1, blocks.shape[1])[:n]

    def flying(
        self, states: Doubles, parameters: Doubles, random: npt.NDArray[np.int64], shown: Doubles
    ) -> Callable[..., None]:
        """What makes steps in place, given their number, as often as it is called.

        `shown` gets the signals of the last step; it has room for the properties behind them where
        they are asked for.
        """
        longest = _DRAWN if self.names.stream else 0
        # Of these flights alone: other threads may fly meanwhile.
        stream = np.empty(max(1, longest * len(self.names.stream) * self.width))
        arrays = states, parameters, random, stream, shown
        addresses = [ctypes.c_void_p(x.ctypes.data) for x in arrays]
        flights, further, blocks = addresses[:2], addresses[2:], ctypes.c_int64(len(states))

        # The default keeps the arrays, which their addresses would not.
        def fly(steps: int, *, properties: bool = False, _arrays: Any = arrays) -> None:
            most = longest or steps
            for done in range(0, steps, most):
                n = min(most, steps - done)
                how_much = 0 if done + n < steps else 2 if properties else 1
                self._fly(*flights, blocks, n, *further, how_much)

        return fly


def lanes_differ(lanes: LaneStep, alone: MachineStep, start: Start) -> str:
    """The first number in which flights in lanes differ from the same ones alone; empty if none.

    They begin at a start; the lanes differ in all parameters.
    """
    names, width, states = lanes.names, lanes.width, start.states
    generator = np.random.default_rng(1)
    factors = 1.0 + _SHARE * generator.uniform(-1.0, 1.0, (width, 1))
    given = factors * start.parameters
    together, parameters = (lanes.blocks(x) for x in (np.tile(states, (width, 1)), given))
    random = np.arange(1, width + 1)
    shown = np.zeros((1, len(names.signals) + len(names.properties), width))
    lanes.flying(together, parameters, random, shown)(_STEPS, properties=True)
    for lane in range(width):
        own, stream = states.copy(), alone.normals(seeded(lane + 1), _STEPS)
        row = np.zeros(shown.shape[1])
        alone.fly(own, given[lane].copy(), _STEPS, stream, row)
        every = (*names.signals, *names.properties, *names.states)
        one = np.concatenate([row, own])
        other = np.concatenate([shown[0, :, lane], together[0, :, lane]])
        if unlike := np.flatnonzero((one != other) & ~(np.isnan(one) & np.isnan(other))).tolist():
            return f"`{every[unlike[0]]}` of lane {lane + 1} of {width}"
    return ""
