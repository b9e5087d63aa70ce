"""The report's page: HTML in a single file without script, fit for paper and for a phone.

``page.html`` has its parts as macros of jinja2, which escapes every text: names of parameters and
files come from logs that anybody may have written. The page's policy lets it load and run nothing,
whatever it contains.
"""

import re
from collections.abc import Callable
from importlib.resources import files
from typing import Any, Final

from jinja2 import Environment, PackageLoader
from markupsafe import Markup, escape

from yawid.sinks.palette import BAD, CARE, DATA, GOOD
from yawid.sinks.words import NEXT

_COLOURS: Final = {"data": DATA, "good": GOOD, "care": CARE, "bad": BAD}
STYLE: Final = (
    f":root {{ {' '.join(f'--{name}: {colour};' for name, colour in _COLOURS.items())} }}\n"
) + files("yawid.report").joinpath("report.css").read_text(encoding="utf-8")
Cell = tuple[str, str]
"""A cell of a wide table: its text, and the small text below it."""
_CONTROLS: Final = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


def _cleaned(text: Any) -> Any:
    """Return a text with U+FFFD for characters that HTML does not allow; HTML as it is."""
    return text if isinstance(text, Markup) else _CONTROLS.sub("\ufffd", str(text))


def _prose(text: str) -> Markup:
    """Return a sentence as HTML in which options are not broken across lines."""
    shown = str(escape(_cleaned(text)))
    return Markup(re.sub(r"--[a-z][a-z-]*", r'<span class="option">\g<0></span>', shown))


def symbol(symbols: str, text: str) -> Markup:
    """Return symbols as HTML, with _ for a subscript and ^ for a superscript, and their meaning."""
    shown = re.sub(r"_(\w+)", r"<sub>\1</sub>", str(escape(symbols)))
    shown = re.sub(r"\^(\w+)", r"<sup>\1</sup>", shown)
    return Markup('<span class="option">{}</span><small>{}</small>').format(Markup(shown), text)


_ENVIRONMENT: Final = Environment(
    loader=PackageLoader("yawid", "report"),
    autoescape=True,
    finalize=_cleaned,
    trim_blocks=True,
    lstrip_blocks=True,
)
_ENVIRONMENT.filters["prose"] = _prose
_ENVIRONMENT.globals |= {"STYLE": STYLE, "NEXT": NEXT}
_PARTS: Final[Any] = _ENVIRONMENT.get_template("page.html").module
Part = Callable[..., str]
page: Part = _PARTS.page
"""The whole document, of a title and an iterable of parts."""
head: Part = _PARTS.head
first_screen: Part = _PARTS.first_screen
listed: Part = _PARTS.listed
pictures: Part = _PARTS.pictures
"""A section of pictures with what to look for in each; "" without any; see :class:`Picture`."""
tables: Part = _PARTS.tables
note: Part = _PARTS.note
"""A paragraph with its own heading, or without one where the title is empty."""
sheet: Part = _PARTS.sheet
table: Part = _PARTS.table
grid: Part = _PARTS.grid
