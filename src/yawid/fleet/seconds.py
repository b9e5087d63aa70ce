"""A sink that keeps in memory when a flight begins and ends, and its Dutch roll once a second."""

import numpy as np

from yawid.dataset.values import Row, known_date
from yawid.sinks.base import Event, Grid, RunRows, Sink


class FlightSink(Sink):
    """Keeps ``first_us`` (us since 1970, None if unknown), ``duration_s`` (s) and ``seconds``.

    With ``every_second``, ``seconds`` has a row of the table ``modes`` for each second, taken from
    its first sample.
    """

    def __init__(self, *, every_second: bool = False) -> None:
        self.first_us: int | None = None
        self.duration_s: float | None = None
        self.seconds: list[Row] = []
        self._every_second = every_second
        self._boot_s, self._last_s = 0.0, -1

    def take(self, event: Event) -> None:
        """See :class:`Sink`; the modes are those of the first method."""
        if isinstance(event, Grid):
            self._method = event.methods[0]
        if not isinstance(event, RunRows):
            return
        samples, modes = event.samples, event.modes
        if self.duration_s is None:
            self.first_us = known_date(int(samples.unix_ns[0]) // 1000)
            self._boot_s = samples.boot_us[0] / 1e6
        self.duration_s = float(samples.boot_us[-1] / 1e6 - self._boot_s)
        if not self._every_second:
            return
        seconds = samples.boot_us // 1_000_000
        rows = np.flatnonzero(np.diff(seconds, prepend=self._last_s))
        self._last_s = int(seconds[-1])
        names = ("wn_rad_s", "wn_std_noise", "zeta", "zeta_std_noise")
        for row in rows.tolist():
            self.seconds.append(
                {
                    "date": known_date(int(samples.unix_ns[row]) // 1000),
                    "boot_s": float(samples.boot_us[row] / 1e6),
                    "method": self._method,
                    "held": bool(samples.held[row]),
                    **dict(zip(names, modes.dutch_roll[row].tolist(), strict=True)),
                }
            )
