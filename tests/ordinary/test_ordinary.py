"""The answer of an ordinary flight, against linear aircraft that are simulated exactly."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from ordinary_plant import AIRSPEED_M_S, DERIVATIVES, LAW, blocks, flown, truth

from yawid.answers.ordinary import OrdinaryAnswer
from yawid.blocks import MotionBlock
from yawid.lateral.model import Guess, Law
from yawid.lateral.motion import COMMAND_STEP_S, Motion
from yawid.ordinary import Ordinary, answer_of
from yawid.ordinary.fit import fit, is_stable, loss_of, slope_of
from yawid.ordinary.model import AT, FREE, NAMES, Band, known_before
from yawid.ordinary.spectra import Sums, spectra, window_sums
from yawid.quantities.airspeed import GRAVITY

GUST = 0.01
SMALL = DERIVATIVES | {
    "Y_beta": -0.5, "L_beta": -36.0, "L_p": -12.0, "L_r": 2.0, "L_delta_a": 60.0,
    "N_beta": 36.0, "N_p": -0.3, "N_r": -2.0,
}  # fmt: skip
START = dict.fromkeys(NAMES, 0.0) | DERIVATIVES | {
    "log_Y_beta": np.log(-DERIVATIVES["Y_beta"]), "N_delta_r": 1.0, "log_span_lag": -12.0,
    "log_gust": np.log(GUST), "log_roll_gust": np.log(GUST), "log_yaw_gust": np.log(1e-8),
    "log_sigma_p": np.log(0.0004), "log_sigma_roll": np.log(0.00012),
    "log_sigma_r": np.log(0.0004), "log_gust_rate": np.log(0.4), "log_roll_gust_rate": np.log(4.0),
}  # fmt: skip
"""What ``flown`` is made of: noise of .002 at 25 Hz has a density of .0004^2."""
X = np.array([START[name] for name in NAMES])


def streamed(flight: np.ndarray, pieces: int = 1) -> Ordinary:
    """Return a flight taken in as so many blocks."""
    motion, samples = blocks(flight)
    stream = Ordinary()
    for rows in np.array_split(np.arange(len(samples)), pieces):
        cut = slice(int(rows[0]), int(rows[-1]) + 1)
        parts = motion.attitude.select(cut), motion.commands.select(cut), motion.acceleration
        stream.store.feed(MotionBlock(*parts))
        stream.feed(samples.select(cut))
    stream.finish()
    return stream


def answered(seed: int, **how: Any) -> OrdinaryAnswer:
    return answer_of(streamed(flown(seed, **how)))


def band_of(sums: Sums, low: float, high: float) -> Band:
    known = known_before(Guess(START, 2.0, 0.0))
    return Band(*spectra(sums, low, high), AIRSPEED_M_S, Law(*LAW), known)


@pytest.mark.parametrize(("frozen", "span_s"), [(0.0, 0.0), (1.0, 0.0), (1.0, 0.3)])
def test_the_spectra_of_a_linear_aircraft_are_those_of_the_model(
    frozen: float, span_s: float
) -> None:
    how = {"frozen": frozen, "span_s": span_s}
    sums = streamed(flown(1, seconds=900.0, gust=GUST, turns=False, **how)).sums()
    data, x = band_of(sums, 0.6, 7.0), X.copy()
    x[AT["frozen"]], x[AT["log_span_lag"]] = frozen, np.log(span_s + 1e-5)

    G, S = (each[0] for each in data.predict(x[None]))
    _, E = data.left_over(G)
    white = np.einsum("bij,bji->b", np.linalg.inv(S), E).real

    for part in np.array_split(np.arange(len(data.w)), 4):
        count = 3.0 * data.n[part].sum()
        assert white[part].sum() / count == pytest.approx(1.0, abs=4.0 / np.sqrt(count))


def test_the_slope_is_that_of_the_likelihood() -> None:
    data = band_of(streamed(flown(2, seconds=300.0)).sums(), 0.6, 7.0)
    x = X + 0.1 * np.cos(np.arange(len(X)))

    slope, _ = slope_of(x, data)

    for at, found in zip(FREE, slope, strict=True):
        step = 1e-4 * np.eye(len(x))[at]
        up, down = (loss_of(x + sign * step, data) for sign in (1.0, -1.0))
        assert found == pytest.approx((up - down) / 2e-4, rel=1e-4, abs=1e-3), NAMES[at]


def test_any_cut_of_the_stream_gives_the_same_to_the_bit() -> None:
    flight = flown(3, seconds=400.0)
    whole = streamed(flight).sums()

    for pieces in (7, 400, len(flight) // 3):
        cut = streamed(flight, pieces).sums()
        assert np.array_equal(cut.Z, whole.Z)
        assert np.array_equal(cut.law, whole.law)
        assert (cut.seconds, cut.turns, cut.speed) == (whole.seconds, whole.turns, whole.speed)


def test_sums_are_kept_as_a_text_to_seven_digits() -> None:
    sums = streamed(flown(3, seconds=170.0)).sums()

    again = Sums.unpacked(sums.packed())

    for name in Sums.__slots__:
        one, other = getattr(again, name), getattr(sums, name)
        np.testing.assert_allclose(one, other, rtol=2e-7, atol=1e-12 * np.abs(other).max())
        assert type(one) is type(other)
    assert len(sums.packed()) < 40_000


@pytest.mark.parametrize(
    ("seed", "of", "how", "most_share"),
    [
        pytest.param(4, DERIVATIVES, {"gust": 0.001}, 1.0, id="calm air"),
        pytest.param(6, DERIVATIVES, {"gust": 0.02}, 1.0, id="gusts", marks=pytest.mark.long),
        pytest.param(
            15, SMALL, {"gust": 0.04, "frozen": 1.0, "span_s": 0.1, "law": (0.5, 0.02)}, 0.05,
            id="a small aircraft whose turns are a small part",
        ),
    ],
)  # fmt: skip
def test_the_mode_of_a_linear_aircraft_is_found_in_calm_air_and_in_gusts(
    seed: int, of: dict[str, float], how: dict[str, Any], most_share: float
) -> None:
    found = answered(seed, derivatives=of, **how)

    wn, zeta = truth(of)
    assert found, found.verdict.reasons
    assert abs(found.dutch_roll.wn_rad_s - wn) < 2.0 * found.dutch_roll.wn_std
    assert abs(found.dutch_roll.zeta - zeta) < 2.0 * found.dutch_roll.zeta_std
    assert found.dutch_roll.wn_std >= 0.025 * found.dutch_roll.wn_rad_s
    assert found.law.k_roll == pytest.approx(how.get("law", LAW)[0], rel=0.1)
    assert found.share < most_share
    told = found.to_json()
    assert {"dutch_roll", "law", "seconds", "spectrum", "verdict"} <= told.keys()
    assert len(told["spectrum"]["w_rad_s"]) == len(told["spectrum"]["measured"]["r"])
    for name, each in found.derivatives.items():
        assert abs(each.value - of[name]) < 3.0 * each.std, name


def test_a_roll_hold_that_integrates_is_found_in_gusts() -> None:
    found = answered(16, gust=0.02, law=(1.2, 0.2), integral=0.8)

    assert found, found.verdict.reasons
    assert found.dutch_roll.wn_rad_s == pytest.approx(truth()[0], rel=0.05)
    assert found.law.k_p == pytest.approx(0.2, abs=0.06)
    assert found.law.k_integral == pytest.approx(0.8, rel=0.15)


def test_the_angle_of_attack_of_a_turn_is_in_what_it_does_to_sideslip() -> None:
    t_s = 0.05 * np.arange(2400)
    roll = 0.4 * np.sin(0.3 * t_s + np.sin(0.9 * t_s))
    p = np.gradient(roll, t_s)
    alpha = 0.06 / np.cos(roll)
    pitch = np.arctan(np.tan(alpha) * np.cos(roll))
    bank = GRAVITY / AIRSPEED_M_S * np.cos(pitch) * np.sin(roll)
    r = bank / np.cos(alpha) + p * np.tan(alpha)  # beta stays 0
    rest = np.zeros(round(120.0 / COMMAND_STEP_S) + 1)
    motion = Motion(
        sample_time_s=0.05, p=p, r=r, roll=roll, pitch=pitch, q=0.0 * p, commands_start_s=0.0,
        rudder=rest, aileron=rest, airspeed_m_s=AIRSPEED_M_S,
    )  # fmt: skip

    _, _, Z = spectra(window_sums(motion, 0.0 * p, 120.0, 1), 0.3, 3.0)

    level, g = float(pitch.mean()), GRAVITY / AIRSPEED_M_S
    left = np.array([-np.tan(level), 1.0, -g * np.cos(level), 0.0, -g, 0.0])
    power = (left @ Z @ left).real.sum()
    assert power < 1e-5 * Z[:, 1, 1].real.sum()


def test_a_record_that_begins_in_flight_before_its_first_command_loses_a_second_of_it() -> None:
    flight = flown(17, seconds=400.0)
    flight[:, 0] += 10.0  # at 40 s a piece begins

    stream = streamed(flight)

    assert stream.sums().seconds == pytest.approx(400.0)
    assert sum(stream.lost_s.values()) == 0.0


def test_an_unstable_aircraft_is_never_reached_although_the_spectra_are_the_same() -> None:
    data, mirrored = band_of(streamed(flown(7, seconds=400.0)).sums(), 0.6, 7.0), X.copy()
    mirrored[AT["N_r"]] = 2.0

    found = fit(X, data)

    assert not is_stable(mirrored, data)
    assert is_stable(found.x, data)


def with_aileron_reversed() -> np.ndarray:
    flight = flown(8)
    flight[:, 4] *= -1.0
    return flight


def with_line(wn_part: float) -> np.ndarray:
    """A flight with a line in the yaw rate near the mode"""
    flight = flown(12, gust=0.005)
    rng, n = np.random.default_rng(12), len(flight)
    w = 2.0 * np.pi * np.fft.rfftfreq(n, 0.04)
    narrow = rng.normal(size=(2, len(w))) * (np.abs(w - wn_part * truth()[0]) < 0.15)
    line = np.fft.irfft(narrow[0] + 1j * narrow[1], n)
    flight[:, 2] += np.sqrt(0.5) * flight[:, 2].std() / line.std() * line
    return flight


@pytest.mark.parametrize(
    ("made", "id_", "is_early", "said"),
    [
        pytest.param(
            lambda: flown(8, turns=False, gust=0.02), "only_feedback", True, (), id="no turns"
        ),
        pytest.param(
            with_aileron_reversed, "aileron_reversed", True, ("--aileron",), id="a reversed aileron"
        ),
        pytest.param(
            lambda: flown(9, seconds=200.0), "too_short", True, ("290 s", "180 s of 200 s"),
            id="a short flight",
        ),
        pytest.param(lambda: flown(10, damper=0.5), "rudder_moves", True, (), id="a yaw damper"),
        # Although the turns explain the yaw rate.
        *(
            pytest.param(
                lambda damper=damper: flown(14, damper=damper, gust=0.0), "rudder_moves", True, (),
                id=f"a yaw damper of {damper} in calm air",
            )
            for damper in (0.5, 0.13)
        ),
        pytest.param(lambda: with_line(0.8), "line", False, (), id="a line near the mode"),
        pytest.param(
            lambda: with_line(1.0), "line", False, (), id="a line at it", marks=pytest.mark.long
        ),
    ],
)  # fmt: skip
def test_a_flight_that_shows_no_mode_is_refused_with_its_reason_if_it_can_be_before_any_fit(
    made: Callable[[], np.ndarray], id_: str, is_early: bool, said: tuple[str, ...]
) -> None:
    found = answer_of(streamed(made()))

    first, *others = found.verdict.reasons
    assert (found.dutch_roll is None, others == []) == (is_early, is_early)
    assert first.id == id_
    assert first.remedy
    for each in said:
        assert each in f"{first.text} {first.remedy}"
