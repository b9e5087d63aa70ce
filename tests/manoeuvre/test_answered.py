"""The answer of one manoeuvre, on a plant whose Dutch roll is known."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from manoeuvre.streams import HZ, TS_S, WN, ZETA, doublets, flown, rest, stream, yawing
from places import C172P
from scipy.signal import butter, lfilter

from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import Floats, SampleBlock
from yawid.cli.main import main
from yawid.config.run import BOTH, RunConfig
from yawid.manoeuvre.answer import HIDDEN_ZETA
from yawid.manoeuvre.answered import answer
from yawid.manoeuvre.judge import ManoeuvreSetting

NOISE = 0.002
MANUAL, FBWA = 0.0, 5.0


def told(samples: SampleBlock, **options: Any) -> Manoeuvre:
    return answer(samples, 7, ManoeuvreSetting(RunConfig(**options), TS_S, (20.0, 20.0), (3, 1)))


def prbs(seconds: float, amplitude: float, seed: int) -> Floats:
    """Pulses of 0.3 s that go either way"""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=round(seconds * HZ / 6) + 1)
    return amplitude * np.repeat(signs, 6)[: round(seconds * HZ)]


RUDDER = flown(rest(1), prbs(30, 0.2, 1), rest(5))
AILERON = flown(rest(1), prbs(30, 0.1, 2), rest(5))


def flight(aileron: Floats | float = 0.0, **options: Any) -> SampleBlock:
    y = yawing(RUDDER, aileron, noise=NOISE)
    return stream(RUDDER, y=options.pop("y", y), aileron=aileron, **options)


def assert_right(found: Manoeuvre, wn_share: float = 0.02) -> None:
    roll = found.dutch_roll
    assert roll.wn_rad_s == pytest.approx(WN, rel=wn_share)
    assert roll.zeta == pytest.approx(ZETA, abs=0.02)
    assert abs(roll.wn_rad_s - WN) < 4.0 * roll.wn_std
    assert abs(roll.zeta - ZETA) < 4.0 * roll.zeta_std


def test_it_is_the_plants_dutch_roll():
    found = told(flight())

    assert_right(found)
    assert found.n == 7
    assert found.inputs == ["rudder"]
    assert not found.turn_removed
    assert found.verdict.method == "ct"
    assert found.verdict.usable


@pytest.mark.parametrize(
    "options",
    [
        {"memory": 3.0},
        {"memory": 0.5},
        {"method": "els", "also": "none"},
        {"orders": (2, 2, 2, 1)},
    ],
)
def test_options_of_the_recursive_estimators_change_no_answer(options: dict[str, Any]):
    assert told(flight(), **options).answer == told(flight()).answer


@pytest.mark.parametrize(("share", "is_poor"), [(1.5, True), (0.5, False)])
def test_a_rudder_that_explains_too_little_of_the_yaw_rate_is_refused(share: float, is_poor: bool):
    """Noise of ``share`` times the answer's size leaves 1 - share / sqrt(1 + share^2) of it."""
    y = yawing(RUDDER, 0.0, noise=0.0)
    noise = share * y.std() * np.random.default_rng(5).standard_normal(len(y))
    found = told(flight(y=y + noise))

    left = 100.0 * (1.0 - share / math.hypot(1.0, share))
    assert found.answer.fit.simulation_pct == pytest.approx(left, abs=4.0)
    assert ("poor_fit" in [each.id for each in found.verdict.fatal]) == is_poor


def test_an_aileron_that_moves_the_nose_on_its_own_is_an_input_too():
    """By the rudder alone the fit is poor; by both it is the plant"""
    found = told(flight(AILERON))

    assert found.inputs == list(BOTH)
    assert list(found.answer.response.residues) == list(BOTH)
    assert_right(found)
    alone = told(flight(AILERON), given=("inputs",))
    assert alone.inputs == ["rudder"]
    by_both, by_one = (each.answer.fit for each in (found, alone))
    assert by_both.simulation_pct > by_one.simulation_pct + 2.0


def test_an_aileron_that_brings_the_fit_nothing_is_not_an_input():
    y = yawing(RUDDER, 0.0, noise=NOISE)
    assert told(flight(AILERON, y=y)).inputs == ["rudder"]


def test_an_aileron_that_is_the_rudders_copy_is_not_an_input():
    samples = stream(RUDDER, y=yawing(RUDDER, 0.5 * RUDDER, noise=NOISE), aileron=0.5 * RUDDER)
    assert told(samples).inputs == ["rudder"]


def test_an_aileron_that_only_reacts_is_not_an_input():
    """A pilot or a damper that levels the wings: what yaw rate and roll explain moves nothing"""
    y = yawing(RUDDER, 0.0, noise=NOISE)
    for _ in range(20):  # the loop closed by iteration
        roll = lfilter([TS_S], [1.0, -0.98], 0.5 * y)
        reaction = np.concatenate([[0.0], -0.6 * roll[:-1] - 0.3 * y[:-1]])
        y = yawing(RUDDER, reaction, noise=NOISE)
    found = told(stream(RUDDER, y=y, aileron=reaction, roll=roll))

    assert np.ptp(reaction) > 0.1
    assert found.inputs == ["rudder"]


def test_in_a_mode_that_holds_roll_the_aileron_is_no_input():
    assert told(flight(AILERON, mode=FBWA)).inputs == ["rudder"]
    assert told(flight(AILERON, mode=MANUAL)).inputs == list(BOTH)
    assert told(flight(AILERON, mode=np.nan)).inputs == list(BOTH)


@pytest.mark.parametrize("mode", [MANUAL, FBWA])
def test_inputs_that_were_given_bind(mode: float):
    one = told(flight(AILERON, mode=mode), inputs=("rudder",), given=("inputs",))
    assert one.inputs == ["rudder"]
    u = np.column_stack([RUDDER, AILERON])
    both = told(replace(flight(AILERON, mode=mode), u=u), inputs=BOTH)
    assert both.inputs == list(BOTH)
    assert_right(both)


def test_inputs_that_move_together_are_refused():
    u = np.column_stack([RUDDER, 0.5 * RUDDER])
    y = yawing(RUDDER, 0.5 * RUDDER, noise=NOISE)
    found = told(replace(stream(RUDDER, y=y, aileron=u[:, 1]), u=u), inputs=BOTH)

    assert "collinear_inputs" in {reason.id for reason in found.verdict.reasons}
    assert not found.verdict.usable


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


@pytest.mark.parametrize(("last", "is_refused"), [(1.25, False), (1.4, True), (0.7, True)])
def test_an_airspeed_that_is_another_one_at_the_end_refuses_a_stretch_that_was_named(
    last: float, is_refused: bool
):
    """Which is never cut: wn goes with the airspeed"""
    speed = np.linspace(20.0, 20.0 * last, len(RUDDER))
    found = told(flight(airspeed=speed), from_s=0.0, to_s=40.0)

    assert [reason.id for reason in found.verdict.fatal] == ["not_converged"] * is_refused
    assert not is_refused or "the first and the last airspeed differ" in found.verdict.fatal[0].text


def banked(strength: float) -> dict[str, Any]:
    turn = strength * np.sin(0.25 * np.arange(len(RUDDER)) * TS_S)
    return {"turn": turn, "y": yawing(RUDDER, noise=NOISE) + turn}


@pytest.mark.parametrize("strength", [0.1, 0.8])
def test_the_turn_is_removed_where_the_yaw_rate_is_fitted_better_without(strength: float):
    found = told(flight(**banked(strength)))

    assert found.turn_removed
    assert_right(found)


def test_a_turn_that_explains_nothing_stays():
    assert not told(flight(turn=banked(0.1)["turn"])).turn_removed
    assert not told(flight(**banked(1e-4))).turn_removed


def test_a_turn_that_was_given_binds():
    kept = told(flight(**banked(0.8)), turn="keep", given=("turn",))
    assert not kept.turn_removed
    assert not kept.verdict.usable


def test_a_turn_that_the_stream_removed_is_not_removed_again():
    """Its y has come without it"""
    found = told(flight(turn=banked(0.8)["turn"]), turn="remove")

    assert found.turn_removed
    assert_right(found)


@pytest.mark.parametrize(("mode", "has_level"), [(MANUAL, True), (FBWA, False), (np.nan, False)])
def test_a_level_of_flying_qualities_is_the_airframes_alone(mode: float, has_level: bool):
    found = told(flight(mode=mode))
    for each in found.estimates.values():
        assert (each.dutch_roll.level is not None) == has_level


def test_a_roll_loop_makes_zeta_less_sure_where_the_aileron_is_no_input():
    closed, bare = (told(flight(mode=mode)).dutch_roll for mode in (FBWA, MANUAL))
    both = told(flight(AILERON, mode=np.nan))

    added = HIDDEN_ZETA * closed.zeta
    assert closed.zeta_std == pytest.approx(math.hypot(bare.zeta_std, added))
    assert closed.wn_std == bare.wn_std
    assert both.inputs == list(BOTH)
    assert both.dutch_roll.zeta_std < 0.04 * both.dutch_roll.zeta


@pytest.mark.parametrize("rows", [1, 5, 18])
def test_a_stretch_that_is_too_short_is_refused_with_a_reason(rows: int):
    rudder = doublets(30.0)[:rows]
    found = told(stream(rudder, y=yawing(rudder, noise=NOISE)))

    assert not found.verdict.usable
    assert found.dutch_roll is None


@pytest.mark.parametrize("what", ["all held", "rudder at rest", "no response"])
def test_what_tells_nothing_is_refused(what: str):
    rudder = {"all held": np.full(400, np.nan), "rudder at rest": rest(20, 0.3)}.get(what, RUDDER)
    y = NOISE * np.random.default_rng(2).normal(size=len(rudder))
    found = told(stream(rudder, y=y))

    assert not found.verdict.usable


def test_held_samples_inside_are_no_samples():
    samples = flight()
    gone = slice(200, 230)
    u, y, held = samples.u.copy(), samples.y.copy(), samples.held.copy()
    u[gone], y[gone], held[gone] = np.nan, np.nan, 1
    assert_right(told(replace(samples, u=u, y=y, held=held)))


def test_the_samples_are_not_changed():
    samples = flight(AILERON, **banked(0.8))
    kept = {name: np.copy(getattr(samples, name)) for name in ("u", "y", "aileron", "turn_rate")}
    told(samples)
    for name, before in kept.items():
        np.testing.assert_array_equal(getattr(samples, name), before)


def test_inputs_given_on_the_command_line_bind(capsys, monkeypatch, tmp_path):
    """--inputs rudder is the default, and still an order: RunConfig.given holds that it was said"""
    seen = []

    def noted(samples: SampleBlock, n: int, setting: ManoeuvreSetting, *more: Any) -> Manoeuvre:
        seen.append(setting.config)
        return answer(samples, n, setting, *more)

    monkeypatch.setattr("yawid.manoeuvre.stage.answer", noted)
    usual = ["replay", str(C172P), "--rerun", "off", "--json", "--out"]
    for options in ([], ["--inputs", "rudder"], ["--turn", "keep", "--orders", "3,3,2,1"]):
        main([*usual, str(tmp_path / "".join(options)), *options])
        (line,) = capsys.readouterr().out.splitlines()
        assert json.loads(line)["manoeuvres"]
        given = {option.removeprefix("--") for option in options[::2]}
        assert {name for name in ("inputs", "turn", "orders") if seen[-1].binds(name)} == given
