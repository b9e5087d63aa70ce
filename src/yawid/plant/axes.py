"""The paper's axes and signs, and the only place where they are converted to the project's.

``plant/`` uses the paper's axes: x forward, y up, z to the right, and on the ground north, up,
east. The rest of the project uses MAVLink's: forward, right, down (north, east, down). Both are
right-handed; a rotation of 90 deg about x converts one to the other.

======================  ======================  =============================
quantity                paper                   project
======================  ======================  =============================
bank, roll rate         gamma, omega_x          roll, p (same sign)
pitch, pitch rate       theta, omega_z          pitch, q (same sign)
yaw, yaw rate           psi, omega_y            -yaw, -r (the paper's nose goes left)
sideslip                beta                    beta (same: air from the right)
rudder                  -delta_H turns left     rudder > 0 turns the nose right: delta_H
aileron                 -delta_b rolls right    aileron > 0 rolls right: -delta_b
======================  ======================  =============================

So yaw rate over rudder is psi'/(-delta_H) of the paper's eq. 23, with its sign.
"""

from yawid.blocks import Floats


def rudder_from_paper(minus_delta_h: Floats) -> Floats:
    """Return the rudder (n,), positive nose right, from the paper's -delta_H; its own inverse."""
    return -minus_delta_h


def yaw_from_paper(psi: Floats) -> Floats:
    """Return yaw or its rate (n,), positive nose right, from psi or omega_y; its own inverse."""
    return -psi
