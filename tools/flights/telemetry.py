"""Turns a flight into the MAVLink frames of a telemetry link, with their receive stamps."""

from __future__ import annotations

import importlib
import math
import socket
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flights.plan import FOOT, KNOT, SENSED_MS, FlightPlan, Floats, Servo
from flights.surgery import Encoder, Record

if TYPE_CHECKING:
    from flights.flight import Flight

BURST_S = 0.001
EPOCH_US = 1_700_000_000_000_000  # the receive clock when the flight starts
VEHICLE, GCS = (1, 1), (255, 190)
"""The ids of the two senders."""
FBWA = 5
DISARMED = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
ARMED = DISARMED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED
"""The base modes of an aeroplane."""
AILERON, ELEVATOR, THROTTLE, RUDDER = 4, 19, 70, 21  # SERVOn_FUNCTION of servos 1 to 4


@dataclass(frozen=True, slots=True)
class Link:
    """The settings of a link: what is sent, and with which noise.

    Rates are in Hz. ``rate_noise`` and ``angle_noise`` are the standard deviations of ATTITUDE's
    noise in rad/s and rad. ``boot_s`` is the vehicle's time at the start of the flight, and
    ``servo_ms`` when the first servo message is sent.

    Raises:
        ValueError: a number is outside its limits.
    """

    attitude_hz: float = 50.0
    servo_hz: float = 50.0
    rate_noise: float = 0.002
    angle_noise: float = 0.001
    boot_s: float = 30.0
    mavlink1: bool = False
    seed: int = 1
    servo_ms: int = 5

    @property
    def sigmas(self) -> list[float]:
        """The standard deviations of the noise of ATTITUDE's angles and rates (6,)."""
        return [self.angle_noise] * 3 + [self.rate_noise] * 3

    def __post_init__(self) -> None:
        for name in ("attitude_hz", "servo_hz"):
            if not 0.0 < getattr(self, name) <= 200.0:
                raise ValueError(f"{name} must lie in (0, 200], got {getattr(self, name)!r}")
        for name in ("rate_noise", "angle_noise", "boot_s"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be >= 0 and finite, got {getattr(self, name)!r}")


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
        columns["attitude/psi-deg"] = np.degrees(columns["attitude/psi-rad"])
        self._step_ms = step_ms
        self.advance_to(0)

    def advance_to(self, ms: int) -> None:
        """Advance to a millisecond after the start."""
        self._at, rest_ms = divmod(ms, self._step_ms)
        self._share, at = rest_ms / self._step_ms, self._at
        self.rudder_us = self.plan.rudder.pulse(float(self.outputs["rudder"][at]))
        self.aileron_us = self.plan.aileron.pulse(float(self.outputs["aileron"][at]))
        noises = self.noises
        self.noise = None if noises is None else noises[ms // SENSED_MS].tolist()

    def __getitem__(self, name: str) -> float:
        """Return the present value of a property by its name in JSBSim."""
        column = self.columns[name]
        here = float(column[self._at])
        return here + self._share * (float(column[self._at + 1]) - here) if self._share else here


class Receiver:
    """The receive stamps of a link that keeps the order: latency, jitter, and some stalls."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._last_us = 0
        self._stalled_until_us = 0

    def stamp(self, sent_us: int) -> int:
        """Return the stamp of the next frame; frames that wait for the end of a stall share one."""
        if self._rng.random() < 0.002:
            self._stalled_until_us = sent_us + int(self._rng.uniform(30_000, 150_000))
        arrival_us = sent_us + 3_000 + int(self._rng.exponential(1_500.0))
        self._last_us = max(self._last_us, self._stalled_until_us, arrival_us)
        return self._last_us


def telemetry(link: Link, flight: Flight | Played) -> Iterator[tuple[int, bytes]]:
    """Fly and yield (receive stamp in us of Unix time, MAVLink frame), stamps never decreasing."""
    rng = np.random.default_rng(link.seed)
    version = "v10" if link.mavlink1 else "v20"
    dialect = importlib.import_module(f"pymavlink.dialects.{version}.ardupilotmega")
    messages = Messages(dialect, link, flight, rng)
    encoder, receiver = Encoder(dialect=dialect), Receiver(rng)
    for ms, name, index in schedule(flight.plan, link, rng):
        flight.advance_to(ms)
        ids = GCS if name == "gcs_heartbeat" else VEHICLE
        frame = encoder.frame(getattr(messages, name)(ms, index), ids)
        yield receiver.stamp(EPOCH_US + 1000 * ms), frame


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
    events = [(100 + 10 * i, "parameter", i) for i in range(len(parameters(plan)))]
    for name, hz, phase_ms in streams:
        due = np.arange(phase_ms, end_ms - 2, 1000.0 / hz).astype(int)
        late = rng.integers(0, 3, len(due))
        events += [(int(ms), name, i) for i, ms in enumerate(due + late)]
    return sorted(event for event in events if event[0] <= end_ms)


def parameters(plan: FlightPlan) -> list[tuple[str, float]]:
    """Return KFF_RDDRMIX, which is 0, the SERVOn parameters of four servos, and the plan's own."""
    outputs = [
        (AILERON, plan.aileron),
        (ELEVATOR, Servo()),
        (THROTTLE, Servo(1000, 1001, 2000)),
        (RUDDER, plan.rudder),
    ]
    found = [("KFF_RDDRMIX", 0.0)]
    for n, (function, servo) in enumerate(outputs, start=1):
        values = (function, servo.min_us, servo.trim_us, servo.max_us, servo.reverse)
        names = ("FUNCTION", "MIN", "TRIM", "MAX", "REVERSED")
        found += [(f"SERVO{n}_{name}", float(v)) for name, v in zip(names, values, strict=True)]
    return [*found, *plan.parameters]


class Messages:
    """The messages that the vehicle or the ground station would send now."""

    def __init__(
        self, dialect: Any, link: Link, flight: Flight | Played, rng: np.random.Generator
    ) -> None:
        self._dialect, self._link, self._flight, self._rng = dialect, link, flight, rng
        self._parameters = parameters(flight.plan)

    def heartbeat(self, ms: int, index: int) -> Any:
        """Return the HEARTBEAT of the armed aeroplane."""
        plane = mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        return self._heartbeat(*plane, ARMED, FBWA)

    def gcs_heartbeat(self, ms: int, index: int) -> Any:
        """Return the HEARTBEAT of the ground station, which is no vehicle."""
        return self._heartbeat(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0)

    def _heartbeat(self, *of: int) -> Any:
        return self._dialect.MAVLink_heartbeat_message(*of, mavlink.MAV_STATE_ACTIVE, 3)

    def parameter(self, ms: int, index: int) -> Any:
        """Return PARAM_VALUE number ``index``."""
        name, value = self._parameters[index]
        whole = name.startswith("SERVO")
        kind = mavlink.MAV_PARAM_TYPE_INT16 if whole else mavlink.MAV_PARAM_TYPE_REAL32
        of = name.encode(), value, kind, len(self._parameters), index
        return self._dialect.MAVLink_param_value_message(*of)

    def attitude(self, ms: int, index: int) -> Any:
        """Return ATTITUDE: the true angles and body rates plus sensor noise."""
        flight, link = self._flight, self._link
        yaw = math.remainder(flight["attitude/psi-rad"], math.tau)
        rates = (flight[f"velocities/{axis}-rad_sec"] for axis in "pqr")
        true = [flight["attitude/phi-rad"], flight["attitude/theta-rad"], yaw, *rates]
        said = np.array(true) + (flight.noise or self._rng.normal(0.0, link.sigmas))
        said[2] = math.remainder(said[2], math.tau)
        boot_ms = (ms + round(1000 * link.boot_s)) % 2**32
        return self._dialect.MAVLink_attitude_message(boot_ms, *said)

    def servo_output_raw(self, ms: int, index: int) -> Any:
        """Return SERVO_OUTPUT_RAW: the servo outputs of this instant."""
        flight = self._flight
        # Sent within the millisecond of the command; the time wraps after 71.6 min.
        boot_us = 1000 * (ms + round(1000 * self._link.boot_s)) + int(self._rng.integers(0, 1000))
        throttle_us = 1000 + round(1000 * flight["fcs/throttle-cmd-norm"])
        servos = [flight.aileron_us, 1500, throttle_us, flight.rudder_us, 0, 0, 0, 0]
        return self._dialect.MAVLink_servo_output_raw_message(boot_us % 2**32, 0, *servos)

    def vfr_hud(self, ms: int, index: int) -> Any:
        """Return VFR_HUD: speeds, heading in whole degrees, throttle, altitude, climb rate."""
        flight = self._flight
        return self._dialect.MAVLink_vfr_hud_message(
            flight["velocities/vc-kts"] * KNOT,
            flight["velocities/vg-fps"] * FOOT,
            round(flight["attitude/psi-deg"]) % 360,
            round(100 * flight["fcs/throttle-cmd-norm"]),
            flight["position/h-sl-ft"] * FOOT,
            flight["velocities/h-dot-fps"] * FOOT,
        )


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
                time.sleep(max(ahead_s, BURST_S))
            sock.sendto(frame, endpoint)
            count += 1
    return count
