# SPDX-License-Identifier: LGPL-2.1-or-later
"""LLVM IR to machine code and into this process; llvmlite is imported here alone, on first use."""

import ctypes
import platform
import sys
from functools import cache
from typing import Any

from flighttune.compiled.ir import PREFIX
from flighttune.compiled.trace import LIBRARY

# The C library whose functions JSBSim calls too.
_MATHEMATICS = "libm.so.6"


def unknown_platform() -> str:
    """Why this computer may not give the bits of JSBSim; empty if it does."""
    here = f"{sys.platform} {platform.machine()} {platform.libc_ver()[0]}".strip()
    known = "linux x86_64 glibc"
    return "" if here == known else f"the platform must be {known}, got {here}"


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
    library = ctypes.CDLL(_MATHEMATICS)
    for name in (*LIBRARY, "sincos"):
        address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
        llvm.add_symbol(f"{PREFIX}{name}", address)
    return llvm


def _machine(level: int) -> Any:
    name, features = processor()
    target = _llvm().Target.from_default_triple()
    return target.create_target_machine(opt=level, cpu=name, features=features, jit=True)


def object_code(text: str, level: int = 2) -> bytes:
    """Machine code of a module of IR."""
    # LLVM contracts a product and a sum into one rounding only where it is told to: never here.
    llvm = _llvm()
    module = llvm.parse_assembly(text)
    module.verify()
    machine = _machine(level)
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
