"""Two channels on one uniform grid of vehicle time: t_k = k * Ts.

y(k) is the yaw rate at the instant t_k, interpolated between the two messages around it; u(k) is
the mean over [t_k, t_k+1) of the deflection. A command is held from message to message: with these
definitions a plant without dead time has nk = 1, and the estimator finds its zero-order-hold
discretisation. A measured deflection follows a straight line between two messages. A gap is a
break: of the instants within it only the first becomes a sample, a held one, and nothing is filled
in.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from yawid.blocks import Bools, Columns, Floats, Held, Ints, Noted, SampleBlock
from yawid.channels.series import NEWEST, Piece, Series, flow_together
from yawid.channels.yaw_reader import LINEAR, ROW

MOST_INSTANTS = 2**16
"""The most instants aligned at once: a clock that leaps at each message must not fill the
memory."""


@dataclass(frozen=True, slots=True)
class AlignedRows(Columns):
    """Aligned rows, not samples yet; ``order`` (n,) is the place of each one's last message.

    ``offset_us`` (n,) is Unix time minus boot time; ``yaw`` (n, columns of ``ROW``) and ``surface``
    (n, inputs + 1) hold the values, NaN in a gap; ``moves`` (n,) is 1 where a command of the inputs
    changed within the interval; ``held`` (n,) has the bits of :class:`Held`.
    """

    k: Ints
    order: Ints
    received_us: Ints
    offset_us: Ints
    yaw: Floats
    surface: Floats
    moves: Floats
    held: Ints


@dataclass(slots=True)
class Aligner:
    """The alignment of one segment after another.

    ``gaps_us`` holds the longest message intervals that are bridged (yaw, surface), in us;
    ``lines`` the columns of the surfaces that were measured and not commanded.
    """

    sample_time_s: float
    gaps_us: tuple[float, float]
    lines: Sequence[int] = ()
    gaps: int = 0
    _kept: Piece = field(init=False)
    _next_k: int | None = None
    _in_gap: bool = False
    _last_unix_ns: int = 0
    _last_mode: float = math.nan

    def feed_piece(self, piece: Piece) -> SampleBlock | None:
        """Take one piece of a segment in; return the samples that it completes, or None."""
        if piece.opens:
            self._kept, self._next_k, self._in_gap = piece, None, False
        else:
            self._kept = Piece.joined([self._kept, piece])
        blocks = [] if self._next_k is not None else self._start()
        before = None
        while self._next_k is not None and self._next_k != before:
            before = self._next_k
            blocks += self._emit(before)
        self._prune()
        return self._samples(blocks) if blocks else None

    @property
    def _ts_us(self) -> float:
        return 1e6 * self.sample_time_s

    def _start(self) -> list[AlignedRows]:
        """Begin the grid once both channels have rows; return a held sample if a segment ended."""
        together = flow_together(self._kept.yaw, self._kept.surface)
        if together is None:
            return []
        both, begin = together
        self._next_k = math.ceil(begin / self._ts_us)
        if self._kept.why == Held.NONE:
            return []
        received = self._kept.yaw if self._kept.yaw.order[0] == both else self._kept.surface
        hole = (
            np.full((1, len(ROW)), np.nan),
            np.full((1, self._kept.surface.values.shape[1]), np.nan),
        )
        k, order, why = np.array([[self._next_k - 1], [both], [int(self._kept.why)]])
        offset_us = self._kept.offset.at(order)
        none = np.zeros(1)
        return [AlignedRows(k, order, received.received_us[:1], offset_us, *hole, none, why)]

    def _emit(self, first_k: int) -> list[AlignedRows]:
        """Return rows at the grid instants that both channels have passed, from ``first_k`` on."""
        last = min(self._kept.yaw.t_us[-1], self._kept.surface.t_us[-1] - self._ts_us) / self._ts_us
        stop = min(math.floor(last) + 3, first_k + MOST_INSTANTS)
        edges = np.arange(first_k, stop) * self._ts_us
        ready = (edges[:-1] <= self._kept.yaw.t_us[-1]) & (edges[1:] <= self._kept.surface.t_us[-1])
        n = int(ready.sum())
        if n == 0:
            return []
        k, edges = first_k + np.arange(n), edges[: n + 1]
        yaw, yaw_row, yaw_gap = self._at_instants(edges[:-1])
        surface, moves, surface_row, surface_gap = self._over_intervals(edges)
        gap = yaw_gap | surface_gap
        first_of_gap = gap & ~np.concatenate([[self._in_gap], gap[:-1]])
        self._next_k, self._in_gap = first_k + n, bool(gap[-1])
        self.gaps += int(first_of_gap.sum())
        yaw[gap], surface[gap] = np.nan, np.nan
        later = self._kept.yaw.order[yaw_row] >= self._kept.surface.order[surface_row]
        order = np.where(
            later, self._kept.yaw.order[yaw_row], self._kept.surface.order[surface_row]
        )
        received = self._kept.yaw.received_us[yaw_row], self._kept.surface.received_us[surface_row]
        received_us = np.where(later, *received)
        held = np.where(gap, int(Held.GAP), 0)
        rows = AlignedRows(
            k, order, received_us, self._kept.offset.at(order), yaw, surface, moves, held
        )
        keep = ~gap | first_of_gap
        return [rows.select(keep)] if keep.any() else []

    def _at_instants(self, t: Floats) -> tuple[Floats, Ints, Bools]:
        """Return the yaw columns at times t in us, the later of the messages used, and the gaps."""
        b = np.searchsorted(self._kept.yaw.t_us, t, side="left")
        a = np.where(self._kept.yaw.t_us[b] == t, b, b - 1)
        width = (self._kept.yaw.t_us[b] - self._kept.yaw.t_us[a]).astype(float)
        weight = (t - self._kept.yaw.t_us[a]) / np.maximum(width, 1.0)
        low, high = self._kept.yaw.values[a], self._kept.yaw.values[b]
        between = low + weight[:, None] * (high - low)
        between[:, len(LINEAR) :] = low[:, len(LINEAR) :]
        return between, b, width > self.gaps_us[0]

    def _over_intervals(self, edges: Floats) -> tuple[Floats, Floats, Ints, Bools]:
        """Return the surfaces' means over [edge, next edge) and more of each interval.

        That is 1 where a command of the inputs changed within it, the message that ends it, and
        whether it lies in a gap.
        """
        times = self._kept.surface.t_us
        inside = times[(times > edges[0]) & (times < edges[-1])].astype(float)
        cuts = np.union1d(edges, inside)
        starts = np.searchsorted(cuts, edges[:-1])
        holds = np.searchsorted(times, cuts[:-1], side="right") - 1
        value = self._kept.surface.values[holds]
        interval = (times[holds + 1] - times[holds]).astype(float)
        inputs = np.delete(value[:, :-1], [i for i in self.lines if i < value.shape[1] - 1], axis=1)
        most, least = (each.reduceat(inputs, starts, axis=0) for each in (np.maximum, np.minimum))
        moves = np.any(most > least, axis=1).astype(float)
        if self.lines:  # the mean of a straight line is its value in the middle
            weight = (0.5 * (cuts[:-1] + cuts[1:]) - times[holds]) / interval
            step = self._kept.surface.values[holds + 1] - value
            value[:, self.lines] += (weight[:, None] * step)[:, self.lines]
        area = value * np.diff(cuts)[:, None]
        mean = np.add.reduceat(area, starts, axis=0) / self._ts_us
        # The mean of a constant is its value to the bit, which the export of a run relies on.
        alone = np.diff(starts, append=len(holds)) == 1
        mean[alone] = value[starts[alone]]
        closing = np.searchsorted(times, edges[1:], side="left")
        return mean, moves, closing, np.maximum.reduceat(interval, starts) > self.gaps_us[1]

    def _prune(self) -> None:
        """Forget the rows that no later sample needs."""
        if self._next_k is None:
            # Until the other channel starts, only the newest row can reach into the first sample.
            self._kept = self._kept.select(NEWEST)
            return
        t, offset = self._next_k * self._ts_us, self._kept.offset
        yaw, surface = (_from(each, t) for each in (self._kept.yaw, self._kept.surface))
        oldest = min(yaw.order[0], surface.order[0])
        row = max(int(np.searchsorted(offset.order, oldest, side="right")) - 1, 0)
        self._kept = replace(
            self._kept, yaw=yaw, surface=surface, offset=offset.select(slice(row, None))
        )

    def _samples(self, blocks: list[AlignedRows]) -> SampleBlock:
        rows = AlignedRows.joined(blocks)
        k, u, aileron = rows.k, rows.surface[:, :-1], rows.surface[:, -1]
        row = dict(zip(ROW, rows.yaw.T, strict=True))
        rate, by_ground, bars = (row.pop(name) for name in ("r", "by_ground", "barred"))
        row["rudder_moves"] = np.fmax(rows.moves, row["rudder_moves"])
        boot_us = np.rint(k * self._ts_us).astype(np.int64)
        unix = np.append(self._last_unix_ns, (boot_us + rows.offset_us) * 1000)
        unix = np.maximum.accumulate(unix)[1:]
        self._last_unix_ns = int(unix[-1])
        barred = np.nan_to_num(bars).astype(np.int64)
        barred += int(Held.RUDDER_INVALID) * np.isnan(u).any(axis=1)
        barred += int(Held.YAW_INVALID) * np.isnan(rate)
        barred += int(Held.ON_GROUND) * (row["on_ground"] == 1.0)
        held = np.where(rows.held != 0, rows.held, barred)
        u, y = np.where(held[:, None] != 0, np.nan, u), np.where(held != 0, np.nan, rate)
        noted = int(Noted.GROUND_SPEED) * ((by_ground == 1.0) & (held == 0))
        return SampleBlock(
            sample_time_s=self.sample_time_s, k=k, boot_us=boot_us, unix_ns=unix,
            received_us=rows.received_us, u=u, y=y, aileron=aileron,
            noted=self._noted(row["mode"]) + noted, held=held,
            epoch=np.full(len(k), self._kept.epoch, np.int64), **row,
        )  # fmt: skip

    def _noted(self, mode: Floats) -> Ints:
        """Return the notes (n,) with MODE_CHANGED where the flight mode differs from the last."""
        known = np.isfinite(mode)
        changed = np.zeros(len(mode), np.int64)
        if known.any():
            first = mode[known][0] if math.isnan(self._last_mode) else self._last_mode
            steps = np.diff(mode[known], prepend=first)
            changed[known] = int(Noted.MODE_CHANGED) * (steps != 0.0)
            self._last_mode = float(mode[known][-1])
        return changed


def _from(series: Series, t: float) -> Series:
    first = max(int(np.searchsorted(series.t_us, t, side="right")) - 1, 0)
    return series.select(slice(first, None))
