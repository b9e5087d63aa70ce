"""The CRC of many frames at once against pymavlink's."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.generator.mavcrc import x25crc

from yawid.sources.mavlink.crc import crc_of_frames


@pytest.mark.parametrize(("count", "longest"), [(0, 3), (1, 265), (31, 3), (32, 20), (900, 265)])
def test_it_equals_pymavlinks_at_every_length_and_place(count: int, longest: int) -> None:
    rng = np.random.default_rng(count + longest)
    data = rng.integers(0, 256, 20_000, dtype=np.uint8)
    first = rng.integers(7, len(data) - longest, count)
    end = first + np.resize(np.arange(2, longest + 1), count)
    extra = rng.integers(0, 256, count, dtype=np.uint8)
    found = crc_of_frames(data, first, end, extra)
    expected = [
        x25crc(data[a:b].tobytes() + bytes([e])).crc
        for a, b, e in zip(first, end, extra, strict=True)
    ]
    assert found.tolist() == expected
