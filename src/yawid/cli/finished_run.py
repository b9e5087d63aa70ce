"""The command line of ``yawid view`` and ``yawid report``: looking at a finished run."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_view_and_report(commands: Any) -> None:
    """Add both commands to the parser's."""
    view = commands.add_parser("view", help="show a finished run in the Rerun viewer")
    view.add_argument("mcap", metavar="RUN.mcap", type=Path)
    view.add_argument("--save", type=Path, metavar="X.rrd", help="write a recording instead")
    view.add_argument(
        "--to", metavar="URL", help="send it to a viewer: rerun+http://HOST:PORT/proxy"
    )
    view.add_argument("--force", action="store_true", help="overwrite a recording that exists")
    view.set_defaults(run=_view)
    report = commands.add_parser("report", help="write a report of a finished run: one HTML file")
    report.add_argument("mcap", metavar="RUN.mcap", type=Path)
    report.add_argument(
        "-o", "--out", type=Path, metavar="R.html", help="(beside the MCAP, under its name)"
    )
    report.add_argument("--force", action="store_true", help="overwrite a report that exists")
    report.set_defaults(run=_report)


def _view(arguments: argparse.Namespace) -> int:
    from yawid.errors import ConfigError
    from yawid.runs.view import view

    if arguments.save is not None and arguments.to is not None:
        raise ConfigError("--save and --to: choose one")
    if arguments.to is not None and not arguments.to.startswith("rerun+http"):
        raise ConfigError(f"--to must be rerun+http://HOST:PORT/proxy, got {arguments.to!r}")
    view(arguments.mcap, arguments.save, arguments.to or "spawn", force=arguments.force)
    if arguments.save is not None:
        print(arguments.save.absolute(), flush=True)
    return 0


def _report(arguments: argparse.Namespace) -> int:
    from yawid.report.write import write_report

    print(write_report(arguments.mcap, arguments.out, force=arguments.force), flush=True)
    return 0
