"""A headless Chromium of this machine for pages as users see them, driven by playwright."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, ConsoleMessage, Page, sync_playwright

OPTIONS = ("--no-sandbox", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader")
"""Without a sandbox, as root in a container has none, and drawn by the processor."""


def find_chromium() -> str | None:
    """Return the path of an installed Chromium or Chrome, or None."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    return next((path for name in names if (path := shutil.which(name))), None)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start the browser that is installed, and end it with the block."""
    with sync_playwright() as player:
        browser = player.chromium.launch(executable_path=find_chromium(), args=[*OPTIONS])
        with browser:
            yield browser


def opened(
    browser: Browser,
    url: str,
    width: int = 1280,
    height: int = 800,
    *,
    phone: bool = False,
    dark: bool = False,
    script: bool = True,
) -> tuple[Page, list[str], list[str]]:
    """Open a page in a window of this size in CSS pixels, and wait until it has loaded.

    The lists are the URLs that it asks for, and its exceptions and console output.
    """
    page = browser.new_page(
        viewport={"width": width, "height": height},
        is_mobile=phone,
        has_touch=phone,
        color_scheme="dark" if dark else "light",
        java_script_enabled=script,
    )
    requests, complaints = list[str](), list[str]()
    page.on("request", lambda request: requests.append(request.url))
    page.on("pageerror", lambda error: complaints.append(error.message))

    def said(message: ConsoleMessage) -> None:
        complaints.append(message.text)

    page.on("console", said)
    page.goto(url)
    return page, requests, complaints
