"""Summaries of whole flights, written by hand like that of a recorded one (sitl_fbwa_50hz)."""

from __future__ import annotations

from typing import Any

from msgspec.structs import replace

from yawid.answers.heard import LinkCounts, VehicleSeen
from yawid.answers.model_parts import Fit, Mode
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import (
    BetweenStd,
    DutchRoll,
    Flight,
    Manoeuvre,
    MethodSummary,
    Orders,
    RunSummary,
    Value,
)

ORDERS = Orders(3, 3, 2, 1)
NOT_CONVERGED = Reason(
    "not_converged",
    "the natural frequency went from 9.1 to 12.4 rad/s between the two halves of the manoeuvre",
    weight="fatal",
)


def estimate(
    method: str, roll: DutchRoll | None, fit_pct: float | None = 91.3, **more: Any
) -> MethodSummary:
    given: dict[str, Any] = {
        "method": method,
        "orders": ORDERS,
        "sample_time_s": 0.04,
        "updates": 575,
        "held": 4,
        "theta": {"a1": -1.9},
        "theta_std": {"a1": 0.01},
        "modes": [Mode(kind="dutch_roll", wn_rad_s=10.2, zeta=0.62)],
        "dutch_roll": roll,
        "physics": {"K": Value(0.308, 0.006, 0.002), "T_theta_s": Value(0.85, 0.04)},
        "fit": Fit(one_step_pct=98.1, simulation_pct=fit_pct),
    }
    return MethodSummary(**(given | more))


def by_ct(roll: DutchRoll | None) -> MethodSummary:
    """Return the answer of a manoeuvre by the continuous-time fit."""
    gone = {"orders": None, "theta": None, "theta_std": None}
    return estimate("ct", roll, **gone, structure="2L", fit=Fit(simulation_pct=91.3))


def roll_of(
    wn: float,
    zeta: float,
    wn_std: float = 0.11,
    zeta_std: float = 0.012,
    noise: tuple[float, float] = (0.03, 0.004),
) -> DutchRoll:
    return DutchRoll(
        wn_rad_s=wn, wn_std=wn_std, wn_std_noise=noise[0], zeta=zeta, zeta_std=zeta_std,
        zeta_std_noise=noise[1],
    )  # fmt: skip


def verdict(*reasons: str, weight: str = "fatal") -> Verdict:
    told = [Reason(each, "", weight=weight) for each in reasons]
    usable = not told or weight == "warning"
    return Verdict(method="ct", usable=usable, reasons=told)


def plain_summary(**more: Any) -> RunSummary:
    """Return a summary with as few fields as possible."""
    given = {"log": "a.tlog", "duration_s": 1.0, "link": LinkCounts(), "channels": {}}
    return RunSummary(**(given | {"verdict": Verdict(usable=True, reasons=[])} | more))


def manoeuvre(
    n: int,
    wn: float | None = 10.2,
    zeta: float = 0.62,
    *,
    speed: float | None = 22.0,
    reason: Reason | None = None,
    **more: Any,
) -> Manoeuvre:
    """Return manoeuvre ``n``, half a minute long, a minute after the last one.

    With a ``reason`` it is not usable.
    """
    from_s = 60.0 * n - 25.0
    minutes, seconds = divmod(2 + round(from_s), 60)
    roll = None if wn is None else roll_of(wn, zeta)
    given: dict[str, Any] = {
        "n": n,
        "from_s": from_s,
        "to_s": from_s + 32.4,
        "duration_s": 32.4,
        "date": f"2026-03-05T12:{14 + minutes}:{seconds:02d}.040Z",
        "mode": "FBWA",
        "loop": "with_roll_loop",
        "airspeed_m_s": speed,
        "airspeed_std_m_s": None if speed is None else 0.3,
        "airspeed_source": None if speed is None else "airspeed",
        "altitude_m": 102.4,
        "inputs": ["rudder"],
        "turn_removed": False,
        "estimates": {
            "ct": by_ct(roll),
            "els": estimate("els", roll),
            "rml": estimate("rml", roll),
        },
        "verdict": Verdict(
            method="ct", usable=reason is None, reasons=[] if reason is None else [reason]
        ),
    }
    return Manoeuvre(**(given | more))


def flight(**more: Any) -> Flight:
    given: dict[str, Any] = {
        "method": "ct",
        "airspeed_m_s": 22.0,
        "airspeed_source": "airspeed",
        "altitude_m": 102.0,
        "date": "2026-03-05T12:14:37.040Z",
        "loop": "with_roll_loop",
        "dutch_roll": roll_of(10.21, 0.624, 0.16, 0.021),
        "kappa_rad_m": Value(0.4634, 0.0077, 0.0012),
        "K_per_V": Value(0.014, 0.0004, 0.0001),
        "overshoot_pct": Value(8.1, 1.2, 0.3),
        "settling_s": Value(0.462, 0.031, 0.008),
        "between_std": BetweenStd(wn_rad_s=0.15, zeta=0.02),
        "used": [1, 2],
        "disagree": [3],
        "verdict": Verdict(method="ct", usable=True, reasons=[]),
    }
    return Flight(**(given | more))


def summary(
    manoeuvres: list[Manoeuvre] | None, of: Flight | None, stream: DutchRoll | None = None
) -> RunSummary:
    """Return the summary of a run whose stream ended at 13.5 rad/s; ``of`` is its flight."""
    roll = stream or roll_of(13.5, 0.71, 0.09, 0.01)
    return RunSummary(
        log="flights/2026-03-05 12-14-02.tlog",
        duration_s=268.0,
        vehicle=VehicleSeen(1, 1, 1, 3),
        link=LinkCounts(frames=40_212),
        channels={},
        estimates={"els": estimate("els", roll, 31.0), "rml": estimate("rml", roll, 33.0)},
        verdict=of.verdict if of is not None else Verdict.of([NOT_CONVERGED]),
        manoeuvres=manoeuvres,
        flight=of,
    )


def four() -> list[Manoeuvre]:
    """Return four manoeuvres: two that are used, one that disagrees, one that is not usable."""
    return [
        manoeuvre(1, 10.27, 0.624),
        manoeuvre(2, 10.07, 0.617, speed=21.6),
        manoeuvre(3, 11.92, 0.41, speed=22.3, turn_removed=True),
        manoeuvre(4, 12.4, 0.33, speed=22.9, mode="STABILIZE", reason=NOT_CONVERGED),
    ]


def four_of_a_flight() -> RunSummary:
    return summary(four(), flight())


def none_usable() -> RunSummary:
    refused = [manoeuvre(n, wn, reason=NOT_CONVERGED) for n, wn in ((1, 12.4), (2, None))]
    verdict = Verdict(method="ct", usable=False, reasons=[NOT_CONVERGED])
    return summary(refused, Flight(used=[], disagree=[], verdict=verdict))


def without_airspeed() -> RunSummary:
    every = [replace(manoeuvre(n, speed=None), altitude_m=None) for n in (1, 2)]
    of = flight(airspeed_m_s=None, airspeed_source=None, altitude_m=None, kappa_rad_m=None,
                K_per_V=None, disagree=[])  # fmt: skip
    return summary(every, of)


def forty() -> RunSummary:
    every = [manoeuvre(n, 8.0 + 0.07 * n, speed=17.5 + 0.15 * n) for n in range(1, 41)]
    return summary(every, flight(used=list(range(1, 41)), disagree=[]))


def mixed_loops() -> RunSummary:
    """A flight with an answer for each loop, that with the roll loop first."""
    every = [
        manoeuvre(1, 10.4, 0.61, mode="MANUAL", loop="airframe", inputs=["rudder", "aileron"]),
        manoeuvre(2, 10.2, 0.63, airspeed_source="ground speed"),
        manoeuvre(3, 10.3, 0.62, mode=None, loop="unknown"),
    ]
    first = flight(used=[2], disagree=[], physics={"a_my_beta": Value(101.0, 3.0, 1.0)})
    bare = flight(
        used=[1], disagree=[], loop="airframe", dutch_roll=roll_of(10.4, 0.61, 0.3, 0.03),
        kappa_rad_m=Value(0.473, 0.014, 0.002), physics={"a_my_beta": Value(104.0, 6.0, 2.0)},
    )  # fmt: skip
    unknown = flight(
        used=[3], disagree=[], loop="unknown", dutch_roll=roll_of(10.3, 0.62, 0.4, 0.04)
    )
    return replace(summary(every, first), flights=[first, bare, unknown])


EVERY = {
    make.__name__: make
    for make in (four_of_a_flight, none_usable, without_airspeed, forty, mixed_loops)
}
