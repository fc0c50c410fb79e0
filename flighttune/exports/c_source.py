"""The outer loop as one C99 file, for a board."""

from collections.abc import Iterable
from pathlib import Path
from string import Template

from flighttune import __version__
from flighttune.control.gains import PIGains
from flighttune.control.mimo_pi import BEYOND_STOP, MimoPI
from flighttune.files.whole import write_text
from flighttune.flight.conditions import command_limits, lead_on
from flighttune.flight.fly import aircraft_table, plant_of
from flighttune.flight.models import law_setup
from flighttune.references.priority import APPROACH, LEAST_SHARE, STEEPEST_DIVE
from flighttune.scenario.schema import Scenario
from flighttune.units import G_PAPER

SOURCE = "ft_outer_loop.c"

_TEMPLATE = Path(__file__).with_name("outer_loop.c")
_USED = "V_a is the airspeed."
_UNUSED = "V_a is not used: the gains are not scheduled."

# Words of the head of the file, for two channels and for three.
_HEAD = (
    {"airspeed_error": "", "n_x_command": "", "or_along": " (or ft_outer_loop_step_along)"},
    {"airspeed_error": " and of airspeed", "n_x_command": " and n_x", "or_along": ""},
)


def export_c(
    scenario: Scenario, name: str, gains: PIGains, folder: Path, *, plant: str | None = None
) -> Path:
    """Write the outer loop of one gain set as a C file, limited as the aircraft `plant` is."""
    limits = command_limits(scenario)
    if plant is not None or scenario.aircraft:
        limits = limits.within(plant_of(aircraft_table(scenario, plant), scenario).limits)
    law, _ = scenario.law_of(name, gains)
    controller = law.discrete_pi(law_setup(scenario, gains, limits))
    if controller is None:
        raise law.refusal("discrete_pi", "exported")
    lead = lead_on(scenario, aircraft_table(scenario, plant) if scenario.aircraft else None)
    source = c_source(
        controller, title=scenario.title, gains=name, lead=lead, g=scenario.flight.g_mps2
    )
    write_text(folder / SOURCE, source)
    return folder / SOURCE


def c_source(
    law: MimoPI,
    *,
    title: str,
    gains: str,
    lead: tuple[float, float] = (0.0, 0.0),
    g: float = G_PAPER,
) -> str:
    """The C99 text of a controller, which needs nothing but the C library's ``math.h``.

    `lead` (s) has the lags of roll and load factor; `g` (m/s^2) is the acceleration of gravity.
    """
    values, channels, airspeed = law.law, law.law.channels, law.gains.airspeed
    return Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=_comment(title),
        gains=_comment(gains),
        version=__version__,
        **_HEAD[airspeed],
        channels=len(channels),
        priority_per_g=_number(APPROACH / g),
        least_share=_number(LEAST_SHARE),
        steepest_dive=_number(STEEPEST_DIVE),
        beyond_stop=_number(BEYOND_STOP),
        uses_V_a=_USED if values.per_speed or airspeed else _UNUSED,
        dt=_number(law.dt),
        g=_number(g),
        lead_phi=_number(lead[0]),
        lead_n_z=_number(lead[1]),
        conditional=int(values.conditional),
        tracking_gain=_number(values.tracking_gain),
        per_speed=_number(values.per_speed),
        feed_forward=int(law.feed_forward),
        K_P=", ".join(f"{{{_numbers(channel.K_P)}}}" for channel in channels),
        K_I_half=", ".join(f"{{{_numbers(channel.K_I_half)}}}" for channel in channels),
        **{
            name: _numbers(getattr(channel, name) for channel in channels)
            for name in ("lower", "upper", "step_down", "step_up")
        },
    )


def _comment(text: str) -> str:
    return " ".join(text.replace("*/", "* /").split())


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(map(_number, values))


def _number(value: float) -> str:
    return repr(value).replace("inf", "INFINITY")
