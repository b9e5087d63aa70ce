"""A run as a notebook and a prompt show it: first whether it is usable, then the answer."""

import io
from collections.abc import Iterator, Sequence

from yawid.answers.run_summary import RunSummary
from yawid.sinks.door import plain
from yawid.sinks.pages import Note, Part, Said, to_html, to_terminal
from yawid.sinks.run_page import summary_page
from yawid.system.stores import Place
from yawid.tables.keywords import in_keywords
from yawid.tables.table import Table


def as_text(path: Place, summary: RunSummary, tables: Sequence[Table]) -> str:
    """Return a run as text for a prompt."""
    out = io.StringIO()
    to_terminal(_parts(path, summary, tables), out)
    return out.getvalue().rstrip()


def page(path: Place, summary: RunSummary, tables: Sequence[Table]) -> str:
    """Return a run as HTML for a notebook, without script, external styles or other sources."""
    return f"<div>{to_html(_parts(path, summary, tables))}</div>"


def _parts(path: Place, summary: RunSummary, tables: Sequence[Table]) -> Iterator[Part]:
    """Yield the page of a run as the terminal has it, with Python's words for options."""
    yield Note(f"{plain(str(path))}: {_whether(summary)}", "bold", wraps=False)
    for part in summary_page(summary):
        if isinstance(part, Said):
            part = part._replace(text=in_keywords(part.text))
        yield part
    rows = ", ".join(f"{table.title} ({len(table)})" for table in tables)
    yield Note(f"    rows  {rows}")


def _whether(summary: RunSummary) -> str:
    """Return in words whether the answer is usable."""
    if not summary.deciding.fatal:
        return summary.deciding.word
    return "NOT USABLE" + (", the numbers are for study only" if summary.estimates else "")
