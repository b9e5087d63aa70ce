"""Runs whose manoeuvres have answers written by hand: transfer functions that are known exactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

import yawid
from yawid.answers.model_parts import Fit
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import (
    BetweenStd,
    DutchRoll,
    Flight,
    Manoeuvre,
    MethodSummary,
    Response,
)
from yawid.tables.run import Run

STEP_S, START_S = 0.05, 10.0
Pole = complex | float
USABLE = Verdict(method="ct", usable=True, reasons=[])


def numbers(poles: Sequence[Pole], residues: Sequence[Sequence[Pole]]) -> np.ndarray:
    """Return what the covariance of a response is of, in its order."""
    pairs = [p for p in poles if isinstance(p, complex)]
    found = [x for p in pairs for x in (abs(p), -p.real / abs(p))]
    found += [p for p in poles if not isinstance(p, complex)]
    for each in residues:
        found += [x for r in each if isinstance(r, complex) for x in (r.real, r.imag)]
        found += [r for r in each if not isinstance(r, complex)]
    return np.array(found, float)


def response(
    poles: Sequence[Pole], residues: Mapping[str, Sequence[Pole]], std: Any = 0.0
) -> Response:
    """Return the answer with a diagonal covariance of these sigmas, or with this one (p, p)."""
    n = len(numbers(poles, list(residues.values())))
    std = np.asarray(std, float)
    covariance = std if std.ndim == 2 else np.diag(np.broadcast_to(std, n) ** 2)

    def parts(values: Sequence[Pole]) -> list[list[float]]:
        return [[complex(x).real, complex(x).imag] for x in values]

    return Response(
        poles=parts(poles),
        residues={name: parts(each) for name, each in residues.items()},
        covariance=covariance.tolist(),
    )


def manoeuvre(
    n: int, of: Response | None, span_s: tuple[float, float] = (10.0, 60.0),
    speed: float | None = 20.0, noise: float = 0.6, **more: Any,
) -> Manoeuvre:  # fmt: skip
    """Return a usable manoeuvre with this answer, whose sigmas are those of the response.

    ``noise`` is the part of sigma that noise alone explains.
    """
    estimates = {}
    if of is not None:
        pole = complex(*of.poles[0])
        wn_std, zeta_std = np.sqrt(np.diag(of.covariance))[:2].tolist()
        roll = DutchRoll(
            wn_rad_s=abs(pole), wn_std=wn_std, wn_std_noise=noise * wn_std,
            zeta=-pole.real / abs(pole), zeta_std=zeta_std, zeta_std_noise=noise * zeta_std,
        )  # fmt: skip
        estimates["ct"] = MethodSummary(
            method="ct", sample_time_s=STEP_S, updates=900, held=0, dutch_roll=roll, response=of,
            structure="2", fit=Fit(simulation_pct=99.0),
        )  # fmt: skip
    given: dict[str, Any] = {
        "from_s": span_s[0], "to_s": span_s[1], "duration_s": span_s[1] - span_s[0],
        "loop": "airframe", "airspeed_m_s": speed, "airspeed_source": "airspeed",
        "inputs": ["rudder"] if of is None else list(of.residues), "turn_removed": False,
        "verdict": USABLE,
    }  # fmt: skip
    return Manoeuvre(n=n, estimates=estimates, **(given | more))


def flight(used: Sequence[Manoeuvre], wn: float, zeta: float, std: float = 0.02) -> Flight:
    """Return the flight of these manoeuvres, at 20 m/s; sigma is a part of wn, and that of zeta."""
    roll = DutchRoll(
        wn_rad_s=wn, wn_std=std * wn, wn_std_noise=0.0, wn_std_mean=std * wn, zeta=zeta,
        zeta_std=std, zeta_std_noise=0.0, zeta_std_mean=std,
    )  # fmt: skip
    return Flight(
        method="ct", airspeed_m_s=20.0, airspeed_source="airspeed", loop="airframe",
        dutch_roll=roll, between_std=BetweenStd(wn_rad_s=0.0, zeta=0.0),
        used=[each.n for each in used], disagree=[], verdict=USABLE,
    )  # fmt: skip


def run_of(
    columns: Mapping[str, np.ndarray], manoeuvres: Sequence[Manoeuvre], of: Flight | None = None
) -> Run:
    """Return the run of a record at 20 Hz, with these answers."""
    n = len(columns["rudder"])
    record = {"t": START_S + STEP_S * np.arange(n), "airspeed [m/s EAS]": np.full(n, 20.0)}
    options: dict[str, Any] = {"rudder_unit": "half-travel", "rudder_is": "commanded"}
    if "aileron" in columns:
        options["inputs"] = ("rudder", "aileron")
    run = yawid.replay(record | dict(columns), manoeuvres="off", **options)
    run.summary = replace(run.summary, manoeuvres=list(manoeuvres), flight=of)
    return run
