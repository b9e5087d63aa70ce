"""The commands ``yawid trend`` and ``yawid diff``, which report what changed."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from yawid.cli.options import Command
from yawid.cli.standard_streams import hush
from yawid.sinks.door import print_answer
from yawid.system.stores import place_of

if TYPE_CHECKING:
    from yawid.trend.diff import Diff
    from yawid.trend.trend import Trend

CHANGED = 7
NOTHING_COMPARED = 5


def add_trend(command: Command) -> None:
    """Give the command its arguments and options."""
    examples = "yawid trend data\nyawid trend data --vehicle serial:4711 -o trend.html"
    command.shape("DATASET", examples, _trend)
    command.option("dataset", metavar="DATASET", type=Path, help="folder made by yawid fleet")
    command.option("--vehicle", metavar="ID", help="only this vehicle, judged among all")
    command.flag("--json", "print one JSON object")
    command.page("R.html", "write a page as well")


def add_diff(command: Command) -> None:
    """Give the command its arguments and options."""
    examples = "yawid diff before.mcap after.mcap\nyawid diff data-2025 data-2026 --json"
    command.shape("A B", examples, _diff)
    for name in ("a", "b"):
        kinds = "the MCAP of a finished run, or a data set"
        command.option(name, metavar=name.upper(), type=place_of, help=kinds)
    command.flag("--json", "print one JSON object")


def _trend(arguments: argparse.Namespace) -> int:
    from yawid.trend.table import print_trend
    from yawid.trend.trend import trend

    report, studied = trend(arguments.dataset, arguments.vehicle)
    if arguments.out is not None:
        hush("matplotlib")  # it makes a folder for its cache where there is none, and logs that
        from yawid.trend.page import write_page

        write_page(report, studied, arguments.out, force=arguments.force)
    print_answer(report, print_trend, as_json=arguments.json)
    return _code(report)


def _diff(arguments: argparse.Namespace) -> int:
    from yawid.trend.diff import diff
    from yawid.trend.table import print_diff

    report = diff(arguments.a, arguments.b)
    print_answer(report, print_diff, as_json=arguments.json)
    return _code(report)


def _code(report: "Trend | Diff") -> int:
    if report.changed:
        return CHANGED
    return 0 if report.judged else NOTHING_COMPARED
