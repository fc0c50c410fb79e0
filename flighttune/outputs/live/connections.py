"""Connections to the page: those without its token wait shortly, and in places of their own."""

import asyncio
import time
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

# Time in which a connection must show the token, s; most connections that have not, and most that
# have: a window has one for its news.
SHOWN_S, MAX_WAITING, MAX_CONNECTIONS = 5.0, 64, 64


class Connection(H11Protocol):
    """A connection that is closed unless it shows the token in time.

    Any user of the machine can open connections that send nothing. A new connection beyond the most
    that may wait closes the oldest one, so that a browser always gets in.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._allowed, self._began = False, time.monotonic()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait."""
        super().connection_made(transport)
        self._end = self.loop.call_later(SHOWN_S, transport.abort)
        waiting = [x for x in self.connections if isinstance(x, Connection) and not x._allowed]
        if len(waiting) > MAX_WAITING:
            min(waiting, key=lambda x: x._began).transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """End."""
        self._end.cancel()
        super().connection_lost(exc)

    def allow(self) -> bool:
        """Let a connection stay that has shown the token; False if too many have."""
        self._allowed = True
        self._end.cancel()
        stay = [x for x in self.connections if isinstance(x, Connection) and x._allowed]
        return len(stay) <= MAX_CONNECTIONS
