"""Standard output and error that fail no command: in any encoding, and when nobody reads them."""

import codecs
import io
import os
import sys
from typing import Any, BinaryIO, cast

WORDS = "flighttune.words"
"""Name of the error handler that writes what an encoding lacks in ASCII."""

_ASCII = {"─": "-", "°": " deg", "±": "+-", "−": "-", "–": "-", "∞": "inf", "‖": "|", "→": "->"}


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    """``χ`` as ``chi``, ``²`` as ``2``, ``°`` as `` deg``."""
    from unicodedata import name, normalize

    assert isinstance(error, UnicodeEncodeError)
    shown = []
    for char in error.object[error.start : error.end]:
        words = name(char, "unnamed").split()
        known = words[-1].lower() if words[0] == "GREEK" else _ASCII.get(char)
        shown.append(known or normalize("NFKD", char).encode("ascii", "ignore").decode() or "?")
    return "".join(shown), error.end


class _Descriptor(io.FileIO):
    """A descriptor that takes everything, and keeps its first error but that nobody reads."""

    error: OSError | None = None

    def write(self, data: Any, /) -> int | None:
        try:
            return super().write(data)
        except OSError as error:
            if not isinstance(error, BrokenPipeError):
                self.error = self.error or error
            return len(data)


class StandardStreams:
    """Standard output and error of this process, from now on."""

    def __init__(self) -> None:
        codecs.register_error(WORDS, _in_ascii)
        self._descriptors = [self._replaced(name) for name in ("stdout", "stderr")]

    def _replaced(self, name: str) -> _Descriptor | None:
        if getattr(sys, name) is None:  # closed by whoever started the command
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        stream = getattr(sys, name)
        if not isinstance(stream, io.TextIOWrapper):
            return None
        stream.reconfigure(errors=WORDS)
        # Not what a test or a notebook has put there, nor a console of Windows, which is no file.
        if stream is not getattr(sys, f"__{name}__") or (os.name == "nt" and stream.isatty()):
            return None
        stream.flush()
        descriptor = _Descriptor(stream.fileno(), "wb", closefd=False)
        unbuffered = stream.write_through  # python -u
        wrapped = io.TextIOWrapper(
            cast("BinaryIO", descriptor if unbuffered else io.BufferedWriter(descriptor)),
            encoding=stream.encoding,
            errors=WORDS,
            line_buffering=stream.line_buffering,
            write_through=unbuffered,
        )
        setattr(sys, name, wrapped)
        return descriptor

    def failure(self) -> str | None:
        """Why not all of standard output could be written, now that all of it has been."""
        from flighttune.whole_file import reason_of

        sys.stdout.flush()
        descriptor, _ = self._descriptors
        return descriptor and descriptor.error and reason_of(descriptor.error)
