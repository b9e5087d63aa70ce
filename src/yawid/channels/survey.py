"""A survey of a flight: its message intervals, and its stretches of flight mode and state.

It observes the channels while they are read, and changes nothing.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from yawid.answers.inspection import FlightPhase, MessageRate
from yawid.blocks import Ints
from yawid.channels.segments import REBOOT_US
from yawid.channels.series import Series
from yawid.channels.yaw_reader import MODE, ON_GROUND
from yawid.quantities.vehicles import FIXED_WING, GENERIC, mode_name

STATES = {0.0: "airborne", 1.0: "on ground"}
"""By the ``on_ground`` of a row; a vehicle may report neither speed nor state."""


@dataclass(slots=True)
class Survey:
    """The rows of yaw and surfaces as they are read (``Channels.watch``)."""

    _yaw: list[Series] = field(default_factory=list)
    _surface_us: list[Ints] = field(default_factory=list)

    def note(self, yaw: Series, surface: Series) -> None:
        """Take in the rows of one stretch of the stream."""
        known = np.nan_to_num(yaw.values[:, [MODE, ON_GROUND]], nan=-1.0)
        self._yaw.append(replace(yaw, values=known))
        self._surface_us.append(surface.t_us)

    def rates(self) -> dict[str, MessageRate]:
        """Return the rates of yaw and rudder messages and their jitter, on the vehicle's clock."""
        both = {"yaw": [rows.t_us for rows in self._yaw], "rudder": self._surface_us}
        found = {}
        for name, times_us in both.items():
            t_us = np.concatenate([*times_us, np.zeros(0, np.int64)])
            steps = np.diff(t_us)
            steps = steps[steps > 0]  # a message received twice or a reboot makes no interval
            if len(steps) >= 2:
                low, middle, high = (np.percentile(steps, [5.0, 50.0, 95.0]) / 1e6).tolist()
                found[name] = MessageRate(len(t_us), 1.0 / middle, middle, low, high)
        return found

    def phases(self, autopilot: int, vehicle_type: int) -> list[FlightPhase]:
        """Return the stretches in one flight mode and one state.

        One on the ground is "slow" where the vehicle may hover.
        """
        rows = Series.joined([Series.empty(2), *self._yaw])
        boots = 1 + np.cumsum(np.diff(rows.t_us, prepend=rows.t_us[:1]) < -REBOOT_US)
        changes = (np.diff(boots) != 0) | np.any(np.diff(rows.values, axis=0) != 0.0, axis=1)
        starts = np.flatnonzero(np.append(len(rows) > 0, changes))
        ends_s = np.maximum.reduceat(rows.t_us, starts) / 1e6 if len(starts) else starts
        found = []
        for start, to_s in zip(starts.tolist(), ends_s.tolist(), strict=True):
            number, on_ground = rows.values[start].tolist()
            mode = mode_name(autopilot, vehicle_type, int(number)) if number >= 0 else None
            state = STATES.get(on_ground)
            hovers = vehicle_type not in (GENERIC, FIXED_WING) or (mode or "").startswith("Q")
            if hovers and on_ground == 1.0:
                state = "slow"
            from_s = float(rows.t_us[start]) / 1e6
            found.append(FlightPhase(int(boots[start]), from_s, to_s, mode, state))
        return found
