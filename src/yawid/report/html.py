"""The report's page: HTML that stands alone, prints well and fits a phone; no script at all.

Every text passes through :func:`safe`: names of parameters and files come from logs that anybody
may have written.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Final

from yawid.report.picture import Picture
from yawid.results.run_summary import ReasonSummary, VerdictSummary
from yawid.sinks.answers import Card, advice

STYLE: Final = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1rem 1.25rem 3rem; max-width: 72rem; background: #fff;
  color: #1c1c1c; font: 15px/1.45 "DejaVu Sans", Verdana, "Segoe UI", sans-serif; }
h1 { font-size: 1.35rem; margin: 0 0 .15rem; overflow-wrap: anywhere; }
h2 { font-size: 1.1rem; margin: 2rem 0 .5rem; border-bottom: 1px solid #ccc;
  padding-bottom: .2rem; }
h3 { font-size: 1rem; margin: 0 0 .25rem; }
.origin { color: #555; margin: 0 0 .8rem; overflow-wrap: anywhere; font-size: .87rem; }
.headline { font-size: 1.08rem; margin: 0 0 .9rem; }
.cards { display: grid; gap: .7rem; grid-template-columns: repeat(4, 1fr); }
.card { border: 1px solid #c8c8c8; border-top: 5px solid #4285f4; border-radius: 6px;
  padding: .6rem .75rem; }
.card .question { font-size: .84rem; color: #555; }
.card .answer { font-size: 1.5rem; font-weight: 700; line-height: 1.25; }
.card .spread { font-weight: 600; }
.card .note { color: #444; font-size: .84rem; }
.use.yes { border-top-color: #2e7d32; } .use.care { border-top-color: #e69100; }
.use.no { border-top-color: #c62828; } .use.no .answer { color: #c62828; }
.unusable .card:not(.use) .answer, .unusable .card:not(.use) .spread { color: #8a8a8a; }
.reasons { list-style: none; padding: 0; margin: .8rem 0 0; }
.reasons li { border-left: 5px solid #e69100; padding: .2rem .7rem; margin: .4rem 0; }
.reasons li.fatal { border-left-color: #c62828; }
.reasons b { margin-right: .4rem; } .reasons .advice { color: #444; font-style: italic; }
.pictures { display: grid; gap: 1.3rem 1.6rem; grid-template-columns: 1fr 1fr; }
figure { margin: 0; break-inside: avoid; min-width: 0; }
figure svg { display: block; width: 100%; height: auto; }
figcaption { font-size: .86rem; color: #333; }
table { border-collapse: collapse; font-size: .87rem; max-width: 100%; }
td, th { text-align: left; vertical-align: top; padding: .14rem .8rem .14rem 0;
  border-bottom: 1px solid #e8e8e8; overflow-wrap: anywhere; }
th { font-weight: 600; white-space: nowrap; } td.number { text-align: right;
  white-space: nowrap;  font-variant-numeric: tabular-nums; }
.tables { display: grid; gap: 1rem 2rem; grid-template-columns: 1fr 1fr; }
.tables > div { min-width: 0; }
details { margin: .6rem 0; } summary { cursor: pointer; }
@media (max-width: 60rem) { .cards { grid-template-columns: 1fr 1fr; } }
@media (max-width: 44rem) { body { padding: .7rem .8rem 2rem; }
  .pictures, .tables { grid-template-columns: 1fr; } .card .answer { font-size: 1.2rem; }
  th { white-space: normal; } }
@media (max-width: 22rem) { .cards { grid-template-columns: 1fr; } }
@media print { body { font-size: 10pt; padding: 0; max-width: none; } @page { margin: 14mm; }
  h2 { break-after: avoid; } .card, li, table { break-inside: avoid; }
  .pictures { gap: .8rem 1rem; }
  .cards { grid-template-columns: repeat(4, 1fr); } .card .answer { font-size: 1.15rem; } }
"""
POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_CONTROLS: Final = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


def safe(text: object) -> str:
    """Return a text as HTML shows it literally; what no page may hold becomes a question mark."""
    return escape(_CONTROLS.sub("\ufffd", str(text)))


def page(title: str, body: Iterable[str]) -> str:
    """Return the whole document; it can load nothing and run nothing, whatever is in it."""
    head = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<link rel="icon" href="data:,">\n<title>{safe(title)}</title>\n'
        f"<style>{STYLE}</style>\n</head>\n<body>\n"
    )
    return head + "\n".join(body) + "\n</body>\n</html>\n"


def first_screen(
    name: str, origin: str, sentence: str, answers: Sequence[Card], verdict: VerdictSummary
) -> str:
    """Return the head of the page: the sentence, the four cards, the reasons."""
    usable = verdict.usable
    kind = "no" if not usable else "care" if verdict.reasons else "yes"
    shown = [_card(card, f"use {kind}" if i == len(answers) - 1 else "") for i, card in
             enumerate(answers)]  # fmt: skip
    return (
        f'<header class="{"usable" if usable else "unusable"}">\n<h1>{safe(name)}</h1>\n'
        f'<p class="origin">{safe(origin)}</p>\n<p class="headline">{safe(sentence)}</p>\n'
        f'<div class="cards">\n{"".join(shown)}</div>\n{_reasons(verdict.reasons)}</header>'
    )


def _card(card: Card, kind: str) -> str:
    notes = "".join(f'<div class="note">{safe(note)}</div>' for note in card.notes)
    return (
        f'<div class="card {kind}"><div class="question">{safe(card.question)}</div>'
        f'<div class="answer">{safe(card.answer)}</div>'
        f'<div class="spread">{safe(card.spread)}</div>{notes}</div>\n'
    )


def _reasons(reasons: Sequence[ReasonSummary]) -> str:
    items = [
        f'<li class="{"fatal" if reason.weight == "fatal" else "warning"}">'
        f"<b>{safe(reason.id.replace('_', ' '))}</b>{safe(reason.text)}. "
        f'<span class="advice">{safe(advice(reason))}</span></li>\n'
        for reason in reasons
    ]
    return f'<ul class="reasons">\n{"".join(items)}</ul>\n' if items else ""


def pictures(title: str, shown: Sequence[Picture]) -> str:
    """Return a section of pictures, each with what to look for."""
    figures = [
        f'<figure id="{p.key}"><h3>{safe(p.title)}</h3>\n{p.svg}\n'
        f"<figcaption>{safe(p.look)}</figcaption></figure>\n"
        for p in shown
    ]
    return f'<h2>{safe(title)}</h2>\n<div class="pictures">\n{"".join(figures)}</div>'


def tables(title: str, shown: Iterable[str]) -> str:
    """Return a section of tables side by side."""
    cells = "".join(f"<div>{table}</div>\n" for table in shown if table)
    return f'<h2>{safe(title)}</h2>\n<div class="tables">\n{cells}</div>'


def table(title: str, rows: Mapping[str, object], *, folded: bool = False) -> str:
    """Return a table of names and values, or nothing where there are none."""
    if not rows:
        return ""
    lines = "".join(
        f"<tr><th>{safe(name)}</th><td>{safe(value)}</td></tr>\n" for name, value in rows.items()
    )
    body = f"<table>\n{lines}</table>"
    if folded:
        return f"<details><summary>{safe(title)} ({len(rows)})</summary>{body}</details>"
    return f"<h3>{safe(title)}</h3>{body}"


def grid(title: str, heading: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table of several columns, the first of names and the rest of numbers."""
    head = "".join(f"<th>{safe(text)}</th>" for text in heading)
    lines = "".join(
        f"<tr><th>{safe(row[0])}</th>"
        + "".join(f'<td class="number">{safe(value)}</td>' for value in row[1:])
        + "</tr>\n"
        for row in rows
    )
    return f"<h3>{safe(title)}</h3><table><tr>{head}</tr>\n{lines}</table>"
