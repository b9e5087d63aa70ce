"""The yaw channel: from the best message that reports it to rows of yaw rate, yaw and roll."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from yawid.blocks import Array, Floats, Held, Ints, MessageBlock, RecordBlock, euler
from yawid.channels.flight_state import LEAST_AIRSPEED, FlightState, SlowFlight, TakeOff
from yawid.channels.motion_reader import COLUMNS, record_columns
from yawid.channels.series import Series, boot_us
from yawid.quantities.airspeed import GRAVITY, known, over_ground
from yawid.quantities.table import of_kind

ABSURD_RAD_S = 50.0
"""A faster rate, or a larger angle, is corrupted: no aircraft turns eight times a second."""
UPRIGHT = np.deg2rad(60.0)
"""The greatest bank or pitch at which a model that is linear in small angles holds. Autopilots bank
to 60 degrees and overshoot a little."""
LINEAR = of_kind("linear")
ROW = (*LINEAR, *of_kind("held"), "by_ground", "barred")
"""The columns of a yaw row: those of LINEAR are interpolated, all others held from message to
message. ``by_ground`` is 1 where the airspeed is the ground speed; ``barred`` has the bits of
:class:`yawid.blocks.Held` for which a row must not update the estimators."""
ON_GROUND, MODE = ROW.index("on_ground"), ROW.index("mode")

RATES = ("rollspeed", "pitchspeed", "yawspeed")

Fields = Array


def _attitude(f: Fields) -> Floats:
    return _angles(f["roll"], f["pitch"], f["yaw"], *(f[name] for name in RATES))


def _quaternion(f: Fields) -> Floats:
    w, x, y, z = (np.asarray(f[f"q{i}"], float) for i in range(1, 5))
    return _angles(*euler(w, x, y, z), *(f[name] for name in RATES))


def _gyro(f: Fields, scale: float = 1.0) -> Floats:
    rates = (scale * np.asarray(f[name], float) for name in ("ygyro", "zgyro"))
    return _angles(*np.full((4, len(f)), np.nan), *rates)


def _angles(*rows: Any) -> Floats:
    """Return the rows as (6, n), NaN where a value is absurd or not finite."""
    angles = np.array(rows, float)
    return np.where(np.abs(angles) < ABSURD_RAD_S, angles, np.nan)


SOURCES: dict[str, tuple[str, Callable[[Fields], Floats]]] = {
    "ATTITUDE": ("yawspeed", _attitude),
    "ATTITUDE_QUATERNION": ("yawspeed", _quaternion),
    "HIGHRES_IMU": ("zgyro", _gyro),
    "SCALED_IMU": ("zgyro", partial(_gyro, scale=1e-3)),
    "RAW_IMU": ("zgyro", partial(_gyro, scale=1e-3)),
}
"""By message, the field and its reader, the best first; RAW_IMU is in mrad/s as ArduPilot sends it.

A reader returns (6, n): roll, pitch and yaw in rad, the rates p, q, r about the body's axes in
rad/s; NaN where unknown."""


@dataclass(slots=True)
class YawReader:
    """The reader of the best source received so far.

    With ``all_flown`` no row of a record is on the ground. With ``motion`` the columns of an
    attitude follow those of ``ROW``, and of a record the acceleration too.
    """

    all_flown: bool = False
    motion: bool = False
    source: str | None = None
    column: str = ""
    rows: int = 0
    _turns: int = 0
    _last_yaw: float | None = None
    _flight: SlowFlight = field(default_factory=SlowFlight)
    _take_off: TakeOff = field(default_factory=TakeOff)

    @property
    def label(self) -> str:
        """The message field that is read, or a record's column."""
        if self.source is None:
            return self.column
        return f"{self.source}.{SOURCES[self.source][0]}"

    @property
    def better(self) -> list[str]:
        """The sources that are better than the one that is read."""
        ranks = list(SOURCES)
        return ranks if self.source is None else ranks[: ranks.index(self.source)]

    def read(self, messages: Mapping[str, MessageBlock], context: FlightState) -> Series:
        """Return the rows of the source's messages, NaN where a value is absurd or not finite."""
        if self.source is None or self.source not in messages:
            return Series.empty(len(ROW) + self.motion * len(COLUMNS))
        block = messages[self.source]
        roll, pitch, yaw, p, q, r = SOURCES[self.source][1](block.fields)
        unwrapped = self._unwrap(yaw)
        row = context.at(block.order) | {"r": r, "yaw": unwrapped, "roll": roll}
        row["turn_rate"] = _turn_rate(row["airspeed"], roll, pitch)
        row["on_ground"] = self._take_off.rolls(row["on_ground"], roll, row["altitude"])
        steep = np.maximum(np.abs(roll), np.abs(pitch)) > UPRIGHT
        row["barred"] = row["barred"] + int(Held.STEEP) * steep
        self.rows += len(block)
        values = np.column_stack([row[name] for name in ROW])
        if self.motion:
            values = np.column_stack([values, roll, pitch, p, q, r])
        return Series(block.order, block.received_us, boot_us(block.fields), values)

    def read_record(self, block: RecordBlock, lost: Ints) -> Series:
        """Return a row for each row of a record that has yaw.

        Where the record has ``held`` bits of its own, they are the whole of it: the bits ``lost``
        (n,), and those that the grid adds itself, are left out here, or they would count twice.
        """
        self.column = block.called["r"]
        has_held = block.held >= 0
        rate, unwrapped = _angles(block.r)[0], self._unwrap(block.yaw)
        level = np.where(np.isfinite(block.pitch), block.pitch, 0.0)
        airspeed = known(block.airspeed)
        turn = np.where(has_held, block.turn_rate, _turn_rate(airspeed, block.roll, level))
        on_ground = np.where(has_held, block.on_ground, self._grounded(block))
        lost = lost + int(Held.YAW_INVALID) * np.isnan(rate)
        held = np.where(block.held > 0, block.held - lost, 0)
        held = held - int(Held.ON_GROUND) * (has_held & (on_ground == 1.0))
        on_ground = np.zeros(len(block)) if self.all_flown else on_ground
        steep = ~has_held & (np.maximum(np.abs(block.roll), np.abs(level)) > UPRIGHT)
        held = held + int(Held.STEEP) * steep
        self.rows += len(block)
        made = {
            "r": rate, "yaw": unwrapped, "turn_rate": turn, "airspeed": airspeed,
            "on_ground": on_ground, "ground_speed": over_ground(block.ground_speed), "barred": held,
        }  # fmt: skip
        columns = (made[name] if name in made else getattr(block, name) for name in ROW)
        values = np.column_stack([*columns])
        if self.motion:
            values = np.hstack([values, record_columns(block)])
        return Series(2 * block.order + 1, block.received_us, block.t_us, values)

    def _grounded(self, block: RecordBlock) -> Floats:
        """Return 1 on the ground, 0 in the air (n,): by speed and height if not in the record."""
        air = block.airspeed
        flies = self._flight.shows(block.altitude, air, block.ground_speed)
        flies |= air >= LEAST_AIRSPEED
        by_speed = np.where(flies, 0.0, np.where(air < LEAST_AIRSPEED, 1.0, np.nan))
        by_speed = self._take_off.rolls(by_speed, block.roll, block.altitude)
        return np.where(np.isfinite(block.on_ground), block.on_ground, by_speed)

    def _unwrap(self, yaw: Floats) -> Floats:
        """Return the yaw with whole turns added, which are counted so that blocks do not matter."""
        rows = np.flatnonzero(np.isfinite(yaw))
        if len(rows) == 0:
            return yaw
        known = yaw[rows]
        before = known[0] if self._last_yaw is None else self._last_yaw
        steps = np.diff(known, prepend=before)
        turns = self._turns - np.cumsum(np.rint(steps / (2.0 * np.pi))).astype(np.int64)
        self._turns, self._last_yaw = int(turns[-1]), float(known[-1])
        unwrapped = yaw.copy()
        unwrapped[rows] = known + 2.0 * np.pi * turns
        return unwrapped


def _turn_rate(airspeed: Floats, roll: Floats, pitch: Floats) -> Floats:
    """Return the yaw rate (n,) in rad/s of a level turn with this bank, (g/V) sin(roll) cos(pitch).

    ``airspeed`` is in m/s; the rate is NaN where that is unknown or too low to fly.
    """
    speed = np.where(airspeed > LEAST_AIRSPEED, airspeed, np.nan)
    return GRAVITY / speed * np.sin(roll) * np.cos(pitch)
