"""Makes tlogs of real MAVLink frames from what a vehicle did, and replays them."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.answers.run_summary import RunSummary
from yawid.blocks import SampleBlock
from yawid.channels.stage import WANTED, Channels
from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.results.summary import summarise
from yawid.runs.job import feed_all, open_log
from yawid.sinks.base import Sink
from yawid.sources.logs.tlog import TlogReader
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.open_log import Log, ReadOptions

START_US = 1_700_000_000_000_000


@dataclass
class FlightLog:
    """A log to which frames are appended with their receive stamps; ``data`` is the tlog."""

    sysid: int = 1
    compid: int = 1
    data: bytes = b""
    latency_us: int = 3_000
    _sequence: dict[tuple[int, int], int] = field(default_factory=dict)

    def add(self, t_s: float, message: Any, sender: tuple[int, int] | None = None) -> None:
        """Append a message sent at ``t_s`` of the vehicle's clock and received a little later."""
        sysid, compid = sender or (self.sysid, self.compid)
        link = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
        link.seq = self._sequence.get((sysid, compid), 0)
        self._sequence[sysid, compid] = (link.seq + 1) % 256
        stamp = START_US + round(1e6 * t_s) + self.latency_us
        self.data += struct.pack(">Q", stamp) + message.pack(link)

    def heartbeat(
        self, t_s: float, kind: int = 1, autopilot: int = 3, sender: tuple[int, int] | None = None
    ) -> None:
        self.add(t_s, mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3), sender)

    def parameter(self, t_s: float, name: str, value: float, count: int = 1) -> None:
        message = mavlink.MAVLink_param_value_message(name.encode(), value, 9, count, 0)
        self.add(t_s, message)

    def attitude(self, t_s: float, rate: float, yaw: float = 0.0, roll: float = 0.0) -> None:
        wrapped = (yaw + np.pi) % (2.0 * np.pi) - np.pi
        message = mavlink.MAVLink_attitude_message(
            round(1000 * t_s) % 2**32, roll, 0.0, wrapped, 0.0, 0.0, rate
        )
        self.add(t_s, message)

    def servos(self, t_s: float, pwm: Sequence[int]) -> None:
        eight = [*pwm, *([0] * (8 - len(pwm)))]
        stamp = round(1e6 * t_s) % 2**32
        self.add(t_s, mavlink.MAVLink_servo_output_raw_message(stamp, 0, *eight))


def fly(
    rate: Callable[[float], float],
    pwm: Callable[[float], int],
    seconds: float,
    *,
    start_s: float = 10.0,
    attitude_s: float = 0.02,
    servo_s: float = 0.02,
    skip: Callable[[float], bool] = lambda t: False,
) -> FlightLog:
    """Return the log of a flight: yaw rate and rudder (servo 4) by the time since ``start_s``."""
    log = FlightLog()
    log.heartbeat(start_s)
    attitude = [(start_s + attitude_s * i, 0) for i in range(round(seconds / attitude_s))]
    servos = [(start_s + servo_s * i + 0.004, 1) for i in range(round(seconds / servo_s))]
    for t, kind in sorted(attitude + servos):
        if skip(t - start_s):
            continue
        if kind == 0:
            log.attitude(t, rate(t - start_s))
        else:
            log.servos(t, [1500, 1500, 1500, pwm(t - start_s)])
    return log


def samples_of(data: bytes, config: RunConfig | None = None, cuts: Sequence[int] = ()) -> Samples:
    """Run a log through decoder and channels, cut into pieces at the bytes ``cuts``."""
    decoder, channels = Decoder(WANTED), Channels(config or RunConfig())
    blocks: list[SampleBlock] = []
    edges = [0, *sorted(cuts), len(data)]
    for low, high in itertools.pairwise(edges):
        frames = decoder.feed(data[low:high])
        if frames is not None:
            blocks += channels.feed_frames(frames)
    frames = decoder.finish()
    if frames is not None:
        blocks += channels.feed_frames(frames)
    blocks += channels.finish()
    return Samples(channels, blocks)


def summary_of(data: bytes, config: RunConfig | None = None) -> dict[str, Any]:
    """Replay a log in one piece; return the object that ``--json`` prints.

    Without a configuration, no manoeuvres are searched for: that takes most of the time.
    """
    return finished(data, config or RunConfig(manoeuvres="off")).to_json()


def finished(
    data: bytes,
    config: RunConfig | None = None,
    *,
    size: int = 0,
    options: ReadOptions | None = None,
    sinks: Sequence[Sink] = (),
) -> RunSummary:
    """Replay a log in pieces of ``size`` bytes (0: in one piece); return its summary."""
    pieces = [data[at : at + (size or len(data))] for at in range(0, len(data), size or len(data))]
    source, pipeline = (
        TlogReader(pieces, (options or ReadOptions()).decoder(WANTED)),
        Pipeline(config or RunConfig(), sinks),
    )
    feed_all(source, pipeline)
    return summarise(pipeline, source.link, "log.tlog", "")


def run_through(path: Path, config: RunConfig) -> tuple[Pipeline, Log]:
    """Run a whole log through a pipeline without sinks; return both."""
    source, pipeline = open_log(path), Pipeline(config)
    feed_all(source, pipeline)
    return pipeline, source


def summarised(path: Path, config: RunConfig) -> RunSummary:
    """Return the summary of a log."""
    pipeline, source = run_through(path, config)
    return summarise(pipeline, source.link, "", "")


def reasons_of(summary: dict[str, Any]) -> list[dict[str, str]]:
    """Return the reasons of a summary: of its verdict, or of a log that is not judged."""
    found = summary["verdict"]["reasons"] if "verdict" in summary else summary.get("warnings", [])
    return list(found)


def reason_ids(summary: dict[str, Any]) -> set[str]:
    """Return the ids of a summary's reasons."""
    return {reason["id"] for reason in reasons_of(summary)}


@dataclass
class Samples:
    """The channels after a run, and all its samples, each column joined over the blocks."""

    channels: Channels
    blocks: list[SampleBlock]

    def __getattr__(self, name: str) -> Any:
        return np.concatenate([getattr(block, name) for block in self.blocks])

    def __len__(self) -> int:
        return sum(len(block) for block in self.blocks)
