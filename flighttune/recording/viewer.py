"""The Rerun viewer with a recording: in a window, or served to a browser."""

import os
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote

from flighttune.errors import RecordingError
from flighttune.records.parquet import check_recording

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
LOCAL = "127.0.0.1"

# Port of the page where a browser is served and no other port was asked for; Rerun's own default
PORT = 9090


def rerun_program() -> str:
    """Path of Rerun itself: ending the script `rerun` would leave the program running."""
    import rerun_cli

    return str(Path(next(iter(rerun_cli.__path__))) / "rerun")


def stream_url(port: int) -> str:
    """Address at which a viewer with its data server on `port` takes a stream."""
    return f"rerun+http://{LOCAL}:{port}/proxy"


def viewer(path: str | Path, *, port: int | None = None) -> tuple[list[str], str]:
    """Command that opens a recording, and the address of the page if a browser is served."""
    check_recording(path)
    command = [rerun_program(), "--bind", LOCAL, str(Path(path).resolve())]
    if port is None and has_screen():
        return [*command, "--port", "auto"], ""
    page, data = port or PORT, (port or PORT) + 1
    _check_free(page)
    _check_free(data)
    served = ["--serve-web", "--web-viewer-port", str(page), "--port", str(data)]
    return [*command, *served], f"http://{LOCAL}:{page}/?url={quote(stream_url(data), safe='')}"


def _check_free(port: int) -> None:
    """Raise unless `port` can be listened on; Rerun waits for ever where its data port is taken."""
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
    """Run a command of `viewer` until it ends; Rerun prints on stderr why it could not go on."""
    # Rerun sends usage statistics to its makers unless it believes that it runs in CI.
    environment = {"RUST_LOG": "warn", "CI": "true"} | os.environ
    if status := subprocess.run(command, env=environment, check=False).returncode:
        raise RecordingError(
            f"{path}: the Rerun viewer must open it, got exit status {status}; its reason is above."
        )


def has_screen(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> bool:
    """Whether a window can be opened: always on macOS and Windows, else as X11 and Wayland say."""
    if platform in ("darwin", "win32"):
        return True
    return any(environment.get(name) for name in DISPLAYS)
