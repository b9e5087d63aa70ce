"""The report's page: HTML in a single file without script, fit for paper and for a phone.

Every text goes through :func:`safe`, since names of parameters and files come from logs that
anybody may have written.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Final

from yawid.answers.reasons import Reason
from yawid.report.picture import Picture
from yawid.sinks.answers import Card
from yawid.sinks.palette import BAD, CARE, DATA, GOOD
from yawid.sinks.words import NEXT

_COLOURS: Final = {"data": DATA, "good": GOOD, "care": CARE, "bad": BAD}
STYLE: Final = (
    f":root {{ {' '.join(f'--{name}: {colour};' for name, colour in _COLOURS.items())} }}\n"
) + files("yawid.report").joinpath("report.css").read_text(encoding="utf-8")
POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
Advised = tuple[Reason, str]
"""A reason, and what to do about it."""
Cell = tuple[str, str]
"""A cell of a wide table: its text, and the small text below it."""
_PALE: Final = ' class="pale"'
_CONTROLS: Final = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


def safe(text: object) -> str:
    """Return a text as HTML that shows it literally, with U+FFFD for characters not allowed."""
    return escape(_CONTROLS.sub("\ufffd", str(text)))


def prose(text: str) -> str:
    """Return a sentence as HTML in which options are not broken across lines."""
    return re.sub(r"--[a-z][a-z-]*", r'<span class="option">\g<0></span>', safe(text))


def page(title: str, body: Iterable[str]) -> str:
    """Return the whole document; its policy lets it load and run nothing, whatever it contains."""
    head = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<link rel="icon" href="data:,">\n<title>{safe(title)}</title>\n'
        f"<style>\n{STYLE}</style>\n</head>\n<body>\n"
    )
    return head + "\n".join(body) + "\n</body>\n</html>\n"


def first_screen(
    name: str,
    origin: str,
    sentence: str,
    answers: Sequence[Card],
    advised: Sequence[Advised],
    remark: str = "",
    step: str | None = None,
) -> str:
    """Return the head of the page: the sentence, the cards, the reasons with what to do.

    ``remark`` is put below the cards. The last card says whether the answer can be used; ``step``
    is what to do next where it cannot.
    """
    kind = {"Yes": "yes", "No": "no"}.get(answers[-1].answer, "care")
    shown = [_card(card, f"use {kind}" if i == len(answers) - 1 else "") for i, card in
             enumerate(answers)]  # fmt: skip
    cards = f'<div class="cards">\n{"".join(shown)}</div>\n'
    below = f"{note('', remark) if remark else ''}\n"
    items = ((reason.weight, reason.called, reason.text, to_do) for reason, to_do in advised)
    last = "" if step is None else f'<p class="next"><b>{NEXT}</b> {prose(step)}</p>\n'
    return head(name, origin, sentence, cards + below + listed(items) + last, usable=kind != "no")


def head(name: str, origin: str, sentence: str, body: str, *, usable: bool) -> str:
    """Return the head of a page: its name, its origin, the answer in a sentence, and ``body``."""
    return (
        f'<header class="{"usable" if usable else "unusable"}">\n<h1>{safe(name)}</h1>\n'
        f'<p class="origin">{safe(origin)}</p>\n<p class="headline">{prose(sentence)}</p>\n'
        f"{body}</header>"
    )


def _card(card: Card, kind: str) -> str:
    notes = "".join(f'<div class="note">{safe(note)}</div>' for note in card.notes)
    return (
        f'<div class="card {kind}"><div class="question">{safe(card.question)}</div>'
        f'<div class="answer">{safe(card.answer)}</div>'
        f'<div class="spread">{safe(card.spread)}</div>{notes}</div>\n'
    )


def listed(items: Iterable[tuple[str, str, str, str]]) -> str:
    """Return a list of items, each with its weight, its name, its text, and what to do."""
    lines = [
        f'<li class="{safe(weight)}"><b>{safe(name)}</b>{prose(text)}. '
        f'<span class="advice">{prose(to_do)}</span></li>\n'
        for weight, name, text, to_do in items
    ]
    return f'<ul class="reasons">\n{"".join(lines)}</ul>\n' if lines else ""


def pictures(title: str, shown: Iterable[Picture | None], against: Sequence[Reason] = ()) -> str:
    """Return a section of pictures with what to look for in each; "" without any.

    They are pale where there are reasons ``against`` them.
    """
    figures = "".join(
        f'<figure id="{each.key}"><h3>{safe(each.title)}</h3>\n{each.svg}\n'
        f"<figcaption>{safe(each.look)}</figcaption></figure>\n"
        for each in shown
        if each is not None
    )
    section = f'{_heading(title)}<div class="pictures">\n{figures}</div>' if figures else ""
    return _void(section, against)


def tables(
    title: str, shown: Iterable[str], against: Sequence[Reason] = (), *, facts: bool = False
) -> str:
    """Return a section of tables side by side, in narrower columns where they are ``facts``.

    It is grey and has the reasons ``against`` its numbers, where there are any.
    """
    cells = "".join(f"<div>{table}</div>\n" for table in shown if table)
    kind = " facts" if facts else ""
    return _void(f'{_heading(title)}<div class="tables{kind}">\n{cells}</div>', against)


def _void(section: str, against: Sequence[Reason]) -> str:
    """Return a section, marked as not usable where there are reasons against it."""
    if not against or not section:
        return section
    ids = ", ".join(reason.name for reason in against)
    head, _, rest = section.partition("\n")
    why = f'<p class="why">Not usable: {safe(ids)}. What is grey is for study only.</p>'
    return f'<div class="void">{head}\n{why}\n{rest}</div>'


def note(title: str, text: str) -> str:
    """Return a paragraph with its own heading, or without one where the title is empty."""
    return f'{_heading(title)}<p class="remark">{safe(text)}</p>'


class Label(str):
    """Safe HTML, which is not escaped again; see :func:`symbol`."""

    __slots__ = ()


def symbol(symbols: str, text: str) -> Label:
    """Return symbols as HTML, with _ for a subscript and ^ for a superscript, and their meaning."""
    shown = re.sub(r"_(\w+)", r"<sub>\1</sub>", safe(symbols))
    shown = re.sub(r"\^(\w+)", r"<sup>\1</sup>", shown)
    return Label(f'<span class="option">{shown}</span><small>{safe(text)}</small>')


def _heading(title: str) -> str:
    return f"<h2>{safe(title)}</h2>\n" if title else ""


def sheet(title: str, heading: Sequence[str], rows: Iterable[tuple[Iterable[Cell], bool]]) -> str:
    """Return a section of one wide table; each row has its cells, and whether it is pale.

    On a narrow page the table scrolls on its own, also by the keyboard.
    """
    head = "".join(f'<th scope="col">{safe(text)}</th>' for text in heading)
    lines = "".join(
        f"<tr{_PALE if pale else ''}>{''.join(map(_cell, cells))}</tr>\n" for cells, pale in rows
    )
    return (
        f'{_heading(title)}<div class="sheet" role="region" tabindex="0" '
        f'aria-label="{safe(title)}"><table>\n<thead><tr>{head}</tr></thead>\n{lines}</table></div>'
    )


def _cell(cell: Cell) -> str:
    text, below = cell
    return f"<td>{safe(text)}{f'<small>{safe(below)}</small>' if below else ''}</td>"


def table(
    title: str, rows: Mapping[str, object], *, folded: bool = False, printed: bool = False
) -> str:
    """Return a table of names and values, "" where there are none; ``folded``: closed at first.

    On paper a folded table is only a line, unless it is ``printed``.
    """
    if not rows:
        return ""
    body = grid("", (), rows.items(), "text")
    if folded:
        kind = ' class="printed"' if printed else ""
        return f"<details{kind}><summary>{safe(title)} ({len(rows)})</summary>{body}</details>"
    return f"<h3>{safe(title)}</h3>{body}"


def grid(
    title: str, heading: Sequence[str], rows: Iterable[Sequence[object]], kind: str = "number"
) -> str:
    """Return a table of several columns: the first has names, the others numbers or texts."""
    head, td = (
        "".join(f"<th>{safe(text)}</th>" for text in heading),
        f'<td class="{kind}">{{}}</td>',
    )
    lines = "".join(
        f"<tr><th>{name if isinstance(name, Label) else safe(name)}</th>"
        f"{''.join(td.format(_unbroken(value)) for value in values)}</tr>\n"
        for name, *values in rows
    )
    shown = f"<table>{f'<tr>{head}</tr>' if head else ''}\n{lines}</table>"
    return f"<h3>{safe(title)}</h3>{shown}" if title else shown


def _unbroken(text: object) -> str:
    """Return a text as HTML; no line break may follow the sign of a sigma."""
    return safe(text).replace("± ", "±\u00a0")
