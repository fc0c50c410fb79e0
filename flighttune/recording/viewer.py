"""The Rerun viewer as a process of our own: found, started, waited for, ended."""

import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from flighttune.errors import RecordingError

LOCAL = "127.0.0.1"
START_TIMEOUT = 30.0
POLL = 0.05
NOISE = "XDG_RUNTIME_DIR"


def executable() -> Path:
    """Return the viewer that came with the Rerun SDK.

    It is started directly: the ``rerun`` script is a shim whose end would orphan the viewer.
    """
    import rerun_cli

    name = "rerun.exe" if os.name == "nt" else "rerun"
    return Path(next(iter(rerun_cli.__path__))) / name


def free_port() -> int:
    """Return a TCP port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind((LOCAL, 0))
        return probe.getsockname()[1]


class ViewerProcess:
    """A running viewer that listens on this machine only.

    Parameters
    ----------
    arguments : sequence of str
        Command line after the name of the program, without port and address.
    port : int
        Port of its data server.
    wait_for : int
        Port that answers once the viewer is ready.
    url : str, optional
        Where a browser finds it; kept as an attribute.
    environment : mapping of str to str, optional
        What to change in the environment.

    Raises
    ------
    RecordingError
        If it ends or does not answer; the message has its last words.
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
        self._said = tempfile.TemporaryFile()  # noqa: SIM115
        command = [str(executable()), "--port", str(port), "--bind", LOCAL, *arguments]
        self._process = subprocess.Popen(
            command,
            env={**os.environ, **(environment or {})},
            stdin=subprocess.DEVNULL,
            stdout=self._said,
            stderr=subprocess.STDOUT,
            start_new_session=True,  # a Ctrl-C is for the command that started it
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
                raise RecordingError(f"the Rerun viewer must start, got: {self.last_words()}.")
            try:
                socket.create_connection((LOCAL, port), timeout=1.0).close()
            except OSError:
                time.sleep(POLL)
            else:
                return
        raise RecordingError(f"the Rerun viewer must answer within {START_TIMEOUT:g} s.")

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def ended(self) -> bool:
        """Whether it runs no more; a viewer that broke off may need a moment for it."""
        try:
            self._process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            return False
        return True

    def last_words(self) -> str:
        """The line in which it said why it ended, or the last one."""
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").strip().splitlines()
        panics = [line for line in lines if "panicked" in line]
        errors = [line for line in lines if "error" in line.lower() and NOISE not in line]
        told = panics[:1] or errors[-1:] or lines[-1:] or [f"exit status {self._process.poll()}"]
        return told[0].strip().rstrip(".")

    def wait(self) -> int:
        """Wait until the user closes it and return its exit status."""
        return self._process.wait()

    def close(self) -> None:
        """End it, if it still runs."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(timeout=5.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._said.close()

    def __enter__(self) -> "ViewerProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
