"""The predictor against its equations, and against a filter's loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yawid.lateral.model import System
from yawid.lateral.predictor import Predictor, exponential, unused, whitened

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

    for Phi, C, Q, R, P in zip(
        predictor.Phi, system.C, predictor.Q, system.R, predictor.P, strict=True
    ):
        seen = P @ C.T @ np.linalg.inv(C @ P @ C.T + R) @ C @ P
        np.testing.assert_allclose(Phi @ (P - seen) @ Phi.T + Q, P, rtol=1e-8, atol=1e-12)
        assert np.abs(np.linalg.eigvals(Phi @ (np.eye(6) - seen @ np.linalg.inv(P)))).max() < 1.0


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
    y, u = rng.normal(size=(n, 3)), rng.normal(size=(2, n, 8))
    own = rng.normal(size=8)  # the state at the start and the trims

    predictor = Predictor.of(system, TS)
    runs = np.repeat(own[None], 2, axis=0)
    found = whitened(predictor, y[None], u, runs[:, :4], runs[:, 4:])
    found[:, unused(missing)] = 0.0

    for i in range(2):
        Phi, G, moment = (each[i] for each in exponential(system.A, TS))
        C, P = system.C[i], predictor.P[i]
        S = C @ P @ C.T + system.R[i]
        factor, K = np.linalg.cholesky(S), Phi @ P @ C.T @ np.linalg.inv(S)
        x, expected = np.append(own[:4], [0.0, 0.0]), np.zeros((n, 3))
        for k in range(n):
            e = y[k] - C @ x
            expected[k] = np.linalg.solve(factor, e)
            push = G @ system.B[i] @ u[i, k, :4] + G[:, :4] @ own[4:]
            push += (TS / 2.0 * G - moment) @ system.B[i] @ u[i, k, 4:]
            x = Phi @ x + push + K @ e
        for start, stop in gaps:  # as many samples as were lost are not used after them
            expected[start : 2 * stop - start] = 0.0
        expected *= np.exp(np.log(np.diag(factor)).sum() / 3.0)
        np.testing.assert_allclose(found[i], expected, atol=1e-10)
