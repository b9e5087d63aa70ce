"""Which orders suit a log or a finished run: ``yawid orders`` and ``--orders auto``."""

import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from yawid.blocks import SampleBlock
from yawid.config.run import RunConfig
from yawid.errors import ChannelError, NotIdentifiable, YawidError
from yawid.offline.orders import Candidate, candidates, compare_orders, recommended
from yawid.physics.modes import finite
from yawid.results.reasons import Verdict
from yawid.results.reports import OrdersReport, OrdersTried
from yawid.results.run_summary import DutchRoll, Orders
from yawid.results.summary import as_summary, summarise
from yawid.runs.run_log import KeepingPipeline, open_log, run_log, settled
from yawid.runs.trials import Trials
from yawid.sinks.terminal.progress import Bar, progress
from yawid.sources.open_log import Log, ReadOptions, Source


def try_orders(pipeline: KeepingPipeline, bar: Bar) -> tuple[list[Candidate], Candidate]:
    """Return every structure tried on a run's samples, best simulation first, and the one to use.

    Raises:
        NotIdentifiable: there are too few samples.
    """
    config = pipeline.config
    if not pipeline.kept:
        raise NotIdentifiable("no sample has both rudder and yaw rate")
    samples = SampleBlock.joined(pipeline.kept)
    tried = candidates(len(config.inputs), extra_b=int(config.output == "yaw"))
    bar.begin(f"{len(tried)} structures", len(tried))
    found = compare_orders(samples.u, samples.y, samples.sample_time_s, tried, bar)
    return found, recommended(found)


def with_orders(source: Source, config: RunConfig) -> RunConfig:
    """Return the configuration with the orders that suit a source (``--orders auto``).

    Where nothing can be compared it stays as it is: the verdict of the replay then says why.

    Raises:
        SourceError: the source cannot be read.
        ConfigError: what is asked for does not fit the source.
    """
    pipeline = KeepingPipeline(replace(config, manoeuvres="off"))
    with progress(sys.stderr, "choosing orders", source.size) as bar:
        run_log(source, pipeline, advance=bar)
        try:
            _, chosen = try_orders(pipeline, bar)
        except NotIdentifiable:
            return config
    return _with(chosen, config)


def _with(chosen: Candidate, config: RunConfig) -> RunConfig:
    orders = chosen.orders
    nb = orders.nb[0] - int(config.output == "yaw")
    return replace(config, orders=(orders.na, nb, orders.nc, orders.nk[0]))


def orders_report(
    log: Path, config: RunConfig, read_options: ReadOptions | None = None
) -> tuple[dict[str, Any], Verdict]:
    """Return what ``yawid orders --json`` prints, and the verdict of a replay with its best orders.

    None are recommended where such a replay cannot be used: they would fit what is no answer.

    Raises:
        ChannelError: the log has no vehicle, rudder or yaw.
        NotIdentifiable: the log has too few samples.
        SourceError: the log cannot be read.
        ConfigError: what is asked for does not fit the log.
    """
    with (
        closing(open_log(log, read_options, again=True)) as source,
        progress(sys.stderr, log.name, source.size) as bar,
    ):
        config = settled(source, config)
        pipeline = KeepingPipeline(replace(config, manoeuvres="off"))
        run_log(source, pipeline, advance=bar)
        if not pipeline.kept:
            raise _why_nothing(source, pipeline)
        found, chosen = try_orders(pipeline, bar)
        verdict = Trials(source, bar).of(_with(chosen, config)).verdict
    report = OrdersReport(
        log=str(log.absolute()),
        recommended=Orders(**_orders(chosen)) if verdict.usable else None,
        candidates=[_described(candidate) for candidate in found],
        verdict=as_summary(verdict),
    )
    return report.to_json(), verdict


def _why_nothing(log: Log, pipeline: KeepingPipeline) -> YawidError:
    """Return what a replay's verdict says of a log without samples."""
    _, verdict = summarise(pipeline, log.link, "", "")
    first = verdict.reasons[0]
    kind = ChannelError if first.exit_code == 3 else NotIdentifiable
    return kind(f"{log.path}: {first.id}: {first.text}")


def _orders(candidate: Candidate) -> dict[str, int]:
    orders = candidate.orders
    return {"na": orders.na, "nb": orders.nb[0], "nc": orders.nc, "nk": orders.nk[0]}


def _described(candidate: Candidate) -> OrdersTried:
    names = ("loss", "aic", "bic", "whiteness_p", "simulation_pct", "update_ns")
    values = finite({name: getattr(candidate, name) for name in names})
    roll = DutchRoll.of(candidate.dutch_roll)
    return OrdersTried(**_orders(candidate), **values, dutch_roll=roll)
