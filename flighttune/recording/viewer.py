"""The Rerun viewer with a recording: in a window, or served to a browser."""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from flighttune.errors import InputError, RecordingError
from flighttune.recording.parquet import check_recording
from flighttune.whole_file import reason_of

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
LOCAL = "127.0.0.1"
START_TIMEOUT = 30.0
POLL = 0.05

# A word in an error that the viewer logs on every machine without a desktop; it means nothing.
NOISE = "XDG_RUNTIME_DIR"


def free_port() -> int:
    """A TCP port on which nothing listens now."""
    with socket.socket() as probe:
        probe.bind((LOCAL, 0))
        return probe.getsockname()[1]


def _check_free(*ports: int) -> None:
    for port in ports:
        with socket.socket() as probe:
            # As the viewer does it: a connection closed a minute ago is no obstacle.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LOCAL, port))
            except OSError as error:
                raise InputError(
                    f"`port` must be free and the one behind it too, got {port}: "
                    f"{reason_of(error)}."
                ) from error


def stream_url(port: int) -> str:
    """Address at which a viewer with its data server on `port` takes a stream."""
    return f"rerun+http://{LOCAL}:{port}/proxy"


def tied(command: list[str]) -> list[str]:
    """A command that, on Linux, is killed when the thread that starts it ends, however that ends.

    ``setpriv`` is part of util-linux; without it the viewer of a killed command stays.
    """
    setpriv = shutil.which("setpriv")
    return command if setpriv is None else [setpriv, "--pdeathsig", "KILL", "--", *command]


class ViewerProcess:
    """A running viewer that listens on this machine only.

    On Linux it ends with the thread that started it, even if that is killed. `arguments` are those
    of ``rerun`` without port and address, `port` is that of its data server, `wait_for` the port
    that answers once the viewer is ready, and `url` where a browser finds it. A viewer that ends or
    does not answer is a RecordingError with its last error.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        *,
        port: int,
        wait_for: int | None = None,
        url: str | None = None,
        environment: dict[str, str] | None = None,
    ) -> None:
        self.port = port
        self.url = url
        # The program itself: its script is a shim, and ending the shim would orphan the viewer.
        import rerun_cli

        program = Path(next(iter(rerun_cli.__path__))) / "rerun"
        # A file, because a pipe that nobody reads would block the viewer when it is full.
        self._output = tempfile.TemporaryFile()  # noqa: SIM115
        command = tied([str(program), "--port", str(port), "--bind", LOCAL, *arguments])
        self._process = subprocess.Popen(
            command,
            env={**os.environ, **(environment or {})},
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
            start_new_session=True,  # Ctrl-C goes to the command that started it, not to the viewer
        )
        try:
            self._await(wait_for or port)
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
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

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

    def wait(self) -> int:
        """Wait until the user closes it and return its exit status."""
        return self._process.wait()

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

    def __enter__(self) -> "ViewerProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def view(path: str | Path, *, web: bool | None = None, port: int | None = None) -> ViewerProcess:
    """Open a recording (.rrd) in a viewer, which the caller waits for or closes.

    With `web` it is served to a browser on this machine instead of a window; by default where there
    is no screen. With `port` it is served at this port, and its data at the next one.
    """
    check_recording(path)
    argument = str(Path(path).resolve())
    if web is False and not has_screen():
        names = ", ".join(DISPLAYS)
        raise RecordingError(
            f"{path}: a window must have a screen, got none of {names}; serve it to a browser."
        )
    if port is None and (web is False or (web is None and has_screen())):
        return ViewerProcess([argument], port=free_port())
    if port is None:
        web_port, port = free_port(), free_port()
    else:
        web_port, port = port, port + 1
        _check_free(web_port, port)
    return ViewerProcess(
        ["--serve-web", "--web-viewer-port", str(web_port), argument],
        port=port,
        wait_for=web_port,
        url=f"http://{LOCAL}:{web_port}/?url={quote(stream_url(port), safe='')}",
    )


def has_screen(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> bool:
    """Whether a window can be opened: always on macOS and Windows, else as X11 and Wayland say."""
    if platform in ("darwin", "win32"):
        return True
    return any(environment.get(name) for name in DISPLAYS)
