"""Commands that compare and bound flights: gaps, bands, monitors, tubes, and the worst flight."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from flighttune.base.errors import InputError
from flighttune.base.files.whole import remove_file, together
from flighttune.cli.options import Verb, check_ending, flown_by, kept_flights, this_command
from flighttune.cli.show import progress_bar
from flighttune.outputs.answers.answer import Answer


def page_note(file: Path) -> str:
    """The command that makes the page of a count."""
    return f"A page with its flights: flighttune report {file}"


def gap(explain_gap: Verb, scenario: str, out: Path | None, claims: list[Path] | None) -> Answer:
    """Fly gains on plants from the paper's law to the aircraft; show what each step adds.

    The commands of a LOG are flown on law and aircraft, and the answer says how much of the
    difference lag, mass, damping and wind explain. Exit status 1 if a flight ends early, or the
    aircraft leaves its tube.
    """
    from flighttune.claims.verify import within
    from flighttune.gaps.of_log import LogGap
    from flighttune.outputs.pages.charts import gap_sheet
    from flighttune.outputs.pages.page import write_gap_page
    from flighttune.outputs.recording.record import record

    stem = f"{Path(scenario.partition('@')[0]).stem}-gap"
    folder = out or Path("runs") / stem
    if "aircraft" in explain_gap.keywords and claims:
        raise InputError("--claim must be absent for a log.")
    explained = explain_gap()
    if isinstance(explained, LogGap):
        explained.sheet().save(folder / "gap.svg")
        return replace(explained.answer(), files={"figure": folder / "gap.svg"})
    explained = within(explained, claims or ())
    figure = page = None
    with together(folder):
        files = record(explained.flown(), folder, name=stem)
        answer = explained.answer(files.signals)
        for name in ("gap.svg", "gap.html"):
            remove_file(folder / name)
        if explained.steps:
            figure, page = folder / "gap.svg", folder / "gap.html"
            gap_sheet(explained).save(figure)
            write_gap_page(explained, answer.tables, page)
    files = {"recording": files.recording, "figure": figure, "page": page}
    return replace(answer, files=files)


def gradient(slopes: Verb) -> Answer:
    """Compute slopes of measures of a flight with respect to gains or numbers of SCENARIO.

    Law, limits and aircraft are differentiated step by step. Exit status 2 if a measure has no
    slope, such as a settling time, which counts samples.
    """
    return slopes().answer()


def compare(compare_runs: Verb, a: str, autopilot: Path | None, out: Path | None) -> Answer:
    """Compare runs, or gains with what an autopilot flies now.

    Of runs: metrics, which is better, and how far apart the paths are; exit status 2 if manoeuvre
    or aircraft differ. --with FILE flies a mission by the parameters of PX4 or ArduPilot beside the
    gains, on the same draws; after a kill the same command goes on.
    """
    if autopilot:
        check_ending(out, ".html")
        compare_runs = partial(compare_runs, kept=kept_flights(a, "compared"))
    compared = compare_runs()
    is_page = out is not None and out.suffix.lower() == ".html"
    files = {"recording": None if is_page else out, "page": out if is_page else None}
    answer = compared.answer()
    if out is None or answer.failure:
        return replace(answer, files=dict.fromkeys(files))
    if autopilot:
        from flighttune.outputs.pages.beside import write_beside_page

        write_beside_page(compared, out, this_command())
    elif is_page:
        from flighttune.outputs.pages.page import write_comparison_page

        write_comparison_page(compared, out)
    else:
        from flighttune.outputs.recording.record import write_overlay

        write_overlay(compared, out)
    return replace(answer, files=files)


def worst(search: Verb, out: Path) -> Answer:
    """Search dispersions and disturbances for the flight with the smallest margin.

    Writes that flight as a scenario for `flighttune fly`. Exit status 1 if it leaves a tube that is
    proven for it.
    """
    flight = search()
    flight.save(out)
    return replace(flight.answer(), files={"scenario": out})


def tube(
    enclose: Verb,
    scenario: str,
    gains: str | None,
    out: Path | None,
    disturbance: str | None,
    boxes: str | None,
) -> Answer:
    """Enclose all flights of SCENARIO with one gain set, limits included; prove the bounds.

    Exit status 1 if the set cannot be bounded for the whole time, or if a flight leaves it.
    """
    from flighttune.base.files.load import BAND, kind_of
    from flighttune.claims.tubes.tube import largest_disturbance, stated_problem
    from flighttune.claims.verbs import residual
    from flighttune.claims.verify import load_residual

    largest, base = disturbance == "largest", Path("runs") / Path(scenario).stem
    if largest and (boxes, out) != (None, None):
        raise InputError("`disturbance` must be a number with --boxes or --out, got largest.")
    try:
        bound = None if largest or disturbance is None else float(disturbance)
    except ValueError:
        raise InputError(f"--disturbance: must be a number, got {disturbance!r}.") from None
    in_file = boxes is not None and kind_of(boxes) == BAND
    counted = load_residual(boxes) if boxes is not None and in_file else None
    if boxes is not None and not in_file:
        with flown_by() as by:
            counted = residual(boxes, gains=gains, **by)
    with progress_bar() as progress:
        follow = None if progress is None else partial(progress, "tube")
        if largest:
            settings = dict(enclose.keywords)
            del settings["disturbance"]
            problem = stated_problem(scenario, settings.pop("gains", None), **settings)
            return largest_disturbance(problem, follow).answer()
        enclosure = enclose(boxes=counted, disturbance=bound, progress=follow)
    files: dict[str, Path | None] = {"proof": None}
    with together():
        if enclosure.problem.band is not None and not in_file:
            files["boxes"] = Path(f"{base}-boxes.npz")
            enclosure.problem.band.save(files["boxes"])
        if enclosure.status == "bounded":
            files["proof"] = out or Path(f"{base}-tube.npz")
            enclosure.save(files["proof"])
    return replace(enclosure.answer(gains or ""), files=files)


def band(count_band: Verb, source: str, flights: int | None, out: Path | None) -> Answer:
    """Bound signals by counting flights: a new one leaves the band with at most a probability.

    Its shape is learned from some flights, and its scale counted on fresh ones: it holds for all
    signals at all times, for any law, plant and weather. --set seed=N draws others. Exit status 1
    if too many flights did not complete for any claim.
    """
    from flighttune.base.files.load import BAND, kind_of

    if kind_of(source) != BAND:
        out = out or Path("runs") / f"{Path(source).stem}-band.npz"
    file = out or Path(source)
    answer = count_band(out=out).answer(file)
    out = out or (Path(source) if flights is not None else None)
    files = {"band": out, "page": None}
    return replace(answer, notes=[*answer.notes, page_note(file)], files=files)


def monitor(count_monitor: Verb, out: Path) -> Answer:
    """Count how often a monitor of flights raises a false alarm, or learn one from logs.

    It learns from healthy flights what to expect of signals that an autopilot has. --set seed=N
    draws others. Exit status 1 if too many flights did not complete for any claim.
    """
    return replace(count_monitor().answer(out), files={"monitor": out})
