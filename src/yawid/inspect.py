"""Is this log usable? By which channels, at which rate, excited where; and if not, what to record.

The answer comes from a replay without outputs, and from looking at where the rudder moved on its
own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from yawid.blocks import Floats, SampleBlock
from yawid.collect import collect, run_through
from yawid.errors import ConfigError
from yawid.run_config import RunConfig
from yawid.summary import summarise
from yawid.verdict import Verdict

WINDOW_S = 5.0
LEAST_STROKE = 0.1
"""A window is excited where the rudder's stroke exceeds this part of half its travel."""
MIXED = 0.95
"""... and is not simply the aileron, mixed in: correlation below this."""
BRIDGE_S = 20.0
"""Excited windows this near belong to one stretch."""
SAMPLES_PER_PERIOD = 16.0
WORTH_PCT = 2.0
"""How many points of the simulated fit a further input must bring."""
BOTH = ("rudder", "aileron")
NICE_RATES_HZ = (5.0, 10.0, 20.0, 25.0, 40.0, 50.0, 100.0)


@dataclass(frozen=True, slots=True)
class Activity:
    """One window of five seconds: what moved in it, in units of half the travel."""

    from_s: float
    to_s: float
    stroke: float
    correlation: float

    @property
    def excited(self) -> bool:
        """Whether the rudder moved, and not as a copy of the aileron."""
        return self.stroke >= LEAST_STROKE and abs(self.correlation) < MIXED


def inspect(log: Path, config: RunConfig) -> tuple[dict[str, Any], Verdict]:
    """Return what a log can answer, as ``yawid inspect --json`` prints it, and its verdict.

    Raises:
        SourceError: the log cannot be read.
        ConfigError: what is asked for does not fit the log.
    """
    pipeline, sha256 = run_through(log, config)
    summary, verdict = summarise(pipeline, str(log.absolute()), sha256)
    excited = []
    if pipeline.bank is not None and pipeline.channels.surfaces:
        excited = stretches(activity(log, config))
    kept = ("log", "sha256", "duration_s", "vehicle", "link", "channels", "verdict")
    report = {key: summary[key] for key in kept if key in summary}
    report["senders"] = {f"{s}/{c}": n for (s, c), n in pipeline.link.senders.items()}
    report["excited"] = [{"from": a, "to": b} for a, b in excited]
    fatal = [r["id"] for r in summary["verdict"]["reasons"] if r["weight"] == "fatal"]
    unanswerable = [reason for reason in fatal if reason in _UNANSWERABLE]
    if unanswerable or not excited:
        reasons = unanswerable or ["not_excited"]
        report["recommend"] = {"record": [_ADVICE[reason] for reason in reasons]}
    else:
        turning = {"turn": "remove", "band": "0.15,3"} if "turn_dominated" in fatal else {}
        longest = max(excited, key=lambda stretch: stretch[1] - stretch[0])
        report["recommend"] = recommend(log, config, longest) | turning
    return report, verdict


def activity(log: Path, config: RunConfig) -> list[Activity]:
    """Return the windows of a log in which it flew, with the aileron beside the rudder if known."""
    blocks = _samples(log, replace(config, inputs=BOTH))
    if not blocks:
        blocks = _samples(log, replace(config, inputs=("rudder",)))
    if not blocks:
        return []
    t = np.concatenate([block.boot_us for block in blocks]) / 1e6
    u = np.concatenate([block.u for block in blocks])
    segment = np.cumsum(np.diff(t, prepend=t[0]) < 0.0)
    window = np.floor(t / WINDOW_S).astype(int)
    edges = np.flatnonzero((np.diff(window) != 0) | (np.diff(segment) != 0)) + 1
    least = 0.8 * WINDOW_S / blocks[0].sample_time_s
    return [
        _activity(times, rows)
        for times, rows in zip(np.split(t, edges), np.split(u, edges), strict=True)
        if np.isfinite(rows).all(axis=1).sum() >= least
    ]


def _samples(log: Path, config: RunConfig) -> list[SampleBlock]:
    try:
        return collect(log, config)
    except ConfigError:
        # Rudder and aileron from different messages: then the rudder is looked at alone.
        return []


def _activity(t: Floats, u: Floats) -> Activity:
    rows = u[np.isfinite(u).all(axis=1)]
    low, high = np.percentile(rows[:, 0], [2.0, 98.0])
    correlation = 0.0
    if rows.shape[1] > 1 and (rows.std(axis=0) > 1e-6).all():
        correlation = float(np.corrcoef(rows[:, 0], rows[:, 1])[0, 1])
    return Activity(float(t[0]), float(t[-1]), float(high - low), correlation)


def stretches(windows: list[Activity]) -> list[tuple[float, float]]:
    """Return the stretches (from, to) in boot seconds that are excited, near ones joined."""
    found: list[tuple[float, float]] = []
    for window in windows:
        if not window.excited:
            continue
        if found and 0.0 <= window.from_s - found[-1][1] < BRIDGE_S:
            found[-1] = (found[-1][0], window.to_s)
        else:
            found.append((window.from_s, window.to_s))
    return [(round(a, 1), round(b, 1)) for a, b in found]


def recommend(log: Path, config: RunConfig, stretch: tuple[float, float]) -> dict[str, Any]:
    """Return the options to replay an excited stretch with, tried out on it.

    The rate gives about sixteen samples per Dutch-roll period; the aileron is an input where it
    tells the yaw rate noticeably better than the rudder alone.
    """
    low, high = stretch
    kept = replace(
        config, method="rml", also="none", memory=None, forgetting=1.0, from_s=low, to_s=high
    )
    alone, both = (_trial(log, replace(kept, inputs=i)) for i in (("rudder",), BOTH))
    with_aileron = _fit(both) > _fit(alone) + WORTH_PCT
    rate = _rate(both if with_aileron else alone)
    inputs = ",".join(BOTH if with_aileron else ("rudder",))
    chosen = {"from": low, "to": high, "rate": rate, "orders": "3,3,2,1"}
    return chosen | {"inputs": inputs, "forgetting": 1.0}


def _trial(log: Path, config: RunConfig) -> dict[str, Any]:
    """Return the summary of a replay without outputs; empty where the channels do not fit."""
    try:
        return summarise(run_through(log, config)[0], "", "")[0]
    except ConfigError:
        return {}


def _fit(summary: dict[str, Any]) -> float:
    fit = summary.get("estimates", {}).get("rml", {}).get("fit", {})
    return float(fit.get("simulation_pct", -np.inf))


def _rate(summary: dict[str, Any]) -> float:
    """Return the nice rate nearest to sixteen samples per period, no more than the log has."""
    channels = summary["channels"]
    own = min(channels[name]["rate_hz"] for name in channels)
    wn = summary["estimates"]["rml"].get("dutch_roll", {}).get("wn_rad_s", 0.0)
    target = max(SAMPLES_PER_PERIOD * wn / (2.0 * np.pi), 10.0)
    allowed = [rate for rate in NICE_RATES_HZ if rate <= own * 1.02]
    if not allowed:
        return float(f"{own:.3g}")
    return min(allowed, key=lambda rate: abs(rate - target))


_UNANSWERABLE = ("no_vehicle", "no_rudder", "no_yaw", "rate_too_low")
_ADVICE = {
    "no_vehicle": "record the vehicle's own HEARTBEAT: log on the link to the aircraft itself",
    "no_rudder": (
        "record SERVO_OUTPUT_RAW and download the parameters on the same link; if the rudder is "
        "known, name it: --rudder servo:N"
    ),
    "no_yaw": "ask for ATTITUDE (id 30) at 25 Hz or more",
    "rate_too_low": (
        "ask for ATTITUDE (30) and SERVO_OUTPUT_RAW (36) at 25 Hz or more: on ArduPilot "
        "SRn_EXTRA1 = 25 and SRn_RC_CHAN = 25 (from 4.7 on MAVn_EXTRA1, MAVn_RC_CHAN), or "
        "MAV_CMD_SET_MESSAGE_INTERVAL with 40000 us (at most 0.8 of the loop rate is sent); on "
        "PX4 mavlink stream -r 50"
    ),
    "not_excited": (
        "fly wings level at a steady airspeed with the rudder doubled left and right: a 3-2-1-1 "
        "whose 2 lasts half a Dutch-roll period, or doublets, ten of them, 10 to 30 % of travel"
    ),
}
