"""A flight as data: legs one after the other, from a named plan, a TOML file, or Python.

    aircraft = "c172p"
    speed_kt = 95.0
    [[leg]]
    kind = "manoeuvre"
    seconds = 60.0
    shape = "3211"
    [[leg]]
    kind = "turn"
    seconds = 25.0
    bank_deg = 20.0

This flies a 3-2-1-1 and a turn; :class:`Leg` describes all fields of a leg.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, fields, replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flights.plan import (
    LEAD_IN_S,
    STEP_S,
    FlightPlan,
    excitation,
    manoeuvre_pieces,
)

Floats = NDArray[np.float64]
KINDS = ("manoeuvre", "idle", "turn", "climb", "speed", "gust", "landing", "go_around")
MODES = {"MANUAL": 0, "FBWA": 5}
"""ArduPlane's custom_mode by name; FBWA has the roll hold, in MANUAL the aileron is held still."""
BEFORE_S, AFTER_S = 2.0, 8.0
"""Time in s of still rudder at the ends of a manoeuvre leg. The last 8 s contain the free decay and
5 s of rest."""
LONGEST_REST_S = 4.0
"""Longest rest in s between the moves of one manoeuvre; 5 s of rest would end it."""
STIR_S = 0.5
"""Time in s in which ``rudder_hold`` rises at the beginning of a leg and falls at its end."""


@dataclass(frozen=True, slots=True)
class Leg:
    """One leg. Most fields apply to all kinds: a turn may climb, and an idle leg may be gusty.

    ``shape`` and ``amplitude`` (rudder units) are those of a manoeuvre. ``speed_kt`` is held from
    this leg on (0: as before). ``climb_ft_min`` is flown until ``to_ft``, if given. ``rudder_hold``
    is a steady rudder, positive to the right.
    MANUAL needs level wings at its beginning, so an idle leg should precede it, not a turn.
    ``severity`` is that of the turbulence (MIL-F-8785C, 0 to 7). ``gust_m_s`` is the peak of one
    side gust, a (1 - cos) of ``gust_s``; the seed draws its side, its time and a factor of its size
    from 0.7 to 1.3.

    Raises:
        ValueError: an unknown kind, mode or shape, or a number outside its limits.
    """

    kind: str
    seconds: float
    mode: str = "FBWA"
    shape: str = "3211"
    amplitude: float = 0.15
    speed_kt: float = 0.0
    bank_deg: float = 0.0
    climb_ft_min: float = 0.0
    to_ft: float = math.nan
    rudder_hold: float = 0.0
    severity: int = 0
    gust_m_s: float = 0.0
    gust_s: float = 2.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"a leg's kind must be one of {', '.join(KINDS)}, got {self.kind!r}")
        if self.mode not in MODES:
            raise ValueError(f"a leg's mode must be one of {', '.join(MODES)}, got {self.mode!r}")
        least = BEFORE_S + AFTER_S if self.kind == "manoeuvre" else 0.0
        if not least < self.seconds < math.inf:
            raise ValueError(f"a leg of kind {self.kind} must last more than {least:g} s")
        if self.rudder_hold and self.kind in ("manoeuvre", "turn", "idle"):
            raise ValueError(f"rudder_hold must be 0 in a leg of kind {self.kind}")
        if not 0 <= self.severity <= 7:
            raise ValueError(f"severity must be 0 to 7, got {self.severity!r}")
        FlightPlan(manoeuvre=self.shape, amplitude=self.amplitude)


@dataclass(frozen=True, slots=True)
class LegPlan:
    """The aircraft, its trim at the start, its roll hold, and the legs that it flies.

    Raises:
        ValueError: there are no legs, or a number is outside its limits.
    """

    aircraft: str
    speed_kt: float
    legs: tuple[Leg, ...]
    altitude_ft: float = 3000.0
    heading_deg: float = 90.0
    roll_gain: float = FlightPlan().roll_gain
    roll_rate_gain: float = FlightPlan().roll_rate_gain
    true_feedback: bool = False

    def __post_init__(self) -> None:
        if not self.legs:
            raise ValueError("a plan needs legs")
        self.trim_plan()

    def trim_plan(self) -> FlightPlan:
        """Return the plan of :mod:`flights.plan` with the same start and length."""
        names = [field.name for field in fields(self) if field.name != "legs"]
        same: dict[str, Any] = {name: getattr(self, name) for name in names}
        seconds = sum(leg.seconds for leg in self.legs)
        return FlightPlan(**same, seconds=seconds, manoeuvre="none")

    def speeds_kt(self) -> list[float]:
        """Return the calibrated airspeed in kt that each leg holds."""
        speeds = [self.speed_kt]
        for leg in self.legs:
            speeds.append(leg.speed_kt or speeds[-1])
        return speeds[1:]


def rudder_moves(leg: Leg, step_s: float) -> Floats:
    """Return the rudder about trim for every millisecond of a leg (n,), in units.

    The leg has as many whole sequences of the manoeuvre as fit; a PRBS or sweep fills it.
    """
    moves = np.zeros(round(leg.seconds / STEP_S))
    first, room = round(BEFORE_S / STEP_S), round((leg.seconds - BEFORE_S - AFTER_S) / STEP_S)
    if leg.kind != "manoeuvre":
        foot = round(STIR_S / STEP_S)
        ends = np.minimum(np.arange(len(moves)), np.arange(len(moves))[::-1]) / foot
        return np.asarray(leg.rudder_hold * np.minimum(ends, 1.0))
    if leg.shape == "sweep":
        plan = FlightPlan(manoeuvre="sweep", amplitude=leg.amplitude, step_s=step_s)
        whole = excitation(replace(plan, seconds=LEAD_IN_S + room * STEP_S))
        moves[first : first + room] = whole[round(LEAD_IN_S / STEP_S) :][:room]
        return moves
    at = complete = first
    for length_s, value in cycle(manoeuvre_pieces(leg.shape, step_s)):
        length_s = length_s if value else min(length_s, LONGEST_REST_S)
        stop = at + round(length_s / STEP_S)
        if value and stop > first + room:
            break
        moves[at:stop] = value * leg.amplitude
        if leg.shape == "prbs" or not value:
            complete = stop
        at = stop
    moves[complete:] = 0.0
    return moves


def read_plan(name: str) -> LegPlan:
    """Return the plan of this name, or that of a TOML file.

    Raises:
        ValueError: ``name`` is neither, or the file has an unknown field or a wrong value.
        OSError: the file cannot be read.
    """
    if name in PLANS:
        return PLANS[name]
    path = Path(name)
    if path.suffix != ".toml":
        raise ValueError(f"--plan must be a .toml file or one of {', '.join(PLANS)}, got {name!r}")
    try:
        return _read(path)
    except (TypeError, tomllib.TOMLDecodeError) as error:
        raise ValueError(f"{name}: {error}") from error


def _read(path: Path) -> LegPlan:
    found = tomllib.loads(path.read_text(encoding="utf-8"))
    legs = tuple(Leg(**leg) for leg in found.pop("leg", []))
    return LegPlan(**found, legs=legs)


PLANS = {path.stem: _read(path) for path in (Path(__file__).parent / "plans").glob("*.toml")}
"""The named plans, which are the files of the folder plans."""
