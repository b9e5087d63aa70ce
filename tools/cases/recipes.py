"""The recipes of replay_logs/: how each log is made, and what is true of the aircraft in it."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from flights import command as fly_jsbsim
from flights.flight import Hands
from flights.fly import Made, flight_of
from flights.plan import FlightPlan, excitation
from flights.surgery import Record, after, join, littered, rewrite, split
from flights.telemetry import Link, telemetry
from flights.trim_tlog import ESSENTIAL, trim
from flights.truth import after_lead_in, linear_dutch_rolls, truth

from cases.changes import no_rudder, px4_controls, px4_outputs, two_vehicles, vtail, with_gaps

Truth = dict[str, Any]
MIT = "MIT (made for yawid)"
KEY = bytes(range(32))
"""The key that signs the frames of the signed case; it is not secret."""
UINT32_WRAP_S = 2**32 / 1e6


@dataclass(frozen=True, slots=True)
class Recipe:
    """How a case is made; ``make`` takes a scratch folder and the folder of recorded flights.

    Without ``manoeuvres``, the references of the case contain only the stream's estimate.
    """

    origin: str
    make: Callable[[Path, Path], Made]
    options: dict[str, Any] = field(default_factory=lambda: {"rate": 10, "forgetting": 1.0})
    floor: int = 700
    licence: str = MIT
    recorded: bool = False
    manoeuvres: bool = False

    @property
    def pinned(self) -> dict[str, Any]:
        """The options in case.toml, with that of manoeuvres."""
        return {"manoeuvres": "auto" if self.manoeuvres else "off"} | self.options


def flown(command: str, scratch: Path, flights: Path) -> Made:
    """Fly as tools/fly_jsbsim.py does with these options."""
    log, found = scratch / "log.tlog", scratch / "truth.json"
    code = fly_jsbsim.main([*shlex.split(command), "--out", str(log), "--truth", str(found)])
    if code:
        raise ValueError(f"fly_jsbsim.py {command} failed")
    truth = json.loads(found.read_text(encoding="utf-8"))
    truth.pop("command")
    return Made(log.read_bytes(), {"flight": f"tools/fly_jsbsim.py {command}"} | truth)


def original(command: str, place: str, scratch: Path, flights: Path) -> Made:
    """Fly one of the first cases, whose truth has the command of the flight itself."""
    made = flown(command, scratch, flights)
    assert made.truth is not None
    truth = {key: value for key, value in made.truth.items() if key != "flight"}
    paths = f"--out replay_logs/{place}/log.tlog --truth replay_logs/{place}/truth.json"
    return Made(made.log, truth | {"command": f"python tools/fly_jsbsim.py {command} {paths}"})


def changed(
    command: str,
    change: Callable[[list[Record]], Iterable[Record] | bytes],
    *rest: Path,
    has_truth: bool = True,
) -> Made:
    """Fly, then change the log's records; without ``has_truth``, the result has no truth."""
    made = flown(command, *rest)
    log = change(split(made.log))
    return Made(log if isinstance(log, bytes) else join(log), made.truth if has_truth else None)


def flown_twice(
    first: str,
    second: str,
    combine: Callable[[list[Record], list[Record]], Sequence[Record]],
    *rest: Path,
) -> Made:
    """Fly twice and combine the logs; the truth is that of the second flight."""
    a, b = flown(first, *rest), flown(second, *rest)
    return Made(join(combine(split(a.log), split(b.log))), b.truth)


def cut(name: str, low_s: float, high_s: float, truth: Truth | None, *rest: Path) -> Made:
    """Cut a stretch out of a recorded flight, keeping only the messages that yawid reads."""
    log = (rest[1] / f"{name}.tlog").read_bytes()
    command = (
        f"python tools/trim_tlog.py {name}.tlog log.tlog --from {low_s:g} --to {high_s:g} --only"
    )
    return Made(trim(log, low_s, high_s, ESSENTIAL), truth and truth | {"command": command})


def with_aileron(scratch: Path, flights: Path) -> Made:
    """Fly with rudder and aileron both moved on purpose, so that each moves the yaw on its own.

    The aileron is then an input, so that the Dutch roll estimated is that of the bare airframe.
    """
    plan = FlightPlan(seconds=100.0, roll_gain=0.3, roll_rate_gain=0.0, true_feedback=True)
    link = Link(attitude_hz=25.0, servo_hz=25.0, seed=11)
    pulses = np.random.default_rng(12).choice([-0.12, 0.12], size=round(plan.seconds / 0.3) + 2)
    pulses[: round(5.0 / 0.3)] = 0.0
    rudder = excitation(plan)
    hands = Hands(rudder, np.repeat(pulses, 300)[: len(rudder)], nose_held=False)
    flight = flight_of(plan, link, hands)
    log = join(telemetry(link, flight))
    found = truth(plan, after_lead_in(flight.flown))
    bare = {
        "dutch_roll": found["dutch_roll_open_loop"],
        "dutch_roll_at_trim": linear_dutch_rolls(plan)["dutch_roll_open_loop"],
    }
    return Made(log, found | bare | {"seed": link.seed})


FLY = "--true-feedback --manoeuvre 3211 --attitude-hz 25 --servo-hz 25 --seconds 90 --seed"
SITL = "ArduPlane V4.6-dev SITL"
SITL_MIT = "MIT (recorded for yawid)"
_FIRST = "--true-feedback --manoeuvre 3211 --seconds 120"
_GCS = f"{_FIRST} --attitude-hz 10 --servo-hz 5 --heading-deg 180 --seed 2"
_EXCITED = {"rate": 25, "forgetting": 1.0}
_SPEEDS = "--true-feedback --plan three_speeds --attitude-hz 10 --servo-hz 10 --seed 21"
SITL_TRUTH: Truth = {
    "aircraft": f"{SITL}, built-in plane model",
    "flown": "FBWA at 22.00 +- 0.03 m/s; doublets, 3-2-1-1, PRBS and sweep on the rudder",
    "dutch_roll": {"wn_rad_s": 10.22, "wn_std": 0.016, "zeta": 0.63, "zeta_std": 0.0005},
    "linearised": "at 22 m/s, closed with FBWA's roll loop as it is in the simulator",
    "uncertainty": "wn: 0.03 m/s (VFR_HUD, standard deviation) by 0.5 rad/s per m/s (9.97 at 21.5 "
    "m/s, 10.47 at 22.5), and half the last digit; zeta: half the last digit",
    "servo_lag_s": 0.14,
    "rudder_mix": "rudder carries 0.5 aileron (KFF_RDDRMIX)",
}
SEGMENTS = {
    "rest": [76.499, 86.479],
    "doublet": [86.479, 106.479],
    "3-2-1-1": [106.499, 143.079],
    "prbs": [143.099, 193.879],
    "sweep": [193.879, 253.9],
}
"""The parts of the flight at 50 Hz, in s since boot."""

RECIPES: dict[str, Recipe] = {
    "c172p_3211": Recipe(
        "JSBSim C172P at 100 kt, 3-2-1-1 on the rudder, wings held level; tools/fly_jsbsim.py, "
        "see truth.json",
        partial(original, _FIRST, "c172p_3211"),
        floor=1100,
    ),
    "c172p_gcs_rates": Recipe(
        "the same flight as a ground station records it: ATTITUDE 10 Hz, servo 5 Hz; "
        "tools/fly_jsbsim.py, see truth.json",
        partial(original, _GCS, "c172p_gcs_rates"),
        {"forgetting": 1.0},
        floor=500,
    ),
    "c172p_three_speeds": Recipe(
        "JSBSim C172P at 95, 80 and 110 kt, four manoeuvres at each, turns and climbs between; "
        "see truth.json for the truth of each manoeuvre at the airspeed it was flown at",
        partial(flown, _SPEEDS),
        {"method": "rml", "also": "none"},
        floor=7000,
        manoeuvres=True,
    ),
    "c172p_mavlink1": Recipe(
        "JSBSim C172P at 100 kt, MAVLink 1 frames", partial(flown, f"{FLY} 3 --mavlink1")
    ),
    "c172p_reversed": Recipe(
        "JSBSim C172P at 100 kt, rudder servo reversed, its trim out of the middle",
        partial(flown, f"{FLY} 4 --rudder 1050,1430,1900,1"),
    ),
    "c172p_vtail": Recipe(
        "JSBSim C172P at 100 kt, its rudder reported as a V-tail's whose elevator moves too",
        partial(changed, f"{FLY} 5", vtail),
    ),
    "px4_controls": Recipe(
        "JSBSim C172P at 100 kt, reported as PX4's ACTUATOR_CONTROL_TARGET",
        partial(changed, f"{FLY} 6", px4_controls),
    ),
    "px4_outputs": Recipe(
        "JSBSim C172P at 100 kt, reported as PX4's outputs: PWM_MAIN_FUNCn and CA_SV_CSi_TYPE",
        partial(changed, f"{FLY} 7", px4_outputs),
    ),
    "c172p_yaw_output": Recipe(
        "JSBSim C172P at 100 kt, through north, with the yaw angle as output",
        partial(flown, f"{FLY} 8 --heading-deg 0"),
        {"rate": 10, "forgetting": 1.0, "output": "yaw", "method": "rml", "also": "els"},
    ),
    "c172p_aileron": Recipe(
        "JSBSim C172P at 100 kt, rudder and aileron both moved on purpose and both inputs",
        with_aileron,
        {"rate": 10, "forgetting": 1.0, "inputs": "rudder,aileron", "method": "rml", "also": "els"},
    ),
    "c172p_gaps": Recipe(
        "JSBSim C172P at 100 kt, the link silent for 0.8, 4 and 15 s",
        partial(changed, f"{FLY} 9", with_gaps),
        floor=600,
    ),
    "c172p_reboot": Recipe(
        "JSBSim C172P at 100 kt, the autopilot rebooted in flight, unannounced",
        partial(
            flown_twice,
            f"{FLY} 10 --boot-s 400 --seconds 50",
            f"{FLY} 11 --boot-s 8 --seconds 50",
            partial(after, pause_s=7.0),
        ),
    ),
    "c172p_uint32_wrap": Recipe(
        "JSBSim C172P at 100 kt, servo time wrapping after 71.6 minutes, 50 s into the flight",
        partial(flown, f"{FLY} 12 --boot-s {UINT32_WRAP_S - 50.0:.3f}"),
    ),
    "two_vehicles": Recipe(
        "two JSBSim C172Ps on one link, at 100 and at 80 kt, and a ground station; the second "
        "asked",
        partial(flown_twice, f"{FLY} 13", f"{FLY} 14 --speed-kt 80 --boot-s 700", two_vehicles),
        {"rate": 10, "forgetting": 1.0, "sysid": 2},
    ),
    "c172p_garbage": Recipe(
        "JSBSim C172P at 100 kt, rubbish at the start and between the records, the end torn",
        partial(changed, f"{FLY} 15", partial(littered, seed=16)),
    ),
    "c172p_signed": Recipe(
        "JSBSim C172P at 100 kt, every frame signed, read without the key",
        partial(changed, f"{FLY} 17", partial(rewrite, key=KEY)),
    ),
    "no_rudder": Recipe(
        "JSBSim C172P reported as a flying wing with elevons: no rudder at all",
        partial(changed, f"{FLY} 18 --seconds 20", no_rudder, has_truth=False),
        floor=0,
    ),
    "sitl_fbwa_50hz": Recipe(
        f"{SITL} flown in FBWA, doublets, 3-2-1-1, PRBS and sweep, trimmed by tools/trim_tlog.py; "
        "recorded for yawid",
        partial(cut, "sitl_fbwa_50hz", 76.5, 255.0, SITL_TRUTH | {"segments_boot_s": SEGMENTS}),
        _EXCITED | {"from": 86.5, "to": 253.9},
        floor=4000,
        licence=SITL_MIT,
        recorded=True,
    ),
    "sitl_fbwa_stock_33hz": Recipe(
        f"{SITL} flown in FBWA on the stock loop, intervals of 20 and 40 ms mixed, trimmed by "
        "tools/trim_tlog.py; recorded for yawid",
        partial(cut, "sitl_fbwa_stock_33hz", 76.8, 255.0, SITL_TRUTH),
        _EXCITED | {"from": 86.9, "to": 254.0, "method": "rml", "also": "els"},
        floor=4000,
        licence=SITL_MIT,
        recorded=True,
    ),
    "sitl_fbwa_manoeuvres": Recipe(
        f"{SITL} flown in FBWA on the stock loop, the same flight as manoeuvres; see truth.json: "
        "10.22 rad/s and 0.630 as flown, trimmed by tools/trim_tlog.py; recorded for yawid",
        partial(cut, "sitl_fbwa_stock_33hz", 70.0, 263.0, SITL_TRUTH),
        {},
        floor=3000,
        licence=SITL_MIT,
        recorded=True,
        manoeuvres=True,
    ),
    "sitl_auto": Recipe(
        f"{SITL} flying an AUTO mission, nothing excited on purpose, trimmed by "
        "tools/trim_tlog.py; recorded for yawid",
        partial(cut, "sitl_auto_25hz", 60.0, 360.0, None),
        {},
        floor=5000,
        licence=SITL_MIT,
        recorded=True,
    ),
}
