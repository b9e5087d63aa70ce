"""The commands ``yawid trend`` and ``yawid diff``, which report what changed."""

import argparse
from pathlib import Path

from yawid.cli.options import Commands, add_command
from yawid.cli.standard_streams import hush
from yawid.sinks.door import print_answer
from yawid.system.stores import place_of

CHANGED = 7
NOTHING_COMPARED = 5


def add_trend(commands: Commands) -> None:
    """Add both commands to the parser."""
    trend = add_command(
        commands, "trend", "DATASET", "what changed over a fleet's flights",
        "yawid trend data\nyawid trend data --vehicle serial:4711 -o trend.html",
    )  # fmt: skip
    trend.add_argument("dataset", metavar="DATASET", type=Path, help="folder made by yawid fleet")
    trend.add_argument("--vehicle", metavar="ID", help="only this vehicle, judged among all")
    trend.add_argument("--json", action="store_true", help="print one JSON object")
    trend.add_argument("-o", "--out", type=Path, metavar="R.html", help="write a page as well")
    trend.add_argument("--force", action="store_true", help="overwrite a page that exists")
    trend.set_defaults(run=_trend)
    diff = add_command(
        commands, "diff", "A B", "what changed between runs or data sets",
        "yawid diff before.mcap after.mcap\nyawid diff data-2025 data-2026 --json",
    )  # fmt: skip
    for name in ("a", "b"):
        kinds = "the MCAP of a finished run, or a data set"
        diff.add_argument(name, metavar=name.upper(), type=place_of, help=kinds)
    diff.add_argument("--json", action="store_true", help="print one JSON object")
    diff.set_defaults(run=_diff)


def _trend(arguments: argparse.Namespace) -> int:
    from yawid.trend.table import print_trend
    from yawid.trend.trend import trend

    report, studied = trend(arguments.dataset, arguments.vehicle)
    if arguments.out is not None:
        hush("matplotlib")  # it makes a folder for its cache where there is none, and logs that
        from yawid.trend.page import write_page

        write_page(report, studied, arguments.out, force=arguments.force)
    print_answer(report, print_trend, as_json=arguments.json)
    if report.changed:
        return CHANGED
    return 0 if report.judged else NOTHING_COMPARED


def _diff(arguments: argparse.Namespace) -> int:
    from yawid.trend.diff import diff
    from yawid.trend.table import print_diff

    report = diff(arguments.a, arguments.b)
    print_answer(report, print_diff, as_json=arguments.json)
    if report.changed:
        return CHANGED
    return 0 if report.judged else NOTHING_COMPARED
