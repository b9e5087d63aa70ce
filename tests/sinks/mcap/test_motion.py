"""The lateral motion in a run's file: what was written is read back to the bit."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from flightlog import fly
from mcap.reader import make_reader

from yawid.blocks import MotionBlock, SampleBlock
from yawid.channels.stage import WANTED
from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.results.summary import summarise
from yawid.runs.finished_run import FinishedRun
from yawid.runs.job import feed_all
from yawid.runs.outputs import Outputs, finish, open_mcap, parameters_of
from yawid.sinks.base import Event, Sink
from yawid.sinks.mcap.reader import open_run
from yawid.sinks.mcap.schemas import MOTION
from yawid.sources.logs.tlog import TlogReader
from yawid.sources.mavlink.decoder import Decoder

DATA = fly(lambda t: np.sin(t), lambda t: 1500 + round(100 * np.sin(2 * t)), 30.0).data


class KeptMotion(Sink):
    def __init__(self) -> None:
        self.blocks: list[MotionBlock] = []

    def take(self, event: Event) -> None:
        if isinstance(event, MotionBlock):
            self.blocks.append(event)


def written(folder: Path, lateral: str | None, size: int = len(DATA)) -> tuple[Path, KeptMotion]:
    """Write the run's file of a log read in pieces of ``size`` bytes."""
    config, outputs = RunConfig(lateral=lateral), Outputs(folder, "run", force=True)
    kept = KeptMotion()
    pipeline = Pipeline(config, [open_mcap(config, outputs), kept])
    source = TlogReader([DATA[at : at + size] for at in range(0, len(DATA), size)], Decoder(WANTED))
    feed_all(source, pipeline)
    summary = summarise(pipeline, source.link, "log.tlog", "")
    finish(pipeline, summary, outputs.files(), parameters_of(pipeline))
    return folder / "run.mcap", kept


def equal(a: MotionBlock, b: MotionBlock) -> bool:
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in fields(MotionBlock)]
    return all(
        np.array_equal(getattr(one, name), getattr(two, name), equal_nan=name == "values")
        for one, two in pairs
        for name in one.__slots__
    )


def topics(path: Path) -> dict[str, int]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        counts = summary.statistics.channel_message_counts
        return {channel.topic: counts.get(i, 0) for i, channel in summary.channels.items()}


@pytest.mark.parametrize("size", [len(DATA), 4096])
def test_motion_is_read_back_to_the_bit_and_before_the_samples_it_is_for(tmp_path, size: int):
    path, kept = written(tmp_path, "auto", size)

    read = list(open_run(path).samples_and_motion())

    motion = MotionBlock.joined([each for each in read if isinstance(each, MotionBlock)])
    assert equal(motion, MotionBlock.joined(kept.blocks))
    assert (len(motion.attitude), len(motion.commands)) == (1499, 1500)
    known_us = 0
    for each in read:
        if isinstance(each, MotionBlock) and len(each.commands):
            known_us = int(each.commands.t_us[-1])
        elif isinstance(each, SampleBlock):
            assert each.boot_us[-1] + 20_000 <= known_us


def test_a_file_has_the_topics_only_where_they_were_asked_for(tmp_path: Path):
    off, _ = written(tmp_path / "off", None)
    on, _ = written(tmp_path / "on", "auto")

    assert not set(MOTION) & topics(off).keys()
    assert topics(on)[MOTION[0]] == 1499
    assert not open_run(off).has_motion
    assert open_run(on).has_motion


def test_each_chunk_of_a_file_with_motion_is_some_seconds_long_at_most(tmp_path: Path):
    path, _ = written(tmp_path, "auto")

    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    spans = [c.message_end_time - c.message_start_time for c in summary.chunk_indexes]
    assert max(spans) < 2.5e9
    assert len(spans) < 2 * 30


def test_a_file_without_motion_asks_for_the_log(tmp_path: Path):
    off, _ = written(tmp_path / "off", None)
    on, _ = written(tmp_path / "on", "auto")

    without, has = FinishedRun(off), FinishedRun(on)
    for run in (without, has):
        run.settled({"lateral": "auto"})

    said = [f"{off} holds no lateral motion: for that, replay the log itself"]
    assert without.left_open(Pipeline(RunConfig())) == said
    assert has.left_open(Pipeline(RunConfig())) == []
