"""Tune a fixed-wing outer loop with a certificate, and see what the full aircraft makes of it.

The public names stand in ``__init__.pyi``. Each is imported on first use: ``import flighttune``
itself costs nothing.
"""

from functools import cache
from importlib import import_module
from typing import Any

__version__ = "0.3.0"


def __getattr__(name: str) -> Any:
    modules = _public_modules()
    if name == "__all__":
        return sorted(modules)
    if name not in modules:
        raise AttributeError(f"module 'flighttune' has no attribute {name!r}")
    return getattr(import_module(modules[name]), name)


def __dir__() -> list[str]:
    return sorted([*_public_modules(), "__all__", "__version__"])


@cache
def _public_modules() -> dict[str, str]:
    """Module of each public name, from the stub that type checkers read."""
    import ast
    from pathlib import Path

    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [line for line in stub.body if isinstance(line, ast.ImportFrom)]
    return {alias.name: str(line.module) for line in imports for alias in line.names}
