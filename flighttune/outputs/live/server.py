"""The server of the page: it answers this machine alone, and only requests with the token."""

import asyncio
import json
import secrets
import socket
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import asdict
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
from flighttune.outputs.live.desk import MAX_WINDOWS, Desk
from flighttune.outputs.pages.frame import look_and_script

# Host names of this machine, also through a tunnel.
HOSTS = [LOCAL, "localhost"]

# Largest request, bytes.
MAX_BYTES = 65_536

# Periods at which a window gets news of a search, and at which a closed window is noticed; time
# that a window may take to reload before it counts as closed; time limits to start and to end, s.
TELL_S, BEAT_S, CLOSED_S, START_S, END_S = 0.1, 1.0, 3.0, 10.0, 1

# The page itself adds to this policy its one script, and that it connects to this server alone.
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "X-Content-Type-Options": "nosniff",
}

Endpoint: TypeAlias = Callable[[Request], Awaitable[Response]]


class Server:
    """Serves the page of a desk in a thread of its own until it is closed."""

    def __init__(self, desk: Desk, port: int) -> None:
        self.desk, self.token = desk, secrets.token_urlsafe(24)
        self._windows, self._left = 0, 0.0
        self._socket = _listening(port)
        self.port = int(self._socket.getsockname()[1])
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

    @property
    def url(self) -> str:
        """Address of the page, with the token that gives access."""
        return f"http://{LOCAL}:{self.port}/{self.token}/"

    @property
    def left(self) -> bool:
        """Whether all windows that were open have been closed."""
        return bool(self._left) and not self._windows and time.monotonic() > self._left + CLOSED_S

    def close(self) -> None:
        """Stop a running search, and end."""
        self.desk.close()
        self._server.should_exit = True
        self._thread.join(START_S)
        self._socket.close()

    def _application(self) -> Starlette:
        answers: dict[str, Endpoint] = {"": self._page, "events": self._events}
        verbs = {name: getattr(self.desk, name) for name in ("picture", "begin", "stop", "save")}
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
            allowed = secrets.compare_digest(token.encode(), self.token.encode())
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
        return HTMLResponse(_page_of(self.desk))

    async def _events(self, _: Request) -> Response:
        if self._windows >= MAX_WINDOWS:
            return PlainTextResponse("too many windows are open", 503)
        return StreamingResponse(self._told(), media_type="text/event-stream")

    async def _told(self) -> AsyncIterator[str]:
        """Events of a search for one window, as long as it is open."""
        self._windows += 1
        told, beat = self.desk.search.state, 0.0
        try:
            while not self._server.should_exit:
                if (state := self.desk.search.state) is not told:
                    told = state
                    yield f"data: {printable(json.dumps(asdict(state)))}\n\n"
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
        except (
            ArithmeticError,
            AttributeError,
            LookupError,
            RecursionError,
            TypeError,
            ValueError,
        ):
            return JSONResponse({"failed": "must be what the page sends"}, 400)

    return answered


def _listening(port: int) -> socket.socket:
    """A socket that listens to this machine alone; an InputError if the port is taken."""
    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((LOCAL, port))
    except (OSError, OverflowError) as error:
        listening.close()
        raise InputError(f"`port` must be free, got {error.args[-1]} at {port}.") from error
    return listening


def _page_of(desk: Desk) -> str:
    """The page without flights, which its script asks for once it has loaded."""
    own = Path(__file__).with_name("live.js")
    page = page_template("flighttune.outputs.live", "live.html.jinja").render(
        title=desk.scenario.title,
        about=(),
        claim="",
        summary=(),
        desk=desk,
        groups=[(name, [*own]) for name, own in groupby(desk.sliders, lambda x: x.group)],
        **look_and_script(own, own.with_suffix(".css")),
    )
    return printable(page)
