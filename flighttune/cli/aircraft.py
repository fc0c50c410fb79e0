"""Commands about an aircraft: adopt one, trim it, design and identify its inner loop."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from flighttune.cli.options import check_ending, out_folder
from flighttune.cli.show import INTERRUPTED, fail, on_interrupt, pick, quiet, tell
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table, figures
from flighttune.shipped import aircraft_names, is_shipped
from flighttune.units import DEG

# Share of the variance, in percent, below which the answer of `identify` is no.
GOOD_FIT = 90.0

TRIM_COLUMNS = columns(
    "V_a_mps gamma_deg trim.alpha_deg trim.beta_deg trim.elevator_deg trim.rudder_deg "
    "trim.throttle reason"
)
SPEED_COLUMNS = [
    *columns("V_a_mps"),
    Column("gamma", "steady at γ", "deg"),
    Column("throttle", "throttle"),
    Column("reason", "not steady at γ [deg], and why"),
]
MODE_COLUMNS = [
    *columns("name"),
    Column("eigenvalue_per_s.0", "real part", "1/s"),
    Column("eigenvalue_per_s.1", "imaginary part", "rad/s"),
    *columns("natural_frequency_rad_s damping"),
]
FIT_NOTE = (
    "fit: share of the variance explained in a manoeuvre not used for the fit; cross: largest "
    "response of the other channel, 1/rad (phi) and rad (n_z)"
)

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
    gamma: Annotated[list[float] | None, _path_angles("-10 to 45, or the glide")] = None,
    phi: Annotated[float, Option("--phi", help="Bank angle in deg.")] = 0.0,
    h: HeightOption = 1000.0,
    verbose: Annotated[
        bool, Option("--verbose", "-v", help="Print every condition, with angles and surfaces.")
    ] = False,
) -> Answer:
    """Trim AIRCRAFT over its envelope; where no trim exists, say why."""
    from flighttune.aircraft.aircraft import load_aircraft
    from flighttune.plants.jsbsim.trim import trim_table

    config = load_aircraft(aircraft)
    angles = [angle * DEG for angle in gamma] if gamma else None
    records = trim_table(config, V_a=V_a or None, gamma=angles, phi=phi * DEG, h=h)
    failure = f"{aircraft}: no steady flight among {len(records)}: {records[0]['reason']}"
    table = Table(TRIM_COLUMNS, records, f"{config.title}: steady flight")
    # With one path angle for each airspeed the table of all conditions is as short.
    if not verbose and len({record["V_a_mps"] for record in records}) < len(records):
        table = replace(table, columns=SPEED_COLUMNS, records=list(_speeds(records)))
    return Answer(
        values={"aircraft": aircraft, "trims": records},
        tables=[table],
        failure="" if any(record["trim"] for record in records) else failure,
    )


def _speeds(records: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """A row for each airspeed: where flight is steady, and why not at the other path angles."""
    for V_a, group in groupby(records, key=lambda record: record["V_a_mps"]):
        own = sorted(group, key=lambda record: record["gamma_deg"])
        steady = [record for record in own if record["trim"]]
        reasons = [
            f"{_range(record['gamma_deg'] for record in alike)}: {reason}"
            for reason, alike in groupby(own, key=lambda record: record["reason"])
            if reason
        ]
        yield {
            "V_a_mps": V_a,
            "gamma": _range(record["gamma_deg"] for record in steady),
            "throttle": _range(record["trim"]["throttle"] for record in steady),
            "reason": "; ".join(reasons),
        }


def _range(values: Iterable[float]) -> str:
    """``-5 to 10``, or the only value; empty without values."""
    ordered = sorted(values)
    return " to ".join(dict.fromkeys(figures(value) for value in (*ordered[:1], *ordered[-1:])))


def design(
    aircraft: AircraftArgument,
    out: Annotated[
        Path | None, out_folder("the aircraft's own; required for a shipped one")
    ] = None,
    dry_run: Annotated[
        bool, Option("--dry-run", help="Print the gains; write no file and no figure.")
    ] = False,
) -> Answer:
    """Design the gains of AIRCRAFT's inner loop, check its step responses and write the gains."""
    from flighttune.aircraft.aircraft import load_aircraft, save_gains
    from flighttune.identify.design import design_aircraft
    from flighttune.identify.steps import steps_table

    before = load_aircraft(aircraft)
    config, steps = design_aircraft(before)
    written, figure = None, None
    gains, place = config.gains, out or config.folder
    missed = [step for step in steps if not step.met]
    assert gains is not None  # a design makes them
    if out is None and is_shipped(config.folder) and not dry_run:
        raise InputError(f"{aircraft}: --out must be given for an aircraft that is shipped.")
    if not (dry_run or missed):
        from flighttune.identify.steps import FIGURE, step_figure

        written, figure = save_gains(gains, place), place / FIGURE
        step_figure(config, steps).save(figure)
    previous = before.gains.gains if before.gains else {}
    compared = [
        {"gain": name, "designed": value, "before": previous.get(name)}
        for name, value in gains.gains.items()
    ]
    failure = ""
    if missed:
        first = missed[0]
        ended = f": {first.ended}" if first.ended else ""
        failure = (
            f"{first.name}: t90 must be at most {first.t90_allowed:g} s and the overshoot "
            f"{100.0 * first.overshoot_allowed:g} %, got {first.t90:.2f} s and "
            f"{100.0 * first.overshoot:.1f} %{ended}; nothing is written"
        )
    return Answer(
        values={"gains": gains.gains},
        tables=[
            Table(columns("gain designed before"), compared, config.title),
            steps_table(steps),
        ],
        verdict="" if written else "nothing is written",
        files={"written": written, "figure": figure},
        failure=failure,
    )


def identify(
    aircraft: AircraftArgument,
    V_a: Annotated[list[float] | None, _airspeeds("that of the design")] = None,
    gamma: Annotated[list[float] | None, _path_angles("0, or the glide")] = None,
    h: HeightOption = 1000.0,
    seed: Annotated[int, Option(help="Seed of the excitation.", min=0)] = 0,
    out: Annotated[
        Path | None,
        Option(
            help="Model file to write, with a figure of the same name [default: identified.json in "
            "the aircraft's folder; for a shipped one runs/identified/AIRCRAFT.json]."
        ),
    ] = None,
) -> Answer:
    """Identify AIRCRAFT's roll and load-factor response in flight; write a model to tune on."""
    from flighttune.aircraft.aircraft import load_aircraft
    from flighttune.identify.figure import identification_figure
    from flighttune.identify.file import FILE_NAME, identified_tables, lags_table, save_identified
    from flighttune.identify.identify import identify_aircraft

    check_ending(out, ".json")
    angles = [angle * DEG for angle in gamma or ()]
    made = identify_aircraft(aircraft, V_a=V_a or (), gamma=angles, h=h, seed=seed)
    name, nominal = made.identified.aircraft, made.conditions[0]
    folder = load_aircraft(aircraft).folder
    shipped = Path("runs") / "identified" / f"{name}.json"
    model = out or (shipped if is_shipped(folder) else folder / FILE_NAME)
    figure = model.with_suffix(".svg")
    place = f"{name} at {nominal.condition.V_a:g} m/s, {nominal.condition.gamma / DEG:g} deg"
    save_identified(made.identified, model)
    identification_figure(nominal, place).save(figure)
    conditions = identified_tables(made.identified)["conditions"]
    poor = [
        f"{channel} at {c.V_a:g} m/s, {c.gamma / DEG:g} deg: {fitted.fit_percent:.1f} %"
        for c in made.identified.conditions
        for channel, fitted in c.channels.items()
        if fitted.fit_percent < GOOD_FIT
    ]
    poor_fit = f"{aircraft}: a lag explains less than {GOOD_FIT:g} % of {'; '.join(poor)}"
    return Answer(
        values={
            "aircraft": name,
            "channels": conditions[0]["channels"],
            "conditions": conditions,
            "skipped": made.skipped,
        },
        tables=[
            lags_table(made.identified),
            Table(
                MODE_COLUMNS, made.modes, f"{place}: airframe without the inner loop", name="modes"
            ),
        ],
        notes=[FIT_NOTE, *(f"left out: {reason}" for reason in made.skipped)],
        files={"model": model, "figure": figure},
        failure=poor_fit if poor else "",
    )


def adopt(
    model: Annotated[
        str,
        Argument(
            metavar="MODEL|FILE.xml|FOLDER",
            help="A model that comes with JSBSim, or the main file of another; also the file "
            "NAME-set.xml of an aircraft of FlightGear, or the folder that holds it.",
        ),
    ],
    V_a: Annotated[
        float | None, Option("--V-a", help="Airspeed in m/s [default: chosen by the model].")
    ] = None,
    h: HeightOption = 1000.0,
    out: Annotated[Path | None, out_folder("aircraft/MODEL")] = None,
) -> Answer:
    """Make an aircraft from a JSBSim model: find its surfaces and engines, tune it and fly it.

    Surfaces, engines and airspeed are found by experiment; the inner loop is designed, flown and
    identified, the outer loop is tuned on the identified model and flown in a turn, compared with
    the paper's gains scaled with airspeed.
    """
    from flighttune.adopt.adopt import TURN
    from flighttune.adopt.adopt import adopt as adopt_model
    from flighttune.adopt.page import flights_table, write_adoption

    name = Path(os.path.abspath(model)).stem.removesuffix("-set")
    try:
        with on_interrupt():
            adoption = adopt_model(
                model, out or Path("aircraft") / name, V_a=V_a, h=h, say=_progress
            )
            page = write_adoption(adoption) if adoption.folder else None
    except KeyboardInterrupt:
        fail("interrupted; what is written is whole", INTERRUPTED)
    failure = f"{model}: {adoption.status}: {adoption.reason}"
    return Answer(
        values={
            **pick(adoption, "status reason engines seconds"),
            "V_a_mps": adoption.V_a,
            **pick(adoption, "fit_percent flown"),
        },
        tables=[flights_table(adoption)],
        notes=adoption.notes,
        verdict=f"{adoption.status} in {adoption.seconds:.0f} s",
        files={
            "folder": adoption.folder,
            "scenario": adoption.folder / TURN if adoption.folder else None,
            "page": page,
        },
        failure="" if adoption.status == "adopted" else failure,
    )


def _progress(line: str) -> None:
    if not quiet():
        tell(line)
