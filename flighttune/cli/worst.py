"""The command that searches for the worst flight of a stated set."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Option

from flighttune.cli.campaign import SchedulerOption, WorkersOption
from flighttune.cli.options import campaign_names, check_ending, scenario_names
from flighttune.cli.progress import campaign_pool
from flighttune.cli.show import INTERRUPTED, emit, fail, pick
from flighttune.present.numbers import number

if TYPE_CHECKING:
    from flighttune.arrays import FloatArray
    from flighttune.campaign.planning.tube_bounds import TubeBounds
    from flighttune.campaign.worst import RareMiss, WorstFlight
    from flighttune.simulate.run import Run

GONE = "interrupted, nothing is written"

FAMILIES = {
    "bang_bang": "bang-bang: it switches where the sensitivity of an error changes its sign",
    "square_wave": "a square wave in each channel",
}
"""Families of disturbances in words."""


def worst(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO|CAMPAIGN",
            help="A campaign (file, shipped name or folder), whose dispersions are searched, or a "
            "scenario with --start-deg or --disturbance.",
            autocompletion=lambda: scenario_names() + campaign_names(),
        ),
    ],
    budget: Annotated[int, Option(help="Flights at most.")] = 2000,
    metric: Annotated[
        str | None,
        Option(
            help="Metric to maximise: a column of a campaign's rows, such as chi.ITAE, or margin, "
            "the largest excess over a requirement relative to its bound [default: margin if there "
            "are requirements]."
        ),
    ] = None,
    gains: Annotated[
        str | None, Option(help="Gain set [default: tuned_identified, else the first].")
    ] = None,
    plant: Annotated[
        str | None, Option(help="Label of the plant as `fly` prints it [default: the first].")
    ] = None,
    completed: Annotated[
        bool, Option("--completed", help="Consider only flights that reach their end time.")
    ] = False,
    start_deg: Annotated[
        float, Option(help="Largest deviation from a scenario's start, course and path angle, deg.")
    ] = 0.0,
    disturbance: Annotated[
        float,
        Option(
            help="Largest disturbance of a scenario's two rates, rad/s: switched where the "
            "sensitivity of an error changes its sign, or a square wave."
        ),
    ] = 0.0,
    rare: Annotated[
        bool, Option("--rare", help="Estimate the probability of a miss by subset simulation.")
    ] = False,
    threshold: Annotated[
        float, Option(help="Value of the metric at which --rare counts a miss.")
    ] = 0.0,
    seed: Annotated[int, Option(help="Seed of the search.", min=0)] = 1,
    tube: Annotated[
        Path | None,
        Option(
            help="Signals of a tube (Parquet): search for the flight nearest to leaving it, and "
            "print how many times wider the tube is."
        ),
    ] = None,
    out: Annotated[
        Path | None, Option(help="Scenario to write [default: runs/NAME-worst.toml].")
    ] = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
) -> None:
    """Search dispersions and disturbances for the flight nearest to missing a requirement.

    Writes that flight as a scenario for `flighttune fly`.
    """
    check_ending(out, ".toml")
    from flighttune.campaign.planning.tube_bounds import TubeBounds
    from flighttune.campaign.worst import WorstSettings, find_worst, rare_miss
    from flighttune.flight.fly import fly

    bounds = None if tube is None else TubeBounds.read(tube)
    settings = WorstSettings(
        budget=budget,
        metric=metric,
        tube=bounds,
        gains=gains,
        plant=plant,
        completed=completed,
        start_deg=start_deg,
        disturbance=disturbance,
        seed=seed,
    )
    miss = found = None
    with campaign_pool(workers, scheduler) as pool:
        if rare:
            miss = rare_miss(source, settings, pool, threshold=threshold)
        else:
            found = find_worst(source, settings, pool)
    if miss is not None:
        emit(_rare_json(miss), _rare_text(miss))
        return
    if found is None:
        fail(f"{source}: {GONE}", INTERRUPTED)
    written = out or Path("runs") / f"{Path(source).stem}-worst.toml"
    _write(found, written)
    ratios = None if bounds is None else _beside(tube, bounds, fly(found.scenario).runs[0])
    answer = {
        **pick(found, "metric value first flights family distance radius status missed drawn"),
        **pick(found.group, "plant gains"),
        "ratio": ratios,
        "ratio_of_search": None if found.reach is None else _ratios(found.reach),
        "scenario": written,
    }
    emit(answer, _text(found, written, ratios))


def _beside(tube: Path | None, bounds: "TubeBounds", run: "Run") -> dict[str, float]:
    """How many times wider a tube is than a flight needs, which is written next to it."""
    from flighttune.tube.of_run import write_worst

    ratios = bounds.ratios(run)
    if tube is not None:
        write_worst(tube, run, ratios)
    return ratios


def _ratios(reach: "FloatArray") -> dict[str, float]:
    """How many times wider a tube is than all flights of a search need, by channel."""
    return {
        channel: 1.0 / share if share else math.inf  # no flight came to its end
        for channel, share in zip(("chi", "gamma"), reach.tolist(), strict=True)
    }


def _write(found: "WorstFlight", path: Path) -> None:
    from flighttune.report.toml_text import toml_text
    from flighttune.whole_file import write_text

    write_text(path, toml_text(found.scenario.as_dict()))


def _text(found: "WorstFlight", written: Path, ratios: dict[str, float] | None) -> Iterator[str]:
    yield f"{found.group.plant} / {found.group.gains}: {found.flights} flights"
    yield (
        f"worst {found.metric}: {number(found.value)}; of the first generation, drawn from the "
        f"distribution: {number(found.first)}"
    )
    for key, value in found.drawn.items():
        yield f"  {key} = {number(value, '.6g') if isinstance(value, float) else value}"
    if found.family:
        yield f"the disturbance is {FAMILIES[found.family]}"
    if found.distance is not None and found.radius is not None:
        yield (
            f"{number(found.distance)} standard deviations from the median, of the "
            f"{number(found.radius)} that hold 99.9 % of the distribution"
        )
    yield f"{found.status}; {found.missed or 'no requirement is missed'}"
    searched = {} if found.reach is None else _ratios(found.reach)
    for name, ratio in (ratios or {}).items():
        yield (
            f"tube over flight, {name}: {number(ratio)}; over the widest of the search: "
            f"{number(searched[name])}"
        )
    yield f"scenario: {written}   (fly it with: flighttune fly {written})"


def _rare_json(miss: "RareMiss") -> dict[str, Any]:
    return pick(miss, "metric threshold probability low high variation levels flights")


def _rare_text(miss: "RareMiss") -> Iterator[str]:
    if miss.probability:
        yield (
            f"P({miss.metric} >= {number(miss.threshold)}) = {number(miss.probability)}, 95 % "
            f"interval {number(miss.low)} to {number(miss.high)}, by {miss.flights} flights in "
            f"{len(miss.levels)} levels"
        )
    else:
        yield (
            f"P({miss.metric} >= {number(miss.threshold)}) is below {number(miss.high)}: "
            f"{miss.flights} flights in {len(miss.levels)} levels reached "
            f"{number(miss.levels[-1])}; give more --budget"
        )
