"""A run's file that was cut off or damaged: the seconds before its first bad record."""

import json
from pathlib import Path
from typing import Any

from mcap.records import Metadata
from yawid.answers.heard import LinkCounts
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import RunSummary
from yawid.config.run import RunConfig
from yawid.config.settings import check_settings
from yawid.errors import SourceError
from yawid.sinks.mcap.reader import McapRun, read_grid
from yawid.sinks.mcap.records import intact, opened
from yawid.sinks.mcap.schemas import MOTION, SAMPLE


def open_torn(path: Path, why: SourceError) -> McapRun:
    """Return what a file that cannot be read as a whole has, without a judgement of its link.

    Raises:
        SourceError: ``why`` it cannot be read, where no sample comes before the first bad record.
    """
    metadata: dict[str, dict[str, str]] = {}
    topics: set[str] = set()
    times_ns: list[int] = []
    with opened(path) as stream:
        for found in intact(stream):
            if isinstance(found, Metadata):
                metadata.setdefault(found.name, found.metadata)
                continue
            topics |= {channel.topic for _, channel, _ in found}
            times_ns += [m.log_time for _, channel, m in found if channel.topic == SAMPLE]
    try:
        texts = {name: _value(text) for name, text in metadata["configuration"].items()}
        given = {name: value for name, value in texts.items() if value is not None}
        config = RunConfig(**check_settings(given, "configuration"))
        grid = read_grid(metadata.get("grid"), config)
    except (ValueError, OverflowError, RecursionError, KeyError, TypeError):
        raise why from None
    if not times_ns:
        raise why
    rows, seconds = len(times_ns), (times_ns[-1] - times_ns[0]) / 1e9
    said = (
        f"{path.name} was cut off or is damaged: it has {rows} samples, {seconds:.1f} s, and its "
        "link was not judged: replay the log itself for an answer"
    )
    summary = RunSummary(
        log=str(path.absolute()),
        duration_s=seconds,
        link=LinkCounts(),
        channels={},
        verdict=Verdict(usable=False, reasons=[Reason("interrupted", said, weight="fatal")]),
    )
    motion = {*MOTION[:2]} <= topics
    return McapRun(path, summary, metadata, {}, config, grid, [], rows, motion, is_torn=True)


def _value(text: str) -> Any:
    """Return a setting from its text in the metadata, which is JSON or the setting itself."""
    try:
        return json.loads(text)
    except ValueError:
        return text
