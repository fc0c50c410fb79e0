"""Whether there is a screen, and the address of this machine alone."""

import os
import sys

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
LOCAL = "127.0.0.1"


def has_screen() -> bool:
    """Whether a window can be opened: always on macOS and Windows, else as X11 and Wayland say."""
    if sys.platform in ("darwin", "win32"):
        return True
    return any(os.environ.get(name) for name in DISPLAYS)
