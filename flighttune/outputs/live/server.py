"""The server of the page: it answers this machine alone, and only requests with the token."""

import asyncio
import json
import secrets
import socket
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from itertools import groupby
from pathlib import Path
from typing import Any, TypeAlias

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import (
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route

from flighttune.base.errors import FlightTuneError, InputError, printable
from flighttune.base.files.whole import reason_of
from flighttune.base.screen import LOCAL
from flighttune.outputs.drawing.templates import page_template
from flighttune.outputs.live.desk import Desk
from flighttune.outputs.pages.frame import look_and_script

# Host names of this machine, also through a tunnel.
HOSTS = [LOCAL, "localhost"]

# Largest request, bytes.
MAX_BYTES = 65_536

# Periods at which a window gets news of a search, at which a closed window is noticed, and at which
# the command looks for the last one; time that a window may take to reload before it counts as
# closed; time limits to start and to end, s. Most windows.
TELL_S, BEAT_S, LOOK_S, CLOSED_S, START_S, END_S = 0.1, 1.0, 0.2, 3.0, 10.0, 1
MAX_WINDOWS = 50

# What anything but our page's JSON may raise where it is read.
ODD = ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError

# The page itself adds to this policy its one script, and that it connects to this server alone.
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "X-Content-Type-Options": "nosniff",
}

Endpoint: TypeAlias = Callable[[Request], Awaitable[Response]]


class Opened:
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
        try:
            self._socket = socket.create_server((LOCAL, port))
        except (OSError, OverflowError) as error:
            raise InputError(f"`port` must be free, got {error.args[-1]} at {port}.") from error
        self.port = int(self._socket.getsockname()[1])
        self.url = f"http://{LOCAL}:{self.port}/{self._token}/"
        config = uvicorn.Config(
            self._application(), log_config=None, lifespan="off", timeout_graceful_shutdown=END_S
        )
        self._server = uvicorn.Server(config)
        sockets = {"sockets": [self._socket]}
        self._thread = threading.Thread(target=self._server.run, kwargs=sockets, daemon=True)
        self._thread.start()
        end = time.monotonic() + START_S
        while not self._server.started and time.monotonic() < end:
            time.sleep(0.01)

    def wait(self, *, until_closed: bool = False) -> None:
        """Wait for ever, or until the last window of the page is closed."""
        while not (until_closed and self._all_closed):
            time.sleep(LOOK_S)

    @property
    def _all_closed(self) -> bool:
        """Whether all windows that were open have been closed."""
        return bool(self._left) and not self._windows and time.monotonic() > self._left + CLOSED_S

    def close(self) -> None:
        """End the server and a running search."""
        self._desk.close()
        self._server.should_exit = True
        self._thread.join(START_S)
        self._socket.close()

    def __enter__(self) -> "Opened":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"a page at {self.url}; .close() ends it"

    def _repr_html_(self) -> str:
        return f'<a href="{self.url}" target="_blank">{self.url}</a>'

    def _application(self) -> Starlette:
        answers: dict[str, Endpoint] = {"": self._page, "events": self._events}
        verbs = {name: getattr(self._desk, name) for name in ("picture", "begin", "stop", "save")}
        answers |= {name: _answered(verb) for name, verb in verbs.items()}
        routes = [
            Route(
                f"/{{token}}/{name}",
                self._guarded(answer),
                methods=["POST" if name in verbs else "GET"],
            )
            for name, answer in answers.items()
        ]
        hosts = Middleware(TrustedHostMiddleware, allowed_hosts=HOSTS, www_redirect=False)
        return Starlette(routes=routes, middleware=[hosts])

    def _guarded(self, answer: Endpoint) -> Endpoint:
        """An answer given only with the token, and where it writes or flies only to our page."""

        async def guarded(request: Request) -> Response:
            token, told = request.path_params["token"], request.headers
            allowed = secrets.compare_digest(token.encode(), self._token.encode())
            ours = f"http://{told.get('host')}"
            allowed &= told.get("origin", ours if request.method == "GET" else "") == ours
            allowed &= told.get("sec-fetch-site", "none") in ("none", "same-origin")
            response: Response = PlainTextResponse("there is no such page", 404)
            if allowed:
                response = await answer(request)
            response.headers.update(HEADERS)
            return response

        return guarded

    async def _page(self, _: Request) -> Response:
        """The page without flights, which its script asks for once it has loaded."""
        desk, own = self._desk, Path(__file__).with_name("live.js")
        page = page_template("flighttune.outputs.live", "live.html.jinja").render(
            title=desk.scenario.title,
            about=(),
            claim="",
            summary=(),
            desk=desk,
            groups=[(name, [*own]) for name, own in groupby(desk.sliders, lambda x: x.group)],
            **look_and_script(own, own.with_suffix(".css")),
        )
        return HTMLResponse(printable(page))

    async def _events(self, _: Request) -> Response:
        if self._windows >= MAX_WINDOWS:
            return PlainTextResponse("too many windows are open", 503)
        return StreamingResponse(self._told(), media_type="text/event-stream")

    async def _told(self) -> AsyncIterator[str]:
        """Events of a search for one window, as long as it is open."""
        self._windows += 1
        told, beat = self._desk.search.state, 0.0
        try:
            while not self._server.should_exit:
                if (state := self._desk.search.state) is not told:
                    told = state
                    yield f"data: {printable(json.dumps(state))}\n\n"
                elif time.monotonic() > beat + BEAT_S:
                    beat = time.monotonic()
                    yield ":\n\n"
                await asyncio.sleep(TELL_S)
        finally:
            self._windows -= 1
            self._left = time.monotonic()


def _answered(verb: Callable[[dict[str, Any]], Any]) -> Endpoint:
    """An endpoint that calls a verb with the JSON of a request; the answer may be its error."""

    async def answered(request: Request) -> Response:
        body = bytearray()
        async for part in request.stream():
            body += part
            if len(body) > MAX_BYTES:
                return JSONResponse({"failed": f"must have at most {MAX_BYTES} bytes"}, 413)
        try:
            return JSONResponse(await run_in_threadpool(verb, json.loads(body)))
        except FlightTuneError as error:
            return JSONResponse({"failed": printable(str(error))})
        except OSError as error:
            said = f"{error.filename}: {reason_of(error)}" if error.filename else str(error)
            return JSONResponse({"failed": printable(said)})
        except ODD:
            return JSONResponse({"failed": "must be what the page sends"}, 400)

    return answered
