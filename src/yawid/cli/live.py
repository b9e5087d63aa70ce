"""The command line of ``yawid live`` and ``yawid recover``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from yawid.config.run import RunConfig
    from yawid.runs.outputs import Outputs
    from yawid.sources.read_options import Reading

ASKED_HZ = 50.0
_ENDPOINT = (
    "udpin:HOST:PORT, udpbcast:HOST:PORT, mcast:, tcp:HOST:PORT or a serial port such as "
    "/dev/ttyUSB0,57600; udpout:HOST:PORT with --request-rates; IPv6 as udpin:[::1]:14560"
)


def add_live(commands: Any, add_outputs: Callable[[argparse.ArgumentParser], None]) -> Any:
    """Add ``live`` to the commands; return its parser."""
    live: argparse.ArgumentParser = commands.add_parser(
        "live", help="estimate from a live link, passively"
    )
    live.add_argument("endpoint", metavar="ENDPOINT", help=_ENDPOINT)
    live.add_argument("--seconds", type=float, metavar="N", help="stop after so many seconds")
    live.add_argument("--no-record", action="store_true", help="write no tlog")
    live.add_argument(
        "--state", type=Path, metavar="FILE", help="resume from it, save to it every minute"
    )
    live.add_argument(
        "--request-rates", type=float, nargs="?", const=ASKED_HZ, metavar="HZ",
        help="transmit: ask the vehicle for attitude and servos at so many Hz (50)",
    )  # fmt: skip
    add_outputs(live)
    return live


def add_recover(commands: Any) -> Any:
    """Add ``recover`` to the commands; return its parser."""
    recover: argparse.ArgumentParser = commands.add_parser(
        "recover", help="make a proper MCAP of one that was cut off"
    )
    recover.add_argument("broken", metavar="BROKEN.mcap", type=Path)
    recover.add_argument("-o", "--out", metavar="OUT.mcap", type=Path, required=True)
    recover.add_argument("--force", action="store_true", help="overwrite a file that exists")
    return recover


def run_live(
    arguments: argparse.Namespace,
    config: RunConfig,
    outputs: Outputs,
    reading: Reading,
    *,
    every_vehicle: bool,
) -> int:
    """Tap the link; print what each vehicle's session came to and return the highest code."""
    from yawid.runs.live import Console, LiveOptions, live
    from yawid.runs.replay import StopFlag

    options = LiveOptions(
        arguments.endpoint,
        arguments.seconds,
        arguments.state,
        arguments.request_rates,
        every_vehicle=every_vehicle,
    )
    with StopFlag().installed() as stop:
        ended = live(options, config, outputs, stop, Console(sys.stderr), reading)
    for session in ended:
        if arguments.json:
            sys.stdout.write(json.dumps(session.summary) + "\n")
            sys.stdout.flush()
        else:
            from yawid.sinks.terminal.summary_table import print_summary

            print_summary(session.summary, sys.stdout)
    return max(session.exit_code for session in ended)


def run_recover(arguments: argparse.Namespace) -> int:
    """Recover a torn MCAP and say what it holds."""
    from yawid.sinks.mcap.recover import recover

    found = recover(arguments.broken, arguments.out, force=arguments.force)
    topics = ", ".join(f"{topic} {count}" for topic, count in sorted(found.counts.items()))
    if found.left_out:
        sys.stderr.write(f"yawid: not to be trusted and left out: {found.left_out}\n")
    sys.stdout.write(f"{arguments.out}: {topics}\n")
    return 0
