"""The answer of an ordinary flight from a log or a finished run, by the product's own reading."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from yawid.answers.ordinary import OrdinaryAnswer
from yawid.blocks import EstimateBlock, ModesBlock, MotionBlock, SampleBlock
from yawid.ordinary import Ordinary, answer_of
from yawid.runs.job import open_log, run
from yawid.sinks.base import Sink


class OrdinarySink(Sink):
    """A sink that gives the samples and the motion to an ordinary flight."""

    def __init__(self, travel_unit: float) -> None:
        self.flight = Ordinary(travel_unit)

    def motion(self, block: MotionBlock) -> None:
        """See :class:`Sink`."""
        self.flight.move(block)

    def write(
        self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock], modes: ModesBlock
    ) -> None:
        """See :class:`Sink`."""
        self.flight.feed(samples)


def ordinary_of_log(path: Path, **settings: Any) -> OrdinaryAnswer:
    """Return what a log answers as an ordinary flight; ``settings`` are those of RunConfig.

    Raises:
        SourceError: the log cannot be read.
        ConfigError: a setting does not fit the log.
    """
    source = open_log(path)
    config = source.settled({"manoeuvres": "off", "lateral": "auto", **settings})
    sink = OrdinarySink(config.half_travel)
    run(source, config, [sink])
    sink.flight.finish()
    return answer_of(sink.flight)
