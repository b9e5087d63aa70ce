"""The yaw channel: from the best message that reports it to rows of yaw rate, yaw, roll and more.

A yaw rate from headings alone, which is coarse and slow, comes from a constant-velocity Kalman
filter (of filterpy): its state is (yaw, yaw rate), driven by white angular acceleration.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from yawid.blocks import Array, Floats, Held, Ints, MessageBlock, RecordBlock, euler
from yawid.channels.clock import OwnClock, boot_us
from yawid.channels.flight_state import LEAST_AIRSPEED, FlightState, SlowFlight, TakeOff
from yawid.channels.motion_reader import COLUMNS, attitude_columns, record_columns
from yawid.channels.series import Series
from yawid.channels.stick_fallback import Wait
from yawid.quantities.airspeed import GRAVITY, known, over_ground
from yawid.quantities.table import of_kind

ABSURD_RAD_S = 50.0
"""A faster rate, or a larger angle, is corrupted: no aircraft turns eight times a second."""
STEEPEST = np.deg2rad(80.0)
"""The greatest pitch at which Euler's formula for the heading rate is used."""
UPRIGHT = np.deg2rad(60.0)
"""The greatest bank or pitch at which a model that is linear in small angles holds. Autopilots bank
to 60 degrees and overshoot a little."""
LINEAR = of_kind("linear")
ROW = (*LINEAR, *of_kind("held"), "by_ground", "barred")
"""The columns of a yaw row: those of LINEAR are interpolated, all others held from message to
message. ``by_ground`` is 1 where the airspeed is the ground speed; ``barred`` has the bits of
:class:`yawid.blocks.Held` for which a row must not update the estimators."""
ON_GROUND, MODE = ROW.index("on_ground"), ROW.index("mode")

FINE_STD = float(np.deg2rad(0.3))
"""The sigma of headings rounded to 0.01 degrees: it is that of the autopilot's own filter."""
WHOLE_DEGREES_STD = float(np.hypot(FINE_STD, np.deg2rad(1.0) / np.sqrt(12.0)))
"""The sigma of headings in whole degrees: rounding adds the sigma of a uniform error."""
ACCELERATION_PSD = 1.0
"""The spectral density of the angular acceleration in rad^2/s^3, of a small aircraft in
manoeuvres."""
LONGEST_S = 2.0
"""The longest silence in s after which the filter goes on; after a longer one it starts again."""

Fields = Array


def _attitude(f: Fields) -> Floats:
    return _angles(f["roll"], f["pitch"], f["yaw"], f["pitchspeed"], f["yawspeed"])


def _quaternion(f: Fields) -> Floats:
    w, x, y, z = (np.asarray(f[f"q{i}"], float) for i in range(1, 5))
    return _angles(*euler(w, x, y, z), f["pitchspeed"], f["yawspeed"])


def _gyro(f: Fields, scale: float = 1.0) -> Floats:
    rates = (scale * np.asarray(f[name], float) for name in ("ygyro", "zgyro"))
    return _angles(*np.full((3, len(f)), np.nan), *rates)


def _heading(degrees: Floats) -> Floats:
    unknown = np.full(len(degrees), np.nan)
    yaw = np.deg2rad((degrees + 180.0) % 360.0 - 180.0)
    return _angles(unknown, unknown, yaw, unknown, unknown)


def _angles(*rows: Any) -> Floats:
    """Return the rows as (5, n), NaN where a value is absurd or not finite."""
    angles = np.array(rows, float)
    return np.where(np.abs(angles) < ABSURD_RAD_S, angles, np.nan)


SOURCES: dict[str, tuple[str, Callable[[Fields], Floats]]] = {
    "ATTITUDE": ("yawspeed", _attitude),
    "ATTITUDE_QUATERNION": ("yawspeed", _quaternion),
    "HIGHRES_IMU": ("zgyro", _gyro),
    "SCALED_IMU": ("zgyro", partial(_gyro, scale=1e-3)),
    "RAW_IMU": ("zgyro", partial(_gyro, scale=1e-3)),
    "GLOBAL_POSITION_INT": (
        "hdg",
        lambda f: _heading(np.where(f["hdg"] == 65535, np.nan, f["hdg"] / 100.0)),
    ),
    "VFR_HUD": ("heading", lambda f: _heading(np.asarray(f["heading"], float))),
}
"""By message, the field and its reader, the best first; RAW_IMU is in mrad/s as ArduPilot sends it.

A reader returns (5, n): roll, pitch and yaw in rad, pitch and yaw rate about the body's axes in
rad/s; NaN where unknown. VFR_HUD is the last choice: its heading is in whole degrees and has no
time."""
COARSE = {"GLOBAL_POSITION_INT": FINE_STD, "VFR_HUD": WHOLE_DEGREES_STD}
"""The sources that report a heading alone, and its sigma in rad."""
UNTIMED = "VFR_HUD"
"""The source without a time of its own."""


@dataclass(slots=True)
class YawReader:
    """The reader of the best source received so far.

    With ``heading_rate`` the rate is that of the heading, by Euler's formula, instead of yaw rate;
    with ``all_flown`` no row of a record is on the ground. With ``motion`` the columns of an
    attitude follow those of ``ROW``, and of a record the acceleration too.
    """

    heading_rate: bool = False
    all_flown: bool = False
    motion: bool = False
    source: str | None = None
    column: str = ""
    rows: int = 0
    _turns: int = 0
    _last_yaw: float | None = None
    _slope: "HeadingRate | None" = None
    _wait: Wait = field(default_factory=Wait)
    _last_us: int | None = None
    _flight: SlowFlight = field(default_factory=SlowFlight)
    _take_off: TakeOff = field(default_factory=TakeOff)

    @property
    def label(self) -> str:
        """The message field that is read, or a record's column."""
        if self.source is None:
            return self.column
        return f"{self.source}.{SOURCES[self.source][0]}"

    def wait(self, clock: OwnClock) -> None:
        """Count the wait for a better source than VFR_HUD by the clock of another message."""
        self._wait.observe(clock.readings.order, clock.readings.us)

    def better(self, messages: Mapping[str, MessageBlock]) -> tuple[str, int] | None:
        """Return the first better source among these messages and its first place, else None."""
        ranks = list(SOURCES)
        worst = len(ranks) if self.source is None else ranks.index(self.source)
        places = {n: self._useful(messages[n]) for n in ranks[:worst] if n in messages}
        found = [(int(order[0]), name) for name, order in places.items() if len(order)]
        if not found:
            return None
        order, name = min(found)
        return name, order

    def _useful(self, block: MessageBlock) -> Ints:
        """Return the places of the rows by which this message can be a source."""
        rows = np.ones(len(block), bool)
        if block.name == "GLOBAL_POSITION_INT":
            rows = block.fields["hdg"] != 65535
        elif block.name == UNTIMED:
            over = self._wait.over_at
            reported = over is not None and "heading" in (block.fields.dtype.names or ())
            rows = (block.order >= (over or 0)) & reported
        places: Ints = block.order[rows]
        return places

    def switch_to(self, source: str) -> None:
        """Read another source from now on."""
        self.source = source
        self._slope = HeadingRate(COARSE[source]) if source in COARSE else None

    def read(
        self, messages: Mapping[str, MessageBlock], context: FlightState, clock: OwnClock
    ) -> Series:
        """Return the rows of the source's messages, NaN where a value is absurd or not finite.

        A source without a time gets that of ``clock``, the clock of another message.
        """
        if self.source is None or self.source not in messages:
            return Series.empty(len(ROW) + self.motion * len(COLUMNS))
        block = messages[self.source]
        if self.source == UNTIMED:
            block, t_us = self._timed_by(block, clock)
        else:
            t_us = boot_us(block.fields)
        with np.errstate(over="ignore", invalid="ignore"):
            # A float may hold any bits: an absurd value becomes NaN, and its sample is held.
            roll, pitch, yaw, q, r = SOURCES[self.source][1](block.fields)
        unwrapped = self._unwrap(yaw)
        rate = r if self._slope is None else self._slope.of(t_us, unwrapped)
        if self.heading_rate and self._slope is None:
            rate = _heading_rate(roll, pitch, q, r)
        row = context.at(block.order) | {"r": rate, "yaw": unwrapped, "roll": roll}
        row["turn_rate"] = _turn_rate(row["airspeed"], roll, pitch)
        row["on_ground"] = self._take_off.rolls(row["on_ground"], roll, row["altitude"])
        steep = np.maximum(np.abs(roll), np.abs(pitch)) > UPRIGHT
        row["barred"] = row["barred"] + int(Held.STEEP) * steep
        self.rows += len(block)
        values = np.column_stack([row[name] for name in ROW])
        if self.motion:
            known = {"roll": roll, "pitch": pitch, "q": q, "r": r}
            columns = attitude_columns(self.source, block.fields, known)
            values = np.hstack([values, np.where(np.abs(columns) < ABSURD_RAD_S, columns, np.nan)])
        return Series(block.order, block.received_us, t_us, values)

    def read_record(self, block: RecordBlock, lost: Ints) -> Series:
        """Return a row for each row of a record that has yaw.

        Where the record has ``held`` bits of its own, they are the whole of it: the bits ``lost``
        (n,), and those that the grid adds itself, are left out here, or they would count twice.
        """
        self.column = block.called["r"]
        if len(block) == 0:
            return Series.empty(len(ROW) + self.motion * (len(COLUMNS) + 1))
        has_held = block.held >= 0
        rate, unwrapped = _angles(block.r)[0], self._unwrap(block.yaw)
        level = np.where(np.isfinite(block.pitch), block.pitch, 0.0)
        if self.heading_rate:
            rate = _heading_rate(block.roll, level, block.q, rate)
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

    def _timed_by(self, block: MessageBlock, clock: OwnClock) -> tuple[MessageBlock, Ints]:
        """Return the rows at which the clock has advanced since the row before, and its times.

        Receive stamps cannot replace the clock, because messages come in bursts.
        """
        t_us = clock.readings.at(block.order)
        before = np.append(t_us[:1] - 1 if self._last_us is None else self._last_us, t_us)[:-1]
        self._last_us = int(t_us[-1])
        moved = t_us != before
        return block.select(moved), t_us[moved]

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


def _heading_rate(roll: Floats, pitch: Floats, q: Floats, r: Floats) -> Floats:
    """Return the rate of the heading (n,) in rad/s by Euler's formula."""
    upright = np.where(np.abs(pitch) < STEEPEST, np.cos(pitch), np.nan)
    rate: Floats = (q * np.sin(roll) + r * np.cos(roll)) / upright
    return rate


def _turn_rate(airspeed: Floats, roll: Floats, pitch: Floats) -> Floats:
    """Return the yaw rate (n,) in rad/s of a level turn with this bank, (g/V) sin(roll) cos(pitch).

    ``airspeed`` is in m/s; the rate is NaN where that is unknown or too low to fly.
    """
    speed = np.where(airspeed > LEAST_AIRSPEED, airspeed, np.nan)
    turn: Floats = GRAVITY / speed * np.sin(roll) * np.cos(pitch)
    return turn


@dataclass(slots=True)
class HeadingRate:
    """The filter, kept from block to block; ``heading_std`` is the sigma of a heading in rad."""

    heading_std: float = FINE_STD
    _filter: Any = None
    _last_us: int = 0

    def of(self, t_us: Ints, yaw: Floats) -> Floats:
        """Return the yaw rate (n,) in rad/s at times in us (n,) from the unwrapped yaw in rad (n,).

        It is NaN where the yaw is, and at each row at which the filter starts.
        """
        rate = np.full(len(yaw), np.nan)
        for i, (t, angle) in enumerate(zip(t_us.tolist(), yaw.tolist(), strict=True)):
            if not np.isfinite(angle):
                continue
            dt = (t - self._last_us) / 1e6
            if self._filter is None or not 0.0 < dt < LONGEST_S:
                self._filter = _new_filter(angle, self.heading_std)
            else:
                self._step(dt, angle)
                rate[i] = self._filter.x[1, 0]
            self._last_us = t
        return rate

    def _step(self, dt: float, angle: float) -> None:
        kalman = self._filter
        kalman.F = np.array([[1.0, dt], [0.0, 1.0]])
        kalman.Q = ACCELERATION_PSD * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        kalman.predict()
        kalman.update(angle)


def _new_filter(angle: float, heading_std: float) -> Any:
    from filterpy.kalman import KalmanFilter

    kalman = KalmanFilter(dim_x=2, dim_z=1)
    kalman.x = np.array([[angle], [0.0]])
    kalman.P = np.diag([heading_std**2, 1.0])
    kalman.H = np.array([[1.0, 0.0]])
    kalman.R = np.array([[heading_std**2]])
    return kalman
