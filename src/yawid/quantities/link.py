"""The counts of what a link carried, in all and by sender."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

Sender = tuple[int, int]
"""The system and component id of a sender."""


class Check(IntEnum):
    """The result of the signature check of one frame."""

    ACCEPTED = 0
    UNSIGNED = 1
    WRONG = 2
    REPLAYED = 3


@dataclass(frozen=True, slots=True)
class SenderStats:
    """The counts of one sender.

    ``frames`` counts all intact frames, ``duplicates`` and ``rejected`` (by signing) those of them
    that are not used, ``lost`` the frames missing by sequence number: 0 for ground stations, whose
    frames a log holds only in part. ``bad_crc`` and ``unknown`` count frames passed over as a whole
    with this sender in their headers, which no checksum protects.
    """

    frames: int = 0
    lost: int = 0
    duplicates: int = 0
    rejected: int = 0
    bad_crc: int = 0
    unknown: int = 0


@dataclass(frozen=True, slots=True)
class LinkStats:
    """The counts of what has been read so far.

    ``frames`` counts the records of all senders whose stamp and frame are intact, ``signed`` those
    of them with a signature (which is checked only with a key); ``senders`` has ``frames`` by
    (sysid, compid). ``bad_crc`` and ``unknown`` count records passed over as a whole because the
    CRC was wrong or the message id unknown; ``skipped_bytes`` counts the bytes in no record of
    these three kinds. ``lost`` counts the frames missing by sequence number, without those of
    ground stations. ``first_us`` and ``last_us`` are the receive stamps of the first and the last
    record, None before the first.

    Two kinds of ``frames`` are not used: ``duplicates``, which a second link carried too, and
    ``rejected``, by kind, those without a right signature (none without a key). ``by_sender`` has
    all counts for each sender.
    """

    frames: int = 0
    skipped_bytes: int = 0
    bad_crc: int = 0
    unknown: int = 0
    lost: int = 0
    signed: int = 0
    first_us: int | None = None
    last_us: int | None = None
    senders: Mapping[Sender, int] = field(default_factory=dict)
    duplicates: int = 0
    rejected: Mapping[Check, int] = field(default_factory=dict)
    by_sender: Mapping[Sender, SenderStats] = field(default_factory=dict)

    @property
    def unsigned_rejected(self) -> int:
        """The number of frames rejected by signing: unsigned, wrongly signed and replayed ones."""
        return sum(self.rejected.values())
