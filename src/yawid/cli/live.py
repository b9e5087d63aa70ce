"""The command ``yawid live``."""

import argparse
import sys
from pathlib import Path

from yawid.cli.options import (
    Command,
    add_outputs,
    add_run_options,
    outputs_of,
    read_options_of,
    settings_of,
)
from yawid.errors import ConfigError
from yawid.sinks.door import print_answer

ASKED_HZ = 50.0
_ENDPOINT = (
    "udpin:HOST:PORT, udpbcast:HOST:PORT, mcast:, tcp:HOST:PORT or a serial port such as "
    "/dev/ttyUSB0,57600; udpout:HOST:PORT with --request-rates; IPv6 as udpin:[::1]:14560"
)
_EXAMPLES = """\
yawid live udpin:127.0.0.1:14560
yawid live /dev/ttyUSB0,57600 --sysid 3 --rerun spawn"""


def add_live(command: Command) -> None:
    """Give the command its arguments and options."""
    from yawid.config.run import COLUMNS

    command.shape("ENDPOINT", _EXAMPLES, _live)
    command.option("endpoint", metavar="ENDPOINT", help=_ENDPOINT)
    command.option(
        "--seconds", type=float, metavar="N", help="stop after N seconds (default: at Ctrl-C)"
    )
    command.flag("--no-record", "write no tlog", rare=True)
    command.option(
        "--request-rates", type=float, nargs="?", const=ASKED_HZ, metavar="HZ",
        help="transmit: ask the vehicle for attitude and servos at HZ, 50 if left out "
        "(default: transmit nothing)",
    )  # fmt: skip
    command.option(
        "--publish", metavar="ENDPOINT", action="append", default=[],
        help="transmit: the answer once a second as MAVLink, NAMED_VALUE_FLOAT and STATUSTEXT, to "
        "udpout:HOST:PORT (a ground station listens there), to whoever sends to udpin:HOST:PORT, "
        "or to tap: back over the tap's own link, so to the vehicle as well; may be given several "
        "times (default: transmit nothing)",
    )  # fmt: skip
    add_outputs(command)
    add_run_options(command, without={COLUMNS})


def _live(arguments: argparse.Namespace) -> int:
    """Run a live session; print the result of each vehicle's and return the highest exit code."""
    from yawid.config.run import RunConfig
    from yawid.runs.live import LiveOptions, live, session_name
    from yawid.runs.stop import StopFlag
    from yawid.sinks.run_page import print_summary
    from yawid.sinks.terminal.console import console_for

    if Path(arguments.endpoint).is_file():
        raise ConfigError(
            f"{arguments.endpoint} is a file, not a live link: use yawid replay for a log, or give "
            "an endpoint such as udpin:127.0.0.1:14560"
        )
    every_vehicle = arguments.sysid == "all"
    if every_vehicle:
        arguments.sysid = None
    settings = settings_of(arguments)
    config, outputs = RunConfig(**settings), outputs_of(arguments, session_name())
    options = LiveOptions(
        arguments.endpoint,
        arguments.seconds,
        arguments.request_rates,
        every_vehicle=every_vehicle,
        publish=tuple(arguments.publish),
    )
    with StopFlag().installed() as stop:
        ended = live(
            options, config, outputs, stop, console_for(sys.stderr), read_options_of(arguments)
        )
    for session in ended:
        print_answer(session.summary, print_summary, as_json=arguments.json)
    return max(session.exit_code for session in ended)
