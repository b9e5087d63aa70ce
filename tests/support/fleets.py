"""Fleets as data sets: drawn by the judge of trends, or written row by row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from checks.judge_trend import Plan, draw_vehicles, flight
from data_sets import MADE_BY, merge

STDS = {"kappa_rad_m": "kappa_std", "zeta": "zeta_std", "K_per_V": "K_per_V_std"}
FALLS = "sysid:7"


def draw_fleet(seed: int, plan: Plan) -> list[dict[str, Any]]:
    """Return a fleet's rows of ``flights``; FALLS is the vehicle whose zeta falls, if one does."""
    rows = []
    for sysid, tracks in enumerate(draw_vehicles(np.random.default_rng(seed), plan), start=1):
        for i, date in enumerate(tracks["zeta"].dates):
            row = {name: float(track.value[i]) for name, track in tracks.items()}
            row |= {STDS[name]: float(track.sigma[i]) for name, track in tracks.items()}
            rows.append(flight(sysid, i, int(date), **row))
    return rows


def write_fleet(folder: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows of ``flights`` as a data set, in the one transaction of one log."""
    log = {"path": "/all", "log_sha256": "all", "outcome": "ok"} | MADE_BY
    flights = {name: list(rows) for name in ("flights", "flights_by_loop")}
    merge(folder, [{"logs": [log]} | flights] if rows else [])
