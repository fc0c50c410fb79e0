"""The command that encloses all flights of a scenario."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from flighttune.cli.gain_sets import chosen_gains
from flighttune.cli.options import GainsOption, ScenarioArgument, check_ending
from flighttune.cli.progress import progress_bar
from flighttune.cli.show import NO, emit, fail, pick, table
from flighttune.errors import InputError
from flighttune.present.tables import Table
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
        found = tube_of(
            loaded,
            chosen,
            plant=plant,
            start=start_deg * DEG,
            disturbance=disturbance,
            conformance=conformance and load_conformance(conformance),
            law=law,
            progress=progress and (lambda part: progress(f"tube {name}", part)),
        )
    inside = flights_inside(found)
    # A tube that its own flight leaves is wrong: neither bounds nor a proof of them are written.
    signals = proof = None
    if inside:
        signals = (out or Path("runs") / f"{Path(scenario).stem}-tube.npz").with_suffix(".parquet")
        write_signals(found, signals)
    if inside and found.status == "bounded" and out is not None:
        save_tube(found, out)
        proof = out
    answer = {**tube_json(found), "inside": inside, "signals": signals}
    answer["seconds"] = time.perf_counter() - began
    emit(answer, _text(found, name, answer, proof))
    if found.status != "bounded":
        fail(f"{scenario}: gains {name}: {found.reason}", NO)
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
            progress=progress and (lambda part: progress(f"tube {name}", part)),
        )
    rows = [
        {"disturbance": float(one.problem.d_high.max()), **pick(one, "status reason")}
        for one in tried
    ]
    bounded = [row["disturbance"] for row in rows if row["status"] == "bounded"]
    largest = max(bounded, default=None)
    lines = [f"tried {row['disturbance']:.2g} rad/s: {row['reason'] or 'bounded'}" for row in rows]
    if largest is not None:
        lines.append(f"largest disturbance for which the set is bounded: {largest:.2g} rad/s")
    emit({"largest_disturbance": largest, "tried": rows}, lines)
    if largest is None:
        fail(f"{scenario.title}: gains {name}: for no disturbance tried the set is bounded.", NO)


def tube_json(found: "Tube") -> dict[str, Any]:
    """A tube as ``--json`` has it."""
    problem, widths = found.problem, found.half_widths[:, :2] / DEG
    ever = found.hand_over and found.hand_over.bounds
    return {
        **pick(found, "status reason model"),
        "probability": found.probability,
        "half_width_deg": {
            channel: {
                "max": float(column.max()),
                "end": float(column[-1]),
                "ever": None if ever is None else float(0.5 * (ever[i, 1] - ever[i, 0]) / DEG),
            }
            for i, (channel, column) in enumerate(zip(("chi", "gamma"), widths.T, strict=True))
            if len(column)
        },
        "limits_can_hold": {
            name: found.held_intervals(i) for i, name in enumerate(("phi_cmd", "n_z_cmd"))
        },
        "handed_over_s": found.handed_over,
        "counted_from_s": found.counted_from,
        "gains": problem.gains.as_lists(),
        "start_rad": problem.start,
        "disturbance_rad_s": [problem.d_low.min(axis=0), problem.d_high.max(axis=0)],
        "counted": problem.conformance and problem.conformance.sentence,
    }


def problem_text(found: "Tube") -> Iterator[str]:
    """Which flights a tube encloses, and what was counted for them."""
    problem = found.problem
    flight, limits = problem.scenario.flight, problem.limits
    chi, gamma = (angle / DEG for angle in problem.path_at_start)
    yield (
        f"flights of {problem.scenario.title!r}, plant {problem.plant!r}: {flight.duration_s:g} s "
        f"at {flight.V_a_mps:g} m/s, {problem.scenario.controller.rate_hz:g} Hz"
    )
    yield (
        f"from within {problem.start / DEG:g} deg of course {chi:g} and path angle {gamma:g} deg; "
        "the reference ends at {:g} and {:g} deg".format(*problem.reference[-1, :2] / DEG)
    )
    yield "limits: " + ", ".join(
        f"{name} {lower * unit:g}..{upper * unit:g} at {falling * unit:g}..{rising * unit:g} per s"
        for name, unit, lower, upper, falling, rising in zip(
            ("phi_cmd [deg]", "n_z_cmd"),
            (1.0 / DEG, 1.0),
            *(limits.lower, limits.upper, limits.rate_lower, limits.rate_upper),
            strict=True,
        )
    )
    low, high = problem.d_low.min(axis=0), problem.d_high.max(axis=0)
    yield "any disturbance of the rates [rad/s]: " + ", ".join(
        f"{name} {lowest:g}..{highest:g}"
        for name, lowest, highest in zip(("chi", "gamma"), low, high, strict=True)
    )
    yield "gains: " + ", ".join(
        f"{name} " + "; ".join(" ".join(f"{gain:.6g}" for gain in row) for row in matrix)
        for name, matrix in (("K_P", problem.gains.K_P), ("K_I", problem.gains.K_I))
    )
    if problem.conformance is not None:
        yield f"counted: {problem.conformance.sentence}"


def widths_text(found: "Tube", gains: str) -> Table:
    """The half-widths of a tube as a table; `gains` is what to call its gains."""
    widths = tube_json(found)["half_width_deg"]
    rows = [
        (channel, f"{width['max']:.3f}", f"{width['end']:.3f}") for channel, width in widths.items()
    ]
    kind = found.problem.table.family.enclosed
    title = f"{found.problem.scenario.title!r}; gains {gains}, {kind}: {found.status}"
    return table(title, ("error", "half-width, largest [deg]", "at the end [deg]"), rows)


def for_ever_text(found: "Tube") -> str:
    """What holds after the time that is enclosed, in a sentence."""
    if found.lost is not None:
        unchecked = found.problem.aircraft_checked is False
        boxes = "in the file" if unchecked else "that flights were counted against"
        return f"{found.reason}: the bounds on the errors are those {boxes}"
    if found.hand_over is None:
        return "after the time of the scenario nothing is claimed: no set was found that is kept"
    chi, gamma = (0.5 * (high - low) / DEG for low, high in found.hand_over.bounds[:2])
    return (
        f"from {found.handed_over:.2f} s on for ever no limit holds a command, and half-widths are "
        f"{chi:.3g} and {gamma:.3g} deg, under disturbances within those at the end"
    )


def _text(
    found: "Tube", name: str, answer: dict[str, Any], proof: Path | None
) -> Iterator[Table | str]:
    yield widths_text(found, name)
    yield from problem_text(found)
    for command, intervals in answer["limits_can_hold"].items():
        spans = ", ".join(f"{begin:.2f}..{end:.2f} s" for begin, end in intervals) or "never"
        yield f"a limit can hold {command}: {spans}"
    yield for_ever_text(found)
    if found.probability is not None:
        yield found.probability.sentence
    yield f"flights flown with it inside: {'yes' if answer['inside'] else 'NO'}"
    if answer["signals"] is not None:
        yield f"signals: {answer['signals']}"
    if proof is not None:
        boxes = "" if found.problem.boxes is None else " --conformance FILE"
        yield f"proof: {proof}   (check it with: flighttune verify {proof}{boxes})"


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


def run_tubes_json(found: "RunTubes") -> dict[str, Any]:
    """Tubes of runs as ``--json`` has them, by label of the run."""
    return {
        label: {
            **pick(one.about, "status reason model start_deg handed_over_s counted_from_s"),
            "probability": one.about.probability,
            "half_width_deg": {
                channel: dict(zip(("max", "end"), widths.tolist(), strict=True))
                for channel, widths in zip(("chi", "gamma"), one.half_widths / DEG, strict=True)
            },
            "inside": label not in found.outside,
        }
        for label, one in found.found.items()
    }


def run_tubes_text(found: "RunTubes", how: str) -> Iterator[str]:
    """A line for each tube, for each that could not be made, or how to make them."""
    for label in found.found:
        yield found.sentence(label)
    for label, why in found.why_not.items():
        yield f"{label}: no tube: {why}"
    if not (found.found or found.why_not):
        yield f"no tube around the errors yet: {how} makes it"


def fail_if_outside(found: "RunTubes") -> None:
    """End the command with status 1 if a flight leaves its tube."""
    if found.outside:
        fail(f"{', '.join(found.outside)}: the flight leaves its tube.", NO)
