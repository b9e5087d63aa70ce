"""The context of the samples: airspeed, altitude, whether the aircraft flies, and its mode.

A VTOL is no aeroplane while it hovers, or while motors that only lift are driven. ArduPlane has
hover modes, and names its lift motors by SERVOn_FUNCTION; masks name those motors of a tilt-rotor
or a tail-sitter that also pull in forward flight. PX4 reports in EXTENDED_SYS_STATE whether a VTOL
hovers or flies on its wings.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Array, Bools, Floats, Held, Ints, MessageBlock
from yawid.channels.parameters import ParameterTable
from yawid.channels.series import Latest
from yawid.channels.surface import raw_output
from yawid.channels.vehicle import Vehicle, has_wings
from yawid.quantities.airspeed import known, over_ground
from yawid.quantities.vehicles import (
    AIRSPEED_GIVEN,
    ARDUPILOT,
    ARDUPLANE_HOVER,
    ARMED,
    LANDED,
    VTOL_TYPES,
    WINGS,
)

LEAST_AIRSPEED = 5.0
"""An aircraft with wings does not fly if airspeed and ground speed are below this, in m/s."""
LEAST_HEIGHT_M = 15.0
"""A slow aircraft flies from this height above its lowest place on: a barometer drifts by 10 m."""
LEAP_M = 30.0
"""An altitude that changes by more than this in one message has a new reference."""
FAR_M = 2.0**24
"""More than any altitude, and exact when added to one."""
LEAST_MOTION = 1.0
"""An aircraft with both speeds below this, in m/s, stands."""
BANKED_RAD, CLIMBED_M = np.deg2rad(5.0), 5.0
"""What an aircraft that was on the ground has to bank or climb to have left it: a runway tilts the
wings by less, and an aircraft that flies does either within seconds."""
AP_MOTORS = range(33, 41)
"""The SERVOn_FUNCTION of motors 1 to 8."""
DRIVEN = 0.05
"""A motor above this part of its range is driven: in forward flight ArduPilot keeps motors that are
armed and idle at their minimum."""
MOTOR_TRAVEL_US = 1000.0, 2000.0
"""The range of a motor's output where the parameters give none."""
OUTPUTS_PER_PORT = 16
"""The number of outputs in one SERVO_OUTPUT_RAW."""


def lift_motors(vehicle: Vehicle, table: ParameterTable) -> dict[int, float]:
    """Return the outputs (from 1) of motors that ArduPlane uses for lift alone.

    Each has the value in us above which it is driven; other vehicles do not name theirs. The
    range is that of Q_M_PWM_MIN, _MAX; before 4.0 of Q_THR_MIN_PWM, _MAX_PWM.
    """
    if vehicle.autopilot != ARDUPILOT or not has_wings(vehicle):
        return {}
    forward = int(table.get("Q_TILT_MASK", 0.0)) | int(table.get("Q_TAILSIT_MOTMX", 0.0))
    low, high = (
        table.get(f"Q_M_PWM_{end}", 0.0) or table.get(f"Q_THR_{end}_PWM", 0.0) or stock
        for end, stock in zip(("MIN", "MAX"), MOTOR_TRAVEL_US, strict=True)
    )
    low, high = (low, high) if 0.0 < low < high else MOTOR_TRAVEL_US
    return {
        number: low + DRIVEN * (high - low)
        for number, function in table.functions().items()
        if function in AP_MOTORS and not forward >> (function - AP_MOTORS.start) & 1
    }


@dataclass(slots=True)
class SlowFlight:
    """The evidence that an aircraft flies although it is slower than ``LEAST_AIRSPEED``.

    It is high above the lowest place so far, it moves, and it has never been twice as fast: a fast
    aircraft that is slow does not fly.
    """

    _lowest_m: float = np.inf
    _last_m: float = np.nan
    _fastest: float = 0.0

    def shows(self, altitude_m: Floats, airspeed: Floats, over_ground: Floats) -> Bools:
        """Return where the rows (n,) that follow are flown, by altitude and speeds in m/s.

        NaN is unknown. The rows up to each one decide, however they were cut into blocks.
        """
        speeds = np.nan_to_num(np.fmin(airspeed, over_ground))
        fastest = np.maximum.accumulate(np.append(self._fastest, speeds))
        self._fastest = float(fastest[-1])
        slow = fastest[1:] < 2.0 * LEAST_AIRSPEED
        high = np.zeros(len(altitude_m), bool)
        rows = np.flatnonzero(np.isfinite(altitude_m))
        if len(rows) == 0:
            return high
        altitude = altitude_m[rows]
        leaps = np.abs(np.diff(altitude, prepend=self._last_m)) > LEAP_M
        self._last_m = float(altitude[-1])
        # Each leap begins a level of its own, below which nothing lies that came before.
        level = FAR_M * np.cumsum(leaps)
        lowest = np.minimum.accumulate(np.append(self._lowest_m, altitude - level))[1:] + level
        self._lowest_m = float(lowest[-1])
        high[rows] = altitude - lowest >= LEAST_HEIGHT_M
        moves = np.fmax(airspeed, over_ground) >= LEAST_MOTION
        return high & slow & moves


@dataclass(slots=True)
class TakeOff:
    """The evidence that an aircraft that was on the ground still rolls on it, however fast.

    Neither its bank nor its altitude has changed since; where either is unknown there is no
    evidence.
    """

    _bank: float = np.nan
    _altitude_m: float = np.nan

    def rolls(self, on_ground: Floats, bank: Floats, altitude_m: Floats) -> Floats:
        """Return ``on_ground`` (n,), 1, 0 or NaN if unknown, with 1 where it still rolls.

        ``bank`` (n,) is in rad. The rows up to each one decide, however they were cut into blocks.
        """
        stands = np.append(np.isfinite(self._bank), on_ground == 1.0)
        bank, altitude = np.append(self._bank, bank), np.append(self._altitude_m, altitude_m)
        last = np.maximum.accumulate(np.where(stands, np.arange(len(stands)), -1))
        left = ~(np.abs(bank - bank[last]) < BANKED_RAD)
        left |= ~(np.abs(altitude - altitude[last]) < CLIMBED_M)
        count = np.cumsum(left)
        flies = (last < 0) | (count > count[last])
        self._bank, self._altitude_m = bank[last[-1]], altitude[last[-1]]
        if flies[-1]:
            self._bank = np.nan
        return np.where((on_ground == 0.0) & ~flies[1:], 1.0, on_ground)


class FlightState:
    """The newest VFR_HUD, HEARTBEAT and EXTENDED_SYS_STATE of the ``vehicle``.

    With ``all_flown`` nothing is on the ground. ``lift`` has the motors of :func:`lift_motors`.
    """

    def __init__(self, all_flown: bool = False) -> None:
        self.all_flown = all_flown
        self.vehicle: Vehicle | None = None
        self.lift: dict[int, float] = {}
        self._slow = SlowFlight()
        self._driven = Latest(1), Latest(1)
        self._hud, self._state, self._system = Latest(5), Latest(2), Latest(2)

    def observe(self, messages: Mapping[str, MessageBlock]) -> None:
        """Take in the context messages of a block."""
        self._hud.observe(messages.get("VFR_HUD"), self._hud_columns)
        self._state.observe(
            messages.get("HEARTBEAT"),
            lambda f: np.stack([f["custom_mode"], f["base_mode"] & ARMED], axis=1).astype(float),
        )
        states = _columns("landed_state", "vtol_state")
        self._system.observe(messages.get("EXTENDED_SYS_STATE"), states)
        servos = messages.get("SERVO_OUTPUT_RAW")
        if not self.lift or servos is None:
            return
        for port, driven in enumerate(self._driven):
            own = servos.select(servos.fields["port"] == port)
            is_driven = np.zeros((len(own), 1))
            for number, driven_us in self.lift.items():
                if (number - 1) // OUTPUTS_PER_PORT == port:
                    pwm = raw_output(own, number)
                    is_driven[(pwm > driven_us) & (pwm < 65535.0)] = 1.0
            driven.add(own.order, is_driven)

    def at(self, order: Ints) -> dict[str, Array]:
        """Return what is known at each place (n,), by the names of channels, NaN where unknown.

        The altitude is that of VFR_HUD (above the sea, from ArduPilot and PX4 alike). ``by_ground``
        is 1 where the airspeed equals the ground speed, which an autopilot without a sensor may
        send instead. ``barred`` has the bits of :class:`Held` where the vehicle does not fly on its
        wings alone.
        """
        hud, (mode, armed) = self._hud.at(order), self._state.at(order).T
        landed, vtol = self._system.at(order).T
        air = known(hud[:, 0])
        return {
            "airspeed": air,
            "on_ground": self._on_ground(hud, armed, landed),
            "mode": mode,
            "altitude": hud[:, 2],
            "by_ground": (air == hud[:, 1]).astype(float),
            "ground_speed": over_ground(hud[:, 1]),
            "airspeed_kind": hud[:, 3],
            "rudder_moves": np.full(len(order), np.nan),
            "barred": self._barred(order, mode, vtol),
        }

    def _barred(self, order: Ints, mode: Floats, vtol: Floats) -> Ints:
        """Return the bits HOVER and LIFT_MOTORS of :class:`Held` at places ``order`` (n,).

        ``mode`` (n,) is the flight mode, ``vtol`` (n,) the MAV_VTOL_STATE, NaN before it is known.
        """
        hovers, vehicle = (vtol > 0.0) & (vtol < WINGS), self.vehicle
        if vehicle is not None and has_wings(vehicle):
            if vehicle.autopilot == ARDUPILOT:
                hovers |= (mode >= ARDUPLANE_HOVER.start) & (mode < ARDUPLANE_HOVER.stop)
            elif vehicle.type in VTOL_TYPES:
                # Its rudder only acts in forward flight, which it must report.
                hovers |= vtol != WINGS
        driven = [port.at(order)[:, 0] == 1.0 for port in self._driven]
        lifts = np.any(driven, axis=0) & bool(self.lift)
        found: Ints = int(Held.HOVER) * hovers + int(Held.LIFT_MOTORS) * lifts
        return found

    def _hud_columns(self, fields: Array) -> Floats:
        """Return airspeed, ground speed, altitude, kind of airspeed, 1 for slow flight, (n, 5).

        An on-board log has the kind itself; for a message the autopilot decides it.
        """
        names = "airspeed", "groundspeed", "alt"
        air, ground, altitude = _columns(*names)(fields).T
        autopilot = 0 if self.vehicle is None else self.vehicle.autopilot
        own = AIRSPEED_GIVEN.get(("VFR_HUD", autopilot), AIRSPEED_GIVEN["VFR_HUD", "airspeed"])
        has_kind = "airspeed_kind" in (fields.dtype.names or ())
        kind = fields["airspeed_kind"] if has_kind else np.full(len(fields), float(own))
        flies = self._slow.shows(altitude, air, ground)
        return np.column_stack([air, ground, altitude, kind, flies]).astype(float)

    def _on_ground(self, hud: Floats, armed: Floats, landed: Floats) -> Floats:
        """Return 1 on the ground, 0 in the air and NaN where neither is reported, (n,).

        A vehicle is on the ground if both speeds are low, or if it is disarmed (ArduPilot alone)
        and slow over ground, since VFR_HUD reports any airspeed at boot. An autopilot that reports
        it has landed is believed unless it is fast over ground: a disarmed PX4 may only be carried
        along. Slower aircraft fly as well: see :class:`SlowFlight`.
        """
        if self.all_flown:
            return np.zeros(len(hud))
        air, over_ground = hud[:, 0], hud[:, 1]
        fast, slow = over_ground >= LEAST_AIRSPEED, over_ground < LEAST_AIRSPEED
        counts = self.vehicle is not None and self.vehicle.autopilot == ARDUPILOT
        disarmed = (armed == 0.0) & counts
        flies = hud[:, 4] == 1.0
        grounded = slow & ((air < LEAST_AIRSPEED) & ~flies | disarmed) | ~fast & (landed == LANDED)
        flying = fast | (air >= LEAST_AIRSPEED) | (landed > LANDED) | flies
        return np.where(grounded, 1.0, np.where(flying, 0.0, np.nan))


def _columns(*names: str) -> Callable[[Array], Floats]:
    """Return the function that reads these fields as (n, columns)."""
    return lambda f: np.stack([np.asarray(f[name], float) for name in names], axis=1)
