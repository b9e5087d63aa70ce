"""Models of answers written by hand: each number is known, so that nothing is left to a fit."""

from __future__ import annotations

import numpy as np
import pytest
from models.answers_by_hand import STEP_S, flight, manoeuvre, numbers, response, run_of
from msgspec.structs import replace
from scipy.signal import cont2discrete, invres, lfilter

from yawid.errors import NotIdentifiable
from yawid.models.answered import Answered

PAIR, LAG = complex(-0.6, 4.0), -9.0
R, C = complex(3.0, -0.4), -6.0
WN, ZETA = abs(PAIR), 0.6 / abs(PAIR)
STD = [0.05, 0.01, 0.4, 0.1, 0.05, 0.2]
"""Sigmas of wn, zeta, the lag, both parts of the pair's residue, and the lag's."""


def G(s, pair=PAIR, lag=LAG, r=R, c=C):
    """Return the transfer function, by its definition."""
    return r / (s - pair) + np.conj(r) / (s - np.conj(pair)) + c / (s - lag)


def still(n: int = 200) -> dict[str, np.ndarray]:
    return {"rudder": np.zeros(n), "r [rad/s]": np.zeros(n)}


def moved(n: int = 1000) -> np.ndarray:
    u = np.zeros(n)
    for start in (60, 200, 520):
        u[start : start + 15], u[start + 15 : start + 30] = 0.3, -0.2
    return u


WHOLE = ((PAIR, R), (PAIR.conjugate(), R.conjugate()), (LAG, C))


def exact(u: np.ndarray, parts=WHOLE) -> np.ndarray:
    """Return the yaw rate from rest for a rudder that is held over each sample, by SciPy."""
    poles, residues = zip(*parts, strict=True)
    num, den = (np.real(each) for each in invres(residues, poles, []))
    b, a, _ = cont2discrete((np.trim_zeros(num.round(12), "f"), den), STEP_S)
    return lfilter(b.ravel(), a, u)


def lagged(std=STD):
    return response([PAIR, LAG], {"rudder": [R, C]}, std)


def test_the_model_has_the_answers_very_poles_and_response() -> None:
    model = run_of(still(), [manoeuvre(1, lagged())]).model(1)

    poles = np.array([PAIR, PAIR.conjugate(), LAG])
    found = np.sort_complex(np.linalg.eigvals(model.ss().A))
    np.testing.assert_allclose(found, np.sort_complex(poles), rtol=1e-12)
    sampled = np.linalg.eigvals(model.ss(discrete=True).A)
    np.testing.assert_allclose(
        np.sort_complex(sampled), np.sort_complex(np.exp(poles * STEP_S)), rtol=1e-11
    )
    w = np.array([0.5, 3.0, WN, 6.0, 30.0])
    np.testing.assert_allclose(model.frequency_response(w).G, G(1j * w), rtol=1e-10)
    u = moved()
    np.testing.assert_allclose(model.simulate(u), exact(u), atol=1e-12)


X = numbers([PAIR, LAG], [[R, C]])


def slopes(s: np.ndarray) -> np.ndarray:
    """Return the slopes (6, k) of G by those numbers."""

    def of(x: np.ndarray) -> np.ndarray:
        pair = x[0] * (-x[1] + 1j * np.sqrt(1.0 - x[1] ** 2))
        return G(s, pair, x[2], complex(x[3], x[4]), x[5])

    return np.array([(of(X + 1e-6 * e) - of(X - 1e-6 * e)) / 2e-6 for e in np.eye(6)])


def test_its_sigmas_are_those_of_the_answers_numbers_where_the_model_holds() -> None:
    model = run_of(still(), [manoeuvre(1, lagged())]).model(1)
    w = np.array([0.5, 0.59, 0.61, 0.9, 1.0, 1.3, 1.59, 1.61, 3.0]) * WN

    found = model.frequency_response(w)

    relative = np.array(STD)[:, None] * slopes(1j * w) / G(1j * w)
    outside = (w < 0.6 * WN) | (w > 1.6 * WN)
    for std, parts in (
        (found.magnitude_std / np.abs(G(1j * w)), relative.real),
        (found.phase_std_rad, relative.imag),
    ):
        assert np.isnan(std[outside]).all()
        np.testing.assert_allclose(
            std[~outside], np.linalg.norm(parts, axis=0)[~outside], rtol=1e-4
        )
    # den is s^3 + (2 zeta wn - lag) s^2 + ...
    first = np.linalg.norm([2.0 * ZETA * 0.05, 2.0 * WN * 0.01, 0.4])
    assert model.ss().A_std[0, 0] == pytest.approx(first, rel=1e-4)


def test_a_lag_that_is_not_known_leaves_the_response_known() -> None:
    w = WN * np.array([0.65, 1.0, 1.5])
    each = slopes(1j * w)[2:].T
    J = np.concatenate([each.real, each.imag])
    lost = np.linalg.svd(J)[2][-1]  # along it lag and residues err, and G hardly does
    assert abs(lost[0]) > 0.5
    covariance = np.diag([1e-6, 1e-8, 0.0, 0.0, 0.0, 0.0])
    covariance[2:, 2:] = 1e2 * np.outer(lost, lost) + 1e-4 * np.eye(4)
    assert np.sqrt(covariance[5, 5]) > 3.0

    of = Answered.of(manoeuvre(1, lagged(covariance)))
    x = of.drawn(4000, np.random.default_rng(1))

    assert np.std(np.log(-x[:, 2])) == pytest.approx(0.3, rel=0.1)
    given = np.diag(J @ covariance[2:, 2:] @ J.T).reshape(2, 3).sum(axis=0) ** 0.5
    spread = np.std(of.transfers(x)[0].at(1j * w), axis=0)  # of both parts together
    assert np.linalg.norm(spread) == pytest.approx(np.linalg.norm(given), rel=0.5)
    assert (spread < 0.1 * np.abs(G(1j * w)).max()).all()


def test_draws_have_the_covariance_that_was_given() -> None:
    rng = np.random.default_rng(4)
    mixing = np.eye(6) + 0.4 * rng.normal(size=(6, 6))
    spread = 0.1 * np.diag(STD)  # small, so that all is nearly linear
    covariance = spread @ mixing @ mixing.T @ spread

    x = Answered.of(manoeuvre(1, lagged(covariance))).drawn(20_000, rng)

    size = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        np.cov(x.T) / np.outer(size, size), covariance / np.outer(size, size), atol=0.03
    )
    np.testing.assert_allclose((x.mean(axis=0) - X) / size, 0.0, atol=0.03)


def faster(factor: float):
    """Return the answer of the same aircraft at another airspeed: G becomes f G(s / f)."""
    return response([factor * PAIR], {"rudder": [factor**2 * R]}, np.array(STD)[[0, 1, 3, 4]])


def test_the_flight_has_its_airspeeds_aircraft_with_its_wn_zeta_and_sigmas() -> None:
    slow, fast = manoeuvre(1, faster(0.9), speed=18.0), manoeuvre(2, faster(1.1), speed=22.0)
    run = run_of(still(), [slow, fast], flight([slow, fast], 1.02 * WN, 1.1 * ZETA))

    model = run.model("flight")

    num, den, _, den_std, _ = model.tf()
    assert den == pytest.approx([1.0, 2.0 * 1.1 * ZETA * 1.02 * WN, (1.02 * WN) ** 2], rel=1e-12)
    assert den_std[2] / (2.0 * 1.02 * WN) == pytest.approx(0.02 * 1.02 * WN, rel=0.15)
    # At 20 m/s both are G itself, whose zero and high end stay when its pair moves.
    assert num == pytest.approx([2.0 * R.real, -2.0 * (R * PAIR.conjugate()).real], rel=1e-9)


def test_a_flight_of_two_structures_has_the_mean_of_their_responses() -> None:
    one, other = (
        manoeuvre(1, faster(1.0)),
        manoeuvre(2, lagged([0.01, 0.002, 0.1, 0.05, 0.02, 0.1])),
    )
    of = flight([one, other], WN, ZETA, 1e-4)
    w = WN * np.linspace(0.6, 1.6, 7)

    found = run_of(still(), [one, other], of).model("flight").frequency_response(w)

    alone, behind = G(1j * w, c=0.0), G(1j * w)
    np.testing.assert_allclose(found.G, 0.5 * (alone + behind), rtol=0.01)
    apart = np.abs(np.abs(alone) - np.abs(behind))
    assert (found.magnitude_std > 0.45 * apart).all()  # half of it, were there no other sigma


def test_a_manoeuvre_is_simulated_exactly_with_its_own_begin_bias_and_gap() -> None:
    u = moved()
    y = exact(u) + 0.03
    columns = {"rudder": u[50:], "r [rad/s]": y[50:].copy()}
    columns["r [rad/s]"][300:330] = np.nan

    span_s = (10.0 + 150 * STEP_S, 10.0 + 900 * STEP_S)  # it begins in the decay of a doublet
    measured = run_of(columns, [manoeuvre(1, lagged(), span_s)]).model(1).measured

    known = np.isfinite(measured.y)
    assert 600 < known.sum() < 740
    np.testing.assert_allclose(measured.simulated[known], measured.y[known], atol=1e-9)
    assert np.isnan(measured.simulated[~known]).all()
    assert measured.longest.stop - measured.longest.start > 500


def test_where_record_and_model_do_not_cohere_the_response_has_no_sigma() -> None:
    u = moved()
    noise = np.random.default_rng(3).standard_normal(len(u))
    w = WN * np.array([0.7, 1.0, 1.4])
    for size, known in ((0.001, True), (5.0, False)):
        columns = {"rudder": u, "r [rad/s]": exact(u) + size * noise}
        found = run_of(columns, [manoeuvre(1, lagged())]).model(1).frequency_response(w)
        assert np.isfinite(found.magnitude_std).tolist() == [known] * 3
        assert (found.coherence > 0.6).tolist() == [known] * 3


def test_each_input_has_its_own_residues() -> None:
    of_aileron = complex(-1.0, 0.5)
    of = response([PAIR], {"rudder": [R], "aileron": [of_aileron]}, 0.01)
    u, y = {"rudder": moved(), "aileron": np.roll(moved(), 77)}, 0.0
    for each, r in zip(u.values(), (R, of_aileron), strict=True):
        y = y + exact(each, ((PAIR, r), (PAIR.conjugate(), r.conjugate())))

    model = run_of(u | {"r [rad/s]": y}, [manoeuvre(1, of)]).model(1)

    w = np.array([2.0, 4.0])
    found = model.frequency_response(w, "aileron").G
    np.testing.assert_allclose(found, G(1j * w, r=of_aileron, c=0.0), rtol=1e-10)
    known = np.isfinite(model.measured.y)
    np.testing.assert_allclose(model.measured.simulated[known], model.measured.y[known], atol=1e-9)


def test_an_answer_without_a_model_says_what_to_do() -> None:
    found, alone = manoeuvre(1, lagged()), manoeuvre(1, lagged(), speed=None)
    old = replace(found, estimates={"ct": replace(found.estimates["ct"], response=None)})
    for each, of, which, words in (
        (old, None, 1, "manoeuvre 1 has no model"),
        (manoeuvre(1, None), None, 1, "manoeuvre 1 has no model"),
        (
            alone,
            flight([alone], WN, ZETA),
            "flight",
            "airspeed is not known: take the model of one",
        ),
    ):
        with pytest.raises(NotIdentifiable, match=words):
            run_of(still(), [each], of).model(which)
