"""A run as a notebook and a prompt show it: first whether it is usable, then the answer."""

from collections.abc import Sequence
from html import escape

from yawid.answers.run_summary import RunSummary
from yawid.sinks.door import plain
from yawid.sinks.words import NEXT, answer_rows, dutch_roll, next_step
from yawid.system.stores import Place
from yawid.tables.keywords import in_keywords
from yawid.tables.table import Table


def as_text(path: Place, summary: RunSummary, tables: Sequence[Table]) -> str:
    """Return a run as text for a prompt."""
    rows = ", ".join(f"{table.title} ({len(table)})" for table in tables)
    lines = [f"{path}: {verdict(summary)}", *reasons(summary), *answer(summary), f"rows: {rows}"]
    return "\n  ".join(map(plain, lines))


def page(path: Place, summary: RunSummary, tables: Sequence[Table]) -> str:
    """Return a run as HTML for a notebook, without script, external styles or other sources."""
    said = "".join(f"<li>{escape(plain(line))}</li>" for line in reasons(summary))
    dim = "" if summary.deciding.usable else ";opacity:0.6"
    lines = escape("\n".join(map(plain, answer(summary))))
    heads = '<th>table</th><th>rows</th><th style="text-align:left">columns</th>'
    body = "".join(
        f"<tr><td>{escape(table.title)}</td><td>{len(table)}</td>"
        f'<td style="text-align:left">{escape(", ".join(table))}</td></tr>'
        for table in tables
    )
    return (
        f"<div><p><b>{escape(verdict(summary))}</b> {escape(plain(str(path)))}</p><ul>{said}</ul>"
        f'<pre style="white-space:pre-wrap;font-family:monospace{dim}">{lines}</pre>'
        f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def verdict(summary: RunSummary) -> str:
    """Return in words whether the answer is usable."""
    if summary.deciding.usable or summary.verdict is None:
        return summary.deciding.word
    return "NOT USABLE" + (", the numbers are for study only" if summary.estimates else "")


def reasons(summary: RunSummary) -> list[str]:
    """Return the reasons of the deciding verdict, fatal ones and warnings, and what to do next."""
    verdict = summary.deciding
    lines = [str(reason) for reason in verdict.reasons]
    step = next_step(verdict)
    return [in_keywords(line) for line in ([*lines, f"{NEXT} {step}"] if step else lines)]


def answer(summary: RunSummary) -> list[str]:
    """Return the lines of the flight's answer, and the stream's where there was no manoeuvre."""
    lines = [f"{row.name:>6}  {row.text}" for row in answer_rows(summary)]
    mode = summary.dutch_roll
    if summary.flight is None and mode is not None and summary.answer is not None:
        lines.append(f"stream  {dutch_roll(mode)} at its end, by {summary.answer.method.upper()}")
    return [*lines, "        ± is one sigma"] if any("±" in line for line in lines) else lines
