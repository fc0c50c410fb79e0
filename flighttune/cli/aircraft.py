"""Commands about an aircraft itself: trims, and design and identification of its inner loop."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flighttune.cli.options import aircraft_names, check_ending, out_folder
from flighttune.cli.show import NO, emit, fail, pick, table
from flighttune.errors import InputError
from flighttune.present.numbers import number
from flighttune.present.tables import Bad, Table
from flighttune.shipped import is_shipped
from flighttune.units import DEG

if TYPE_CHECKING:
    from flighttune.identify.design import DesignedAircraft
    from flighttune.identify.identify import AircraftIdentification
    from flighttune.plants.jsbsim.trim import TrimRow

GOOD_FIT = 90.0
"""Share of the variance, in percent, below which the answer of `identify` is no."""

AircraftArgument = Annotated[
    str,
    Argument(
        metavar="AIRCRAFT",
        help="A shipped aircraft, or the folder of one.",
        autocompletion=aircraft_names,
    ),
]
HeightOption = Annotated[float, Option("--h", help="Height above sea level in m.")]


def _airspeeds(default: str) -> Any:
    return Option("--V-a", help=f"Airspeed in m/s; repeatable [default: {default}].")


def _path_angles(default: str) -> Any:
    return Option("--gamma", help=f"Flight-path angle in deg; repeatable [default: {default}].")


def trim(
    aircraft: AircraftArgument,
    V_a: Annotated[list[float] | None, _airspeeds("six over the envelope")] = None,
    gamma: Annotated[list[float] | None, _path_angles("-10 to 45")] = None,
    phi: Annotated[float, Option("--phi", help="Bank angle in deg.")] = 0.0,
    h: HeightOption = 1000.0,
) -> None:
    """Trim AIRCRAFT over its envelope; where no trim exists, say why."""
    from flighttune.aircraft.aircraft import load_aircraft
    from flighttune.plants.jsbsim.trim import trim_table

    config = load_aircraft(aircraft)
    angles = [angle * DEG for angle in gamma] if gamma else None
    rows = trim_table(config, V_a=V_a or None, gamma=angles, phi=phi * DEG, h=h)
    head = "V_a [m/s], γ [deg], α [deg], β [deg], elevator [deg], rudder [deg], throttle, no trim"
    emit(
        {"aircraft": aircraft, "trims": [_trim_json(row) for row in rows]},
        [
            table(
                f"{config.title}: steady flight",
                head.split(", "),
                [_trim_cells(row) for row in rows],
            )
        ],
    )
    if not any(row.point for row in rows):
        fail(f"{aircraft}: no steady flight among {len(rows)}: {rows[0].reason}", NO)


def design(
    aircraft: AircraftArgument,
    out: Annotated[
        Path | None, out_folder("the aircraft's own; required for a shipped one")
    ] = None,
    dry_run: Annotated[
        bool, Option("--dry-run", help="Print the gains; write no file and no figure.")
    ] = False,
) -> None:
    """Design the gains of AIRCRAFT's inner loop, check its step responses and write the gains."""
    from flighttune.aircraft.aircraft import load_aircraft, save_gains
    from flighttune.identify.design import design_aircraft

    designed = design_aircraft(load_aircraft(aircraft))
    config, figure = designed.config, None
    gains, place = config.gains, out or config.folder
    assert gains is not None  # a design makes them
    if out is None and is_shipped(config.folder) and not dry_run:
        raise InputError(f"{aircraft}: --out must be given for an aircraft that is shipped.")
    written = None
    if not (dry_run or designed.missed):
        from flighttune.identify.step_figure import FILE_NAME, step_figure

        written, figure = save_gains(gains, place), place / FILE_NAME
        step_figure(config, designed.checks).save(figure)
    answer = {
        "written": written,
        "figure": figure,
        "gains": gains.gains,
        "steps": [
            {
                **pick(check.step, "channel overshoot"),
                "V_a_mps": check.step.V_a,
                "step": check.step.size,
                "t90_s": check.step.t90,
                "met": check.met,
            }
            for check in designed.checks
        ],
    }
    emit(answer, _design_text(designed, written))
    if designed.missed:
        first = designed.missed[0]
        fail(
            f"{first.name}: t90 must be at most {first.t90_allowed:g} s and the overshoot "
            f"{100.0 * first.overshoot_allowed:g} %, got {first.step.t90:.2f} s and "
            f"{100.0 * first.step.overshoot:.1f} %{first.step.ended and ': ' + first.step.ended}; "
            "nothing is written",
            NO,
        )


def identify(
    aircraft: AircraftArgument,
    V_a: Annotated[list[float] | None, _airspeeds("that of the design")] = None,
    gamma: Annotated[list[float] | None, _path_angles("0")] = None,
    h: HeightOption = 1000.0,
    seed: Annotated[int, Option(help="Seed of the excitation.", min=0)] = 0,
    out: Annotated[
        Path | None,
        Option(
            help="Model file to write, with a figure of the same name [default: identified.json in "
            "the aircraft's folder; for a shipped one runs/identified/AIRCRAFT.json]."
        ),
    ] = None,
) -> None:
    """Identify AIRCRAFT's roll and load-factor response in flight; write a model to tune on."""
    from flighttune.aircraft.aircraft import load_aircraft
    from flighttune.identify.file import FILE_NAME, identified_tables, save_identified
    from flighttune.identify.identify import identify_aircraft
    from flighttune.report.identification import identification_figure

    check_ending(out, ".json")
    angles = [angle * DEG for angle in gamma or (0.0,)]
    found = identify_aircraft(aircraft, V_a=V_a or (), gamma=angles, h=h, seed=seed)
    name, nominal = found.identified.aircraft, found.conditions[0]
    folder = load_aircraft(aircraft).folder
    shipped = Path("runs") / "identified" / f"{name}.json"
    model = out or (shipped if is_shipped(folder) else folder / FILE_NAME)
    figure = model.with_suffix(".svg")
    place = f"{name} at {nominal.condition.V_a:g} m/s, {nominal.condition.gamma / DEG:g} deg"
    save_identified(found.identified, model)
    identification_figure(nominal, place).save(figure)
    tables = identified_tables(found.identified)
    answer = {
        "aircraft": tables["aircraft"],
        "channels": tables["conditions"][0]["channels"],
        "conditions": tables["conditions"],
        "skipped": found.skipped,
        "modes": [
            {
                "name": mode.name,
                "eigenvalue_per_s": mode.eigenvalue,
                "natural_frequency_rad_s": mode.natural_frequency,
                "damping": mode.damping,
            }
            for mode in found.rigid_body.modes
        ],
        "model": model,
        "figure": figure,
    }

    def text() -> Iterator[Table | str]:
        yield from _identification_text(found, place)
        yield f"model: {model}   figure: {figure}"

    emit(answer, text())
    poor = [
        f"{channel} at {c.V_a:g} m/s, {c.gamma / DEG:g} deg: {fitted.fit_percent:.1f} %"
        for c in found.identified.conditions
        for channel, fitted in (("phi", c.phi), ("n_z", c.n_z))
        if fitted.fit_percent < GOOD_FIT
    ]
    if poor:
        fail(f"{aircraft}: a lag explains less than {GOOD_FIT:g} % of {'; '.join(poor)}", NO)


def _trim_json(row: "TrimRow") -> dict[str, Any]:
    condition, point = row.condition, row.point
    angles = "alpha beta theta aileron elevator rudder"
    return {
        "V_a_mps": condition.V_a,
        **_in_deg(condition, "gamma phi"),
        "h_m": condition.h,
        "trim": point and {**_in_deg(point, angles), "throttle": point.throttle},
        "reason": row.reason,
    }


def _in_deg(value: object, names: str) -> dict[str, float]:
    """Angles of `value` in degrees, with the unit at the end of each key."""
    return {f"{name}_deg": math.degrees(angle) for name, angle in pick(value, names).items()}


def _trim_cells(row: "TrimRow") -> tuple[str, ...]:
    cells = ["-"] * 5
    if row.point is not None:
        angles = pick(row.point, "alpha beta elevator rudder").values()
        cells = [*(f"{angle / DEG:z.2f}" for angle in angles), f"{row.point.throttle:.3f}"]
    return f"{row.condition.V_a:g}", f"{row.condition.gamma / DEG:g}", *cells, Bad(row.reason)


def _design_text(designed: "DesignedAircraft", written: Path | None) -> Iterator[Table | str]:
    from flighttune.identify.steps import steps_table

    config = designed.config
    gains = [
        (name, f"{value:.4g}", number(designed.previous.get(name, math.nan)))
        for name, value in (config.gains.gains if config.gains else {}).items()
    ]
    yield table(config.title, ("gain", "designed", "before"), gains)
    yield steps_table(designed.checks)
    yield f"written: {written}" if written else "nothing is written"


def _identification_text(found: "AircraftIdentification", place: str) -> Iterator[Table | str]:
    from flighttune.identify.model import lags_table

    yield lags_table(found.identified)
    yield (
        "fit: share of the variance explained in a manoeuvre not used for the fit; cross: largest "
        "response of the other channel, 1/rad (phi) and rad (n_z)"
    )
    for reason in found.skipped:
        yield f"left out: {reason}"
    modes = []
    for mode in found.rigid_body.modes:
        pole = mode.eigenvalue
        values = (pole.real, pole.imag, mode.natural_frequency, mode.damping)
        modes.append((mode.name, *(f"{value:.3f}" for value in values)))
    head = ("mode", "real part [1/s]", "imaginary part [rad/s]", "ω [rad/s]", "damping")
    yield table(f"{place}: airframe without the inner loop", head, modes)
