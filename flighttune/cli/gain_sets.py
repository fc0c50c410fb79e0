"""Gains by name or file, and how commands print them and their margins."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flighttune.cli.show import NO, fail, json_text, pick, table
from flighttune.present.tables import Table

if TYPE_CHECKING:
    from flighttune.control.gains import PIGains
    from flighttune.control.linear_model import LinearModel
    from flighttune.control.margins import LoopMargins
    from flighttune.scenario import Scenario


def chosen_gains(scenario: "Scenario", wanted: str | None) -> tuple[str, "PIGains"]:
    """Name and gains of what ``--gains`` asks for; exits with status 1 where tuning finds none."""
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


def gains_json(gains: "PIGains | None") -> dict[str, Any]:
    """``K_P`` and ``K_I`` as nested lists, null where there are no gains."""
    return {"K_P": None, "K_I": None} if gains is None else dict(gains.as_lists())


def gains_table(title: str, gains: "PIGains | None") -> Table:
    """Gains as a table, a row a command; no rows where there are no gains."""
    rows = []
    if gains is not None:
        for name, row in zip(gains.labels, gains.K, strict=True):
            rows.append((name, *(f"{value:z.4f}" for value in row)))
    return table(title, ("", "e_chi", "e_gamma", "int e_chi", "int e_gamma"), rows)


def write_json(path: Path, value: dict[str, Any]) -> None:
    """Write one JSON object to a file, whole or not at all."""
    from flighttune.whole_file import write_text

    write_text(path, json_text(value) + "\n")


def margins_json(margins: "LoopMargins | None") -> dict[str, Any] | None:
    """Margins with the unit at the end of each key."""
    if margins is None:
        return None
    return {
        "channels": {
            one.channel: {
                **pick(one, "gain_increase gain_decrease"),
                "phase_margin_deg": math.degrees(one.phase_margin),
                "delay_margin_s": one.delay_margin,
            }
            for one in margins.channels
        },
        "all": {
            **pick(margins, "disk_margin disk_gain"),
            "disk_phase_deg": math.degrees(margins.disk_phase),
            "delay_margin_s": margins.delay_margin,
            "lag_margin_s": margins.lag_margin,
        },
    }


def margins_text(margins: "LoopMargins | None") -> Iterator[str]:
    """The margins in lines, one a channel and one for all channels at once."""
    if margins is None:
        return
    for one in margins.channels:
        yield (
            f"margins of {one.channel}: gain {_factor(one.gain_decrease)} to "
            f"{_factor(one.gain_increase)}, "
            f"phase {math.degrees(one.phase_margin):.0f} deg, delay {one.delay_margin:.3f} s"
        )
    yield (
        f"all at once: gain x{1.0 / margins.disk_gain:.2f} to x{margins.disk_gain:.2f}, phase "
        f"{math.degrees(margins.disk_phase):.0f} deg, delay {margins.delay_margin:.3f} s, "
        f"first-order lag {margins.lag_margin:.3f} s"
    )


def _factor(value: float) -> str:
    if value == 0.0:
        return "x0"
    return f"x{value:.2f}" if math.isfinite(value) else "any"
