"""A mode that the rudder has no part in is no answer to the rudder."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import butter, cont2discrete, lfilter

from yawid.results.coherence import Coherence, coherence_at, coherence_reasons

TS = 0.05
RNG_RUNS = 300


def plant(u: np.ndarray, wn: float = 2.0, zeta: float = 0.2) -> np.ndarray:
    b, a, _ = cont2discrete((wn**2 * np.array([0.8, 1.0]), [1.0, 2 * zeta * wn, wn**2]), TS)
    return lfilter(np.ravel(b), a, u)


def commands(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.repeat(rng.choice([-0.2, 0.2], n // 16 + 1), 16)[:n]


def test_nothing_but_noise_is_said_to_be_driven_in_no_more_than_one_case_of_fifty():
    rng = np.random.default_rng(1)
    driven = 0
    for _ in range(RNG_RUNS):
        u, y = rng.standard_normal((2, 2400))
        found = coherence_at(u, y, 2.0, TS)
        assert found is not None
        driven += found.driven

    assert driven <= RNG_RUNS / 50


def test_a_mode_that_the_rudder_drives_is_seen_through_gusts_as_strong_as_its_answer():
    rng = np.random.default_rng(2)
    seen = 0
    for _ in range(100):
        u = commands(rng, 2400)
        y = plant(u)
        gusts = plant(rng.standard_normal(2400))
        seen += coherence_at(u, y + gusts * y.std() / gusts.std(), 2.0, TS).driven

    assert seen >= 97


def line_flight(seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """A Dutch roll at 2 rad/s, and a line at 2.4 Hz with a sixth of the power."""
    rng = np.random.default_rng(seed)
    u = commands(rng, 4800)
    y = plant(u)
    y = y + 0.05 * y.std() * rng.standard_normal(len(y))
    line = np.sin(2.0 * np.pi * 2.4 * TS * np.arange(len(y)))
    return u, y + 0.64 * y.std() * line


def test_a_vibration_line_is_not_driven_and_the_band_asked_for_leaves_it_out():
    u, y = line_flight()

    at_line = coherence_at(u, y, 2.0 * np.pi * 2.4, TS)
    at_mode = coherence_at(u, y, 2.0, TS)

    assert not at_line.driven
    assert at_line.peak_hz == pytest.approx(2.4, abs=0.2)
    assert at_line.peak_share == pytest.approx(0.17, abs=0.03)
    assert at_line.band_hz[0] < 0.3 < at_line.band_hz[1] < 2.4
    assert at_mode.driven
    (reason,) = coherence_reasons(15.1, at_line)
    assert reason.id == "mode_not_driven"
    assert "2.40 Hz" in reason.text
    assert "try --band" in reason.text
    assert list(coherence_reasons(2.0, at_mode)) == []


def test_a_line_at_the_mode_itself_is_not_called_vibration():
    """Gusts move the Dutch roll of 2 rad/s, and the rudder only moves slowly"""
    rng = np.random.default_rng(6)
    b, a = butter(3, 0.15 * 2 * TS)
    u = lfilter(b, a, rng.standard_normal(4800))
    slow = plant(u)
    y = slow + 4.0 * slow.std() * plant(rng.standard_normal(4800)) / plant(u).std() * u.std()
    found = coherence_at(u, y, 2.0, TS)

    assert not found.driven
    assert found.peak_hz == pytest.approx(2.0 / (2.0 * np.pi), abs=0.1)
    (reason,) = coherence_reasons(2.0, found)
    assert "the Dutch roll itself" in reason.text
    assert "vibration or gusts" not in reason.text


def test_a_mode_within_the_rudders_band_is_not_cured_by_a_band():
    found = Coherence(0.1, 0.3, 20, 0.3, 0.6, (0.1, 0.6))
    (reason,) = coherence_reasons(2.0, found)
    assert "it may be the Dutch roll itself" in reason.text
    assert "vibration" not in reason.text
    assert reason.remedy == {}
    (reason,) = coherence_reasons(9.0, found)
    assert "vibration or gusts; try --band 0.1,0.6" in reason.text


def test_a_record_too_short_for_eight_segments_abstains():
    rng = np.random.default_rng(4)
    u, y = rng.standard_normal((2, 700))

    assert coherence_at(u, y, 0.5, TS) is None
    assert coherence_at(u, y, 4.0, TS) is not None
    assert list(coherence_reasons(0.5, None)) == []


def test_segments_never_reach_across_what_is_not_known():
    rng = np.random.default_rng(5)
    u, y = rng.standard_normal((2, 4000))
    y[::150] = np.nan

    assert coherence_at(u, y, 2.0, TS) is None  # three periods are 189 samples
    assert coherence_at(u, y, 6.0, TS).segments >= 8


def test_scipy_finds_the_same():
    from scipy.signal import coherence

    u, y = line_flight()
    found = coherence_at(u, y, 2.0, TS)

    length = 2 * math.ceil(2.0 * math.pi / TS)
    frequency, squared = coherence(
        u, y, fs=1.0 / TS, nperseg=length, detrend="linear", window="hann"
    )
    near = np.abs(frequency - 2.0 / (2.0 * np.pi)) <= 0.2 * 2.0 / (2.0 * np.pi)
    assert found.squared == pytest.approx(squared[near].max(), rel=1e-6)
