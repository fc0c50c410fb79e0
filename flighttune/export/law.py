"""Why gains cannot be exported: of the laws only some can, and none written in Python."""

from flighttune.control.law import Law, kinds_with
from flighttune.errors import InputError


def refusal(name: str, law: Law, ability: str) -> InputError:
    """Why the gain set `name` of a law without an ability of `Law` cannot be exported."""
    return InputError(
        f"`gains` must be flown by the law {kinds_with(ability)} to be exported, got {name!r} of "
        f"the law {law.name!r}."
    )
