"""Flies an aircraft of JSBSim with a moving rudder, and records what its telemetry link delivers.

    python tools/fly_jsbsim.py --manoeuvre 3211 --seconds 120 --out log.tlog
    python tools/fly_jsbsim.py --udp 127.0.0.1:14560

The first command writes a tlog that any MAVLink tool reads, and next to it the Dutch roll that
should be found in it, as log.truth.json. --udp sends the same frames to a UDP endpoint instead, at
the pace of the flight. The same command gives the same bytes.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import msgspec
from flights.flight import Flight
from flights.fly import fly, written
from flights.plan import FlightError, FlightPlan, Link, Servo
from flights.surgery import split
from flights.telemetry import send, telemetry


def servo(text: str) -> Servo:
    """Return the servo of ``MIN,TRIM,MAX`` in us; a fourth number other than 0 reverses it."""
    low, trim, high, *reverse = map(int, text.split(","))
    return Servo(low, trim, high, reverse=any(reverse))


def endpoint(text: str) -> tuple[str, int]:
    """Return (host, port) of ``HOST:PORT``."""
    host, _, port = text.rpartition(":")
    return host, int(port)


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Return the options; those of plan and link have the name and default of their field."""
    parser = argparse.ArgumentParser(
        prog="fly_jsbsim.py",
        description=(__doc__ or "").split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    to = parser.add_mutually_exclusive_group(required=True)
    to.add_argument("--out", "-o", type=Path, help="tlog to write")
    to.add_argument("--udp", type=endpoint, metavar="HOST:PORT", help="send in real time")
    for title, defaults in (("flight", FlightPlan()), ("link", Link())):
        group = parser.add_argument_group(title, defaults.__doc__)
        for each in fields(defaults):
            flag, value = f"--{each.name.replace('_', '-')}", getattr(defaults, each.name)
            if value is False:
                group.add_argument(flag, action="store_true", help="a flag")
            elif not isinstance(value, tuple):
                kind = servo if isinstance(value, Servo) else type(value)
                group.add_argument(flag, type=kind, default=value, help="%(type)s")
    return parser.parse_args(argv)


def asked(options: argparse.Namespace) -> tuple[FlightPlan, Link]:
    """Return the flight and the link that options ask for.

    Raises:
        ValueError: the manoeuvre is unknown, or a number is outside its limits.
    """
    plan = msgspec.convert(options, FlightPlan, from_attributes=True)
    return plan, msgspec.convert(options, Link, from_attributes=True)


def main(argv: Sequence[str]) -> int:
    """Fly, write and send; return 0, or 2 after printing the reason in one line."""
    options = parse(argv)
    try:
        plan, link = asked(options)
        if options.udp:
            count = send(telemetry(link, Flight(plan, link=link)), options.udp)
        else:
            made = fly(plan, link, command=shlex.join(["python", "tools/fly_jsbsim.py", *argv]))
            options.out.write_bytes(made.log)
            options.out.with_suffix(".truth.json").write_text(written(made), encoding="utf-8")
            count = len(split(made.log))
        print(f"fly_jsbsim: {count} frames", file=sys.stderr)
    except (FlightError, ValueError, OSError, OverflowError) as error:
        print(f"fly_jsbsim: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
