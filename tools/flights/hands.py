"""Movements of the controls: at random, by a pilot, or as a feedback of the flight."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from flights.flight import Flight, Floats
from flights.plan import LEAD_IN_S, STEP_S


def count(seconds: float) -> int:
    """Return the number of milliseconds in a log of this length, both ends included."""
    return round(seconds / STEP_S) + 1


def wander(rng: np.random.Generator, n: int, tau_s: float, std: float) -> Floats:
    """Return noise (n,), a value for each millisecond, filtered by two lags of ``tau_s``.

    ``std`` is the standard deviation of the process, from which that of a short piece may differ.
    """
    every = max(round(0.1 * tau_s / STEP_S), 1)
    white = rng.normal(size=math.ceil(n / every) + 200)
    pole = math.exp(-0.1)
    slow = lfilter([1.0], [1.0, -2.0 * pole, pole * pole], white)[199:]
    # Scale by the standard deviation of the process, not of this piece.
    slow *= std * math.sqrt((1.0 - pole**2) ** 3 / (1.0 + pole**2))
    at = np.arange(n) / every
    return np.asarray(np.interp(at, np.arange(len(slow)), slow))


def pulses(rng: np.random.Generator, seconds: float, amplitude: float, unit_s: float) -> Floats:
    """Return moves to either side (n,), whose side is drawn every ``unit_s`` after the lead-in."""
    n = count(seconds)
    held = rng.choice([-amplitude, amplitude], size=math.ceil(seconds / unit_s) + 1)
    moves = np.repeat(held, round(unit_s / STEP_S))[:n]
    moves[: round(LEAD_IN_S / STEP_S)] = 0.0
    return np.asarray(moves)


def by_hand(rng: np.random.Generator, seconds: float, amplitude: float, unit_s: float) -> Floats:
    """Return the rudder (n,) of a pilot's doublets, all different, with smooth edges and rests.

    ``unit_s`` is about the length of one side; a change of side takes 0.3 s.
    """
    n = count(seconds)
    rudder, at = np.zeros(n), round(LEAD_IN_S / STEP_S)
    while at < n:
        sign = float(rng.choice([-1.0, 1.0]))
        for side in (sign, -sign, 0.0):
            length = round(unit_s * rng.uniform(0.6, 1.4) * (2.0 if side == 0.0 else 1.0) / STEP_S)
            rudder[at : at + length] = side * amplitude * rng.uniform(0.5, 1.0)
            at += length
    foot = np.hanning(301)
    return np.asarray(np.convolve(rudder, foot / foot.sum())[:n])


@dataclass(slots=True)
class Mixed:
    """A rudder that copies the aileron: ``share`` of it with a lag of ``lag_s``, and noise (n,)."""

    share: float
    lag_s: float = 0.0
    noise: Floats | None = None
    _now: float = field(default=0.0, init=False)

    def __call__(self, flight: Flight) -> float:
        """Return the rudder of this millisecond."""
        wanted = self.share * flight.aileron
        step = 1.0 if self.lag_s <= STEP_S else STEP_S / self.lag_s
        self._now += step * (wanted - self._now)
        return self._now + (0.0 if self.noise is None else float(self.noise[flight.ms]))


@dataclass(slots=True)
class Damper:
    """A yaw damper: a rudder against the yaw rate, whose steady part a washout removes."""

    gain: float
    washout_s: float = 3.0
    _slow: float = field(default=0.0, init=False)

    def __call__(self, flight: Flight) -> float:
        """Return the rudder of this millisecond."""
        r = flight.sensed(5)
        self._slow += STEP_S / self.washout_s * (r - self._slow)
        return -self.gain * (r - self._slow)
