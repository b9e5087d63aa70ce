"""What a link carried: the counts of all of it, and of each sender."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

Sender = tuple[int, int]
"""System and component id."""


class Check(IntEnum):
    """What came of checking one frame."""

    ACCEPTED = 0
    UNSIGNED = 1
    WRONG = 2
    REPLAYED = 3


@dataclass(frozen=True, slots=True)
class SenderStats:
    """Counts of one sender.

    ``frames`` are all that are intact, ``duplicates`` and ``rejected`` (by signing) those of them
    that count no further, ``lost`` what is missing by sequence number: 0 for ground stations, whose
    frames a log holds only in part. ``bad_crc`` and ``unknown`` are frames passed over whole whose
    headers, which nothing protects, name the sender.
    """

    frames: int = 0
    lost: int = 0
    duplicates: int = 0
    rejected: int = 0
    bad_crc: int = 0
    unknown: int = 0


@dataclass(frozen=True, slots=True)
class LinkStats:
    """What has been read so far.

    ``frames`` counts the records whose stamp and frame are intact, of all senders, ``signed`` those
    of them that carry a signature (which was checked only with a key) and ``senders`` splits them
    by (sysid, compid). ``bad_crc`` and ``unknown`` count records passed over whole because the CRC
    was wrong or the message id unknown; ``skipped_bytes`` are the bytes in no record of these three
    kinds. ``lost`` counts the frames missing by sequence number, ground stations left out.
    ``first_us`` and ``last_us`` are the receive stamps of the first and last record, None before
    there is one.

    Two kinds of ``frames`` count no further: ``duplicates`` are those a second link carried too,
    ``rejected`` by kind those without a right signature (none without a key). ``by_sender`` has it
    all for each sender.
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
        """Frames refused by signing: unsigned, wrongly signed and replayed ones."""
        return sum(self.rejected.values())
