"""The configuration and the summary of a recovered file, whose run was cut off before its end.

Configuration and grid are at the head of every file, and the newest estimate is the last state of
the run. The losses of the link and the channels are written only at the end: without them there is
no answer, and the verdict reports that.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from google.protobuf.message import DecodeError
from msgspec.structs import replace

from yawid.answers.heard import LinkCounts
from yawid.answers.model_parts import Fit
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import DutchRoll, MethodSummary, Orders, RunSummary
from yawid.answers.session import Recovered
from yawid.blocks import finite
from yawid.config.run import RunConfig, check_settings
from yawid.sinks.base import Grid
from yawid.sinks.mcap.reader import read_grid
from yawid.sinks.mcap.schemas import (
    MODE_VALUES,
    MODES,
    SAMPLE,
    TOPICS,
    estimate_topics,
    message_class,
)

CONFIGURATION, SUMMARY = "configuration.toml", "summary.json"
NAMES: Final = (CONFIGURATION, SUMMARY)
_NO_VALUE: Final = (ValueError, OverflowError, RecursionError, KeyError, TypeError, DecodeError)


@dataclass(slots=True)
class Remains:
    """The parts of a damaged file that a summary is made from, gathered while it is copied.

    ``attachments`` holds only those in ``NAMES``, ``rows`` counts the samples, ``held`` those that
    were held.
    """

    metadata: dict[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    rows: int = 0
    held: int = 0
    _first_ns: int = 0
    _last_ns: int = 0
    _newest: dict[str, bytes] = field(default_factory=dict)

    def add(self, topic: str, log_time: int, data: bytes) -> None:
        """Take the data of a copied message."""
        self._newest[topic] = data
        if topic == SAMPLE:
            self._first_ns = self._first_ns if self.rows else log_time
            self._last_ns = log_time
            self.rows += 1
            self.held += _read(topic, data).held != 0

    def attached(self, path: Path, left_out: str, *, lost: bool) -> dict[str, bytes]:
        """Return the attachments for the new file: configuration and summary.

        ``path`` is the damaged file, ``left_out`` names what was not copied, ``lost`` says whether
        messages are among that. Where there is a summary and no message is lost, or where the
        configuration cannot be read, the attachments are returned as they were found.
        """
        if SUMMARY in self.attachments and not lost:
            return self.attachments
        try:
            config = self._config()
            summary = self._summary(path, config)
            before = summary.deciding
            first = Reason("interrupted", self._missing(path, left_out), weight="fatal")
            others = [each for each in before.reasons if each.id != "interrupted"]
        except _NO_VALUE:
            return self.attachments
        summary = replace(
            summary,
            verdict=replace(before, usable=False, reasons=[first, *others]),
            recovered=Recovered(self.rows, left_out),
        )
        text = json.dumps(summary.to_json())
        return {CONFIGURATION: config.to_toml().encode(), SUMMARY: text.encode()}

    def _missing(self, path: Path, left_out: str) -> str:
        found = f"recovered from {path.name}, {self.rows} samples"
        found += f" without {left_out}" if left_out else ""
        ends = (
            ""
            if SUMMARY in self.attachments
            else "; its run was cut off, and the link was not judged"
        )
        return f"{found}{ends}: replay the log itself for an answer"

    def _config(self) -> RunConfig:
        """Return the configuration in the metadata at the head of the file."""
        texts = self.metadata["configuration"]
        settings = {name: _value(text) for name, text in texts.items()}
        given = {name: value for name, value in settings.items() if value is not None}
        return RunConfig(**check_settings(given, "configuration"))

    def _summary(self, path: Path, config: RunConfig) -> RunSummary:
        """Return the run's own summary, or one made from its newest messages."""
        if SUMMARY in self.attachments:
            return RunSummary.from_json(self.attachments[SUMMARY])
        grid = read_grid(self.metadata.get("grid"), config)
        estimates = None
        if grid is not None and self.rows:
            each = {method: self._estimate(method, grid, config) for method in grid.methods}
            estimates = {method: found for method, found in each.items() if found is not None}
        return RunSummary(
            log=str(path.absolute()),
            duration_s=max(self._last_ns - self._first_ns, 0) / 1e9,
            link=LinkCounts(),
            channels={},
            estimates=estimates,
            verdict=Verdict(usable=False, reasons=[]),
        )

    def _estimate(self, method: str, grid: Grid, config: RunConfig) -> MethodSummary | None:
        """Return a method's summary from its newest messages, None where it has none."""
        topic = estimate_topics(grid.methods)[method]
        if topic not in self._newest:
            return None
        newest = _read(topic, self._newest[topic])
        roll = None
        if method == grid.methods[0] and MODES in self._newest:
            modes = _read(MODES, self._newest[MODES])
            row = [getattr(modes, f"dutch_roll_{name}") for name in MODE_VALUES]
            roll = DutchRoll.of(row, row[1::2])
        return MethodSummary(
            method=method,
            orders=Orders(*config.orders),
            sample_time_s=grid.sample_time_s,
            forgetting_factor=config.forgetting_factor(grid.sample_time_s),
            updates=self.rows - self.held,
            held=self.held,
            theta=finite(dict(zip(grid.parameters, newest.theta, strict=True))),
            theta_std=finite(dict(zip(grid.parameters, newest.theta_std, strict=True))),
            dutch_roll=roll,
            fit=Fit(),
        )


def _value(text: str) -> Any:
    """Return a setting from its text in the metadata, which is JSON or the setting itself."""
    try:
        return json.loads(text)
    except ValueError:
        return text


def _read(topic: str, data: bytes) -> Any:
    return message_class(TOPICS[topic]).FromString(data)
