"""What a machine reads of a regression: JUnit XML and JSON."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from yawid.errors import SinkError
from yawid.runs.regress.check import Outcome

_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def write_junit(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Write JUnit XML: a test case per case; what differs is a failure, what cannot run an error.

    Raises:
        SinkError: the file cannot be written.
    """
    counts = {
        "tests": len(outcomes),
        "failures": sum(o.code == 1 for o in outcomes),
        "errors": sum(o.code > 1 for o in outcomes),
    }
    suite = ET.Element("testsuite", name="yawid regress", time=_seconds(outcomes))
    suite.attrib |= {key: str(value) for key, value in counts.items()}
    for outcome in outcomes:
        case = ET.SubElement(
            suite,
            "testcase",
            classname="yawid.runs.regress",
            name=_clean(outcome.name),
            time=_seconds([outcome]),
        )
        if not outcome.ok:
            kind = "failure" if outcome.code == 1 else "error"
            told = ET.SubElement(case, kind, message=_clean(outcome.wrong[0]))
            told.text = _clean("\n".join(outcome.wrong))
    suites = ET.Element("testsuites")
    suites.append(suite)
    ET.indent(suites)
    try:
        path.write_bytes(ET.tostring(suites, encoding="utf-8", xml_declaration=True) + b"\n")
    except OSError as error:
        raise SinkError(f"cannot write {path}: {error.strerror}") from error


def as_json(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return what ``--json`` prints: the same for the same logs and references."""
    return {
        "exit_code": exit_code(outcomes),
        "cases": [
            {
                "name": o.name,
                "folder": str(o.folder),
                "ok": o.ok,
                "exit_code": o.code,
                "wrong": list(o.wrong),
                "files": o.files,
            }
            for o in outcomes
        ],
    }


def exit_code(outcomes: Sequence[Outcome]) -> int:
    """Return the highest code of all cases."""
    return max((o.code for o in outcomes), default=0)


def _seconds(outcomes: Sequence[Outcome]) -> str:
    return f"{sum(o.seconds for o in outcomes):.3f}"


def _clean(text: str) -> str:
    """Return the text without what XML cannot hold: a log may put anything into a name."""
    return _NOT_XML.sub("\ufffd", text)
