"""Makes tlogs of real MAVLink frames from what a vehicle did, and replays them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from flights.surgery import Encoder, Record, join
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.answers.run_summary import RunSummary
from yawid.blocks import FrameBlock, MotionBlock, SampleBlock
from yawid.channels.stage import WANTED, Channels
from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.results.summary import summarise
from yawid.runs.job import feed_all, open_log
from yawid.sinks.base import Sink
from yawid.sources.logs.tlog import TlogReader
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.open_log import Log, ReadOptions

START_US, LATENCY_US = 1_700_000_000_000_000, 3_000


@dataclass
class FlightLog:
    """A log to which frames are appended with their receive stamps; ``data`` is the tlog."""

    sysid: int = 1
    records: list[Record] = field(default_factory=list)
    _encoder: Encoder = field(default_factory=Encoder)

    @property
    def data(self) -> bytes:
        return join(self.records)

    def add(self, t_s: float, message: Any, sender: tuple[int, int] | None = None) -> None:
        """Append a message sent at ``t_s`` of the vehicle's clock and received a little later."""
        stamp = START_US + round(1e6 * t_s) + LATENCY_US
        self.records.append((stamp, self._encoder.frame(message, sender or (self.sysid, 1))))

    def heartbeat(
        self, t_s: float, kind: int = 1, autopilot: int = 3, sender: tuple[int, int] | None = None
    ) -> None:
        self.add(t_s, beat(kind, autopilot), sender)

    def parameter(self, t_s: float, name: str, value: float, count: int = 1) -> None:
        self.add(t_s, told(name, value, count))

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


def beat(kind: int = 1, autopilot: int = 3, base_mode: int = 0, mode: int = 0) -> Any:
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, base_mode, mode, 4, 3)


def hud(airspeed: float, over_ground: float, altitude: float = 100.0) -> Any:
    return mavlink.MAVLink_vfr_hud_message(airspeed, over_ground, 0, 50, altitude, 0.0)


def told(name: str, value: float, count: int = 1) -> Any:
    """Return the message that has a parameter's value, one of ``count`` parameters."""
    return mavlink.MAVLink_param_value_message(name.encode(), value, 9, count, 0)


def every(
    step_s: float, seconds: float, message: Callable[[float], Any]
) -> list[tuple[float, Any]]:
    """Return a message of each time, from 0 on."""
    return [(step_s * i, message(step_s * i)) for i in range(round(seconds / step_s))]


def fly(
    rate: Callable[[float], float],
    pwm: Callable[[float], int | Sequence[int]],
    seconds: float,
    *,
    start_s: float = 10.0,
    attitude_s: float = 0.02,
    servo_s: float = 0.02,
    skip: Callable[[float], bool] = lambda t: False,
    roll: Callable[[float], float] = lambda t: 0.0,
    yaw: Callable[[float], float] = lambda t: 0.0,
    vehicle: Any = None,
    more: Iterable[tuple[float, Any]] = (),
) -> FlightLog:
    """Return the log of a flight: yaw rate and rudder (servo 4) by the time since ``start_s``.

    ``pwm`` may give all outputs. ``vehicle`` is its HEARTBEAT, ``more`` has other messages, each
    with its time since ``start_s``.
    """
    log = FlightLog()
    log.add(start_s, vehicle or beat())
    events: list[tuple[float, int, Any]] = [(start_s + t, -1, message) for t, message in more]
    events += [(start_s + attitude_s * i, 0, None) for i in range(round(seconds / attitude_s))]
    events += [(start_s + servo_s * i + 0.004, 1, None) for i in range(round(seconds / servo_s))]
    for t, kind, message in sorted(events, key=lambda event: event[:2]):
        if kind < 0:
            log.add(t, message)
        elif skip(t - start_s):
            continue
        elif kind == 0:
            log.attitude(t, rate(t - start_s), yaw(t - start_s), roll(t - start_s))
        else:
            outputs = pwm(t - start_s)
            log.servos(t, [1500, 1500, 1500, outputs] if isinstance(outputs, int) else outputs)
    return log


def samples_of(data: bytes, config: RunConfig | None = None, cuts: Sequence[int] = ()) -> Samples:
    """Run a log through decoder and channels, cut into pieces at the bytes ``cuts``."""
    decoder = Decoder(WANTED)
    pieces = (data[low:high] for low, high in itertools.pairwise([0, *sorted(cuts), len(data)]))
    frames = itertools.chain(map(decoder.feed, pieces), map(Decoder.finish, [decoder]))
    return samples_from(frames, config)


def samples_from(frames: Iterable[FrameBlock | None], config: RunConfig | None = None) -> Samples:
    """Run decoded frames through the channels."""
    channels = Channels(config or RunConfig())
    blocks: list[SampleBlock] = []
    motion: list[MotionBlock | None] = []
    for each in frames:
        if each is not None:
            blocks += channels.feed_frames(each)
        motion.append(channels.motion())
    blocks += channels.finish()
    return Samples(channels, blocks, [each for each in (*motion, channels.motion()) if each])


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
    """The channels after a run, its lateral motion if that was asked for, and all its samples.

    Each column is joined over the blocks.
    """

    channels: Channels
    blocks: list[SampleBlock]
    motion: list[MotionBlock] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        return np.concatenate([getattr(block, name) for block in self.blocks])

    def __len__(self) -> int:
        return sum(len(block) for block in self.blocks)
