"""Turns a flight into the MAVLink frames of a telemetry link, with their receive stamps."""

from __future__ import annotations

import importlib
import math
import socket
import time
from collections.abc import Iterable, Iterator
from dataclasses import astuple
from typing import TYPE_CHECKING, Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flights.plan import FOOT, KNOT, SENSED, SENSED_MS, FlightPlan, Floats, Link, Servo
from flights.surgery import Encoder, Record

if TYPE_CHECKING:
    from flights.flight import Flight

EPOCH_US = 1_700_000_000_000_000  # the receive clock when the flight starts
VEHICLE, GCS = (1, 1), (255, 190)
"""The ids of the two senders."""
FBWA = 5
DISARMED = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
ARMED = DISARMED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED
"""The base modes of an aeroplane."""
AILERON, ELEVATOR, THROTTLE, RUDDER = 4, 19, 70, 21  # SERVOn_FUNCTION of servos 1 to 4


class Played:
    """A replacement of a flight: it has the properties that telemetry reads, computed beforehand.

    ``columns`` are properties (n,) by their names in JSBSim, with a value for each ``step_ms``;
    what lies in between is interpolated. ``aileron`` and ``rudder`` (n,) are the outputs in units,
    which stay for a step. ``noises`` (m, 6) are those of the sensors, each for SENSED_MS; without
    them the link draws noise.
    """

    def __init__(
        self,
        plan: FlightPlan,
        columns: dict[str, Floats],
        outputs: dict[str, Floats],
        step_ms: int = 1,
        noises: Floats | None = None,
    ) -> None:
        self.plan, self.columns, self.outputs, self.noises = plan, columns, outputs, noises
        self._step_ms = step_ms

    def advance_to(self, ms: int) -> None:
        """Advance to a millisecond after the start."""
        self._at, rest_ms = divmod(ms, self._step_ms)
        self._share = rest_ms / self._step_ms
        rudder, aileron = (float(self.outputs[name][self._at]) for name in ("rudder", "aileron"))
        self.rudder_us, self.aileron_us = (
            self.plan.rudder.pulse(rudder), self.plan.aileron.pulse(aileron)
        )  # fmt: skip
        self.noise = None if self.noises is None else self.noises[ms // SENSED_MS].tolist()

    def __getitem__(self, name: str) -> float:
        """Return the present value of a property by its name in JSBSim."""
        column = self.columns[name]
        here = float(column[self._at])
        return here + self._share * (float(column[self._at + 1]) - here) if self._share else here


def telemetry(link: Link, flight: Flight | Played) -> Iterator[Record]:
    """Fly and yield (receive stamp in us of Unix time, MAVLink frame), stamps never decreasing.

    The link keeps the order. It has latency, jitter, and some stalls, at whose end all frames that
    wait arrive at once.
    """
    rng = np.random.default_rng(link.seed)
    version = 10 if link.mavlink1 else 20
    dialect = importlib.import_module(f"pymavlink.dialects.v{version}.ardupilotmega")
    encoder = Encoder(dialect=dialect)
    arrival_us = stalled_us = 0
    for ms, name, index in schedule(flight.plan, link, rng):
        flight.advance_to(ms)
        message = getattr(dialect, f"MAVLink_{name.removeprefix('gcs_')}_message")
        said = message(*values(name, ms, index, link, flight, rng))
        frame = encoder.frame(said, GCS if name == "gcs_heartbeat" else VEHICLE)
        sent_us = EPOCH_US + 1000 * ms
        if rng.random() < 0.002:
            stalled_us = sent_us + int(rng.uniform(30_000, 150_000))
        delayed_us = sent_us + 3_000 + int(rng.exponential(1_500.0))
        arrival_us = max(arrival_us, stalled_us, delayed_us)
        yield arrival_us, frame


def schedule(plan: FlightPlan, link: Link, rng: np.random.Generator) -> list[tuple[int, str, int]]:
    """Return (millisecond after the start, message, its count) in the order of sending.

    As in an autopilot, each stream has its own phase, and messages are sent up to 2 ms late.
    """
    streams = [
        ("heartbeat", 1.0, 0),
        ("gcs_heartbeat", 1.0, 440),
        ("attitude", link.attitude_hz, 2),
        ("servo_output_raw", link.servo_hz, link.servo_ms),
        ("vfr_hud", 4.0, 9),
    ]
    end_ms = int(1000 * plan.seconds)
    events = [(100 + 10 * i, "param_value", i) for i in range(len(parameters(plan)))]
    for name, hz, phase_ms in streams:
        due = np.arange(phase_ms, end_ms - 2, 1000.0 / hz).astype(int)
        late = rng.integers(0, 3, len(due))
        events += [(int(ms), name, i) for i, ms in enumerate(due + late)]
    return sorted(event for event in events if event[0] <= end_ms)


def parameters(plan: FlightPlan) -> list[tuple[str, float]]:
    """Return KFF_RDDRMIX, which is 0, the SERVOn parameters of four servos, and the plan's own."""
    servos = [
        (AILERON, plan.aileron),
        (ELEVATOR, Servo()),
        (THROTTLE, Servo(1000, 1001, 2000)),
        (RUDDER, plan.rudder),
    ]
    names = ("FUNCTION", "MIN", "TRIM", "MAX", "REVERSED")
    of_servos = [
        (f"SERVO{n}_{name}", float(value))
        for n, (function, servo) in enumerate(servos, start=1)
        for name, value in zip(names, (function, *astuple(servo)), strict=True)
    ]
    return [("KFF_RDDRMIX", 0.0), *of_servos, *plan.parameters]


def values(
    name: str, ms: int, index: int, link: Link, flight: Flight | Played, rng: np.random.Generator
) -> tuple[Any, ...]:
    """Return the values of the fields of a message that is sent now.

    ATTITUDE has the true angles and rates with the noise of the flight's sensors, else that of the
    link. A servo message is sent within the millisecond of its command.
    """
    boot_ms = ms + round(1000 * link.boot_s)
    throttle = flight["fcs/throttle-cmd-norm"]
    match name:
        case "attitude":
            true = np.array([flight[each] for each in SENSED])
            said = true + (flight.noise or rng.normal(0.0, link.sigmas))
            said[2] = math.remainder(said[2], math.tau)
            return boot_ms % 2**32, *said
        case "servo_output_raw":
            boot_us = 1000 * boot_ms + int(rng.integers(0, 1000))  # it wraps after 71.6 min
            outputs = flight.aileron_us, 1500, 1000 + round(1000 * throttle), flight.rudder_us
            return boot_us % 2**32, 0, *outputs, 0, 0, 0, 0
        case "vfr_hud":
            return (
                flight["velocities/vc-kts"] * KNOT, flight["velocities/vg-fps"] * FOOT,
                round(math.degrees(flight["attitude/psi-rad"])) % 360, round(100 * throttle),
                flight["position/h-sl-ft"] * FOOT, flight["velocities/h-dot-fps"] * FOOT,
            )  # fmt: skip
        case "param_value":
            sent = parameters(flight.plan)
            key, value = sent[index]
            kind = "INT16" if key.startswith("SERVO") else "REAL32"
            number = getattr(mavlink, f"MAV_PARAM_TYPE_{kind}")
            return key.encode(), value, number, len(sent), index
        case "heartbeat":
            plane = mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
            return *plane, ARMED, FBWA, mavlink.MAV_STATE_ACTIVE, 3
    return mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3


def send(frames: Iterable[Record], endpoint: tuple[str, int], speedup: float = 1.0) -> int:
    """Send each frame as a datagram at the pace of its stamps; return how many were sent.

    Those of a millisecond are sent together.
    """
    count, first_us, start_s = 0, None, time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        for stamp_us, frame in frames:
            first_us = stamp_us if first_us is None else first_us
            ahead_s = (stamp_us - first_us) / (1e6 * speedup) - (time.monotonic() - start_s)
            if ahead_s > 0.0:
                time.sleep(max(ahead_s, 0.001))
            sock.sendto(frame, endpoint)
            count += 1
    return count
