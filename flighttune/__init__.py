"""Tune a fixed-wing outer loop with a certificate, and fly it on the full aircraft.

The public names stand in ``__init__.pyi``. Each is imported on first use: ``import flighttune``
itself costs nothing.
"""

from typing import Any

from flighttune.base.public import modules_of, public_value

__version__ = "0.5.0"


def __getattr__(name: str) -> Any:
    return public_value(__name__, name)


def __dir__() -> list[str]:
    return sorted([*modules_of(__name__), "__all__", "__version__"])
