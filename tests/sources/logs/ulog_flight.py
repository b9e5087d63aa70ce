"""A ULog as PX4 writes one, the known flight in it, and in the telemetry log next to it."""

from __future__ import annotations

import math
import struct
from functools import cache

from flightlog import FlightLog
from sources.logs.onboard_flight import Flight, flight, telemetry_of, us

from yawid.sources.logs.ulog import UlogReader

CODES = {"uint64_t": "Q", "uint8_t": "B", "bool": "?", "float": "f", "int32_t": "i"}
SYNC = bytes([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12])
TOPICS = {
    # name: fields as uORB has them, timestamp first
    "vehicle_angular_velocity": ("uint64_t timestamp_sample", "float[3] xyz"),
    "vehicle_attitude": ("uint64_t timestamp_sample", "float[4] q"),
    "actuator_outputs": ("float[16] output", "uint8_t noutputs", "uint8_t[3] _padding0"),
    "actuator_outputs_sim": ("float[16] output",),
    "actuator_controls_0": ("float[8] control",),
    "actuator_controls_1": ("float[8] control",),
    "vehicle_torque_setpoint": ("uint64_t timestamp_sample", "float[3] xyz"),
    "sensor_combined": ("float[3] gyro_rad", "float[3] accelerometer_m_s2"),
    "vehicle_acceleration": ("uint64_t timestamp_sample", "float[3] xyz"),
    "input_rc": ("uint8_t channel_count", "float[18] values"),
    "vehicle_status": ("uint8_t arming_state", "uint8_t nav_state", "uint8_t system_type",
                       "uint8_t system_id", "bool is_vtol", "uint8_t vehicle_type"),
    "vehicle_land_detected": ("bool landed",),
    "vtol_vehicle_status": ("uint8_t vehicle_vtol_state",),
    "airspeed_validated": ("float calibrated_airspeed_m_s", "float true_airspeed_m_s"),
    "airspeed": ("float true_airspeed_m_s", "float indicated_airspeed_m_s"),
    "vehicle_air_data": ("float rho", "float baro_alt_meter"),
    "vehicle_local_position": ("float vx", "float vy", "bool v_xy_valid"),
    "vehicle_global_position": ("float alt",),
    "vehicle_gps_position": ("uint64_t time_utc_usec", "float vel_m_s", "uint8_t fix_type"),
    "unrelated_topic": ("float[32] noise",),
}  # fmt: skip


class ULogFile:
    """``data`` is the log: definitions first, then what was added, each topic when first used."""

    def __init__(self, parameters: dict[str, float]) -> None:
        self._out = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000))
        self._message("B", bytes(40))
        for name, fields in TOPICS.items():
            text = ";".join(("uint64_t timestamp", *fields))
            self._message("F", f"{name}:{text};".encode())
        for key, value in parameters.items():
            self.parameter(key, value)
        self._ids: dict[tuple[str, int], int] = {}

    @property
    def data(self) -> bytes:
        return bytes(self._out)

    def add(self, name: str, t_us: int, *values: object, instance: int = 0) -> None:
        """Append one publication; arrays are given as sequences, the rest is zero."""
        if (name, instance) not in self._ids:
            self._ids[name, instance] = len(self._ids)
            subscribed = struct.pack("<BH", instance, self._ids[name, instance]) + name.encode()
            self._message("A", subscribed)
        body = struct.pack("<HQ", self._ids[name, instance], t_us)
        given = iter(values)
        for field in TOPICS[name]:
            kind, label = field.split()
            base, _, size = kind.rstrip("]").partition("[")
            if label.startswith("_padding"):
                continue
            value = next(given, 0)
            column = value if isinstance(value, list | tuple) else [value]
            column = [*column, *([0] * (int(size or 1) - len(column)))]
            body += struct.pack(f"<{len(column)}{CODES[base]}", *column)
        self._message("D", body)

    def sync(self) -> None:
        self._message("S", SYNC)

    def parameter(self, key: str, value: float) -> None:
        kind = "int32_t" if isinstance(value, int) else "float"
        named = f"{kind} {key}".encode()
        packed = struct.pack(f"<{CODES[kind]}", value)
        self._message("P", bytes([len(named)]) + named + packed)

    def _message(self, kind: str, body: bytes) -> None:
        self._out += struct.pack("<HB", len(body), ord(kind)) + body


READER = UlogReader
UNIX_S = 1_700_000_000
PARAMETERS = {
    "MAV_TYPE": 1,
    "PWM_MAIN_FUNC3": 202,
    "PWM_MAIN_MIN3": 1100,
    "PWM_MAIN_MAX3": 1900,
    "CA_SV_CS1_TYPE": 4,
    "FW_AIRSPD_TRIM": 18.0,
}


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, ...]:
    (a, b, c), (x, y, z) = (
        [f(angle / 2) for angle in (roll, pitch, yaw)] for f in (math.cos, math.sin)
    )
    return (
        a * b * c + x * y * z,
        x * b * c - a * y * z,
        a * y * c + x * b * z,
        a * b * z - x * y * c,
    )


def logged(flight: Flight, airspeed_m_s: float = 18.5, **more: float) -> ULogFile:
    log = ULogFile(PARAMETERS | more)
    first = us(flight.t[0])
    log.add("vehicle_status", first - 100, 2, 0, 1, 7)
    for k, t in enumerate(flight.t):
        now = us(t)
        if k % 50 == 0:
            log.sync()
            log.add("vehicle_gps_position", now + 500, us(UNIX_S + t))
            log.add("unrelated_topic", now + 600)
        if k % 5 == 0:
            angles = flight.roll[k], flight.pitch[k], flight.yaw[k]
            log.add("vehicle_attitude", now + 300, now, quaternion(*angles))
        log.add("vehicle_angular_velocity", now + 200, now, list(map(float, flight.rates[k])))
        log.add("actuator_outputs", now + 4000, [1500, 1500, int(flight.pwm[k])], 3)
        if k % 10 == 0:
            log.add("airspeed_validated", now + 5000, airspeed_m_s)
            log.add("vehicle_local_position", now + 5100, 3.0, 4.0, True)
    return log


def telemetry(flight: Flight) -> FlightLog:
    return telemetry_of(flight, (12, 0), PARAMETERS, 3, 5.0)


@cache
def whole() -> bytes:
    return logged(flight()).data


def change(log: ULogFile, t_us: int) -> None:
    """Append a parameter that changes in flight."""
    log.parameter("PWM_MAIN_MAX3", 2000)
    log.add("actuator_outputs", t_us, [1500])
