"""A recording in the Rerun viewer: in a window, or in a browser where there is no screen."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote

from flighttune.errors import RecordingError
from flighttune.recording.check import check_recording
from flighttune.recording.viewer import LOCAL, ViewerProcess, free_port

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")


def view(path: str | Path, *, web: bool | None = None) -> ViewerProcess:
    """Open a recording in the viewer.

    Parameters
    ----------
    path : path-like
        A ``.rrd`` file.
    web : bool, optional
        Serve it to a browser instead of opening a window; by default where there is no screen.
        It is served on this machine only and needs no network.

    Returns
    -------
    ViewerProcess
        The running viewer, with the `url` to open where it serves a browser. The caller waits for
        it (``wait``) or ends it (``close``, or a ``with`` block).

    Raises
    ------
    RecordingError
        If `path` is not a recording, a window is asked for where there is no screen, or the viewer
        does not start.
    """
    check_recording(path)
    file = str(Path(path).resolve())
    if web is None:
        web = not has_screen()
    if not web:
        if not has_screen():
            names = ", ".join(DISPLAYS)
            raise RecordingError(
                f"{path}: a window must have a screen, got none of {names}; serve it to a browser."
            )
        return ViewerProcess([file], port=free_port())
    port, web_port = free_port(), free_port()
    data = quote(f"rerun+http://{LOCAL}:{port}/proxy", safe="")
    return ViewerProcess(
        ["--serve-web", "--web-viewer-port", str(web_port), file],
        port=port,
        wait_for=web_port,
        url=f"http://{LOCAL}:{web_port}/?url={data}",
    )


def has_screen(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> bool:
    """Whether a window can be opened: always on macOS and Windows, else as X11 and Wayland say."""
    if platform in ("darwin", "win32"):
        return True
    return any(environment.get(name) for name in DISPLAYS)
