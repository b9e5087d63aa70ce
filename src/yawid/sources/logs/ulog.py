"""PX4's on-board log (.ulg), read by pyulog, as the MAVLink messages that the channels read.

| topic | becomes |
|---|---|
| actuator_outputs | SERVO_OUTPUT_RAW; the instance is the port |
| actuator_outputs_sim | HIL_ACTUATOR_CONTROLS |
| actuator_controls_0, or vehicle_torque_setpoint | ACTUATOR_CONTROL_TARGET |
| input_rc | RC_CHANNELS |
| vehicle_status | HEARTBEAT, with ``custom_mode`` as PX4 would send it |
| airspeed, ground speed, altitude | VFR_HUD |
| vehicle_land_detected, vtol_vehicle_status | EXTENDED_SYS_STATE |
| vehicle_angular_velocity, vehicle_attitude | ATTITUDE |
| vehicle_acceleration, or sensor_combined | ACCELERATION, the lateral one |

ACTUATOR_CONTROL_TARGET of a VTOL is the fixed-wing's instance. ATTITUDE has a row for each row of
vehicle_angular_velocity, at its sampling time, with the angles of vehicle_attitude interpolated
between two of its rows; older logs have the rates in vehicle_attitude itself, or in
sensor_combined. A standard log has actuator_outputs at 10 Hz and vehicle_torque_setpoint at 50 Hz:
``--rudder control:2`` reads the latter.
"""

import contextlib
import io
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from yawid.blocks import FIRST_DATE_US, Array, Floats, FrameBlock, Ints, MessageBlock, euler
from yawid.errors import SourceError
from yawid.quantities.airspeed import density_ratio, equivalent_of_true, known
from yawid.quantities.link import LinkStats
from yawid.quantities.vehicles import (
    AIRSPEED_GIVEN,
    ARMED,
    FIXED_WING,
    IN_AIR,
    LANDED,
    PX4,
    ROTORS,
    TO_ROTORS,
    TO_WINGS,
    VTOL_TYPES,
    WINGS,
    px4_custom_modes,
)
from yawid.sources.logs.as_mavlink import (
    COMPID,
    FIX_3D,
    NONE,
    PlacedFields,
    angles_at,
    frame_block,
    in_pieces,
    merged,
    message,
    quiet,
    steady,
    table,
    within,
)

_AIRSPEED = ("calibrated_airspeed_m_s", "equivalent_airspeed_m_s", "indicated_airspeed_m_s")
_TRUE = "true_airspeed_m_s"
"""True airspeed is converted by the air's density; it is only used without any of the others."""
_GPS = ("vehicle_gps_position", "sensor_gps")
_TOPICS = (
    *("vehicle_attitude", "vehicle_angular_velocity", "sensor_combined", "vehicle_status"),
    "vehicle_acceleration",
    *("actuator_outputs", "actuator_outputs_sim", "actuator_controls_0", "actuator_controls_1"),
    *("vehicle_torque_setpoint", "input_rc", "airspeed_validated", "airspeed"),
    *("vehicle_local_position", "vehicle_global_position", "vehicle_air_data", *_GPS),
    *("vehicle_land_detected", "vtol_vehicle_status"),
)
_ARMED_STATE = 2
_ROTARY_WING, _FIXED_WING = 1, 2  # vehicle_status.vehicle_type
_NOTHING = NONE, np.zeros(0)
UlogTopic = Mapping[str, Array]
_NO_ROWS: UlogTopic = {"timestamp": NONE}
_OLDEST_SAMPLE_US = 1_000_000  # no sample is published later than this


class UlogReader:
    """A ULog; the module's docstring lists the messages made from it.

    Messages come in the order of their times of publication; parameters known at the start come
    first. ``received_us`` is Unix time by the median of GPS time minus boot time, or the boot time
    without GPS. The whole log is read at once by pyulog; a torn or damaged log gives what pyulog
    finds in it.

    Raises:
        SourceError: pyulog is missing, or can read nothing of the file.
    """

    @quiet()
    def __init__(self, path: Path) -> None:
        self._path = path
        self._log = parsed(path, _TOPICS)
        self._topics = topics_of(self._log)
        self._unix_us = self._unix_minus_boot_us()
        self._status = self._topics.get(("vehicle_status", 0), _NO_ROWS)
        self._sysid = self._first("system_id", "MAV_SYS_ID") or 1
        self._blocks = list(self._in_order(dict(self._messages())))

    @property
    def link(self) -> LinkStats:
        """The counts of messages in the topics read; pyulog does not count what it passes over."""
        times = [topic["timestamp"] for topic in self._topics.values() if len(topic["timestamp"])]
        found = sum(len(t) for t in times)
        ends = [int(t.min()) for t in times] + [int(t.max()) for t in times]
        return LinkStats(
            frames=found,
            first_us=min(ends) + self._unix_us if ends else None,
            last_us=max(ends) + self._unix_us if ends else None,
            senders={(self._sysid, COMPID): found},
        )

    @property
    def vehicle_id(self) -> str | None:
        """The autopilot's unique number, None where the log does not have it."""
        own = self._log.msg_info_dict.get("sys_uuid")
        return f"uuid:{own}" if isinstance(own, str) and own else None

    def read(self) -> Iterator[tuple[int, FrameBlock | None]]:
        """Yield (bytes, messages) from the start."""
        total = sum(len(block) for block in self._blocks)
        for size, low, high in in_pieces(self._path, total):
            yield size, frame_block(within(block, low, high) for block in self._blocks)

    def _messages(self) -> Iterator[tuple[str, PlacedFields]]:
        """Yield each message's name, the times of its rows and their fields."""
        yield "HEARTBEAT", self._heartbeats()
        yield "PARAM_VALUE", self._parameters()
        yield "VFR_HUD", self._hud()
        yield "EXTENDED_SYS_STATE", system_state(self._topics)
        yield "ATTITUDE", self._attitude()
        yield "ACCELERATION", self._acceleration()
        yield "SERVO_OUTPUT_RAW", self._servos()
        yield "ACTUATOR_CONTROL_TARGET", self._controls()
        simulated = self._topics.get(("actuator_outputs_sim", 0), _NO_ROWS)
        name, controls = "HIL_ACTUATOR_CONTROLS", array(simulated, "output", 16)
        yield name, _timed(name, simulated, controls=controls)
        stick = self._topics.get(("input_rc", 0), _NO_ROWS)
        values = array(stick, "values", 18)
        columns = {f"chan{i + 1}_raw": values[:, i] for i in range(18)}
        yield "RC_CHANNELS", _timed("RC_CHANNELS", stick, **columns)

    def _in_order(self, parts: Mapping[str, PlacedFields]) -> Iterator[MessageBlock]:
        """Yield the blocks; each row's ``order`` is its rank among all rows by time.

        Rows of equal time come in the order of ``parts``.
        """
        times = np.concatenate([t for t, _ in parts.values()])
        place = np.empty(len(times), np.int64)
        place[np.argsort(times, kind="stable")] = np.arange(len(times))
        start = 0
        for name, (t_us, fields) in parts.items():
            order = place[start : start + len(t_us)]
            start += len(t_us)
            rows = np.argsort(order)
            received = t_us[rows] + self._unix_us
            yield message(name, order[rows], received, fields[rows], self._sysid)

    def _first(self, column: str, parameter: str) -> int:
        """Return vehicle_status's first number in a column, else a parameter, 0 without either."""
        reported = [*self._status.get(column, ())[:1], self._log.initial_parameters.get(parameter)]
        sound = (int(n) for n in reported if isinstance(n, int | np.integer) and 0 <= n <= 255)
        return next(sound, 0)

    def _vehicle_type(self) -> int:
        kind = self._first("system_type", "MAV_TYPE")
        flies_as = self._status.get("vehicle_type", NONE)
        return kind or (FIXED_WING if (flies_as == _FIXED_WING).any() else 0)

    def _heartbeats(self) -> PlacedFields:
        """Return a HEARTBEAT for the state at the start, then one for each vehicle_status."""
        status = self._status
        n = len(status["timestamp"])
        armed = status.get("arming_state", np.full(n, _ARMED_STATE)) == _ARMED_STATE
        mode = status.get("nav_state", np.zeros(n))
        if n == 0:
            armed, mode = np.ones(1, bool), np.zeros(1)
        rows = np.concatenate([[0], np.arange(n)])
        fields = table(
            "HEARTBEAT",
            n + 1,
            type=self._vehicle_type(),
            autopilot=PX4,
            base_mode=np.where(armed[rows], ARMED, 0),
            custom_mode=px4_custom_modes(mode[rows]),
        )
        return np.concatenate([[-1], published(status)]), fields

    def _parameters(self) -> PlacedFields:
        reported = [(-1, name, value) for name, value in self._log.initial_parameters.items()]
        reported += self._log.changed_parameters
        reported = [(t, n, v) for t, n, v in reported if isinstance(v, int | float)]
        fields = table(
            "PARAM_VALUE",
            len(reported),
            param_id=[name.encode()[:16] for _, name, _ in reported],
            param_value=[float(value) for _, _, value in reported],
        )
        return np.array([t for t, _, _ in reported], np.int64), fields

    def _hud(self) -> PlacedFields:
        """Return a VFR_HUD at each time at which a column of it is reported, the others held."""
        air, kind = self._airspeed()
        heights = ("vehicle_global_position", "alt"), ("vehicle_air_data", "baro_alt_meter")
        height, _ = next(self._known(*heights), (_NOTHING, ""))
        ground = self._over_ground()
        columns = {"airspeed": air, "groundspeed": ground, "alt": height}
        return merged("VFR_HUD", np.nan, {"airspeed_kind": kind}, **columns)

    def _having(self, *wanted: Sequence[str]) -> Iterator[tuple[UlogTopic, Sequence[str]]]:
        """Yield those of the topics that have the columns named after them."""
        for name, *columns in wanted:
            topic = self._topics.get((name, 0), {})
            if {*columns} <= topic.keys():
                yield topic, columns

    def _known(self, *wanted: Sequence[str]) -> Iterator[tuple[tuple[Ints, Floats], str]]:
        """Yield times, values and name of those columns that have any number."""
        for topic, (column,) in self._having(*wanted):
            if np.isfinite(topic[column]).any():
                yield (published(topic), topic[column].astype(float)), column

    def _airspeed(self) -> tuple[tuple[Ints, Floats], float]:
        """Return the best airspeed that has any number, and the kind of airspeed it is."""
        topics = "airspeed_validated", "airspeed"
        wanted = [*itertools.product(topics, _AIRSPEED), *itertools.product(topics, (_TRUE,))]
        for (t_us, speed), column in self._known(*wanted):
            if np.isfinite(known(speed)).any():
                if column == _TRUE:
                    speed = equivalent_of_true(speed, self._density_ratio(t_us))
                return (t_us, speed), AIRSPEED_GIVEN["ULog", column]
        return _NOTHING, np.nan

    def _density_ratio(self, t_us: Ints) -> Floats:
        """Return the air's density over that at sea level (n,) at times in us, NaN if unknown."""
        air = self._topics.get(("vehicle_air_data", 0), {})
        nothing = np.full(len(t_us), np.nan)
        if not len(air.get("timestamp", ())):
            return nothing
        newest = np.searchsorted(published(air), t_us, side="right") - 1
        rho, height = (
            np.where(newest >= 0, air[name][newest], np.nan) if name in air else nothing
            for name in ("rho", "baro_alt_meter")
        )
        return density_ratio(height, rho)

    def _over_ground(self) -> tuple[Ints, Floats]:
        """Return the ground speed in m/s: that of PX4's position estimate, else that of GPS."""
        for position, _ in self._having(("vehicle_local_position", "vx", "vy")):
            t_us = published(position)
            is_known = position.get("v_xy_valid", np.ones(len(t_us))) != 0
            if is_known.any():
                return t_us, np.where(is_known, np.hypot(position["vx"], position["vy"]), np.nan)
        for topic, _ in self._having(*((name, "vel_m_s", "fix_type") for name in _GPS)):
            fixed = topic["fix_type"] >= FIX_3D
            return published(topic), np.where(fixed, topic["vel_m_s"], np.nan).astype(float)
        return _NOTHING

    def _attitude(self) -> PlacedFields:
        attitude = self._topics.get(("vehicle_attitude", 0), _NO_ROWS)
        names = ("rollspeed", "pitchspeed", "yawspeed")
        for topic, columns in self._having(
            ("vehicle_angular_velocity", *(f"xyz[{i}]" for i in range(3))),
            ("vehicle_attitude", *names),
            ("sensor_combined", *(f"gyro_rad[{i}]" for i in range(3))),
        ):
            known = {rate: topic[c] for rate, c in zip(names, columns, strict=True)}
            known |= angles_at(
                sampled(topic), sampled(attitude), *euler(*array(attitude, "q", 4).T)
            )
            return _timed("ATTITUDE", topic, sampled(topic), **known)
        return NONE, table("ATTITUDE", 0)

    def _acceleration(self) -> PlacedFields:
        wanted = ("vehicle_acceleration", "xyz[1]"), ("sensor_combined", "accelerometer_m_s2[1]")
        for topic, (column,) in self._having(*wanted):
            return _timed("ACCELERATION", topic, sampled(topic), yacc=topic[column])
        return NONE, table("ACCELERATION", 0)

    def _servos(self) -> PlacedFields:
        parts = [(NONE, table("SERVO_OUTPUT_RAW", 0))]
        for (name, port), topic in self._topics.items():
            if name == "actuator_outputs":
                values = array(topic, "output", 16)
                columns = {f"servo{i + 1}_raw": values[:, i] for i in range(16)}
                parts.append(_timed("SERVO_OUTPUT_RAW", topic, port=port, **columns))
        return np.concatenate([t for t, _ in parts]), np.concatenate([f for _, f in parts])

    def _controls(self) -> PlacedFields:
        is_vtol = self._status.get("is_vtol", NONE).any() or self._vehicle_type() in VTOL_TYPES
        for own in (1, 0) if is_vtol else (0,):
            # Roll, pitch and yaw have the same indices in both.
            wanted = (
                (f"actuator_controls_{own}", 0, "control"),
                ("vehicle_torque_setpoint", own, "xyz"),
            )
            for name, instance, column in wanted:
                if (topic := self._topics.get((name, instance))) is not None:
                    controls = array(topic, column, 8)
                    return _timed("ACTUATOR_CONTROL_TARGET", topic, controls=controls)
        return NONE, table("ACTUATOR_CONTROL_TARGET", 0)

    def _unix_minus_boot_us(self) -> int:
        for topic, _ in self._having(*((name, "time_utc_usec") for name in _GPS)):
            utc = topic["time_utc_usec"].astype(np.int64)
            is_known = utc > FIRST_DATE_US
            if is_known.any():
                return int(np.median((utc - published(topic))[is_known]))
        return 0


def _timed(
    name: str, topic: UlogTopic, t_us: Ints | None = None, /, **columns: Any
) -> PlacedFields:
    """Return a message at each row; its time is that of publication, where it is not ``t_us``."""
    places = published(topic)
    return places, table(name, len(places), time_usec=places if t_us is None else t_us, **columns)


def parsed(path: Path, topics: Iterable[str]) -> Any:
    """Return pyulog's ULog with these topics.

    Raises:
        SourceError: pyulog is missing, or can read none of the topics.
    """
    try:
        from pyulog import ULog
    except ImportError as error:
        raise SourceError(
            f"{path} is a PX4 ULog: reading it needs pyulog (pip install 'yawid[ulog]')"
        ) from error
    said = io.StringIO()
    try:
        # pyulog prints reports of damage to stdout, which is for our results.
        with path.open("rb") as file, contextlib.redirect_stdout(said):
            log = ULog(file, list(topics))
    except Exception as error:  # whatever pyulog raises at a damaged byte
        raise SourceError(f"{path} cannot be read as a ULog ({error}): copy it again") from error
    if not log.data_list:
        raise SourceError(f"{path} is a ULog that holds none of the topics needed")
    return log


def topics_of(log: Any) -> dict[tuple[str, int], UlogTopic]:
    """Return the topics by name and instance; each has columns (n,) by name."""
    found: dict[tuple[str, int], UlogTopic] = {}
    for topic in log.data_list:
        if "timestamp" not in topic.data:
            continue
        rows = steady(topic.data["timestamp"].astype(np.int64))
        columns = {name: column[rows] for name, column in topic.data.items()}
        found[topic.name, topic.multi_id] = columns
    return found


def published(topic: UlogTopic) -> Ints:
    """Return the times (n,) at which the rows were published, in us since boot."""
    return topic["timestamp"].astype(np.int64)


def sampled(topic: UlogTopic) -> Ints:
    """Return the times (n,) in us since boot of sampling or, where unknown, of publication."""
    t_us = published(topic)
    sampled = topic.get("timestamp_sample", np.zeros(len(t_us))).astype(np.int64)
    return np.where((sampled > 0) & (np.abs(t_us - sampled) < _OLDEST_SAMPLE_US), sampled, t_us)


def array(topic: UlogTopic, name: str, size: int) -> Floats:
    """Return the columns name[0], name[1], ... as (n, size), NaN where the log has fewer."""
    nothing = np.full(len(topic["timestamp"]), np.nan)
    columns = [topic.get(f"{name}[{i}]", nothing) for i in range(size)]
    with quiet():
        return np.stack(columns, axis=1).astype(float)


def system_state(topics: Mapping[tuple[str, int], UlogTopic]) -> PlacedFields:
    """Return an EXTENDED_SYS_STATE at each report of a column; the other one keeps its value."""
    land = topics.get(("vehicle_land_detected", 0), {})
    landed = _NOTHING
    if "landed" in land:
        landed = published(land), np.where(land["landed"] != 0, LANDED, IN_AIR).astype(float)
    return merged("EXTENDED_SYS_STATE", 0.0, landed_state=landed, vtol_state=_vtol(topics))


def _vtol(topics: Mapping[tuple[str, int], UlogTopic]) -> tuple[Ints, Floats]:
    """Return the state of a VTOL by vtol_vehicle_status, else by the vehicle type at the time."""
    own = topics.get(("vtol_vehicle_status", 0), {})
    if "vehicle_vtol_state" in own:
        return published(own), own["vehicle_vtol_state"].astype(float)
    if {"vtol_in_rw_mode", "vtol_in_trans_mode", "in_transition_to_fw"} <= own.keys():
        settled = np.where(own["vtol_in_rw_mode"] != 0, ROTORS, WINGS)
        turning = np.where(own["in_transition_to_fw"] != 0, TO_WINGS, TO_ROTORS)
        state = np.where(own["vtol_in_trans_mode"] != 0, turning, settled)
        return published(own), state.astype(float)
    status = topics.get(("vehicle_status", 0), {})
    if {"is_vtol", "vehicle_type"} <= status.keys() and status["is_vtol"].any():
        on_rotors = status["vehicle_type"] == _ROTARY_WING
        return published(status), np.where(on_rotors, ROTORS, WINGS).astype(float)
    return _NOTHING
