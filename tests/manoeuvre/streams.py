"""Samples made by hand for the tests of manoeuvres: what the rudder did in, a block out."""

from collections.abc import Iterator, Sequence
from dataclasses import fields
from itertools import pairwise

import numpy as np
from scipy.signal import cont2discrete, lfilter

from yawid.blocks import Floats, Held, SampleBlock
from yawid.manoeuvre.find import Finder
from yawid.quantities.airspeed import Kind

TS_S = 0.05
HZ = 20
START_NS = 1_700_000_000_000_000_000


def stream(
    rudder: Floats,
    *,
    first_k: int = 0,
    aileron: Floats | float = np.nan,
    airspeed: Floats | float = 20.0,
    mode: float = 0.0,
    epoch: int = 0,
    noted: int = 0,
    y: Floats | None = None,
    turn: Floats | float = 0.0,
    roll: Floats | float = 0.0,
    yaw: Floats | float = 0.0,
    ground_speed: Floats | float = np.nan,
    altitude: Floats | float = 100.0,
) -> SampleBlock:
    """A flight on the grid of 20 Hz; ``rudder`` (n,) in half travels, held where it is NaN"""
    n = len(rudder)
    k = np.arange(first_k, first_k + n)
    held = np.where(np.isnan(rudder), int(Held.GAP), 0)
    columns = {
        "airspeed": airspeed,
        "aileron": aileron,
        "turn_rate": turn,
        "roll": roll,
        "mode": mode,
    }
    columns |= {"yaw": yaw, "ground_speed": ground_speed, "altitude": altitude}
    columns |= {"airspeed_kind": float(Kind.EQUIVALENT), "rudder_moves": 0.0}
    rows = {name: np.broadcast_to(np.float64(value), n).copy() for name, value in columns.items()}
    output = np.where(held == 0, 0.0 if y is None else y, np.nan)
    boot_us = np.round(k * TS_S * 1e6).astype(np.int64)
    return SampleBlock(
        sample_time_s=TS_S,
        k=k,
        boot_us=boot_us,
        unix_ns=START_NS + 1000 * boot_us,
        received_us=(START_NS // 1000 + boot_us),
        u=np.array(rudder, float)[:, None],
        y=output,
        noted=np.full(n, noted),
        held=held,
        epoch=np.full(n, epoch),
        on_ground=np.zeros(n),
        **rows,
    )


def rest(seconds: float, at: float = 0.0) -> Floats:
    return np.full(round(HZ * seconds), at)


def doublets(seconds: float, amplitude: float = 0.2) -> Floats:
    """Half a second to either side, at least one of each, and back"""
    return amplitude * np.where(np.arange(round(HZ * seconds)) // 10 % 2, -1.0, 1.0)


def flown(*parts: Floats) -> Floats:
    return np.concatenate(parts)


def without(samples: SampleBlock, first: int, stop: int) -> SampleBlock:
    """The samples without rows ``first`` to ``stop``: the grid has none there"""
    rows = np.arange(len(samples))
    return samples.select(rows[(rows < first) | (rows >= stop)])


def joined(*parts: SampleBlock) -> SampleBlock:
    return SampleBlock.joined(parts)


def cut(samples: SampleBlock, edges: Sequence[int]) -> Iterator[SampleBlock]:
    bounds = sorted({0, len(samples), *(edge for edge in edges if 0 < edge < len(samples))})
    for first, stop in pairwise(bounds):
        yield samples.select(slice(first, stop))


def found_in(
    samples: SampleBlock, edges: Sequence[int] = (), unit: float = 1.0
) -> list[SampleBlock]:
    """The manoeuvres of a stream that comes in blocks with these edges"""
    finder = Finder(TS_S, unit)
    found = [each for block in cut(samples, edges) for each in finder.feed(block)]
    return found + finder.finish()


def spans(found: Sequence[SampleBlock]) -> list[tuple[int, int]]:
    """First and last k of each"""
    return [(int(each.k[0]), int(each.k[-1])) for each in found]


def assert_same(one: Sequence[SampleBlock], other: Sequence[SampleBlock]) -> None:
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        for field in fields(SampleBlock):
            np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))


WN, ZETA = 6.0, 0.3
"""The Dutch roll of :func:`yawing`."""


def yawing(
    rudder: Floats, aileron: Floats | float = 0.0, *, noise: float = 0.0, seed: int = 1
) -> Floats:
    """The yaw rate (n,) of eq. 23's plant to rudder and aileron held over each interval of 20 Hz"""
    square = WN**2
    poles = [1.0, 2.0 * ZETA * WN, square]
    zeros = [[0.3 * square * 0.9, 0.3 * square], [0.8 * square]]
    y = noise * np.random.default_rng(seed).standard_normal(len(rudder))
    for u, zero in zip((rudder, np.broadcast_to(aileron, len(rudder))), zeros, strict=True):
        b, a, _ = cont2discrete((zero, poles), TS_S, method="zoh")
        y += lfilter(b[0], a, np.nan_to_num(u))
    return y
