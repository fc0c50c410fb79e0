"""Parts of the flown loop, for laws, plants and studies of your own.

Laws and their limits, plants and sensors, linear models and their indicators, and measures of a
flight. The names stand in ``loop.pyi``; each is imported on first use.
"""

from typing import Any

from flighttune.base.public import modules_of, public_value


def __getattr__(name: str) -> Any:
    return public_value(__name__, name)


def __dir__() -> list[str]:
    return sorted([*modules_of(__name__), "__all__"])
