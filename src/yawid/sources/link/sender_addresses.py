"""Who sends: the address each system id was received from, and its anomalies."""

from __future__ import annotations

from yawid.sources.link.endpoints import written
from yawid.sources.link.inbox import Address

TOGETHER_US = 5_000_000
"""Two addresses received within this time of one another are two senders, not one that moved."""


class Addresses:
    """Remembers the addresses of every system id; ``latest`` has the one received last."""

    def __init__(self) -> None:
        self.latest: dict[int, Address] = {}
        self._received_us: dict[int, dict[Address, int]] = {}
        self._reported: set[int] = set()

    def observe(self, pairs: set[tuple[int, Address]], now_us: int) -> list[str]:
        """Take the (system id, address) pairs received since the last call; return new anomalies.

        A system id from two addresses at once is said one time; an address that takes over from a
        silent one is a restarted sender and not worth a line.
        """
        news = []
        for sysid, address in sorted(pairs):
            self.latest[sysid] = address
            if sysid in self._reported:
                continue
            known = self._received_us.setdefault(sysid, {})
            known[address] = now_us
            for old in [a for a, us in known.items() if now_us - us > TOGETHER_US]:
                del known[old]
            if len(known) > 1:
                self._reported.add(sysid)
                del self._received_us[sysid]
                places = " and ".join(written(*place) for place in known)
                news.append(
                    f"system {sysid} is sent from two addresses, {places}: a forged or doubled "
                    "stream, or two vehicles with one id; both are recorded and estimated"
                )
        return news
