"""The bare airframe is found again from motions of a known aircraft: predictor, law, fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from lateral.flown import DERIVATIVES, ROLL, P, R, flown
from linear_flights import airframe, modes
from scipy.linalg import expm

from yawid.lateral import fit_airframe as fit_airframe_room
from yawid.lateral import large
from yawid.lateral.criterion import Criterion
from yawid.lateral.fit import fit, guesses
from yawid.lateral.fit_airframe import autocorrelation, fit_airframe
from yawid.lateral.gates import GATES, MOST_LOST, failed_gates
from yawid.lateral.large import small_motion
from yawid.lateral.model import System
from yawid.lateral.motion import COMMAND_STEP_S, Motion
from yawid.lateral.predictor import Predictor, exponential, innovations, unused
from yawid.lateral.record import Record
from yawid.lateral.roll_law import roll_law
from yawid.plant.lateral import LateralCoefficients, lateral_motion

TS = 0.04


@pytest.fixture(scope="module")
def system() -> System:
    """Return two variants of some model."""
    rng = np.random.default_rng(3)
    A = rng.normal(size=(2, 6, 6)) - 2.0 * np.eye(6)
    B, C = rng.normal(size=(2, 6, 4)), rng.normal(size=(2, 3, 6))
    Q = np.stack([np.diag([0.0, 0.0, 0.2, 0.0, 0.5, 1.0])] * 2)
    return System(A, B, C, Q, np.stack([np.diag([0.1, 0.2, 0.3])] * 2))


def test_the_exponential_and_its_integrals_are_those_of_each_eigenvalue(system: System) -> None:
    Phi, area, moment = exponential(system.A, TS)

    for i in range(2):
        s, vectors = np.linalg.eig(system.A[i])
        end = np.exp(s * TS)
        each = end, (end - 1.0) / s, (TS * end - (end - 1.0) / s) / s
        for found, values in zip((Phi, area, moment), each, strict=True):
            expected = (vectors * values @ np.linalg.inv(vectors)).real
            np.testing.assert_allclose(found[i], expected, atol=1e-12)


def test_the_steady_covariance_solves_riccatis_equation(system: System) -> None:
    predictor = Predictor.of(system, TS)

    for Phi, C, Q, noise, found in zip(
        predictor.Phi, system.C, predictor.Q, system.R, predictor.P, strict=True
    ):
        seen = found @ C.T @ np.linalg.inv(C @ found @ C.T + noise) @ C @ found
        np.testing.assert_allclose(Phi @ (found - seen) @ Phi.T + Q, found, rtol=1e-8, atol=1e-12)
        closed_loop = Phi @ (np.eye(6) - seen @ np.linalg.inv(found))
        assert np.abs(np.linalg.eigvals(closed_loop)).max() < 1.0


def test_next_to_a_model_the_covariance_is_known_to_the_square_of_the_distance(
    system: System,
) -> None:
    for distance in (1e-3, 1e-4):
        moved = replace(system, A=system.A * (1.0 + distance), R=system.R * (1.0 - distance))
        near = Predictor.of(moved, TS, Predictor.of(system, TS))

        assert np.abs(near.P - Predictor.of(moved, TS).P).max() < distance**2


@pytest.mark.parametrize("gaps", [(), ((20, 29), (40, 41)), ((0, 3), (90, 100), (148, 150))])
def test_the_innovations_are_those_of_the_steady_filter_and_unused_after_gaps(
    system: System, gaps: tuple[tuple[int, int], ...]
) -> None:
    rng = np.random.default_rng(5)
    n, missing = 150, np.zeros(150, bool)
    for start, stop in gaps:
        missing[start:stop] = True
    y, u = rng.normal(size=(n, 3)), rng.normal(size=(n, 8))
    own = rng.normal(size=10)  # the state at the start and the trims

    predictor = Predictor.of(system, TS)
    into = np.dstack([predictor.drive, predictor.K, predictor.trim @ own[6:, None]])
    known, start = np.column_stack([u, y, np.ones(n)]), np.column_stack([own[:6], own[:6]])
    found = innovations(predictor, known, into, np.eye(3, 12, 8), start)
    found[unused(missing)] = 0.0

    for i in range(2):
        Phi, G, moment = (each[i] for each in exponential(system.A, TS))
        C, P = system.C[i], predictor.P[i]
        S = C @ P @ C.T + system.R[i]
        factor, K = np.linalg.cholesky(S), Phi @ P @ C.T @ np.linalg.inv(S)
        x, expected = own[:6], np.zeros((n, 3))
        for k in range(n):
            e = y[k] - C @ x
            expected[k] = np.linalg.solve(factor, e)
            push = G @ system.B[i] @ u[k, :4] + G[:, :4] @ own[6:]
            push += (TS / 2.0 * G - moment) @ system.B[i] @ u[k, 4:]
            x = Phi @ x + push + K @ e
        for start, stop in gaps:  # as many samples as were lost are not used after them
            expected[start : 2 * stop - start] = 0.0
        expected *= np.exp(np.log(np.diag(factor)).sum() / 3.0)
        np.testing.assert_allclose(found[:, :, i], expected, atol=1e-10)


WN, ZETA, ROLL_S = modes(airframe(DERIVATIVES)[0])
"""The modes of the aircraft that flies in these tests."""


def test_eq_21_is_recovered_from_its_own_motion_without_noise() -> None:
    """In the plant's axes psi and theta_G are positive left; the motion is small, as it is linear.

    A bank's sine and the yaw of a bank are known inputs of the fit, and not in eq. 21.
    """
    c = LateralCoefficients(
        a_z_gamma=-9.80665 / 60.0, a_z_beta=0.3, a_mx_omega_x=3.5, a_mx_omega_y=1.0,
        a_mx_beta=8.0, a_mx_delta_b=5e-4, a_my_omega_x=-0.1, a_my_omega_y=0.5, a_my_beta=5.0,
        a_my_delta_h=3e-4,
    )  # fmt: skip
    plant, given = lateral_motion(c), flown(seconds=30.0)
    inputs = np.stack([given.aileron, given.rudder], axis=1)  # -delta_b rolls right as an aileron
    larger = np.zeros((9, 9))  # states, inputs and their slopes
    larger[:5, :5], larger[:5, 5:7], larger[5:7, 7:] = plant.A, plant.B[:, :2], np.eye(2)
    step, x, states = expm(larger * COMMAND_STEP_S)[:5], np.zeros(5), []
    for now, after in zip(inputs, np.vstack([inputs[1:], inputs[-1:]]), strict=True):
        states.append(x)
        x = step @ np.concatenate([x, now, (after - now) / COMMAND_STEP_S])
    _, gamma, gamma_rate, _, psi_rate = np.array(states)[200::8].T
    motion = replace(given, p=gamma_rate, r=-psi_rate, roll=gamma, airspeed_m_s=60.0)

    found = fit_airframe([motion], servo_lag_s=0.0)

    milli = {name: 1e3 if "delta" in name else 1.0 for name in found.derivatives}
    got = {name: known.value * milli[name] for name, known in found.derivatives.items()}
    assert got == pytest.approx({
        "Y_beta": -0.3, "L_beta": -8.0, "L_p": -3.5, "L_r": 1.0, "L_delta_a": 0.5,
        "L_delta_r": 0.0, "N_beta": 5.0, "N_p": -0.1, "N_r": -0.5, "N_delta_a": 0.0,
        "N_delta_r": -0.3, "Y_delta_r": 0.0,
    }, abs=1e-6)  # fmt: skip


FAST = {
    "Y_beta": -2.8, "L_beta": -34.0, "L_p": -10.0, "L_r": 1.4, "L_delta_a": 47.0,
    "L_delta_r": -8.0, "N_beta": 77.0, "N_p": 0.2, "N_r": -10.0, "N_delta_a": 0.0,
    "N_delta_r": 22.0, "Y_delta_r": -0.4,
}  # fmt: skip
LONG = pytest.mark.long


def with_gap() -> Motion:
    """A motion without its samples of two seconds, while the rudder moves."""
    motion = flown(2, seconds=20.0, lag_s=0.05)
    k = np.arange(len(motion.p))
    columns = {name: getattr(motion, name) for name in ("p", "r", "roll", "pitch", "q")}
    lost = (k >= 60) & (k < 110)
    return replace(motion, **{name: np.where(lost, np.nan, x) for name, x in columns.items()})


def drifting() -> Motion:
    """An estimator's roll differs from the integral of its rates, and is smoother than they are."""
    given = flown(seconds=20.0, amplitude=0.3, aileron=0.2, lag_s=0.1)
    noise = np.random.default_rng(1).normal(size=(3, len(given.p)))
    p, r = given.p + 3e-4 * noise[0], given.r + 3e-4 * noise[1]
    return replace(given, p=p, r=r, roll=given.roll + 1e-4 * np.cumsum(noise[2]))


def jumping() -> Motion:
    """On lines between messages at 50 Hz, of a fast aircraft behind a slow servo.

    The rudder jumps at the beginning of its line. Taken as the line itself, wn was 5 % low and the
    roll mode 37 % too slow.
    """
    given = flown(
        2, seconds=15.0, rate_hz=50.0, lag_s=0.14, amplitude=0.3, aileron=0.15, derivatives=FAST,
        ramp_s=COMMAND_STEP_S,
    )  # fmt: skip
    every = np.arange(0, len(given.rudder), round(0.02 / COMMAND_STEP_S))
    lines = np.interp(np.arange(len(given.rudder)), every, given.rudder[every])
    return replace(given, rudder=lines)


@pytest.mark.parametrize(
    ("made", "lag_s", "within", "of", "air"),
    [
        pytest.param(
            lambda: [flown(1, lag_s=0.1)], None, (0.05, 0.03, 0.2), DERIVATIVES, (0.1, 0.0),
            id="lag",
            marks=LONG,
        ),
        pytest.param(
            lambda: [flown(1)], None, (0.05, 0.03, 0.2), DERIVATIVES, (0.0, 0.0),
            id="none", marks=LONG,
        ),
        pytest.param(
            lambda: [flown(1, seconds=20.0, lag_s=0.1, gust=0.02)], None, (0.05, 0.03, 0.2),
            DERIVATIVES, (0.1, 0.02), id="lag and gusts",
        ),
        pytest.param(
            lambda: [flown(1, seconds=20.0, gust=0.02)], 0.0, (0.05, 0.05, 0.3), DERIVATIVES,
            (0.0, 0.02), id="gusts",
        ),
        pytest.param(lambda: [with_gap()], 0.05, (0.02, 0.02, 0.2), DERIVATIVES, None, id="gap"),
        pytest.param(
            lambda: [flown(5, seconds=15.0), flown(6, seconds=15.0)], 0.0, (0.05, 0.03, 0.2),
            DERIVATIVES, None, id="two manoeuvres",
        ),
        pytest.param(
            lambda: [drifting()], 0.1, (0.005, 0.005, 0.02), None, None,
            id="a roll angle that drifts",
        ),
        pytest.param(lambda: [jumping()], None, (0.01, 0.015, 0.06), None, None, id="jumps"),
    ],
)  # fmt: skip
def test_the_airframe_is_found_with_noise_lag_and_gusts(
    made: Callable[[], list[Motion]], lag_s: float | None, within: tuple[float, float, float],
    of: dict[str, float] | None, air: tuple[float, float] | None,
) -> None:  # fmt: skip
    """Its derivatives, if they are known, within three sigmas; also with gaps, drift and jumps.

    ``air`` is the servo's lag, and the sideslip of the gusts.
    """
    motions = made()
    fast = motions[0].sample_time_s == 0.02
    found = fit_airframe(motions, servo_lag_s=lag_s)

    wn, zeta, roll_s = modes(airframe(FAST if fast else DERIVATIVES)[0])
    assert not found.failed
    assert found.wn_rad_s.value == pytest.approx(wn, rel=within[0])
    assert found.zeta.value == pytest.approx(zeta, abs=within[1])
    assert found.roll_s.value == pytest.approx(roll_s, rel=within[2])
    assert found.wn_rad_s.std < 0.05 * wn
    if air is not None:
        lag, gust = air
        assert abs(found.servo_lag_s.value + found.delay_s.value - lag) < 0.02
        # It was a thousandth of it: the scale of the whitened innovations is not that of the noise.
        assert gust == 0.0 or 0.5 * gust < found.gust_std_rad < 2.0 * gust
    for name, true in (of or {}).items():
        known = found.derivatives[name]
        assert abs(known.value - true) < 3.0 * known.std, (name, known, true)


@pytest.mark.parametrize(
    ("amplitudes", "stall_rad", "limited", "gust"),
    [((0.3,), 0.2, (0.0, 0.0), 0.0), ((0.3,), np.inf, (0.5, 0.03), 0.0),
     ((0.3,), np.inf, (0.5, 0.03), 0.02), ((0.3,), 0.25, (0.5, 0.06), 0.0),
     ((0.3, 0.27), 0.2, (0.0, 0.0), 0.0)],
    ids=["a fin that stalls", "a damper at its limits", "the same in gusts", "both",
         "two manoeuvres"],
)  # fmt: skip
def test_the_airframe_is_that_of_small_motion(
    amplitudes: tuple[float, ...], stall_rad: float, limited: tuple[float, float], gust: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """A linear fit of the same motion is between small and large motion, five sigmas away."""
    A, controls = airframe(DERIVATIVES)
    wn, zeta, _ = modes(A - limited[0] * np.outer(controls[:, 1], np.eye(4)[R]))
    motions = [
        flown(3 + i, amplitude=amplitude, stall_rad=stall_rad, limited=limited, gust=gust)
        for i, amplitude in enumerate(amplitudes)
    ]

    def away() -> list[float]:
        found = fit_airframe(motions, servo_lag_s=0.0)
        assert not found.failed
        pairs = ((found.wn_rad_s, wn), (found.zeta, zeta))
        return [abs(known.value - true) / known.std for known, true in pairs]

    assert max(away()) < 2.0
    monkeypatch.setattr(fit_airframe_room, "small_motion", lambda best: best)
    assert max(away()) > 5.0


def test_an_airframe_is_refused_where_the_fin_loses_most_of_its_effect() -> None:
    """At the largest sideslip of .17 rad a fin that stalls at .1 has lost 45 % of it."""
    found = fit_airframe([flown(3, amplitude=0.3, stall_rad=0.1)], servo_lag_s=0.0)

    assert found.failed["not_proportional"] > MOST_LOST


@pytest.mark.parametrize("stall_rad", [np.inf, 0.5])
def test_what_large_motion_explains_is_known_without_its_fit(stall_rad: float) -> None:
    """Of a linear aircraft it is nothing, and the fit is the same."""
    record = Record(flown(3, amplitude=0.3, stall_rad=stall_rad))
    best = fit(Criterion([record], guesses([record], 0.0)[0], {"servo_lag": (0.0, 0.005)}))
    columns = [large.columns(record, best.at.parts[0], (0.0, 0.0))]

    with_fin = large.fitted_with(best, [columns[0][:, :1]], large.INTO[:1])

    gain = large.gains(best, columns)[0]
    assert gain == pytest.approx(best.criterion - with_fin.criterion, rel=0.15, abs=0.5)
    assert (small_motion(best) is best) == (stall_rad == np.inf)


def test_pitch_and_angle_of_attack_are_two_things() -> None:
    """In a climb of 0.3 rad along its own axis p still makes no sideslip."""
    found = fit_airframe([flown(seconds=15.0, pitch=0.3)], servo_lag_s=0.0)

    assert found.alpha_rad.value == pytest.approx(0.0, abs=0.02)
    assert found.wn_rad_s.value == pytest.approx(WN, rel=0.01)


def test_the_roll_law_does_not_pass_for_the_airframe() -> None:
    """Under a fast roll hold the aircraft as flown has another mode; the airframe is the same."""
    hold = (1.0, 0.3)
    A, controls = airframe(DERIVATIVES)
    closed = A - np.outer(controls[:, 0], [0.0, hold[1], 0.0, hold[0]])
    assert abs(modes(closed)[1] - ZETA) > 0.03

    found = fit_airframe([flown(4, seconds=20.0, hold=hold, aileron=0.0)], servo_lag_s=0.0)

    assert abs(found.zeta.value - ZETA) < 3.0 * found.zeta.std
    assert abs(found.wn_rad_s.value - WN) < 3.0 * found.wn_rad_s.std


@pytest.mark.long
def test_what_a_slower_rudder_servo_does_to_the_derivatives_is_in_their_sigma() -> None:
    """The model has one lag for both, and gives the rest to the rudder's side force: -7 sigma."""
    motion = flown(1, lag_s=0.1)
    slower = np.roll(motion.rudder, 20)  # by 0.1 s

    found = fit_airframe([replace(motion, rudder=slower)], servo_lag_s=0.1)

    for name in ("Y_beta", "N_r", "L_r", "Y_delta_r"):
        known = found.derivatives[name]
        assert abs(known.value - DERIVATIVES[name]) < 3.0 * known.std, (name, known)


def test_all_starts_end_at_one_likelihood() -> None:
    """Also those whose noise begins where another start ended."""
    records = [Record(flown(seed=3, seconds=12.0, lag_s=0.1))]

    ends = [fit(Criterion(records, each, {})) for each in guesses(records, None)]
    ends.append(fit(Criterion(records, guesses(records, None)[2], {}), before=ends[0]))

    assert all(each.settled for each in ends)
    assert np.ptp([each.criterion for each in ends]) < 1.0


def test_the_covariance_is_that_of_the_criterions_curvature_for_motion_and_noise() -> None:
    """With the noise's block of Gauss and Newton's doubled, gusts had 1.7 times what they have."""
    record = Record(flown(4, seconds=60.0, gust=1.0))
    best = fit(Criterion([record], guesses([record], 0.0)[0], {"servo_lag": (0.0, 0.005)}))
    information, centre = np.linalg.inv(best.covariance), best.at

    def half(x: np.ndarray) -> float:
        at = best.of.at(x)
        power, surprise = np.sum(at.e**2), np.sum(at.surprise**2)
        return float(best.of.count * np.log(power) + surprise) / 2.0

    compared = set()
    for i in np.flatnonzero((np.diag(information) > 50.0) & (best.x > best.of.least)):
        step = np.eye(len(best.x))[i] * 0.7 / np.sqrt(information[i, i])
        apart = half(best.x + step) + half(best.x - step) - 2.0 * half(centre.x)
        curvature = apart / np.sum(step**2)
        assert information[i, i] == pytest.approx(curvature, rel=0.06), best.of.names[i]
        compared.add(best.of.names[i])
    assert compared >= {"N_beta", "N_p", "log_sigma_roll", "log_gust", "log_gust_rate"}


@pytest.mark.parametrize("lag_s", [0.0, 0.002, 0.1])
def test_what_a_later_jump_does_to_the_innovations_is_that_of_its_inputs(lag_s: float) -> None:
    """Each is a sum of runs that all jumps share; here each is run by itself."""
    motion = flown(3, seconds=12.0, aileron=0.2)
    edges = np.isin(np.arange(len(motion.rudder)) // 100 % 5, (1, 3))
    records = [Record(replace(motion, rudder=motion.rudder + 0.3 * edges))]
    guess, record = guesses(records, None)[0], records[0]
    criterion = Criterion(records, replace(guess, start=guess.start | {"servo_lag": lag_s}), {})
    part = criterion.at(criterion.start()).parts[0]
    assert len(record.jumps) > 5

    def run(later_s: list[float]) -> np.ndarray:
        predictor, n = part.predictor, len(record.y)
        known = np.column_stack([record.inputs(lag_s, 0.0, later_s), record.y, np.ones(n)])
        into = np.dstack([predictor.drive, predictor.K, np.zeros((1, 6, 1))])
        found = innovations(predictor, known, into, np.eye(3, 12, 8), np.zeros((6, 1)))
        return np.asarray(found[:, :, 0].ravel())

    for j in range(len(record.jumps)):
        by = np.eye(len(record.jumps))[j]
        expected, found = run(by.tolist()) - run([]), part.columns[: record.y.size, 8 + j]
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(("rate_hz", "correlated"), [(25.0, 0.5), (50.0, 0.25)])
def test_the_colour_of_the_innovations_is_that_over_40_ms(
    rate_hz: float, correlated: float
) -> None:
    """An autoregressive noise of 0.5 a sample leaves 0.25 after two."""
    rng, e = np.random.default_rng(2), np.zeros((4000, 3))
    for k in range(1, len(e)):
        e[k] = 0.5 * e[k - 1] + rng.normal(size=3)
    motion = flown(seconds=4000 / rate_hz, rate_hz=rate_hz)
    its = {name: getattr(motion, name)[:4000] for name in ("p", "r", "roll", "pitch", "q")}
    record = Record(replace(motion, **its))

    assert autocorrelation([e.ravel()], [record]) == pytest.approx(correlated, abs=0.06)


@pytest.mark.long
def test_a_jump_after_which_nothing_is_measured_changes_nothing() -> None:
    """It comes in the last samples, in which p is missing."""
    motion = flown(3)
    p, times_s = motion.p.copy(), motion.command_times_s()
    p[-5:] = np.nan
    jumped = motion.rudder + 0.3 * (times_s >= motion.sample_time_s * (len(p) - 2))

    found = fit_airframe([replace(motion, p=p, rudder=jumped)], servo_lag_s=0.0)

    as_before = fit_airframe([replace(motion, p=p)], servo_lag_s=0.0)
    assert found.wn_rad_s.value == pytest.approx(as_before.wn_rad_s.value, rel=1e-3)
    assert found.zeta.value == pytest.approx(as_before.zeta.value, abs=1e-3)


def test_a_fit_that_does_not_settle_says_after_how_many_steps() -> None:
    """The text once said "within nan steps"."""
    motion = flown(seed=3, seconds=12.0)
    gates = failed_gates(fit_airframe([motion]), [Record(motion)], settled=False)
    said = GATES["not_settled"].said(gates["not_settled"])
    assert said == "the fit did not settle within 100 steps"


HOLD = (0.6, 0.2)
HELD: dict[str, Any] = {"amplitude": 0.3, "aileron": 0.2, "hold": HOLD, "lag_s": 0.1}


def closed(lag_s: float, roll_lag_s: float) -> tuple[float, float]:
    """Return wn and zeta under HOLD: the aileron and the roll angle heard are two more states."""
    A, controls = airframe(DERIVATIVES)
    whole = np.zeros((6, 6))
    whole[:4, :4], whole[:4, 4], whole[4, 4] = A, controls[:, 0], -1.0 / lag_s
    whole[4, 5], whole[4, P] = -HOLD[0] / lag_s, -HOLD[1] / lag_s
    whole[5, ROLL], whole[5, 5] = 1.0 / roll_lag_s, -1.0 / roll_lag_s
    poles, vectors = np.linalg.eig(whole)
    response = vectors[R] * np.linalg.solve(vectors, np.append(controls[:, 1], [0.0, 0.0]))
    energy = np.where(poles.imag > 0.0, np.abs(response) ** 2 / np.abs(poles.real), 0.0)
    pair = poles[np.argmax(energy)]
    return float(abs(pair)), float(-pair.real / abs(pair))


@pytest.mark.parametrize(("roll_lag_s", "within"), [(0.0, 0.05), (0.1, 0.1)])
def test_the_law_is_found_although_the_aileron_is_moved_as_well(roll_lag_s: float, within: float):
    """And so is the lag of the roll angle that the hold hears."""
    law = roll_law(Record(flown(3, roll_lag_s=roll_lag_s, **HELD)))

    assert law.roll_lag_s == roll_lag_s
    assert (law.roll_gain, law.rate_gain) == pytest.approx(HOLD, rel=within)


def test_an_aileron_that_rests_has_a_law_without_gains_and_one_that_moves_by_itself_has_none():
    resting = roll_law(Record(flown(3, aileron=0.0)))

    assert (resting.roll_gain, resting.rate_gain) == (0.0, 0.0)
    assert roll_law(Record(flown(3, aileron=0.2))) is None
    # Under the hold, but moved so much that roll and p explain .94 of it, with the wrong gains.
    assert roll_law(Record(flown(3, **HELD | {"aileron": 0.3}))) is None


@pytest.mark.parametrize(
    ("roll_lag_s", "apart"), [pytest.param(1e-3, 0.03, marks=pytest.mark.long), (0.1, 0.025)]
)
def test_closed_with_the_law_the_airframe_is_the_aircraft_as_flown(roll_lag_s: float, apart: float):
    """Without its roll hold its damping is another."""
    found = fit_airframe([flown(3, roll_lag_s=roll_lag_s, **HELD)], servo_lag_s=0.1)

    (wn, zeta), (own_wn, own_zeta) = closed(0.1, roll_lag_s), found.as_flown
    assert abs(own_wn.value - wn) < min(2.0 * own_wn.std, 0.02 * wn)
    assert abs(own_zeta.value - zeta) < min(2.0 * own_zeta.std, 0.02)
    assert abs(found.zeta.value - zeta) > apart
