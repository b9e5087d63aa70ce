"""The report's page: HTML in a single file, fit for paper and for a phone.

``page.html`` has its parts as macros of jinja2, which escapes every text: names of parameters and
files come from logs that anybody may have written. The page's policy lets it load nothing and run
only the two scripts with which its pictures zoom, whatever it contains; it is whole without them.
"""

import re
from base64 import b64encode
from collections.abc import Callable
from hashlib import sha256
from importlib.resources import files
from typing import Any, Final

from jinja2 import Environment, PackageLoader
from markupsafe import Markup, escape

from yawid.sinks.palette import BAD, CARE, DATA, GOOD
from yawid.sinks.words import NEXT

_COLOURS: Final = {"data": DATA, "good": GOOD, "care": CARE, "bad": BAD}


def _own(name: str) -> str:
    """Return a text file of this package."""
    return files("yawid.report").joinpath(name).read_text(encoding="utf-8")


STYLE: Final = (
    f":root {{ {' '.join(f'--{name}: {colour};' for name, colour in _COLOURS.items())} }}\n"
) + _own("report.css")
_UPLOT: Final = _own("uPlot.iife.min.js").partition("\n")[2]  # without its first line, an address
SCRIPTS: Final = (
    f"/* uPlot 1.6.32\n\n{_own('uPlot.LICENSE')}*/\n{_UPLOT}",
    _own("chart.js") + _own("zoom.js"),
)
"""All that the page runs: uPlot with its licence, and what makes charts of the pictures by it."""
NUMBERS: Final = '<script type="application/json">'
"""The tag before the numbers of a picture; a browser runs nothing of this type."""
_HASHES: Final = [b64encode(sha256(each.encode()).digest()).decode() for each in SCRIPTS]
POLICY: Final = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; "
    "script-src " + " ".join(f"'sha256-{each}'" for each in _HASHES)
)
"""The Content-Security-Policy of the page; the styles are also those of each picture's parts."""
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
_ENVIRONMENT.globals |= {
    "STYLE": STYLE, "ZOOM_STYLE": _own("uPlot.min.css"), "SCRIPTS": SCRIPTS, "POLICY": POLICY,
    "NUMBERS": NUMBERS, "NEXT": NEXT,
}  # fmt: skip
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
