"""The pages of ``yawid serve``: the list, an upload, a flight's report, card, summary and exports.

Whoever can make the browser of this machine send a request must reach nothing by it: the host of a
request is this machine by name or number (no DNS name that was pointed here), its origin is this
server or not given (no other page), and a page runs only this server's own script. A name in an
address only looks up a row of the list; the name of an upload is made safe before it is one.
"""

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Final
from urllib.parse import parse_qs, quote

from jinja2 import Environment, PackageLoader
from markupsafe import Markup
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    JSONResponse,
    PlainTextResponse,
    RedirectResponse,
    Response,
)
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from yawid.errors import SinkError, YawidError
from yawid.report.html import STYLE
from yawid.serve.flights import Flights, Row
from yawid.serve.tasks import CARD, EXPORTS, MADE, MODELS, REPORT, RUN, SUMMARY
from yawid.sinks.door import plain, say, show_traceback
from yawid.sources.formats import WITH_RECORDS
from yawid.system.part_file import sync

MOST_BYTES: Final = 2 * 1024**3
"""The largest log that is taken."""
MOST_S: Final = 600.0
"""The longest time of an upload in s."""
MOST_SILENT_S: Final = 10.0
"""The longest time in s without data: whoever sends nothing would keep others out."""
MOST_AT_ONCE: Final = 8
"""Uploads at the same time."""
MOST_TYPED: Final = 4096
"""Bytes of a line of options."""
LOOK_S: Final = 1.0
"""The time in s after which the folder is looked at again."""
_HOST: Final = re.compile(r"(127\.0\.0\.1|localhost)(:\d{1,5})?")
_ENDS: Final = "frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
_OWN: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'; "
    + _ENDS
)
_SAFE: Final = {
    "content-security-policy": _OWN,
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}
_CLOSE: Final = {"connection": "close"}
"""A header of an answer that comes before the end of its request's body."""


def _shown(text: Any) -> Any:
    return text if isinstance(text, Markup) else plain(str(text))


_ENVIRONMENT: Final = Environment(
    loader=PackageLoader("yawid", "serve"), autoescape=True, finalize=_shown,
    trim_blocks=True, lstrip_blocks=True,
)  # fmt: skip
_ENVIRONMENT.filters["address"] = lambda name: quote(name, safe="")
_TYPES: Final = {REPORT: "text/html", CARD: "text/plain", SUMMARY: "application/json"}


class Guard:
    """Refuses what comes from elsewhere, and adds the headers that keep a page to itself."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        given = dict(scope["headers"])
        host = given.get(b"host", b"").decode("latin-1")
        origin = given.get(b"origin", f"http://{host}".encode()).decode("latin-1")

        async def safely(message: Message) -> None:
            if message["type"] == "http.response.start":
                known = {name for name, _ in message["headers"]}
                message["headers"] = [*message["headers"], *(
                    (name.encode(), value.encode()) for name, value in _SAFE.items()
                    if name.encode() not in known
                )]  # fmt: skip
            await send(message)

        if _HOST.fullmatch(host) and origin == f"http://{host}":
            await self._app(scope, receive, safely)
        else:
            refused = PlainTextResponse("refused: the request is not from this page\n", 403, _CLOSE)
            await refused(scope, receive, safely)


class Pages:
    """The pages of these flights."""

    def __init__(self, flights: Flights) -> None:
        self._flights, self._uploads = flights, 0
        own = files("yawid.serve")
        style = STYLE + own.joinpath("serve.css").read_text(encoding="utf-8")
        script = own.joinpath("serve.js").read_text(encoding="utf-8")
        self.app = Guard(Starlette(
            routes=[
                Route("/", self._list),
                Route("/progress", self._progress),
                Route("/serve.css", lambda _: Response(style, media_type="text/css")),
                Route("/serve.js", lambda _: Response(script, media_type="text/javascript")),
                Route("/flights/{name}", self._file),
                Route("/flights/{name}", self._upload, methods=["PUT"]),
                Route("/flights/{name}", self._typed, methods=["POST"]),
                Route("/flights/{name}/{what}", self._file),
            ],
            exception_handlers={
                HTTPException: _said, YawidError: _said, OSError: _said, Exception: _said,
            },
            lifespan=self._lifespan,
        ))  # fmt: skip

    @asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        watch = asyncio.create_task(self._watch())
        yield
        watch.cancel()

    async def _watch(self) -> None:
        """Look at the folder again and again."""
        while True:
            with suppress(OSError):  # it may be away for a while
                self._flights.look()
            await asyncio.sleep(LOOK_S)

    async def _list(self, _: Request) -> Response:
        self._flights.look()
        text = _ENVIRONMENT.get_template("list.html").render(
            flights=self._flights, states=self._flights.states(), suffixes=WITH_RECORDS,
        )  # fmt: skip
        return Response(text, media_type="text/html")

    async def _progress(self, _: Request) -> Response:
        self._flights.look()
        return JSONResponse({"version": self._flights.version, "logs": self._flights.states()})

    async def _file(self, request: Request) -> Response:
        """Return a file of a flight, which is made where that has not been done."""
        row, what = self._row(request), request.path_params.get("what", REPORT)
        if not row.outcome:
            state = self._flights.states().get(row.name, "waits")
            return PlainTextResponse(f"{row.name} {state}\n", 202, {"refresh": "1"})
        if what == "files":
            names = (SUMMARY, RUN, *EXPORTS, *MODELS)
            text = _ENVIRONMENT.get_template("files.html").render(row=row, names=names)
            return Response(text, media_type="text/html")
        if what in MADE:
            future = self._flights.make(row.name, what)
            made = (await asyncio.shield(asyncio.wrap_future(future)))["logs"][0]
            if made["outcome"] != "ok":
                raise HTTPException(404, f"{row.name}: {made['text'] if row.wn else row.text}")
        path = self._flights.out / f"{row.name}.{what}"
        if what not in (SUMMARY, RUN, *MADE) or not path.is_file():
            raise HTTPException(404, f"{row.name}: there is no {what} of it")
        return FileResponse(
            path, media_type=_TYPES.get(what, "application/octet-stream"),
            filename=f"{Path(row.name).stem}.{what}",
            content_disposition_type="inline" if what in _TYPES else "attachment",
            # A report has a policy of its own, as it may be opened without a server.
            headers={"content-security-policy": _ENDS} if what == REPORT else None,
        )  # fmt: skip

    def _row(self, request: Request) -> Row:
        row = self._flights.rows.get(request.path_params["name"])
        if row is None:
            raise HTTPException(404, "there is no such flight")
        return row

    async def _typed(self, request: Request) -> Response:
        """Read a log again with the options that were typed."""
        row, body = self._row(request), BytesIO()
        await _received(request, body, MOST_TYPED)
        line = parse_qs(body.getvalue().decode("utf-8", "replace")).get("options", [""])[0]
        self._flights.add(row.name, line)
        return RedirectResponse("/", 303)

    async def _upload(self, request: Request) -> Response:
        """Write a log into the folder, whole or not at all, and have it read."""
        if int(request.headers.get("content-length", 0)) > MOST_BYTES:
            raise HTTPException(413, f"a log may have {MOST_BYTES / 1e9:.1f} GB", _CLOSE)
        if self._uploads >= MOST_AT_ONCE or self._flights.is_full:
            raise HTTPException(503, "too many logs at once", _CLOSE | {"retry-after": "2"})
        path, part = self._flights.free(request.path_params["name"])
        self._uploads += 1
        try:
            async with asyncio.timeout(MOST_S):
                await _received(request, part.stream, MOST_BYTES)
            await run_in_threadpool(sync, part.stream)
            part.take_name(path)
        finally:
            self._uploads -= 1
            part.remove()
        self._flights.add(path.name)
        return JSONResponse({"name": path.name}, 201)


async def _received(request: Request, into: BinaryIO, most: int) -> None:
    """Write the body of a request into a stream.

    Raises:
        HTTPException: it has more than ``most`` bytes, or was cut off.
        TimeoutError: nothing came for too long.
    """
    size, more = 0, True
    while more:
        async with asyncio.timeout(MOST_SILENT_S):
            message = await request.receive()
        if message["type"] == "http.disconnect":
            raise HTTPException(400, "the request was cut off", _CLOSE)
        body, more = message.get("body", b""), message.get("more_body", False)
        size += len(body)
        if size > most:
            raise HTTPException(413, f"at most {most} bytes are taken", _CLOSE)
        await run_in_threadpool(into.write, body)


async def _said(_: Request, error: Exception) -> Response:
    """Return an error as a line of text."""
    status, headers, text = 400, _CLOSE, str(error)
    if isinstance(error, HTTPException):
        status, headers, text = error.status_code, dict(error.headers or {}), error.detail
    elif isinstance(error, TimeoutError):
        status, text = 408, "the request was too slow"
    elif isinstance(error, SinkError | OSError):  # the folder is away, or its disk is full
        status, text = 507, re.sub(r"^\[Errno \d+\] ", "", text)
    elif not isinstance(error, YawidError):
        status = 500
        say(f"unforeseen, a fault of yawid: {type(error).__name__}: {error}: please report it")
        show_traceback(error)
    return PlainTextResponse(f"{plain(text)}\n", status, headers)
