from __future__ import annotations

import numpy as np

from yawid.config.estimator import ArmaxOrders
from yawid.physics.model_response import step_response
from yawid.plant.yaw import YawPlant


def test_eq_1_the_transient_function_is_the_plants_response_to_a_unit_step():
    plant = YawPlant(K=1.0, T_theta_s=0.8, omega_beta=2.5, xi_beta=0.4)
    measured = plant.linear().simulate(np.ones(200), 0.05)[:, 0]

    found = step_response(plant.theta(0.05), ArmaxOrders(2, 2, 0, 1), 200)

    np.testing.assert_allclose(found, measured, atol=1e-12)
