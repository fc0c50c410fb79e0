# SPDX-License-Identifier: LGPL-2.1-or-later
"""LLVM IR to machine code and into this process; llvmlite is imported here alone, on first use."""

import ctypes
import platform
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from flighttune.compiled.ir import PREFIX
from flighttune.compiled.trace import LIBRARY


@dataclass(frozen=True)
class Platform:
    """What code is made for: LLVM's name of it, and the library whose functions JSBSim calls too.

    `sincos` is its function that gives a sine and a cosine; empty if it has none. `further` are
    functions that LLVM calls by itself, with their libraries; `processor` has all instructions
    that a step needs.
    """

    triple: str
    processor: str
    library: str
    sincos: str = ""
    further: Mapping[str, str] = field(default_factory=dict)


PLATFORMS = {
    "linux x86_64 glibc": Platform("x86_64-unknown-linux-gnu", "x86-64-v2", "libm.so.6", "sincos"),
    "darwin arm64": Platform("arm64-apple-darwin", "apple-m1", "libSystem.B.dylib", "__sincos"),
    # A step has more on its stack than a page, which Windows wants to be touched in order.
    "win32 AMD64": Platform(
        "x86_64-pc-windows-msvc", "x86-64-v2", "ucrtbase.dll", further={"__chkstk": "ntdll.dll"}
    ),
}

# What Windows has not: the function, and the mark of code with doubles that its linker asks for.
_MISSING = f"""
@_fltused = global i32 0
declare double @{PREFIX}sin(double)
declare double @{PREFIX}cos(double)
define void @{PREFIX}sincos(double %x, ptr %sine, ptr %cosine) alwaysinline {{
  %s = call double @{PREFIX}sin(double %x)
  %c = call double @{PREFIX}cos(double %x)
  store double %s, ptr %sine
  store double %c, ptr %cosine
  ret void
}}
"""


def this_platform() -> str:
    """Name of this computer's platform, as in `PLATFORMS`."""
    return f"{sys.platform} {platform.machine()} {platform.libc_ver()[0]}".strip()


def unknown_platform() -> str:
    """Why no code is made for this computer; empty if it is."""
    here = this_platform()
    known = ", ".join(PLATFORMS)
    return "" if here in PLATFORMS else f"the platform must be one of {known}, got {here}"


@cache
def processor() -> tuple[str, str]:
    """Name and instructions of the processor for which code is made."""
    llvm = _llvm()
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


@cache
def _llvm() -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    here = PLATFORMS[this_platform()]
    functions = [(f"{PREFIX}{name}", name, here.library) for name in LIBRARY]
    functions += [(f"{PREFIX}sincos", name, here.library) for name in [here.sincos] if name]
    functions += [(name, name, library) for name, library in here.further.items()]
    for name, of_library, library in functions:
        llvm.add_symbol(name, _address(library, of_library))
    return llvm


def _address(library: str, name: str) -> int:
    function = getattr(ctypes.CDLL(library), name)
    return ctypes.cast(function, ctypes.c_void_p).value or 0


def library_address(name: str) -> int:
    """Where the code of a function of the C library is in this process."""
    return _address(PLATFORMS[this_platform()].library, name)


@cache
def library_region() -> range:
    """The addresses of the C library in this process, on Linux; none elsewhere."""
    found, library = [], PLATFORMS[this_platform()].library
    library_address("sin")  # it is loaded
    with suppress(OSError), open("/proc/self/maps", encoding="utf-8") as maps:
        for line in maps:
            if line.rstrip().endswith(f"/{library}"):
                found += [int(x, 16) for x in line.split()[0].split("-")]
    return range(min(found, default=0), max(found, default=0))


def _machine(level: int, other: str = "") -> Any:
    """The machine of this computer, or any of another platform."""
    where = PLATFORMS[other or this_platform()]
    name, features = (where.processor, "") if other else processor()
    target = _llvm().Target.from_triple(where.triple)
    return target.create_target_machine(opt=level, cpu=name, features=features, jit=True)


def object_code(text: str, level: int = 2, *, other: str = "") -> bytes:
    """Machine code of a module of IR, of this computer or of another platform."""
    # LLVM contracts a product and a sum into one rounding only where it is told to: never here.
    llvm = _llvm()
    if other:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
    where = PLATFORMS[other or this_platform()]
    module = llvm.parse_assembly(f'target triple = "{where.triple}"\n{text}')
    if not where.sincos:
        module.link_in(llvm.parse_assembly(f'target triple = "{where.triple}"\n{_MISSING}'))
    module.verify()
    machine = _machine(level, other)
    options = llvm.create_pipeline_tuning_options(speed_level=level)
    options.slp_vectorization = True  # several operations in one instruction, each as before
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return machine.emit_object(module)


class Loaded:
    """Machine code in this process, as long as this object lives."""

    def __init__(self, code: bytes) -> None:
        llvm = _llvm()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine(2))
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Address of a function; 0 if there is none of that name."""
        return self._engine.get_function_address(name)

    def place_library(self) -> None:
        """Tell code that reads the tables of the C library where it begins in this process."""
        if place := self.address("place_library"):
            ctypes.CFUNCTYPE(None, ctypes.c_int64)(place)(library_region().start)
