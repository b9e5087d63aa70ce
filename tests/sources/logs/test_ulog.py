"""What the topics of a ULog become, checked by pyulog and by what was flown."""

from __future__ import annotations

import math
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil
from pyulog import ULog
from sources.logs.onboard_flight import (
    columns,
    flight,
    flown,
    lateral_accelerations,
    us,
    written,
)
from sources.logs.ulog_flight import UNIX_S, ULogFile, logged, whole

from yawid.errors import SourceError
from yawid.quantities.airspeed import Kind
from yawid.quantities.vehicles import PX4, mode_name, px4_custom_modes
from yawid.runs.job import open_log
from yawid.sources.logs.as_mavlink import table
from yawid.sources.logs.ulog import UlogReader

NAN = math.nan


def test_every_row_is_what_pyulog_reads_and_angles_are_those_flown(tmp_path: Path):
    path = written(tmp_path, whole())
    log, mine = ULog(str(path)), columns(UlogReader(path))
    outputs = log.get_dataset("actuator_outputs").data
    rates = log.get_dataset("vehicle_angular_velocity").data
    attitude = mine["ATTITUDE"]

    assert not log.file_corruption
    np.testing.assert_array_equal(mine["SERVO_OUTPUT_RAW"]["time_usec"], outputs["timestamp"])
    np.testing.assert_array_equal(mine["SERVO_OUTPUT_RAW"]["servo3_raw"], outputs["output[2]"])
    np.testing.assert_array_equal(attitude["time_usec"], rates["timestamp_sample"])
    for i, name in enumerate(("rollspeed", "pitchspeed", "yawspeed")):
        np.testing.assert_array_equal(attitude[name], rates[f"xyz[{i}]"])
    parameters = {row["param_id"].decode(): row["param_value"] for row in mine["PARAM_VALUE"]}
    assert parameters == log.initial_parameters
    for name in ("roll", "pitch", "yaw"):
        away = attitude[::5][name][:-1] - getattr(flight(), name)[::5][:-1]
        np.testing.assert_allclose(np.angle(np.exp(1j * away)), 0.0, atol=1e-6)


Added = tuple[Any, ...]
FIX, NO_FIX = (
    ("vehicle_gps_position", t, us(UNIX_S), v, n) for t, v, n in ((1000, 12.0, 3), (3000, 15.0, 1))
)
LANDINGS = [("vehicle_land_detected", 1000, True), ("vtol_vehicle_status", 2000, 3),
            ("vehicle_land_detected", 3000, False), ("vtol_vehicle_status", 4000, 4)]  # fmt: skip
PORTS = [
    ("actuator_outputs", 1000 * k + i, [1100 + 200 * i, 1200 + 200 * i], {"instance": i})
    for k in range(3)
    for i in range(2)
]
TORQUES = [
    ("vehicle_torque_setpoint", 1000 * k + 5 + i, 0, [0, 0, (0.9, 0.2)[i]], {"instance": i})
    for k in range(3)
    for i in range(2)
]
ARMINGS = [
    ("vehicle_status", 1000 * k, armed, mode, 1, 1)
    for k, (armed, mode) in enumerate([(1, 0), (2, 0), (2, 3), (1, 3)])
]


def statuses(is_vtol: bool) -> list[Added]:
    """A rotary wing, then a fixed wing."""
    return [("vehicle_status", 1000 * kind, 2, 0, 21, 1, is_vtol, kind) for kind in (1, 2)]


def states(rows: np.ndarray) -> list[list[int]]:
    return [rows["landed_state"].tolist(), rows["vtol_state"].tolist()]


def servos(rows: np.ndarray) -> list[list[float]]:
    return [rows["port"].tolist(), rows["servo2_raw"].tolist()]


def modes(rows: np.ndarray) -> list[str]:
    return [mode_name(PX4, 1, mode) for mode in rows["custom_mode"].tolist()]


@pytest.mark.parametrize(
    ("rows", "name", "read", "expected"),
    [
        # Without a fix no speed is known; the estimator's goes before that of GPS.
        ([FIX, ("vehicle_global_position", 2000, 321.5), NO_FIX], "VFR_HUD",
         lambda rows: [rows["groundspeed"], rows["alt"]], [[12.0] * 3, [NAN, 321.5, 321.5]]),
        ([FIX, ("vehicle_local_position", 2000, 3.0, 4.0, True)], "VFR_HUD",
         lambda rows: rows["groundspeed"], [5.0]),
        (LANDINGS, "EXTENDED_SYS_STATE", states, [[1, 1, 2, 2], [0, 3, 3, 4]]),
        # A VTOL without a status of its own is what its type is just now.
        (statuses(True), "EXTENDED_SYS_STATE", states, [[0, 0], [3, 4]]),
        (statuses(False), "EXTENDED_SYS_STATE", states, [[], []]),
        # A VTOL is steered by its fixed-wing setpoint.
        ([("vehicle_status", 1, 2, 0, 22, 1, True), *TORQUES], "ACTUATOR_CONTROL_TARGET",
         lambda rows: rows["controls"][:, 2:4], [[np.float32(0.2), NAN]] * 3),
        # A torque setpoint stands where the controls stood.
        *[
            ([row], "ACTUATOR_CONTROL_TARGET",
             lambda rows: rows["controls"][0, :3], np.float32([0.1, 0.0, 0.25]))
            for row in (
                ("vehicle_torque_setpoint", 5000, 0, [0.1, 0.0, 0.25]),
                ("actuator_controls_0", 5000, [0.1, 0.0, 0.25]),
            )
        ],
        (PORTS, "SERVO_OUTPUT_RAW", servos, [[0, 1] * 3, [1200.0, 1400.0] * 3]),
        ([("actuator_outputs_sim", 5000, [-0.5, 0.5])], "HIL_ACTUATOR_CONTROLS",
         lambda rows: rows["controls"][0, :2], [-0.5, 0.5]),
        ([("input_rc", 5000, 8, [1000 + i for i in range(18)])], "RC_CHANNELS",
         lambda rows: rows["chan18_raw"], [1017]),
        (ARMINGS, "HEARTBEAT", lambda rows: rows["base_mode"] & 128, [0, 0, 128, 128, 0]),
        (ARMINGS, "HEARTBEAT", modes, ["MANUAL"] * 3 + ["MISSION"] * 2),
        # Rates of older logs come from the gyro.
        ([("sensor_combined", 1000 * k, [0.1, 0.2, 0.25]) for k in range(5)], "ATTITUDE",
         lambda rows: [rows["yawspeed"], rows["yaw"]], [[0.25] * 5, [NAN] * 5]),
    ],
)  # fmt: skip
def test_topics_become_messages(
    rows: list[Added], name: str, read: Any, expected: Any, tmp_path: Path
):
    log = ULogFile({})
    for *row, last in rows:
        more = last if isinstance(last, dict) else {}
        log.add(*row, *([] if more else [last]), **more)
    mine = columns(UlogReader(written(tmp_path, log.data))).get(name, table(name, 0))
    np.testing.assert_array_equal(read(mine), expected)


@pytest.mark.parametrize(
    ("validated", "plain", "expected", "kind"),
    [
        ((18.0, 22.0), (21.0, 19.0), 18.0, Kind.CALIBRATED),
        ((NAN, 22.0), (21.0, 19.0), 19.0, Kind.INDICATED),
        ((0.0, 22.0), (21.0, 19.0), 19.0, Kind.INDICATED),  # a column of zeros is none
        ((NAN, 22.0), (21.0, NAN), 22.0 * math.sqrt(0.9 / 1.225), Kind.TRUE),
        ((NAN, NAN), (21.0, NAN), 21.0 * math.sqrt(0.9 / 1.225), Kind.TRUE),
    ],
)
def test_a_true_airspeed_is_the_last_resort_and_converted_by_the_air_s_density(
    tmp_path: Path,
    validated: tuple[float, float],
    plain: tuple[float, float],
    expected: float,
    kind: Kind,
):
    log = ULogFile({})
    log.add("vehicle_air_data", 500, 0.9, 3000.0)
    log.add("airspeed_validated", 1000, *validated)
    log.add("airspeed", 1000, *plain)
    mine = columns(UlogReader(written(tmp_path, log.data)))["VFR_HUD"]

    assert mine["airspeed"][-1] == pytest.approx(expected, rel=1e-6)
    assert mine["airspeed_kind"].tolist() == [float(kind)] * len(mine)


def test_the_autopilots_own_number_is_the_vehicles_id(tmp_path: Path):
    key, number = b"char[4] sys_uuid", b"00ab"
    body = bytes([len(key)]) + key + number
    info = struct.pack("<HB", len(body), ord("I")) + body
    first = 16 + 3 + 40  # magic, time and flags come before all else
    named = written(tmp_path, whole()[:first] + info + whole()[first:], "named.ulg")

    assert open_log(named).vehicle_id == "uuid:00ab"
    assert open_log(written(tmp_path, whole())).vehicle_id is None


def test_every_mode_that_a_vehicle_sends_by_name_is_known_from_its_log():
    numbers = px4_custom_modes(np.arange(256)).tolist()
    for name in {*mavutil.px4_map} - {"RATTITUDE", "RTGS"}:
        _, main, sub = mavutil.px4_map[name]
        assert main << 16 | sub << 24 in numbers, name
        assert mode_name(PX4, 1, main << 16 | sub << 24) == name
    assert len({*numbers}) == 256
    assert mode_name(PX4, 1, numbers[21]) == "mode 21"


@pytest.mark.parametrize("topic", ["vehicle_acceleration", "sensor_combined"])
def test_the_lateral_acceleration_is_in_the_motion_at_its_own_times(topic: str, tmp_path: Path):
    """A filtered acceleration has the time of its sample, which is before that of publication."""
    log = logged(flown(20.0))
    for k in range(100):
        acceleration, now = [1.0, 0.5 + k / 64, -9.8], us(21.0) + 10_000 * k
        if topic == "vehicle_acceleration":
            log.add(topic, now + 900, now + 300, acceleration)
        else:
            log.add(topic, now + 300, [0.0, 0.0, 0.0], acceleration)

    t_us, found = lateral_accelerations(UlogReader(written(tmp_path, log.data)))

    assert t_us == [us(21.0) + 10_000 * k + 300 for k in range(100)]
    assert found == [0.5 + k / 64 for k in range(100)]


def test_without_pyulog_the_user_is_told_what_to_install(tmp_path: Path, monkeypatch):
    path = written(tmp_path, whole())
    monkeypatch.setitem(sys.modules, "pyulog", None)
    with pytest.raises(SourceError, match=r"pip install 'yawid\[ulog\]'"):
        UlogReader(path)
