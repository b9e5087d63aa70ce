"""The CRC of many frames at once against pymavlink's."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.generator.mavcrc import x25crc

from yawid.sources.mavlink.crc import crc_of_frames


@pytest.mark.parametrize("count", [1, 31, 32, 200, 3000])
@pytest.mark.parametrize("longest", [3, 20, 265])
def test_it_equals_pymavlinks_at_every_length_and_place(count: int, longest: int) -> None:
    rng = np.random.default_rng(count + longest)
    data = rng.integers(0, 256, 20_000, dtype=np.uint8)
    first = rng.integers(7, len(data) - longest, count)
    end = first + rng.integers(2, longest + 1, count)
    extra = rng.integers(0, 256, count, dtype=np.uint8)
    found = crc_of_frames(data, first, end, extra)
    expected = [
        x25crc(data[a:b].tobytes() + bytes([e])).crc
        for a, b, e in zip(first, end, extra, strict=True)
    ]
    assert found.tolist() == expected


def test_every_length_of_a_frame_is_right() -> None:
    lengths = np.repeat(np.arange(2, 266), 2)
    data = np.random.default_rng(1).integers(0, 256, 400, dtype=np.uint8)
    first = np.full(len(lengths), 100)
    found = crc_of_frames(data, first, first + lengths, np.zeros(len(lengths), np.uint8))
    expected = [x25crc(data[100 : 100 + n].tobytes() + b"\0").crc for n in lengths.tolist()]
    assert found.tolist() == expected


def test_no_frames_have_no_crc() -> None:
    none = np.empty(0, np.int64)
    assert len(crc_of_frames(np.zeros(9, np.uint8), none, none, np.empty(0, np.uint8))) == 0
