"""Inputs that excite a plant, sampled on the grid and held between its instants.

A unit step excites only models of order 1; those of order 2 to 3 need a doublet, 3-2-1-1, PRBS,
sweep or multisine.
"""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy import signal

from yawid.blocks import Floats
from yawid.errors import ConfigError

Kind = Literal["step", "impulse", "doublet", "3211", "prbs", "sweep", "multisine"]
KINDS: tuple[Kind, ...] = get_args(Kind)
BITS = {"doublet": (1.0, -1.0), "3211": (1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0)}
"""The bits of a shape that is held bit by bit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """One input: zero until ``start_s``, then a shape with the peak ``amplitude``.

    ``unit_s`` is the length of a doublet's half, of the 1 of a 3-2-1-1 and of a PRBS bit;
    ``low_hz`` and ``high_hz`` bound sweep and multisine; ``seed`` draws the PRBS's start and the
    multisine's phases. An impulse lasts one sample and has the area ``amplitude`` (times 1 s).

    Raises:
        ConfigError: the kind is unknown, or a value is outside its limits.
    """

    kind: Kind
    amplitude: float = 1.0
    start_s: float = 0.0
    unit_s: float = 1.0
    low_hz: float = 0.05
    high_hz: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ConfigError(f"excitation must be one of {', '.join(KINDS)}, got {self.kind!r}")
        if not math.isfinite(self.amplitude) or self.amplitude == 0.0:
            raise ConfigError(f"amplitude must be finite and not 0, got {self.amplitude!r}")
        if not 0.0 <= self.start_s < math.inf or not 0.0 < self.unit_s < math.inf:
            raise ConfigError(
                f"start_s must be >= 0 and unit_s > 0, got {self.start_s!r} and {self.unit_s!r}"
            )
        if self.seed < 0:
            raise ConfigError(f"seed must be >= 0, got {self.seed!r}")

    def samples(self, count: int, sample_time_s: float) -> Floats:
        """Return u (count,): u(k) is held over [k Ts, (k+1) Ts).

        Raises:
            ConfigError: the shape starts after the end, switches faster than the samples, exceeds
            half their rate, or has no frequency in its band.
        """
        first = round(self.start_s / sample_time_s)
        if not 0 <= first < count:
            raise ConfigError(f"start_s = {self.start_s} lies outside the {count} samples")
        u = np.zeros(count)
        u[first:] = self.amplitude * self._shape(count - first, sample_time_s)
        return u

    def _shape(self, count: int, ts: float) -> Floats:
        match self.kind:
            case "step":
                return np.ones(count)
            case "impulse":
                return np.asarray(np.eye(1, count)[0] / ts)
            case "doublet" | "3211" | "prbs":
                return self._held(count, round(self.unit_s / ts))
        if not self.high_hz <= 0.5 / ts:
            raise ConfigError(f"high_hz must be at most half the rate, got {self.high_hz} Hz")
        if self.kind == "sweep":
            t = np.arange(count) * ts
            ends = self.low_hz, count * ts, self.high_hz
            return np.asarray(signal.chirp(t, *ends, "logarithmic", phi=-90))
        # Equal sines at the record's harmonics in the band, with random phases and peak 1.
        low, high = (edge_hz * count * ts for edge_hz in (self.low_hz, self.high_hz))
        harmonics = np.arange(math.ceil(low), math.floor(high) + 1)
        if not len(harmonics):
            band = f"{self.low_hz} and {self.high_hz} Hz"
            raise ConfigError(f"no harmonic of {count * ts:g} s lies between {band}")
        phases = np.random.default_rng(self.seed).uniform(0.0, 2.0 * np.pi, len(harmonics))
        angle = 2.0 * np.pi * np.outer(np.arange(count) / count, harmonics) + phases
        u = np.cos(angle).sum(axis=1)
        return np.asarray(u / np.abs(u).max())

    def _held(self, count: int, length: int) -> Floats:
        """Return bits of +-1 (count,), each held for ``length`` samples, then zeros.

        Those of a PRBS are a maximum-length sequence, which does not repeat up to 2^20 bits.
        """
        if length < 1:
            raise ConfigError(f"unit_s = {self.unit_s} is shorter than half a sample")
        bits = np.array(BITS.get(self.kind, ()))
        if self.kind == "prbs":
            needed = -(-count // length)
            order = min(max(4, needed.bit_length()), 20)
            start = np.random.default_rng(self.seed).integers(0, 2, order)
            start[0] = 1  # all zeros would stay zero
            bits = 2.0 * signal.max_len_seq(order, state=start, length=needed)[0] - 1.0
        return np.resize(np.append(np.repeat(bits, length), np.zeros(count)), count)
