"""The command ``yawid damper``: which gain of the yaw damper gives which damping."""

import argparse
from pathlib import Path

from yawid.cli.options import Commands, add_command, add_options
from yawid.cli.standard_streams import hush
from yawid.errors import ConfigError
from yawid.sinks.door import print_answer, say


def add_damper(commands: Commands) -> None:
    """Add the command to the parser."""
    damper = add_command(
        commands, "damper", "RUN|LOG", "say which gain of the yaw damper gives which damping",
        "yawid damper flight.mcap\nyawid damper flight.tlog --airspeed 15,25 -o page.html",
    )  # fmt: skip
    damper.add_argument(
        "log", metavar="RUN|LOG", type=Path, help="the MCAP of a finished run, or a log to replay"
    )
    options = (
        ("--aim", float, "ZETA", "the damping ratio aimed at (default: 0.3 to 0.4)"),
        ("--loop-rate", float, "HZ", "the autopilot's loop rate (default: the log's)"),
        ("--airspeed", _pair, "LO,HI", "airspeeds in m/s (default: those flown)"),
    )
    add_options(damper, options)
    damper.add_argument(
        "--autopilot", choices=("ardupilot", "px4"), help="whose damper (default: the log's)"
    )
    damper.add_argument(
        "--param", type=_parameter, action="append", default=[], metavar="NAME=VALUE",
        help="a parameter of the autopilot that is not in the log; may be repeated",
    )  # fmt: skip
    damper.add_argument("--json", action="store_true", help="print one JSON object")
    damper.add_argument("-o", "--out", type=Path, metavar="PAGE.html", help="write a page as well")
    damper.add_argument("--force", action="store_true", help="overwrite a page that exists")
    damper.set_defaults(run=_damper)


def _pair(text: str) -> tuple[float, float]:
    try:
        low, high = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be LO,HI in m/s, got {text!r}") from None
    return low, high


def _parameter(text: str) -> tuple[str, float]:
    from yawid.damper.autopilots import READ

    name, _, value = text.partition("=")
    if (name := name.strip()) not in READ:
        raise argparse.ArgumentTypeError(
            f"no damper reads a parameter {name!r}; these are read: {', '.join(READ)}"
        )
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, got {text!r}") from None


def _damper(arguments: argparse.Namespace) -> int:
    from yawid.damper.study import Asked, study
    from yawid.sinks.damper_table import print_damper
    from yawid.tables.replay import run_of

    if arguments.out is not None and arguments.out.suffix != ".html":
        raise ConfigError(f"--out {arguments.out}: the name must end in .html")
    asked = Asked(
        arguments.aim, arguments.autopilot, arguments.loop_rate, arguments.airspeed,
        dict(arguments.param),
    )  # fmt: skip
    found = study(run_of(arguments.log).facts, asked)
    print_answer(found.report, print_damper, as_json=arguments.json)
    if arguments.out is not None and found.predicted is None:
        say(f"{arguments.out} was not written, as there is nothing to draw")
    elif arguments.out is not None:
        hush("matplotlib")  # it makes a folder for its cache where there is none, and logs that
        from yawid.report.damper_page import write_damper_page

        write_damper_page(found, arguments.out, force=arguments.force)
    return found.exit_code
