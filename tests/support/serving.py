"""Serves a folder on a free port: in a thread of this process, or as a user does by the command."""

from __future__ import annotations

import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import NamedTuple

import httpx
from checks.children import flights_page

from yawid.fleet.spec import Spec
from yawid.serve import server
from yawid.serve.flights import Flights

LIMIT_S = 240.0
"""How long an answer may take, on a machine that does other things as well."""


class Served(NamedTuple):
    """A server that runs: its port, and a client that asks it as a browser's page would."""

    port: int
    client: httpx.Client

    def put(self, name: str, data: bytes) -> str:
        """Drop a log; return the name that it has got."""
        answer = self.client.put(f"/flights/{name}", content=data)
        assert answer.status_code == 201, answer.text
        return str(answer.json()["name"])

    def read(self) -> None:
        """Wait until every log is read."""
        end_s = time.monotonic() + LIMIT_S
        while self.client.get("/progress").json()["logs"]:
            assert time.monotonic() < end_s
            time.sleep(0.05)

    def answer(self, raw: bytes, within_s: float = 5.0) -> bytes:
        """Send bytes as they are; return what is answered until the server closes or is silent."""
        found = b""
        with closing(socket.create_connection((server.HERE, self.port), timeout=within_s)) as own:
            try:
                own.sendall(raw)
                while piece := own.recv(65536):
                    found += piece
                    if b"\r\n\r\n" in found:
                        own.settimeout(0.2)
            except OSError:
                pass  # it was cut off, or nothing more comes
        return found


@contextmanager
def served(folder: Path) -> Iterator[Served]:
    """Serve a folder in a thread of this process."""
    with closing(server.opened(0)) as listening, ExitStack() as stack:
        of_folder = server.server_of(Flights(folder, Spec(), stack))
        thread = threading.Thread(
            target=of_folder.run, kwargs={"sockets": [listening]}, daemon=True
        )
        thread.start()
        port = listening.getsockname()[1]
        try:
            with httpx.Client(base_url=f"http://{server.HERE}:{port}", timeout=LIMIT_S) as client:
                yield Served(port, client)
        finally:
            of_folder.should_exit = True
            thread.join(LIMIT_S)
            assert not thread.is_alive()


@contextmanager
def commanded(folder: Path) -> Iterator[tuple[Served, subprocess.Popen[str]]]:
    """Serve a folder by the command; yield its process, too."""
    with (
        flights_page(folder) as (address, process),
        httpx.Client(base_url=address, timeout=LIMIT_S) as client,
    ):
        yield Served(int(address.strip("/").rpartition(":")[2]), client), process
