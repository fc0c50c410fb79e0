"""Gains by name or file, and how commands print them and their margins."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flighttune.cli.show import NO, fail, pick
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table

if TYPE_CHECKING:
    from flighttune.control.gains import PIGains
    from flighttune.control.linear_model import LinearModel
    from flighttune.control.margins import LoopMargins
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


def chosen_gains(scenario: "Scenario", wanted: str | None) -> tuple[str, "PIGains"]:
    """Name and gains selected by ``--gains``; exits with status 1 where tuning finds none."""
    from flighttune.flight.outer_loop import gain_set
    from flighttune.scenario import load_gains

    if wanted is None:
        wanted = scenario.gain_names[0]
    if Path(wanted).suffix.lower() in (".json", ".toml"):
        return wanted, load_gains(wanted)
    gains = gain_set(scenario, wanted)
    if gains is None:
        fail(f"--gains: `{wanted}` must be feasible: tuning found no such gains.", NO)
    return wanted, gains


def margins_of(model: "LinearModel", gains: "PIGains | None") -> "LoopMargins | None":
    """Margins of the loop of gains, None where there are no gains or the loop is not stable."""
    from flighttune.control.margins import loop_margins

    return None if gains is None else loop_margins(model, gains)


def gains_values(gains: "PIGains | None") -> dict[str, Any]:
    """``K_P`` and ``K_I`` as nested lists, null where there are no gains."""
    return {"K_P": None, "K_I": None} if gains is None else dict(gains.as_lists())


def gains_table(title: str, gains: "PIGains | None") -> Table:
    """Gains as a table, a row a command; no rows where there are no gains."""
    records = []
    if gains is not None:
        records = [
            {"command": command, "P": proportional, "I": integral}
            for command, proportional, integral in zip(
                gains.labels, gains.K_P.tolist(), gains.K_I.tolist(), strict=True
            )
        ]
    return Table(title=title, columns=GAINS_COLUMNS, records=records)


def margins_values(margins: "LoopMargins | None") -> dict[str, Any] | None:
    """Margins with the unit at the end of each key."""
    if margins is None:
        return None
    return {
        "channels": {
            loop.channel: {
                **pick(loop, "gain_increase gain_decrease"),
                "phase_margin_deg": math.degrees(loop.phase_margin),
                "delay_margin_s": loop.delay_margin,
            }
            for loop in margins.channels
        },
        "all": {
            **pick(margins, "disk_margin disk_gain"),
            "disk_phase_deg": math.degrees(margins.disk_phase),
            "delay_margin_s": margins.delay_margin,
            "lag_margin_s": margins.lag_margin,
        },
    }


def margins_table(values: Mapping[str, Any] | None) -> Table:
    """Margins as `margins_values` has them: a row a channel, and one for all channels at once."""
    records = []
    if values is not None:
        every = values["all"]
        together = {
            "gain_decrease": 1.0 / every["disk_gain"],
            "gain_increase": every["disk_gain"],
            "phase_margin_deg": every["disk_phase_deg"],
        }
        records = [{"loop": channel, **own} for channel, own in values["channels"].items()]
        records.append({"loop": "all at once", **every, **together})
    return Table(title="stability margins", columns=MARGIN_COLUMNS, records=records)


def save_answer(path: Path, answer: Answer) -> None:
    """Write the JSON object of an answer to a file, whole or not at all."""
    from flighttune.whole_file import write_text

    write_text(path, answer.json() + "\n")
