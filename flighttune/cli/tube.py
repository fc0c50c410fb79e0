"""The command that encloses all flights of a scenario, and answers about tubes."""

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from flighttune.cli import options
from flighttune.cli.gains import chosen_gains, gains_table
from flighttune.cli.show import NO, fail, pick, progress_bar
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import CHANNEL_SYMBOLS, columns
from flighttune.present.tables import Column, Table
from flighttune.units import DEG

if TYPE_CHECKING:
    from flighttune.simulate.run import Run
    from flighttune.tube.problem import Tube
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
LOST = "`flighttune band` bounds such flights with a probability, without a model."
LIMIT_KEYS = ("lower", "upper", "rate_lower", "rate_upper")
LIMIT_COLUMNS = [*columns(f"command {' '.join(LIMIT_KEYS)}"), Column("held_s", "can hold", "s")]
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
    scenario: options.ScenarioArgument,
    gains: options.GainsOption = None,
    plant: Annotated[str | None, options.plant_label("the first that is not an aircraft")] = None,
    start_deg: options.StartOption = 0.0,
    disturbance: Annotated[
        float | None,
        Option(help="Bound on the disturbance of each rate, rad/s [default: the scenario's]."),
    ] = None,
    conformance: Annotated[
        Path | None,
        Option(help="File of `flighttune conform`: bound its aircraft, with rates in its boxes."),
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
    settings: options.SetOption = None,
) -> Answer:
    """Enclose all flights of SCENARIO with one gain set, limits included; prove the bounds.

    Exit status 1 if the set cannot be bounded for the whole time, or if a flight leaves it.
    """
    from flighttune.conformance.file import load_conformance
    from flighttune.tube import tube as tube_module
    from flighttune.tube.problem import tube_problem
    from flighttune.tube.proof import save_tube
    from flighttune.tube.store import write_signals

    options.check_ending(out, ".npz")
    loaded, name, chosen = chosen_gains(scenario, gains, settings)
    law, _ = loaded.law_of(name, chosen)
    place = f"{scenario}: gains {name}"
    if not law.by_gains:
        fail(f"{place}: a tube must be of the paper's law, got one of your own.", NO)
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
            return _tried(tube_module.largest_disturbance(problem, progress=follow), name)
        enclosure = tube_module.tube_of(problem, progress=follow)
    inside = tube_module.flights_inside(enclosure)
    answer = enclosed(enclosure, name)
    signals = proof = None
    notes, failure = [*answer.notes], ""
    # A tube that its own flight leaves is wrong: neither bounds nor a proof of them are written.
    if not inside:
        failure = f"{place}: a flight leaves the tube, so no file is written."
    else:
        signals = (out or Path("runs") / f"{Path(scenario).stem}-tube.npz").with_suffix(".parquet")
        write_signals(enclosure, signals)
    if enclosure.status != "bounded":
        failure = f"{place}: {enclosure.reason}"
    elif inside and out is not None:
        save_tube(enclosure, out)
        proof = out
        if problem.boxes is not None:
            notes.append(f"Check the boxes too: flighttune verify {out} --conformance FILE")
    return Answer(
        values={**answer.values, "inside": inside, "seconds": time.perf_counter() - began},
        tables=answer.tables,
        notes=notes,
        verdict="The flights flown with it are inside."
        if inside
        else "A flight flown with it leaves the tube.",
        files={"signals": signals, "proof": proof},
        failure=failure,
    )


def _tried(tubes: Sequence["Tube"], gains: str) -> Answer:
    """The disturbances that were tried; a failure if none is bounded."""
    records = [
        {"disturbance": tube.problem.disturbance, **pick(tube, "status reason")} for tube in tubes
    ]
    bounded = [record["disturbance"] for record in records if record["status"] == "bounded"]
    largest = max(bounded, default=None)
    title = tubes[0].problem.scenario.title
    failure = f"{title}: gains {gains}: for no disturbance tried the set is bounded."
    verdict = f"largest disturbance for which the set is bounded: {largest} rad/s"
    return Answer(
        values={"largest_disturbance": largest},
        tables=[Table(TRIED_COLUMNS, records, "tried", name="tried")],
        verdict=verdict if bounded else "",
        failure="" if bounded else failure,
    )


def enclosed(tube: "Tube", gains: str) -> Answer:
    """The flights that a tube encloses and its widths; `gains` names its gains."""
    import numpy as np

    problem, widths = tube.problem, tube.bounds.half_widths / DEG
    flight, limits, counted = problem.scenario.flight, problem.limits, problem.conformance
    ever = None if tube.hand_over is None else (0.5 / DEG * np.ptp(tube.hand_over.bounds, axis=1))
    half_widths = {
        channel: {
            "max": float(widths[:, i].max()),
            "end": float(widths[-1, i]),
            "ever": None if ever is None else float(ever[i]),
        }
        for i, channel in enumerate(CHANNEL_SYMBOLS)
        if len(widths)
    }
    low, high = problem.disturbances
    lowest, highest = low.min(axis=0).tolist(), high.max(axis=0).tolist()
    limited = {name: tube.held_intervals(i) for i, name in enumerate(("phi_cmd", "n_z_cmd"))}
    about = {
        "plant": problem.plant,
        **pick(flight, "duration_s V_a_mps"),
        "rate_hz": problem.scenario.controller.rate_hz,
        "start": dict(zip(CHANNEL_SYMBOLS, problem.path_at_start, strict=True)),
        "within": problem.start,
        "end": dict(zip(CHANNEL_SYMBOLS, problem.reference[-1, :2].tolist(), strict=True)),
    }
    disturbance = [
        {"channel": channel, "low": lower, "high": upper}
        for channel, lower, upper in zip(CHANNEL_SYMBOLS, lowest, highest, strict=True)
    ]
    commands = [
        {
            "command": name,
            **{key: float(getattr(limits, key)[i]) * unit for key in LIMIT_KEYS},
            "held_s": [f"{begin:g} to {end:g}" for begin, end in intervals] or "never",
        }
        for i, (name, unit, intervals) in enumerate(
            zip(("phi_cmd [deg]", "n_z_cmd"), (1.0 / DEG, 1.0), limited.values(), strict=True)
        )
    ]
    if tube.status != "bounded":
        notes = [LOST] if problem.boxes else []
    elif tube.hand_over is None:
        notes = ["There is no claim beyond the end of the scenario: no invariant set was found."]
    else:
        notes = [
            f"From {tube.handed_over:.2f} s on no limit ever holds a command, under disturbances "
            "within those at the end."
        ]
    if counted is not None:
        notes.append(f"counted: {counted.sentence}")
    if tube.probability is not None:
        notes.append(tube.probability.sentence)
    kind = problem.table.family.enclosed
    title = f"{problem.scenario.title!r}; gains {gains}, {kind}: {tube.status}"
    return Answer(
        values={
            **pick(tube, "status reason probability"),
            "model": problem.model,
            "half_width_deg": half_widths,
            "limits_can_hold": limited,
            "handed_over_s": tube.handed_over,
            "gains": problem.gains.as_lists(),
            "start_rad": problem.start,
            "disturbance_rad_s": [lowest, highest],
            "counted": counted.sentence if counted else None,
        },
        tables=[
            Table(
                WIDTH_COLUMNS, [{"error": key, **own} for key, own in half_widths.items()], title
            ),
            Table(FLIGHT_COLUMNS, [about], "flights"),
            Table(DISTURBANCE_COLUMNS, disturbance, "any disturbance of the rates"),
            Table(LIMIT_COLUMNS, commands, "limits, rates per second"),
            gains_table("gains", problem.gains),
        ],
        notes=notes,
    )


def tubes_around(
    runs: Sequence["Run"],
    folder: Path,
    command: str,
    *,
    make: bool,
    conformance: Path | None,
    scenario: str = "",
) -> "tuple[RunTubes, Answer]":
    """The tubes of runs found in a folder, and their part of the answer of a command.

    With `make`, missing tubes are computed; otherwise a note names the `command` that computes
    them. A flight outside its tube is a failure. `scenario`: the one that was flown, where it is
    clear which.
    """
    from flighttune.conformance.file import load_conformance
    from flighttune.tube.store import tubes_of

    boxes = None if conformance is None else load_conformance(conformance)
    with progress_bar() as progress:
        tubes = tubes_of(runs, folder, make=make, conformance=boxes, progress=progress)
    return tubes, tubes_answer(tubes, command, scenario)


def tubes_answer(tubes: "RunTubes", command: str, scenario: str = "") -> Answer:
    """The tubes of runs of a scenario as part of an answer; `command` computes missing ones."""
    from flighttune.scenario.load import scenario_from

    of_tube = "status reason model start_deg handed_over_s probability worst"
    values = {
        label: {
            **pick(tube.about, of_tube),
            "half_width_deg": {
                channel: {key: width / DEG for key, width in widths.items()}
                for channel, widths in tube.half_widths.items()
            },
            **pick(tube, "inside computed file"),
        }
        for label, tube in tubes.tubes.items()
    }
    flown = {run.label: run.provenance for run in tubes.runs}
    source = scenario or "SCENARIO"
    if any(run.band for run in tubes.runs):
        hint = ""
    elif any(made.scenario.get("route") for made in flown.values()):
        drawn = f"{command.removesuffix(' --tube')} --band FILE"
        hint = (
            "To count how wide the corridor of the route is: "
            f"flighttune band {source} --start-deg 1 --out FILE, then {drawn}"
        )
    elif any(made.aircraft for made in flown.values()):
        hint = (
            "To bound the errors of an aircraft, which takes minutes of flights: "
            f"flighttune conform {source} --start-deg 1 --out FILE, then "
            f"{command} --conformance FILE"
        )
    elif any(made.scenario.get("disturbance") for made in flown.values()):
        hint = f"To bound the errors under the disturbance: {command}"
    else:  # nothing drives a law off its own flight
        hint = ""
    notes = []
    for label, tube in tubes.tubes.items():
        searched = "SCENARIO|CAMPAIGN"
        if scenario:
            start, made = tube.about.start_deg, flown[label]
            drawn = f"--start-deg {start:g}" if start else "--disturbance RAD_PER_S"
            searched = f"{scenario} --gains {made.gains_name} --plant {made.plant} {drawn}"
        air = scenario_from(dict(flown[label].scenario)).air
        notes.append(_note(label, tube, air, searched))
    notes += [f"{label}: no tube: {why}" for label, why in tubes.why_not.items()]
    outside = ", ".join(tubes.outside)
    records = [{"run": label, **own} for label, own in values.items()]
    return Answer(
        values={"tubes": values},
        tables=[Table(RUN_COLUMNS, records, "tubes")],
        notes=notes or ([hint] if hint else []),
        failure=f"{outside}: the flight leaves its tube." if outside else "",
    )


def _note(label: str, tube: "RunTube", air: str, searched: str) -> str:
    """The model of a tube, where it is lost, its probability, and how to find its worst flight.

    `searched`: arguments of ``worst`` that say which flights it searches.
    """
    about, sentences = tube.about, [f"{label}: its tube is that of {tube.about.model}, in {air}."]
    if about.reason:
        sentences.append(f"It is lost: {about.reason}. {LOST}")
    if about.probability:
        sentences.append(f"{about.probability.sentence}.")
    if about.worst is None:
        search = f"flighttune worst {searched} --tube {tube.file}"
        sentences.append(f"To search for the flight that comes closest to its bounds: {search}")
    return " ".join(sentences)
