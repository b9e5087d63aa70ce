"""The answer of one manoeuvre, on plants whose Dutch roll is known: right, or none with a reason.

One list of flights that are answered, one of flights that are refused; gusts, drift, turns and
vibration are among them, and rudders that are not the one that moved the aircraft.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from finished_runs import replayed
from manoeuvre.streams import (
    HZ,
    TS_S,
    WN,
    ZETA,
    doublets,
    fed_back,
    flown,
    rest,
    slow_doublets,
    stream,
    yawing,
)
from models.answers_by_hand import numbers, response
from places import REPLAY_LOGS
from scipy.signal import butter, lfilter, step

import yawid
from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import Floats, SampleBlock
from yawid.config.run import BOTH, RunConfig
from yawid.manoeuvre.answered import answer, step_of
from yawid.manoeuvre.feedback import rate_feedback
from yawid.manoeuvre.judge import ManoeuvreSetting

NOISE = 0.002
MANUAL, FBWA = 0.0, 5.0
ALONE = ["rudder"]


def told(samples: SampleBlock, **options: Any) -> Manoeuvre:
    return answer(samples, 7, ManoeuvreSetting(RunConfig(**options), TS_S, (20.0, 20.0), (3, 1)))


def pulses(seconds: float, rows: int, amplitude: float, seed: int) -> Floats:
    """Pulses of so many samples that go either way, between rests"""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=round(seconds * HZ / rows) + 1)
    return flown(rest(1), amplitude * np.repeat(signs, rows)[: round(seconds * HZ)], rest(5))


RUDDER, AILERON = pulses(30, 6, 0.2, 1), pulses(30, 6, 0.1, 2)
SLOW = pulses(40, 16, 0.2, 1)
CALM = yawing(RUDDER, noise=0.004)


def flight(aileron: Floats | float = 0.0, **options: Any) -> SampleBlock:
    y = yawing(RUDDER, aileron, noise=NOISE)
    return stream(RUDDER, y=options.pop("y", y), aileron=aileron, **options)


def both(mode: float = MANUAL, share: float = 0.0) -> SampleBlock:
    """Rudder and aileron as inputs; with a ``share`` the aileron is the rudder's copy."""
    aileron = share * RUDDER if share else AILERON
    return replace(flight(aileron, mode=mode), u=np.column_stack([RUDDER, aileron]))


def banked(strength: float) -> dict[str, Any]:
    turn = strength * np.sin(0.25 * np.arange(len(RUDDER)) * TS_S)
    return {"turn": turn, "y": yawing(RUDDER, noise=NOISE) + turn}


def reacting() -> SampleBlock:
    """A pilot or a damper that levels the wings: what yaw rate and roll explain moves nothing"""
    y = yawing(RUDDER, 0.0, noise=NOISE)
    for _ in range(20):  # the loop closed by iteration
        roll = lfilter([TS_S], [1.0, -0.98], 0.5 * y)
        reaction = np.concatenate([[0.0], -0.6 * roll[:-1] - 0.3 * y[:-1]])
        y = yawing(RUDDER, reaction, noise=NOISE)
    assert np.ptp(reaction) > 0.1
    return stream(RUDDER, y=y, aileron=reaction, roll=roll)


def with_gap() -> SampleBlock:
    samples, gone = flight(), slice(200, 230)
    u, y, held = samples.u.copy(), samples.y.copy(), samples.held.copy()
    u[gone], y[gone], held[gone] = np.nan, np.nan, 1
    return replace(samples, u=u, y=y, held=held)


def coloured(share: float, of: Floats, b: Any, a: Any, seed: int) -> Floats:
    """Noise through a filter, of this share of the calm yaw rate, as long as ``of``"""
    x = lfilter(b, a, np.random.default_rng(seed).standard_normal(len(of) + 400))[400:]
    return share * CALM.std() * x / x.std()


def drift(share: float, corner_hz: float, seed: int, of: Floats) -> Floats:
    return coloured(share, of, *butter(2, corner_hz / (HZ / 2)), seed)


def gusts(share: float) -> SampleBlock:
    """They pass through the aircraft's own mode"""
    p = np.exp(complex(-ZETA * WN, WN * math.sqrt(1.0 - ZETA**2)) * TS_S)
    return stream(RUDDER, y=CALM + coloured(share, CALM, [1.0], [1, -2 * p.real, abs(p) ** 2], 4))


def vibrating(rudder: Floats, noise: float = 0.0, seed: int = 1) -> Floats:
    """A line at 6 Hz as large as the yaw rate, whose phase drifts as a motor's does"""
    t = np.arange(len(rudder)) * TS_S
    phase = 0.09 * np.cumsum(np.random.default_rng(3).standard_normal(len(t)))
    gyro = noise * np.random.default_rng(seed).standard_normal(len(t))
    return yawing(rudder, noise=0.002) + 0.2 * np.sin(37.7 * t + phase) + gyro


Flown = tuple[Callable[[], SampleBlock], dict[str, Any], dict[str, Any]]
TURN = drift(0.15 / CALM.std(), 0.15, 2, SLOW)
ANSWERED: dict[str, Flown] = {
    "the rudder alone": (flight, {}, {"inputs": ALONE, "turn": False}),
    "an aileron that moves the nose": (lambda: flight(AILERON), {}, {"inputs": list(BOTH)}),
    "one that brings the fit nothing": (
        lambda: flight(AILERON, y=yawing(RUDDER, noise=NOISE)), {}, {"inputs": ALONE},
    ),
    "one in MANUAL": (lambda: flight(AILERON, mode=MANUAL), {}, {"inputs": list(BOTH)}),
    "one in an unknown mode": (lambda: flight(AILERON, mode=np.nan), {}, {"inputs": list(BOTH)}),
    "both inputs given": (both, {"inputs": BOTH}, {"inputs": list(BOTH)}),
    "both given where the mode holds roll": (
        lambda: both(FBWA), {"inputs": BOTH}, {"inputs": list(BOTH)},
    ),
    "a turn": (lambda: flight(**banked(0.1)), {}, {"turn": True}),
    "a large turn": (lambda: flight(**banked(0.8)), {}, {"turn": True}),
    "a turn that explains nothing": (lambda: flight(turn=banked(0.1)["turn"]), {}, {"turn": False}),
    "a turn of next to nothing": (lambda: flight(**banked(1e-4)), {}, {"turn": False}),
    "a turn that the stream removed": (
        lambda: flight(turn=banked(0.8)["turn"]), {"turn": "remove"}, {"turn": True},
    ),
    "one that only reacts": (reacting, {}, {"inputs": ALONE, "other": True}),
    "held samples inside": (with_gap, {}, {}),
    "an airspeed that grows by a quarter": (
        lambda: flight(airspeed=np.linspace(20.0, 25.0, len(RUDDER))),
        {"from_s": 0.0, "to_s": 40.0}, {},
    ),
    "noise of half the yaw rate": (
        lambda: flight(y=noisy(0.5)), {}, {"explained": pytest.approx(55.3, abs=4.0)},
    ),
    "no gusts": (lambda: gusts(0.0), {}, {"sure": True}),
    "gusts of 2 %": (lambda: gusts(0.02), {}, {"sure": True}),
    "gusts of 10 %": (lambda: gusts(0.1), {}, {"sure": True}),
    "a drift": (lambda: stream(RUDDER, y=CALM + drift(0.4, 0.2, 7, CALM)), {}, {}),
    "noise": (lambda: stream(RUDDER, y=noisy(0.2)), {}, {}),
    "a vibration above the mode": (lambda: stream(SLOW, y=vibrating(SLOW)), {}, {}),
    "turns as large as the yaw, removed": (
        lambda: stream(SLOW, y=yawing(SLOW, noise=NOISE), turn=TURN), {"turn": "remove"}, {},
    ),
    "a weak damper": (lambda: damped(0.2), {}, {"other": True}),
    "a damper that is warned of": (
        lambda: damped(0.6), {}, {"other": True, "said": ["closed_loop"]},
    ),
}  # fmt: skip
"""Samples, options, and what is found."""


def noisy(share: float) -> Floats:
    """Noise of ``share`` times the answer's size leaves 1 - share / sqrt(1 + share^2) of it."""
    y = yawing(RUDDER)
    return y + share * y.std() * np.random.default_rng(5).standard_normal(len(y))


def damped(gain: float) -> SampleBlock:
    """For .2, .6, 1.5 the part of the rudder that feeds back the yaw rate is .33, .81 and 1.3."""
    rudder, rate = fed_back(gain, slow_doublets(4), 0.002)
    return stream(rudder, y=rate)


T, Y = step(([0.9 * WN**2, WN**2], [1.0, 2.0 * ZETA * WN, WN**2]), T=np.linspace(0.0, 6.0, 6001))
SETTLED_S = T[np.abs(Y - 1.0) > 0.05 * np.abs(Y - 1.0).max()][-1]
"""When the yaw rate of :func:`yawing` stands after a step of the rudder, by SciPy, and how far its
second swing goes, of the first."""
OVERSHOOT_PCT = 100.0 * (1.0 - Y.min()) / (Y.max() - 1.0)


@pytest.mark.parametrize("name", ANSWERED)
def test_a_flight_is_answered_by_its_plants_dutch_roll(name: str):
    """And its samples stay as they are"""
    made, options, expected = ANSWERED[name]
    samples, untouched = made(), made()
    found = told(samples, **options)

    assert (found.n, found.verdict.usable, found.verdict.method) == (7, True, "ct")
    roll = found.dutch_roll
    if "other" not in expected:
        assert roll.wn_rad_s == pytest.approx(WN, rel=0.02)
        assert roll.zeta == pytest.approx(ZETA, abs=0.02)
        assert abs(roll.wn_rad_s - WN) < 3.0 * roll.wn_std
        assert abs(roll.zeta - ZETA) < 3.0 * roll.zeta_std
        swing = ((found.answer.settling_s, SETTLED_S), (found.answer.overshoot_pct, OVERSHOOT_PCT))
        for known, true in swing:
            assert abs(known.value - true) < 3.0 * known.std < 0.5 * true
    seen = {
        "inputs": found.inputs, "turn": found.turn_removed, "sure": roll.wn_std < 0.03 * WN,
        "explained": found.answer.fit.simulation_pct, "other": True,
        "said": [each.id for each in found.verdict.reasons],
    }  # fmt: skip
    assert {key: seen[key] for key in expected} == expected
    assert list(found.answer.response.residues) == found.inputs
    for column in ("u", "y", "aileron", "turn_rate"):
        np.testing.assert_array_equal(getattr(samples, column), getattr(untouched, column))


@pytest.mark.parametrize("zeta", [0.1, 0.25, 0.4, 0.6])
def test_the_sigmas_of_a_swing_are_the_scatter_of_answers_with_noise(zeta: float):
    pole, residue = 3.0 * complex(-zeta, math.sqrt(1.0 - zeta**2)), complex(1.0, -0.3)
    std = np.array([0.06, 0.05 * zeta, 0.08, 0.05])
    true = step_of(response([pole], {"rudder": [residue]}, std))
    rng, off = np.random.default_rng(3), []
    for noise in std * rng.normal(size=(100, 4)):
        wn, own, re, im = numbers([pole], [[residue]]) + noise
        seen = wn * complex(-own, math.sqrt(1.0 - own**2))
        found = step_of(response([seen], {"rudder": [complex(re, im)]}, std))
        off.append([(found[name].value - true[name].value) / found[name].std for name in true])
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert ((rms > 0.5) & (rms < 1.3)).all()
    assert (np.mean(np.abs(off) < 2.0, axis=0) > 0.9).all()


def test_an_aileron_that_is_the_rudders_copy_is_no_input():
    assert told(flight(0.5 * RUDDER)).inputs == ALONE


def foreign(y: Floats, seed: int, turn: Floats | float = 0.0) -> Callable[[], SampleBlock]:
    """A rudder that does nothing: a line, turns and gusts, none of them is a Dutch roll"""
    return lambda: stream(pulses(40, 16, 0.2, seed), y=y, turn=turn)


def no_response(rudder: Floats) -> Callable[[], SampleBlock]:
    noise = NOISE * np.random.default_rng(2).normal(size=len(rudder))
    return lambda: stream(rudder, y=noise)


def cut_off(rows: int) -> SampleBlock:
    rudder = doublets(30.0)[:rows]
    return stream(rudder, y=yawing(rudder, noise=NOISE))


REFUSED: dict[str, tuple[Callable[[], SampleBlock], dict[str, Any], str]] = {
    "a turn that is kept": (
        lambda: flight(**banked(0.8)), {"turn": "keep", "given": ("turn",)}, "",
    ),
    **{
        f"an airspeed by {share} at the end of a named stretch": (
            lambda share=share: flight(airspeed=np.linspace(20.0, 20.0 * share, len(RUDDER))),
            {"from_s": 0.0, "to_s": 40.0}, "the first and the last airspeed differ",
        )
        for share in (1.4, 0.7)
    },
    **{f"{rows} samples": (lambda rows=rows: cut_off(rows), {}, "") for rows in (1, 5, 18)},
    "all samples held": (no_response(np.full(400, np.nan)), {}, ""),
    "a rudder at rest": (no_response(rest(20, 0.3)), {}, ""),
    "no response": (no_response(RUDDER), {}, ""),
    **{
        f"another rudder, {what} {seed}": (foreign(y, seed, turn), {}, "")
        for seed in (100, 101, 102)
        for what, y, turn in (
            ("vibration", vibrating(SLOW), 0.0),
            ("turns", yawing(SLOW, noise=NOISE) + TURN, TURN),
        )
    },
    "a rudder that feeds back the yaw rate": (lambda: damped(1.5), {}, "mode_not_driven"),
    "a rudder that explains 17 % of the yaw rate": (lambda: flight(y=noisy(1.5)), {}, "poor_fit"),
    "inputs that move together": (lambda: both(share=0.5), {"inputs": BOTH}, "collinear_inputs"),
}  # fmt: skip
"""Samples, options, and a reason or a part of its text."""


@pytest.mark.parametrize("name", REFUSED)
def test_what_shows_no_dutch_roll_is_refused(name: str):
    made, options, expected = REFUSED[name]
    found = told(made(), **options)

    assert not found.verdict.usable
    assert expected in " ".join(f"{each.id}: {each.text}" for each in found.verdict.fatal)
    swings = [each.settling_s or each.overshoot_pct for each in found.estimates.values()]
    assert not any(swings)


@pytest.mark.parametrize(
    "options",
    [{"memory": 3.0}, {"memory": 0.5}, {"method": "els", "also": "none"}, {"orders": (2, 2, 2, 1)}],
)
def test_options_of_the_recursive_estimators_change_no_answer(options: dict[str, Any]):
    assert told(flight(), **options).answer == told(flight()).answer


@pytest.mark.parametrize("mode", [MANUAL, FBWA])
def test_the_rudder_alone_explains_less_where_it_is_given_or_the_mode_holds_roll(mode: float):
    free, alone = (told(flight(AILERON, mode=mode), given=given) for given in ((), ("inputs",)))

    assert alone.inputs == ALONE
    assert (free.inputs == ALONE) == (mode == FBWA)
    by_both, by_one = (each.answer.fit.simulation_pct for each in (free, alone))
    assert (by_both > by_one + 2.0) == (mode == MANUAL)


def rolling(seed: int) -> SampleBlock:
    """Strokes of the foot on a runway: a lag of .1 to .5 s without a Dutch roll, and its bumps"""
    rng = np.random.default_rng([7, seed])
    seconds, strength, noise, bumps_hz, lag_s = (
        rng.uniform(*span)
        for span in ((6.0, 14.0), (0.15, 0.4), (0.01, 0.12), (0.4, 2.0), (0.08, 0.5))
    )
    rng, n = np.random.default_rng(seed), round(seconds * HZ)
    rudder, at = np.zeros(n), HZ
    while at < n - 3 * HZ:
        width = rng.integers(6, 24)
        rudder[at : at + width] = strength * rng.choice([-1, 1]) * rng.uniform(0.5, 1)
        at += width + rng.integers(0, 30)
    decay = math.exp(-TS_S / lag_s)
    yaw = lfilter([0.0, 0.8 * (1.0 - decay)], [1.0, -decay], rudder)
    bumps = lfilter(*butter(2, bumps_hz / (HZ / 2)), rng.standard_normal(n + 100))[100:]
    return stream(rudder, y=yaw + noise * bumps / bumps.std(), airspeed=15.0)


@pytest.mark.parametrize("seed", [10, 42, 145, 241, 469, 8, 29, 34, 100, 182, 295, 354, 433, 453])
def test_a_roll_on_a_runway_has_no_usable_answer(seed: int):
    """A lag alone explains the yaw rate; a pair next to it is a line of the bumps

    Those from 8 on had all that a pair needs but an effect of the rudder on it.
    """
    assert not told(rolling(seed)).verdict.usable


@pytest.mark.parametrize(("noise", "seed"), [(0.15, 9), (0.165, 15), (0.165, 16), (0.18, 8)])
def test_in_vibration_and_noise_the_answer_is_right_or_none(noise: float, seed: int):
    found = told(stream(SLOW, y=vibrating(SLOW, noise, seed)))

    roll = found.dutch_roll
    assert roll is None or roll.wn_rad_s == pytest.approx(WN, rel=0.1)
    for number, true in ((roll.wn_rad_s, WN), (roll.zeta, ZETA)) if found.verdict.usable else ():
        std = roll.wn_std if true == WN else roll.zeta_std
        assert abs(number - true) < 2.0 * std


def test_in_strong_gusts_sigma_is_large():
    roll = told(gusts(0.5)).dutch_roll

    assert abs(roll.wn_rad_s - WN) < 2.0 * roll.wn_std
    assert abs(roll.zeta - ZETA) < 2.0 * roll.zeta_std
    assert roll.wn_std > 0.03 * WN


def test_a_roll_loop_makes_zeta_less_sure_and_has_no_level_of_flying_qualities():
    bare, closed, unknown = (told(flight(mode=mode)).dutch_roll for mode in (MANUAL, FBWA, np.nan))
    both_inputs = told(flight(AILERON, mode=np.nan)).dutch_roll

    added = 0.04 * closed.zeta
    assert closed.zeta_std == pytest.approx(math.hypot(bare.zeta_std, added))
    assert closed.wn_std == bare.wn_std
    assert both_inputs.zeta_std < 0.04 * both_inputs.zeta
    assert [each.level is None for each in (bare, closed, unknown)] == [False, True, True]


def test_a_default_that_is_given_on_the_command_line_binds(tmp_path):
    """--turn keep is the default, and still an order: RunConfig.given holds that it was said"""
    log, removed = REPLAY_LOGS / "c172p_reboot" / "log.tlog", []
    for options in ((), ("--turn", "keep")):
        summary = yawid.load(replayed(log, tmp_path / str(len(options)), *options)).summary
        removed.append([each.turn_removed for each in summary.manoeuvres])
    assert removed == [[True, True], [False, False]]


@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize("gain", [0.1, 0.4, 1.5])
def test_the_gain_of_a_damper_is_found_between_a_pilots_movements(gain: float, noise: float):
    rudder, rate = fed_back(gain, slow_doublets(10), noise)
    found = rate_feedback(rudder, rate, np.full(len(rate), np.nan), 4.0, TS_S)

    assert found.gain == pytest.approx(-gain, rel=0.15)
    # |r / rudder| at 4 rad/s is 1 / (2 zeta), less on both sides of it.
    assert 0.3 * gain / 0.4 < found.share < 1.05 * gain / 0.4


SWEPT_S = 0.005 * np.arange(8000)


@pytest.mark.parametrize(
    "pilot",
    [slow_doublets(10), 0.2 * np.sin((0.3 + 0.2 * SWEPT_S) * SWEPT_S)],
    ids=["doublets", "sweep"],
)
def test_a_pilots_rudder_is_no_feedback(pilot: Floats):
    rudder, rate = fed_back(0.0, pilot, 0.002)
    found = rate_feedback(rudder, rate, np.full(len(rate), np.nan), 4.0, TS_S)

    assert found is None or found.share < 0.1
