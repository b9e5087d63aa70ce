"""Headless Chromium over its debugging pipe: opens a page, notes its requests, takes pictures.

It needs no driver package: the protocol is JSON over two pipes (--remote-debugging-pipe) with a
zero byte after each message; https://chromedevtools.github.io/devtools-protocol/ describes it.
"""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from checks.children import LIMIT_S, child

# The browser reads descriptor 3 and writes to 4.
CONNECTED = 'exec "$0" "$@" 3<&0 4>&1 >/dev/null'
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
LOADED = """new Promise(done => document.readyState == "complete" ? done()
                        : addEventListener("load", () => done()))"""
COMPLAINTS = ("Log.entryAdded", "Runtime.exceptionThrown", "Runtime.consoleAPICalled")


def find_chromium() -> str | None:
    """Return the path of an installed Chromium or Chrome, or None."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    return next((path for name in names if (path := shutil.which(name))), None)


class Browser:
    """A browser with one page.

    ``requests`` are the URLs that the page has loaded so far, ``complaints`` its log entries,
    exceptions and console output, as JSON.

    Raises:
        RuntimeError: no browser is installed, or it does not answer.
    """

    def __enter__(self) -> Browser:
        self.requests, self.complaints = list[str](), list[str]()
        chromium = find_chromium()
        if chromium is None:
            raise RuntimeError("no chromium is installed")
        self._ended, self._count, self._session = ExitStack(), 0, dict[str, str]()
        profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        own = f"--user-data-dir={self._ended.enter_context(profile)}", "about:blank"
        running = child(
            ["/bin/bash", "-c", CONNECTED, chromium, *OPTIONS, *own], 10 * LIMIT_S,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0,
        )  # fmt: skip
        self._process: Any = self._ended.enter_context(running)
        self._messages = self._read()
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": attached["sessionId"]}
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.close()

    def _read(self) -> Iterator[dict[str, Any]]:
        """Yield the browser's messages until it ends."""
        kept = b""
        while data := os.read(self._process.stdout.fileno(), 1 << 20):
            *lines, kept = (kept + data).split(b"\0")
            yield from map(json.loads, lines)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send one command and return its result; note the events that come before it.

        Raises:
            RuntimeError: the browser does not answer, or reports an error.
        """
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters} | self._session
        self._process.stdin.write(json.dumps(message).encode() + b"\0")
        for reply in self._messages:
            if reply.get("id") == self._count and "result" in reply:
                return dict(reply["result"])
            if "error" in reply:
                break
            if reply.get("method") == "Network.requestWillBeSent":
                self.requests.append(reply["params"]["request"]["url"])
            if reply.get("method") in COMPLAINTS:
                self.complaints.append(json.dumps(reply["params"]))
        raise RuntimeError(f"the browser did not do {message}")

    def open(self, url: str, width: int = 1280, height: int = 800, *, phone: bool = False) -> None:
        """Open a page in a window of this size in CSS pixels, and wait until it has loaded."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": phone}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        self.call("Page.navigate", url=url)
        self.evaluate(LOADED)

    def listen(self, seconds: float) -> None:
        """Note the page's events for so many seconds."""
        self.evaluate(f"new Promise(done => setTimeout(done, {1e3 * seconds}))")

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page, of a promise when it has one.

        Raises:
            RuntimeError: the expression raises an exception.
        """
        asked = {"expression": expression, "returnByValue": True, "awaitPromise": True}
        found = self.call("Runtime.evaluate", **asked)
        if "exceptionDetails" in found:
            raise RuntimeError(f"{expression}: {found['exceptionDetails']['text']}")
        return found["result"].get("value")

    def screenshot(self, path: Path) -> None:
        """Save a picture of the whole page as a PNG."""
        clip = self.call("Page.getLayoutMetrics")["cssContentSize"] | {"scale": 1}
        taken = self.call("Page.captureScreenshot", captureBeyondViewport=True, clip=clip)
        path.write_bytes(base64.b64decode(taken["data"]))

    def pdf(self, path: Path) -> None:
        """Print the page to A4."""
        paper = {"preferCSSPageSize": True, "paperWidth": 8.27, "paperHeight": 11.69}
        path.write_bytes(base64.b64decode(self.call("Page.printToPDF", **paper)["data"]))
