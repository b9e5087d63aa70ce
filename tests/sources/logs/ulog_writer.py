"""A ULog as the file format is written down: header, definitions, subscriptions, data."""

from __future__ import annotations

import struct

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
            self._parameter(key, value)
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

    def change(self, key: str, value: float) -> None:
        """Append a parameter changed in flight."""
        self._parameter(key, value)

    def sync(self) -> None:
        self._message("S", SYNC)

    def _parameter(self, key: str, value: float) -> None:
        kind = "int32_t" if isinstance(value, int) else "float"
        named = f"{kind} {key}".encode()
        packed = struct.pack(f"<{CODES[kind]}", value)
        self._message("P", bytes([len(named)]) + named + packed)

    def _message(self, kind: str, body: bytes) -> None:
        self._out += struct.pack("<HB", len(body), ord(kind)) + body
