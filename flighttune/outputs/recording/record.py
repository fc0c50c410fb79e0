"""Writing a flown scenario to a folder, one Parquet file per run and one recording; its viewer."""

import os
import socket
import subprocess
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings
from rerun.error_utils import catch_and_log_exceptions

from flighttune.base.errors import RecordingError, need
from flighttune.base.files.whole import remove_file, together, whole_file
from flighttune.base.screen import LOCAL, has_screen
from flighttune.base.units import shown_unit
from flighttune.flight.flown import FlownScenario
from flighttune.flight.loop.run import Run, claims_around
from flighttune.flight.records import parquet
from flighttune.gaps.compare import Comparison, overlaid
from flighttune.outputs.answers.compare import comparison_table
from flighttune.outputs.drawing.chart import peaks
from flighttune.outputs.drawing.palette import LIMIT, NEUTRAL, rgb
from flighttune.outputs.recording import entities
from flighttune.outputs.recording.page import blueprint, log_legends, scenario_page
from flighttune.outputs.recording.plots import Plot, displayed, limits_of, shown_plots, with_derived
from flighttune.outputs.recording.scene import log_route, log_scene, route_of, somewhere

# Default port of the page for a browser, as in Rerun
PORT = 9090


def rerun_program() -> str:
    """Path of Rerun's program itself, because ending the script `rerun` would leave it running."""
    import rerun_cli

    return str(Path(next(iter(rerun_cli.__path__))) / "rerun")


def stream_url(port: int) -> str:
    """Address at which a viewer with its data server on `port` takes a stream."""
    return f"rerun+http://{LOCAL}:{port}/proxy"


def viewer(path: str | Path, *, port: int | None = None) -> tuple[list[str], str]:
    """Command that opens a recording, and the address of the page if a browser is served."""
    parquet.check_recording(path)
    command = [rerun_program(), "--bind", LOCAL, str(Path(path).resolve())]
    if port is None and has_screen():
        return [*command, "--port", "auto"], ""
    page, data = port or PORT, (port or PORT) + 1
    _check_free(page)
    _check_free(data)
    served = ["--serve-web", "--web-viewer-port", str(page), "--port", str(data)]
    return [*command, *served], f"http://{LOCAL}:{page}/?url={quote(stream_url(data), safe='')}"


def _check_free(port: int) -> None:
    """Raise unless `port` is free, because Rerun waits for ever if its data port is taken."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOCAL, port))
        except (OSError, OverflowError) as error:
            raise RecordingError(
                f"port {port} must be free for the Rerun viewer, got {error.args[-1]}; "
                "`--port` takes another one."
            ) from error


def run_viewer(path: str | Path, command: list[str]) -> None:
    """Run a command of `viewer` until it ends; Rerun prints the reason of a failure on stderr."""
    # Rerun sends usage statistics to its makers unless it believes that it runs in CI.
    environment = {"RUST_LOG": "warn", "CI": "true"} | os.environ
    if status := subprocess.run(command, env=environment, check=False).returncode:
        raise RecordingError(
            f"{path}: the Rerun viewer must open it, got exit status {status}; its reason is above."
        )


FAINT = 150  # opacity of thin lines, of 255
FAINTEST = 110  # opacity of measured signals
POSE = ("north", "east", "down", "chi", "gamma", "phi")
DASH, GAP = 0.35, 0.15  # length of a dash of a band, and of the gap after it, s


class RecordedFiles(NamedTuple):
    """Paths of the files of a flight."""

    recording: Path  # Rerun recording of all runs
    signals: Mapping[str, Path]  # Parquet file of each run, by its label


def record(flown: FlownScenario, folder: str | Path, *, name: str = "flight") -> RecordedFiles:
    """Write a flown scenario to `folder`: ``PLANT-GAINS.parquet`` for each run, and ``NAME.rrd``.

    Parameters
    ----------
    flown : FlownScenario
        Result of `flighttune.fly`.
    folder : path-like
        Made if needed. Files of the same name are replaced together after all have been written,
        and Parquet files of a replaced recording are removed.
    name : str
        Stem of the recording's name.

    Returns
    -------
    RecordedFiles
        Paths of all files.

    Raises
    ------
    OutputError
        If a file cannot be written; the folder is then unchanged.
    RecordingError
        If the scenario has a value that JSON cannot represent.

    Examples
    --------
    >>> flown = ft.fly(ft.load_scenario("paper_as_printed"))
    >>> ft.record(flown, "runs/mine").recording.name
    'flight.rrd'
    """
    folder = Path(folder)
    recording = folder / f"{name}.rrd"
    paths = parquet.signal_files(flown.runs, folder)
    runs = [parquet.parts_of(run) for run in flown.runs]
    flight = [sha256 for _, _, sha256 in runs]
    picture = recording_bytes(
        flown.runs,
        page=page_of(flown),
        title=flown.scenario.title,
        # without the private part of the path
        origin={"folder": folder.name if folder.is_absolute() else str(folder), "sha256": flight},
    )
    with together(folder):
        for path in parquet.files_shown(recording) if os.path.exists(recording) else ():
            remove_file(path)
        for path, parts in zip(paths, runs, strict=True):
            with whole_file(path) as part:
                part.write_bytes(parquet.record_bytes(parts, flight))
        with whole_file(recording) as part:
            part.write_bytes(picture)
    labels = (run.label for run in flown.runs)
    return RecordedFiles(recording=recording, signals=dict(zip(labels, paths, strict=True)))


def page_of(flown: FlownScenario) -> str:
    """The page of text in the recording of a flown scenario, as Markdown."""
    return scenario_page(flown.runs, scenario=flown.scenario.as_dict(), indicators=flown.indicators)


def write_recording(runs: Sequence[Run], path: str | Path, *, page: str, title: str) -> None:
    """Write all runs of a scenario to one recording that opens by itself in Rerun."""
    data = recording_bytes(runs, page=page, title=title)
    with whole_file(Path(path)) as part:
        part.write_bytes(data)


def write_log(run: Run, path: str | Path) -> None:
    """Write the log of a flight to a recording; RecordingError names missing signals."""
    if lacking := [name for name in POSE if name not in run.signals]:
        raise RecordingError(f"{run.label}: must have {', '.join(lacking)} to be seen in 3D.")
    scenario = run.provenance.scenario
    page = scenario_page([run], scenario=scenario)
    write_recording([run], path, page=page, title=str(scenario["title"]))


def recording_bytes(
    runs: Sequence[Run], *, page: str, title: str, origin: Mapping[str, Any] | None = None
) -> bytes:
    """The file that `write_recording` writes; `origin` has folder and SHA-256 of the runs."""
    try:
        return _bytes(runs, page, title, origin)
    finally:
        # Rerun keeps every stream, of recordings and blueprints, in a list with two threads and all
        # logged data. This is its own way to drop unused streams.
        rerun_bindings.flush_and_cleanup_orphaned_recordings()  # pyright: ignore[reportAttributeAccessIssue]


@np.errstate(over="ignore")  # a law may command 1e308, which overflows in degrees
@catch_and_log_exceptions(strict=True)  # Rerun raises on wrong data instead of dropping it
def _bytes(runs: Sequence[Run], page: str, title: str, origin: Mapping[str, Any] | None) -> bytes:
    # In memory, because on a full disk Rerun only logs an error or never returns.
    # A new id each time, because the viewer keeps only one of two files with the same id.
    stream = rr.RecordingStream(entities.application(title), recording_id=uuid.uuid4())
    try:
        memory = stream.memory_recording()
        if origin is not None:
            stream.send_property(parquet.ORIGIN, rr.AnyValues(**origin))
        recorded = entities.runs_to_draw(runs)
        extended = with_derived(recorded)
        plots, route = shown_plots([flight.run for flight in extended]), route_of(extended)
        on_map = route is not None and route[1].geographic
        _send_layout(stream, blueprint(extended, plots, on_map=on_map))
        stream.send_recording_name(title)
        text = rr.TextDocument(page, media_type=rr.MediaType.MARKDOWN)
        entities.log_still(stream, entities.PAGE, text)
        if extended:
            log_scene(stream, [somewhere(flight) for flight in recorded])
            log_legends(stream, extended)
        if route is not None:
            log_route(stream, [somewhere(flight) for flight in extended], *route)
        for plot in dict.fromkeys(plot for tab in plots.values() for plot in tab):
            _log_plot(stream, plot, extended)
        return memory.drain_as_bytes()
    finally:
        stream.disconnect()


def _send_layout(stream: rr.RecordingStream, layout: rrb.Blueprint) -> None:
    """Like ``stream.send_blueprint``, which would keep the layout's stream for ever."""
    native = rerun_bindings.new_blueprint(
        application_id=str(stream.get_application_id()),
        make_default=False,
        make_thread_default=False,
        default_enabled=True,
    )
    layout_stream = rr.RecordingStream._from_native(native)
    layout_stream.set_time("blueprint", sequence=0)
    layout._log_to_stream(layout_stream)
    storage = layout_stream.memory_recording().storage
    # Active as well as default, because the default does not replace the layout that the viewer
    # makes while data arrive.
    rerun_bindings.send_blueprint(storage, True, True, recording=stream.to_native())
    layout_stream.disconnect()  # sink and stream refer to each other


def _log_plot(stream: rr.RecordingStream, plot: Plot, flights: Sequence[entities.DrawnRun]) -> None:
    folder = f"{entities.PLOTS}/{plot.signal}"

    def log_signals(path: str, run: Run, signals: Sequence[str], **style: Any) -> None:
        """Log signals of a run as lines of one entity, thinned."""
        values = np.column_stack([displayed(run.signals, name) for name in signals])
        samples = peaks(values)
        entities.log_lines(stream, path, rr.SeriesLines(**style), run.t[samples], values[samples])

    # The time axis reaches a little beyond the longest flight, in all plots alike.
    end = entities.END * max(flight.run.duration for flight in flights)
    nothing = rr.Scalars.columns(scalars=[np.nan, np.nan])
    stream.send_columns(f"{folder}/{entities.AXIS}", [entities.times([0.0, end])], nothing)
    having = [flight for flight in flights if plot.signal in flight.run.signals]
    for flight in having:
        run, strong, rgb_of_run = flight.run, f"{folder}/{flight.key}", flight.style.rgb
        # the first line of this entity is drawn strong
        names = [name for name in plot.signals if name in run.signals]
        thin = len(names) - 1
        log_signals(
            strong,
            run,
            names,
            colors=[(*rgb_of_run, 255), *[(*rgb_of_run, FAINT)] * thin],
            widths=[flight.style.width, *[1.0] * thin],
            names=[run.label, *(f"{run.label}, {name}" for name in names[1:])],
        )
        if plot.measured in run.signals:
            log_signals(
                f"{folder}/{entities.MEASURED}/{flight.key}",
                run,
                [plot.measured],
                colors=[(*rgb_of_run, FAINTEST)],
                widths=[1.0],
                names=[f"{run.label}, {plot.measured}"],
            )
        for place, (claim, ends) in enumerate(claims_around(run.claims, plot.signal)):
            values = shown_unit(claim.units[plot.signal])[1] * ends.T
            # dashed for counted bounds, thin for proven bounds
            samples, counted = peaks(values), claim.kind == "counted"
            t, values = run.t[samples], values[samples]
            if counted:
                values[t % (DASH + GAP) > DASH] = np.nan
            style = rr.SeriesLines(
                colors=[(*rgb_of_run, 255 if counted else FAINT)] * 2,
                widths=[1.0, 1.0],
                names=[f"{run.label}, {claim.title}: {end}" for end in ("lowest", "highest")],
            )
            entities.log_lines(stream, f"{strong}_claim_{place}", style, t, values)
    longest = max((flight.run for flight in having), key=lambda run: run.duration)
    if plot.common in longest.signals:
        reference = {"colors": [rgb(NEUTRAL)], "widths": [2.0], "names": ["reference"]}
        log_signals(f"{folder}/{entities.REFERENCE}", longest, [plot.common], **reference)
    bounds = limits_of(longest.provenance.scenario, plot.limit) if plot.limit else None
    if bounds is not None:
        names = ["lower limit", "upper limit"]
        style = rr.SeriesLines(colors=[rgb(LIMIT)] * 2, widths=[2.0] * 2, names=names)
        ends = longest.signals.index[[0, -1]]
        entities.log_lines(
            stream, f"{folder}/{entities.LIMITS}", style, ends, np.array([bounds, bounds])
        )


def show(flown: FlownScenario, *, width: int = 1280, height: int = 720) -> None:
    """Show the recording of flights in a notebook's cell.

    Parameters
    ----------
    flown : FlownScenario
        Result of `flighttune.fly`.
    width, height : int, pixels

    Raises
    ------
    InputError
        If the viewer for notebooks is not installed.

    Examples
    --------
    >>> flown = ft.fly(ft.load_scenario("paper_as_printed"))
    >>> ft.show(flown, height=500)  # the last line of a cell
    """
    need("`show`", "rerun_notebook")
    from rerun.notebook import Viewer

    picture = recording_bytes(flown.runs, page=page_of(flown), title=flown.scenario.title)
    # A streaming viewer would keep the stream and its threads as long as the notebook runs.
    viewer = Viewer(width=width, height=height, use_global_recording=False)
    viewer._viewer.send_rrd(picture)
    viewer.display()


def write_overlay(comparison: Comparison, path: str | Path) -> None:
    """Write all runs of a comparison to one recording, aligned at the start of the flight."""
    runs = overlaid(comparison)
    scenario = runs[0].provenance.scenario
    title = f"{scenario.get('title', 'Flight')}: comparison"
    page = scenario_page(runs, scenario=scenario)
    compared = comparison_table("Compared", comparison.metrics).markdown()
    write_recording(runs, Path(path), page=f"{page}\n## Compared\n\n{compared}\n", title=title)
