"""What the numbers of the yaw channel are called: by the paper, and by a flight-test engineer.

The paper is M. T. Vu, "Development of a kinematic identification framework for the directional
motion of a fixed-wing aircraft based on an ARMAX model"; its eq. 22 and 23 have the first eight.
Its beta is psi - theta_Gamma, nose right of the path positive: the opposite of sideslip as usually
counted, wind from the right. With that sideslip, r the yaw rate and d the rudder, nose right,

    r' = N_beta beta + N_r r + N_dr d,    beta' = Y_beta/V beta - r,

so that N_beta and N_dr are the paper's numbers and N_r and Y_beta/V their negatives.
"""

from dataclasses import dataclass
from typing import Final

PAPER: Final = (
    "M. T. Vu, Development of a kinematic identification framework for the directional motion of a "
    "fixed-wing aircraft based on an ARMAX model, eq. 22-23"
)


@dataclass(frozen=True, slots=True)
class Name:
    """One number: its usual symbol, empty without one, the paper's, what it is, its unit.

    ``unit`` may hold {rudder}, the unit of the rudder.
    """

    usual: str
    paper: str
    text: str
    unit: str

    @property
    def symbols(self) -> str:
        """Both symbols, the usual one first: the number is that of either."""
        return " = ".join(filter(None, (self.usual, self.paper)))


OF_YAW_CHANNEL: Final = {
    "K": Name("", "K", "static gain", "rad/s per {rudder}"),
    "T_theta_s": Name("", "T_θ", "numerator time constant", "s"),
    "omega_beta": Name("ωn", "ω_β", "natural frequency", "rad/s"),
    "xi_beta": Name("ζ", "ξ_β", "damping ratio", ""),
    "a_z_beta": Name("−Y_β/V", "a_z^β", "side force by sideslip", "1/s"),
    "a_my_omega_y": Name("−N_r", "a_my^ωy", "yaw damping", "1/s"),
    "a_my_beta": Name("N_β", "a_my^β", "weathercock stability", "1/s²"),
    "a_my_delta_h": Name("N_δr", "a_my^δH", "rudder effectiveness", "1/s² per {rudder}"),
    "servo_tau_s": Name("τ", "", "lag of the servo", "s"),
    "reduction_error": Name("", "", "misfit of eq. 23, 0.3 to 3 ωn", ""),
}
"""By the names of :data:`yawid.physics.derivatives.NAMES`, and the reduction's error."""
