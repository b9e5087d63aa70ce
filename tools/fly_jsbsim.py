"""Flies an aircraft of JSBSim with a moving rudder, and records what its telemetry link delivers.

    python tools/fly_jsbsim.py --manoeuvre 3211 --seconds 120 --out log.tlog --truth truth.json
    python tools/fly_jsbsim.py --udp 127.0.0.1:14560

The first command writes a tlog that any MAVLink tool reads, and the Dutch roll that should be found
in it: to the file of --truth, by default next to the log as log.truth.json. --udp sends the same
frames to a UDP endpoint at the pace of the flight, with --out after it is flown. The same command
gives the same bytes.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path

from flights.flight import Flight
from flights.fly import fly, written
from flights.plan import FlightError, FlightPlan, Servo
from flights.surgery import Record, split
from flights.telemetry import Link, send, telemetry

OF_KIND = {
    str: "a name", float: "a number", int: "a whole number", Servo: "MIN,TRIM,MAX[,REVERSED] in us"
}  # fmt: skip


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
    parser.add_argument("--out", "-o", type=Path, help="tlog to write")
    parser.add_argument("--truth", type=Path, help="JSON file for the Dutch roll to be found")
    parser.add_argument("--udp", type=endpoint, metavar="HOST:PORT", help="send in real time")
    for title, defaults in (("flight", FlightPlan()), ("link", Link())):
        group = parser.add_argument_group(title, defaults.__doc__)
        for each in fields(defaults):
            flag, value = f"--{each.name.replace('_', '-')}", getattr(defaults, each.name)
            if value is False:
                group.add_argument(flag, action="store_true", help="a flag")
            elif not isinstance(value, tuple):
                kind = servo if isinstance(value, Servo) else type(value)
                group.add_argument(flag, type=kind, default=value, help=OF_KIND[type(value)])
    options = parser.parse_args(argv)
    if not (options.out or options.truth or options.udp):
        parser.error("nothing to do: give --out, --truth or --udp")
    return options


def asked(options: argparse.Namespace) -> tuple[FlightPlan, Link]:
    """Return the flight and the link that options ask for."""
    given = vars(options)
    link = Link(**{each.name: given[each.name] for each in fields(Link)})
    plan = FlightPlan(**{x.name: given[x.name] for x in fields(FlightPlan) if x.name in given})
    return plan, link


def main(argv: Sequence[str]) -> int:
    """Fly, write and send; return 0, or 2 after printing the reason in one line."""
    options = parse(argv)
    out, path, udp = options.out, options.truth, options.udp
    try:
        plan, link = asked(options)
        if not (out or path):
            frames: Iterable[Record] = telemetry(link, Flight(plan, link=link))
        else:
            made = fly(plan, link, command=shlex.join(["python", "tools/fly_jsbsim.py", *argv]))
            frames = split(made.log)
            if out:
                out.write_bytes(made.log)
            (path or out.with_suffix(".truth.json")).write_text(written(made), encoding="utf-8")
        count = send(frames, udp) if udp else len([*frames])
        print(f"fly_jsbsim: {count} frames", file=sys.stderr)
    except (FlightError, ValueError, OSError, OverflowError) as error:
        print(f"fly_jsbsim: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
