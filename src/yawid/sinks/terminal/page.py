"""The paper of what is printed for people: how wide it is, and that no text on it is a command."""

from typing import TextIO

from rich.console import Console

WIDTH = 80


def page_console(stream: TextIO) -> Console:
    """Return what prints a page: as wide as the terminal, or ``WIDTH``; ``[red]`` is a text."""
    width = None if stream.isatty() else WIDTH
    return Console(file=stream, highlight=False, markup=False, emoji=False, width=width)
