"""The vehicle's clock: one time in microseconds since boot for every message.

SERVO_OUTPUT_RAW.time_usec has 32 bits and wraps every 71.6 minutes while ATTITUDE.time_boot_ms goes
on, so the first is unwrapped with the help of the second.
"""

import numpy as np

from yawid.blocks import Array, Ints

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
