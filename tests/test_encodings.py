"""Every text file is opened with its encoding, as a Windows console's cp1252 has no ζ.

Ruff's PLW1514 sees this only where it can infer that an object is a path.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest
from places import ROOT

MODE = {"open": 0, "fdopen": 1, "read_text": -1, "write_text": -1}
"""The position of the mode among the arguments of a method; -1: it always opens a text."""
MAYBE = re.compile(r"(?:open|read_text|write_text)\((?!.*\bencoding=)")
"""A line that may open a text without its encoding: only the files that have one are parsed."""


BINARY = {"StoredPath(path).open()", "StoredPath(log.path).open()", "self.open()"}
"""Calls of a store's own method, which opens bytes."""


def without_encoding(source: str) -> Iterator[str]:
    """Name every call of a method that opens a text and leaves its encoding to the system."""
    for call in ast.walk(ast.parse(source)) if MAYBE.search(source) else ():
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute)):
            continue
        place = MODE.get(call.func.attr)
        if place is None or {"encoding", "fileobj", None} & {each.arg for each in call.keywords}:
            continue
        modes = [each.value for each in call.keywords if each.arg == "mode"] + call.args[place:]
        mode = getattr(modes[0], "value", None) if modes and place >= 0 else "r"
        if isinstance(mode, str) and set(mode) <= set("rwxa+t"):
            yield ast.unparse(call)


@pytest.mark.parametrize("folder", ["src", "tests", "tools"])
def test_every_text_is_opened_with_its_encoding(folder: str) -> None:
    found = {
        (path.relative_to(ROOT).as_posix(), call)
        for path in (ROOT / folder).rglob("*.py")
        for call in without_encoding(path.read_text(encoding="utf-8"))
        if call not in BINARY
    }
    assert found == set()


@pytest.mark.parametrize(
    "line",
    [
        "page.read_text()",
        "page.write_text(text)",
        "page.open('a')",
        "page.open()",
        "os.fdopen(0, mode='w')",
    ],
)
def test_a_text_without_its_encoding_is_found(line: str) -> None:
    assert [*without_encoding(line)]
    assert not [*without_encoding(line[:-1] + ", encoding='utf-8')".replace("(, ", "("))]
    assert not [*without_encoding("page.open('ab')")]
