"""Each renderer of a page: what a medium cannot show as it is does no harm, and nothing is lost."""

from __future__ import annotations

import io
from html.parser import HTMLParser

from yawid.answers.reasons import Reason, Verdict
from yawid.sinks.door import WIDTH
from yawid.sinks.pages import (
    Grid,
    Note,
    Part,
    Said,
    to_html,
    to_terminal,
    verdict_parts,
)
from yawid.sinks.words import Row

HOSTILE = "a|b <script>\x1b[31m"
REASONS = [Reason("not_converged", HOSTILE, weight="fatal"), Reason("repeated", "twice")]
PAGE: list[Part] = [
    *verdict_parts(Verdict.of(REASONS)),
    Row("flight", f"wn 1.0 {'and so on ' * 20}"),
    Row("", "of noise alone", "dim"),
    Said("", "an advice"),
    Grid(("n", "mode"), [("1", HOSTILE), ("2", "FBWA")], ["dim", ""], texts=(1,)),
    Note("yawid replay " + "x" * 90, wraps=False),
]


def test_in_a_terminal_lines_are_80_wide_but_for_what_is_copied_and_no_text_is_a_command():
    out = io.StringIO()
    to_terminal(PAGE, out)
    *lines, command = out.getvalue().splitlines()

    assert lines[0] == "verdict  NOT USABLE"
    assert lines[1] == "  not_converged: a|b <script>\\x1b[31m"
    assert lines[2] == "  warning repeated: twice"
    assert lines[3].startswith("  flight  wn 1.0 and")
    assert lines[4].startswith(" " * 10 + "so on")
    assert max(map(len, lines)) <= WIDTH < len(command) == 103
    assert "\x1b" not in out.getvalue()


class Tags(HTMLParser):
    """The tags of a page and its texts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.texts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.add(tag)

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_in_html_texts_are_texts_and_none_is_lost():
    found = Tags(to_html(PAGE))

    assert found.tags == {"p", "b", "small", "table", "tr", "th", "td"}
    assert "NOT USABLE" in found.texts[1]
    assert (
        found.texts.count(HOSTILE.replace("\x1b", "\\x1b")) == 1
    )  # the cell; the reason has a space before
    assert found.texts[-1].endswith("x" * 90)
