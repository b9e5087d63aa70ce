"""Reports of overload: where more arrives than a session can estimate, drops are reported."""

from collections.abc import Iterator

from yawid.sinks.base import Pace
from yawid.sources.link.inbox import LONGEST
from yawid.sources.link.tap import Tap

BEHIND_S, CAUGHT_UP_S = 3.0, 1.0
AGAIN_S = 10.0
"""How often the number of dropped datagrams is reported again while it grows."""


class Overload:
    """A watch on how far reading is behind the link, and on the datagrams that were dropped."""

    def __init__(self, tap: Tap) -> None:
        self._tap = tap
        self._is_behind = False
        self._said = 0
        self._too_long_said = False
        self._again = Pace(AGAIN_S)

    def lines(self) -> Iterator[str]:
        """Yield a line for each new event; to be called after each read has been estimated."""
        inbox = self._tap.inbox
        behind_s = (self._tap.stamps.now() - self._tap.reached_us()) / 1e6
        if behind_s > BEHIND_S and not self._is_behind:
            self._is_behind = True
            yield (
                f"the estimates are {behind_s:.0f} s behind the link: {len(inbox)} datagrams wait, "
                "and those for which the queue has no room will be dropped"
            )
        elif behind_s < CAUGHT_UP_S and self._is_behind:
            self._is_behind = False
            yield "the estimates have caught up with the link"
        if inbox.too_long and not self._too_long_said:
            self._too_long_said = True
            yield (
                f"datagrams of more than {LONGEST} bytes arrive, which no MAVLink link sends: they "
                "are dropped and counted"
            )
        queue, system = inbox.dropped, self._tap.socket_dropped or 0
        if queue + system > self._said and self._again.due():
            self._said = queue + system
            yield (
                f"more data arrive than can be read: {queue + system} datagrams were dropped so "
                f"far ({queue} by the queue, {system} by the operating system), in no file and no "
                "estimate"
            )
