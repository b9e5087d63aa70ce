"""A day of this and a day of that: bounded, finite, and back within 300 samples.

The textbook recursion overflows after 35 000 silent updates at a forgetting factor of 0.98 and
loses definiteness after 2 000 at trim; nothing here may.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from daylog import long_log
from flightlog import finished, fly, samples_of
from flights.surgery import join, split
from scipy.signal import lfilter

from yawid.blocks import Floats, Status
from yawid.config.estimator import ArmaxOrders, EstimatorConfig
from yawid.config.run import RunConfig
from yawid.estimation.armax import RecursiveArmax

DAY = 24 * 3600 * 20
"""A day of samples at 20 Hz."""
TS = 0.05
A, B, C = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5], [1.0, -0.5, 0.1]
TRUTH = np.array([*A[1:], *B[1:], *C[1:], 0.0])
PART = 100_000
SPREAD = np.array([4.34, 4.34, 1.0, 1.0, 4.34, 4.34, 1.0])
"""Of what stands before each parameter, y, u, residual and 1, while excited: P times its square is
P on scaled signals. Wind-up would take it to 1e308; each of its factors is capped at 1e6."""
LARGEST_P = {0.98: 1e7, "usual": 2.0}
"""On scaled signals after a day: absolutely at a memory of 50 samples, where nothing of the flight
is left after ten seconds; at the usual minute relative to what it was while excited."""


def excited(n: int, rng: np.random.Generator, gain: float = 1.0) -> tuple[Floats, Floats]:
    u = rng.normal(size=n)
    noise = lfilter(C, A, 0.05 * rng.normal(size=n))
    return u, gain * lfilter(B, A, u) + noise


Day = Callable[[int, np.random.Generator], tuple[Floats, Floats]]


def silence(first: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    return np.zeros(PART), np.zeros(PART)


def quiet_rudder(first: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    return np.zeros(PART), lfilter(C, A, 0.05 * rng.normal(size=PART))


def trim(first: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    u = np.full(PART, 0.3)
    return u, 0.3 * sum(B) / sum(A) + lfilter(C, A, 0.05 * rng.normal(size=PART))


def sine(first: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """One steady weave without any noise: two directions are excited, the others never."""
    k = first + np.arange(PART)
    w = 2.4 * TS
    response = np.polyval(B[::-1], np.exp(-1j * w)) / np.polyval(A[::-1], np.exp(-1j * w))
    return np.sin(w * k), abs(response) * np.sin(w * k + np.angle(response))


def estimator(method: str, forgetting: float) -> RecursiveArmax:
    orders = ArmaxOrders(na=2, nb=(2,), nc=2, nk=(1,))
    return RecursiveArmax(
        EstimatorConfig(
            orders=orders, sample_time_s=TS, forgetting_factor=forgetting, method=method
        )
    )


def scaled_p(armax: RecursiveArmax) -> float:
    """Return the largest variance in P on scaled signals (to the power of two of their factors)."""
    return float((np.diag(armax.P) * SPREAD**2).max())


def assert_bounded(armax: RecursiveArmax, largest: float) -> None:
    assert np.isfinite(armax.theta).all()
    assert np.isfinite(armax.P).all()
    assert np.linalg.eigvalsh(armax.P).min() > 0.0
    assert scaled_p(armax) < largest


def error(armax: RecursiveArmax, gain: float = 1.0) -> float:
    """Return the largest error of a and b: c is known as well as the noise allows, no better."""
    truth = TRUTH.copy()
    truth[2:4] *= gain
    return float(np.abs(armax.theta - truth)[:4].max())


LONG_DAYS = [pytest.param(day, marks=pytest.mark.long) for day in (silence, quiet_rudder, sine)]
FORGETTING = [0.98, math.exp(-TS / 60.0)]


@pytest.mark.slow
@pytest.mark.parametrize("forgetting", FORGETTING)
@pytest.mark.parametrize("method", ["els", "rml"])
@pytest.mark.parametrize("day", [trim, *LONG_DAYS])
def test_a_day_of_nothing_new_leaves_it_bounded_and_ready(day: Day, method: str, forgetting: float):
    rng = np.random.default_rng(1)
    armax = estimator(method, forgetting)
    armax.run(*excited(3000, rng), keep="last")
    assert error(armax) < 0.05
    usual = forgetting != 0.98
    largest = LARGEST_P["usual"] * scaled_p(armax) if usual else LARGEST_P[0.98]

    for first in range(0, DAY, PART):
        last = armax.run(*day(first, rng), keep="last")
        assert last.status[-1] in (Status.TRACKING, Status.HELD)
        assert_bounded(armax, largest)
        assert error(armax) < (0.05 if usual else 0.6)  # of b, which nothing tells
    armax.run(*excited(300, rng), keep="last")

    assert_bounded(armax, largest)
    assert error(armax) < 0.04


@pytest.mark.long
@pytest.mark.parametrize("method", ["els", "rml"])
def test_ten_million_updates_of_a_plant_that_changes_between_long_poor_stretches(method: str):
    """2 000 excited and 48 000 poor samples in turn; the gain changes while nobody looks."""
    rng = np.random.default_rng(2)
    armax, worst, gains = estimator(method, 0.98), 0.0, []
    poor: list[Day] = [silence, quiet_rudder, trim, sine]
    for cycle in range(200):
        gain = 1.0 if cycle % 2 else 1.5
        armax.run(*excited(300, rng, gain), keep="last")
        worst = max(worst, error(armax, gain))
        gains.append(abs(armax.theta[2:4].sum() / (sum(B) * gain) - 1.0))
        armax.run(*excited(1700, rng, gain), keep="last")
        u, y = poor[cycle % 4](48_000 * cycle, rng)
        armax.run(u[:48_000], y[:48_000], keep="last")
        assert_bounded(armax, 300.0)

    assert armax.updates > 9_990_000
    assert worst < 0.08
    assert np.mean(gains) < 0.02  # what the best remedies against wind-up leave


@pytest.mark.long
def test_ten_million_held_samples_change_nothing_but_their_count():
    rng = np.random.default_rng(3)
    armax = estimator("rml", 0.98)
    armax.run(*excited(3000, rng), keep="last")
    theta, p = armax.theta, armax.P
    nothing = np.full(PART, np.nan)
    for _ in range(100):
        armax.run(nothing, nothing, keep="last")

    np.testing.assert_array_equal(armax.theta, theta)
    np.testing.assert_array_equal(armax.P, p)
    assert armax.held >= 10_000_000


HZ = 10.0
HOURS_24 = round(24 * 3600 * HZ)


def dutch_roll_filter() -> tuple[Floats, Floats]:
    """Return (b, a) of wn 2.4 rad/s, zeta 0.25, gain 0.5 rad/s per unit, sampled at HZ."""
    from scipy.signal import cont2discrete

    wn, zeta = 2.4, 0.25
    b, a, _ = cont2discrete(([0.5, 0.5 * wn**2], [1.0, 2 * zeta * wn, wn**2]), 1.0 / HZ)
    return b.ravel(), a


def flown(u: Floats, seed: int) -> Floats:
    b, a = dutch_roll_filter()
    return lfilter(b, a, u) + 0.002 * np.random.default_rng(seed).normal(size=len(u))


def doublets(n: int, seed: int) -> Floats:
    return np.repeat(np.random.default_rng(seed).choice([-0.25, 0.0, 0.25], n // 8 + 1), 8)[:n]


def summary_of(log: bytes, chunk: int = 1 << 20, **settings) -> dict:
    return finished(log, RunConfig(rate=HZ, **settings), size=chunk).to_json()


def assert_found(summary: dict, bias: float = 0.0) -> None:
    """Both methods have the truth within three sigma and ``bias``, and know it to a few percent.

    The sigma is that of noise: the plant is of the model's structure.
    """
    for method in ("els", "rml"):
        found = summary["estimates"][method]["dutch_roll"]
        assert abs(found["wn_rad_s"] - 2.4) < 3.0 * found["wn_std_noise"] + bias * 2.4
        assert abs(found["zeta"] - 0.25) < 3.0 * found["zeta_std_noise"] + bias
        assert 0.0 < found["wn_std_noise"] < 0.05 * 2.4
        assert 0.0 < found["zeta_std_noise"] < 0.07


def a_day(kind: str) -> Floats:
    k = np.arange(HOURS_24)
    return {
        "silence": np.zeros(HOURS_24),
        "trim": np.full(HOURS_24, 0.12),
        "sine": 0.2 * np.sin(1.3 * k / HZ),
    }[kind]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["silence", "trim", "sine"])
def test_a_day_through_the_whole_pipeline_between_two_manoeuvres(kind: str):
    u = np.concatenate([doublets(1200, 1), a_day(kind), doublets(300, 2)])
    found = summary_of(long_log(flown(u, 3), 1500.0 + 400.0 * u, HZ), manoeuvres="off")

    assert found["link"]["lost"] == 0
    assert found["duration_s"] > 86_400
    assert found["estimates"]["rml"]["updates"] > 0.99 * HOURS_24
    assert_found(found)


@pytest.mark.slow
def test_a_link_that_says_nothing_for_a_day_is_one_gap():
    first, second = doublets(600, 4), doublets(600, 5)
    log = long_log(flown(first, 6), 1500.0 + 400.0 * first, HZ)
    log += long_log(flown(second, 7), 1500.0 + 400.0 * second, HZ, start_s=86_500.0)
    found = summary_of(log, memory=math.inf)

    assert (found["link"]["gaps"], found["link"]["reboots"]) == (1, 0)
    assert found["estimates"]["els"]["updates"] < 1200
    assert_found(found)


@pytest.mark.slow
@pytest.mark.parametrize("count", [200, pytest.param(1000, marks=pytest.mark.long)])
def test_many_reboots(count: int):
    """Each life lasts ten seconds and has a clock of its own; what was learned is kept."""
    log = b"".join(lives(count, 100))
    found = summary_of(log, memory=math.inf, manoeuvres="off", ordinary="off")

    assert found["link"]["reboots"] == count - 1
    assert found["estimates"]["els"]["updates"] > 85 * count
    assert_found(found, bias=0.001)  # sigma is 0.01 %, and a pulse is whole microseconds


def lives(count: int, samples: int) -> Iterator[bytes]:
    for life in range(count):
        u = doublets(samples, life)
        data = long_log(flown(u, 1000 + life), 1500.0 + 400.0 * u, HZ, start_s=8.0)
        # The receiver's clock goes on; the vehicle's begins again.
        later_us = round(life * 1e6 * (samples / HZ + 3.0))
        yield join((stamp + later_us, frame) for stamp, frame in split(data))


def test_memory_and_grid_after_a_day_without_servo_messages():
    """What is kept while one channel is silent does not grow: the newest row alone."""
    first = fly(lambda t: 0.1 * math.sin(t), lambda t: 1500, 3.0, servo_s=100.0)
    samples = samples_of(first.data)

    assert sum(len(piece.yaw) for piece in samples.channels.startup.pieces) <= 2
