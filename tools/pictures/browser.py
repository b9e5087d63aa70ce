"""Headless Chromium over its debugging pipe: opens a page, notes its requests, takes pictures.

It needs no driver package: the protocol is JSON over two pipes (--remote-debugging-pipe) with a
zero byte after each message; https://chromedevtools.github.io/devtools-protocol/ describes it.
"""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from checks.children import LEAVE_S, LONG_S, child

OPTIONS = (
    "--headless=new",
    "--no-sandbox",  # needed as root in a container
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--no-first-run",
    "--hide-scrollbars",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-pipe",
)
TIMEOUT_S = 60.0


def find_chromium() -> str | None:
    """Return the path of an installed Chromium or Chrome, or None."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    return next((path for name in names if (path := shutil.which(name))), None)


@dataclass
class Browser:
    """A browser with one page.

    ``requests`` are the URLs that the page has loaded so far, ``complaints`` its log entries,
    exceptions and console output.

    Raises:
        RuntimeError: no browser is installed, or it does not answer.
    """

    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    def __enter__(self) -> Browser:
        chromium = find_chromium()
        if chromium is None:
            raise RuntimeError("no chromium is installed")
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        # The browser reads descriptor 3 and writes to 4; a shell connects them to the pipes.
        shell = f'exec "$0" "$@" 3<&{theirs_in} 4>&{theirs_out}'
        options = (*OPTIONS, f"--user-data-dir={self._profile.name}", "about:blank")
        quiet = subprocess.DEVNULL
        running = child(
            ["/bin/bash", "-c", shell, chromium, *options], LONG_S,
            pass_fds=(theirs_in, theirs_out), stdout=quiet, stderr=quiet,
        )  # fmt: skip
        self._ended = ExitStack()
        self._process = self._ended.enter_context(running)
        os.close(theirs_in)
        os.close(theirs_out)
        self._buffer = b""
        self._count = 0
        self._events: list[str] = []
        self._session = ""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._out)
        with suppress(subprocess.TimeoutExpired):  # it ends when its input closes
            self._process.wait(LEAVE_S)
        self._ended.close()
        os.close(self._in)
        self._profile.cleanup()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send one command and return its result; note the events that come before it.

        Raises:
            RuntimeError: the browser does not answer, or reports an error.
        """
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            reply = self._read(TIMEOUT_S)
            if reply is None:
                raise RuntimeError(f"the browser did not answer {method}")
            if reply.get("id") == self._count:
                if "error" in reply:
                    raise RuntimeError(f"{method}: {reply['error']['message']}")
                result: dict[str, Any] = reply["result"]
                return result

    def open(self, url: str, width: int = 1280, height: int = 800, *, phone: bool = False) -> None:
        """Open a page in a window of this size in CSS pixels, and wait until it has loaded."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=phone,
        )
        self._events.clear()
        self.call("Page.navigate", url=url)
        self.wait("Page.loadEventFired")

    def wait(self, event: str) -> None:
        """Wait for an event of this name.

        Raises:
            RuntimeError: it does not come in time.
        """
        while event not in self._events:
            if self._read(TIMEOUT_S) is None:
                raise RuntimeError(f"the browser did not say {event}")

    def listen(self, seconds: float) -> None:
        """Note the page's events for so many seconds."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._read(left)

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page.

        Raises:
            RuntimeError: the expression raises an exception.
        """
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        if "exceptionDetails" in found:
            raise RuntimeError(f"{expression}: {found['exceptionDetails']['text']}")
        return found["result"].get("value")

    def screenshot(self, path: Path, *, whole: bool = False) -> None:
        """Save a picture of the window, or of the whole page, as a PNG."""
        taken = self.call(
            "Page.captureScreenshot", captureBeyondViewport=whole, **_clip(self, whole)
        )
        path.write_bytes(base64.b64decode(taken["data"]))

    def pdf(self, path: Path) -> int:
        """Print the page to A4; return the number of sheets."""
        printed = self.call(
            "Page.printToPDF", preferCSSPageSize=True, paperWidth=8.27, paperHeight=11.69
        )
        data = base64.b64decode(printed["data"])
        path.write_bytes(data)
        return data.count(b"/Type /Page\n") or data.count(b"/Type /Page")

    def _read(self, timeout_s: float) -> dict[str, Any] | None:
        """Return the next message, or None after ``timeout_s`` or when the browser has ended."""
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._in], [], [], timeout_s)
            data = os.read(self._in, 1 << 16) if ready else b""
            if not data:
                return None
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        self._note(message)
        return message

    def _note(self, message: dict[str, Any]) -> None:
        method, parameters = message.get("method", ""), message.get("params", {})
        self._events.append(method)
        if method == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])
        elif method == "Log.entryAdded":
            self.complaints.append(parameters["entry"]["text"])
        elif method == "Runtime.exceptionThrown":
            self.complaints.append(parameters["exceptionDetails"]["text"])
        elif method == "Runtime.consoleAPICalled":
            self.complaints.append(str([a.get("value") for a in parameters["args"]]))


def _clip(browser: Browser, whole: bool) -> dict[str, Any]:
    if not whole:
        return {}
    size = browser.call("Page.getLayoutMetrics")["cssContentSize"]
    return {"clip": size | {"x": 0, "y": 0, "scale": 1}}
