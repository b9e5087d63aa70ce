"""The names of the yaw channel: all its numbers, with the signs of a flight-test textbook."""

from __future__ import annotations

import numpy as np

from yawid.physics.derivatives import NAMES, REDUCTION_ERROR
from yawid.physics.names import OF_YAW_CHANNEL
from yawid.plant.simulate import REFERENCE
from yawid.plant.yaw import YawPlant


def test_every_number_has_a_name() -> None:
    assert list(OF_YAW_CHANNEL) == [*NAMES, REDUCTION_ERROR]


def test_with_the_usual_signs_the_usual_equations_are_the_papers_plant() -> None:
    """N_beta beta + N_r r + N_dr d, Y_beta/V beta - r; beta positive with wind from the right."""
    usual = {}
    for key in ("a_z_beta", "a_my_omega_y", "a_my_beta", "a_my_delta_h"):
        symbol = OF_YAW_CHANNEL[key].usual
        sign = -1.0 if symbol[0] == "−" else 1.0
        usual[symbol.removeprefix("−")] = sign * getattr(REFERENCE, key)
    A = np.array([[usual["N_r"], usual["N_β"]], [-1.0, usual["Y_β/V"]]])
    B, s = np.array([usual["N_δr"], 0.0]), 0.7j
    plant = YawPlant.from_coefficients(REFERENCE)
    square = plant.omega_beta**2
    paper = plant.K * square * (plant.T_theta_s * s + 1) / (
        s**2 + 2 * plant.xi_beta * plant.omega_beta * s + square
    )  # fmt: skip

    assert np.isclose(np.linalg.solve(s * np.eye(2) - A, B)[0], paper, rtol=1e-12)
    assert usual["N_β"] > 0 > usual["N_r"]
