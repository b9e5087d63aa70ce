"""Fleets as data sets: drawn by the judge of trends, or written row by row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from checks.judge_trend import Plan, draw_vehicles, flight
from data_sets import merge

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
    """Write rows of ``flights`` as a data set."""
    made_by = ("log_sha256", "yawid_version", "analysis_version", "config_hash")
    merge(
        folder,
        [
            {
                "logs": [
                    {"path": f"/{row['log_sha256']}", "outcome": "ok"}
                    | {name: row[name] for name in made_by}
                ],
                "flights": [row],
                "flights_by_loop": [row],
            }
            for row in rows
        ],
    )
