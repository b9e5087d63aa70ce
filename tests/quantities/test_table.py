"""The table of quantities, with the signs of a textbook, and the names of flight modes."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink import mavutil

from yawid.plant.simulate import REFERENCE
from yawid.plant.yaw import YawPlant
from yawid.quantities.table import CHANNELS, YAW_CHANNEL, quantity
from yawid.quantities.units import UNITS
from yawid.quantities.vehicles import ARDUPILOT, mode_name


def test_a_channel_s_unit_is_one_that_records_know() -> None:
    units = {row.unit for row in CHANNELS.values()} - {"", "1", "UTC"}

    assert units <= {unit.symbol for unit in UNITS.values()}


@pytest.mark.parametrize(
    ("name", "unit", "said"),
    [
        ("wn_std", "rad/s", "total"),
        ("wn_std_noise", "rad/s", "part of wn_std that noise"),
        ("kappa_std", "rad/m", "total"),
        ("K_per_V_std_noise", "rad/m per {rudder}", "part of K_per_V_std that noise"),
        ("servo_tau_s_std", "s", "total"),
        ("theta_std", "", "of noise alone"),
    ],
)
def test_a_sigma_has_the_unit_of_what_it_is_of(name: str, unit: str, said: str) -> None:
    assert quantity(name).unit == unit
    assert said in quantity(name).words


def test_with_the_usual_signs_the_usual_equations_are_the_papers_plant() -> None:
    """N_beta beta + N_r r + N_dr d, Y_beta/V beta - r; beta positive with wind from the right."""
    usual = {}
    for key in ("a_z_beta", "a_my_omega_y", "a_my_beta", "a_my_delta_h"):
        symbol = YAW_CHANNEL[key].symbol.split(" = ")[0]
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


def test_arduplanes_modes_are_called_as_pymavlink_calls_them() -> None:
    for vehicle_type in range(46):
        names = mavutil.mode_mapping_bynumber(vehicle_type) or {}
        for mode in range(-1, 40):
            expected = names.get(mode, f"mode {mode}")
            assert mode_name(ARDUPILOT, vehicle_type, mode) == expected
