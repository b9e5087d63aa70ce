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
    samples: SampleBlock, edges: Sequence[int] = (), unit: float = 1.0, bare: float | None = None
) -> list[SampleBlock]:
    """The manoeuvres of a stream that comes in blocks with these edges; ``bare`` is a mode"""
    finder = Finder(TS_S, unit, None if bare is None else lambda mode: mode == bare)
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
    rudder: Floats,
    aileron: Floats | float = 0.0,
    *,
    wn: float = WN,
    zeta: float = ZETA,
    lead_s: float = 0.9,
    noise: float = 0.0,
    seed: int = 1,
) -> Floats:
    """The yaw rate (n,) of eq. 23's plant to rudder and aileron held over each interval of 20 Hz"""
    square = wn**2
    poles = [1.0, 2.0 * zeta * wn, square]
    zeros = [[0.3 * square * lead_s, 0.3 * square], [0.8 * square]]
    y = noise * np.random.default_rng(seed).standard_normal(len(rudder))
    for u, zero in zip((rudder, np.broadcast_to(aileron, len(rudder))), zeros, strict=True):
        b, a, _ = cont2discrete((zero, poles), TS_S, method="zoh")
        y += lfilter(b[0], a, np.nan_to_num(u))
    return y


def fed_back(gain: float, pilot: Floats, noise: float = 0.0) -> tuple[Floats, Floats]:
    """Rudder and yaw rate r at 20 Hz; rudder = pilot - gain * r, ``pilot`` is each 5 ms.

    r / rudder is 16 / (s^2 + 1.6 s + 16), whose Dutch roll is 4 rad/s and zeta .2.
    """
    system = np.array([[0.0, 1.0], [-16.0, -1.6]]), np.array([[0.0], [16.0]])
    a, b, *_ = cont2discrete((*system, np.eye(2), np.zeros((2, 1))), 0.005)
    x, rudder, r = np.zeros(2), np.zeros(len(pilot)), np.zeros(len(pilot))
    rng = np.random.default_rng(1)
    for k, moved in enumerate(pilot):
        r[k] = x[0]
        rudder[k] = moved - gain * (x[0] + noise * rng.normal())
        x = a @ x + b[:, 0] * rudder[k]
    y = r[::10]
    return rudder.reshape(-1, 10).mean(axis=1), y + noise * rng.normal(size=len(y))


def slow_doublets(count: int) -> Floats:
    """Of .65 s to either side, each 5 ms, one every 5 s"""
    return np.tile(np.repeat([0.2, -0.2, 0.0], [130, 130, 740]), count)
