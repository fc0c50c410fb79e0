# SPDX-License-Identifier: LGPL-2.1-or-later
"""The compiled step of an aircraft, or why there is none: what the rest of the package imports."""

import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cache, lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

from flighttune import vehicles
from flighttune.base import units
from flighttune.base.c_library import c_library
from flighttune.vehicles.aircraft.aircraft import AircraftConfig
from flighttune.vehicles.compiled import machine
from flighttune.vehicles.compiled.aircraft import CompiledStep as CompiledStep
from flighttune.vehicles.compiled.cache import Kept, kept_or_made
from flighttune.vehicles.compiled.check import Unchecked, case_of, check_flight, check_start
from flighttune.vehicles.compiled.evaluated import EvaluatedFdm, Evaluation, Loaded, LoadedFdm
from flighttune.vehicles.compiled.model import Air, Source
from flighttune.vehicles.compiled.properties import Unsupported as Unsupported
from flighttune.vehicles.compiled.settling import BeforeFlight, before_flight
from flighttune.vehicles.compiled.signals import shown_signals
from flighttune.vehicles.compiled.step import MachineStep, Names, traced
from flighttune.vehicles.compiled.trimming import writing
from flighttune.vehicles.plants.jsbsim.fdm import Fdm, load, thrusts_of
from flighttune.vehicles.plants.jsbsim.model_files import Unchanged
from flighttune.vehicles.plants.weather import TurbulenceModel

# Versions of JSBSim that the compiled step reproduces.
KNOWN_VERSIONS = ("1.3.3",)

# Checks of a step that may fail in this process before it is refused without a check.
MAX_UNCHECKED = 5

# Differences of a step that are kept, each of its case.
MAX_DIFFERENCES = 100


@dataclass(frozen=True)
class Refusal:
    """Why JSBSim flies an aircraft itself."""

    reason: str


def compiled(
    config: AircraftConfig,
    *,
    steps: int = 1,
    turbulence: TurbulenceModel | None = None,
    gust: bool = False,
    files: Unchanged | None = None,
) -> CompiledStep | Refusal:
    """The compiled step of an aircraft in still air or wind, with turbulence or a gust in it.

    The first use of an aircraft compiles its step and flies it beside JSBSim; the result is cached.
    `steps`: integration steps in a sample of the inner loop. `files`: as for `Source`.
    """
    if why := machine.unknown_platform():
        return Refusal(why)
    if (found := jsbsim_version()) not in KNOWN_VERSIONS:
        return Refusal(f"JSBSim must be of version {' or '.join(KNOWN_VERSIONS)}, got {found}")
    source, air = Source(config, steps, files), Air(turbulence, gust)
    return _for_case(source, air, lambda: _compiled(source, air))


def evaluated(
    config: AircraftConfig, *, ground: float = 0.0, files: Unchanged | None = None
) -> EvaluatedFdm | None:
    """An aircraft that starts without JSBSim, to the bit; None if JSBSim must start it.

    The first use compiles its evaluations and starts it beside JSBSim; the result is cached.
    """
    step = compiled(config, files=files)
    if isinstance(step, Refusal):
        return None
    source = Source(config, 1, files)
    evaluation = _for_case(source, ground, lambda: _evaluation(step, source, ground))
    if isinstance(evaluation, Refusal):
        return None
    try:
        return EvaluatedFdm(evaluation, source, ground=ground)
    except Unsupported:
        return None  # a start is not refused to its user: JSBSim makes it


@cache
def jsbsim_version() -> str:
    """The installed version of JSBSim."""
    return version("jsbsim")


def not_compiled(config: AircraftConfig) -> str:
    """Why JSBSim flies all flights of an aircraft itself; empty if long ones are compiled."""
    step = compiled(config)
    return step.reason if isinstance(step, Refusal) else ""


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


@dataclass
class _Known:
    """What this process knows of a step or start: itself once it may fly, and why it may not."""

    ready: Any = None
    differences: dict[str, str] = field(default_factory=dict)  # by case
    failed: list[str] = field(default_factory=list)


@lru_cache(maxsize=64)
def _known(_source: Source, _of: Air | float) -> _Known:
    return _Known()


def _for_case(source: Source, of: Air | float, make: Callable[[], tuple[Kept, Any]]) -> Any:
    """The step or start that `make` gives, or why it is refused for the numbers of a source.

    A difference is one of its case alone: other numbers are checked by themselves.
    """
    known, case = _known(source, of), case_of(source.config)
    if known.ready is None and case not in known.differences:
        if len(known.failed) >= MAX_UNCHECKED:
            return Refusal(known.failed[-1])
        try:
            kept, known.ready = make()
            known.differences |= kept.differences
            known.failed += [kept.differences[case]] if case in kept.differences else []
        except Unchecked as why:
            known.failed.append(str(why))
            return Refusal(str(why))
        except Unsupported as what:
            known.ready = Refusal(f"the compiled step does not know {what}")
    if case in known.differences:
        return Refusal(known.differences[case])
    return known.ready


def _checked(
    kept: Kept, config: AircraftConfig, check: Callable[[Kept], tuple[str, Loaded | None]]
) -> Kept:
    """A step with what a check of a case finds; a case that was equal stands for others."""
    if kept.equal or (case := case_of(config)) in kept.differences:
        return kept
    difference, loaded = check(kept)
    if not difference:
        return replace(kept, equal=True, loaded=asdict(loaded) if loaded else {})
    others = [*kept.differences.items()][1 - MAX_DIFFERENCES :]
    return replace(kept, differences=dict(others) | {case: difference})


def _compiled(source: Source, air: Air) -> tuple[Kept, CompiledStep | None]:
    def check(kept: Kept) -> tuple[str, None]:
        step = CompiledStep(source, air, kept.names, kept.code)
        return check_flight(step, source.config).difference, None

    def made() -> Kept:
        names, code = _code(source, air)
        return Kept(names=names, code=code)

    kept = kept_or_made(_key(source, air), made, lambda kept: _checked(kept, source.config, check))
    return kept, CompiledStep(source, air, kept.names, kept.code) if kept.equal else None


def _evaluation(
    step: CompiledStep, source: Source, ground: float
) -> tuple[Kept, Evaluation | None]:
    """How an aircraft is evaluated at its start."""
    model, write = source.model(Air()), _writing()
    engines = len(model.engines)  # of the model; a glider may have some at rest

    def evaluation(kept: Kept, loaded: Loaded) -> Evaluation:
        code = BeforeFlight(kept.names, kept.code, engines)
        return Evaluation(source, model, loaded, code, write, _evaluated_or_loaded)

    def made() -> Kept:
        names, text = before_flight(model, thrusts_of(source.config))
        return Kept(names=names, code=machine.object_code(text))

    def check(kept: Kept) -> tuple[str, Loaded | None]:
        fdm = LoadedFdm(source.config, ground=ground, files=source.files)
        try:
            loaded, difference = check_start(step, evaluation(kept, fdm.known), source, ground)
        except Unsupported as what:
            return f"a start does not know {what}", None
        return difference, loaded

    engines_settle, settings = source.config.engines.settle, source.config.settings
    kept = kept_or_made(
        _key(source, Air(), f"start {ground} {engines_settle} {settings}"),
        made,
        lambda kept: _checked(kept, source.config, check),
    )
    return kept, evaluation(kept, Loaded(**kept.loaded)) if kept.equal else None


def _evaluated_or_loaded(files: Unchanged, steps: int, ground: float) -> Fdm:
    by_code = evaluated(files.config, ground=ground, files=files)
    return by_code or load(files, steps, ground)


@cache
def _writing() -> MachineStep:
    """What a write to an initial state does."""

    def made() -> Kept:
        names, text = writing()
        return Kept(names=names, code=machine.object_code(text))

    kept = kept_or_made(_digest("initial state"), made)
    return MachineStep(kept.names, kept.code)


@lru_cache(maxsize=4)
def _code(source: Source, air: Air, *, sloped: bool = False) -> tuple[Names, bytes]:
    """The names and the machine code of a step."""
    model, config = source.model(air), source.config
    names, text = traced(
        model, lambda now: shown_signals(now, model.engines, config), sloped=sloped
    )
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
    """Digest of the code that makes a step, starts it and checks it."""
    files = sorted(Path(vehicles.__file__).parent.rglob("*.py"))
    files.append(Path(units.__file__))
    return sha256(b"".join(file.read_bytes() for file in files)).digest()
