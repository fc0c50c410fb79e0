"""Gains by name or file, and how commands print them and their margins."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flighttune.cli.show import NO, fail, pick
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table

if TYPE_CHECKING:
    from flighttune.control.gains import PIGains
    from flighttune.control.margins import Margins
    from flighttune.scenario import Scenario

GAINS_COLUMNS = (
    Column("command", "command"),
    Column("P.0", "e_chi", digits="z.4f"),
    Column("P.1", "e_gamma", digits="z.4f"),
    Column("I.0", "int e_chi", digits="z.4f"),
    Column("I.1", "int e_gamma", digits="z.4f"),
)
MARGIN_COLUMNS = [
    *columns("loop"),
    Column("gain_decrease", "gain from"),
    Column("gain_increase", "gain to"),
    *columns("phase_margin_deg delay_margin_s lag_margin_s"),
]


def chosen_gains(source: str, wanted: str | None) -> "tuple[Scenario, str, PIGains]":
    """Scenario, and the name and gains of ``--gains``; exit status 1 if tuning finds none."""
    from flighttune.flight.outer_loop import gain_set
    from flighttune.scenario import load_gains, load_scenario

    scenario = load_scenario(source)
    name = scenario.gain_names[0] if wanted is None else wanted
    if Path(name).suffix.lower() in (".json", ".toml"):
        return scenario, name, load_gains(name)
    gains = gain_set(scenario, name)
    if gains is None:
        fail(f"--gains: `{name}` must be feasible: tuning found no such gains.", NO)
    return scenario, name, gains


def gains_values(gains: "PIGains | None") -> dict[str, Any]:
    """``K_P`` and ``K_I`` as nested lists, null where there are no gains."""
    return {"K_P": None, "K_I": None} if gains is None else dict(gains.as_lists())


def gains_table(title: str, gains: "PIGains | None") -> Table:
    """Gains as a table, a row a command; no rows where there are no gains."""
    if gains is None:
        return Table(GAINS_COLUMNS, [], title)
    rows = zip(gains.labels, gains.K_P.tolist(), gains.K_I.tolist(), strict=True)
    records = [{"command": name, "P": K_P, "I": K_I} for name, K_P, K_I in rows]
    return Table(GAINS_COLUMNS, records, title)


def margins_table(margins: "Sequence[Margins]") -> Table:
    """Stability margins: a row a channel, and one for all channels at once."""
    records = [
        {
            **pick(row, "loop gain_decrease gain_increase"),
            "phase_margin_deg": math.degrees(row.phase_margin),
            "delay_margin_s": row.delay_margin,
        }
        for row in margins
    ]
    if margins:
        records[-1] |= {
            "lag_margin_s": margins[-1].lag_margin,
            "disk_margin": margins[-1].disk_margin,
        }
    return Table(MARGIN_COLUMNS, records, "stability margins", name="margins")


def save_answer(path: Path, answer: Answer) -> None:
    """Write the JSON object of an answer to a file, whole or not at all."""
    from flighttune.whole_file import write_text

    write_text(path, answer.json() + "\n")
