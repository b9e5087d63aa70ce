"""The vehicle's clock: one time in microseconds since boot for every message.

SERVO_OUTPUT_RAW.time_usec has 32 bits and wraps every 71.6 minutes while ATTITUDE.time_boot_ms goes
on, so the first is unwrapped with the help of the second.
"""

from dataclasses import dataclass, field

import numpy as np

from yawid.blocks import FIRST_DATE_US, Array, Ints, MessageBlock
from yawid.channels.series import Readings

NEWEST = slice(-1, None)
"""The newest row, all that is kept of an earlier series."""


def boot_us(fields: Array) -> Ints:
    """Return the boot time in us (n,) that a message reports: time_boot_ms, or time_usec (n,)."""
    if "time_boot_ms" in (fields.dtype.names or ()):
        return fields["time_boot_ms"].astype(np.int64) * 1000
    return fields["time_usec"].astype(np.int64)


def unwrap_uint32_us(raw: Ints, order: Ints, boot_us: Ints, boot_order: Ints) -> Ints:
    """Return 32-bit microseconds unwrapped by the last full boot time received before each of them.

    ``boot_us`` and ``boot_order`` (m >= 1,) are the full times and their places. The result, int64
    microseconds (n,), lies within 2**31 us (35.8 min) of the full time.
    """
    last = np.maximum(np.searchsorted(boot_order, order) - 1, 0)
    turns = np.rint((boot_us[last] - raw) / 2.0**32).astype(np.int64)
    unwrapped: Ints = raw + turns * 2**32
    return unwrapped


@dataclass(slots=True)
class OwnClock:
    """The clock of a single message, for where no other reports a full time: its newest readings.

    They count from boot if the message reports time since boot, and from its first row if it
    reports Unix time.
    """

    readings: Readings = field(default_factory=Readings.none)
    _shift: int | None = None
    _last: int | None = None

    def observe(self, block: MessageBlock | None) -> None:
        """Take a block in; of the earlier readings only the newest is kept."""
        if block is None or len(block) == 0:
            return
        raw = boot_us(block.fields)
        if self._shift is None:
            self._shift = -int(raw[0]) if raw[0] >= FIRST_DATE_US else 0  # time_usec may be Unix
        t_us = raw + self._shift
        if block.name == "SERVO_OUTPUT_RAW" and block.fields.dtype["time_usec"].itemsize == 4:
            # Of 32 bits, a fall by more than half their range is a wrap, a smaller one a reboot.
            steps = np.diff(raw, prepend=raw[0] if self._last is None else self._last)
            turns = -np.cumsum(np.rint(steps / 2.0**32).astype(np.int64))
            self._last, self._shift = int(raw[-1]), self._shift + int(turns[-1]) * 2**32
            t_us = t_us + turns * 2**32
        fresh = Readings(block.order, t_us)
        self.readings = Readings.joined([self.readings.select(NEWEST), fresh])
