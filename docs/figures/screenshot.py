"""Pictures of a recording without a screen, as the viewer draws it.

Run it with ``python docs/figures/screenshot.py runs/paper/paper.rrd picture.png --at 4.4``.
"""

import argparse
import io
import os
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from packaging.version import Version

from flighttune.base.errors import RecordingError
from flighttune.base.files.whole import whole_file
from flighttune.flight.records.parquet import check_recording
from flighttune.outputs.recording.entities import TIMELINE
from flighttune.outputs.recording.record import LOCAL, rerun_program, stream_url

if TYPE_CHECKING:
    from rerun.experimental import ViewerState

SIZE = (1600, 1000)
TITLE_BAR = 36
COLOURS = 256
NO_GRAPHICS = ("render context", "adapter")
NEEDS_DRIVER = "find a graphics card or a software driver (Debian: mesa-vulkan-drivers)"
SETTLE_TIMEOUT = 20.0
ALIKE_AT_START = 6
"""Pictures in a row without change after which the messages of the start are gone."""

LAYOUTS = Version(version("rerun-sdk")) >= Version("0.41")
"""Whether the viewer can be told which tab to show."""

POLL = 0.1
LOADING_GRACE = 10.0


START_TIMEOUT = 30.0

# A word in an error that the viewer logs on every machine without a desktop; it means nothing.
NOISE = "XDG_RUNTIME_DIR"


def free_port() -> int:
    """A TCP port on which nothing listens now."""
    with socket.socket() as probe:
        probe.bind((LOCAL, 0))
        return probe.getsockname()[1]


class ViewerProcess:
    """A viewer without window, which ends with the thread that started it where `setpriv` is."""

    def __init__(self, arguments: list[str], *, port: int) -> None:
        setpriv = shutil.which("setpriv")
        tie = [] if setpriv is None else [setpriv, "--pdeathsig", "KILL", "--"]
        # A file, because a pipe that nobody reads would block the viewer when it is full.
        self._output = tempfile.TemporaryFile()  # noqa: SIM115
        self._process = subprocess.Popen(
            [*tie, rerun_program(), "--port", str(port), "--bind", LOCAL, *arguments],
            env={**os.environ, "CI": "true", "RUST_LOG": "error"},
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            self._await(port)
        except BaseException:
            self.close()
            raise

    def _await(self, port: int) -> None:
        end = time.monotonic() + START_TIMEOUT
        while time.monotonic() < end:
            if self._process.poll() is not None:
                raise RecordingError(f"the Rerun viewer must start, got: {self.last_error()}.")
            try:
                socket.create_connection((LOCAL, port), timeout=1.0).close()
            except OSError:
                time.sleep(POLL)
            else:
                return
        raise RecordingError(f"the Rerun viewer must answer within {START_TIMEOUT:g} s.")

    @property
    def ended(self) -> bool:
        """Whether the process has ended; a crashing viewer has a second to do so."""
        try:
            self._process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            return False
        return True

    def last_error(self) -> str:
        """The line of its output that says why it ended, or the last one."""
        self._output.seek(0)
        lines = self._output.read().decode(errors="replace").strip().splitlines()
        panics = [line for line in lines if "panicked" in line]
        errors = [line for line in lines if "error" in line.lower() and NOISE not in line]
        line, *_ = panics[:1] or errors[-1:] or lines[-1:] or [f"status {self._process.poll()}"]
        return line.strip().rstrip(".")

    def close(self) -> None:
        """End the viewer if it still runs."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(timeout=5.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._output.close()


@dataclass(frozen=True, slots=True)
class Complaint:
    """A warning or error of the viewer: the view (or the log) it is in, and its text."""

    where: str
    words: str


class _Client040:
    """The client of Rerun 0.40 under the names of 0.41; it cannot choose a tab."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self.get_state, self.get_logs = client.viewer_state, client.viewer_logs

    def open(self, path: str) -> None:
        self._client.open_url(path)

    def take_screenshot(self, view: str | None = None) -> bytes:
        with TemporaryDirectory() as folder:
            picture = Path(folder) / "picture.png"
            self._client.save_screenshot(str(picture), view)
            return picture.read_bytes()


def viewer_client(url: str) -> Any:
    """What talks to a running viewer, in any version of Rerun that we take."""
    from rerun.experimental import ViewerClient

    client = ViewerClient.connect(url)
    return client if LAYOUTS else _Client040(client)


class HeadlessViewer:
    """A viewer without window that has one recording open.

    Parameters
    ----------
    recording : path-like
        A ``.rrd`` file.
    size : (int, int), pixels
        Width and height of the pictures.

    Raises
    ------
    RecordingError
        If the viewer cannot start (without a graphics card it needs a software driver such as
        Debian's ``mesa-vulkan-drivers``) or cannot open the file.
    """

    def __init__(self, recording: str | Path, *, size: tuple[int, int] = SIZE) -> None:
        check_recording(recording)
        self._recording = recording
        path = Path(recording).resolve()
        port = free_port()
        window = f"{size[0]}x{size[1]}"
        self._process = ViewerProcess(
            ["--headless", "--hide-welcome-screen", "--window-size", window], port=port
        )
        try:
            self._client = viewer_client(stream_url(port))
            self._open(path)
        except BaseException:
            self.close()
            raise

    def _open(self, path: Path) -> None:
        with self._translated_errors():
            self._client.open(str(path))
        end = time.monotonic() + LOADING_GRACE
        while self._state().loading and time.monotonic() < end:
            time.sleep(POLL)
        if LAYOUTS:
            with self._translated_errors():
                self._layout = self._client.get_blueprint().blueprint
            self._layout["/top_panel"] = {"PanelBlueprint": {"state": "Hidden"}}
            self._apply()
        self._settle(alike=ALIKE_AT_START)

    @contextmanager
    def _translated_errors(self) -> Iterator[None]:
        """Raise a failing request to the viewer as a RecordingError."""
        try:
            yield
        except (ConnectionError, RuntimeError) as error:
            said = self._process.last_error() if self._process.ended else str(error)
            wanted = NEEDS_DRIVER if any(word in said for word in NO_GRAPHICS) else "show it"
            raise RecordingError(
                f"{self._recording}: the viewer must {wanted}, got: {said}."
            ) from error

    def _state(self) -> "ViewerState":
        with self._translated_errors():
            return self._client.get_state()

    def _apply(self) -> None:
        with self._translated_errors():
            self._client.set_blueprint(self._layout, of="recording")

    @property
    def tabs(self) -> dict[str, str]:
        """Name of each tab and its place in the layout."""
        return {self._name(place): place for place in _inside(self._tabs())}

    def _tabs(self) -> dict[str, Any]:
        for parts in self._layout.values():
            container = parts.get("ContainerBlueprint", {})
            if container.get("container_kind") == "Tabs":
                return container
        raise RecordingError("the layout of a recording must have tabs, got none.")

    def _name(self, place: str) -> str:
        return next(iter(self._layout[_key(place)].values()))["display_name"]

    def views(self, tab: str) -> dict[str, str]:
        """Name and id of every view on `tab`."""
        found: dict[str, str] = {}
        pending = [self.tabs[tab]]
        while pending:
            place = pending.pop(0)
            if _key(place).startswith("/view/"):
                found[self._name(place)] = place.rpartition("/")[2]
            else:
                pending += _inside(self._layout[_key(place)]["ContainerBlueprint"])
        return found

    def show(self, tab: str | None = None, *, at: float | None = None) -> None:
        """Bring a tab to the front and the time cursor to `at` (s of flight); wait for the picture.

        Raises
        ------
        RecordingError
            If there is no such tab, or the picture does not come to rest.
        """
        if tab is not None:
            if tab not in self.tabs:
                known = ", ".join(self.tabs)
                raise RecordingError(
                    f"{self._recording}: the tab must be one of {known}, got {tab}."
                )
            self._tabs()["active_tab"] = self.tabs[tab]
            self._apply()
        if at is not None:
            with self._translated_errors():
                self._client.set_time(TIMELINE, duration=float(at), play_state="paused")
        self._settle()

    def _settle(self, *, alike: int = 2) -> None:
        """Wait until `alike` pictures in a row are the same."""
        before, count, end = b"", 0, time.monotonic() + SETTLE_TIMEOUT
        while time.monotonic() < end:
            now = self.picture()
            count = count + 1 if now == before and not self._state().loading else 1
            if count == alike:
                return
            before = now
        raise RecordingError(
            f"{self._recording}: the picture must come to rest within {SETTLE_TIMEOUT:g} s."
        )

    def picture(self, view: str | None = None) -> bytes:
        """PNG of the whole window, or of one view by its id."""
        with self._translated_errors():
            return self._client.take_screenshot(view)

    @property
    def cursor(self) -> float | None:
        """Time of flight shown, s."""
        now = self._state().recordings[0].current_time
        return None if now is None else now / 1e9

    def complaints(self) -> list[Complaint]:
        """Reports of the views, and errors in the log of the viewer."""
        found = [
            Complaint(view.name, f"{report.summary} {report.details or ''}".strip())
            for view in self._state().views
            for report in view.reports
        ]
        with self._translated_errors():
            logged = [entry for entry in self._client.get_logs() if entry.level == "ERROR"]
        return found + [Complaint("log", entry.message) for entry in logged]

    def close(self) -> None:
        """End the viewer."""
        self._process.close()

    def __enter__(self) -> "HeadlessViewer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _key(place: str) -> str:
    """Key of a part of the layout: the viewer refers to parts with and without a first slash."""
    return f"/{place.lstrip('/')}"


def _inside(container: dict[str, Any]) -> list[str]:
    """Parts of a container; the viewer gives a single one without a list."""
    contents = container["contents"]
    return [contents] if isinstance(contents, str) else list(contents)


def screenshot(
    recording: str | Path,
    path: str | Path,
    *,
    tab: str | None = None,
    at: float | None = None,
    size: tuple[int, int] = SIZE,
) -> None:
    """Save a picture of a recording, small enough for a page: 256 colours, no title bar.

    Parameters
    ----------
    recording : path-like
        A ``.rrd`` file.
    path : path-like
        PNG file to write or replace.
    tab : str, optional
        Name of the tab to show; the first one if not given.
    at : float, s, optional
        Time of flight to show; the start if not given.
    size : (int, int), pixels
        Width and height of the window, of which the picture leaves out the title bar.

    Raises
    ------
    RecordingError
        If the viewer cannot start, or the recording cannot be opened or has no such tab.
    """
    from PIL import Image

    with HeadlessViewer(recording, size=size) as viewer:
        viewer.show(tab, at=at)
        picture = viewer.picture()
    with whole_file(Path(path)) as part, Image.open(io.BytesIO(picture)) as image:
        width, height = image.size
        below = image.convert("RGB").crop((0, TITLE_BAR, width, height))
        below.quantize(COLOURS, dither=Image.Dither.NONE).save(part, format="PNG", optimize=True)


def main() -> None:
    """Read the command line and save one picture."""
    parser = argparse.ArgumentParser(description="Save a picture of a recording.")
    parser.add_argument("recording", help="a .rrd file")
    parser.add_argument("picture", help="the PNG file to write")
    parser.add_argument("--tab", help="tab to show [default: the first]")
    parser.add_argument("--at", type=float, help="time of flight to show, s [default: the start]")
    given = parser.parse_args()
    screenshot(given.recording, given.picture, tab=given.tab, at=given.at)


if __name__ == "__main__":
    main()
