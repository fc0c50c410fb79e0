"""A flight for JSBSim alone, or the outer loop in C, from one gain set of a scenario; a monitor."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from itertools import accumulate, count
from pathlib import Path
from string import Template
from typing import Any, Literal, TypeAlias

import numpy as np

from flighttune.base.answering import Answering
from flighttune.base.errors import InputError
from flighttune.base.files.load import BAND, MONITOR, load_one
from flighttune.base.files.whole import together, write_text
from flighttune.base.units import G_0, G_PAPER
from flighttune.claims.monitor import LogMonitor, Monitor, Watching
from flighttune.control.exact_law import ExactLaw, RateLaw
from flighttune.control.gains import PIGains
from flighttune.control.mimo_pi import BEYOND_STOP, MimoPI
from flighttune.control.wind import LEAST_SPEED, WIND_ESTIMATE_S
from flighttune.flight.conditions import lead_on
from flighttune.flight.entry import Entry
from flighttune.flight.fly import aircraft_table
from flighttune.flight.load import chosen_entry
from flighttune.flight.models import law_setup
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps.watch import FACTOR, LAG_S, SLOW, signals_of
from flighttune.outputs.exports.jsbsim_folder import ExportedFlight, export_jsbsim
from flighttune.outputs.exports.needs import needs
from flighttune.routes.follow import (
    APPROACH,
    APPROACH_BESIDE,
    LEAST_SHARE,
    LEAST_SHARE_BESIDE,
    STEEPEST_DIVE,
)

SOURCE, MONITOR_SOURCE = "ft_outer_loop.c", "ft_monitor.c"

# C expressions of a monitor's quantities that are not signals
_QUANTITIES = {
    "1": "1.0",
    "cos_phi": "cos(s->phi)",
    "sin_phi": "sin(s->phi)",
    "sin_gamma": "sin(s->gamma)",
    "slow": f"(0.5 * (1.0 + tanh(s->V_err / {SLOW})))",
    "to_roll": "(s->phi_cmd - s->phi)",
    "to_pitch": "(s->theta_cmd - s->theta)",
    "excess": f"(s->f_x / {G_0} - s->n_z * (sin(s->theta) - sin(s->gamma)))",
}

_FOLDER = Path(__file__).parent
_USED = "V_a is the airspeed."
_UNUSED = "V_a is not used: the gains are not scheduled."

# Words for the head of the file, with two and with three channels.
_HEAD = (
    {"airspeed_error": "", "n_x_command": "", "or_along": " (or ft_outer_loop_step_along)"},
    {"airspeed_error": " and of airspeed", "n_x_command": " and n_x", "or_along": ""},
)


def export_c(entry: Entry, folder: Path) -> Path:
    """Write the outer loop of one gain set as a C file, with the limits of its plant."""
    scenario, law = entry.scenario, entry.law
    setup = law_setup(scenario, entry.found_gains, entry.limits)
    if (controller := law.in_c(setup)) is None:
        raise law.refusal("in_c", "exported")
    source = c_source(
        controller,
        title=scenario.title,
        gains=entry.name,
        lead=entry.lead if entry.plant.aircraft else lead_on(scenario, None),
        g=scenario.flight.g_mps2,
        notes=(*scenario.assumptions, *needs(entry)),
        speed_priority=scenario.speed_priority,
    )
    write_text(folder / SOURCE, source)
    return folder / SOURCE


def c_source(
    law: MimoPI | ExactLaw,
    *,
    title: str,
    gains: str,
    lead: tuple[float, float] = (0.0, 0.0),
    g: float = G_PAPER,
    notes: Sequence[str] = (),
    speed_priority: bool = False,
) -> str:
    """The C99 text of a controller with lags `lead` (s); it needs only ``math.h``.

    Its head has the `notes`. `speed_priority`: include the function that reduces the path angle to
    keep airspeed, which three channels always have.
    """
    values, channels = law.law, law.law.channels
    form = "exact_law.c" if isinstance(law, ExactLaw) else "outer_loop.c"
    return Template((_FOLDER / form).read_text(encoding="utf-8")).substitute(
        _of_exact_law(law.law) if isinstance(law, ExactLaw) else _of_pi(law, g),
        title=_comment(title),
        gains=_comment(gains),
        notes="".join(f"\n * {_comment(note)}" for note in notes),
        version=version("flighttune"),
        speed_priority=_speed_priority(law.gains.airspeed, speed_priority, g),
        dt=_number(law.dt),
        lead_phi=_number(lead[0]),
        lead_n_z=_number(lead[1]),
        conditional=int(values.conditional),
        tracking_gain=_number(values.tracking_gain),
        K_P=_rows(channel.K_P for channel in channels),
        K_I=_rows(channel.K_I_half for channel in channels),
        **{
            name: _numbers(getattr(channel, name) for channel in channels)
            for name in ("lower", "upper", "step_down", "step_up")
        },
    )


def _of_pi(law: MimoPI, g: float) -> dict[str, Any]:
    airspeed = law.gains.airspeed
    return {
        **_HEAD[airspeed],
        "channels": len(law.law.channels),
        "least_speed": _number(LEAST_SPEED),
        "beyond_stop": _number(BEYOND_STOP),
        "uses_V_a": _USED if law.law.per_speed or airspeed else _UNUSED,
        "g": _number(g),
        "per_speed": _number(law.law.per_speed),
        "feed_forward": int(law.feed_forward),
    }


def _speed_priority(channel: bool, beside: bool, g: float) -> str:
    """The C function that reduces the path angle to keep airspeed, if it is used."""
    if not (channel or beside):
        return ""
    return Template((_FOLDER / "speed_priority.c").read_text(encoding="utf-8")).substitute(
        per_speed=_number(APPROACH / g) if channel else f"{_number(APPROACH_BESIDE)} / V_ref",
        least_share=_number(LEAST_SHARE if channel else LEAST_SHARE_BESIDE),
        steepest_dive=_number(STEEPEST_DIVE),
        least_speed=_number(LEAST_SPEED),
        wind_s=_number(WIND_ESTIMATE_S),
    )


def _of_exact_law(law: RateLaw) -> dict[str, Any]:
    names = "per_g", "lift_floor", "brake", "turn_brake"
    numbers = {name: _number(getattr(law, name)) for name in names}
    return {**numbers, "course_first": int(law.course_first), "feedback": _numbers(law.feedback)}


def monitor_source(monitor: Watching, *, title: str, dt: float, no_claim: str = "") -> str:
    """The C99 text of a monitor, sampled every `dt` (s); it needs only ``math.h``.

    `no_claim`: why its claim does not cover flights of the scenario.
    """
    watches, lags = monitor.watches, count()
    models, from_s = watches[0].models, watches[0].from_s
    terms = [_term(text, lags) for model in models for text in (*model.terms, model.target)]
    # The residual is the target minus the weighted terms.
    weights = (
        np.concatenate([[*np.negative(model.weights), 1.0] for model in watch.models]).tolist()
        for watch in watches
    )
    keep_mean = [math.exp(-dt / model.mean_s) if model.mean_s else 0.0 for model in models]
    keep_past = [math.exp(-dt / model.past_s) if model.past_s else 1.0 for model in models]
    return Template((_FOLDER / "monitor.c").read_text(encoding="utf-8")).substitute(
        title=_comment(title),
        version=version("flighttune"),
        claim=_comment(
            f"No claim about flights of this scenario: {no_claim}. It was counted on others: "
            f"{monitor.sentence}"
            if no_claim
            else monitor.sentence
        ),
        dt=_number(dt),
        models=len(models),
        watches=len(watches),
        terms=len(terms),
        lags=next(lags),
        first_judged=round(from_s / dt),
        names=", ".join(f'"{model.name}"' for model in models),
        signals=", ".join(signals_of(models)),
        first_term=", ".join(map(str, accumulate([0, *(len(x.terms) + 1 for x in models)]))),
        weights=_rows(weights),
        middle=_rows(watch.middle.tolist() for watch in watches),
        half=_rows(watch.half.tolist() for watch in watches),
        keep_term=_number(math.exp(-dt / LAG_S)),
        keep_mean=_numbers(keep_mean),
        keep_past=_numbers(keep_past),
        most=_numbers(0.0 if model.loss else math.inf for model in models),
        lag_s=_number(LAG_S),
        step="\n".join(f"    term[{i}] = {term};" for i, term in enumerate(terms)),
    )


def _term(text: str, lags: Iterator[int]) -> str:
    """A term of a monitor in C, behind its lag; a rate has a lag of its own."""
    product, is_rate = "1.0", False
    for operation, rate, name in FACTOR.findall(text):
        value = _QUANTITIES.get(name, f"s->{name}")
        if rate:
            value, is_rate = f"ft_rate(m, {next(lags)}, {value})", True
        product += f" {operation or '*'} {value}"
    return product if is_rate else f"ft_lagged(m, {next(lags)}, {product})"


def _rows(rows: Iterable[Iterable[float]]) -> str:
    """The rows of a matrix in C."""
    return ", ".join(f"{{{_numbers(row)}}}" for row in rows)


def _comment(text: str) -> str:
    return " ".join(text.replace("*/", "* /").split())


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(map(_number, values))


def _number(value: float) -> str:
    return repr(value).replace("inf", "INFINITY")


Form: TypeAlias = Literal["jsbsim", "c"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedSource(Answering):
    """The outer loop as a file of C99."""

    source: Path
    notes: tuple[str, ...] = ()
    monitor: Path | None = None  # valid in C99 too


def export(
    scenario: Scenario | str | Path,
    gains: PIGains | str | None = None,
    *,
    out: str | Path,
    plant: str | None = None,
    form: Form = "jsbsim",
    claim: Monitor | LogMonitor | Path | str | None = None,
    changes: Mapping[str, Any] | None = None,
) -> ExportedFlight | ExportedSource:
    """Write one flight of a scenario for JSBSim alone, or its outer loop in C.

    JSBSim flies the folder at once in a separate process, and its flight is compared with `fly`.
    This takes seconds.

    Parameters
    ----------
    scenario : Scenario, str or Path
        A scenario, its file, or the name of a shipped scenario.
    gains : PIGains or str, optional
        Gains, or a gain set by name or file; by default the first of the scenario.
    out : str or Path
        Folder to write to; files of the same names are replaced.
    plant : str, optional
        Label of the plant, by default the first aircraft.
    form : {"jsbsim", "c"}
        A folder that JSBSim flies by itself, or one C99 file.
    claim : Monitor, LogMonitor, Path or str, optional
        A monitor, or its file, which is also written in C.
    changes : mapping of str to value, optional
        Values to set in the scenario by dotted key.

    Returns
    -------
    ExportedFlight or ExportedSource
        The files, and how the two flights compare.

    Raises
    ------
    InputError
        If the scenario has no such aircraft, a wind that changes, or a law without this form, or if
        the claim is not a monitor or not for C.
    InfeasibleError
        If tuning finds no such gains.
    PlantError
        If the aircraft cannot be built or has no steady flight to start from.
    OutputError
        If the folder cannot be written.

    Examples
    --------
    >>> ft.export("paper", "paper", out="loop", form="c").source.name
    'ft_outer_loop.c'
    """
    entry = chosen_entry(scenario, gains, changes)
    loaded = entry.scenario
    notes = loaded.gains_notes(plant, entry.name)
    watching = load_one(claim, "monitor", BAND, MONITOR)
    if watching is not None and not (isinstance(watching, Watching) and form == "c"):
        got = type(watching).__name__
        raise InputError(f"`claim` must be a monitor, for the form c, got a {got} for {form}.")
    if form == "jsbsim":
        loaded.check_over_time("an export", airspeed=True)
    if form == "jsbsim" or plant or loaded.aircraft:
        entry = replace(entry, plant=aircraft_table(loaded, plant))
    notes = (*notes, *needs(entry))
    if form == "c":
        monitor = None
        with together(out):
            source = export_c(entry, Path(out))
            if watching is not None:
                if why := watching.not_counted(entry):
                    notes = (f"no claim about flights of this scenario: {why}.", *notes)
                dt = 1.0 / loaded.controller.rate_hz
                text = monitor_source(watching, title=loaded.title, dt=dt, no_claim=why)
                monitor = write_text(source.with_name(MONITOR_SOURCE), text)
        return ExportedSource(source=source, notes=notes, monitor=monitor)
    flight = export_jsbsim(entry, Path(out).absolute())
    return replace(flight, notes=notes)
