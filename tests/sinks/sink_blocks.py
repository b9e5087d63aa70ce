"""Blocks for the tests of the sinks."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from typing import Any

import hand_flights
import msgspec
import numpy as np
from hand_flights import roll_of

from yawid.answers.heard import LinkCounts, VehicleSeen
from yawid.answers.model_parts import Fit
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import ChannelFound, Flight, Manoeuvre, RunSummary, Value
from yawid.blocks import EstimateBlock, Held, ModesBlock, SampleBlock, Status
from yawid.quantities.table import YAW_CHANNEL
from yawid.sinks.base import Flush, Found, Grid, LogLine, RunRows, Sink

PARAMETERS = ("a1", "a2", "b1", "b2", "c1", "bias")
METHODS = ("els", "rml")
ROWS = 60
START_NS = 1_700_000_000_000_000_000
SAMPLE_TIME_S = 0.05
VERDICT = Verdict(
    usable=False,
    reasons=[
        Reason("not_excited", "the rudder moves by less than 1 %", weight="fatal"),
        Reason("rudder_assumed", "servo 4 taken for the rudder", weight="warning"),
    ],
)
SUMMARY = RunSummary(
    log="/flights/a.tlog",
    sha256="ab" * 32,
    duration_s=1.0,
    vehicle=VehicleSeen(1, 1, 1, 3),
    link=LinkCounts(),
    channels={"rudder": ChannelFound("servo 4", reversed=True, rate_hz=50.0)},
    verdict=VERDICT,
)
FLIGHT = Flight(
    method="ct",
    airspeed_m_s=20.5,
    loop="airframe",
    dutch_roll=roll_of(10.1, 0.63, 0.15, 0.02, (0.02, 0.003)),
    physics={"K": Value(-1.5, 0.1)},
    used=[1, 3],
    disagree=[2],
    verdict=Verdict(method="ct", usable=True, reasons=[]),
)
GRID = Grid(PARAMETERS, ("rudder",), METHODS, SAMPLE_TIME_S, autopilot=3, vehicle_type=1)
Blocks = tuple[SampleBlock, dict[str, EstimateBlock], ModesBlock]


def make_samples(n: int, n_inputs: int, rng: np.random.Generator) -> SampleBlock:
    k = np.arange(n) + 100
    boot_us = (k * SAMPLE_TIME_S * 1e6).astype(np.int64)
    held = np.where(rng.random(n) < 0.2, Held.GAP | Held.RUDDER_INVALID, Held.NONE).astype(np.int64)
    u, y = rng.normal(size=(n, n_inputs)), rng.normal(size=n)
    u[held != 0], y[held != 0] = np.nan, np.nan
    return SampleBlock(
        sample_time_s=SAMPLE_TIME_S,
        k=k,
        boot_us=boot_us,
        unix_ns=START_NS + boot_us * 1000,
        received_us=START_NS // 1000 + boot_us + rng.integers(0, 40_000, n),
        u=u,
        y=y,
        yaw=np.cumsum(rng.normal(size=n)),
        roll=rng.normal(size=n),
        turn_rate=rng.normal(size=n),
        airspeed=rng.uniform(10.0, 30.0, n),
        noted=rng.integers(0, 16, n),
        held=held,
        epoch=np.arange(n) // 50,
        aileron=rng.normal(size=n),
        mode=np.full(n, 10.0),
        on_ground=rng.integers(0, 2, n).astype(float),
        altitude=rng.uniform(0.0, 500.0, n),
        rudder_moves=rng.integers(0, 2, n).astype(float),
        ground_speed=rng.uniform(10.0, 30.0, n),
        airspeed_kind=rng.integers(1, 5, n).astype(float),
    )


def make_estimate(samples: SampleBlock, p: int, rng: np.random.Generator) -> EstimateBlock:
    n = len(samples)
    status = np.where(samples.held != 0, Status.HELD, Status.TRACKING).astype(np.uint8)
    status[:3] = Status.WARMING_UP
    return EstimateBlock.of(
        theta=rng.normal(size=(n, p)),
        theta_std=rng.random((n, p)),
        covariance=None,
        y_hat=rng.normal(size=n),
        innovation=rng.normal(size=n),
        residual=rng.normal(size=n),
        noise_std=rng.random(n),
        status=status,
    )


def make_modes(n: int, na: int, rng: np.random.Generator) -> ModesBlock:
    dutch_roll = rng.random((n, 4))
    dutch_roll[:2] = np.nan
    return ModesBlock(
        poles=rng.normal(size=(n, na)) + 1j * rng.normal(size=(n, na)),
        wn=rng.random((n, na)),
        wn_std=rng.random((n, na)),
        zeta=rng.normal(size=(n, na)),
        zeta_std=rng.random((n, na)),
        dutch_roll=dutch_roll,
        yaw=rng.normal(size=(n, len(YAW_CHANNEL))),
        yaw_std=rng.random((n, len(YAW_CHANNEL))),
    )


def make_manoeuvre(
    samples: SampleBlock, first: int, last: int, n: int = 1
) -> tuple[Manoeuvre, tuple[int, int]]:
    """A usable manoeuvre of rows from one to the other; and its Unix times."""
    from_s, to_s = (float(samples.boot_us[row]) / 1e6 for row in (first, last))
    span_ns = int(samples.unix_ns[first]), int(samples.unix_ns[last])
    date = datetime.fromtimestamp(0, UTC) + timedelta(microseconds=span_ns[0] // 1000)
    ct = msgspec.structs.replace(
        hand_flights.by_ct(roll_of(10.2, 0.62, 0.2, 0.03, (0.05, 0.01))),
        physics={"K": Value(-1.5, 0.1, 0.04)},
        yaw_acceleration=Value(-40.0, 2.0, 1.0),
        fit=Fit(simulation_pct=87.0),
    )
    return hand_flights.manoeuvre(
        n,
        speed=21.5,
        from_s=from_s,
        to_s=to_s,
        duration_s=to_s - from_s,
        date=date.isoformat(timespec="seconds"),
        airspeed_std_m_s=0.5,
        airspeed_kind="equivalent",
        altitude_m=120.0,
        inputs=["rudder", "aileron"],
        turn_removed=True,
        estimates={"ct": ct},
        verdict=Verdict(method="ct", usable=True, reasons=VERDICT.reasons[1:]),
    ), span_ns


def unanswered(found: Manoeuvre) -> Manoeuvre:
    """The same where nothing could be estimated, in a log that knows of no airspeed."""
    verdict = Verdict(usable=False, reasons=VERDICT.reasons)
    nothing = {"mode": None, "airspeed_m_s": None, "altitude_m": None}
    nothing |= {"airspeed_source": None, "airspeed_kind": None}
    nothing |= {"airspeed_std_m_s": None}
    return msgspec.structs.replace(found, estimates={}, verdict=verdict, **nothing)


def make_blocks(n: int = 100, n_inputs: int = 1, p: int = len(PARAMETERS), na: int = 2) -> Blocks:
    rng = np.random.default_rng(20)
    samples = make_samples(n, n_inputs, rng)
    estimates = {method: make_estimate(samples, p, rng) for method in METHODS}
    return samples, estimates, make_modes(n, na, rng)


def rows_of(block: Any, rows: slice) -> Any:
    """The same rows of every column."""
    columns = {field.name: getattr(block, field.name) for field in fields(block)}
    return replace(block, **{k: v[rows] for k, v in columns.items() if isinstance(v, np.ndarray)})


def cut(blocks: Blocks, edges: list[int]) -> Iterator[Blocks]:
    """The same rows in blocks that end at the given edges."""
    samples, estimates, modes = blocks
    bounds = sorted({0, len(samples), *edges})
    for first, last in pairwise(bounds):
        rows = slice(first, last)
        yield (
            rows_of(samples, rows),
            {method: rows_of(estimate, rows) for method, estimate in estimates.items()},
            rows_of(modes, rows),
        )


def run(sink: Sink, blocks: Blocks, edges: list[int], known: int = ROWS) -> None:
    """Give a sink a run but for its end; two manoeuvres are reported at the row ``known``."""
    sink.take(LogLine(START_NS, "info", "before the grid is known"))
    sink.take(GRID)
    for block in cut(blocks, [known, *edges]):
        sink.take(RunRows(*block))
        sink.take(Flush())
        if block[0].k[-1] == blocks[0].k[known - 1]:
            for n, rows in enumerate([(10, 30), (31, 55)], start=1):
                sink.take(Found(*make_manoeuvre(blocks[0], *rows, n)))
    sink.take(LogLine(int(blocks[0].unix_ns[-1]), "warning", "the last line"))


def run_script(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a script in an interpreter of its own that sees what this one sees."""
    return subprocess.run(
        [sys.executable, "-c", script, *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
