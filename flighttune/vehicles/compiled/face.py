# SPDX-License-Identifier: LGPL-2.1-or-later
"""The compiled step of an aircraft, or why there is none: what the rest of the package imports."""

import platform
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

from flighttune import vehicles
from flighttune.base import units
from flighttune.vehicles.aircraft.aircraft import AircraftConfig
from flighttune.vehicles.compiled import machine
from flighttune.vehicles.compiled.aircraft import CompiledStep as CompiledStep
from flighttune.vehicles.compiled.cache import Kept, kept_or_made
from flighttune.vehicles.compiled.check import Unchecked, Verdict, check_flight, check_start
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

# Flights that may fail to check a step before it is refused
MAX_UNCHECKED = 5


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
    if len(reasons := _unchecked(source, air)) >= MAX_UNCHECKED:
        return Refusal(reasons[-1])
    try:
        return _compiled(source, air)
    except Unchecked as why:
        reasons.append(str(why))
        return Refusal(str(why))


def evaluated(
    config: AircraftConfig, *, ground: float = 0.0, files: Unchanged | None = None
) -> EvaluatedFdm | None:
    """An aircraft that starts without JSBSim, to the bit; None if JSBSim must start it.

    The first use compiles its evaluations and starts it beside JSBSim; the result is cached.
    """
    if isinstance(compiled(config, files=files), Refusal):
        return None
    source = Source(config, 1, files)
    if len(reasons := _unchecked(source, ground)) >= MAX_UNCHECKED:
        return None
    try:
        evaluation = _evaluation(source, ground)
        return evaluation and EvaluatedFdm(evaluation, source, ground=ground)
    except Unchecked as why:
        reasons.append(str(why))
    except Unsupported:
        pass  # a start is not refused to its user: JSBSim makes it
    return None


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
        return Kept(names=names, code=code, verdict={})

    kept = kept_or_made(_key(source, air, "slopes"), made)
    return MachineStep(kept.names, kept.code)


@lru_cache(maxsize=32)
def _unchecked(_source: Source, _of: Air | float) -> list[str]:
    """Reasons why flights could not check a step or start, to append to: other numbers may do."""
    return []


@lru_cache(maxsize=32)
def _compiled(source: Source, air: Air) -> CompiledStep | Refusal:
    try:
        kept = kept_or_made(_key(source, air), lambda: _made(source, air))
    except Unsupported as what:
        return Refusal(f"the compiled step does not know {what}")
    verdict = Verdict(**kept.verdict)
    if verdict.difference:
        return Refusal(verdict.difference)
    return CompiledStep(source, air, kept.names, kept.code)


@lru_cache(maxsize=32)
def _evaluation(source: Source, ground: float) -> Evaluation | None:
    """How an aircraft is evaluated; None if a start differs from JSBSim's."""
    if not isinstance(step := compiled(source.config, files=source.files), CompiledStep):
        return None
    model, write = source.model(Air()), _writing()
    engines = len(model.engines)  # of the model; a glider may have some at rest

    def made() -> Kept:
        names, text = before_flight(model, thrusts_of(source.config))
        code = machine.object_code(text)
        fdm = LoadedFdm(source.config, ground=ground, files=source.files)
        before_it = BeforeFlight(names, code, engines)
        found = Evaluation(source, model, fdm.known, before_it, write, _evaluated_or_loaded)
        try:
            loaded, difference = check_start(step, found, source, ground)
        except Unsupported as what:
            loaded, difference = found.loaded, f"a start does not know {what}"
        verdict = {"difference": difference, "loaded": asdict(loaded)}
        return Kept(names=names, code=code, verdict=verdict)

    engines_settle, settings = source.config.engines.settle, source.config.settings
    try:
        kept = kept_or_made(
            _key(source, Air(), f"start {ground} {engines_settle} {settings}"), made
        )
    except Unsupported:
        return None
    if kept.verdict["difference"]:
        return None
    loaded = Loaded(**kept.verdict["loaded"])
    code = BeforeFlight(kept.names, kept.code, engines)
    return Evaluation(source, model, loaded, code, write, _evaluated_or_loaded)


def _evaluated_or_loaded(files: Unchanged, steps: int, ground: float) -> Fdm:
    by_code = evaluated(files.config, ground=ground, files=files)
    return by_code or load(files, steps, ground)


@cache
def _writing() -> MachineStep:
    """What a write to an initial state does."""

    def made() -> Kept:
        names, text = writing()
        return Kept(names=names, code=machine.object_code(text), verdict={})

    kept = kept_or_made(_digest("initial state"), made)
    return MachineStep(kept.names, kept.code)


def _made(source: Source, air: Air) -> Kept:
    """Trace, compile and check the step of an aircraft."""
    names, code = _code(source, air)
    verdict = check_flight(CompiledStep(source, air, names, code), source.config)
    return Kept(names=names, code=code, verdict=verdict.record())


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
    machine_and_code = platform.platform(), *machine.processor(), _own_digest()
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
