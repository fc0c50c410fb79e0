"""The answer of a designed aircraft, and its figure."""

import math
from collections.abc import Sequence

import numpy as np

from flighttune.base.units import DEG
from flighttune.base.words import pick
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.drawing.chart import DASHED, Chart, Sheet
from flighttune.outputs.drawing.palette import HUES, INK
from flighttune.vehicles.identification.design import BANK, DesignedAircraft, StepResponse, fly_step

COLOURS = tuple(strong for (strong, _), _ in HUES)
STEP_COLUMNS = columns("name t90_s t90_allowed_s overshoot overshoot_allowed met", of="steps")


def answer(designed: DesignedAircraft) -> Answer:
    """Designed and earlier gains, and the steps; a failure if a step misses a requirement."""
    compared = [
        {"gain": name, "designed": value, "before": designed.before.get(name)}
        for name, value in designed.gains.gains.items()
    ]
    gains = Table(columns("gain designed before"), compared, designed.config.title)
    values, tables = {"gains": designed.gains.gains}, [gains, steps_table(designed.steps)]
    met, n = sum(step.met for step in designed.steps), len(designed.steps)
    return Answer(
        lines=[f"{met} of {n} step responses meet their requirements."],
        values=values,
        tables=tables,
        findings=unmet(designed.missed),
    )


def steps_table(steps: Sequence[StepResponse]) -> Table:
    """Flown steps against the requirements."""
    records = [
        pick(step, "name channel overshoot overshoot_allowed met")
        | {"V_a_mps": step.V_a, "step": step.size}
        | {"t90_s": step.t90, "t90_allowed_s": step.t90_allowed}
        for step in steps
    ]
    return Table(title="step responses", name="steps", columns=STEP_COLUMNS, records=records)


def sheet(designed: DesignedAircraft) -> Sheet:
    """The flown step responses, and the load factor during a roll into a level bank."""
    config, steps = designed.config, designed.steps
    roll = Chart(title="Roll, step of 30°", y="φ [deg]")
    load = Chart(title="Load factor, steps of 0.5", y="n_z [1]")
    lateral = Chart(title="Lateral load factor in the roll step", y="n_y [1]")
    bank = Chart(title="Load factor on the way into a level 45° bank", y="n_z [1]")
    height = config.design.h if config.design else 1000.0
    rates = {"phi": config.limits.phi_rate, "n_z": config.limits.n_z_rate}
    for V_a, colour in zip(sorted({step.V_a for step in steps}), COLOURS, strict=False):
        name = f"{V_a:g} m/s"
        for step in (step for step in steps if step.V_a == V_a):
            signals, rate = step.signals, rates[step.channel]
            # The command behind the rate limit of the inner loop, equal at every airspeed.
            ramp = np.sign(step.size) * np.minimum(abs(step.size), rate * signals["t"])
            if step.channel == "phi":
                chart, unit, start, label = roll, DEG, 0.0, f"command, {rate / DEG:g}°/s"
                lateral.line(signals["t"], signals["n_y"], colour, name=name)
            else:
                chart, unit, start, label = load, 1.0, 1.0, f"command, {rate:g} per s"
            named = step.size > 0.0  # the step down has the same colour
            response = signals[step.channel] / unit
            chart.line(signals["t"], response, colour, name=name if named else "")
            if step.V_a == steps[0].V_a:
                command = (start + ramp) / unit
                label = label if named else ""
                chart.line(signals["t"], command, INK, dash=DASHED, width=1.0, name=label)
        banked = fly_step(config, "phi", BANK, V_a, height, 6.0).signals
        bank.line(banked["t"], banked["n_z"], colour, name=name)
    bank.level(1.0 / math.cos(BANK), INK, dash=DASHED)
    bank.legend.append(("1/cos 45°", INK, DASHED))
    return Sheet(charts=[roll, load, lateral, bank], title=config.title)
