"""Two benches of speed: updates of an estimator, and the reading of a telemetry log.

    python tools/bench.py estimator [--rounds 60]
    python tools/bench.py link

Every figure is the best of several measurements. On a shared machine the best shows the cost of the
code, while the mean depends on what other programs do.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from timeit import repeat, timeit
from typing import Any

import numpy as np

from bench.frame import best, table

SAMPLES, SINGLE = 4_000, 500
SETTINGS = {"no floor": (1.0, 0), "floor": (0.998, 0), "floor and diagnostics": (0.998, 20)}
"""Forgetting factor and lags of the residuals, by name."""


def updates(armax: Any, samples: list[tuple[float, float]]) -> None:
    """Update an estimator by a sample at a time."""
    for u, y in samples:
        armax.update(u, y)


def ns(count: int, call: Callable[..., object], *of: Any, **options: Any) -> float:
    """Return the time in ns of each of ``count`` updates, which a call makes."""
    return 1e9 * timeit(partial(call, *of, **options), number=1) / count


def runs(order: int) -> Iterator[tuple[str, Callable[[], float]]]:
    """Yield what measures an update of each method, and how it is called."""
    # Here, as their memory would count as that of the readers of `link`.
    from scipy.signal import lfilter

    from yawid import ArmaxOrders, EstimatorConfig, RecursiveArmax

    u, e = np.random.default_rng(0).standard_normal((2, SAMPLES))
    a, orders = (1.0, -1.5, 0.7), ArmaxOrders(order, order, order, 1)
    y = lfilter((0.0, 1.0, 0.5), a, u) + lfilter((1.0, -1.0, 0.2), a, e)
    for method, (name, (forgetting, lags)) in product(("els", "rml"), SETTINGS.items()):
        armax = RecursiveArmax(EstimatorConfig(
            orders=orders, sample_time_s=0.05, method=method, bias=False,
            forgetting_factor=forgetting, residual_lags=lags,
        ))  # fmt: skip
        armax.run(u, y)
        yield f"{method} bulk, {name}", partial(ns, SAMPLES, armax.run, u, y, keep="last")
        if name == "floor":
            samples = np.column_stack([u, y])[:SINGLE].tolist()
            yield f"{method} update, floor", partial(ns, SINGLE, updates, armax, samples)


def estimator(options: Namespace) -> list[Iterable[str]]:
    """Measure the recursive methods with 6 and 9 parameters, in blocks and sample by sample."""
    columns = {"ns per update, 6 parameters": 2, "9 parameters": 3}
    found = {column: best(dict(runs(order)), options.rounds) for column, order in columns.items()}
    return [table("", {
        name: {column: f"{of[name]:.0f}" for column, of in found.items()}
        for name in found["9 parameters"]
    })]  # fmt: skip


WANTED = (
    "ATTITUDE", "SERVO_OUTPUT_RAW", "RAW_IMU", "VFR_HUD", "RC_CHANNELS", "HEARTBEAT", "PARAM_VALUE",
)  # fmt: skip
"""What a replay reads of a log."""
MEGABYTES, MB_AN_HOUR = (20, 200), 25.8
"""The sizes of the logs (flights/long_log.py), 53 % of whose frames are wanted, and the size of an
hour."""


def read_yawid(path: Path) -> None:
    """Decode the wanted messages of a log."""
    from yawid.sources.logs.tlog import read_tlog
    from yawid.sources.mavlink.decoder import Decoder

    decoder = Decoder(WANTED)
    for chunk in read_tlog(path):
        decoder.feed(chunk)
    decoder.finish()


def read_pymavlink(path: Path) -> None:
    """Decode them by pymavlink."""
    from pymavlink import mavutil

    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    while log.recv_match(type=list(WANTED)) is not None:
        pass


READERS: dict[str, tuple[Callable[[Path], None], int]] = {
    "yawid": (read_yawid, 5),
    "pymavlink recv_match": (read_pymavlink, 1),
}
"""The readers, and how often each reads a log, of which the fastest counts."""


def measured(reader: str, path: Path) -> tuple[float, float]:
    """Return MB/s and the peak memory in MB of a reader, in this process."""
    read, times = READERS[reader]
    mb_s = path.stat().st_size / 1e6 / min(repeat(partial(read, path), number=1, repeat=times))
    # ru_maxrss would have the memory of the parent before the start in it.
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return mb_s, int(status.split("VmHWM:")[1].split()[0]) / 1024


def link(options: Namespace) -> list[Iterable[str]]:
    """Read made-up telemetry logs of MEGABYTES, each by each reader in a process of its own.

    The start of a process and its imports are not timed.
    """
    from flights.long_log import write_log

    one_each = ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1)
    with tempfile.TemporaryDirectory() as folder, one_each as pool:
        paths = [Path(folder) / f"{mb}.tlog" for mb in MEGABYTES]
        for mb, path in zip(MEGABYTES, paths, strict=True):
            write_log(path, mb / MB_AN_HOUR)
        found = {reader: zip(*pool.map(partial(measured, reader), paths), strict=True)
                 for reader in READERS}  # fmt: skip
    return [table("", {
        reader: {name: " / ".join(f"{x:.3g}" for x in each)
                 for name, each in zip(("MB/s", "peak MB"), columns, strict=True)}
        for reader, columns in found.items()
    })]  # fmt: skip
