"""``yawid man``: the texts on commands, options, exit codes, reasons and terms, for man(1)."""

import argparse
import re
from collections.abc import Iterator
from functools import partial
from typing import Final

from yawid.cli.explain import Parts, parts_of
from yawid.cli.options import Commands, add_command
from yawid.sinks.door import print_text
from yawid.version import __version__

SECTIONS: Final = {
    "commands": "COMMANDS", "options": "OPTIONS", "exit codes": "EXIT STATUS",
    "reasons": "REASONS", "terms": "TERMS",
}  # fmt: skip
"""The kinds of parts on the page, and their headings."""
_FENCE: Final = re.compile(r"```\w*\n(.*?)```\n?", re.DOTALL)
_MARKS: Final = re.compile(r"\[([^]]+)\]\([^)]+\)|`([^`]+)`|\*\*(.+?)\*\*", re.DOTALL)


def add_man(commands: Commands, whole: argparse.ArgumentParser) -> None:
    """Add ``man`` to the parser; its page has the commands and options of ``whole``."""
    man = add_command(
        commands, "man", "", "print yawid's page for man(1)",
        "yawid man | man -l -\nyawid man > ~/.local/share/man/man1/yawid.1",
    )  # fmt: skip
    man.set_defaults(run=partial(_man, whole))


def _man(whole: argparse.ArgumentParser, _: argparse.Namespace) -> int:
    print_text(man_page(str(whole.description), parts_of(whole)))
    return 0


def man_page(what: str, parts: Parts) -> str:
    """Return the page as roff; ``what`` says in a line what yawid is for."""
    lines = [
        f'.TH YAWID 1 "" "yawid {__version__}" "User Commands"', ".SH NAME",
        f"yawid \\- {_plain(what)}", ".SH SYNOPSIS", ".B yawid", "COMMAND ... [options]",
        ".SH DESCRIPTION", "Each command prints its options with",
        ".BR \\-\\-help ;", "yawid explain WORD prints one part of this page.",
    ]  # fmt: skip
    for kind, heading in SECTIONS.items():
        lines.append(f".SH {heading}")
        for (of, word), text in parts.items():
            if of == kind:
                lines += [".PP", f".B {_plain(word)}", ".RS 4", *_roff(text), ".RE"]
    return "\n".join(lines) + "\n"


def _roff(text: str) -> Iterator[str]:
    """Yield a part of the manual, in Markdown, as lines of roff."""
    for i, piece in enumerate(_FENCE.split(text)):
        if i % 2 == 1 or "\n|" in f"\n{piece}":  # a block of code, or with a table
            yield from (".PP", ".nf", *map(_plain, piece.strip("\n").split("\n")), ".fi")
            continue
        for paragraph in filter(None, re.split(r"\n\s*\n|\n(?=- |  of )", piece.strip("\n"))):
            yield ".IP \\(bu 2" if paragraph.startswith("- ") else ".PP"
            words = " ".join(paragraph.removeprefix("- ").split())
            yield _MARKS.sub(lambda found: f"\\fB{found[found.lastindex or 0]}\\fP", _plain(words))


def _plain(text: str) -> str:
    """Return a line of text as roff prints it: whatever characters it has."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    text = "".join(each if each.isascii() else f"\\[u{ord(each):04X}]" for each in text)
    return f"\\&{text}" if text[:1] in (".", "'") else text
