"""Commands about an aircraft itself: its inner loop and its steady flights."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flighttune.cli.show import NO, JsonOption, fail, print_json, print_table, say

if TYPE_CHECKING:
    from flighttune.plants.jsbsim.design_aircraft import DesignedAircraft
    from flighttune.plants.jsbsim.trim_table import TrimRow

AircraftArgument = Annotated[
    str, typer.Argument(metavar="AIRCRAFT", help="A shipped aircraft, or the folder of one.")
]


def design(
    aircraft: AircraftArgument,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show the gains; write no file and no figure.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Make the gains of AIRCRAFT's inner loop, fly its steps, write gains and figure."""
    from flighttune.plants.jsbsim.aircraft import load_aircraft
    from flighttune.plants.jsbsim.design_aircraft import design_aircraft, write_gains

    designed = design_aircraft(load_aircraft(aircraft))
    config, figure = designed.config, None
    written = not (dry_run or designed.missed)
    if written:
        from flighttune.plants.jsbsim.step_figure import draw_steps

        write_gains(config.file, config.gains)
        figure = draw_steps(config, designed.checks, config.folder)
    if as_json:
        print_json(_design_json(designed, config.file if written else None, figure))
    else:
        _print_design(designed, written)
    if designed.missed:
        first = designed.missed[0]
        fail(
            f"{first.name}: t90 must be at most {first.t90_allowed:g} s and the overshoot "
            f"{100.0 * first.overshoot_allowed:g} %, got {first.step.t90:.2f} s and "
            f"{100.0 * first.step.overshoot:.1f} %{first.step.ended and ': ' + first.step.ended}; "
            "nothing is written",
            NO,
        )


def trim(
    aircraft: AircraftArgument,
    V_a: Annotated[
        list[float] | None, typer.Option("--V-a", help="Airspeeds in m/s; by default the envelope.")
    ] = None,
    gamma: Annotated[
        list[float] | None, typer.Option("--gamma", help="Flight-path angles in deg.")
    ] = None,
    phi: Annotated[float, typer.Option("--phi", help="Bank in deg.")] = 0.0,
    h: Annotated[float, typer.Option("--h", help="Height in m.")] = 1000.0,
    as_json: JsonOption = False,
) -> None:
    """Show the steady flights of AIRCRAFT, and why there is none where there is none."""
    from flighttune.plants.jsbsim.aircraft import load_aircraft
    from flighttune.plants.jsbsim.trim_table import trim_table

    config = load_aircraft(aircraft)
    rows = trim_table(
        config,
        V_a=V_a or None,
        gamma=None if not gamma else [math.radians(angle) for angle in gamma],
        phi=math.radians(phi),
        h=h,
    )
    if as_json:
        print_json({"aircraft": aircraft, "trims": [_trim_json(row) for row in rows]})
    else:
        _print_trims(config.title, rows)
    if not any(row.point for row in rows):
        fail(f"{aircraft}: no steady flight among {len(rows)}: {rows[0].reason}", NO)


def _design_json(
    designed: "DesignedAircraft", file: Path | None, figure: Path | None
) -> dict[str, Any]:
    return {
        "written": None if file is None else str(file),
        "figure": None if figure is None else str(figure),
        "gains": dict(designed.config.gains),
        "steps": [
            {
                "channel": check.step.channel,
                "V_a_mps": check.step.V_a,
                "step": check.step.size,
                "t90_s": check.step.t90,
                "overshoot": check.step.overshoot,
                "met": check.met,
            }
            for check in designed.checks
        ],
    }


def _print_design(designed: "DesignedAircraft", written: bool) -> None:
    gains = [
        (name, f"{value:.4g}", f"{designed.previous.get(name, math.nan):.4g}")
        for name, value in designed.config.gains.items()
    ]
    print_table(designed.config.title, ("gain", "designed", "before"), gains)
    steps = [
        (
            check.name,
            f"{check.step.t90:.2f}",
            f"{check.t90_allowed:g}",
            f"{100.0 * check.step.overshoot:.1f}",
            f"{100.0 * check.overshoot_allowed:g}",
            "yes" if check.met else "no",
        )
        for check in designed.checks
    ]
    header = ("step", "t90 in s", "at most", "overshoot in %", "at most", "met")
    print_table("steps flown", header, steps)
    say(f"written: {designed.config.file}" if written else "nothing is written")


def _trim_json(row: "TrimRow") -> dict[str, Any]:
    c, point = row.condition, row.point
    found = (
        None
        if point is None
        else {
            "alpha_deg": math.degrees(point.alpha),
            "beta_deg": math.degrees(point.beta),
            "theta_deg": math.degrees(point.theta),
            "aileron_deg": math.degrees(point.aileron),
            "elevator_deg": math.degrees(point.elevator),
            "rudder_deg": math.degrees(point.rudder),
            "throttle": point.throttle,
        }
    )
    return {
        "V_a_mps": c.V_a,
        "gamma_deg": math.degrees(c.gamma),
        "phi_deg": math.degrees(c.phi),
        "h_m": c.h,
        "trim": found,
        "reason": row.reason,
    }


def _print_trims(title: str, rows: "tuple[TrimRow, ...]") -> None:
    table = []
    for row in rows:
        c, point = row.condition, row.point
        found = ("-",) * 5
        if point is not None:
            angles = (point.alpha, point.beta, point.elevator, point.rudder)
            found = (*(f"{math.degrees(a):.2f}" for a in angles), f"{point.throttle:.3f}")
        table.append((f"{c.V_a:g}", f"{math.degrees(c.gamma):g}", *found, row.reason))
    header = ("V_a m/s", "γ deg", "α deg", "β deg", "elevator", "rudder", "throttle", "no trim")
    print_table(f"{title}: steady flight", header, table)
