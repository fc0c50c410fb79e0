"""A folder wherever fsspec reaches, its files whole or not there: the only importer of fsspec."""

import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from flighttune.errors import InputError, OutputError, RecordingError

WRITING = ".writing"
"""Folder of the files that are not finished yet; a sibling of all others, so that no glob over a
folder of finished files meets them."""


class Store:
    """Files under one path or URL.

    Parameters
    ----------
    url : str or Path
        A local folder, or any URL that fsspec knows (``memory://x``, ``s3://bucket/x``).

    Attributes
    ----------
    url : str
        As it was given.

    Raises
    ------
    InputError
        If the protocol is not known, or its package is not installed.
    """

    def __init__(self, url: str | Path) -> None:
        import fsspec.core

        self.url = str(url)
        try:
            fs, root = fsspec.core.url_to_fs(self.url)
        except (ValueError, ImportError) as error:
            raise InputError(
                f"{self.url}: must be a folder or a URL that fsspec can open, got: {error}."
            ) from error
        self._fs: Any = fs
        self._root = str(root).rstrip("/") or str(root)

    def place(self, name: str) -> str:
        """Path or URL of the file `name`, as a user would give it."""
        return f"{self.url.rstrip('/')}/{name}"

    def exists(self, name: str) -> bool:
        """Whether there is a file or folder `name`."""
        with self._reading(name):
            self._fs.invalidate_cache()
            return bool(self._fs.exists(self._at(name)))

    def names(self, folder: str) -> tuple[str, ...]:
        """Names of the files in `folder`, sorted; none where there is no such folder."""
        with self._reading(folder):
            self._fs.invalidate_cache()
            try:
                found = self._fs.ls(self._at(folder), detail=False)
            except FileNotFoundError:
                return ()
        return tuple(sorted(str(path).rstrip("/").rsplit("/", 1)[-1] for path in found))

    def read(self, name: str) -> bytes:
        """Return the bytes of the file `name`.

        Raises
        ------
        RecordingError
            If it cannot be read.
        """
        with self._reading(name):
            return bytes(self._fs.cat_file(self._at(name)))

    def write(self, name: str, data: bytes) -> None:
        """Write the file `name` whole or not at all; what stood there before stays until then.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        part = self._at(f"{WRITING}/{uuid.uuid4().hex}")
        with self._writing(name):
            try:
                self._fs.makedirs(self._at(WRITING), exist_ok=True)
                self._fs.makedirs(self._at(name).rsplit("/", 1)[0], exist_ok=True)
                self._fs.pipe_file(part, data)
                self._fs.mv(part, self._at(name))
            except BaseException:
                with suppress(Exception):
                    self._fs.rm_file(part)
                raise

    def create(self, name: str, data: bytes) -> bool:
        """Write the file `name` where there is none; return whether there was none.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        with self._writing(name):
            self._fs.makedirs(self._root, exist_ok=True)
            try:
                with self._fs.open(self._at(name), "xb") as file:
                    file.write(data)
            except FileExistsError:
                return False
            except (NotImplementedError, ValueError):  # a file system that cannot tell atomically
                if self.exists(name):
                    return False
                self._fs.pipe_file(self._at(name), data)
        return True

    def remove(self, name: str) -> None:
        """Remove the file or folder `name`, if it is there.

        Raises
        ------
        OutputError
            If it cannot be removed.
        """
        with self._writing(name), suppress(FileNotFoundError):
            self._fs.rm(self._at(name), recursive=True)

    def _at(self, name: str) -> str:
        return f"{self._root.rstrip('/')}/{name}"

    @contextmanager
    def _reading(self, name: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # each file system has errors of its own
            raise RecordingError(f"{self.place(name)}: must be readable, got {error}.") from error

    @contextmanager
    def _writing(self, name: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # each file system has errors of its own
            what = error.strerror if isinstance(error, OSError) and error.strerror else error
            raise OutputError(f"{self.place(name)}: must be writable, got: {what}.") from error
