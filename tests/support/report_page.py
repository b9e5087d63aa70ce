"""Reads the page of a report: its text, its tags, and the addresses in it."""

from __future__ import annotations

from html.parser import HTMLParser

ADDRESSES = {"src", "href", "xlink:href", "action", "data"}


class Page(HTMLParser):
    """The text of a page, its tags, attributes and ids, and the addresses in it."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.attributes: list[str] = []
        self.addresses: list[str] = []
        self.texts: list[str] = []
        self.feed(html)
        self.text = " ".join(" ".join(self.texts).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [name for name, _ in attrs]
        given = [(name, value) for name, value in attrs if value is not None]
        self.ids += [value for name, value in given if name == "id"]
        self.addresses += [value for name, value in given if name in ADDRESSES]

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def first_screen(html: str) -> str:
    return Page(html[html.index("<header") : html.index("</header>")]).text
