"""Is this log usable? By which channels, at which rate, excited where; and if not, what to record.

The answer comes from a replay without outputs, and from looking at where the rudder moved on its
own.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from yawid.advice import what_to_record
from yawid.blocks import Floats, SampleBlock
from yawid.channels.decimate import RATE_SLACK
from yawid.channels.survey import AIRBORNE, GROUNDED, Intervals, Phase, Survey
from yawid.channels.vehicle import FIXED_WING, GENERIC, Vehicle
from yawid.collect import collect, run_through
from yawid.errors import ConfigError
from yawid.results.reasons import Verdict
from yawid.run_config import RunConfig
from yawid.sources.flight_modes import mode_name
from yawid.sources.reading import Reading
from yawid.sources.senders import SenderStats
from yawid.summary import as_summary, summarise
from yawid.verdict import LEAST_RATE_HZ

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
NOBODY = frozenset({"no_vehicle", "no_rudder", "no_yaw"})
UNANSWERABLE = NOBODY | {"rate_too_low"}
"""Reasons that no other option of a replay can mend."""
WORTH_SAYING = frozenset({"collinear_inputs", "rudder_assumed"})
"""Other reasons that the next recording can do away with."""
LEAST_PER_PERIOD, GOOD_PER_PERIOD = 4.0, 10.0
"""Messages per period of the Dutch roll: fewer than the first are no answer, the second is well."""
STATES = {AIRBORNE: "airborne", GROUNDED: "on ground"}
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


def inspect(
    log: Path, config: RunConfig, reading: Reading | None = None
) -> tuple[dict[str, Any], Verdict]:
    """Return what a log can answer, as ``yawid inspect --json`` prints it, and its verdict.

    The verdict is that of the stretch recommended where that is usable, else of the whole log.

    Raises:
        SourceError: the log cannot be read.
        ConfigError: what is asked for does not fit the log.
    """
    reading, survey = reading or Reading(), Survey()
    pipeline, sha256 = run_through(log, config, reading=reading, watch=survey.note)
    summary, verdict = summarise(pipeline, str(log.absolute()), sha256)
    excited = []
    if pipeline.bank is not None and pipeline.channels.surfaces:
        excited = stretches(activity(log, config, reading))
    kept = ("log", "sha256", "duration_s", "vehicle", "link", "channels")
    report = {key: summary[key] for key in kept if key in summary}
    link = pipeline.link
    report["senders"] = {f"{s}/{c}": n for (s, c), n in link.senders.items()}
    counted = {key: SenderStats(frames) for key, frames in link.senders.items()} | dict(
        link.by_sender
    )
    report["by_sender"] = {f"{s}/{c}": asdict(n) for (s, c), n in counted.items()}
    if link.signed:
        report["link"]["signed"] = link.signed
    if (said := reading.unchecked(link)) is not None:
        report["unchecked"] = said
    report |= flown(survey, pipeline.channels.lock.vehicle)
    report["excited"] = [{"from": a, "to": b} for a, b in excited]
    ids = [reason.id for reason in verdict.reasons]
    is_answerable = bool(excited) and not UNANSWERABLE.intersection(ids)
    advised = [i for i in ids if i in UNANSWERABLE or i in WORTH_SAYING]
    if not excited and not NOBODY.intersection(ids):
        advised.append("not_excited")
    report["recommend"] = {}
    if is_answerable:
        longest = max(excited, key=lambda stretch: stretch[1] - stretch[0])
        later_hz = min(each["rate_hz"] for each in report["rates"].values())
        options, tried = recommend(log, config, reading, longest, later_hz)
        if tried.usable:  # a flight that ends in a turn is no worse for it
            verdict = tried
        turns = any(reason.id == "turn_dominated" for reason in verdict.reasons)
        report["recommend"] = options | ({"turn": "remove", "band": "0.15,3"} if turns else {})
    if record := what_to_record(advised, pipeline.channels):
        report["recommend"]["record"] = record
    report["verdict"] = as_summary(verdict)
    return report, verdict


def flown(survey: Survey, vehicle: Vehicle | None) -> dict[str, Any]:
    """Return message rates with their jitter, what they can answer, and the phases of the flight.

    Intervals and rates are on the vehicle's clock; ``from`` and ``to`` in seconds since boot.
    """
    named = zip(("yaw", "rudder"), survey.intervals(), strict=True)
    rates = {name: _rate_and_jitter(found) for name, found in named if found is not None}
    told: dict[str, Any] = {"rates": rates}
    slowest_hz = min((each["rate_hz"] for each in rates.values()), default=0.0)
    if len(rates) == 2 and slowest_hz >= LEAST_RATE_HZ * RATE_SLACK:
        told["answerable"] = {
            "wn_max_rad_s": 2.0 * np.pi * slowest_hz / LEAST_PER_PERIOD,
            "wn_well_rad_s": 2.0 * np.pi * slowest_hz / GOOD_PER_PERIOD,
        }
    if vehicle is not None:
        told["phases"] = [_phase(phase, vehicle) for phase in survey.phases]
    return told


def _rate_and_jitter(found: Intervals) -> dict[str, float]:
    names = ("median_s", "p5_s", "p95_s")
    intervals = {f"interval_{name}": float(getattr(found, name)) for name in names}
    return {"messages": found.messages, "rate_hz": found.rate_hz} | intervals


def _phase(phase: Phase, vehicle: Vehicle) -> dict[str, Any]:
    """Describe a phase; what hovers may be slow without standing on the ground."""
    told: dict[str, Any] = {
        "boot": phase.boot,
        "from": phase.from_us / 1e6,
        "to": phase.to_us / 1e6,
    }
    mode = ""
    if phase.mode >= 0:
        told["mode"] = mode = mode_name(vehicle.autopilot, vehicle.type, phase.mode)
    state = STATES.get(phase.state)
    hovers = vehicle.type not in (GENERIC, FIXED_WING) or mode.startswith("Q")
    if state is not None:
        told["state"] = "slow" if hovers and phase.state == GROUNDED else state
    return told


def activity(log: Path, config: RunConfig, reading: Reading) -> list[Activity]:
    """Return the windows of a log in which it flew, with the aileron beside the rudder if known."""
    blocks = _samples(log, replace(config, inputs=BOTH), reading)
    if not blocks:
        blocks = _samples(log, replace(config, inputs=("rudder",)), reading)
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


def _samples(log: Path, config: RunConfig, reading: Reading) -> list[SampleBlock]:
    try:
        return collect(log, config, reading)
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


def recommend(
    log: Path, config: RunConfig, reading: Reading, stretch: tuple[float, float], later_hz: float
) -> tuple[dict[str, Any], Verdict]:
    """Return the options to replay an excited stretch with, and the verdict of trying it.

    The rate gives about sixteen samples per Dutch-roll period, and no more than ``later_hz``, what
    the slower message has over the whole log; the aileron is an input where it tells the yaw rate
    noticeably better than the rudder alone.
    """
    low, high = stretch
    kept = replace(
        config, method="rml", also="none", memory=None, forgetting=1.0, from_s=low, to_s=high
    )
    alone = _trial(log, replace(kept, inputs=("rudder",)), reading)
    both = alone
    with suppress(ConfigError):  # no aileron, or in another message
        both = _trial(log, replace(kept, inputs=BOTH), reading)
    with_aileron = _fit(both[0]) > _fit(alone[0]) + WORTH_PCT
    summary, verdict = both if with_aileron else alone
    inputs = ",".join(BOTH if with_aileron else ("rudder",))
    chosen = {"from": low, "to": high, "rate": _rate(summary, later_hz), "orders": "3,3,2,1"}
    return chosen | {"inputs": inputs, "forgetting": 1.0}, verdict


def _trial(log: Path, config: RunConfig, reading: Reading) -> tuple[dict[str, Any], Verdict]:
    """Return the summary and verdict of a replay without outputs.

    Raises:
        ConfigError: the channels do not fit.
    """
    return summarise(run_through(log, config, reading=reading)[0], "", "")


def _fit(summary: dict[str, Any]) -> float:
    fit = summary.get("estimates", {}).get("rml", {}).get("fit", {})
    return float(fit.get("simulation_pct", -np.inf))


def _rate(summary: dict[str, Any], later_hz: float) -> float:
    """Return the nice rate nearest to sixteen samples per period, no more than the log has."""
    channels = summary["channels"]
    own = min(later_hz, *(channels[name]["rate_hz"] for name in channels))
    wn = summary["estimates"]["rml"].get("dutch_roll", {}).get("wn_rad_s", 0.0)
    target = max(SAMPLES_PER_PERIOD * wn / (2.0 * np.pi), 10.0)
    allowed = [rate for rate in NICE_RATES_HZ if rate <= own * 1.02]
    if not allowed:
        return float(f"{own:.3g}")
    return min(allowed, key=lambda rate: abs(rate - target))
