"""The command that encloses all flights of a scenario, and answers about tubes."""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from flighttune.cli import options
from flighttune.cli.gains import chosen_gains
from flighttune.cli.show import NO, fail, pick, progress_bar
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table
from flighttune.units import DEG

if TYPE_CHECKING:
    from flighttune.tubes.enclosure import Tube

TRIED_COLUMNS = [Column("disturbance", "disturbance", "rad/s", ".2g"), *columns("status reason")]


def tube(
    scenario: options.ScenarioArgument,
    gains: options.GainsOption = None,
    plant: Annotated[str | None, options.plant_label("the first that is not an aircraft")] = None,
    start_deg: options.StartOption = 0.0,
    disturbance: Annotated[
        float | None,
        Option(
            help="Bound on the disturbance of each rate, rad/s [default: the scenario's, or the "
            "residual of the logs of a model]."
        ),
    ] = None,
    boxes: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="File of `flighttune band --of residual`: bound its aircraft, with rates in it.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        Option("--out", help="Proof file (.npz) to write [default: runs/NAME-tube.npz]."),
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
    from flighttune.campaign.band import load_band
    from flighttune.campaign.claims import save_claim
    from flighttune.tubes import tube as tubes
    from flighttune.tubes.problem import tube_problem

    options.check_ending(out, ".npz")
    if largest_disturbance and (disturbance, boxes, out) != (None, None, None):
        raise InputError(
            "`largest_disturbance` must not be given with --disturbance, --boxes or --out."
        )
    loaded, name, chosen = chosen_gains(scenario, gains, settings)
    place, began = f"{scenario}: gains {name}", time.perf_counter()
    law, _ = loaded.law_of(name, chosen)
    if not law.by_gains:
        fail(f"{place}: a tube must be of the paper's law, got one of your own.", NO)
    with progress_bar() as progress:
        follow = None if progress is None else partial(progress, f"tube {name}")
        if largest_disturbance:
            problem = tube_problem(loaded, chosen, plant=plant, start=start_deg * DEG, law=law)
            return _tried(tubes.largest_disturbance(problem, progress=follow), name)
        enclosure = tubes.tube(
            loaded,
            name if gains is None else gains,
            None if boxes is None else load_band(boxes),
            plant=plant,
            start=start_deg * DEG,
            disturbance=disturbance,
            progress=follow,
        )
    answer, proof = enclosure.answer(name), None
    notes, inside = [*answer.notes], enclosure.reason != tubes.LEFT
    if enclosure.status == "bounded":
        proof = out or Path("runs") / f"{Path(scenario).stem}-tube.npz"
        save_claim(enclosure, proof)
        if enclosure.problem.boxes is not None:
            notes.append(f"Check the boxes too: flighttune verify {proof} --boxes FILE")
    return replace(
        answer,
        values={**answer.values, "inside": inside, "seconds": time.perf_counter() - began},
        notes=notes,
        verdict="The flights flown with it are inside." if inside else "",
        files={"proof": proof},
        failure=f"{place}: {answer.failure}" if answer.failure else "",
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
