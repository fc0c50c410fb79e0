# SPDX-License-Identifier: LGPL-2.1-or-later
"""The compiled step of an aircraft, and how it starts without JSBSim; or why there is none."""

import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

from flighttune.base import units
from flighttune.base.c_library import c_library
from flighttune.compiled import machine
from flighttune.compiled.aircraft import CompiledStep, Start
from flighttune.compiled.cache import Kept, kept_or_made
from flighttune.compiled.check import Unchecked
from flighttune.compiled.evaluated import Evaluation, Loaded
from flighttune.compiled.ir import ALONE, Lanes
from flighttune.compiled.lanes import LaneStep, fly_ir, lanes_differ, widths
from flighttune.compiled.lifted import Lifted, lifted
from flighttune.compiled.model import Air, Source
from flighttune.compiled.properties import Properties, Unsupported
from flighttune.compiled.settling import BeforeFlight, before_flight
from flighttune.compiled.step import MachineStep, Names, traced
from flighttune.compiled.trace import Number
from flighttune.compiled.trimming import writing

# Where many aircraft were compared: versions of JSBSim, and the platform. A step of another one is
# checked for longer, and flies if it is equal.
KNOWN_VERSIONS, KNOWN_PLATFORM = ("1.3.3",), "linux x86_64 glibc"

# Checks of a step that may fail in this process before it is refused without a check.
MAX_UNCHECKED = 5

# Differences of a step that are kept, each of its case.
MAX_DIFFERENCES = 100

# Starts of an aircraft, evaluated by what JSBSim shows of it, beside JSBSim: what it shows in the
# end, and what differs.
CheckOfStarts: TypeAlias = Callable[[Callable[[Loaded], Evaluation]], tuple[Loaded, str]]


@dataclass(frozen=True)
class Refusal:
    """Why JSBSim flies an aircraft itself."""

    reason: str


def compiled(
    source: Source, air: Air, case: str, check: Callable[[CompiledStep], str]
) -> CompiledStep | Refusal:
    """The compiled step of an aircraft.

    The first use of an aircraft compiles its step and flies it beside JSBSim; the result is cached.

    Parameters
    ----------
    source, air : Source, Air
        The aircraft, and the kind of air.
    case : str
        Digest of all numbers that decide a check: what it finds holds for flights with these alone.
    check : callable
        Flies the step beside JSBSim, as `check_flight` does, and says what differs.
    """
    if why := machine.unknown_platform():
        return Refusal(why)
    return _for_case(source, air, case, lambda: _compiled(source, air, case, check))


def evaluated(
    source: Source, kind: str, case: str, thrusts: Sequence[str], check: CheckOfStarts
) -> Evaluation | Refusal:
    """How an aircraft starts without JSBSim, to the bit.

    The first use compiles its evaluations and starts it beside JSBSim; the result is cached.
    `kind` has all that decides a start beside the source, `thrusts` are the properties with the
    thrust of the engines; `case`: as for `compiled`.
    """
    return _for_case(source, kind, case, lambda: _evaluated(source, kind, case, thrusts, check))


@cache
def jsbsim_version() -> str:
    """The installed version of JSBSim."""
    return version("jsbsim")


@cache
def unproven() -> str:
    """Version and platform of JSBSim if only a check can tell what it does; else empty."""
    here = machine.this_platform()
    if jsbsim_version() in KNOWN_VERSIONS and here == KNOWN_PLATFORM:
        return ""
    return f"JSBSim {jsbsim_version()} on {here}"


def sloped(step: CompiledStep) -> MachineStep:
    """The step of an aircraft with slopes behind its states, parameters and signals."""
    return _sloped(step.source, step.air)


@lru_cache(maxsize=32)
def _sloped(source: Source, air: Air) -> MachineStep:
    def made() -> Kept:
        names, code = _code(source, air, sloped=True)
        return Kept(names=names, code=code)

    kept = kept_or_made(_key(source, air, "slopes"), made)
    return MachineStep(kept.names, kept.code)


def in_lanes(step: CompiledStep, start: Start) -> LaneStep:
    """The step of an aircraft for many flights, as many in a vector as the processor has room for.

    The first use flies the lanes beside the step alone, from a `start`, and is cached. Where they
    differ, flights are stepped one after the other.
    """
    wide, calling = widths()
    functions = lifted(wide, _digest)
    width = wide if functions.names else calling
    return _in_lanes(step, width, functions, start) or _in_lanes(step, 1, Lifted())


def _in_lanes(step: CompiledStep, width: int, functions: Lifted, start: Start | None = None) -> Any:
    """The step of so many lanes; None where they differ from the step alone after a `start`."""

    def made() -> Kept:
        names, code = _code(step.source, step.air, lanes=Lanes(width, functions.names))
        return Kept(names=names, code=code)

    def checked(kept: Kept) -> Kept:
        if start is None or kept.equal or kept.differences:
            return kept
        lanes = LaneStep(kept.names, kept.code, width)
        difference = lanes_differ(lanes, step.machine, start)
        found = {"": difference} if difference else {}
        return replace(kept, equal=not difference, differences=found)

    kind = f"lanes {width} {' '.join(functions.names)}"
    kept = kept_or_made(_key(step.source, step.air, kind), made, checked)
    return LaneStep(kept.names, kept.code, width) if kept.equal or start is None else None


@dataclass
class _Known:
    """What this process knows of a step or start: itself once it may fly, and why it may not."""

    ready: Any = None
    differences: dict[str, str] = field(default_factory=dict)  # by case
    failed: dict[str, str] = field(default_factory=dict)  # by case, also what was not checked


@lru_cache(maxsize=64)
def _known(_source: Source, _of: Air | str) -> _Known:
    return _Known()


def _for_case(
    source: Source, of: Air | str, case: str, make: Callable[[], tuple[Kept, Any]]
) -> Any:
    """The step or start that `make` gives, or why it is refused for the numbers of a case.

    A difference is one of its case alone: other numbers are checked by themselves.
    """
    known = _known(source, of)
    if known.ready is None and not {case} & {*known.differences, *known.failed}:
        if len(known.failed) >= MAX_UNCHECKED:
            last = [*known.failed.values()][-1]
            return Refusal(f"{MAX_UNCHECKED} checks of other numbers failed, the last: {last}")
        try:
            kept, known.ready = make()
            known.differences |= kept.differences
            if case in kept.differences:
                known.failed[case] = kept.differences[case]
        except Unchecked as why:
            known.failed[case] = str(why)
        except Unsupported as what:
            known.ready = Refusal(f"the compiled step does not know {what}")
    if case in known.differences:
        return Refusal(known.differences[case])
    return known.ready or Refusal(known.failed[case])


def _checked(kept: Kept, case: str, check: Callable[[], tuple[Loaded | None, str]]) -> Kept:
    """A step with what a check of a case finds; a case that was equal stands for others."""
    if kept.equal or case in kept.differences:
        return kept
    loaded, difference = check()
    if not difference:
        return replace(kept, equal=True, loaded=asdict(loaded) if loaded else {})
    others = [*kept.differences.items()][1 - MAX_DIFFERENCES :]
    return replace(kept, differences=dict(others) | {case: difference})


def _compiled(
    source: Source, air: Air, case: str, check: Callable[[CompiledStep], str]
) -> tuple[Kept, CompiledStep | None]:
    def step(kept: Kept) -> CompiledStep:
        return CompiledStep(source, air, kept.names, kept.code)

    def made() -> Kept:
        names, code = _code(source, air)
        return Kept(names=names, code=code)

    def checked(kept: Kept) -> Kept:
        def beside_jsbsim() -> tuple[None, str]:
            difference = check(step(kept))
            return None, f"{unproven()}: {difference}" if difference and unproven() else difference

        return _checked(kept, case, beside_jsbsim)

    kept = kept_or_made(_key(source, air), made, checked)
    return kept, step(kept) if kept.equal else None


def _evaluated(
    source: Source, kind: str, case: str, thrusts: Sequence[str], check: CheckOfStarts
) -> tuple[Kept, Evaluation | None]:
    """How an aircraft is evaluated at its start."""
    model, write = source.model(Air()), _writing()
    engines = len(model.engines)  # of the model; a glider may have some at rest

    def evaluation(kept: Kept, loaded: Loaded) -> Evaluation:
        code = BeforeFlight(kept.names, kept.code, engines)
        return Evaluation(source, model, loaded, code, write)

    def made() -> Kept:
        names, text = before_flight(model, thrusts)
        return Kept(names=names, code=machine.object_code(text))

    def checked(kept: Kept) -> Kept:
        def beside_jsbsim() -> tuple[Loaded | None, str]:
            try:
                return check(lambda loaded: evaluation(kept, loaded))
            except Unsupported as what:
                return None, f"a start does not know {what}"

        return _checked(kept, case, beside_jsbsim)

    kept = kept_or_made(_key(source, Air(), kind), made, checked)
    return kept, evaluation(kept, Loaded(**kept.loaded)) if kept.equal else None


@cache
def _writing() -> MachineStep:
    """What a write to an initial state does."""

    def made() -> Kept:
        names, text = writing()
        return Kept(names=names, code=machine.object_code(text))

    kept = kept_or_made(_digest("initial state"), made)
    return MachineStep(kept.names, kept.code)


@lru_cache(maxsize=4)
def _code(
    source: Source, air: Air, *, sloped: bool = False, lanes: Lanes | None = None
) -> tuple[Names, bytes]:
    """The names and the machine code of a step, also one of many flights in `lanes`."""
    model = source.model(air)

    def shown(now: Properties) -> Mapping[str, Number]:
        return source.signals(now, model.engines)

    names, text = traced(model, shown, sloped=sloped, lanes=lanes or ALONE)
    if lanes is not None:
        text += fly_ir(names, lanes.width)
        text += lifted(lanes.width, _digest).text if lanes.lifted else ""
    return names, machine.object_code(text)


def _key(source: Source, air: Air, kind: str = "") -> str:
    """Digest of everything a step depends on: the model and its parts, JSBSim, machine, code."""
    parts = (text for part in source.parts() for text in part)
    return _digest(*source.stated, air.turbulence or "", str(air.gust), kind, *parts)


def _digest(*texts: str | bytes) -> str:
    """Digest of texts, of JSBSim, the machine and our code."""
    digest = sha256()
    here = platform.platform(), c_library(), *machine.processor()
    machine_and_code = *here, _own_digest()
    for text in (*texts, jsbsim_version(), version("llvmlite"), *machine_and_code):
        data = text.encode() if isinstance(text, str) else text
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()


@cache
def _own_digest() -> bytes:
    """Digest of the code of this room, and of the units."""
    files = sorted(Path(__file__).parent.rglob("*.py"))
    files.append(Path(units.__file__))
    return sha256(b"".join(file.read_bytes() for file in files)).digest()
