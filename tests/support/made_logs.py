"""What the messages of a log that the tools made contain, by pymavlink's own decoder."""

from __future__ import annotations

import numpy as np
from flights.surgery import messages, split


def columns(log: bytes, name: str, *fields: str) -> np.ndarray:
    """Return the fields of the vehicle's messages of a name (n, fields)."""
    own = [m for m in messages(split(log), name) if m.get_srcSystem() == 1]
    return np.array([[getattr(m, field) for field in fields] for m in own], float)
