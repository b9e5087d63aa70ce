"""The server of ``yawid serve``: one address of this machine, which no other machine reaches."""

import socket
from typing import Any, Final

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from yawid.errors import SinkError
from yawid.serve.app import Pages
from yawid.serve.flights import Flights
from yawid.system.processes import HERE

MOST_CONNECTIONS: Final = 64
"""Connections at once; a browser has six. Each may hold 64 kB of a request."""
MOST_SILENT_S: Final = 10.0
"""The longest time in s of a request's first lines, and of an idle connection."""
END_S: Final = 2
"""The longest time in s in which requests are ended after Ctrl-C."""


class Impatient(H11Protocol):
    """A connection that is closed where no request comes: uvicorn would wait for ever."""

    def connection_made(self, transport: Any) -> None:
        """Begin to wait for a request."""
        super().connection_made(transport)
        self.loop.call_later(MOST_SILENT_S, self._look, None)

    def _look(self, before: Any) -> None:
        """Close the connection if all that it asked for was answered before the last look."""
        if self.cycle is before and (before is None or before.response_complete):
            self.transport.abort()
        elif not self.transport.is_closing():
            self.loop.call_later(MOST_SILENT_S, self._look, self.cycle)


def opened(port: int) -> socket.socket:
    """Return a socket that listens at this port, or at a free one for 0.

    Raises:
        SinkError: another program has the port.
    """
    try:
        return socket.create_server((HERE, port), backlog=256)
    except OSError as error:
        why = str(error.strerror).partition(" (")[0]  # Python adds the address
        raise SinkError(f"cannot serve at {HERE}:{port}: {why}: choose another --port") from error


def server_of(flights: Flights) -> uvicorn.Server:
    """Return the server of these flights; a signal ends it, and is raised again."""
    config = uvicorn.Config(
        Pages(flights).app, http=Impatient, ws="none", loop="asyncio", lifespan="on",
        log_config=None,
        log_level="critical",  # a fault has its line by app.py, and a client may leave
        access_log=False, server_header=False, proxy_headers=False,
        limit_concurrency=MOST_CONNECTIONS, timeout_graceful_shutdown=END_S,
    )  # fmt: skip
    return uvicorn.Server(config)
