"""Compares yawid's answers with the truth of a log, as rows that all judges of flights count.

A row is one estimate: a manoeuvre's answer (kind ``manoeuvre``), what the recursive methods had at
its end (``rml``, ``els``), its bare airframe (``bare``), or the flight's (``flight``). Recursive
methods have no verdict; their rows have that of the answer with which they are shown.

The response that an answer gives stands next to that of the linearised aircraft: |G(jw)| from the
rudder to the yaw rate at multiples of the true wn, and two numbers of eq. 23,
K (T s + 1) wn^2 / (s^2 + 2 zeta wn s + wn^2): K, and the yaw acceleration K T wn^2 of a step. The
truth's K and T fit its response in the band in which the answer's do.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from bench.frame import METHODS, Floats, Row, Truth
from flights.fly import Made
from flights.linear import GRAVITY
from flights.plan import FOOT, KNOT, plan_at
from flights.truth import LATERAL, at_airspeeds, response, with_roll_hold, yaw_channel

from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import (
    DutchRoll,
    Manoeuvre,
    RunSummary,
    Value,
)
from yawid.config.run import RunConfig
from yawid.errors import YawidError
from yawid.models.answered import Answered, changes_of
from yawid.pipeline import Pipeline
from yawid.results.summary import summarise
from yawid.runs.job import feed_all, open_log

Known = tuple[Floats, Floats]
"""True wn in rad/s and zeta (2,), and their sigmas (2,)."""
BARE = ("aileron",)
"""The input with which a truth is that of the bare airframe."""
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
    source, pipeline = open_log(log), Pipeline(config or RunConfig())
    feed_all(source, pipeline)
    return summarise(pipeline, source.link, str(log), "")


def judged(log: Path, truth: Truth, config: RunConfig | None = None) -> list[Row]:
    """Replay a log and return its rows; a log that fails has only the flight's row, refused."""
    config = config or RunConfig()
    try:
        return compared(replayed(log, config), truth, config)
    except YawidError as error:
        row = {"kind": "flight"} | judged_answer(None, None, NOT_JUDGED)
        return [row | {"fatal": type(error).__name__}]


def true_at(truth: Truth, from_s: float, to_s: float, inputs: Sequence[str]) -> Known | None:
    """Return the truth between two boot times, or None if it is unknown.

    With the aileron as an input, the roll hold is not part of the model, and the truth is that of
    the bare airframe.
    """
    name = "dutch_roll_open_loop" if BARE[0] in inputs else "dutch_roll"
    line = truth.get("lines", {}).get(name)
    return line and at_airspeeds(line, flown_kt(truth, from_s, to_s))


def flown_kt(truth: Truth, from_s: float, to_s: float) -> Floats:
    """Return the airspeeds (n,) in kt that a truth has between two boot times."""
    flown = np.array(truth["flown"])
    return np.asarray(flown[(flown[:, 0] >= from_s) & (flown[:, 0] <= to_s), 1])


def compared(summary: RunSummary, truth: Truth, config: RunConfig | None = None) -> list[Row]:
    """Return the rows of one flight; its own row has no estimate if it is refused."""
    inputs, found = (config or RunConfig()).inputs, summary.manoeuvres or []
    known = {each.n: true_at(truth, each.from_s, each.to_s, each.inputs) for each in found}
    rows = [row for each in found for row in _manoeuvre_rows(each, known[each.n], truth, inputs)]
    return [*rows, _flight_row(summary, known)]


def _manoeuvre_rows(
    found: Manoeuvre, known: Known | None, truth: Truth, inputs: Sequence[str]
) -> Iterator[Row]:
    """Yield a manoeuvre's rows: of the stream's methods, its answer, and its bare airframe."""
    where: Row = {name: getattr(found, name) for name in ("n", "from_s", "to_s", "turn_removed")}
    where["inputs"] = "+".join(found.inputs)
    of_stream, of_bare = (true_at(truth, found.from_s, found.to_s, x) for x in (inputs, BARE))
    for method in METHODS:
        estimate = found.estimates.get(method)
        roll = None if estimate is None else estimate.dutch_roll
        yield where | {"kind": method} | judged_answer(roll, of_stream, found.verdict)
    own = {} if known is None else numbers_shown(found, float(known[0][0]))
    answer = judged_answer(found.dutch_roll, known, found.verdict)
    yield where | {"kind": "manoeuvre"} | answer | own
    if (bare := found.lateral) is not None:
        yield where | {"kind": "bare"} | judged_answer(bare.dutch_roll, of_bare, bare.verdict)


def _flight_row(summary: RunSummary, known: Mapping[int, Known | None]) -> Row:
    flight, verdict = summary.flight, summary.deciding
    if flight is None:
        return {"kind": "flight"} | judged_answer(None, None, verdict)
    used = [m for m in summary.manoeuvres or [] if m.n in flight.used or not flight.used]
    roll = flight.dutch_roll if verdict.usable else None
    of = _together(used, known, flight.airspeed_m_s)
    return {"kind": "flight"} | judged_answer(roll, of, verdict)


def _together(
    used: Sequence[Manoeuvre], known: Mapping[int, Known | None], at_speed: float | None
) -> Known | None:
    """Return the mean truth of manoeuvres and its sigma, from their sigmas and their scatter.

    wn is scaled to ``at_speed`` in m/s; with None it is not. The result is None if the truth of a
    manoeuvre is unknown.
    """
    truths = [one for each in used if (one := known[each.n]) is not None]
    if len(truths) < len(used):
        return None
    speeds = [at_speed / each.airspeed_m_s if at_speed and each.airspeed_m_s else 1.0
              for each in used]  # fmt: skip
    scales = np.column_stack([speeds, np.ones(len(used))])
    values, sigmas = (scales * [of[i] for of in truths] for i in (0, 1))
    squares = np.mean(np.square(sigmas), axis=0) + np.var(values, axis=0)
    return np.mean(values, axis=0), np.sqrt(squares)


def judged_answer(roll: DutchRoll | None, known: Known | None, verdict: Verdict) -> Row:
    """Return verdict, truth, estimate, error (wn's in %), sigmas and z; unknown ones are None.

    ``sigma_mean`` and ``z_mean`` are those of a flight's mean.
    """
    row: Row = {
        "usable": verdict.usable,
        "warnings": " ".join(r.id for r in verdict.reasons if r.weight == "warning"),
        "fatal": " ".join(r.id for r in verdict.fatal),
    }
    keys = ("wn", "wn_rad_s", "wn_error_pct"), ("zeta", "zeta", "zeta_error")
    for i, (name, key, error) in enumerate(keys):
        true, true_sigma = (None, None) if known is None else (float(x[i]) for x in known)
        value = None if roll is None else getattr(roll, key)
        off = None if value is None or true is None else value - true
        row |= {f"{name}_true": true, f"{name}_true_sigma": true_sigma, name: value}
        row[error] = 100.0 * off / true if off is not None and true and name == "wn" else off
        for end in ("", "_mean"):
            sigma = getattr(roll, f"{name}_std{end}", None)
            total = math.hypot(sigma or 0.0, true_sigma or 0.0)
            z = None if off is None or sigma is None or total == 0.0 else off / total
            row |= {f"{name}_sigma{end}": sigma, f"{name}_z{end}": z}
    return row


AT = (0.7, 1.0, 1.4)
"""The multiples of the true wn at which |G| is compared."""
BAND: Floats = np.linspace(0.6, 1.6, 21)
"""The multiples of wn at which eq. 23 is fitted to a response."""
SHOWN = (*(f"gain at {each:g} wn" for each in AT), "K", "yaw acceleration")
"""The names of the numbers."""


def gains(found: Manoeuvre, w: Floats) -> tuple[Floats, Floats]:
    """Return |G(jw)| of the rudder at w (k,) in rad/s, and its sigmas by the fit's covariance."""
    model = Answered.of(found)
    assert found.answer is not None
    assert found.answer.response is not None
    rudder, s = model.inputs.index("rudder"), np.asarray(1j * w, complex)

    def size(x: Floats) -> Floats:
        return np.asarray(np.abs(model.transfers(x[None])[rudder].at(s)[0]))

    changes = changes_of(size, model.x, np.array(found.answer.response.covariance))
    return size(model.x), np.linalg.norm(changes, axis=-1)


def numbers_shown(found: Manoeuvre, wn_rad_s: float) -> Row:
    """Return the numbers of SHOWN and their sigmas; nothing of an answer without a response."""
    answer = found.answer
    if answer is None or answer.response is None:
        return {}
    shown = [Value(*each) for each in np.transpose(gains(found, wn_rad_s * np.array(AT))).tolist()]
    shown += [(answer.physics or {})["K"], answer.yaw_acceleration or Value()]
    row = {name: of.value for name, of in zip(SHOWN, shown, strict=True)}
    return row | {f"{name}_sigma": of.std for name, of in zip(SHOWN, shown, strict=True)}


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
    knots = round(float(flown_kt(truth, row["from_s"], row["to_s"]).mean()), 1)
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
