"""Public names of the package and of `flighttune.loop`, each imported on first use."""

from functools import cache
from importlib import import_module
from typing import Any

PACKAGE = "flighttune"

# Names that moved into a module without being in its stub.
MOVED = {
    "FlightEnv": "flighttune.gym",
    "OutputError": "flighttune.base.errors",
    "Provenance": "flighttune.flight.loop.run",
    "Report": "flighttune.outputs.pages.frame",
    "ShapeError": "flighttune.base.errors",
    "StoppedError": "flighttune.base.errors",
    "TrimError": "flighttune.base.errors",
}

# Replacements of names that were removed.
REPLACED = {
    "load_claim": "flighttune.load",
    "load_recording": "flighttune.load",
    "save_claim": "the method `save` of what is written",
    "save_identified": "the method `save` of what is written",
}


def public_value(namespace: str, name: str) -> Any:
    """A public name of this package or of `flighttune.loop`, imported from its module."""
    modules = modules_of(namespace)
    if name == "__all__":
        return sorted(modules)
    if name in modules:
        module = import_module(modules[name])
        if modules[name] == f"{namespace}.{name}":
            return module
        return _checked(namespace, getattr(module, name))
    text = f"module {namespace!r} has no attribute {name!r}"
    place = "flighttune.loop" if name in modules_of("flighttune.loop") else MOVED.get(name)
    now = REPLACED.get(name) or (place and f"{place}.{name}")
    raise AttributeError(f"{text}: it is now {now}" if now else text)


@cache
def _checked(namespace: str, value: Any) -> Any:
    """A function whose arguments are held to its annotations, a class with short signatures."""
    from types import FunctionType

    if isinstance(value, type):
        from flighttune.base.signatures import with_short_signatures

        return with_short_signatures(value)
    if not isinstance(value, FunctionType):
        return value
    from flighttune.base.arguments import checked

    call = checked(value)
    call.__module__ = namespace  # by which it is pickled
    return call


@cache
def modules_of(namespace: str) -> dict[str, str]:
    """Module of each public name, from the stub that type checkers read."""
    import ast
    from pathlib import Path

    stub = "__init__.pyi" if namespace == PACKAGE else "loop.pyi"
    text = Path(__file__).parents[1].joinpath(stub).read_text(encoding="utf-8")
    return {
        alias.name: f"{PACKAGE}.{alias.name}" if line.module == PACKAGE else str(line.module)
        for line in ast.parse(text).body
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
    }
