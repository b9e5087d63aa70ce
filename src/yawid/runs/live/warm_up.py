"""What the first sample of a process would wait for, done beside a link that is recorded."""

import threading
from dataclasses import fields
from typing import Any

import numpy as np

from yawid.blocks import SampleBlock
from yawid.config.run import RunConfig
from yawid.estimation.bank import Bank
from yawid.estimation.record_fit import fit_record
from yawid.physics.modes import modes

_SAMPLES = 300  # more than the scale window: every branch of the kernel has been loaded then
_SAMPLE_TIME_S = 0.05
MOST_HELD = 64 << 20
"""Bytes that wait for the estimators at most: a minute of a link of a megabyte a second."""


class Warming:
    """The warm-up in a thread of its own: with nothing compiled yet it takes seconds.

    ``held`` counts the bytes that wait for it, of all sessions together.
    """

    def __init__(self, config: RunConfig) -> None:
        self.held = 0
        self._failure: BaseException | None = None
        # A second signal ends the process at once: it must not wait for a compiler.
        self._thread = threading.Thread(
            target=self._run, args=(config,), name="yawid-warming", daemon=True
        )
        self._thread.start()

    def is_over(self) -> bool:
        """Whether estimators may be run now.

        Raises:
            Exception: what the warm-up failed with.
        """
        if self._thread.is_alive():
            return False
        if self._failure is not None:
            raise self._failure
        return True

    def wait(self) -> None:
        """Return when it is over; raises as :meth:`is_over` does."""
        self._thread.join()
        self.is_over()

    def _run(self, config: RunConfig) -> None:
        try:
            warm_up(config)
        except BaseException as failure:
            self._failure = failure


def warm_up(config: RunConfig) -> None:
    """Run made-up samples through estimators of this configuration and throw the result away."""
    rng = np.random.default_rng(0)
    inputs = len(config.inputs)
    columns: dict[str, Any] = {
        field.name: np.zeros(_SAMPLES, np.int64 if "Ints" in str(field.type) else np.float64)
        for field in fields(SampleBlock)
        if field.name not in ("sample_time_s", "u")
    }
    columns["y"] = rng.standard_normal(_SAMPLES)
    u = rng.standard_normal((_SAMPLES, inputs))
    samples = SampleBlock(sample_time_s=_SAMPLE_TIME_S, u=u, **columns)
    estimates = Bank(config, _SAMPLE_TIME_S).run(samples)
    modes(estimates[config.method], config.armax_orders(), _SAMPLE_TIME_S)
    # The filter of all fits, of which the start fit comes later than these samples.
    fit_record(config.estimator(config.method, _SAMPLE_TIME_S), u, columns["y"])
