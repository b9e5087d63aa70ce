"""The yaw dampers of the autopilots as their sources define them: one row for each.

ArduPlane, libraries/APM_Control/AP_YawController.cpp and ArduPlane/Attitude.cpp: with the yaw
rate r and the wanted turn (g/V) sin(roll) RLL in deg/s,

    h = washout(r - turn),    u = -DAMP S^2 (h + INT * integral of h)    in degrees of 45,

and the washout is h <- 0.996008 h + (change of its input) at each call. S is SCALING_SPEED over the
airspeed (equivalent), within [min(.5, SCALING_SPEED / (2 AIRSPEED_MAX)), max(2, SCALING_SPEED / (.7
AIRSPEED_MIN))]. yawid's unit of rudder, half the travel, is 45 degrees there.

PX4, src/modules/fw_rate_control/FixedwingRateControl.cpp: u = S^2 (FW_YR_P e + FW_YR_I *
integral of e) with e = -r in straight flight, S = FW_AIRSPD_TRIM over the calibrated airspeed, held
within [FW_AIRSPD_STALL, FW_AIRSPD_MAX]; S = 1 where FW_ARSP_SCALE_EN is 0. Half the travel is 1.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from yawid.blocks import Floats
from yawid.physics.modes import Complexes
from yawid.quantities.vehicles import ARDUPILOT, PX4

Parameters = Mapping[str, float]
KEPT_A_CALL: Final = 0.996008
"""The part of its output that ArduPlane's washout keeps at each call."""
LEAST_AIRSPEED_MIN: Final = 5.0
"""ArduPlane's MIN_AIRSPEED_MIN in m/s."""


@dataclass(frozen=True, slots=True)
class Law:
    """A damper at one airspeed: u = -K(s) r in half travels, for every gain g of its parameter.

    With a washout or an integral that g scales::

        K(s) = scaling (g (s + integral) / (s + washout) + fixed / s) exp(-s delay)

    ``washout`` and ``integral`` in rad/s; ``fixed`` is an integrator that g does not scale, in
    rad/s per unit of g. Without a washout and an integral K is scaling (g + fixed / s).
    """

    scaling: float
    washout: float
    integral: float
    fixed: float
    delay_s: float

    def fraction(self, gain: float) -> tuple[Floats, Floats]:
        """Return num and den of K without its delay, highest power first."""
        num = [gain, gain * self.integral + self.fixed, self.fixed * self.washout]
        return self.scaling * np.array(num), np.array([1.0, self.washout, 0.0])

    def at(self, s: Complexes, gain: float) -> Complexes:
        """Return K at points s of any shape, other than 0."""
        num, den = self.fraction(gain)
        return np.asarray(np.polyval(num, s) / np.polyval(den, s) * np.exp(-s * self.delay_s))

    def states(self, gain: float) -> tuple[Floats, Floats, Floats, float]:
        """Return A (q, q), B (q,), C (q,) and D of K in observer form, the delay as Pade(2, 2)."""
        num, den = self.fraction(gain)
        if d := self.delay_s:
            late, early = ([1.0, sign * 6.0 / d, 12.0 / d**2] for sign in (-1.0, 1.0))
            num, den = np.convolve(num, late), np.convolve(den, early)
        A = np.eye(len(den) - 1, k=1)  # noqa: N806
        A[:, 0] = -den[1:]
        return A, num[1:] - num[0] * den[1:], np.eye(1, len(A))[0], float(num[0])


@dataclass(frozen=True, slots=True)
class Autopilot:
    """One autopilot's yaw damper.

    ``gain`` is the parameter that is advised, ``loop_rate`` the one with the loop's rate in Hz.
    ``needs`` returns the parameters that the loop needs, each by its newest name with older ones
    after it. ``against`` returns why the loop cannot be modelled, ``law`` the loop of a rate in Hz
    at an equivalent airspeed in m/s; its delay is half a period of the loop, the mean age of a
    command held until the next call. ``turn`` is the parameter of the turn's term, None without
    one. ``mix`` is the part of the aileron that the rudder gets.
    """

    name: str
    words: str
    number: int
    gain: str
    loop_rate: str
    needs: Callable[[Parameters], tuple[tuple[str, ...], ...]]
    against: Callable[[Parameters], str | None]
    law: Callable[[Parameters, float, float], Law]
    turn: str | None
    mix: str


def first(values: Parameters, names: tuple[str, ...]) -> float | None:
    """Return the first of these parameters that is known and finite."""
    found = (values[name] for name in names if name in values)
    return next((value for value in found if math.isfinite(value)), None)


SCALING, LOWEST, HIGHEST = (
    ("SCALING_SPEED",),
    ("AIRSPEED_MIN", "ARSPD_FBW_MIN"),
    ("AIRSPEED_MAX", "ARSPD_FBW_MAX"),
)


def _arduplane_law(values: Parameters, loop_hz: float, airspeed_m_s: float) -> Law:
    speed, low, high = (first(values, each) or math.nan for each in (SCALING, LOWEST, HIGHEST))
    least = min(0.5, speed / (2.0 * high))
    most = max(2.0, speed / (0.7 * max(low, LEAST_AIRSPEED_MIN)))
    S = min(max(speed / airspeed_m_s, least), most)  # noqa: N806
    washout = -math.log(KEPT_A_CALL) * loop_hz
    integral = values.get("YAW2SRV_INT", 0.0)
    return Law(math.degrees(1.0) / 45.0 * S**2, washout, integral, 0.0, 0.5 / loop_hz)


def _arduplane_against(values: Parameters) -> str | None:
    if values.get("YAW_RATE_ENABLE", 0.0):
        return ("YAW_RATE_ENABLE is on: a rate PID moves the rudder next to "
                       "the damper, and its part is not modelled; set it to 0")  # fmt: skip
    if values.get("YAW2SRV_INT", 0.0) and values.get("YAW2SRV_SLIP", 0.0):
        return ("YAW2SRV_SLIP and YAW2SRV_INT are set: they feed back the "
                       "lateral acceleration, of which rudder to yaw rate says nothing; set "
                       "YAW2SRV_SLIP to 0")  # fmt: skip
    return None


def _px4_law(values: Parameters, loop_hz: float, airspeed_m_s: float) -> Law:
    low = first(values, ("FW_AIRSPD_STALL", "FW_AIRSPD_MIN")) or 0.1
    high = values.get("FW_AIRSPD_MAX", math.inf)
    S = values.get("FW_AIRSPD_TRIM", math.nan) / min(max(airspeed_m_s, low), high)  # noqa: N806
    S = S if values.get("FW_ARSP_SCALE_EN", 1.0) else 1.0  # noqa: N806
    return Law(S**2, 0.0, 0.0, values.get("FW_YR_I", 0.0), 0.5 / loop_hz)


def _px4_against(values: Parameters) -> str | None:
    if values.get("FW_YR_D", 0.0):
        return ("FW_YR_D is set: it feeds back the yaw acceleration, which is "
                       "not modelled; set it to 0")  # fmt: skip
    shares = [abs(value) for name, value in values.items()
              if name.startswith("CA_SV_CS") and name.endswith("_TRQ_Y") and value]  # fmt: skip
    if len(shares) > 1 or any(abs(share - 1.0) > 1e-3 for share in shares):
        return ("several surfaces share the yaw torque, or one takes it by "
                       "another factor than 1 (CA_SV_CSi_TRQ_Y): what reaches the rudder is "
                       "not known")  # fmt: skip
    return None


def _px4_needs(values: Parameters) -> tuple[tuple[str, ...], ...]:
    scaled = values.get("FW_ARSP_SCALE_EN", 1.0)
    return (("FW_YR_P",), *((("FW_AIRSPD_TRIM",),) if scaled else ()))


AUTOPILOTS: Final = {
    row.name: row
    for row in (
        Autopilot(
            "ardupilot", "ArduPlane", ARDUPILOT, "YAW2SRV_DAMP", "SCHED_LOOP_RATE",
            lambda values: (("YAW2SRV_DAMP",), SCALING, LOWEST, HIGHEST),
            _arduplane_against, _arduplane_law, "YAW2SRV_RLL", "KFF_RDDRMIX",
        ),
        Autopilot(
            "px4", "PX4", PX4, "FW_YR_P", "IMU_GYRO_RATEMAX",
            _px4_needs, _px4_against, _px4_law, None, "FW_RLL_TO_YAW_FF",
        ),
    )
}  # fmt: skip
"""The dampers by name, as ``--autopilot`` takes them."""


READ: Final = (
    "YAW2SRV_DAMP", "YAW2SRV_RLL", "YAW2SRV_INT", "YAW2SRV_SLIP", "YAW_RATE_ENABLE", *SCALING,
    *LOWEST, *HIGHEST, "SCHED_LOOP_RATE", "KFF_RDDRMIX", "FW_YR_P", "FW_YR_I", "FW_YR_D",
    "FW_AIRSPD_TRIM", "FW_AIRSPD_STALL", "FW_AIRSPD_MIN", "FW_AIRSPD_MAX", "FW_ARSP_SCALE_EN",
    "IMU_GYRO_RATEMAX", "FW_RLL_TO_YAW_FF",
)  # fmt: skip
"""The parameters that a user may give; how surfaces share the yaw torque only the log says."""
