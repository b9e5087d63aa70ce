"""A page as data, and its renderers: for a terminal, as text, and as HTML.

A page is a sequence of parts, which say what is shown; only a renderer knows how. Each makes every
text harmless for its medium: :func:`plain` for a terminal, HTML.
"""

import io
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from textwrap import fill
from typing import Final, NamedTuple, TextIO, TypeAlias

from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from yawid.answers.reasons import Verdict
from yawid.sinks.door import page_console, plain
from yawid.sinks.words import NEXT, Row, next_step

NAME_WIDTH: Final = 9
"""The width of the column of names."""
MOST_APART: Final = 5
"""The most columns of a table of 80 columns that are two blanks apart."""


class Said(NamedTuple):
    """An indented paragraph; its first word, such as the id of a reason, has a style of its own."""

    word: str
    text: str
    style: str = ""


class Note(NamedTuple):
    """A paragraph in one style; one that is for copying is not wrapped."""

    text: str
    style: str = ""
    wraps: bool = True


class Grid(NamedTuple):
    """A table: its headings, its rows, and the style of each row.

    ``texts`` are the places of columns of texts, which are to the left; the last one may be folded.
    """

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    styles: Sequence[str] = ()
    texts: Sequence[int] = (0,)


Part: TypeAlias = Row | Said | Note | Grid
Page: TypeAlias = Iterable[Part]


def verdict_parts(verdict: Verdict) -> Iterator[Part]:
    """Yield whether an answer is usable, every reason, and what to do next."""
    styles = {"usable": "bold green", "not usable": "bold red"}
    word = verdict.word if verdict.word != "not usable" else "NOT USABLE"
    yield Row("verdict", word, styles.get(verdict.word, "bold yellow"))
    for reason in verdict.reasons:
        yield Said(
            f"{reason.called}:", reason.text, "red" if reason.weight == "fatal" else "yellow"
        )
    if (step := next_step(verdict)) is not None:
        yield Said(NEXT, step, "bold")


def hanging(name: str, text: str, width: int) -> str:
    """Return one row: its name, and its text next to it, all of whose lines are indented."""
    begin, indent = f"{name:>{NAME_WIDTH - 1}}  ", " " * (NAME_WIDTH + 1)
    return fill(text, width, initial_indent=begin, subsequent_indent=indent, break_on_hyphens=False)


def to_terminal(page: Page, stream: TextIO) -> None:
    """Print a page, as wide as the terminal, or 80 columns."""
    console = page_console(stream)
    for part in page:
        match part:
            case Row("verdict", text, style):
                console.print(Text("verdict  ") + Text(plain(text), style))
            case Row(name, text, style):
                console.print(Text(hanging(plain(name), plain(text), console.width), style))
            case Said(word, text, style):
                line = Text(f"{plain(word)} " if word else "", style) + Text(plain(text), "default")
                console.print(Padding(line, (0, 0, 0, 2), expand=False))
            case Note(text, style, wraps):
                console.print(Text(plain(text), style), soft_wrap=not wraps)
            case Grid():
                console.print(rich_table(part))


def rich_table(grid: Grid) -> Table:
    """Return a table of rich; of a wide one the columns have one blank between them, not two."""
    is_wide = len(grid.heads) > MOST_APART
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0) if is_wide else (0, 1))
    for i, head in enumerate(grid.heads):
        is_whole = i != grid.texts[-1]
        table.add_column(
            plain(head),
            justify="left" if i in grid.texts else "right",
            no_wrap=is_whole,
            overflow="fold",
        )
    for row, style in zip(grid.rows, grid.styles or [""] * len(grid.rows), strict=True):
        table.add_row(*map(plain, row), style=style)
    return table


def to_text(page: Page) -> str:
    """Return a page as a terminal of 80 columns shows it, without colours."""
    out = io.StringIO()
    to_terminal(page, out)
    return out.getvalue()


def to_html(page: Page) -> str:
    """Return a page as HTML without script, styles or other sources from outside."""
    out = []
    for part in page:
        match part:
            case Grid(heads, rows, _, texts):
                sides = ["left" if i in texts else "right" for i in range(len(heads))]
                lines = [_row("th", heads, sides), *(_row("td", row, sides) for row in rows)]
                out.append(f"<table>{''.join(lines)}</table>")
            case Note(text):
                out.append(f"<p><small>{_safe(text)}</small></p>")
            case Row(name, text) | Said(name, text):
                out.append(f"<p><b>{_safe(name)}</b> {_safe(text)}</p>")
    return "".join(out)


def _row(tag: str, cells: Sequence[str], sides: Sequence[str]) -> str:
    each = zip(cells, sides, strict=True)
    told = [f'<{tag} style="text-align:{side}">{_safe(text)}</{tag}>' for text, side in each]
    return f"<tr>{''.join(told)}</tr>"


def _safe(text: str) -> str:
    return escape(plain(text))
