"""An aircraft of JSBSim in flight: trimmed, held by an autopilot, its controls moved on purpose.

The autopilot's sensors have the noise that ATTITUDE reports; with a plan's ``true_feedback`` they
have none, as when the cases of replay_logs/ were recorded. Outside of :func:`jsbsim_rudder`, a
positive rudder turns the nose right, as in ArduPilot; in JSBSim, a positive ``fcs/rudder-cmd-norm``
turns it left. A positive aileron rolls right in both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jsbsim
import numpy as np
from scipy.optimize import root

from flights.linear import SEVERITY, LinearAircraft
from flights.plan import (
    SENSED,
    SENSED_MS,
    STEP_S,
    FlightError,
    FlightPlan,
    Floats,
    Link,
    count,
    excitation,
    sealed,
)

NOTED = ("velocities/vc-kts", "position/h-sl-ft")
NOTED_MS = 250
PITCH_GAIN, PITCH_RATE_GAIN = 1.0, 0.3
"""Elevator units per rad and per rad/s that hold the nose as trimmed, and so the airspeed."""
MISSING = {
    "f104": ("systems/radar/range",),
    "L17": ("fcs/flaps-pos-deg",),
    "fokker100": (
        "/gear/gear/wow",
        *(f"/sim/model/pushback/{name}" for name in ("position-norm", "ki", "kp", "kd")),
    ),
}
"""Properties that an aircraft of JSBSim's reads and only FlightGear makes: without them it does not
load."""
STOPPED = ("c182",)
"""Aircraft of JSBSim's whose engine stops in ``run_ic``: it is started again before the trim."""
GLIDING = ("C130", "p51d")
"""Aircraft of JSBSim's whose engines do not run without FlightGear: they stay off."""
BALANCE = {
    "ic/alpha-rad": "accelerations/wdot-ft_sec2",
    "ic/gamma-rad": "accelerations/udot-ft_sec2",
    "fcs/elevator-cmd-norm": "accelerations/qdot-rad_sec2",
    "ic/phi-rad": "accelerations/vdot-ft_sec2",
    "fcs/aileron-cmd-norm": "accelerations/pdot-rad_sec2",
    "fcs/rudder-cmd-norm": "accelerations/rdot-rad_sec2",
}
"""What the trim of a gliding aircraft moves, and the accelerations that are 0 then."""
UNBALANCED = 0.01
"""The largest acceleration, in ft/s^2 or rad/s^2, that a trim of a gliding aircraft leaves."""


@dataclass(slots=True)
class Hands:
    """What moves the controls in addition to the autopilot, with a value for each millisecond.

    ``rudder`` and ``aileron`` (n,) are in units about trim, ``bank`` (n,) is the roll in rad to be
    held; None is 0. ``react`` is called with the flight each millisecond and returns additional
    rudder. With ``nose_held`` the elevator holds the nose as trimmed; otherwise it does not move.
    """

    rudder: Floats | None = None
    aileron: Floats | None = None
    bank: Floats | None = None
    react: Callable[[Flight], float] | None = None
    nose_held: bool = True


def jsbsim_rudder(unit: float) -> float:
    """Convert yawid's rudder (positive: nose right) to JSBSim's (positive: nose left), or back."""
    return -unit


def put(fdm: Any, values: Mapping[str, float]) -> None:
    """Set properties of an aircraft by their names in JSBSim, in this order."""
    for name, value in values.items():
        fdm[name] = value


def stir(fdm: Any, seed: int, severity: int) -> None:
    """Begin the turbulence of a severity (MIL-F-8785C)."""
    put(fdm, {
        "atmosphere/randomseed": seed,
        "atmosphere/turb-type": 3,  # MIL-F-8785C
        SEVERITY: severity,
    })  # fmt: skip


def trimmed(plan: FlightPlan) -> Any:
    """Return a ``jsbsim.FGFDMExec`` in straight and level flight, engines running or GLIDING.

    A linear aircraft, of the plan's own or of sealed.toml, is returned as it is.

    Raises:
        FlightError: JSBSim does not have the aircraft, or finds no trim.
    """
    if "servo_lag_s" in (own := dict(plan.own) or sealed(plan.aircraft)):
        return LinearAircraft(own, plan)
    jsbsim.set_logger(jsbsim.DefaultLogger(jsbsim.LogLevel.FATAL))
    fdm = jsbsim.FGFDMExec(jsbsim.get_default_root_dir())
    fdm.set_debug_level(0)
    fdm.disable_output()
    put(fdm, dict.fromkeys(MISSING.get(plan.aircraft, ()), 0.0))
    if not fdm.load_model(plan.aircraft):
        raise FlightError(f"JSBSim cannot load {plan.aircraft!r}")
    fdm.set_dt(STEP_S)
    put(fdm, {
        "ic/h-sl-ft": plan.altitude_ft, "ic/vc-kts": plan.speed_kt, "ic/gamma-deg": 0.0,
        "ic/psi-true-deg": plan.heading_deg, "gear/gear-cmd-norm": 0.0,
    })  # fmt: skip
    if plan.aircraft in GLIDING:
        return _gliding(fdm, plan)
    fdm["propulsion/set-running"] = -1
    fdm.run_ic()
    if plan.aircraft in STOPPED:
        fdm["propulsion/set-running"] = -1
    try:
        fdm.do_trim(jsbsim.TrimMode.FULL)
    except jsbsim.TrimFailureError as error:
        raise FlightError(
            f"{plan.aircraft} finds no trim at {plan.speed_kt:g} kt, {plan.altitude_ft:g} ft"
        ) from error
    return fdm


def _gliding(fdm: Any, plan: FlightPlan) -> Any:
    """Return an aircraft that is trimmed without thrust, in air that rises as fast as it sinks.

    So it keeps its altitude: the motion is that of a glide, seen from the rising air. JSBSim's own
    initial conditions stay those of the glide in still air, at which ``FGLinearization`` starts.

    Raises:
        FlightError: no trim is found.
    """

    def accelerations(moves: Floats) -> list[float]:
        put(fdm, dict(zip(BALANCE, moves.tolist(), strict=True)) | {"ic/vc-kts": plan.speed_kt})
        fdm.run_ic()
        return [fdm[name] for name in BALANCE.values()]

    fdm.set_trim_status(True)  # the gear is up, and the controls are where they are commanded to be
    start = np.array([0.05, -0.08, 0.0, 0.0, 0.0, 0.0])
    glide = root(accelerations, start, method="lm", options={"eps": 1e-5}).x
    if not max(map(abs, accelerations(glide))) < UNBALANCED:
        raise FlightError(f"{plan.aircraft} finds no glide at {plan.speed_kt:g} kt")
    alpha, gamma = glide[:2].tolist()
    speed_fps = fdm["velocities/vt-fps"]
    put(fdm, {
        "ic/vt-fps": speed_fps * math.cos(gamma), "ic/gamma-rad": 0.0,
        "ic/alpha-rad": alpha + gamma,
    })  # fmt: skip
    fdm.run_ic()
    fdm["atmosphere/wind-down-fps"] = speed_fps * math.sin(gamma)
    fdm.suspend_integration()
    fdm.run()
    fdm.resume_integration()
    put(fdm, {"ic/gamma-rad": gamma, "ic/alpha-rad": alpha, "ic/vc-kts": plan.speed_kt})
    fdm.set_trim_status(False)
    return fdm


class Flight:
    """A flight in progress: ``advance_to`` a millisecond after the start, then read properties.

    ``hands`` move the controls; without them only the rudder moves as the plan says, and the
    elevator does not move. ``severity`` is that of the turbulence (MIL-F-8785C, 0: calm). ``flown``
    collects time in s, calibrated airspeed in kt and altitude in ft, four times a second from the
    start. ``noise`` (6,) is the present noise of the sensors in the order of ``SENSED``; None if
    they have none.

    The command of an instant is set before the step that arrives there: JSBSim first propagates the
    state, then evaluates controls and forces, so that the command acts from that instant on.

    Raises:
        FlightError: the aircraft cannot be loaded or trimmed, or trim and moves pass the stops.
    """

    def __init__(
        self,
        plan: FlightPlan,
        hands: Hands | None = None,
        link: Link | None = None,
        severity: int = 0,
    ) -> None:
        hands = hands or Hands(excitation(plan), nose_held=False)
        link = link or Link()
        self._fdm = fdm = trimmed(plan)
        self.plan, self._hands = plan, hands
        n = count(plan.seconds)
        self._elevator, self._pitch = fdm["fcs/elevator-cmd-norm"], fdm["attitude/theta-rad"]
        self._aileron_trim = fdm["fcs/aileron-cmd-norm"]
        rudder = _about(jsbsim_rudder(fdm["fcs/rudder-cmd-norm"]), hands.rudder, n)
        aileron = _about(self._aileron_trim, hands.aileron, n)
        roll = _about(fdm["attitude/phi-rad"], hands.bank, n)
        if max(map(abs, rudder)) > 1.0:
            raise FlightError("trim and amplitude together pass the rudder's stop")
        self._asked = list(zip(rudder, aileron, roll, strict=False))
        self.rudder_us = plan.rudder.pulse(rudder[0])
        self.aileron_us = plan.aileron.pulse(self._aileron_trim)
        if severity:
            stir(fdm, link.seed, severity)
        rng = np.random.default_rng([link.seed, 43])
        self._noises = (
            [] if plan.true_feedback
            else rng.normal(0.0, link.sigmas, (n // SENSED_MS + 1, 6)).tolist()
        )  # fmt: skip
        self.noise: list[float] | None = None
        self.ms = 0
        self.flown: list[tuple[float, ...]] = []
        self._observe()

    def advance_to(self, ms: int) -> None:
        """Fly on to a millisecond after the start."""
        plan, hands = self.plan, self._hands
        while self.ms < ms:
            self.ms += 1
            rudder, aileron, roll = self._asked[self.ms]
            if hands.react:
                rudder += hands.react(self)
            rolled = plan.roll_gain * (self.sensed(0) - roll)
            aileron -= rolled + plan.roll_rate_gain * self.sensed(3)
            elevator = self._elevator
            if hands.nose_held:
                pitched = PITCH_GAIN * (self.sensed(1) - self._pitch)
                elevator = elevator + pitched + PITCH_RATE_GAIN * self.sensed(4)
            self.rudder_us = plan.rudder.pulse(rudder)
            self.aileron_us = plan.aileron.pulse(aileron)
            # The aircraft flies the servo outputs, with their quantisation.
            moved = self._moved(
                plan.rudder.unit(self.rudder_us), plan.aileron.unit(self.aileron_us)
            )
            put(self._fdm, {
                "fcs/rudder-cmd-norm": jsbsim_rudder(moved[0]),
                "fcs/aileron-cmd-norm": moved[1],
                "fcs/elevator-cmd-norm": elevator,
            })  # fmt: skip
            self._fdm.run()
            self._observe()

    def _observe(self) -> None:
        """Note what was flown, and take the sensors' next noise, each when it is due."""
        if self.ms % NOTED_MS == 0:
            self.flown.append((self.ms * STEP_S, *(self[name] for name in NOTED)))
        if self._noises and self.ms % SENSED_MS == 0:
            self.noise = self._noises[self.ms // SENSED_MS]

    def _moved(self, *commands: float) -> Sequence[float]:
        """Return what the servos of rudder and aileron make of their commands this millisecond."""
        return commands

    def sensed(self, number: int) -> float:
        """Return number ``number`` of ``SENSED`` as the autopilot senses it."""
        return self[SENSED[number]] + (self.noise[number] if self.noise else 0.0)

    @property
    def aileron(self) -> float:
        """The last command of the aileron in units about trim."""
        return float(self.plan.aileron.unit(self.aileron_us) - self._aileron_trim)

    def __getitem__(self, name: str) -> float:
        """Return the present value of a property of JSBSim."""
        return float(self._fdm[name])


def _about(trim: float, moves: Floats | None, n: int) -> list[float]:
    """Return a trim with the moves about it, if any, for each millisecond (n,)."""
    return [trim] * n if moves is None else (trim + moves).tolist()
