"""ULogs written by the file format's own description, with pyulog and the flight as the truth."""

from __future__ import annotations

import builtins
import contextlib
import hashlib
import io
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from flightlog import Samples, samples_of
from hypothesis import example, given
from hypothesis import strategies as st
from printed import why_invalid
from pymavlink import mavutil
from sources.logs.onboard_flight import (
    assert_same_samples,
    flown,
    lateral_accelerations,
    samples_from,
)
from sources.logs.ulog_flight import (
    PARAMETERS,
    UNIX_S,
    columns,
    flight,
    logged,
    telemetry,
    us,
    whole,
    written,
)
from sources.logs.ulog_writer import ULogFile

from yawid.answers.heard import VehicleSeen
from yawid.config.run import RunConfig
from yawid.errors import SourceError
from yawid.pipeline import Pipeline
from yawid.quantities.airspeed import Kind
from yawid.quantities.vehicles import PX4, mode_name, px4_custom_modes
from yawid.runs.inspect_log import inspect
from yawid.runs.job import open_log
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay
from yawid.sources.logs.as_mavlink import table
from yawid.sources.logs.ulog import UlogReader

NAN = math.nan


@pytest.fixture
def ulg(tmp_path: Path) -> Path:
    return written(tmp_path, whole())


def samples(path: Path, **settings: str) -> Samples:
    return samples_from(UlogReader(path), RunConfig(**settings))


def test_the_samples_are_those_of_the_telemetry_log_of_the_same_flight(ulg: Path):
    assert_same_samples(samples(ulg), samples_of(telemetry(flight()).data))


def test_the_replay_names_the_rudder_by_the_parameters(ulg: Path, tmp_path: Path):
    log = ulg.rename(tmp_path / "flight.tlog")
    summary = replay(log, {"memory": math.inf}, Outputs(tmp_path, "out"), StopFlag())
    verdict = summary.verdict

    assert verdict.exit_code == 0, verdict.reasons
    assert summary.sha256 == hashlib.sha256(whole()).hexdigest()
    assert why_invalid("replay", summary.to_json()) == ""
    assert summary.vehicle == VehicleSeen(sysid=7, compid=1, type=1, autopilot=12)
    rudder = summary.channels["rudder"]
    assert (rudder.source, rudder.how) == ("SERVO_OUTPUT_RAW.servo3_raw", "parameter")
    assert (rudder.min_us, rudder.trim_us, rudder.max_us) == (1100, 1500, 1900)
    found = summary.estimates["els"].dutch_roll.wn_rad_s
    assert found == pytest.approx(4.0, rel=0.02)


def test_every_row_is_what_pyulog_reads(ulg: Path):
    from pyulog import ULog

    log, mine = ULog(str(ulg)), columns(ulg)
    outputs = log.get_dataset("actuator_outputs").data
    rates = log.get_dataset("vehicle_angular_velocity").data

    assert not log.file_corruption
    np.testing.assert_array_equal(mine["SERVO_OUTPUT_RAW"]["time_usec"], outputs["timestamp"])
    np.testing.assert_array_equal(mine["SERVO_OUTPUT_RAW"]["servo3_raw"], outputs["output[2]"])
    np.testing.assert_array_equal(mine["ATTITUDE"]["time_usec"], rates["timestamp_sample"])
    for i, name in enumerate(("rollspeed", "pitchspeed", "yawspeed")):
        np.testing.assert_array_equal(mine["ATTITUDE"][name], rates[f"xyz[{i}]"])
    told = {row["param_id"].decode(): row["param_value"] for row in mine["PARAM_VALUE"]}
    assert told == log.initial_parameters


def test_altitude_and_the_speed_by_gps_come_with_the_hud(tmp_path: Path):
    log = ULogFile({})
    log.add("vehicle_gps_position", 1000, us(UNIX_S), 12.0, 3)
    log.add("vehicle_global_position", 2000, 321.5)
    log.add("vehicle_gps_position", 3000, us(UNIX_S), 15.0, 1)
    mine = columns(written(tmp_path, log.data))["VFR_HUD"]

    assert mine["groundspeed"].tolist() == [12.0, 12.0, 12.0]  # without a fix no speed is known
    np.testing.assert_array_equal(mine["alt"], [np.nan, 321.5, 321.5])


def test_the_estimators_speed_goes_before_that_of_gps(tmp_path: Path):
    log = ULogFile({})
    log.add("vehicle_gps_position", 1000, us(UNIX_S), 12.0, 3)
    log.add("vehicle_local_position", 2000, 3.0, 4.0, True)
    mine = columns(written(tmp_path, log.data))["VFR_HUD"]
    assert mine["groundspeed"].tolist() == [5.0]


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
    mine = columns(written(tmp_path, log.data))["VFR_HUD"]

    assert mine["airspeed"][-1] == pytest.approx(expected, rel=1e-6)
    assert mine["airspeed_kind"].tolist() == [float(kind)] * len(mine)


def told(mine: np.ndarray) -> list[tuple[int, int]]:
    return list(zip(mine["landed_state"].tolist(), mine["vtol_state"].tolist(), strict=True))


def test_landed_and_hovering_come_as_the_system_state(tmp_path: Path):
    log = ULogFile({})
    log.add("vehicle_land_detected", 1000, True)
    log.add("vtol_vehicle_status", 2000, 3)
    log.add("vehicle_land_detected", 3000, False)
    log.add("vtol_vehicle_status", 4000, 4)
    mine = columns(written(tmp_path, log.data))["EXTENDED_SYS_STATE"]

    assert told(mine) == [(1, 0), (1, 3), (2, 3), (2, 4)]


def test_a_vtol_without_a_status_of_its_own_is_what_its_type_is_just_now(tmp_path: Path):
    for is_vtol, expected in ((True, [(0, 3), (0, 4)]), (False, [])):
        log = ULogFile({})
        for t, kind in ((1000, 1), (2000, 2)):  # rotary wing, fixed wing
            log.add("vehicle_status", t, 2, 0, 21, 1, is_vtol, kind)
        mine = columns(written(tmp_path, log.data))
        assert told(mine.get("EXTENDED_SYS_STATE", table("EXTENDED_SYS_STATE", 0))) == expected


@pytest.mark.parametrize(
    ("landed", "state"), [(True, "on ground"), (False, "airborne"), (None, None)]
)
def test_nobody_flies_by_an_airspeed_of_zero_alone(landed, state, tmp_path: Path):
    log = ULogFile(PARAMETERS)
    if landed is not None:
        log.add("vehicle_land_detected", 500, landed)
    for k in range(1500):
        log.add("vehicle_angular_velocity", 20_000 * k + 1000, 0, [0, 0, 0.1])
        log.add("actuator_outputs", 20_000 * k + 1010, [1500, 1500, 1500 + k % 50], 3)
        log.add("airspeed_validated", 20_000 * k + 1020, 0.0)
    report = inspect(written(tmp_path, log.data), {})

    assert {phase.state for phase in report.phases[-1:]} == {state}


def test_angles_are_those_flown(ulg: Path):
    mine = columns(ulg)["ATTITUDE"][::5]
    for name in ("roll", "pitch", "yaw"):
        away = mine[name][:-1] - getattr(flight(), name)[::5][:-1]
        np.testing.assert_allclose(np.angle(np.exp(1j * away)), 0.0, atol=1e-6)


def test_unix_time_is_that_of_gps(ulg: Path):
    link = UlogReader(ulg).link
    assert link.first_us == us(UNIX_S + flight().t[0]) - 100 - 500
    assert link.last_us is not None
    assert link.last_us - link.first_us == pytest.approx(60e6, abs=30_000)


def test_the_autopilots_own_number_is_the_vehicles_id(ulg: Path, tmp_path: Path):
    key, number = b"char[4] sys_uuid", b"00ab"
    body = bytes([len(key)]) + key + number
    info = struct.pack("<HB", len(body), ord("I")) + body
    first = 16 + 3 + 40  # magic, time and flags come before all else
    named = tmp_path / "named.ulg"
    named.write_bytes(whole()[:first] + info + whole()[first:])

    assert open_log(named).vehicle_id == "uuid:00ab"
    assert open_log(ulg).vehicle_id is None


def test_torque_setpoint_stands_where_the_controls_stood(tmp_path: Path):
    for topic, values in (
        ("vehicle_torque_setpoint", lambda u: (0, [0.1, 0.0, u])),
        ("actuator_controls_0", lambda u: ([0.1, 0.0, u],)),
    ):
        log = ULogFile({"MAV_TYPE": 1})
        for k in range(1500):
            log.add("vehicle_angular_velocity", 20_000 * k, 0, [0, 0, 0.1 * math.sin(0.02 * k)])
            log.add(topic, 20_000 * k + 10, *values(0.25 * (k // 50 % 2)))
        found = samples(written(tmp_path, log.data))

        assert found.channels.surfaces[0].source == "ACTUATOR_CONTROL_TARGET.controls[2]"
        known = found.u[np.isfinite(found.u)]
        assert (known.min(), known.max()) == (0.0, 0.25)


def test_a_vtol_is_steered_by_its_fixed_wing_setpoint(tmp_path: Path):
    log = ULogFile({})
    log.add("vehicle_status", 1, 2, 0, 22, 1, True)
    for k in range(3):
        log.add("vehicle_torque_setpoint", 1000 * k + 5, 0, [0, 0, 0.9], instance=0)
        log.add("vehicle_torque_setpoint", 1000 * k + 6, 0, [0, 0, 0.2], instance=1)
    mine = columns(written(tmp_path, log.data))["ACTUATOR_CONTROL_TARGET"]
    np.testing.assert_allclose(mine["controls"][:, 2], 0.2, rtol=1e-6)
    assert np.isnan(mine["controls"][:, 3:]).all()


def test_outputs_of_each_instance_are_a_port(tmp_path: Path):
    log = ULogFile({})
    for k in range(3):
        log.add("actuator_outputs", 1000 * k, [1100, 1200], instance=0)
        log.add("actuator_outputs", 1000 * k + 1, [1300, 1400], instance=1)
    log.add("actuator_outputs_sim", 5000, [-0.5, 0.5])
    log.add("input_rc", 5000, 8, [1000 + i for i in range(18)])
    mine = columns(written(tmp_path, log.data))

    servos = mine["SERVO_OUTPUT_RAW"]
    assert servos[["port", "servo2_raw"]].tolist() == [(0, 1200.0), (1, 1400.0)] * 3
    assert mine["HIL_ACTUATOR_CONTROLS"]["controls"][0, :2].tolist() == [-0.5, 0.5]
    assert mine["RC_CHANNELS"]["chan18_raw"].tolist() == [1017]


def test_a_parameter_changed_in_flight_holds_from_there_on(tmp_path: Path):
    log = logged(flown(4.0))
    log.change("PWM_MAIN_MAX3", 2000)
    log.add("actuator_outputs", us(30.0), [1500])
    blocks = [
        frames.messages["PARAM_VALUE"]
        for _, frames in UlogReader(written(tmp_path, log.data)).read()
        if frames is not None and "PARAM_VALUE" in frames.messages
    ]
    order = np.concatenate([block.order for block in blocks])
    value = np.concatenate([block.fields["param_value"] for block in blocks])

    assert order[:-1].max() <= len(PARAMETERS)
    assert order[-1] > 200
    assert value[-1] == 2000.0


def test_modes_and_arming_come_with_the_status(tmp_path: Path):
    log = ULogFile({})
    for k, (armed, mode) in enumerate([(1, 0), (2, 0), (2, 3), (1, 3)]):
        log.add("vehicle_status", 1000 * k, armed, mode, 1, 1)
    beats = columns(written(tmp_path, log.data))["HEARTBEAT"]
    assert (beats["base_mode"] & 128).tolist() == [0, 0, 128, 128, 0]
    names = [mode_name(PX4, 1, mode) for mode in beats["custom_mode"].tolist()]
    assert names == ["MANUAL"] * 3 + ["MISSION"] * 2


@pytest.mark.parametrize("name", sorted(set(mavutil.px4_map) - {"RATTITUDE", "RTGS"}))
def test_every_mode_that_a_vehicle_sends_by_name_is_known_from_its_log(name: str):
    _, main, sub = mavutil.px4_map[name]
    assert main << 16 | sub << 24 in px4_custom_modes(np.arange(256)).tolist()
    assert mode_name(PX4, 1, main << 16 | sub << 24) == name


def test_a_mode_without_a_name_is_its_number_and_no_other_mode():
    modes = px4_custom_modes(np.arange(256))
    assert len(set(modes.tolist())) == 256
    assert mode_name(PX4, 1, modes[21]) == "mode 21"


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


def test_rates_of_older_logs_come_from_the_gyro(tmp_path: Path):
    log = ULogFile({})
    for k in range(5):
        log.add("sensor_combined", 1000 * k, [0.1, 0.2, 0.3])
    mine = columns(written(tmp_path, log.data))["ATTITUDE"]
    np.testing.assert_allclose(mine["yawspeed"], 0.3, rtol=1e-6)
    assert np.isnan(mine["yaw"]).all()


def test_order_rises_through_the_log_whatever_the_message(ulg: Path):
    low = -1
    for _, frames in UlogReader(ulg).read():
        orders = np.sort(np.concatenate([b.order for b in frames.messages.values()]))
        np.testing.assert_array_equal(orders, np.arange(low + 1, low + 1 + len(orders)))
        low = orders[-1]


@pytest.mark.parametrize("cut", [1, 100, 20_001])
def test_a_torn_log_gives_what_came_before_the_tear(tmp_path: Path, cut: int):
    complete = columns(written(tmp_path, whole()))["SERVO_OUTPUT_RAW"]
    torn = columns(written(tmp_path, whole()[:-cut]))["SERVO_OUTPUT_RAW"]
    assert 0 < len(complete) - len(torn) <= 1 + cut // 100 or cut == 1
    assert (torn == complete[: len(torn)]).all()


@example(173264)  # a NaN that signals
@given(st.integers(0, 2**32 - 1))
def test_flipped_bytes_are_read_or_refused_in_silence(tmp_path: Path, seed: int):
    rng = np.random.default_rng(seed)
    data = np.frombuffer(logged(flown(2.0)).data, np.uint8).copy()
    where = rng.choice(np.arange(8, len(data)), 30, replace=False)
    data[where] ^= rng.integers(1, 256, 30, np.uint8)
    said, pipeline = io.StringIO(), Pipeline(RunConfig())
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        with contextlib.suppress(SourceError):
            for _, frames in UlogReader(written(tmp_path, data.tobytes())).read():
                pipeline.feed(frames)
        pipeline.finish()
    assert said.getvalue() == ""


def test_a_log_of_other_topics_is_refused_in_one_line(tmp_path: Path):
    log = ULogFile({})
    log.add("unrelated_topic", 5)
    for data, text in ((log.data, "none of the topics"), (log.data[:9], "cannot be read")):
        with pytest.raises(SourceError, match=text) as caught:
            open_log(written(tmp_path, data))
        assert "\n" not in str(caught.value)


def test_without_pyulog_the_user_is_told_what_to_install(ulg: Path, monkeypatch):
    found = builtins.__import__

    def refuse(name: str, *args: object, **kwargs: object) -> object:
        if name == "pyulog":
            raise ImportError(name)
        return found(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(SourceError, match=r"pip install 'yawid\[ulog\]'"):
        UlogReader(ulg)
