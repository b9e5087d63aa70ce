"""The samples of a whole log, for what looks at a record and not at a stream."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from yawid.blocks import SampleBlock
from yawid.channels.clock import Series
from yawid.channels.stage import WANTED, Channels
from yawid.config.run import RunConfig
from yawid.errors import ChannelError, NotIdentifiable, YawidError
from yawid.offline.orders import Candidate, candidates, compare_orders, recommended
from yawid.pipeline import Pipeline
from yawid.results.summary import summarise
from yawid.sinks.base import Sink
from yawid.sources.open_log import open_log
from yawid.sources.read_options import Reading


def collect(log: Path, config: RunConfig, reading: Reading | None = None) -> list[SampleBlock]:
    """Return the samples of a log as the estimators would see them.

    Raises:
        SourceError: the log cannot be read.
        ConfigError: what is asked for does not fit the log.
    """
    reading = reading or Reading()
    decoder, channels = reading.decoder(WANTED), Channels(config)
    blocks: list[SampleBlock] = []
    for _, frames in open_log(log, decoder, reading.form).read():
        blocks += [] if frames is None else channels.feed(frames)
    frames = decoder.finish()
    blocks += [] if frames is None else channels.feed(frames)
    blocks += channels.finish()
    channels.boots.check(config)
    return blocks


def run_through(
    log: Path,
    config: RunConfig,
    sinks: Sequence[Sink] = (),
    *,
    reading: Reading | None = None,
    watch: Callable[[Series, Series], None] | None = None,
) -> tuple[Pipeline, str]:
    """Replay a log without files; return the pipeline, its sinks still open, and the log's sha256.

    ``watch`` is shown the rows of yaw and surfaces as they are read.

    Raises:
        SourceError: the log cannot be read.
        ConfigError: what is asked for does not fit the log.
    """
    reading = reading or Reading()
    digest, pipeline = hashlib.sha256(), Pipeline(config, sinks, reading=reading)
    pipeline.channels.watch = watch
    pipeline.source = reader = open_log(log, pipeline.decoder, reading.form)
    for _, frames in reader.read(digest):
        pipeline.take(frames)
    pipeline.finish()
    pipeline.channels.boots.check(config)
    return pipeline, digest.hexdigest()


def try_orders(
    log: Path, config: RunConfig, reading: Reading | None = None
) -> tuple[list[Candidate], Candidate]:
    """Return every structure tried on a log, best simulation first, and the one to use.

    Raises:
        ChannelError: the log has no vehicle, rudder or yaw.
        NotIdentifiable: the log has too few samples.
        SourceError: the log cannot be read.
        ConfigError: what is asked for does not fit the log.
    """
    blocks = collect(log, config, reading)
    if not blocks:
        raise _why_nothing(log, config, reading)
    u, y = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("u", "y"))
    tried = candidates(len(config.inputs), extra_b=int(config.output == "yaw"))
    found = compare_orders(u, y, blocks[0].sample_time_s, tried)
    return found, recommended(found)


def with_orders(log: Path, config: RunConfig, reading: Reading | None = None) -> RunConfig:
    """Return the configuration with the orders that suit the log (``--orders auto``).

    Where nothing can be compared it stays as it is: the verdict of the replay then says why.
    """
    try:
        _, chosen = try_orders(log, config, reading)
    except (ChannelError, NotIdentifiable):
        return config
    orders = chosen.orders
    nb = orders.nb[0] - int(config.output == "yaw")
    return replace(config, orders=(orders.na, nb, orders.nc, orders.nk[0]))


def _why_nothing(log: Path, config: RunConfig, reading: Reading | None) -> YawidError:
    """Return what a replay's verdict says of a log without samples."""
    _, verdict = summarise(run_through(log, config, reading=reading)[0], "", "")
    first = verdict.reasons[0]
    kind = ChannelError if first.kind.exit_code == 3 else NotIdentifiable
    return kind(f"{log}: {first.id}: {first.text}")


def orders_report(log: Path, config: RunConfig, reading: Reading | None = None) -> dict[str, Any]:
    """Return what ``yawid orders --json`` prints."""
    found, chosen = try_orders(log, config, reading)
    return {
        "log": str(log.absolute()),
        "recommended": _orders(chosen),
        "candidates": [_described(candidate) for candidate in found],
    }


def _orders(candidate: Candidate) -> dict[str, int]:
    orders = candidate.orders
    return {"na": orders.na, "nb": orders.nb[0], "nc": orders.nc, "nk": orders.nk[0]}


def _described(candidate: Candidate) -> dict[str, Any]:
    names = ("loss", "aic", "bic", "whiteness_p", "simulation_pct", "update_ns")
    values = {name: getattr(candidate, name) for name in names}
    mode = zip(("wn_rad_s", "wn_std", "zeta", "zeta_std"), candidate.dutch_roll, strict=True)
    described: dict[str, Any] = _orders(candidate) | _finite(values)
    return described | ({"dutch_roll": found} if (found := _finite(dict(mode))) else {})


def _finite(values: dict[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items() if np.isfinite(value)}
