"""Reads the page of a report: its text, its tags, the addresses in it, and what a browser runs."""

from __future__ import annotations

import json
import re
from base64 import b64encode
from hashlib import sha256
from html.parser import HTMLParser
from typing import Any

ADDRESSES = {"src", "href", "xlink:href", "action", "data"}


class Page(HTMLParser):
    """The text of a page, its tags, attributes and ids, its addresses, and its scripts.

    ``numbers`` are those from which each picture's charts are made, ``policy`` is the page's.
    """

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.attributes: list[str] = []
        self.addresses: list[str] = []
        self.texts: list[str] = []
        self.scripts: list[str] = []
        self.numbers: list[Any] = []
        self.policy = ""
        self._kind: str | None = None
        self.feed(html)
        self.text = " ".join(" ".join(self.texts).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [name for name, _ in attrs]
        given = [(name, value) for name, value in attrs if value is not None]
        self.ids += [value for name, value in given if name == "id"]
        self.addresses += [value for name, value in given if name in ADDRESSES]
        if ("http-equiv", "Content-Security-Policy") in given:
            self.policy = dict(given)["content"]
        self._kind = dict(given).get("type", "") if tag == "script" else None

    def handle_endtag(self, tag: str) -> None:
        self._kind = None

    def handle_data(self, data: str) -> None:
        if self._kind == "application/json":
            self.numbers.append(json.loads(data))
        elif self._kind is not None:
            self.scripts.append(data)
        else:
            self.texts.append(data)


def assert_runs_only_its_own(page: Page, own: tuple[str, ...]) -> None:
    """Assert that a page has these scripts or none, and that its policy allows them and no other.

    What a policy does not name its default decides.
    """
    rules = dict(rule.split(" ", 1) for rule in page.policy.split("; "))
    hashes = [b64encode(sha256(script.encode()).digest()).decode() for script in own]

    assert tuple(page.scripts) in {own, ()}
    assert rules["default-src"] == "'none'"
    assert rules["script-src"].split() == [f"'sha256-{each}'" for each in hashes]
    assert set(rules) == {"default-src", "script-src", "style-src", "img-src"}
    assert [name for name in page.attributes if re.match("on", name)] == []


def first_screen(html: str) -> str:
    return Page(html[html.index("<header") : html.index("</header>")]).text
