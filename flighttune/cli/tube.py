"""The command that encloses all flights of a scenario."""

from collections.abc import Mapping
from functools import partial
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
"""Qualification of a proof for an aircraft that was read without the conformance of its boxes."""

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flighttune.simulate.run import Run
    from flighttune.tube.result import Tube
    from flighttune.tube.store import RunTube, RunTubes

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
    Column("within", "start within", "deg", factor=1.0 / DEG),
    Column("end.chi", "course of the reference at the end", "deg", factor=1.0 / DEG),
    Column("end.gamma", "path angle of the reference at the end", "deg", factor=1.0 / DEG),
]
DISTURBANCE_COLUMNS = [
    *columns("channel"),
    Column("low", "lowest", "rad/s"),
    Column("high", "highest", "rad/s"),
]
LIMIT_KEYS = ("lower", "upper", "rate_lower", "rate_upper")
RUN_COLUMNS = [
    Column("run", "run"),
    Column("start_deg", "from starts within", "deg"),
    *(
        Column(f"half_width_deg.{channel}.{key}", f"{symbol} {words}", "deg", ".2g")
        for key, words in (("max", "±"), ("end", "± at the end"))
        for channel, symbol in CHANNEL_SYMBOLS.items()
    ),
    Column("handed_over_s", "for ever from", "s"),
    *columns("inside"),
    Column("computed", "proven now"),
    *(
        Column(f"worst.{channel}", f"tube over worst flight {symbol}", digits=".2g")
        for channel, symbol in CHANNEL_SYMBOLS.items()
    ),
]


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
    from flighttune.tube import tube as tube_module
    from flighttune.tube.problem import tube_problem
    from flighttune.tube.proof import save_tube
    from flighttune.tube.store import write_signals

    check_ending(out, ".npz")
    loaded = load_scenario(scenario)
    name, chosen = chosen_gains(loaded, gains)
    law, _ = loaded.law_of(name, chosen)
    if not law.by_gains:
        fail(
            f"{scenario}: gains {name}: a tube must be of the paper's law, got one of your own.", NO
        )
    if largest_disturbance and (disturbance, conformance, out) != (None, None, None):
        raise InputError(
            "`largest_disturbance` must not be given with --disturbance, --conformance or --out."
        )
    began = time.perf_counter()
    problem = tube_problem(
        loaded,
        chosen,
        plant=plant,
        start=start_deg * DEG,
        disturbance=disturbance,
        conformance=None if conformance is None else load_conformance(conformance),
        law=law,
    )
    with progress_bar() as progress:
        follow = None if progress is None else partial(progress, f"tube {name}")
        if largest_disturbance:
            _tried(tube_module.largest_disturbance(problem, progress=follow), name)
            return
        enclosure = tube_module.tube_of(problem, progress=follow)
    inside = tube_module.flights_inside(enclosure)
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
        fail(f"{scenario}: gains {name}: a flight leaves the tube, so no file is written.", NO)


def _tried(tubes: "Sequence[Tube]", gains: str) -> None:
    """Show the disturbances that were tried, and end with status 1 if none is bounded."""
    records = [
        {"disturbance": tube.problem.disturbance, **pick(tube, "status reason")} for tube in tubes
    ]
    bounded = [record["disturbance"] for record in records if record["status"] == "bounded"]
    largest = max(bounded, default=None)
    verdict = f"largest disturbance for which the set is bounded: {largest} rad/s"
    emit(
        Answer(
            values={"largest_disturbance": largest},
            tables=[Table(title="tried", name="tried", columns=TRIED_COLUMNS, records=records)],
            verdict=verdict if bounded else "",
        )
    )
    if not bounded:
        title = tubes[0].problem.scenario.title
        fail(f"{title}: gains {gains}: for no disturbance tried the set is bounded.", NO)


def tube_values(tube: "Tube") -> dict[str, Any]:
    """The values of a tube that ``--json`` prints."""
    import numpy as np

    problem, widths = tube.problem, tube.bounds.half_widths / DEG
    ever = None if tube.hand_over is None else (0.5 / DEG * np.ptp(tube.hand_over.bounds, axis=1))
    low, high = problem.disturbances
    return {
        **pick(tube, "status reason probability"),
        "model": problem.model,
        "half_width_deg": {
            channel: {
                "max": float(widths[:, i].max()),
                "end": float(widths[-1, i]),
                "ever": None if ever is None else float(ever[i]),
            }
            for i, channel in enumerate(CHANNEL_SYMBOLS)
            if len(widths)
        },
        "limits_can_hold": {
            name: tube.held_intervals(i) for i, name in enumerate(("phi_cmd", "n_z_cmd"))
        },
        "handed_over_s": tube.handed_over,
        "counted_from_s": tube.counted_from,
        "gains": problem.gains.as_lists(),
        "start_rad": problem.start,
        "disturbance_rad_s": [low.min(axis=0), high.max(axis=0)],
        "counted": problem.conformance.sentence if problem.conformance else None,
    }


def problem_tables(tube: "Tube", values: Mapping[str, Any], gains: str) -> list[Table]:
    """Tables of the flights that a tube encloses and its widths; `gains` names its gains."""
    problem = tube.problem
    flight, limits = problem.scenario.flight, problem.limits
    kind = problem.table.family.enclosed
    about = {
        "plant": problem.plant,
        **pick(flight, "duration_s V_a_mps"),
        "rate_hz": problem.scenario.controller.rate_hz,
        "start": dict(zip(CHANNEL_SYMBOLS, problem.path_at_start, strict=True)),
        "within": problem.start,
        "end": dict(zip(CHANNEL_SYMBOLS, problem.reference[-1, :2].tolist(), strict=True)),
    }
    disturbance = [
        {"channel": channel, "low": float(low), "high": float(high)}
        for channel, low, high in zip(CHANNEL_SYMBOLS, *values["disturbance_rad_s"], strict=True)
    ]
    commands = [
        {"command": name} | {key: float(getattr(limits, key)[i]) * unit for key in LIMIT_KEYS}
        for i, (name, unit) in enumerate((("phi_cmd [deg]", 1.0 / DEG), ("n_z_cmd", 1.0)))
    ]
    at_limit = [
        {"command": name, "from_s": begin, "to_s": end}
        for name, intervals in values["limits_can_hold"].items()
        for begin, end in intervals or [("never", None)]
    ]
    return [
        Table(
            title=f"{problem.scenario.title!r}; gains {gains}, {kind}: {tube.status}",
            columns=WIDTH_COLUMNS,
            records=[{"error": name, **own} for name, own in values["half_width_deg"].items()],
        ),
        Table(title="flights", columns=FLIGHT_COLUMNS, records=[about]),
        Table(
            title="any disturbance of the rates", columns=DISTURBANCE_COLUMNS, records=disturbance
        ),
        Table(
            title="limits, rates per second",
            columns=columns(" ".join(["command", *LIMIT_KEYS])),
            records=commands,
        ),
        Table(title="a limit can hold", columns=columns("command from_s to_s"), records=at_limit),
        gains_table("gains", problem.gains),
    ]


def bounds_after(tube: "Tube") -> list[str]:
    """Sentences on the bounds after the enclosed time, and on the flights counted."""
    problem = tube.problem
    if tube.lost is not None:
        boxes = "that flights were counted against" if problem.conformance else "in the file"
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
    """The tubes of runs found in a folder; with `make`, missing ones are computed."""
    from flighttune.conformance import load_conformance
    from flighttune.tube.store import tubes_of

    boxes = None if conformance is None else load_conformance(conformance)
    with progress_bar() as progress:
        return tubes_of(runs, folder, make=make, conformance=boxes, progress=progress)


def run_tubes_values(tubes: "RunTubes") -> dict[str, Any]:
    """The values of the tubes of runs that ``--json`` prints, by label of the run."""
    return {
        label: {
            **pick(
                tube.about,
                "status reason model start_deg handed_over_s counted_from_s probability worst",
            ),
            "half_width_deg": {
                channel: {key: width / DEG for key, width in widths.items()}
                for channel, widths in tube.half_widths.items()
            },
            **pick(tube, "inside computed file"),
        }
        for label, tube in tubes.tubes.items()
    }


def run_tubes_table(tubes: "RunTubes") -> Table:
    """Widths of the tubes of runs, and whether the flights are inside."""
    records = [{"run": label, **values} for label, values in run_tubes_values(tubes).items()]
    return Table(title="tubes", columns=RUN_COLUMNS, records=records)


def run_tubes_notes(tubes: "RunTubes", how: str) -> list[str]:
    """The model of each tube and its probability, why a run has none, or how to make them."""
    notes = [_note(label, tube) for label, tube in tubes.tubes.items()]
    notes += [f"{label}: no tube: {why}" for label, why in tubes.why_not.items()]
    return notes or [f"No tube around the errors yet: {how} makes it."]


def _note(label: str, tube: "RunTube") -> str:
    about, lost = tube.about, ""
    if about.reason:
        counted = about.counted_from_s is not None
        lost = f" It is lost{', and the bounds are those counted' if counted else ''}: "
        lost += f"{about.reason}."
    chance = f" {about.probability.sentence}." if about.probability else ""
    worst = ""
    if about.worst is None:
        worst = f" flighttune worst SCENARIO|CAMPAIGN --tube {tube.file} searches its worst flight."
    return f"{label}: a tube of {about.model}.{lost}{chance}{worst}"


def fail_if_outside(tubes: "RunTubes") -> None:
    """End the command with status 1 if a flight leaves its tube."""
    if tubes.outside:
        fail(f"{', '.join(tubes.outside)}: the flight leaves its tube.", NO)
