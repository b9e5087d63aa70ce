"""The orders that suit a log or a finished run: ``yawid orders`` and ``--orders auto``."""

import sys
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from yawid.answers.reports import OrdersReport, OrdersTried
from yawid.answers.run_summary import DutchRoll, Orders
from yawid.blocks import SampleBlock, finite
from yawid.config.run import RunConfig
from yawid.errors import ChannelError, NotIdentifiable
from yawid.runs.job import KeptSamples, Recording, open_log, run
from yawid.sinks.terminal.progress import Bar, progress
from yawid.sources.open_log import ReadOptions

if TYPE_CHECKING:
    from yawid.offline.orders import Tried


def with_orders(source: Recording, config: RunConfig) -> RunConfig:
    """Return the configuration; orders ``auto`` are replaced by those that suit the source.

    Where no orders can be compared they are the default ones: the verdict of the replay then
    gives the reason.

    Raises:
        SourceError: the source cannot be read.
        ConfigError: what is asked for does not fit the source.
    """
    if config.orders != "auto":
        return config
    with progress(sys.stderr, "choosing orders", source.size) as bar:
        usual, kept = replace(config, orders=RunConfig().orders, manoeuvres="off"), KeptSamples()
        run(source, usual, [kept], advance=bar)
        samples = kept.joined()
        try:
            return _with(_compared(samples, config, bar)[1], config)
        except NotIdentifiable:
            return replace(config, orders=RunConfig().orders)


def _compared(
    samples: SampleBlock | None, config: RunConfig, bar: Bar
) -> tuple["list[Tried]", "Tried"]:
    """Return every structure tried on the samples, best simulation first, and the one to use.

    Raises:
        NotIdentifiable: there are too few samples.
    """
    from yawid.offline.orders import candidates, compare_orders, recommended  # seldom needed

    if samples is None:
        raise NotIdentifiable("no sample has both rudder and yaw rate")
    tried = candidates(len(config.inputs), extra_b=int(config.output == "yaw"))
    bar.begin(f"{len(tried)} structures", len(tried))
    found = compare_orders(samples.u, samples.y, samples.sample_time_s, tried, bar)
    return found, recommended(found)


def _with(chosen: "Tried", config: RunConfig) -> RunConfig:
    orders = chosen.orders
    nb = orders.nb[0] - int(config.output == "yaw")
    return replace(config, orders=(orders.na, nb, orders.nc, orders.nk[0]))


def orders_report(
    log: Path, settings: Mapping[str, Any], read_options: ReadOptions | None = None
) -> OrdersReport:
    """Return what ``yawid orders`` prints, with the verdict of a replay of the log.

    Orders are the stream's, and change no verdict. Where that is not usable none are recommended:
    they would be those of noise.

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
        config, kept = source.settled(settings), KeptSamples()
        job = run(source, replace(config, orders=RunConfig().orders), [kept], advance=bar)
        samples, verdict = kept.joined(), job.conclude().deciding
        try:
            found, chosen = _compared(samples, config, bar)
        except NotIdentifiable as error:  # the log's own first reason says more, if it has one
            first = next(iter(verdict.reasons), None)
            if first is None or (samples is not None and first.exit_code != 3):
                raise
            kind = ChannelError if first.exit_code == 3 else NotIdentifiable
            raise kind(f"{log}: {first}") from error
    return OrdersReport(
        log=str(log.absolute()),
        recommended=Orders(*_with(chosen, config).four_orders) if verdict.usable else None,
        candidates=[_described(candidate) for candidate in found],
        verdict=verdict,
    )


def _described(candidate: "Tried") -> OrdersTried:
    names = ("loss", "aic", "bic", "whiteness_p", "simulation_pct", "update_ns")
    values = finite({name: getattr(candidate, name) for name in names})
    roll, orders = DutchRoll.of(candidate.dutch_roll), candidate.orders
    own = {"na": orders.na, "nb": orders.nb[0], "nc": orders.nc, "nk": orders.nk[0]}
    return OrdersTried(**own, **values, dutch_roll=roll)
