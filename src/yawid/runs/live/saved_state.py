"""The estimators' state, kept in a file from one session to the next: ``--state FILE``."""

import json
import os
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import asdict
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np

from yawid.config.run import OF_RECORDS, RunConfig
from yawid.errors import ConfigError
from yawid.estimation.armax import RecursiveArmax
from yawid.estimation.bank import Bank
from yawid.pipeline import Pipeline
from yawid.runs.live.bulkhead import Bulkhead
from yawid.sinks.base import Pace
from yawid.system.part_file import os_errors_as_sink_error, write_whole

VERSION = "yawid-state-1"
SAVE_S = 60.0
_REMEDY = "to start again, remove it or give another file to --state"
# These settings choose the samples, or what is derived from the model; they do not change it.
_NOT_THE_MODEL = (
    *("sysid", "from_s", "to_s", "boot", "servo_tau", "manoeuvres", "lateral", "servo_lag"),
    "ordinary",
    *("airborne", "given"),
)
_OF_RECORDS = (*OF_RECORDS, "rudder_stroke_rad")


class StateFile(Bulkhead):
    """Estimators in a file, keyed by vehicle, channels and configuration.

    The file is a line of JSON (version, key, time, sizes), then the bytes of each estimator. A
    state of another configuration is refused at once. One of another vehicle or other channels is
    refused when these are known: estimation then starts without it, and the file is kept as
    ``<path>.old``, or ``.old-2`` and so on.

    Raises:
        ConfigError: the file exists and is not a state, or has another version or configuration.
        SinkError: the file cannot be written.
    """

    def __init__(self, path: Path, config: RunConfig, say: Callable[[str], None]) -> None:
        super().__init__("the state", "the state is no longer saved", say)
        self._path = path
        self._pace = Pace(SAVE_S)
        self._keep_old = False
        self._writing: Future[None] | None = None
        check_place(path, config)
        self._head, self._saved = _read(path)
        if self._head is not None:
            reason = _difference({"configuration": _settings(config)}, self._head["key"])
            if reason:
                raise ConfigError(f"the state in {path} does not fit this session: {reason}")

    def resume(self, bank: Bank, pipeline: Pipeline) -> None:
        """Put the saved estimators into a new bank if they fit; report whether they do."""
        if self._head is None:
            return
        head, self._head = self._head, None
        reason = _difference(_key(bank, pipeline), head["key"])
        estimators = self._saved
        if not reason and {m: e.config for m, e in estimators.items()} != {
            m: e.config for m, e in bank.estimators.items()
        }:
            reason = "the estimators are set up differently"
        if reason:
            self._keep_old = True
            self._say(
                f"the state in {self._path} does not fit this session, so estimation starts again: "
                f"{reason}"
            )
            return
        for method, estimator in estimators.items():
            # The time between the sessions is a gap: the lags must not reach across it.
            estimator.run(np.full((1, estimator.config.orders.n_inputs), np.nan), [np.nan])
            bank.estimators[method] = estimator
        minutes = (time.time() - head["saved_s"]) / 60.0
        updates = bank.estimators[bank.methods[0]].updates
        self._say(f"resumed from {self._path}: {updates} updates, saved {minutes:.0f} min ago")

    def tick(self, pipeline: Pipeline, worker: Executor) -> None:
        """Have the worker save every ``SAVE_S``; a failure to write is reported once."""
        if self._writing is not None:
            if not self._writing.done():
                return
            self.attempt(self._writing.result, None)
            self._writing = None
        if pipeline.bank is not None and self.failure is None and self._pace.due():
            self.attempt(lambda: self._begin(pipeline, worker), None)

    def save(self, pipeline: Pipeline) -> None:
        """Save now, if there is anything to save."""
        if self._writing is not None:
            self.attempt(self._writing.result, None)
        if pipeline.bank is not None:
            self.attempt(lambda: self._write(self._content(pipeline)), None)

    def _begin(self, pipeline: Pipeline, worker: Executor) -> None:
        self._writing = worker.submit(self._write, self._content(pipeline))

    def _content(self, pipeline: Pipeline) -> bytes:
        """Return the content of the file for the present state; the pipeline must have a bank."""
        bank = pipeline.bank
        assert bank is not None
        saved = {m: e.to_bytes() for m, e in bank.estimators.items()}
        head = {
            "version": VERSION,
            "key": _key(bank, pipeline),
            "saved_s": time.time(),
            "sizes": {method: len(data) for method, data in saved.items()},
        }
        return json.dumps(head).encode() + b"\n" + b"".join(saved.values())

    def _write(self, data: bytes) -> None:
        with os_errors_as_sink_error(self._path):
            if self._keep_old:
                self._keep_old = False
                self._path.replace(_free_name(self._path))
            write_whole({self._path: data}, force=True)


def check_place(path: Path, config: RunConfig) -> None:
    """Check before a flight that a state can be kept in the file.

    Raises:
        ConfigError: estimators of this configuration cannot be saved.
        SinkError: its folder cannot be written to.
    """
    if config.engine != "numba":
        raise ConfigError(f"--state needs --engine numba: {config.engine} cannot be saved")
    with os_errors_as_sink_error(path), tempfile.TemporaryFile(dir=path.absolute().parent):
        pass


def _free_name(path: Path) -> Path:
    """Return the first of ``<path>.old``, ``<path>.old-2``, ``<path>.old-3`` ... not in use."""
    names = chain([".old"], (f".old-{number}" for number in count(2)))
    kept = (path.with_name(path.name + name) for name in names)
    return next(each for each in kept if not os.path.lexists(each))


def of_vehicle(path: Path, sysid: int) -> Path:
    """Return the path of the state of one of several vehicles."""
    return path.with_name(f"{path.name}-{sysid}")


def check_states(path: Path, config: RunConfig) -> None:
    """Check before a flight that the states of all vehicles fit and can be kept.

    Raises:
        ConfigError, SinkError: as :class:`StateFile` does.
    """
    check_place(path, config)
    for own in (of_vehicle(path, sysid) for sysid in range(256)):
        if own.exists():
            StateFile(own, config, lambda _: None)


def _read(path: Path) -> tuple[dict[str, Any] | None, dict[str, RecursiveArmax]]:
    """Return the head and the estimators by method, (None, {}) where there is no file yet.

    Raises:
        ConfigError: as :class:`StateFile` does.
    """
    try:
        head_line, _, body = path.read_bytes().partition(b"\n")
    except FileNotFoundError:
        return None, {}
    except OSError as error:
        raise ConfigError(f"cannot read the state {path}: {error.strerror}") from error
    try:
        head: dict[str, Any] = json.loads(head_line)
        version, sizes = head["version"], dict(head["sizes"])
        head["key"]["configuration"], head["saved_s"] + 0.0, sum(sizes.values())
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path} is not a saved state: give another file to --state") from error
    if version != VERSION:
        raise ConfigError(f"{path} was saved as {version!r}, this is {VERSION!r}: {_REMEDY}")
    if sum(sizes.values()) != len(body):
        raise ConfigError(f"{path} is incomplete: {_REMEDY}")
    saved, at = {}, 0
    for method, size in sizes.items():
        try:
            saved[method] = RecursiveArmax.from_bytes(body[at : at + size])
        except (ConfigError, KeyError, TypeError) as error:
            raise ConfigError(f"the {method} in {path} is unusable ({error}): {_REMEDY}") from error
        at += size
    return head, saved


def _key(bank: Bank, pipeline: Pipeline) -> dict[str, object]:
    """Return all that must agree for a state to be resumed, in JSON's types."""
    channels, vehicle = pipeline.channels, pipeline.channels.lock.vehicle
    assert vehicle is not None
    key = {
        "vehicle": f"{vehicle.sysid}/{vehicle.compid}, type {vehicle.type}",
        "channels": [*map(str, channels.surfaces), channels.yaw.label],
        "configuration": _settings(channels.config),
        "sample time": bank.sample_time_s,
    }
    return dict(json.loads(json.dumps(key)))


def _settings(config: RunConfig) -> dict[str, object]:
    settings = {k: v for k, v in asdict(config).items() if k not in (*_NOT_THE_MODEL, *_OF_RECORDS)}
    return dict(json.loads(json.dumps(settings)))


def _difference(ours: dict[str, object], theirs: dict[str, object]) -> str:
    """Return a text on the first difference, "" if there is none."""
    for name, value in ours.items():
        other = theirs.get(name)
        if isinstance(value, dict) and isinstance(other, dict):
            if inner := _difference(value, other):
                return f"{name}: {inner}"
        elif value != other:
            return f"{name} is {value}, in the state {other}"
    return ""
