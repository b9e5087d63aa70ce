"""The command ``yawid damper``: which gain of the yaw damper gives which damping."""

import argparse
from collections import ChainMap
from functools import partial
from pathlib import Path
from typing import Annotated

from yawid.cli.options import Command, choice, numbers
from yawid.cli.standard_streams import hush
from yawid.sinks.door import print_answer, say


def add_damper(command: Command) -> None:
    """Give the command its arguments and options."""
    from msgspec import Meta

    from yawid.damper.autopilots import READ

    command.shape(
        "RUN|LOG",
        "yawid damper flight.mcap\nyawid damper flight.tlog --airspeed 15,25 -o page.html",
        _damper,
    )
    kinds = "the MCAP of a finished run, or a log to replay"
    command.option("log", metavar="RUN|LOG", type=Path, help=kinds)
    text = "the damping ratio aimed at (default: 0.3 to 0.4)"
    command.option("--aim", type=float, metavar="ZETA", help=text)
    text = "airspeeds in m/s (default: those flown)"
    airspeeds = Annotated[tuple[float, float], Meta(description="be LO,HI in m/s")]
    command.option("--airspeed", type=airspeeds, metavar="LO,HI", help=text)
    text = "whose damper (default: the log's)"
    command.option("--autopilot", **choice("ardupilot", "px4"), help=text)
    command.option(
        "--param", type=partial(numbers, READ), action="append", default=[], metavar="NAME=VALUE",
        help="a parameter of the autopilot that is not in the log; may be repeated",
    )  # fmt: skip
    command.flag("--json", "print one JSON object")
    command.page("PAGE.html", "write a page as well")


def _damper(arguments: argparse.Namespace) -> int:
    from yawid.damper.study import Asked, study
    from yawid.sinks.run_page import print_damper
    from yawid.tables.replay import run_of

    given = dict(ChainMap(*reversed(arguments.param)))  # of a parameter the last one counts
    asked = Asked(arguments.aim, arguments.autopilot, arguments.airspeed, given)
    found = study(run_of(arguments.log).facts, asked)
    print_answer(found.report, print_damper, as_json=arguments.json)
    if arguments.out is not None and found.predicted is None:
        say(f"{arguments.out} was not written, as there is nothing to draw")
    elif arguments.out is not None:
        hush("matplotlib")  # it makes a folder for its cache where there is none, and logs that
        from yawid.report.damper_page import write_damper_page

        write_damper_page(found, arguments.out, force=arguments.force)
    return found.exit_code
