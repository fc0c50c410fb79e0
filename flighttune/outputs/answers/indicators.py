"""The answer of the indicators of a loop."""

from flighttune.base.words import number, pick
from flighttune.control.theory.indicators import Indicators
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.labels import columns


def answer(loop: Indicators) -> Answer:
    """Whether the loop is stable and how fast it decays; its indicators and eigenvalues."""
    values = pick(loop, "status reason R_K I_K E_K spectral_abscissa Q scaling")
    poles = [{"real": pole.real, "imaginary": pole.imag} for pole in loop.eigenvalues]
    said = f"Not stable: {loop.reason}"
    if loop.status == "stable":
        said = (
            f"Stable: the squared norm of states and errors decays at {number(loop.R_K)} 1/s or "
            f"faster, and the slowest eigenvalue at {number(-loop.spectral_abscissa)} 1/s."
        )
    return Answer(
        lines=[said],
        values={**values, "eigenvalues": [list(pole.values()) for pole in poles]},
        tables=[
            Table(columns("R_K I_K E_K spectral_abscissa"), [values], "indicators"),
            Table(columns("real imaginary", of="eigenvalues"), poles, "eigenvalues"),
        ],
    )
