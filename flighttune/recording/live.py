"""A scenario watched while it is being flown, at real time or faster, and stopped by hand."""

import threading
import time
import uuid

import numpy as np
import pandas as pd
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.control.limits import Limits
from flighttune.errors import InputError
from flighttune.palette import Look, looks
from flighttune.plants.base import FlightCondition, Plant, Stop
from flighttune.recording.geometry import attitudes, headings, positions
from flighttune.recording.live_layout import (
    DRAWN_SPAN,
    LIVE,
    SESSION,
    SHOWN,
    live_blueprint,
    log_aircraft,
    log_ground,
    log_styles,
    move_ground,
)
from flighttune.recording.mesh import SPAN
from flighttune.recording.names import (
    BODY,
    NANOSECONDS,
    PATHS,
    PLOTS,
    REFERENCE,
    application,
    plain_name,
    told_apart,
)
from flighttune.recording.plots import displayed
from flighttune.recording.thinning import evenly
from flighttune.scenario.schema import Scenario

SENT_EVERY = 0.1
"""Seconds between two deliveries to the viewer; of flight where it is flown as fast as it goes."""

PATH_EVERY = 0.5
"""Seconds of flight between two drawings of the path so far."""

PATH_POINTS = 600
BETWEEN_RUNS = 1.0
"""Seconds on the session's timeline between two runs."""

GRID_SECONDS = 4.0
"""Distance of two lines of the ground, in seconds of flight."""


class LiveSession:
    """A stream to a viewer that runs can be flown under.

    Parameters
    ----------
    scenario : Scenario
        What is going to be flown.
    url : str
        Where the viewer listens: ``rerun+http://127.0.0.1:PORT/proxy``.
    pace : float or None
        Seconds of flight a second; None for as fast as it goes.

    Attributes
    ----------
    spacing : float, m
        Of the lines on the ground.
    start_of_run : float, s
        Where the run in the air begins on the session's timeline.
    stopped : bool
        Whether someone has asked for the end: the run in the air ends with the status
        ``interrupted`` after the sample it is at, and no other one begins.

    Raises
    ------
    InputError
        If `pace` is not positive.
    """

    def __init__(self, scenario: Scenario, url: str, *, pace: float | None = 1.0) -> None:
        if pace is not None and not pace > 0.0:
            raise InputError(f"`pace` must be positive, got {pace}.")
        self.scenario, self.pace = scenario, pace
        self.start_of_run = 0.0
        self._stop = threading.Event()
        names = [entry if isinstance(entry, str) else entry.name for entry in scenario.gains]
        pairs = [(plant.label, name) for plant in scenario.plant for name in names]
        found = looks(pairs)
        self._looks = {f"{plant} / {name}": found[plant, name] for plant, name in pairs}
        self.stream = rr.RecordingStream(application(scenario.title), recording_id=uuid.uuid4())
        self.stream.connect_grpc(url, default_blueprint=live_blueprint())
        self.stream.send_recording_name(f"{scenario.title}, live")
        self.spacing = GRID_SECONDS * scenario.flight.V_a_mps
        log_ground(self.stream, spacing=self.spacing)
        keys = told_apart(plain_name(label) for label in self._looks)
        self._keys = dict(zip(self._looks, keys, strict=True))
        log_styles(self.stream, keys, list(self._looks.values()))

    @property
    def stopped(self) -> bool:
        """Whether someone has asked for the end."""
        return self._stop.is_set()

    def stop(self) -> None:
        """End the run in the air after the sample it is at; may be called from a signal handler."""
        self._stop.set()

    def watch(self, plant: Plant, label: str) -> Plant:
        """The plant, seen by the viewer and kept to the pace."""
        return WatchedPlant(plant, self._keys[label], self._looks[label], self)

    def wait_until(self, moment: float) -> None:
        """Sleep until `moment` of the monotonic clock, or until stopped."""
        self._stop.wait(max(0.0, moment - time.monotonic()))

    def close(self) -> None:
        """Deliver what is left."""
        self.stream.disconnect()

    def __enter__(self) -> "LiveSession":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class WatchedPlant:
    """A plant whose signals go to a viewer; flies as the plant in it.

    Parameters
    ----------
    plant : Plant
        A plant that was not flown before.
    key : str
        Name of the run in the tree of the recording.
    look : Look
        Of the run.
    session : LiveSession
        Where the signals go, and who says when to stop.
    """

    def __init__(self, plant: Plant, key: str, look: Look, session: LiveSession) -> None:
        self.kind, self.signals = plant.kind, plant.signals
        self._plant, self._look, self._session = plant, look, session
        self._key = key
        self._rows: list[tuple[float, ...]] = []
        self._path: list[FloatArray] = []
        self._t = self._sent = self._drawn = 0.0
        self._seen: tuple[float, ...] = ()

    @property
    def limits(self) -> Limits:
        """What the plant itself limits its commands to."""
        return self._plant.limits

    def start(self, condition: FlightCondition) -> None:
        """Start the plant and the clock."""
        self._plant.start(condition)
        self._began = time.monotonic()
        stream = self._session.stream
        self._set_time(0.0)
        log_aircraft(stream, f"{LIVE}/{BODY}", self._look, scale=DRAWN_SPAN / SPAN)

    def observe(self) -> tuple[float, ...]:
        """What the plant shows."""
        self._seen = self._plant.observe()
        return self._seen

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float) -> Stop | None:
        """Fly on, unless someone has asked for the end."""
        self._rows.append((self._t, *self._seen, phi_cmd, n_z_cmd))
        pace = self._session.pace
        ended = self._session.stopped
        if ended or self._t - self._sent >= SENT_EVERY * (pace or 1.0):
            self._deliver()
            if pace is not None:
                self._session.wait_until(self._began + self._t / pace)
        if ended or self._session.stopped:
            return self._over(Stop("interrupted", f"stopped by hand at t = {self._t:.2f} s."))
        stop = self._plant.advance(phi_cmd, n_z_cmd, duration)
        self._t += duration
        last = self._t >= self._session.scenario.flight.duration_s - duration / 2.0
        return self._over(stop) if stop or last else None

    def _over(self, stop: Stop | None) -> Stop | None:
        if self._rows:
            self._deliver()
        self._session.start_of_run += self._t + BETWEEN_RUNS
        return stop

    def _set_time(self, t: float) -> None:
        nanoseconds = round((self._session.start_of_run + t) * NANOSECONDS)
        self._session.stream.set_time(SESSION, duration=np.timedelta64(nanoseconds, "ns"))

    def _deliver(self) -> None:
        """Send the samples since the last delivery."""
        names = ("t", *self.signals, "phi_cmd", "n_z_cmd")
        table = pd.DataFrame(self._rows, columns=pd.Index(names), dtype=float).set_index("t")
        self._rows, self._sent = [], self._t
        stream, start = self._session.stream, self._session.start_of_run
        moments = np.rint((start + table.index.to_numpy()) * NANOSECONDS)
        when = [rr.TimeColumn(SESSION, duration=moments.astype("timedelta64[ns]"))]
        for name, (_, signals) in SHOWN.items():
            values = np.column_stack([displayed(table, signal) for signal in signals])
            scalars = rr.Scalars.columns(scalars=values)
            stream.send_columns(f"{PLOTS}/{name}/{self._key}", when, scalars)
        followed = self._session.scenario.followed().sampled(table.index.to_numpy())
        for name, values in zip(("chi", "gamma"), followed, strict=True):
            scalars = rr.Scalars.columns(scalars=np.rad2deg(values))
            stream.send_columns(f"{PLOTS}/{name}/{REFERENCE}", when, scalars)
        carried = rr.Transform3D.columns(translation=positions(table), quaternion=headings(table))
        stream.send_columns(LIVE, when, carried)
        turned = rr.Transform3D.columns(quaternion=attitudes(table))
        stream.send_columns(f"{LIVE}/{BODY}", when, turned)
        self._path.append(positions(table))
        if self._t - self._drawn >= PATH_EVERY or self._drawn == 0.0:
            self._draw_path()

    def _draw_path(self) -> None:
        path = np.vstack(self._path)
        path = path[evenly(len(path), most=PATH_POINTS)]
        self._drawn = self._t
        self._set_time(self._t)
        width = rr.components.Radius.ui_points(self._look.width)
        line = rr.LineStrips3D([path], radii=width, colors=[self._look.rgb])
        self._session.stream.log(f"{PATHS}/{self._key}", line)
        move_ground(self._session.stream, path[-1], spacing=self._session.spacing)
