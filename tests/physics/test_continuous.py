"""Transfer functions: continuous by hand, and measured by spectra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_flights import drawn
from scipy.signal import freqz, residue, step

from yawid.errors import ConfigError, NotIdentifiable
from yawid.physics.continuous import Transfer, overshoot_of, pole_of, settling_of
from yawid.physics.frequency_response import frequency_response
from yawid.plant.excitation import Excitation
from yawid.plant.yaw import YawPlant

NUM, YAW, LAG_S = [29.08, 34.20], [1.0, 13.148, 111.17], 0.14
"""The yaw channel of the simulated flights, in front of a servo of 0.14 s."""
S = 1j * np.array([0.5, 3.0, 10.0, 25.0])


def model(count: int = 1) -> Transfer:
    """Return equal models; the lag is in the third column."""
    r, p, _ = residue(NUM, np.polymul(YAW, [LAG_S, 1.0]))
    order = np.argsort(-p.imag + 1e3 * (p.imag == 0.0))
    return Transfer(*(np.tile(each[order].astype(complex), (count, 1)) for each in (p, r)))


def true(s, speed: float = 1.0, yaw=YAW):
    """Return G(s) at a higher airspeed: the aircraft's part is faster, the servo is not."""
    aircraft = np.polyval(NUM, s / speed) / np.polyval(yaw, s / speed)
    return speed * aircraft / (LAG_S * s + 1.0)


def test_poles_and_residues_have_the_response_of_the_polynomials() -> None:
    assert model().at(S)[0] == pytest.approx(true(S), rel=1e-9)
    assert model().dutch_roll[0] == pytest.approx(-6.574 + 1j * np.sqrt(111.17 - 6.574**2))
    assert pole_of(np.sqrt(111.17), np.array(6.574 / np.sqrt(111.17))) == pytest.approx(
        model().dutch_roll[0]
    )


def test_a_higher_airspeed_makes_the_aircraft_faster_and_not_its_servo() -> None:
    found = model(2).faster(1.3, np.array([2, -1])).at(S)

    assert found[0] == pytest.approx(true(S, 1.3), rel=1e-9)
    # Without a lag everything scales: G becomes 1.3 G(s / 1.3).
    assert found[1] == pytest.approx(1.3 * true(S / 1.3), rel=1e-9)
    assert model().faster(1.3).at(S)[0] == pytest.approx(found[1], rel=1e-12)


def test_an_airspeed_that_is_hardly_higher_changes_hardly_anything() -> None:
    near = model().faster(1.0 + 1e-9, np.array([2])).at(S)[0]

    assert near == pytest.approx(true(S), rel=1e-8)
    assert model().faster(1.0, np.array([2])).at(S)[0] == pytest.approx(true(S), rel=1e-12)


def test_a_moved_pair_leaves_zeros_and_lags() -> None:
    moved = model().with_pair(np.array([9.0 * np.exp(2.0j)]))

    assert moved.at(S)[0] == pytest.approx(true(S, yaw=[1.0, -18.0 * np.cos(2.0), 81.0]), rel=1e-9)


def test_models_with_fewer_poles_stand_next_to_others_with_their_own_response() -> None:
    pair = model().poles[:, :2]
    alone = Transfer(pair, np.ones((1, 2), complex))
    both = Transfer.joined([alone, model()])

    assert both.poles.shape == (2, 3)
    assert both.at(S)[0] == pytest.approx(1.0 / (S - pair[0, 0]) + 1.0 / (S - pair[0, 1]))
    assert both.at(S)[1] == pytest.approx(true(S), rel=1e-9)
    again = both.faster(1.3, np.array([-1, 2])).with_pair(both.dutch_roll)
    assert again.poles.shape == (2, 3)
    assert np.isfinite(again.at(S)).all()


@settings(max_examples=30)
@given(
    wn=st.floats(0.5, 20.0),
    zeta=st.floats(0.03, 0.97),
    lead=st.floats(-3.0, -0.01) | st.floats(0.01, 20.0),
)
def test_a_swing_settles_and_overshoots_as_scipys_response_to_a_step(wn, zeta, lead):
    """Of a pair and a zero: after it no distance from the end is above 5 % of the largest."""
    num, den = [lead * wn, wn**2], [1.0, 2.0 * zeta * wn, wn**2]
    r, p, _ = residue(num, den)
    upper = np.argmax(p.imag)
    found = settling_of(p[upper], r[upper])

    t, y = step((num, den), T=np.linspace(0.0, 1.5 * float(found), 2001))
    away = np.abs(y - 1.0) / np.abs(y - 1.0).max()
    assert np.interp(found, t, away) == pytest.approx(0.05, rel=0.02)
    assert (away[t > found] < 0.0505).all()
    peak_s = np.pi / p[upper].imag  # eq. 9
    _, y = step(([wn**2], den), T=np.arange(101) * peak_s / 50.0)
    assert overshoot_of(np.array(zeta)) == pytest.approx(y.max() - 1.0, abs=1e-9)


def test_a_swing_that_grows_never_settles():
    assert np.isnan(settling_of(np.array([0.1 + 2.0j, 2.0j]), np.ones(2, complex))).all()


def test_the_yaw_rate_of_aircraft_whose_roll_is_held_stands_when_the_swing_has_settled():
    """Of all six poles of 60 aircraft, with servos and roll hold; where modes of roll are slow and
    large, a few stand later"""
    late = []
    for of in map(drawn, range(60)):
        A = np.zeros((6, 6))
        A[:4, :4], A[:4, 4:], A[4, :4] = of.A, of.B, -of.hold / of.lag_s
        A[4, 4] = A[5, 5] = -1.0 / of.lag_s
        p, vectors = np.linalg.eig(A)
        r = vectors[2] * np.linalg.inv(vectors)[:, 5] / of.lag_s
        pair = np.argmin(np.abs(p - pole_of(of.wn_rad_s, np.array(of.zeta))))
        t = np.linspace(0.0, 15.0 * 2.0 * np.pi / of.wn_rad_s, 20_000)
        away = np.abs((r / p * np.exp(t[:, None] * p)).sum(axis=1))
        late.append(t[away > 0.05 * away.max()][-1] / settling_of(p[pair], r[pair]))
    assert np.percentile(late, [5, 25, 50, 75]) == pytest.approx([0.99, 1.0, 1.01, 1.08], abs=0.03)
    assert np.max(late) < 2.5


TS = 0.05
PLANT = YawPlant(K=1.0, T_theta_s=0.8, omega_beta=2.5, xi_beta=0.4)
THETA = PLANT.theta(TS)


def answer(u: np.ndarray) -> np.ndarray:
    return PLANT.linear().simulate(u, TS)[:, 0]


def prbs(seconds: float, seed: int = 0) -> np.ndarray:
    return Excitation(kind="prbs", unit_s=0.2, seed=seed).samples(round(seconds / TS), TS)


def test_cross_spectra_measure_g_where_the_coherence_is_high():
    rng = np.random.default_rng(5)
    u = prbs(1200.0)
    y = answer(u) + 0.05 * rng.standard_normal(len(u))
    found = frequency_response(u, y, TS, 20.0)
    _, G = freqz([0.0, *THETA[2:]], [1.0, *THETA[:2]], worN=found.w, fs=2.0 * np.pi / TS)
    seen = (found.w > 0.6) & (found.w < 12.6)
    assert (found.coherence[seen] > 0.9).all()
    magnitude = (np.abs(found.G) - np.abs(G))[seen] / found.magnitude_std[seen]
    phase = np.angle(found.G / G)[seen] / found.phase_std_rad[seen]
    for miss in (magnitude, phase):
        assert np.sqrt(np.mean(miss**2)) == pytest.approx(1.0, abs=0.35)


def test_noise_alone_has_no_coherence():
    u, y = np.random.default_rng(6).standard_normal((2, 20_000))
    assert frequency_response(u, y, TS, 10.0).coherence.mean() < 0.02


U = prbs(60.0)


@pytest.mark.parametrize(
    ("u", "y", "segment_s", "error", "words"),
    [
        (np.ones(500), answer(np.ones(500)), 2.0, NotIdentifiable, "does not move"),
        (U, U, 50.0, ConfigError, "segment"),
        (U, U[1:], 2.0, ConfigError, "alike"),
        (U, np.where(U > 0.0, np.nan, U), 2.0, ConfigError, "without gaps"),
    ],
)
def test_what_says_nothing_is_refused(u, y, segment_s, error, words):
    with pytest.raises(error, match=words):
        frequency_response(u, y, TS, segment_s)
