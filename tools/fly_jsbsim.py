"""Flies an aircraft of JSBSim with a moving rudder, and records what its telemetry link delivers.

    python tools/fly_jsbsim.py --manoeuvre 3211 --seconds 120 --out log.tlog --truth truth.json
    python tools/fly_jsbsim.py --plan three_speeds -o log.tlog
    python tools/fly_jsbsim.py --udp 127.0.0.1:14560

The first command writes a tlog that any MAVLink tool reads, and the Dutch roll that should be found
in it. --udp sends the same frames to a UDP endpoint at the pace of the flight, with --out after it
is flown. The same command gives the same bytes. A plan (flights/plan.py) is a whole flight; its
truth, manoeuvre by manoeuvre, is written next to the log as log.truth.json, or to the file of
--truth.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from pathlib import Path

from flights.fly import LegFlight, flight_of, leg_truth
from flights.plan import FlightError, FlightPlan, Servo, read_plan
from flights.surgery import Record, join
from flights.telemetry import Link, send, telemetry
from flights.truth import after_lead_in, truth

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
    parser.add_argument("--plan", metavar="FILE|NAME", help=".toml file, three_speeds, or upset")
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


def main(argv: Sequence[str]) -> int:
    """Fly, write and send; return 0, or 2 after printing the reason in one line."""
    options = vars(parse(argv))
    out, path, udp, named = (options.pop(name) for name in ("out", "truth", "udp", "plan"))
    try:
        link = Link(**{each.name: options.pop(each.name) for each in fields(Link)})
        plan = FlightPlan(**options)
        if named:
            plan = replace(read_plan(named), true_feedback=plan.true_feedback)
        flight = flight_of(plan, link)
        frames: Iterable[Record] = telemetry(link, flight)
        if out:
            frames = [*frames]
            out.write_bytes(join(frames))
        count = send(frames, udp) if udp else sum(1 for _ in frames)
        print(f"fly_jsbsim: {count} frames", file=sys.stderr)
        if isinstance(flight, LegFlight):
            found = leg_truth(plan, link, flight) | {"plan": named}
            path = path or (out and out.with_suffix(".truth.json"))
        elif path:
            found = truth(plan, after_lead_in(flight.flown))
            found |= {"seconds": plan.seconds, "manoeuvre": plan.manoeuvre, "seed": link.seed}
        if path:
            found["command"] = shlex.join(["python", "tools/fly_jsbsim.py", *argv])
            path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    except (FlightError, ValueError, OSError, OverflowError) as error:
        print(f"fly_jsbsim: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
