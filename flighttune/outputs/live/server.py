"""The server of the page: it answers this machine alone, and only requests with the token."""

import asyncio
import json
import secrets
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager
from itertools import groupby
from pathlib import Path
from typing import Any

import uvicorn
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from flighttune.base.errors import FlightTuneError, InputError, printable
from flighttune.base.screen import LOCAL
from flighttune.outputs.drawing.templates import page_template
from flighttune.outputs.live.connections import Connection
from flighttune.outputs.live.desk import Asked, Desk, in_thread
from flighttune.outputs.pages.frame import look_and_script

# Host names of this machine, also through a tunnel.
HOSTS = [LOCAL, "localhost"]

# Largest request, bytes.
MAX_BYTES = 65_536

# Periods at which a window gets news of a search and the command looks for the last window; time
# that a window may take to reload before it counts as closed; time limits of the server's end, s.
TELL_S, LOOK_S, CLOSED_S, END_S, JOIN_S = 0.2, 0.2, 3.0, 1, 10.0

# Time in which the windows show the error that then ends the command, s.
SHOWN_S = 2.0

# The page itself adds to this policy its one script, and that it connects to this server alone.
HEADERS = [
    ("Cache-Control", "no-store"),
    ("Content-Security-Policy", "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Referrer-Policy", "no-referrer"),  # the address holds the token
    ("X-Content-Type-Options", "nosniff"),
]


class Opened(AbstractContextManager["Opened"]):
    """A page that is served until it is closed.

    Attributes
    ----------
    url : str
        Address on this machine, with the token that gives access.
    port : int
        Port of the server, for a tunnel.

    Examples
    --------
    >>> with ft.open("level_turn", browser=False) as page:
    ...     page.url.startswith("http://127.0.0.1:")
    True
    """

    def __init__(self, desk: Desk, port: int) -> None:
        self._desk, self._token = desk, secrets.token_urlsafe(24)
        self._windows, self._left = 0, 0.0
        verbs: list[Callable[[Asked], Any]] = [desk.picture, desk.begin, desk.stop, desk.save]
        self._verbs = {verb.__name__: verb for verb in verbs}
        try:
            self._socket = socket.create_server((LOCAL, port))
        except (OSError, OverflowError) as error:
            raise InputError(f"`port` must be free, got {error.args[-1]} at {port}.") from error
        self.port = int(self._socket.getsockname()[1])
        self.url = f"http://{LOCAL}:{self.port}/{self._token}/"
        application = Starlette(
            routes=[Route("/{token}/{name:path}", self._answer, methods=["GET", "POST"])],
            middleware=[Middleware(TrustedHostMiddleware, HOSTS, www_redirect=False)],
        )
        config = uvicorn.Config(
            application,
            headers=HEADERS,
            log_config=None,
            lifespan="off",
            http=Connection,
            timeout_graceful_shutdown=END_S,
        )
        self._server = uvicorn.Server(config)
        self._thread = in_thread(lambda: self._server.run(sockets=[self._socket]))

    def wait(self, *, until_closed: bool = False) -> None:
        """Wait for ever, or until the last window of the page is closed.

        DifferenceError if a compiled flight of the page is not that of JSBSim; the page shows it.
        """
        while not (until_closed and self._all_closed):
            time.sleep(LOOK_S)
            if self._desk.differs is not None:
                time.sleep(SHOWN_S)
                raise self._desk.differs

    @property
    def _all_closed(self) -> bool:
        """Whether all windows that were open have been closed."""
        return bool(self._left) and not self._windows and time.monotonic() > self._left + CLOSED_S

    def close(self) -> None:
        """End the server and a running search."""
        self._desk.close()
        self._server.should_exit = True
        self._thread.join(JOIN_S)
        self._socket.close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"a page at {self.url}; .close() ends it"

    def _repr_html_(self) -> str:
        return f'<a href="{self.url}" target="_blank">{self.url}</a>'

    async def _answer(self, request: Request) -> Response:
        """An answer given only with the token, and where it writes or flies only to our page."""
        told, get = request.headers, request.method == "GET"
        token, name = request.path_params["token"], request.path_params["name"]
        ours = f"http://{told.get('host')}"
        allowed = secrets.compare_digest(token.encode(), self._token.encode())
        allowed &= told.get("origin", ours if get else "") == ours
        allowed &= told.get("sec-fetch-site", "none") in ("none", "same-origin")
        if allowed and not self._stays(request):
            raise HTTPException(503)
        if allowed and get and not name:
            return HTMLResponse(self._page())
        if allowed and get and name == "events":
            return StreamingResponse(self._told(), media_type="text/event-stream")
        if allowed and not get and name in self._verbs:
            return await _done(request, self._verbs[name])
        raise HTTPException(404)

    def _stays(self, request: Request) -> bool:
        """Whether the connection of a request with the token may stay."""
        for connection in self._server.server_state.connections:
            if isinstance(connection, Connection) and connection.client == request.client:
                return connection.allow()
        return True  # it has just been closed

    def _page(self) -> str:
        """The page without flights, which its script asks for once it has loaded."""
        desk, own = self._desk, Path(__file__).with_name("live.js")
        page = page_template("flighttune.outputs.live", "live.html.jinja").render(
            title=desk.scenario.title,
            about=(),
            claim="",
            summary=(),
            desk=desk,
            groups=[(name, [*group]) for name, group in groupby(desk.sliders, lambda x: x.group)],
            **look_and_script(own, own.with_suffix(".css")),
        )
        return printable(page)

    async def _told(self) -> AsyncIterator[str]:
        """Events of a search for one window, as long as it is open."""
        self._windows += 1
        told = self._desk.search.state
        try:
            while not self._server.should_exit:
                state = self._desk.search.state
                # a comment, which a window ignores, fails once it is closed
                yield ":\n\n" if state is told else f"data: {printable(json.dumps(state))}\n\n"
                told = state
                await asyncio.sleep(TELL_S)
        finally:
            self._windows -= 1
            self._left = time.monotonic()


async def _done(request: Request, verb: Callable[[Asked], Any]) -> Response:
    """What a verb returns for a request, or its error in a line."""
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > MAX_BYTES:
            return JSONResponse({"failed": f"must have at most {MAX_BYTES} bytes"}, 413)
    try:
        asked = Asked.model_validate_json(bytes(body))
        return JSONResponse(await run_in_threadpool(verb, asked))
    except ValidationError:
        return JSONResponse({"failed": "must be what the page sends"}, 400)
    except FlightTuneError as error:
        return JSONResponse({"failed": printable(str(error))})
