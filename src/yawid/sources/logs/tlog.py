"""The reader of telemetry logs: in chunks, with a hash; other files are refused in one line."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from yawid.blocks import FrameBlock
from yawid.errors import SourceError
from yawid.quantities.link import LinkStats
from yawid.sources.logs.foreign import ARCHIVE, foreign
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.definitions import definitions
from yawid.sources.mavlink.framing import SLACK, STAMP_SIZE, find_frames, frame_size

CHUNK = 1 << 20  # half as much would save 2 MB, twice as much would cost 20
_HEAD = 1 << 20  # a log has an intact record in its first MiB


class TlogReader:
    """The pieces of a telemetry log, which may be cut anywhere, read through a decoder."""

    vehicle_id = None

    def __init__(self, pieces: Iterable[bytes], decoder: Decoder) -> None:
        self._pieces, self._decoder = pieces, decoder

    @property
    def link(self) -> LinkStats:
        """The counts of all that has been decided so far."""
        return self._decoder.link

    def read(self) -> Iterator[tuple[int, FrameBlock | None]]:
        """Yield (bytes read, the messages they complete) to the end."""
        for piece in self._pieces:
            yield len(piece), self._decoder.feed(piece)
        yield 0, self._decoder.finish()


def check_readable(path: Path) -> None:
    """Read the head of a log; return if it is a telemetry log.

    Raises:
        SourceError: there is no such file, it cannot be read, or its first MiB holds no intact
        record.
    """
    next(read_tlog(path))


def read_tlog(path: Path, chunk: int = CHUNK) -> Iterator[bytes]:
    """Yield the bytes of a log, ``chunk`` at a time.

    Raises:
        SourceError: as :func:`check_readable`, with the first piece; or reading fails later on.
    """
    if not path.is_file() and path.exists():
        kind = "is a directory" if path.is_dir() else "is not a regular file"
        raise SourceError(f"{path} {kind}: give the .tlog file itself")
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
            if head.startswith(ARCHIVE) or not _has_record(head):
                # A stored archive is not packed: the frames of all its logs would be one flight.
                raise SourceError(f"{path} {_what_it_is(path, head)}")
            data = head[:chunk]
            file.seek(len(data))
            while data:
                yield data
                data = file.read(chunk)
    except FileNotFoundError as error:
        raise SourceError(f"{path} does not exist: check the name of the log") from error
    except PermissionError as error:
        raise SourceError(f"{path} may not be read: ask for permission (chmod u+r)") from error
    except OSError as error:
        reason = error.strerror or error
        raise SourceError(
            f"{path} cannot be read ({reason}): copy the log and try again"
        ) from error


def record_at(tlog: bytes, at: int) -> bytes:
    """Return the record of a tlog, its stamp and an intact frame, that begins at an offset."""
    frame = at + STAMP_SIZE
    size = frame_size(tlog[frame : frame + 3])
    assert size is not None
    return tlog[at : frame + size]


def _has_record(head: bytes) -> bool:
    decoder = Decoder(wanted=())
    decoder.feed(head)
    decoder.finish()
    return decoder.link.frames > 0


def _what_it_is(path: Path, head: bytes) -> str:
    """Return what a file is that is no telemetry log, and what to do."""
    if not head:
        return "is empty: nothing was recorded"
    if (known := foreign(path, head)) is not None:
        return known
    if _is_text(head):
        return (
            "is a text file, neither MAVLink (MSBuild calls its files .tlog too) nor a table with "
            "a line of names (t, rudder, r) above its numbers: give a log or such a table"
        )
    if _has_bare_frames(head):
        return (
            "holds MAVLink frames without time stamps (.rlog, .raw): give the .tlog recorded with "
            "it"
        )
    return "holds no intact MAVLink record in its first MiB: give a telemetry log (.tlog)"


def _is_text(head: bytes) -> bool:
    sample = head[:4096]
    if sample.startswith((b"\xff\xfe", b"\xfe\xff")):
        return True
    controls = set(range(32)) - set(b"\t\n\r\f\x1b")
    return not controls.intersection(sample)


def _has_bare_frames(head: bytes) -> bool:
    room = bytes(SLACK)
    data = np.frombuffer(b"".join((room, head, room)), np.uint8)
    found, _ = find_frames(data, SLACK, SLACK + len(head), definitions())
    return len(found) > 0
