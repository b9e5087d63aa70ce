"""The counts of what a link carried, by sender."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from yawid.blocks import Bools, Bytes
from yawid.quantities.link import Check, LinkStats, SenderStats
from yawid.quantities.vehicles import GROUND_STATION
from yawid.sources.mavlink.definitions import HEARTBEAT, Definitions
from yawid.sources.mavlink.framing import CRC_SIZE, SIGNATURE_SIZE, STAMP_SIZE
from yawid.sources.mavlink.sequence import Records, SenderCount
from yawid.sources.mavlink.signing import Signing

GCS_SYSID = 255
_REFUSALS = (Check.UNSIGNED, Check.WRONG, Check.REPLAYED)
_TYPE_OFFSET = 4  # of HEARTBEAT.type in the payload


class Tally:
    """The counts of records that were decided on, and the choice of those to be used."""

    def __init__(self, known: Definitions, signing: Signing | None) -> None:
        self.record_bytes = 0
        self._signing = signing
        self._heartbeat = known.row_of[HEARTBEAT]
        self._signed = 0
        self._first: int | None = None
        self._last: int | None = None
        self._senders: dict[int, SenderCount] = {}
        self._ground: set[int] = set()
        self._rejected: dict[Check, int] = dict.fromkeys(_REFUSALS, 0)

    def add(self, data: bytes, buffer: Bytes, records: Records) -> Bools:
        """Count the records; return which are to be used (n,): accepted, and no duplicates.

        ``buffer`` (b,) is ``data`` as an array.
        """
        self._count_bytes(records)
        is_used = np.ones(len(records.sender), np.bool_)
        if self._signing is not None:
            is_used = self._accepted(data, records, self._signing)
        used = records.select(is_used)
        self._find_ground(buffer, used)
        is_used[is_used] = self._are_new(data, used)
        return is_used

    def _count_bytes(self, records: Records) -> None:
        frames = records.frames
        if self._first is None:
            self._first = int(records.stamps[0])
        self._last = int(records.stamps[-1])
        payload_bytes = int(frames.length.sum())
        trailer_bytes = int((frames.end - frames.payload).sum()) - payload_bytes
        self._signed += (trailer_bytes - CRC_SIZE * len(frames)) // SIGNATURE_SIZE
        header_bytes = int((frames.payload - frames.begin).sum()) + STAMP_SIZE * len(frames)
        self.record_bytes += header_bytes + payload_bytes + trailer_bytes

    def _accepted(self, data: bytes, records: Records, signing: Signing) -> Bools:
        checks = signing.check(data, records.frames, records.sysid, records.compid)
        for check in self._rejected:
            self._rejected[check] += int(np.count_nonzero(checks == check))
        is_accepted: Bools = checks == Check.ACCEPTED
        refused = np.bincount(records.sender[~is_accepted])
        for key in np.flatnonzero(refused).tolist():
            self._senders.setdefault(key, SenderCount()).rejected += int(refused[key])
        return is_accepted

    def _are_new(self, data: bytes, records: Records) -> Bools:
        is_new = np.empty(len(records.sender), np.bool_)
        for key in np.flatnonzero(np.bincount(records.sender)).tolist():
            rows = np.flatnonzero(records.sender == key)
            own = records if len(rows) == len(is_new) else records.select(rows)
            is_new[rows] = self._senders.setdefault(key, SenderCount()).add(data, own)
        return is_new

    def _find_ground(self, buffer: Bytes, records: Records) -> None:
        frames = records.frames
        rows = np.flatnonzero((frames.row == self._heartbeat) & (frames.length > _TYPE_OFFSET))
        is_ground = buffer[frames.payload[rows] + _TYPE_OFFSET] == GROUND_STATION
        self._ground.update(records.sender[rows[is_ground]].tolist())

    def stats(
        self,
        decided_bytes: int,
        passed_bytes: int,
        bad_crc: Mapping[int, int],
        unknown: Mapping[int, int],
    ) -> LinkStats:
        """Return the counts; of ``decided_bytes``, ``passed_bytes`` belong to records passed over.

        ``bad_crc`` and ``unknown`` count those records by the sender in their headers. A sender
        that has no intact record may be noise: its records count in the sums only.
        """
        by_sender = {}
        for key, sender in sorted(self._senders.items()):
            is_ground = key >> 8 == GCS_SYSID or key in self._ground
            frames = sender.frames + sender.rejected
            lost = 0 if is_ground else max(sender.lost, 0) + sender.lost_in_jumps()
            passed = bad_crc.get(key, 0), unknown.get(key, 0)
            counted = SenderStats(frames, lost, sender.duplicates, sender.rejected, *passed)
            by_sender[divmod(key, 256)] = counted
        counts = by_sender.values()
        return LinkStats(
            frames=sum(count.frames for count in counts),
            skipped_bytes=decided_bytes - passed_bytes - self.record_bytes,
            bad_crc=sum(bad_crc.values()),
            unknown=sum(unknown.values()),
            lost=sum(count.lost for count in counts),
            signed=self._signed,
            first_us=self._first,
            last_us=self._last,
            senders=MappingProxyType({key: count.frames for key, count in by_sender.items()}),
            duplicates=sum(count.duplicates for count in counts),
            rejected=MappingProxyType(dict(self._rejected)),
            by_sender=MappingProxyType(by_sender),
        )
