"""What a process of the pool does for the pages: it answers a log, or makes a file of an answer.

A log that crashes, hangs or takes all memory does so to that process. It imports no server.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from yawid.config.run import OF_RECORDS
from yawid.dataset.values import Row, failed
from yawid.errors import YawidError
from yawid.fleet.spec import Spec
from yawid.fleet.worker import Task
from yawid.tables.export import FORMATS

UNREAD: Final = "not read"
"""The outcome of a log whose reading failed for a reason that may pass."""
EXPORTS: Final = tuple(f"{what}{end}" for what in ("samples", "manoeuvres", "modes")
                       for end in FORMATS)  # fmt: skip
MODELS: Final = ("model.json", "model.mat")
REPORT, CARD, SUMMARY, RUN = "report.html", "card", "summary.json", "mcap"
"""Files of a flight: its page, what to fly next, what ``replay --json`` prints, the run itself."""
MADE: Final = (REPORT, CARD, *EXPORTS, *MODELS)
"""Those that are made when somebody asks for them."""
_ASKED: Final = re.compile(
    r"(?:: add |: give |name it by )(--.+?)(?:, with one of |; there are |$)"
)
"""The options that an error about columns asks for."""


@dataclass(frozen=True, slots=True)
class Read(Task):
    """A log to be answered; its run and its summary are written into the folder ``out``."""

    out: Path

    def rows(self, copies: Path) -> Any:
        """Return the log's row of the list, in the form of a fleet's rows."""
        try:
            return {"logs": [answered(Path(self.path), self.spec, self.out)]}
        except (YawidError, OSError) as error:
            asked = _ASKED.search(str(error))
            text = str(error).replace(self.path, Path(self.path).name)
            return failed(UNREAD, text) | {"asks": asked[1] if asked else ""}


@dataclass(frozen=True, slots=True)
class Make(Task):
    """A file ``what`` of a flight, to be made in the folder ``out``."""

    out: Path
    what: str

    def rows(self, copies: Path) -> Any:
        """Return whether it was made, and why not, in the form of a fleet's rows."""
        try:
            make(Path(self.path), self.spec, self.out, self.what)
        except (YawidError, OSError) as error:
            return failed(UNREAD, str(error))
        return {"logs": [{"outcome": "ok"}]}


def answered(log: Path, spec: Spec, out: Path) -> Row:
    """Replay a log; write its run and its summary, and return its row of the list."""
    from yawid.runs.outputs import Outputs
    from yawid.runs.replay import StopFlag, replay
    from yawid.sinks.answers import cards, elsewhere
    from yawid.sinks.door import json_line
    from yawid.sinks.words import NONE
    from yawid.sources.formats import format_of

    has_columns = format_of(log).has_columns
    settings = {name: value for name, value in spec.settings.items()
                if has_columns or name not in OF_RECORDS}  # fmt: skip
    summary = replay(
        log, settings, Outputs(out, log.name, force=True), StopFlag(), spec.read_options()
    )
    (out / f"{log.name}.{SUMMARY}").write_text(json_line(summary.to_json()), encoding="ascii")
    flight, verdict = summary.flight, summary.deciding
    wn, zeta = (f"{card.answer.removesuffix(' rad/s')} {card.spread}".strip()
                for card in cards(summary)[:2])  # fmt: skip
    why = "; ".join(str(reason) for reason in verdict.fatal or verdict.reasons)
    if verdict.fatal:  # a number that cannot be trusted is in the report, with why
        wn, zeta, why = NONE, NONE, f"{elsewhere(summary)} {why}".strip()
    speed_m_s = None if flight is None else flight.airspeed_m_s
    return {
        "outcome": "not judged" if summary.verdict is None else verdict.word,
        "text": why,
        "usable": verdict.usable,
        "wn": wn,
        "zeta": zeta,
        "airspeed": "" if speed_m_s is None else f"{speed_m_s:.1f} m/s",
        "date": (flight and flight.date) or "",
    }


def make(log: Path, spec: Spec, out: Path, what: str) -> None:
    """Make a file of a flight.

    Raises:
        YawidError: the flight has nothing of it, or it cannot be written.
    """
    mcap, path = (out / f"{log.name}.{each}" for each in (RUN, what))
    if what == REPORT:
        from yawid.report.write import write_report

        write_report(mcap, path, force=True)
    elif what == CARD:
        from yawid.runs.inspect_log import inspect
        from yawid.sinks.pages import to_text
        from yawid.sinks.terminal.inspection import card_page

        report = inspect(log, spec.settings, spec.read_options(), with_card=True)
        path.write_text(to_text(card_page(report)), encoding="utf-8")
    elif what in EXPORTS:
        from yawid.tables.export import export

        export(mcap, path, what.partition(".")[0], force=True)
    else:
        from yawid.tables.model_file import write_model
        from yawid.tables.replay import run_of

        write_model(run_of(mcap), "flight", path, {}, force=True)
