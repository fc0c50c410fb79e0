"""Packages that single features need, and the extra of flighttune that installs each."""

from importlib.util import find_spec

from flighttune.errors import InputError

# Extra by module, as in pyproject.toml.
EXTRAS = {
    "dask": "cluster",
    "distributed": "cluster",
    "gymnasium": "gym",
    "numba": "fast",
    "pymavlink": "logs",
    "pyulog": "logs",
    "rerun_notebook": "notebook",
}


def need(what: str, *modules: str) -> None:
    """Refuse a feature whose modules are not all installed.

    `what`: the feature, as the message names it. `*modules`: any of `EXTRAS`. Raises InputError if
    one is missing; names the extra.
    """
    absent = [module for module in modules if find_spec(module) is None]
    if absent:
        raise InputError(_message(what, absent))


def missing_extra(error: ImportError, what: str) -> str | None:
    """The message of `need` for an import that failed; None where no extra would help."""
    module = (error.name or "").partition(".")[0]
    absent = module in EXTRAS and find_spec(module) is None
    return _message(what, [module]) if absent else None


def _message(what: str, absent: list[str]) -> str:
    extra = EXTRAS[absent[0]]
    names = ", ".join(absent).replace("_", "-")
    return f"{what} needs {names}; install it with: pip install 'flighttune[{extra}]'"
