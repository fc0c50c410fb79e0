"""A scenario shown while it is being flown, at real time or faster, and stopped by hand."""

import threading
import time
import uuid

import numpy as np
import pandas as pd
import rerun as rr
import rerun.blueprint as rrb

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.plants.base import FlightCondition, Plant, Stop, WrappedPlant
from flighttune.present.names import distinct
from flighttune.present.palette import LineStyle, line_styles
from flighttune.present.thinning import evenly
from flighttune.recording import entities
from flighttune.recording.blueprint import layout, scene_view, time_view
from flighttune.recording.entities import application, on_screen, plain_name, times
from flighttune.recording.plots import Plot, displayed, positions
from flighttune.recording.record import reference_style, run_style
from flighttune.recording.scene import (
    aircraft_model,
    attitudes,
    chase_eye,
    grid_lines,
    headings,
    log_ground,
)
from flighttune.scenario.schema import Scenario

SESSION = "session_time"  # flown since the first run began: the runs one after another
LIVE = f"{entities.AIRCRAFT}/live"  # frame of the aircraft that flies now

LIVE_PLOTS = (
    Plot("chi", "Course chi, reference grey"),
    Plot("gamma", "Path angle gamma, reference grey"),
    Plot("phi", "Roll phi flown, command thin", thin="phi_cmd"),
    Plot("n_z", "Load factor n_z flown, command thin", thin="n_z_cmd"),
    Plot("V_a", "Airspeed V_a"),
)

SENT_EVERY = 0.1  # s between two deliveries to the viewer; of flight if flown as fast as possible
PATH_POINTS = 600
BETWEEN_RUNS = 1.0  # s on the session's timeline
DRAWN_SPAN = 12.0  # m, width of the aircraft as drawn
GRID_SECONDS = 4.0  # s of flight between two lines of the ground

GRID_LINES = 21


class LiveSession:
    """A stream to a viewer; the `Observer` that `flighttune.flight.fly.fly` takes.

    `url` is where the viewer listens, ``rerun+http://127.0.0.1:PORT/proxy``, and `pace` the seconds
    of flight per second, None for as fast as possible.
    """

    def __init__(self, scenario: Scenario, url: str, *, pace: float | None = 1.0) -> None:
        if pace is not None and not pace > 0.0:
            raise InputError(f"`pace` must be positive, got {pace}.")
        self.scenario, self.pace = scenario, pace
        self.start_of_run = 0.0  # s, on the session's timeline
        self._stop = threading.Event()
        pairs = [(plant.label, name) for plant in scenario.plant for name in scenario.gain_names]
        labels = [" / ".join(pair) for pair in pairs]
        drawn = zip(distinct(map(plain_name, labels)), line_styles(pairs).values(), strict=True)
        self._drawn = dict(zip(labels, drawn, strict=True))
        self.stream = rr.RecordingStream(application(scenario.title), recording_id=uuid.uuid4())
        self.stream.connect_grpc(url, default_blueprint=live_blueprint())
        self.stream.send_recording_name(f"{scenario.title}, live")
        # m, between the lines on the ground
        self.spacing = GRID_SECONDS * scenario.flight.V_a_mps
        half = np.full(2, (GRID_LINES - 1) * self.spacing / 2.0)
        log_ground(self.stream, grid_lines(-half, half, self.spacing, self.spacing / 2.0))
        lines = {f"{name}/{entities.REFERENCE}": reference_style() for name in ("chi", "gamma")}
        for plot in LIVE_PLOTS:
            for key, line in self._drawn.values():
                lines[f"{plot.signal}/{key}"] = run_style(line, key, plot.signals)
        for path, style in lines.items():
            self.stream.log(f"{entities.PLOTS}/{path}", style, static=True)

    @property
    def stopped(self) -> bool:
        """Whether someone has asked for the end.

        The present run then ends with the status ``interrupted`` after its current sample, and no
        other one begins.
        """
        return self._stop.is_set()

    def stop(self) -> None:
        """Ask for the end; may be called from a signal handler."""
        self._stop.set()

    def watch(self, plant: Plant, label: str) -> Plant:
        """The plant, shown in the viewer and slowed down to the pace."""
        return LivePlant(plant, *self._drawn[label], self)

    def wait_until(self, moment: float) -> None:
        """Sleep until `moment` of the monotonic clock, or until stopped."""
        self._stop.wait(max(0.0, moment - time.monotonic()))

    def __enter__(self) -> "LiveSession":
        return self

    def __exit__(self, *_: object) -> None:
        self.stream.disconnect()


class LivePlant(WrappedPlant):
    """A plant that sends its signals to a session, and otherwise flies as the plant in it."""

    def __init__(self, plant: Plant, key: str, style: LineStyle, session: LiveSession) -> None:
        super().__init__(plant, ())
        self._key, self._style, self._session = key, style, session
        self._rows: list[tuple[float, ...]] = []
        self._path: list[FloatArray] = []
        self._t = self._sent = 0.0
        self._observed: tuple[float, ...] = ()

    def start(self, condition: FlightCondition) -> None:
        """Start the plant and the clock."""
        super().start(condition)
        self._began = time.monotonic()
        self._set_time(0.0)
        model = aircraft_model(self._style.rgb, DRAWN_SPAN)
        self._session.stream.log(f"{LIVE}/{entities.BODY}", *model)

    def observe(self) -> tuple[float, ...]:
        """Signals of the plant."""
        self._observed = self._observe()
        return self._observed

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float) -> Stop | None:
        """Fly on, unless someone has asked for the end."""
        self._rows.append((self._t, *self._observed, phi_cmd, n_z_cmd))
        session = self._session
        if session.stopped or self._t - self._sent >= SENT_EVERY * (session.pace or 1.0):
            self._deliver()
            if session.pace is not None:
                session.wait_until(self._began + self._t / session.pace)
        if session.stopped:  # possibly during the wait
            return self._end(Stop("interrupted", f"stopped by hand at t = {self._t:.2f} s."))
        stop = super().advance(phi_cmd, n_z_cmd, duration)
        self._t += duration
        last = self._t >= session.scenario.flight.duration_s - duration / 2.0
        return self._end(stop) if stop or last else None

    def _end(self, stop: Stop | None) -> Stop | None:
        if self._rows:
            self._deliver()
        self._session.start_of_run += self._t + BETWEEN_RUNS
        return stop

    def _set_time(self, t: float) -> None:
        nanoseconds = round((self._session.start_of_run + t) * 1e9)
        self._session.stream.set_time(SESSION, duration=np.timedelta64(nanoseconds, "ns"))

    def _deliver(self) -> None:
        """Send the samples since the last delivery."""
        names = ("t", *self.signals, "phi_cmd", "n_z_cmd")
        table = pd.DataFrame(self._rows, columns=pd.Index(names), dtype=float).set_index("t")
        self._rows, self._sent = [], self._t
        stream, t = self._session.stream, table.index.to_numpy()
        when = [times(self._session.start_of_run + t, timeline=SESSION)]
        lines = {
            f"{plot.signal}/{self._key}": [displayed(table, name) for name in plot.signals]
            for plot in LIVE_PLOTS
        }
        reference = self._session.scenario.followed().sampled(t)
        for name, values in zip(("chi", "gamma"), reference, strict=True):
            lines[f"{name}/{entities.REFERENCE}"] = [np.rad2deg(values)]
        for path, values in lines.items():
            scalars = rr.Scalars.columns(scalars=np.column_stack(values))
            stream.send_columns(f"{entities.PLOTS}/{path}", when, scalars)
        carried = rr.Transform3D.columns(translation=positions(table), quaternion=headings(table))
        stream.send_columns(LIVE, when, carried)
        turned = rr.Transform3D.columns(quaternion=attitudes(table))
        stream.send_columns(f"{LIVE}/{entities.BODY}", when, turned)
        self._path.append(positions(table))
        path = np.vstack(self._path)
        path = path[evenly(len(path), most=PATH_POINTS)]
        self._set_time(self._t)
        line = rr.LineStrips3D([path], radii=on_screen(self._style.width), colors=[self._style.rgb])
        stream.log(f"{entities.PATHS}/{self._key}", line)
        # The grid follows the aircraft by whole spacings, so that its lines seem to stand still.
        spacing = self._session.spacing
        below = np.round(path[-1] / spacing) * spacing
        stream.log(entities.GROUND, rr.Transform3D(translation=below))


def live_blueprint() -> rrb.Blueprint:
    """One tab that follows the flight."""
    eye = chase_eye(2.0 * DRAWN_SPAN)
    chase = scene_view("Behind the aircraft", eye, f"/{entities.WORLD}/**", origin=LIVE)
    plots = [time_view(f"{entities.PLOTS}/{plot.signal}", plot.heading) for plot in LIVE_PLOTS]
    tab = rrb.Horizontal(chase, rrb.Vertical(*plots), column_shares=[3, 2], name="Live")
    return layout([tab], timeline=SESSION, play_state="following")
