"""The command that measures an aircraft's inner loop."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flighttune.cli.show import NO, JsonOption, fail, print_json, print_table, say
from flighttune.units import DEG

if TYPE_CHECKING:
    from flighttune.plants.identification.model import IdentifiedChannel
    from flighttune.plants.jsbsim.identify import AircraftIdentification

GOOD_FIT = 90.0
"""Share of the held-out variance, in percent, below which the answer is no."""


def identify(
    aircraft: Annotated[
        str, typer.Argument(metavar="AIRCRAFT", help="A shipped aircraft, or a folder with one.")
    ],
    V_a: Annotated[
        list[float] | None,
        typer.Option("--V-a", help="Airspeed in m/s; may be repeated. By default the design's."),
    ] = None,
    gamma: Annotated[
        list[float] | None,
        typer.Option("--gamma", help="Flight-path angle in deg; may be repeated. By default 0."),
    ] = None,
    h: Annotated[float, typer.Option("--h", help="Height above sea level in m.")] = 1000.0,
    seed: Annotated[int, typer.Option(help="Of the excitation.", min=0)] = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="Model file; by default runs/identified/AIRCRAFT.json. A figure of the "
                     "same name is drawn beside it."),
    ] = None,
    as_json: JsonOption = False,
) -> None:  # fmt: skip
    """Measure how AIRCRAFT follows roll and load-factor commands; write a model to tune on."""
    from flighttune.errors import InputError
    from flighttune.plants.identification.file import save_identified
    from flighttune.plants.jsbsim.identify import identify_aircraft
    from flighttune.report.identification import identification_figure, save_figure

    if out is not None and out.suffix != ".json":
        raise InputError(f"--out: must be a file that ends in .json, got {str(out)!r}.")
    found = identify_aircraft(
        aircraft,
        V_a=V_a or (),
        gamma=[angle * DEG for angle in gamma or (0.0,)],
        h=h,
        seed=seed,
    )
    name = found.identified.aircraft
    model = out if out is not None else Path("runs") / "identified" / f"{name}.json"
    figure = model.with_suffix(".png")
    nominal = found.conditions[0]
    place = f"{name} at {nominal.condition.V_a:g} m/s, {nominal.condition.gamma / DEG:g} deg"
    save_identified(found.identified, model)
    save_figure(identification_figure(nominal, place), figure)
    if as_json:
        print_json(_json(found, model, figure))
    else:
        _print(found, place)
        say(f"model: {model}   figure: {figure}")
    poor = [
        f"{channel} at {c.V_a:g} m/s, {c.gamma / DEG:g} deg: {fitted.fit_percent:.1f} %"
        for c in found.identified.conditions
        for channel, fitted in (("phi", c.phi), ("n_z", c.n_z))
        if fitted.fit_percent < GOOD_FIT
    ]
    if poor:
        fail(f"{aircraft}: a lag explains less than {GOOD_FIT:g} % of {'; '.join(poor)}", NO)


def _json(found: "AircraftIdentification", model: Path, figure: Path) -> dict[str, Any]:
    from flighttune.plants.identification.file import identified_tables

    tables = identified_tables(found.identified)
    return {
        "aircraft": tables["aircraft"],
        "channels": tables["conditions"][0]["channels"],
        "conditions": tables["conditions"],
        "skipped": list(found.skipped),
        "modes": [
            {
                "name": mode.name,
                "eigenvalue_per_s": [mode.eigenvalue.real, mode.eigenvalue.imag],
                "natural_frequency_rad_s": mode.natural_frequency,
                "damping": mode.damping,
            }
            for mode in found.rigid_body.modes
        ],
        "model": str(model),
        "figure": str(figure),
    }


def _print(found: "AircraftIdentification", place: str) -> None:
    header = (
        "V_a m/s", "gamma deg", "channel", "order", "w rad/s", "damping", "lag s", "delay s",
        "bandwidth rad/s", "cross", "fit %",
    )  # fmt: skip
    rows = [
        (f"{c.V_a:g}", f"{c.gamma / DEG:g}", name, *_cells(channel))
        for c in found.identified.conditions
        for name, channel in (("phi", c.phi), ("n_z", c.n_z))
    ]
    print_table(f"{found.identified.aircraft}: inner loop as flown", header, rows)
    say(
        "fit: share of the variance of a manoeuvre that was not used; cross: largest answer of the "
        "other channel, 1/rad (phi) and rad (n_z)"
    )
    for reason in found.skipped:
        say(f"left out: {reason}")
    modes = [
        (
            mode.name,
            f"{mode.eigenvalue.real:.3f}",
            f"{mode.eigenvalue.imag:.3f}",
            f"{mode.natural_frequency:.3f}",
            f"{mode.damping:.3f}",
        )
        for mode in found.rigid_body.modes
    ]
    header = ("mode", "real part 1/s", "imaginary part rad/s", "w rad/s", "damping")
    print_table(f"{place}: airframe without the inner loop", header, modes)


def _cells(channel: "IdentifiedChannel") -> tuple[str, ...]:
    lag = channel.lag
    return (
        str(lag.order),
        f"{lag.natural_frequency:.2f}",
        f"{lag.damping:.2f}" if lag.order > 1 else "-",
        f"{lag.lag:.3f}" if lag.order > 2 else "-",
        f"{lag.delay:.3f}",
        f"{lag.bandwidth:.2f}",
        f"{channel.cross:.3f}",
        f"{channel.fit_percent:.1f}",
    )
