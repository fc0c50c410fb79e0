"""The command that encloses all flights of a scenario."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from flighttune.cli.gain_sets import chosen_gains, gains_table
from flighttune.cli.options import GainsOption, ScenarioArgument, check_ending
from flighttune.cli.progress import progress_bar
from flighttune.cli.show import NO, emit, fail, pick
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import CHANNEL_SYMBOLS, columns
from flighttune.present.tables import Column, Table
from flighttune.units import DEG

NOT_CHECKED = "for the boxes in the file; that an aircraft keeps them is not checked here"
"""Said of the tube of an aircraft that was read without the conformance of its boxes."""

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flighttune.control.gains import PIGains
    from flighttune.control.law import Law
    from flighttune.scenario.schema import Scenario
    from flighttune.simulate.run import Run
    from flighttune.tube.of_run import RunTubes
    from flighttune.tube.result import Tube

WIDTH_COLUMNS = [
    *columns("error"),
    Column("max", "largest half-width", "deg"),
    Column("end", "at the end", "deg"),
    Column("ever", "ever after", "deg"),
]
TRIED_COLUMNS = [Column("disturbance", "disturbance", "rad/s", ".2g"), *columns("status reason")]
FLIGHT_COLUMNS = [
    *columns("plant duration_s V_a_mps rate_hz"),
    Column("start.chi", "course at the start", "deg", factor=1.0 / DEG),
    Column("start.gamma", "path angle at the start", "deg", factor=1.0 / DEG),
    Column("within", "from within", "deg", factor=1.0 / DEG),
    Column("end.chi", "course of the reference at the end", "deg", factor=1.0 / DEG),
    Column("end.gamma", "path angle of the reference at the end", "deg", factor=1.0 / DEG),
]
DISTURBANCE_COLUMNS = [
    *columns("channel"),
    Column("low", "lowest", "rad/s"),
    Column("high", "highest", "rad/s"),
]
LIMIT_COLUMNS = columns("command lower upper rate_lower rate_upper")


def tube(
    scenario: ScenarioArgument,
    gains: GainsOption = None,
    plant: Annotated[
        str | None,
        Option(
            help="Label of the plant as `fly` prints it [default: the first that is not an "
            "aircraft]."
        ),
    ] = None,
    start_deg: Annotated[
        float,
        Option(help="Largest deviation from the scenario's start, course and path angle, deg."),
    ] = 0.0,
    disturbance: Annotated[
        float | None,
        Option(
            help="Bound on the disturbance of each rate, of any shape, rad/s [default: the "
            "amplitudes of the scenario's sinusoid, or none]."
        ),
    ] = None,
    conformance: Annotated[
        Path | None,
        Option(
            help="File of `flighttune conform`: bound its aircraft, with residual rates in the "
            "boxes."
        ),
    ] = None,
    out: Annotated[
        Path | None, Option("--out", help="Proof file (.npz) to write; `verify` checks it.")
    ] = None,
    largest_disturbance: Annotated[
        bool,
        Option(
            "--largest-disturbance",
            help="Search, to two digits, for the largest disturbance for which the set is bounded.",
        ),
    ] = False,
) -> None:
    """Enclose all flights of SCENARIO with one gain set, limits included; prove the bounds.

    Exit status 1 if the set cannot be bounded for the whole time, or if a flight leaves it.
    """
    import time

    from flighttune.conformance import load_conformance
    from flighttune.scenario import load_scenario
    from flighttune.tube.flights import flights_inside
    from flighttune.tube.proof import save_tube
    from flighttune.tube.signals import write_signals
    from flighttune.tube.tube import tube as tube_of

    check_ending(out, ".npz")
    loaded = load_scenario(scenario)
    name, chosen = chosen_gains(loaded, gains)
    law, _ = loaded.law_of(name, chosen)
    if not law.by_gains:
        fail(
            f"{scenario}: gains {name}: a tube must be of the paper's law, got one of your own.", NO
        )
    if largest_disturbance:
        if disturbance is not None or conformance is not None or out is not None:
            raise InputError(
                "`largest_disturbance` must stand without --disturbance, --conformance and --out."
            )
        _largest_disturbance(loaded, name, chosen, plant=plant, start=start_deg * DEG, law=law)
        return
    began = time.perf_counter()
    with progress_bar() as progress:
        enclosure = tube_of(
            loaded,
            chosen,
            plant=plant,
            start=start_deg * DEG,
            disturbance=disturbance,
            conformance=None if conformance is None else load_conformance(conformance),
            law=law,
            progress=None if progress is None else (lambda part: progress(f"tube {name}", part)),
        )
    inside = flights_inside(enclosure)
    # A tube that its own flight leaves is wrong: neither bounds nor a proof of them are written.
    signals = proof = None
    if inside:
        signals = (out or Path("runs") / f"{Path(scenario).stem}-tube.npz").with_suffix(".parquet")
        write_signals(enclosure, signals)
    if inside and enclosure.status == "bounded" and out is not None:
        save_tube(enclosure, out)
        proof = out
    values = tube_values(enclosure)
    notes = bounds_after(enclosure)
    if proof is not None and enclosure.problem.boxes is not None:
        notes.append(f"Check the boxes too: flighttune verify {proof} --conformance FILE")
    emit(
        Answer(
            values={**values, "inside": inside, "seconds": time.perf_counter() - began},
            tables=problem_tables(enclosure, values, name),
            notes=notes,
            verdict="The flights flown with it are inside."
            if inside
            else "A flight flown with it leaves the tube.",
            files={"signals": signals, "proof": proof},
        )
    )
    if enclosure.status != "bounded":
        fail(f"{scenario}: gains {name}: {enclosure.reason}", NO)
    if not inside:
        fail(f"{scenario}: gains {name}: a flight leaves the tube, so that no file is written.", NO)


def _largest_disturbance(
    scenario: "Scenario",
    name: str,
    gains: "PIGains",
    *,
    plant: str | None,
    start: float,
    law: "Law",
) -> None:
    from flighttune.tube.tube import largest_disturbance

    with progress_bar() as progress:
        tried = largest_disturbance(
            scenario,
            gains,
            plant=plant,
            start=start,
            law=law,
            progress=None if progress is None else (lambda part: progress(f"tube {name}", part)),
        )
    records = [
        {"disturbance": float(run.problem.d_high.max()), **pick(run, "status reason")}
        for run in tried
    ]
    bounded = [record["disturbance"] for record in records if record["status"] == "bounded"]
    largest = max(bounded, default=None)
    emit(
        Answer(
            values={"largest_disturbance": largest},
            tables=[Table(title="tried", name="tried", columns=TRIED_COLUMNS, records=records)],
            verdict=""
            if largest is None
            else f"largest disturbance for which the set is bounded: {largest:.2g} rad/s",
        )
    )
    if largest is None:
        fail(f"{scenario.title}: gains {name}: for no disturbance tried the set is bounded.", NO)


def tube_values(tube: "Tube") -> dict[str, Any]:
    """A tube as ``--json`` has it."""
    problem, widths = tube.problem, tube.half_widths[:, :2] / DEG
    ever = None
    if tube.hand_over is not None:
        ever = 0.5 * (tube.hand_over.bounds[:, 1] - tube.hand_over.bounds[:, 0]) / DEG
    return {
        **pick(tube, "status reason model"),
        "probability": tube.probability,
        "half_width_deg": {
            channel: {
                "max": float(column.max()),
                "end": float(column[-1]),
                "ever": None if ever is None else float(ever[i]),
            }
            for i, (channel, column) in enumerate(zip(("chi", "gamma"), widths.T, strict=True))
            if len(column)
        },
        "limits_can_hold": {
            name: tube.held_intervals(i) for i, name in enumerate(("phi_cmd", "n_z_cmd"))
        },
        "handed_over_s": tube.handed_over,
        "counted_from_s": tube.counted_from,
        "gains": problem.gains.as_lists(),
        "start_rad": problem.start,
        "disturbance_rad_s": [problem.d_low.min(axis=0), problem.d_high.max(axis=0)],
        "counted": problem.conformance.sentence if problem.conformance else None,
    }


def problem_tables(tube: "Tube", values: Mapping[str, Any], gains: str) -> list[Table]:
    """Tables of the flights that a tube encloses and its widths; `gains` names its gains."""
    problem = tube.problem
    flight, limits = problem.scenario.flight, problem.limits
    kind = problem.table.family.enclosed
    title = f"{problem.scenario.title!r}; gains {gains}, {kind}: {tube.status}"
    widths = [{"error": channel, **own} for channel, own in values["half_width_deg"].items()]
    about = {
        "plant": problem.plant,
        "duration_s": flight.duration_s,
        "V_a_mps": flight.V_a_mps,
        "rate_hz": problem.scenario.controller.rate_hz,
        "start": dict(zip(CHANNEL_SYMBOLS, problem.path_at_start, strict=True)),
        "within": problem.start,
        "end": dict(zip(CHANNEL_SYMBOLS, problem.reference[-1, :2].tolist(), strict=True)),
    }
    low, high = problem.d_low.min(axis=0), problem.d_high.max(axis=0)
    disturbance = [
        {"channel": name, "low": float(low[i]), "high": float(high[i])}
        for i, name in enumerate(CHANNEL_SYMBOLS)
    ]
    commands = [
        {
            "command": name,
            **{
                key: float(values[i]) * unit
                for key, values in (
                    ("lower", limits.lower),
                    ("upper", limits.upper),
                    ("rate_lower", limits.rate_lower),
                    ("rate_upper", limits.rate_upper),
                )
            },
        }
        for i, (name, unit) in enumerate((("phi_cmd [deg]", 1.0 / DEG), ("n_z_cmd", 1.0)))
    ]
    at_limit = [
        {"command": name, "from_s": begin, "to_s": end}
        for name, intervals in values["limits_can_hold"].items()
        for begin, end in intervals or [("never", None)]
    ]
    return [
        Table(title=title, columns=WIDTH_COLUMNS, records=widths),
        Table(title="flights", columns=FLIGHT_COLUMNS, records=[about]),
        Table(
            title="any disturbance of the rates", columns=DISTURBANCE_COLUMNS, records=disturbance
        ),
        Table(title="limits, rates per second", columns=LIMIT_COLUMNS, records=commands),
        Table(title="a limit can hold", columns=columns("command from_s to_s"), records=at_limit),
        gains_table("gains", problem.gains),
    ]


def bounds_after(tube: "Tube") -> list[str]:
    """Sentences on the bounds after the enclosed time, and on the flights counted."""
    problem = tube.problem
    if tube.lost is not None:
        boxes = (
            "in the file"
            if problem.aircraft_checked is False
            else "that flights were counted against"
        )
        notes = [f"{tube.reason}: the bounds on the errors are those {boxes}."]
    elif tube.hand_over is None:
        notes = ["There is no claim beyond the end of the scenario: no invariant set was found."]
    else:
        notes = [
            f"From {tube.handed_over:.2f} s on no limit ever holds a command, under disturbances "
            "within those at the end."
        ]
    if problem.conformance is not None:
        notes.append(f"counted: {problem.conformance.sentence}")
    if tube.probability is not None:
        notes.append(tube.probability.sentence)
    return notes


def run_tubes(
    runs: "Sequence[Run]", folder: Path, *, make: bool, conformance: Path | None
) -> "RunTubes":
    """The tubes of runs that are in a folder; with `make` also those that are not."""
    from flighttune.tube.of_run import tubes_of

    boxes = None
    if conformance is not None:
        from flighttune.conformance import load_conformance

        boxes = load_conformance(conformance)
    with progress_bar() as progress:
        return tubes_of(runs, folder, make=make, conformance=boxes, progress=progress)


def run_tubes_values(tubes: "RunTubes") -> dict[str, Any]:
    """Tubes of runs as ``--json`` has them, by label of the run."""
    return {
        label: {
            **pick(tube.about, "status reason model start_deg handed_over_s counted_from_s"),
            "probability": tube.about.probability,
            "half_width_deg": {
                channel: dict(zip(("max", "end"), widths.tolist(), strict=True))
                for channel, widths in zip(("chi", "gamma"), tube.half_widths / DEG, strict=True)
            },
            "inside": label not in tubes.outside,
        }
        for label, tube in tubes.found.items()
    }


def run_tubes_notes(tubes: "RunTubes", how: str) -> list[str]:
    """A sentence for each tube, for each that could not be made, or how to make them."""
    notes = [tubes.sentence(label) for label in tubes.found]
    notes += [f"{label}: no tube: {why}" for label, why in tubes.why_not.items()]
    return notes or [f"No tube around the errors yet: {how} makes it."]


def fail_if_outside(tubes: "RunTubes") -> None:
    """End the command with status 1 if a flight leaves its tube."""
    if tubes.outside:
        fail(f"{', '.join(tubes.outside)}: the flight leaves its tube.", NO)
