"""Fly JSBSim's aircraft with a moving rudder and record what its telemetry link would deliver.

    python tools/fly_jsbsim.py --manoeuvre 3211 --seconds 120 --out log.tlog --truth truth.json
    python tools/fly_jsbsim.py --plan three_speeds -o log.tlog
    python tools/fly_jsbsim.py --udp 127.0.0.1:14560

writes a tlog that any MAVLink tool reads, and the Dutch roll that should be found in it; or sends
the same frames to a UDP endpoint at the pace of the flight. The same command gives the same bytes.
A plan (flight_legs.py) is a whole flight; its truth, manoeuvre by manoeuvre, is written beside the
log as log.truth.json unless --truth says where.
"""

from __future__ import annotations

import argparse
import json
import shlex
import socket
import struct
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from flights.flight import MANOEUVRES, Flight, FlightError, FlightPlan, Servo, excitation
from flights.guided import LegFlight, leg_truth
from flights.legs import PLANS, LegPlan, read_plan
from flights.telemetry import Link, telemetry
from flights.truth import after_lead_in, disagreement, truth

Stamped = tuple[int, bytes]
PLAN_NUMBERS = {
    "speed_kt": "calibrated airspeed",
    "altitude_ft": "above sea level",
    "heading_deg": "at the start",
    "seconds": "length of the flight",
    "amplitude": "of the rudder about trim, 1 is full travel",
    "step_s": "unit of time of the manoeuvre, best 0.3 Dutch-roll periods",
    "roll_gain": "roll hold, aileron per rad",
    "roll_rate_gain": "roll hold, aileron per rad/s",
}
LINK_NUMBERS = {
    "attitude_hz": "rate of ATTITUDE",
    "servo_hz": "rate of SERVO_OUTPUT_RAW",
    "rate_noise": "standard deviation in rad/s",
    "angle_noise": "standard deviation in rad",
    "boot_s": "vehicle time at the start",
}
SERVO_HELP = "MIN,TRIM,MAX[,REVERSED] in us"
OWN = (
    "out",
    "truth",
    "udp",
    "speedup",
    "plan",
)  # neither the flight's options nor the link's


def fly(plan: FlightPlan, link: Link) -> Iterator[Stamped]:
    """Yield (receive stamp in us of Unix time, MAVLink frame) of a flight, as it is flown.

    Raises:
        FlightError: the aircraft cannot be loaded or trimmed, or trim and amplitude pass the stops.
    """
    return telemetry(plan, link, Flight(plan, excitation(plan)))


def record(frames: Iterable[Stamped], path: Path) -> Iterator[Stamped]:
    """Pass frames on and write them to a tlog: 8 bytes of stamp, big-endian, then the frame."""
    with path.open("wb") as log:
        for stamp_us, frame in frames:
            log.write(struct.pack(">Q", stamp_us) + frame)
            yield stamp_us, frame


def send(frames: Iterable[Stamped], endpoint: tuple[str, int], speedup: float = 1.0) -> int:
    """Send each frame as a datagram at the pace of its stamps; return how many were sent."""
    sent = 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        start_s, first_us = time.monotonic(), None
        for stamp_us, frame in frames:
            first_us = stamp_us if first_us is None else first_us
            ahead_s = (stamp_us - first_us) / (1e6 * speedup) - (time.monotonic() - start_s)
            if ahead_s > 0.0:
                time.sleep(ahead_s)
            sock.sendto(frame, endpoint)
            sent += 1
    return sent


def endpoint(text: str) -> tuple[str, int]:
    """Return (host, port) of ``HOST:PORT``."""
    host, colon, port = text.rpartition(":")
    if not (colon and host and port.isdecimal() and 0 < int(port) < 65536):
        raise argparse.ArgumentTypeError(f"expected HOST:PORT, got {text!r}")
    return host, int(port)


def servo(text: str) -> Servo:
    """Return the servo of ``MIN,TRIM,MAX`` in us; a fourth number other than 0 reverses it."""
    try:
        low, trim, high, *reverse = map(int, text.split(","))
        return Servo(low, trim, high, reverse=any(reverse))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"expected MIN,TRIM,MAX[,REVERSED]: {error}") from error


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Return the options; those of plan and link have their field's name and default."""
    parser = argparse.ArgumentParser(
        prog="fly_jsbsim.py",
        description=(__doc__ or "").split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--out", "-o", type=Path, help="tlog to write")
    plans = f"a whole flight: a .toml file or one of {', '.join(PLANS)}"
    parser.add_argument("--plan", metavar="FILE|NAME", help=plans)
    parser.add_argument("--truth", type=Path, help="JSON file for the Dutch roll to be found")
    parser.add_argument("--udp", type=endpoint, metavar="HOST:PORT", help="send in real time")
    parser.add_argument("--speedup", type=float, default=1.0, help="of --udp")
    plan = parser.add_argument_group("flight")
    plan.add_argument("--aircraft", default=FlightPlan().aircraft, help="any that JSBSim brings")
    plan.add_argument("--manoeuvre", choices=MANOEUVRES, default=FlightPlan().manoeuvre, help=" ")
    _add_numbers(plan, FlightPlan(), PLAN_NUMBERS)
    for name in ("rudder", "aileron"):
        plan.add_argument(f"--{name}", type=servo, default="1100,1500,1900", help=SERVO_HELP)
    link = parser.add_argument_group("link")
    _add_numbers(link, Link(), LINK_NUMBERS)
    link.add_argument("--mavlink1", action="store_true", help="MAVLink 1 frames")
    link.add_argument("--seed", type=int, default=Link().seed, help="of noise and jitter")
    options = parser.parse_args(argv)
    if not (options.out or options.truth or options.udp):
        parser.error("nothing to do: give --out, --truth or --udp")
    if not options.speedup > 0.0:
        parser.error("--speedup must be > 0")
    if options.plan:
        if not (options.out or options.udp):
            parser.error("--plan is flown to --out or --udp")
        own = {"aircraft", "manoeuvre", *PLAN_NUMBERS, "rudder", "aileron"}
        changed = [name for name in own if getattr(options, name) != parser.get_default(name)]
        # Servos come as their default's text parsed: they are equal to what a plan flies.
        changed = [name for name in changed if getattr(options, name) != Servo()]
        if changed:
            parser.error(f"--plan says what is flown: leave out {', '.join(sorted(changed))}")
    return options


def _add_numbers(group: Any, defaults: object, names: Mapping[str, str]) -> None:
    for name, text in names.items():
        flag = f"--{name.replace('_', '-')}"
        group.add_argument(flag, type=float, default=getattr(defaults, name), help=text)


def main(argv: Sequence[str]) -> int:
    """Fly, write, send; return 0, or 2 with one line of reason."""
    options = vars(parse(argv))
    own = {name: options.pop(name) for name in OWN}
    link_names = {*LINK_NUMBERS, "mavlink1", "seed"}
    try:
        link = Link(**{name: options.pop(name) for name in link_names})
        if own["plan"]:
            fly_legs(read_plan(own["plan"]), link, own, argv)
            return 0
        plan = FlightPlan(**options)
        flight = Flight(plan, excitation(plan))
        deliver(telemetry(plan, link, flight), own)
        if own["truth"]:
            write_truth(plan, link, flight, own["truth"], argv)
    except (FlightError, ValueError, OSError) as error:
        print(f"fly_jsbsim: {error}", file=sys.stderr)
        return 2
    return 0


def fly_legs(plan: LegPlan, link: Link, own: dict[str, Any], argv: Sequence[str]) -> None:
    """Fly a plan, deliver it, and write its truth, which is known when it has been flown."""
    flight = LegFlight(plan, link.seed)
    deliver(telemetry(plan.trim_plan(), link, flight), own)
    path = own["truth"] or (own["out"] and own["out"].with_suffix(".truth.json"))
    if path:
        write_json(leg_truth(plan, link, flight) | {"plan": own["plan"]}, path, argv)


def write_truth(
    plan: FlightPlan, link: Link, flight: Flight, path: Path, argv: Sequence[str]
) -> None:
    """Write the truth of a finished flight and how the log beside it was made."""
    found = truth(plan, after_lead_in(flight.flown))
    if warning := disagreement(found):
        print(f"fly_jsbsim: {warning}", file=sys.stderr)
    found["seconds"], found["manoeuvre"], found["seed"] = plan.seconds, plan.manoeuvre, link.seed
    write_json(found, path, argv)


def write_json(found: dict[str, Any], path: Path, argv: Sequence[str]) -> None:
    """Write a truth and the command that flies it again."""
    found["command"] = shlex.join(["python", "tools/fly_jsbsim.py", *argv])
    path.write_text(json.dumps(found, indent=1) + "\n")


def deliver(frames: Iterator[Stamped], own: dict[str, Any]) -> None:
    """Fly, write and send as asked, and say how much."""
    if own["out"]:
        frames = record(frames, own["out"])
    count = send(frames, own["udp"], own["speedup"]) if own["udp"] else sum(1 for _ in frames)
    print(f"fly_jsbsim: {count} frames", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
