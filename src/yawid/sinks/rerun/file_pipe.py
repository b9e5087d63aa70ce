"""A pipe that ends in a file: Rerun writes to the pipe, and a failed write is noticed here.

Rerun's own writer stops at a failed write, and whoever then closes the recording may wait forever.
"""

import os
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import Final

from yawid.system.files import HAS_DESCRIPTOR_NAMES

_PIECE: Final = 1 << 16  # bytes; a pipe of Linux holds no more


class FilePipe:
    """Writes all that comes through a pipe to a file; ``name`` opens the pipe like a file.

    After a failed write the pipe is still read to its end, so that its writer never waits. Where a
    pipe has no name (Windows), ``name`` is the file itself, and a failed write is not noticed.
    """

    def __init__(self, path: Path) -> None:
        self._failed = ""
        self._thread = Thread(target=self._pass_on, name="rrd", daemon=True)
        if not HAS_DESCRIPTOR_NAMES:
            self.name, self._own = str(path), -1
            return
        self._file = path.open("wb", buffering=0)
        self._end, self._own = os.pipe()
        self.name = f"/dev/fd/{self._own}"
        self._thread.start()

    def release(self) -> None:
        """Close the own end: the pipe then ends as soon as whoever opened ``name`` closes it."""
        if self._own >= 0:
            os.close(self._own)

    def check(self) -> None:
        """Check that no write has failed until now.

        Raises:
            RuntimeError: one has, with the system's reason.
        """
        if self._failed:
            raise RuntimeError(self._failed)

    def finish(self, timeout_s: float) -> None:
        """Wait until the file has everything that came.

        Raises:
            RuntimeError: a write has failed, or the disk needs more than ``timeout_s``.
        """
        if self._own >= 0:
            self._thread.join(timeout_s)
        self.check()
        if self._thread.is_alive():
            raise RuntimeError(f"the disk took more than {timeout_s:g} s")

    def _pass_on(self) -> None:
        while piece := os.read(self._end, _PIECE):
            try:
                while piece and not self._failed:
                    piece = piece[self._file.write(piece) :]
            except OSError as error:
                self._failed = error.strerror or str(error)
        os.close(self._end)
        with suppress(OSError):
            self._file.close()
