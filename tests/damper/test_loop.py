"""The damper's loop: margins and closed poles by hand, the law against the autopilot's steps."""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.signal import lfilter, residue

from yawid.damper.advice import spread
from yawid.damper.autopilots import AUTOPILOTS, Autopilot, Law
from yawid.damper.loop import closed_dutch_roll, known_frequencies, margins, settling_times
from yawid.physics.continuous import Transfer, settling_of

PLANE = {"SCALING_SPEED": 15.0, "AIRSPEED_MIN": 10.0, "AIRSPEED_MAX": 30.0}
PLAIN = Law(1.0, 0.0, 0.0, 0.0, 0.0)


def of_poles(*poles: complex, gain: float = 1.0) -> Transfer:
    """Return gain / product of (s - p), by its partial fractions."""
    p = np.array([poles], complex)
    others = p[0][:, None] - p[0][None, :]
    np.fill_diagonal(others, 1.0)
    return Transfer(p, gain / np.prod(others, axis=1)[None])


def test_the_margins_of_three_lags() -> None:
    # 1/((s+1)(s+2)(s+3)) is on the limit with a gain of 60, at sqrt(11) rad/s.
    G, w = of_poles(-1.0, -2.0, -3.0), np.geomspace(0.01, 30.0, 3000)

    phase_deg, gain_db, _ = margins(G, PLAIN, np.array([0.0, 10.0, 30.0, 120.0]), w)

    assert gain_db[1:, 0] == pytest.approx(20.0 * np.log10([6.0, 2.0, 0.5]), abs=1e-3)
    crossing = brentq(lambda x: (x**2 + 1) * (x**2 + 4) * (x**2 + 9) - 30.0**2, 0.1, 10.0)
    angle = sum(math.degrees(math.atan2(crossing, p)) for p in (1.0, 2.0, 3.0))
    assert phase_deg[2, 0] == pytest.approx(180.0 - angle, abs=0.01)
    assert phase_deg[3, 0] < 0.0
    assert np.isinf(phase_deg[0, 0])
    assert np.isinf(gain_db[0, 0])


@pytest.mark.parametrize(
    ("size", "zeros", "pole", "law", "gain"),
    [
        # Below the mode the washout leads: there the phase left to +180 degrees counts.
        (1.0, [], complex(-0.3, 3.0), Law(1.0, 6.0, 0.0, 0.0, 0.05), 8.0),
        # The sign of the gain at rest does not turn the margin at the mode.
        (6.0, [-0.3], complex(-0.5, math.sqrt(24.75)), Law(1.0, 0.8, 0.0, 0.0, 0.02), 0.5),
        (6.0, [0.3], complex(-0.5, math.sqrt(24.75)), Law(1.0, 0.8, 0.0, 0.0, 0.02), 0.5),
    ],
)
def test_the_phase_margin_is_the_least_on_either_side_of_the_mode(
    size: float, zeros: list[float], pole: complex, law: Law, gain: float
) -> None:
    """Behind a washout and a delay"""
    r = size * np.prod(pole - np.array(zeros)) / (pole - pole.conjugate())
    G = Transfer(np.array([[pole, pole.conjugate()]]), np.array([[r, np.conj(r)]]))

    found = margins(G, law, np.array([gain]), np.geomspace(0.05, 40.0, 4000))[0][0, 0]

    s = 1j * np.geomspace(0.05, 40.0, 20_000)
    plant = size * np.prod([s - each for each in zeros], axis=0)
    L = law.at(s, gain) * plant / ((s - pole) * (s - pole.conjugate()))
    at = np.flatnonzero(np.diff(np.abs(L) > 1.0))
    assert len(at) == 2
    assert found == pytest.approx(180.0 - np.abs(np.degrees(np.angle(L[at]))).max(), abs=0.2)


def test_what_still_crosses_above_the_known_frequencies_is_marked() -> None:
    G = of_poles(-1.0, gain=5.0)

    _, _, beyond = margins(G, PLAIN, np.array([1.0, 3.0]), np.geomspace(0.1, 9.0, 50))
    assert beyond.T.tolist() == [[False, True]]
    assert known_frequencies(10.0, 0.05)[-1] == pytest.approx(0.2 * 20.0 * math.tau)
    assert known_frequencies(2.0, 0.05)[[0, -1]] == pytest.approx([0.2, 6.0])


PAIR, SLOW = complex(-1.0, 5.0), complex(-0.4, 5.0)


@pytest.mark.parametrize(
    ("poles", "size", "law", "gains"),
    [
        ((PAIR, PAIR.conjugate(), -7.0), 60.0, Law(0.6, 0.8, 0.0, 0.0, 0.0), (0.0, 0.5, 1.0, 2.0)),
        ((SLOW, SLOW.conjugate()), 10.0, Law(1.0, 0.5, 0.0, 0.2, 0.06), (0.0, 0.1, 0.5)),
    ],
)
def test_the_closed_pair_is_a_root_of_the_characteristic_equation(
    poles: tuple[complex, ...], size: float, law: Law, gains: tuple[float, ...]
) -> None:
    """A gain on the washed-out yaw rate, an integrator as it is, and a delay, which hardly errs."""
    G, (k, washout, _, integral, delay_s) = of_poles(*poles, gain=size), astuple(law)

    found = closed_dutch_roll(G, law, np.array(gains))[:, 0]

    assert integral > 0.0 or found[0] == pytest.approx(poles[0], rel=1e-9)
    for gain, s in zip(gains, found, strict=True):
        acts = (k * gain * s / (s + washout) + integral / s) * np.exp(-delay_s * s)
        assert abs(np.prod(s - np.array(poles)) + size * acts) < 1e-4
        assert s.imag > 0.0


def test_the_damped_swing_settles_as_that_of_the_closed_loops_transfer_function() -> None:
    """Of 60 (s + .8) / ((s - p) (s - p*) (s + 7) (s + .8) + 36 g s), by SciPy."""
    G, law = of_poles(PAIR, PAIR.conjugate(), -7.0, gain=60.0), Law(0.6, 0.8, 0.0, 0.0, 0.0)
    gains = np.array([0.0, 0.5, 2.0])

    found = settling_times(G, law, gains, closed_dutch_roll(G, law, gains))[:, 0]

    for gain, own in zip(gains.tolist(), found, strict=True):
        den = np.poly([PAIR, PAIR.conjugate(), -7.0, -0.8]).real
        r, p, _ = residue([60.0, 48.0], np.polyadd(den, [36.0 * gain, 0.0]))
        upper = np.argmax(p.imag)
        assert own == pytest.approx(settling_of(p[upper], r[upper]), rel=1e-5)


def test_a_pair_that_becomes_two_real_poles_is_left_out() -> None:
    # s^2 + (2 + 10 g) s + 25: real from g = 0.8 on.
    pole = complex(-1.0, math.sqrt(24.0))
    residue = 10.0 * pole / (pole - pole.conjugate())
    G = Transfer(np.array([[pole, pole.conjugate()]]), np.array([[residue, residue.conjugate()]]))

    s = closed_dutch_roll(G, PLAIN, np.array([0.0, 0.4, 0.79, 1.0, 2.0]))[:, 0]

    assert (-s.real / np.abs(s))[:3] == pytest.approx([0.2, 0.6, 0.99], abs=1e-6)
    assert np.isnan(s[3:]).all()


def test_a_draw_whose_pair_becomes_real_stays_in_sigma_with_its_last_value() -> None:
    zeta = np.array([[0.5, 0.6, 0.7, 0.5, 0.7, 0.6], [0.5, 0.6, 0.7, 0.5, 0.9, 0.6]])
    after = np.array([0.5, 0.6, 0.7, 0.5, np.nan, 0.6])

    middle, std = spread(np.vstack([zeta, after]))

    # The median is .6 with the fifth draw and without it.
    assert middle == pytest.approx([0.6, 0.6, 0.6])
    squares = [0.01 + 0.01 + 0.01 + late**2 for late in (0.1, 0.3, 0.3)]
    assert std == pytest.approx(np.sqrt(np.array(squares) / 6.0))


@pytest.mark.parametrize("loop_hz", [50.0, 400.0])
def test_arduplanes_damper_is_the_one_of_its_source(loop_hz: float) -> None:
    values = PLANE | {"YAW2SRV_DAMP": 0.3, "YAW2SRV_INT": 0.5}
    law = AUTOPILOTS["ardupilot"].law(values, loop_hz, 20.0)
    scaler, w = 15.0 / 20.0, 4.0

    # The source's steps, at the loop's rate, for a yaw rate of sin(w t); see AP_YawController.cpp.
    times = np.arange(round(60.0 * loop_hz)) / loop_hz
    r = np.degrees(np.sin(w * times))
    washed = lfilter([1.0, -1.0], [1.0, -0.9960080], r)
    integrator = np.cumsum(-0.5 * washed / loop_hz)
    put_out = 0.3 * scaler**2 * (integrator - washed) / 45.0
    later = times > 30.0
    wave = np.exp(-1j * w * times[later])
    u = put_out[later] - put_out[later].mean()
    found = 2.0j * np.mean(u * wave)
    # Held until the next call, it comes half a period later.
    found *= np.exp(-0.5j * w / loop_hz)

    assert -law.at(np.array([1j * w]), 0.3)[0] == pytest.approx(found, rel=0.02)


def test_the_scaling_is_held_as_in_the_sources() -> None:
    plane, px4 = AUTOPILOTS["ardupilot"], AUTOPILOTS["px4"]
    speeds = (1.0, 15.0, 22.0, 100.0)

    def scaling(autopilot: Autopilot, values: dict[str, float], speed: float) -> float:
        """Return S: a gain of 1 counts as S^2 times that at S = 1."""
        unit = math.degrees(1.0) / 45.0 if autopilot is plane else 1.0
        return math.sqrt(autopilot.law(values, 50.0, speed).scaling / unit)

    assert [scaling(plane, PLANE, v) for v in speeds] == pytest.approx(
        [15.0 / 7.0, 1.0, 15.0 / 22.0, 0.25]
    )
    old = {"SCALING_SPEED": 15.0, "ARSPD_FBW_MIN": 10.0, "ARSPD_FBW_MAX": 30.0}
    assert scaling(plane, old, 22.0) == pytest.approx(15.0 / 22.0)
    trim = {"FW_AIRSPD_TRIM": 15.0, "FW_AIRSPD_STALL": 7.0, "FW_AIRSPD_MAX": 20.0}
    found = [scaling(px4, trim, v) for v in (3.0, 10.0, 40.0)]
    assert found == pytest.approx([15.0 / 7.0, 1.5, 0.75])
    assert scaling(px4, trim | {"FW_ARSP_SCALE_EN": 0.0}, 10.0) == 1.0


def test_px4s_integrator_stays_as_it_is_while_p_is_raised() -> None:
    values = {"FW_YR_I": 0.1, "FW_AIRSPD_TRIM": 15.0}
    law = AUTOPILOTS["px4"].law(values, 400.0, 10.0)

    assert law.at(np.array([2.0j]), 0.3)[0] == pytest.approx(
        2.25 * (0.3 + 0.1 / 2.0j) * np.exp(-2.0j * 0.00125)
    )


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [
        ("ardupilot", {"YAW_RATE_ENABLE": 1.0}, "YAW_RATE_ENABLE"),
        ("ardupilot", {"YAW2SRV_SLIP": 1.0, "YAW2SRV_INT": 0.5}, "YAW2SRV_SLIP"),
        ("px4", {"FW_YR_D": 0.1}, "FW_YR_D"),
        ("px4", {"CA_SV_CS0_TRQ_Y": 0.5, "CA_SV_CS1_TRQ_Y": -0.5}, "TRQ_Y"),
    ],
)
def test_a_loop_that_is_not_modelled_is_named(name: str, values: dict, says: str) -> None:
    against = AUTOPILOTS[name].against(values)

    assert says in against
    assert AUTOPILOTS[name].against({"YAW2SRV_SLIP": 1.0, "CA_SV_CS0_TRQ_Y": -1.0}) is None
