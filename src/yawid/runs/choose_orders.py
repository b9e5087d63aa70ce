"""The orders that suit a log or a finished run: ``yawid orders``."""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from yawid.answers.reports import OrdersReport
from yawid.config.run import RunConfig
from yawid.errors import ChannelError, NotIdentifiable
from yawid.runs.job import KeptSamples, open_log, run
from yawid.sinks.terminal.progress import progress
from yawid.sources.open_log import ReadOptions


def orders_report(
    log: Path, settings: Mapping[str, Any], read_options: ReadOptions | None = None
) -> OrdersReport:
    """Return what ``yawid orders`` prints, with the verdict of a replay of the log.

    The samples are those of the manoeuvres, where these have enough, and else all of the log.
    Orders are the stream's, and change no verdict. Where that is not usable none are recommended:
    they would be those of noise.

    Raises:
        ChannelError: the log has no vehicle, rudder or yaw.
        NotIdentifiable: the log has too few samples.
        SourceError: the log cannot be read.
        ConfigError: what is asked for does not fit the log.
    """
    from yawid.offline.orders import (  # seldom needed
        CANDIDATES,
        compare_orders,
        samples_of_manoeuvres,
    )

    source = open_log(log, read_options)
    with progress(sys.stderr, log.name, source.size) as bar:
        config, kept = source.settled(settings), KeptSamples()
        job = run(source, replace(config, orders=RunConfig().orders), [kept], advance=bar)
        summary = job.conclude()
        verdict = summary.deciding
        try:
            samples, used = samples_of_manoeuvres(kept.joined(), summary.manoeuvres or [])
            bar.begin(f"{len(CANDIDATES)} structures", len(CANDIDATES))
            found, chosen = compare_orders(
                samples.u, samples.y, samples.sample_time_s, config, advance=bar
            )
        except NotIdentifiable as error:  # the log's own first reason says more, if it has one
            first = next(iter(verdict.reasons), None)
            if first is None or (kept.joined() is not None and first.exit_code != 3):
                raise
            kind = ChannelError if first.exit_code == 3 else NotIdentifiable
            raise kind(f"{log}: {first}") from error
    return OrdersReport(
        log=str(log.absolute()),
        manoeuvres=used,
        recommended=chosen if verdict.usable else None,
        candidates=found,
        verdict=verdict,
    )
