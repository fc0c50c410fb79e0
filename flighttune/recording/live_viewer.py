"""A viewer that waits for a flight: in a window, or served to a browser."""

from urllib.parse import quote

from flighttune.recording.view import has_screen
from flighttune.recording.viewer import LOCAL, ViewerProcess, free_port


def waiting_viewer(*, web: bool | None = None) -> ViewerProcess:
    """Start a viewer for a `flighttune.recording.live.LiveSession`.

    Parameters
    ----------
    web : bool, optional
        Serve it to a browser instead of opening a window; by default where there is no screen.

    Returns
    -------
    ViewerProcess
        Listens on this machine only; `stream_url` of its port is where the session connects. Its
        `url` is the page to open where it serves a browser.

    Raises
    ------
    RecordingError
        If it does not start.
    """
    port = free_port()
    if not (not has_screen() if web is None else web):
        return ViewerProcess(["--hide-welcome-screen"], port=port)
    web_port = free_port()
    return ViewerProcess(
        ["--serve-web", "--web-viewer-port", str(web_port)],
        port=port,
        wait_for=web_port,
        url=f"http://{LOCAL}:{web_port}/?url={quote(stream_url(port), safe='')}",
    )


def stream_url(port: int) -> str:
    """Where a viewer that listens on `port` takes data."""
    return f"rerun+http://{LOCAL}:{port}/proxy"
