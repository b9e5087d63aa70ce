"""Fly JSBSim's aircraft and put what yawid finds beside JSBSim's own linearisation.

    python tools/bench.py aircraft

Each flight is 120 s of 3-2-1-1 on the rudder with the wings held level, replayed with the default
orders at 10 Hz, nothing forgotten. The truth is the Dutch roll of the aircraft linearised at the
mean airspeed flown, closed with the roll hold. The exit code is 1 where RML misses 2.5 % or 0.02.
"""

from __future__ import annotations

import argparse
import math
import struct
from collections.abc import Iterator
from typing import Any

from jsbsim_flight import Flight, FlightPlan, excitation
from jsbsim_truth import after_lead_in, flown_dutch_rolls
from telemetry import Link, telemetry

from yawid.channels.stage import WANTED
from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.results.summary import summarise
from yawid.runs.run_log import run_log
from yawid.sources.open_log import TlogBytes

FLIGHTS = (
    ("c172p", 80.0, 3000.0),
    ("c172p", 100.0, 3000.0),
    ("J3Cub", 60.0, 2000.0),
    ("J3Cub", 70.0, 2000.0),
    ("T37", 160.0, 5000.0),
    ("T37", 220.0, 5000.0),
    ("t6texan2", 150.0, 5000.0),
    ("t6texan2", 200.0, 5000.0),
)
AMPLITUDE = 0.1
WN_SHARE = 0.025
ZETA_ERROR = 0.02


def fly(
    aircraft: str, speed_kt: float, altitude_ft: float
) -> tuple[dict[str, float], dict[str, Any]]:
    """Fly one, replay it; return the true Dutch roll and the estimates by method."""
    plan = FlightPlan(
        aircraft=aircraft,
        speed_kt=speed_kt,
        altitude_ft=altitude_ft,
        amplitude=AMPLITUDE,
        seconds=120.0,
    )
    config = RunConfig(rate=10.0, forgetting=1.0)
    flight = Flight(plan, excitation(plan))
    frames = telemetry(plan, Link(attitude_hz=50.0, servo_hz=50.0), flight)
    pipeline = Pipeline(config)
    records = b"".join(struct.pack(">Q", stamp_us) + frame for stamp_us, frame in frames)
    source = TlogBytes([records], WANTED)
    run_log(source, pipeline)
    summary, _ = summarise(pipeline, source.link, aircraft, "")
    true = flown_dutch_rolls(plan, after_lead_in(flight.flown))["dutch_roll"]
    assert true is not None, plan
    return true, summary.estimates or {}


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table: wn in rad/s and zeta, what they should be and by how much they miss."""
    argparse.ArgumentParser(prog="bench.py aircraft", description=__doc__).parse_args(arguments)
    rows: dict[str, list[str]] = {"truth": [], "RML": [], "ELS": []}
    missed = []
    for aircraft, speed_kt, altitude_ft in FLIGHTS:
        true, estimates = fly(aircraft, speed_kt, altitude_ft)
        rows["truth"].append(f"{true['wn_rad_s']:.3f}, {true['zeta']:.3f}")
        for method in ("rml", "els"):
            found = estimates[method].dutch_roll
            wn, zeta = (math.nan, math.nan) if found is None else (found.wn_rad_s, found.zeta)
            share, error = wn / true["wn_rad_s"] - 1.0, zeta - true["zeta"]
            rows[method.upper()].append(f"{100 * share:+.1f} %, {error:+.3f}")
            if method == "rml" and not (abs(share) <= WN_SHARE and abs(error) <= ZETA_ERROR):
                missed.append(aircraft)
    yield "| | " + " | ".join(f"{aircraft} {speed:g} kt" for aircraft, speed, _ in FLIGHTS) + " |"
    yield "|---" * (1 + len(FLIGHTS)) + "|"
    for name, cells in rows.items():
        yield f"| {name} | " + " | ".join(cells) + " |"
    if missed:
        raise SystemExit(f"RML misses {', '.join(missed)}")
