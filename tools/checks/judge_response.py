"""The response that a manoeuvre's answer gives, next to that of the linearised aircraft.

Compared are |G(jw)| from the rudder to the yaw rate at multiples of the true wn, and two numbers of
eq. 23, K (T s + 1) wn^2 / (s^2 + 2 zeta wn s + wn^2): K, and the yaw acceleration K T wn^2 of a
step. The truth's K and T fit its response in the band in which the answer's do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from flights.linear import GRAVITY
from flights.plan import FOOT, KNOT
from flights.sealed import plan_at
from flights.truth import LATERAL, response, with_roll_hold, yaw_channel
from numpy.typing import NDArray

from yawid.answers.run_summary import MethodSummary, Response, Value

Row = dict[str, Any]
Floats = NDArray[np.float64]
AT = (0.7, 1.0, 1.4)
"""The multiples of the true wn at which |G| is compared."""
BAND: Floats = np.linspace(0.6, 1.6, 21)
"""The multiples of wn at which eq. 23 is fitted to a response."""
SHOWN = (*(f"gain at {each:g} wn" for each in AT), "K", "yaw acceleration")
"""The names of the numbers."""
STEP = 1e-6
"""The step of the derivatives of |G| by its numbers, relative to their size."""


def gain(of: Response, w: float, name: str = "rudder") -> Value:
    """Return |G(jw)| of an input at w in rad/s, with its sigma by the covariance of its numbers."""
    poles = np.array(of.poles) @ (1.0, 1j)
    paired = poles.imag != 0.0
    pole_numbers = [x for p in poles for x in ((abs(p), -p.real / abs(p)) if p.imag else (p.real,))]
    ours = [
        (each == name, value)
        for each, residues in of.residues.items()
        for pair, is_pair in zip(residues, paired, strict=True)
        for value in pair[: 1 + is_pair]
    ]
    mine, values = np.array(ours).T
    numbers = np.concatenate([pole_numbers, values])
    own = np.concatenate([np.zeros(len(pole_numbers), bool), mine > 0.0])

    def size(x: Floats) -> float:
        at, G = iter(x[: len(pole_numbers)]), 0j
        each = iter(x[own])
        for is_pair in paired:
            if not is_pair:
                G += next(each) / (1j * w - next(at))
                continue
            wn, zeta = next(at), next(at)
            p = wn * complex(-zeta, np.sqrt(1.0 - zeta**2))
            r = complex(next(each), next(each))
            G += r / (1j * w - p) + r.conjugate() / (1j * w - p.conjugate())
        return float(abs(G))

    steps = STEP * np.maximum(np.abs(numbers), STEP)
    slopes = np.array([
        (size(numbers + move) - size(numbers - move)) / (2.0 * step)
        for step, move in zip(steps, np.diag(steps), strict=True)
    ])  # fmt: skip
    return Value(size(numbers), float(np.sqrt(slopes @ np.array(of.covariance) @ slopes)))


def numbers_shown(answer: MethodSummary | None, wn_rad_s: float) -> Row:
    """Return the numbers of SHOWN and their sigmas; nothing of an answer without a response."""
    if answer is None or answer.response is None:
        return {}
    found = [gain(answer.response, each * wn_rad_s) for each in AT]
    found += [(answer.physics or {})["K"], answer.yaw_acceleration or Value()]
    row: Row = {}
    for name, of in zip(SHOWN, found, strict=True):
        row |= {name: of.value, f"{name}_sigma": of.std}
    return row


def less_turn(A: Floats, rudder: Floats, per_roll: float) -> tuple[Floats, Floats]:
    """Return a model (n, n), (n,) whose yaw rate is less the turn, ``per_roll`` in 1/s of roll."""
    moved = np.eye(len(A))
    moved[LATERAL.index("R"), LATERAL.index("Phi")] = -per_roll
    return moved @ A @ np.linalg.inv(moved), moved @ rudder


def against(row: Row, truth: dict[str, Any]) -> Row:
    """Return a row, that of a usable answer with the errors in % of SHOWN, and their z.

    The truth is the linearisation at the mean airspeed of the manoeuvre, of the yaw rate less the
    turn where that was removed.
    """
    if SHOWN[0] not in row or not row["usable"]:
        return row
    flown = np.array(truth["flown"])
    inside = (flown[:, 0] >= row["from_s"]) & (flown[:, 0] <= row["to_s"])
    knots = round(float(flown[inside, 1].mean()), 1)
    plan = plan_at((truth["aircraft"], truth["altitude_m"] / FOOT, knots))
    bare, closed = with_roll_hold(plan)
    model = bare if "aileron" in row["inputs"] else closed
    if row["turn_removed"]:
        model = less_turn(*model, GRAVITY / (knots * KNOT))
    of = yaw_channel(*model, BAND)
    if of is None:
        return row
    wn = of["wn_rad_s"]
    true = np.abs(response(*model, row["wn_true"] * np.array(AT))).tolist()
    true += [of["K"], of["K"] * of["T_s"] * wn**2]
    for name, value in zip(SHOWN, true, strict=True):
        off = row[name] - value
        row |= {f"{name}_error_pct": 100.0 * off / value, f"{name}_z": off / row[f"{name}_sigma"]}
    return row
