"""Believe a record only if its stamp fits: within 3 days of its neighbours."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from yawid.blocks import Ints
from yawid.sources.mavlink.resync import NO_STAMP, STAMP_TOLERANCE_US, stamps_agree

_MOST_PENDING = 8


class StampFilter:
    """Sorts records by whether their stamps belong to the stream.

    A stamp belongs if it agrees with that of the last record believed. One that does not stays
    pending: a later record that agrees with it makes both believed (the clock was set), a later one
    that agrees with the last record believed drops it (the stamp was damaged). Nothing is lost if
    the very first stamp is the damaged one. ``last_us`` is the stamp of the last record believed,
    None before the first; whoever reads records that fit by other means sets it.
    """

    def __init__(self) -> None:
        self.last_us: int | None = None

    def sort(self, stamps: Ints, pending: int) -> tuple[Ints | slice, Ints]:
        """Return the rows to believe and the rows that stay pending, both rising.

        ``stamps`` (n,) are those of the records in the order received; the first ``pending`` of
        them are what the call before left pending.
        """
        fresh = stamps[pending:]
        near = np.abs(np.diff(fresh)) <= STAMP_TOLERANCE_US
        near &= (fresh[1:] != NO_STAMP) & (fresh[:-1] != NO_STAMP)
        edges = [0, *(np.flatnonzero(~near) + 1).tolist(), len(fresh)]
        if not pending and len(edges) == 2 and len(fresh) and self._continues(int(fresh[0])):
            self.last_us = int(fresh[-1])
            return slice(None), np.empty(0, np.int64)
        believed = np.zeros(len(stamps), np.bool_)
        waiting = list(range(pending))
        for first, stop in pairwise(edges):
            if first == stop:
                continue
            run = slice(pending + first, pending + stop)
            stamp = int(stamps[run.start])
            if not self._continues(stamp):
                partner = [i for i in waiting if stamps_agree(int(stamps[i]), stamp)]
                if not partner and stop - first == 1:
                    waiting = [*waiting, run.start][-_MOST_PENDING:]
                    continue
                believed[partner] = True
            believed[run] = True
            waiting = []
            self.last_us = int(stamps[run.stop - 1])
        return np.flatnonzero(believed), np.array(waiting, np.int64)

    def _continues(self, stamp: int) -> bool:
        return self.last_us is not None and stamps_agree(self.last_us, stamp)
