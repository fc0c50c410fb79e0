"""The command that encloses all flights of a scenario."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from flighttune.cli.gain_sets import chosen_gains
from flighttune.cli.options import GainsOption, ScenarioArgument, check_ending
from flighttune.cli.progress import progress_bar
from flighttune.cli.show import NO, emit, fail, pick
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table
from flighttune.units import DEG

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flighttune.simulate.run import Run
    from flighttune.tube.of_run import RunTubes
    from flighttune.tube.result import Tube

WIDTH_COLUMNS = [
    *columns("error"),
    Column("max", "largest half-width", "deg"),
    Column("end", "at the end", "deg"),
    Column("ever", "ever after", "deg"),
]
LIMITED_COLUMNS = columns("command from_s to_s")


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
) -> None:
    """Enclose all flights of SCENARIO with one gain set, limits included; prove the bounds.

    Exit status 1 if the set cannot be bounded for the whole time.
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
    if loaded.is_own_law(name):
        fail(
            f"{scenario}: gains {name}: a tube must be of the paper's law, got one of your own.", NO
        )
    began = time.perf_counter()
    with progress_bar() as progress:
        found = tube_of(
            loaded,
            chosen,
            plant=plant,
            start=start_deg * DEG,
            disturbance=disturbance,
            conformance=None if conformance is None else load_conformance(conformance),
            law=name.rpartition(":")[0] or "exact",
            progress=progress and (lambda part: progress(f"tube {name}", part)),
        )
    inside = flights_inside(found)
    signals = (out or Path("runs") / f"{Path(scenario).stem}-tube.npz").with_suffix(".parquet")
    write_signals(found, signals)
    if out is not None and found.status == "bounded":
        save_tube(found, out)
    values = tube_values(found)
    proof = out if found.status == "bounded" else None
    title = f"{loaded.title}; gains {name}, {found.model}: {found.status}"
    emit(
        Answer(
            values={**values, "inside": inside, "seconds": time.perf_counter() - began},
            tables=[widths_table(title, values), limited_table(values)],
            notes=[bounds_after(found), *probability_notes(found)],
            verdict="The flights flown with it are inside."
            if inside
            else "A flight flown with it leaves the tube.",
            files={"signals": signals, "proof": proof},
        )
    )
    if found.status != "bounded":
        fail(f"{scenario}: gains {name}: {found.reason}", NO)
    if not inside:
        fail(f"{scenario}: gains {name}: a flight leaves the tube.", NO)


def tube_values(found: "Tube") -> dict[str, Any]:
    """A tube as ``--json`` has it."""
    widths = found.half_widths[:, :2] / DEG
    ever = None
    if found.hand_over is not None:
        ever = 0.5 * (found.hand_over.bounds[:, 1] - found.hand_over.bounds[:, 0]) / DEG
    return {
        **pick(found, "status reason model"),
        "probability": found.probability,
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
            name: found.held_intervals(i) for i, name in enumerate(("phi_cmd", "n_z_cmd"))
        },
        "handed_over_s": found.handed_over,
        "counted_from_s": found.counted_from,
    }


def widths_table(title: str, values: Mapping[str, Any]) -> Table:
    """The half-widths of a tube as `tube_values` has them."""
    records = [{"error": channel, **own} for channel, own in values["half_width_deg"].items()]
    return Table(title=title, columns=WIDTH_COLUMNS, records=records)


def limited_table(values: Mapping[str, Any]) -> Table:
    """When a limit can hold a command, as `tube_values` has it."""
    records = [
        {"command": name, "from_s": begin, "to_s": end}
        for name, intervals in values["limits_can_hold"].items()
        for begin, end in intervals or [("never", None)]
    ]
    return Table(title="a limit can hold", columns=LIMITED_COLUMNS, records=records)


def bounds_after(found: "Tube") -> str:
    """What holds after the time that is enclosed, in a sentence."""
    if found.lost is not None:
        return (
            f"{found.reason}: the bounds on the errors are those that flights were counted against."
        )
    if found.hand_over is None:
        return "There is no claim beyond the end of the scenario: no invariant set was found."
    return (
        f"From {found.handed_over:.2f} s on no limit ever holds a command, under disturbances "
        "within those at the end."
    )


def probability_notes(found: "Tube") -> list[str]:
    """With which probability a flight leaves, where flights were counted."""
    return [] if found.probability is None else [found.probability.sentence]


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


def run_tubes_values(found: "RunTubes") -> dict[str, Any]:
    """Tubes of runs as ``--json`` has them, by label of the run."""
    return {
        label: {
            **pick(tube.about, "status reason model start_deg handed_over_s counted_from_s"),
            "probability": tube.about.probability,
            "half_width_deg": {
                channel: dict(zip(("max", "end"), widths.tolist(), strict=True))
                for channel, widths in zip(("chi", "gamma"), tube.half_widths / DEG, strict=True)
            },
            "inside": label not in found.outside,
        }
        for label, tube in found.found.items()
    }


def run_tubes_notes(found: "RunTubes", how: str) -> list[str]:
    """A sentence for each tube, for each that could not be made, or how to make them."""
    notes = [found.sentence(label) for label in found.found]
    notes += [f"{label}: no tube: {why}" for label, why in found.why_not.items()]
    return notes or [f"No tube around the errors yet: {how} makes it."]
