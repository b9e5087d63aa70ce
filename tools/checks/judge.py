"""Compares yawid's answers with the truth of a log, as rows that all judges of flights count.

A row is one estimate: a manoeuvre's answer (kind ``manoeuvre``), what the recursive methods had at
its end (``rml``, ``els``), its bare airframe (``bare``), or the flight's (``flight``). Recursive
methods have no verdict; their rows have that of the answer with which they are shown.

The response that an answer gives is compared with that of the linearised aircraft: |G(jw)| from the
rudder to the yaw rate at multiples of the true wn, and two numbers of eq. 23,
K (T s + 1) wn^2 / (s^2 + 2 zeta wn s + wn^2): K, and the yaw acceleration K T wn^2 of a step. The
truth's K and T fit its response in the band in which the answer's do.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import control
import numpy as np
from bench.frame import METHODS, Floats, Row, Truth
from flights.flight import trimmed
from flights.fly import Made
from flights.linear import GRAVITY
from flights.plan import FOOT, KNOT, FlightPlan, plan_at
from flights.truth import LATERAL, PHI, R, at_airspeeds, dutch_roll, lateral, with_roll_hold

from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import Bare, DutchRoll, Manoeuvre, RunSummary
from yawid.config.run import RunConfig
from yawid.errors import YawidError
from yawid.lateral.model import DERIVATIVES
from yawid.models.answered import Answered, changes_of
from yawid.runs.job import open_log, run

Known = tuple[Floats, Floats]
"""True wn in rad/s and zeta (2,), and their sigmas (2,)."""
NOT_JUDGED = Verdict(usable=False, reasons=[])


def kept(folder: Path, name: str, make: Callable[[], Made]) -> tuple[Path, Truth]:
    """Return a log and its truth; make them if the folder does not have them yet."""
    log, truth = folder / f"{name}.tlog", folder / f"{name}.json"
    if not truth.exists():  # the truth is written last, so with it the log is complete
        made = make()
        log.write_bytes(made.log)
        truth.write_text(json.dumps(made.truth, indent=1) + "\n", encoding="utf-8")
    return log, json.loads(truth.read_text(encoding="utf-8"))


def replayed(log: Path, config: RunConfig | None = None) -> RunSummary:
    """Return the summary of a log, replayed with the default options unless others are given."""
    return run(open_log(log), config or RunConfig()).conclude()


def judged(
    log: Path, truth: Truth, config: RunConfig | None = None, *, responses: bool = False
) -> list[Row]:
    """Replay a log and return its rows; a log that fails has only the flight's row, refused."""
    try:
        return compared(replayed(log, config), truth, responses=responses)
    except YawidError as error:
        row = {"kind": "flight"} | judged_answer(None, None, NOT_JUDGED)
        return [row | {"fatal": type(error).__name__}]


def flown_kt(truth: Truth, from_s: float, to_s: float) -> Floats:
    """Return the airspeeds (n,) in kt that a truth has between two boot times."""
    flown = np.array(truth["flown"])
    return np.asarray(flown[(flown[:, 0] >= from_s) & (flown[:, 0] <= to_s), 1])


def true_at(truth: Truth, from_s: float, to_s: float, inputs: Sequence[str]) -> Known | None:
    """Return the truth between two boot times, or None if it is unknown.

    With the aileron as an input, the roll hold is not part of the model, and the truth is that of
    the bare airframe.
    """
    name = "dutch_roll_open_loop" if "aileron" in inputs else "dutch_roll"
    line = truth.get("lines", {}).get(name)
    return line and at_airspeeds(line, flown_kt(truth, from_s, to_s))


def compared(summary: RunSummary, truth: Truth, *, responses: bool = False) -> list[Row]:
    """Return the rows of one flight; its own row has no estimate if it is refused.

    With ``responses``, those of usable answers have the errors in % of SHOWN, and their z.
    """
    rows, known = list[Row](), dict[int, Known | None]()
    for found in summary.manoeuvres or []:
        true = partial(true_at, truth, found.from_s, found.to_s)
        known[found.n] = of = true(found.inputs)
        stream = {name: each.dutch_roll for name, each in found.estimates.items()}
        own = {name: judged_answer(stream.get(name), true(["rudder"]), found.verdict)
               for name in METHODS}  # fmt: skip
        own["manoeuvre"] = judged_answer(found.dutch_roll, of, found.verdict)
        if responses and found.verdict.usable and of is not None:
            own["manoeuvre"] |= response_errors(found, truth, float(of[0][0]))
        if (bare := found.lateral) is not None:
            own["bare"] = judged_answer(bare.dutch_roll, true(["aileron"]), bare.verdict)
            if responses and bare.verdict.usable:
                own["bare"] |= bare_errors(found, bare, truth)
        rows += [{"from_s": found.from_s, "kind": kind} | row for kind, row in own.items()]
    return [*rows, _flight_row(summary, known)]


def _flight_row(summary: RunSummary, known: Mapping[int, Known | None]) -> Row:
    """Return the row of a flight, compared with the mean truth of the manoeuvres that it uses.

    Each wn is scaled to the flight's airspeed; sigma has theirs and their scatter.
    """
    flight, verdict, of = summary.flight, summary.deciding, None
    if flight is None or not verdict.usable:
        return {"kind": "flight"} | judged_answer(None, None, verdict)
    used = [each for each in summary.manoeuvres or [] if each.n in flight.used]
    truths, at = [known[each.n] for each in used], flight.airspeed_m_s
    if truths and all(truths):
        scales = [[at / each.airspeed_m_s if at and each.airspeed_m_s else 1.0, 1.0]
                  for each in used]  # fmt: skip
        values, sigmas = np.swapaxes(np.array(truths), 0, 1) * np.array(scales)
        of = values.mean(axis=0), np.sqrt(np.mean(sigmas**2, axis=0) + values.var(axis=0))
    return {"kind": "flight"} | judged_answer(flight.dutch_roll, of, verdict)


def judged_answer(roll: DutchRoll | None, known: Known | None, verdict: Verdict) -> Row:
    """Return verdict, truth, estimate, error (wn's in %) and z; unknown ones are None.

    ``z_mean`` is that of a flight's mean.
    """
    row: Row = {
        "usable": verdict.usable,
        "warnings": " ".join(r.id for r in verdict.reasons if r.weight == "warning"),
        "fatal": " ".join(r.id for r in verdict.fatal),
    }
    keys = ("wn", "wn_rad_s", "wn_error_pct"), ("zeta", "zeta", "zeta_error")
    for i, (name, key, error) in enumerate(keys):
        true, true_sigma = (None, None) if known is None else (float(x[i]) for x in known)
        value = getattr(roll, key, None)
        off = None if value is None or true is None else value - true
        row |= {f"{name}_true": true, f"{name}_true_sigma": true_sigma, name: value}
        row[error] = 100.0 * off / true if off is not None and true and name == "wn" else off
        for end in ("", "_mean"):
            sigma = getattr(roll, f"{name}_std{end}", None)
            total = math.hypot(sigma or 0.0, true_sigma or 0.0)
            row[f"{name}_z{end}"] = (
                None if off is None or sigma is None or total == 0.0 else off / total
            )
    return row


OF_BARE = ("roll mode", *DERIVATIVES)
"""The numbers of a bare airframe that are compared, next to wn and zeta."""


def bare_errors(found: Manoeuvre, bare: Bare, truth: Truth) -> Row:
    """Return the errors in % of the numbers of OF_BARE that an airframe has, and their z.

    The truth is the linearisation at the mean airspeed of the manoeuvre; a positive rudder turns
    the nose to the right.
    """
    A, aileron, rudder = lateral(trimmed(plan_of(found, truth)))
    rows = {"Y": LATERAL.index("Beta"), "L": LATERAL.index("P"), "N": R}
    columns = {"beta": A[:, rows["Y"]], "p": A[:, rows["L"]], "r": A[:, R]}
    columns |= {"delta_a": aileron, "delta_r": -rudder}
    true = {name: float(columns[name[2:]][rows[name[0]]]) for name in DERIVATIVES}
    poles = np.linalg.eigvals(A)
    true["roll mode"] = -1.0 / float(poles[np.abs(poles.imag) < 1e-6].real.min())
    known = {name: (each.value, each.std) for name, each in (bare.derivatives or {}).items()}
    if bare.roll_mode is not None:
        known["roll mode"] = bare.roll_mode.time_constant_s, bare.roll_mode.std
    row: Row = {}
    for name, (value, std) in known.items():
        if value is not None and std:
            row[f"{name}_error_pct"] = 100.0 * (value - true[name]) / (true[name] or math.nan)
            row[f"{name}_z"] = (value - true[name]) / std
    return row


def plan_of(found: Manoeuvre, truth: Truth) -> FlightPlan:
    """Return the aircraft at its altitude and at the mean airspeed of a manoeuvre."""
    knots = round(float(flown_kt(truth, found.from_s, found.to_s).mean()), 1)
    return plan_at((truth["aircraft"], truth["altitude_m"] / FOOT, knots))


AT: Floats = np.array([0.7, 1.0, 1.4])
"""The multiples of the true wn at which |G| is compared."""
BAND: Floats = np.linspace(0.6, 1.6, 21)
"""The multiples of wn at which eq. 23 is fitted to a response."""
SHOWN = (*(f"gain at {each:g} wn" for each in AT), "K", "yaw acceleration")
"""The names of the numbers."""


def response_errors(found: Manoeuvre, truth: Truth, wn_rad_s: float) -> Row:
    """Return the errors in % of the numbers of SHOWN, and their z; of the true wn.

    The truth is the linearisation at the mean airspeed of the manoeuvre, of the yaw rate less the
    turn where that was removed.
    """
    plan = plan_of(found, truth)
    bare, closed = with_roll_hold(plan)
    A, rudder = bare if "aileron" in found.inputs else closed
    turn = GRAVITY / (plan.speed_kt * KNOT) if found.turn_removed else 0.0
    row: Row = {}
    shown, known = numbers_shown(found, wn_rad_s), true_numbers(A, rudder, turn, wn_rad_s)
    for name, (value, std), true in zip(SHOWN, shown, known, strict=True):
        row[f"{name}_error_pct"] = 100.0 * (value - true) / true
        row[f"{name}_z"] = (value - true) / std
    return row


def numbers_shown(found: Manoeuvre, wn_rad_s: float) -> list[tuple[Any, Any]]:
    """Return the numbers of SHOWN of an answer, and their sigmas by the fit's covariance."""
    model, answer = Answered.of(found), found.answer
    assert answer is not None
    assert answer.response is not None
    rudder, s = model.inputs.index("rudder"), np.asarray(1j * wn_rad_s * AT, complex)

    def size(x: Floats) -> Floats:
        return np.asarray(np.abs(model.transfers(x[None])[rudder].at(s)[0]))

    changes = changes_of(size, model.x, np.array(answer.response.covariance))
    gains = zip(size(model.x).tolist(), np.linalg.norm(changes, axis=-1).tolist(), strict=True)
    others = (answer.physics or {}).get("K"), answer.yaw_acceleration
    return [*gains, *((each.value, each.std) for each in others if each is not None)]


def true_numbers(A: Floats, rudder: Floats, turn: float, wn_rad_s: float) -> list[float]:
    """Return the numbers of SHOWN of a model A (n, n), rudder (n,).

    Its yaw rate is less the turn, ``turn`` in 1/s of the roll. K and T minimise the relative misfit
    of eq. 23 to the whole response: that also has spiral and roll mode, eq. 23 does not.
    """
    mode, eye = dutch_roll(A, rudder, R), np.eye(len(A))
    assert mode is not None
    wn, zeta = mode["wn_rad_s"], mode["zeta"]
    G = control.ss(A, -rudder[:, None], eye[R] - turn * eye[PHI], 0.0)
    s = 1j * wn * BAND
    pair = wn**2 / (s**2 + 2.0 * zeta * wn * s + wn**2) / G(s)
    columns = np.stack([pair, pair * s], axis=1)
    real = np.concatenate([columns.real, columns.imag])
    K, KT = np.linalg.lstsq(real, np.repeat([1.0, 0.0], len(s)), rcond=None)[0].tolist()
    return [*np.abs(G(1j * wn_rad_s * AT)).tolist(), K, KT * wn**2]
